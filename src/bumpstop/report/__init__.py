"""Reports: a collision's force distribution as one page a person can read, print and file."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bumpstop.report.collision.page import write_report

__all__ = ["write_report"]


def __getattr__(name: str) -> Any:
    """Import what draws with matplotlib when it is asked for: colours and HTML need none of it."""
    if name == "write_report":
        from bumpstop.report.collision.page import write_report

        return write_report
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
