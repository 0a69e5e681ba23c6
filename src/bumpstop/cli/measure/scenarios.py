"""Contact situations that commands name: scenario files by their stems or names of their own, and registers."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.collision import Scenario
    from bumpstop.register.situation import Situation


def named_scenarios(given: Sequence[str], changes: dict[str, Any], option: str) -> list[tuple[str, Scenario]]:
    """Names and scenarios of :func:`named_situations`."""
    return [(one.name, one.scenario) for one in named_situations(given, changes, option)]


def named_situations(given: Sequence[str], changes: dict[str, Any], option: str) -> list[Situation]:
    """Situations, in order: each ``FILE``, called after its stem, or ``NAME=FILE``; every row of a register.

    Raises:
        InputError: two have one name, or a file cannot be used.
    """
    from bumpstop.collision import load_scenario
    from bumpstop.register import load_register
    from bumpstop.register.register_file import is_register
    from bumpstop.register.situation import Situation

    found: list[Situation] = []
    for text in given:
        if is_register(Path(text)):
            for situation in load_register(text, changes=changes).situations:
                if any(situation.name == other.name for other in found):
                    raise InputError(option, f"{situation.name!r} of {text} is named twice", "give it another name")
                found.append(situation)
            continue
        name, equals, file = text.partition("=")
        if not equals or "/" in name or Path(text).exists():
            name, file = Path(text).stem, text
        if any(name == other.name for other in found):
            raise InputError(option, f"{name!r} is named twice", "give one of them as NAME=FILE")
        scenario, path = load_scenario(file, dict(changes)), Path(file)
        found.append(Situation(name=name, scenario=scenario, file=path, scenario_file=path, changed=frozenset(changes)))
    return found
