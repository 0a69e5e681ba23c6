"""Pages of the documentation: their code, tables and sections."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md")])
CLI = sorted((ROOT / "docs" / "reference" / "cli").glob("*.md"))
WIDTH = "110"  # of the consoles in docs/reference/cli
AS_DOCTEST = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE


def read(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


def command_line() -> str:
    """All pages of the command line, one behind the other."""
    return "\n".join(page.read_text(encoding="utf-8") for page in CLI)


def blocks(page: Path, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)


def section(text: str, heading: str) -> str:
    """What stands under a heading, up to the next of its rank or above."""
    begin = text.index(f"\n{heading}\n") + len(heading) + 2
    rank = len(heading) - len(heading.lstrip("#"))
    end = re.compile(rf"^#{{1,{rank}}} ", re.MULTILINE).search(text, begin)
    return text[begin : end.start() if end else None]


def rows(text: str, first_column: str) -> list[list[str]]:
    """Cells of the rows of every table whose first column is called so."""
    found: list[list[str]] = []
    inside = False
    for line in text.splitlines():
        cells = [cell.strip() for cell in line.strip().strip("|").split("|")] if line.startswith("|") else []
        if not cells:
            inside = False
        elif cells[0] == first_column:
            inside = True
        elif inside and not set(cells[0]) <= {"-"}:
            found.append(cells)
    assert found, f"no table begins with {first_column!r}"
    return found


def without_fences(text: str) -> str:
    return re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)


def code(cell: str) -> list[str]:
    return re.findall(r"`([^`]+)`", cell)
