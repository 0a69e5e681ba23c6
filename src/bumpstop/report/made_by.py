"""What made a page: the command, the day, and the versions of what worked on it."""

from __future__ import annotations

import platform
from datetime import UTC, datetime
from importlib.metadata import version

from bumpstop._native import target
from bumpstop.text_files import running_command


def made_by() -> dict[str, str]:
    """Command and day, where a command makes the page, and versions; by name, in the order in which they are read.

    A page that a program makes has no day: the same result then gives the same bytes.
    """
    command = running_command()
    made = {"command": command, "date": datetime.now(tz=UTC).date().isoformat()} if command else {}
    return made | {
        "bumpstop": version("bumpstop"),
        "numpy": version("numpy"),
        "Python": platform.python_version(),
        "kernels": target,
    }
