"""Reports: a collision's force distribution as one page a person can read, print and file."""

from bumpstop.report.collision.page import write_report

__all__ = ["write_report"]
