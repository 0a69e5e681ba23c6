"""A comparison of the validation on a page, run while the site is built: ``{comparison}``."""

from __future__ import annotations

import contextlib
import importlib
import io
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).resolve().parents[2]


class Comparison(SphinxDirective):
    """Paragraphs, tables and checks of a comparison, in its order; the argument is its module under ``validation``."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Run the comparison in full and write down what it finds."""
        # The reference simulators that comparisons use live with the tests.
        for folder in (ROOT, ROOT / "tests"):
            if str(folder) not in sys.path:
                sys.path.insert(0, str(folder))
        module = importlib.import_module(f"validation.{self.arguments[0]}")
        from validation.findings import Findings

        findings = Findings(self.arguments[0].rpartition(".")[2], module.TITLE)
        with contextlib.redirect_stdout(io.StringIO()):
            module.compare(findings, quick=False)
        return self.parse_text_to_nodes("\n".join(as_markdown(findings)))


def as_markdown(findings: Any) -> list[str]:
    """Lines of Markdown, of everything that was found.

    Args:
        findings: of a comparison, :class:`validation.findings.Findings`.
    """
    from validation.findings import Check, Table

    lines: list[str] = []
    for item in findings.items:
        if isinstance(item, Check):
            detail = f": {item.detail}" if item.detail else ""
            lines.append(f"- **{'PASS' if item.passed else 'FAIL'}** {item.what}{detail}")
        elif isinstance(item, Table):
            cells = [item.headings, ["---"] * len(item.headings), *item.shown()]
            lines += ["", f"**{item.caption}**", ""]
            lines += ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in cells]
            lines.append("")
        elif type(item) is str:
            lines += ["", item, ""]
        else:
            raise TypeError(f"{findings.name}: no page shows a {type(item).__name__}")
    return lines


def setup(app: Any) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("comparison", Comparison)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
