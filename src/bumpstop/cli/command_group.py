"""Groups of commands whose help lists them in the order of the work, with their whole first sentence."""

from __future__ import annotations

from typing import Any

import typer
from typer.core import TyperGroup

# How hard a collision is, what brings it below the limits, recordings, and what is made of them.
_ORDER = (
    *(
        "new",
        "evaluate",
        "view",
        "measure",
        "report",
        "program",
        "require",
        "sensitivity",
        "stopping",
        "study",
        "campaign",
    ),
    *(
        "robots",
        "bodies",
        "recording",
        "plan",
        "identify",
        "validate",
        "tune",
        "detect",
        "score",
        "detector",
        "monitor",
    ),
    "benchmark",
    *("plant", "experiment"),
)
_WHOLE_SENTENCE = 1000  # characters: longer than any


class CommandGroup(TyperGroup):
    """A group of commands; those that the order of the work does not name stand in the order of their code."""

    def list_commands(self, context: Any) -> list[str]:
        """Names, in the order of the work."""
        names = super().list_commands(context)
        return sorted(names, key=lambda name: _ORDER.index(name) if name in _ORDER else len(_ORDER))

    def format_commands(self, context: Any, formatter: Any) -> None:
        """Write a row for each command; click would cut its description to what one line holds."""
        rows = []
        for name in self.list_commands(context):
            command = self.get_command(context, name)
            if command is not None and not command.hidden:
                rows.append((name, command.get_short_help_str(_WHOLE_SENTENCE)))
        with formatter.section("Commands"):
            formatter.write_dl(rows)


def group(help_text: str, name: str | None = None) -> typer.Typer:
    """A group of commands, whose help and errors are plain text."""
    return typer.Typer(
        cls=CommandGroup, name=name, rich_markup_mode=None, pretty_exceptions_enable=False, help=help_text
    )
