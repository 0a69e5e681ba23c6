"""Formulas as MathML, which browsers draw without a script or a font of ours."""

from __future__ import annotations

from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml


def _visit(translator: Any, node: nodes.Element, *, block: bool) -> None:
    formula = tex2mathml(node.astext(), as_block=block)
    opening = f'<div class="formula"{_identifier(node)}>' if block else ""
    translator.body.append(f"{opening}{formula}{'</div>' if block else ''}")
    raise nodes.SkipNode


def _identifier(node: nodes.Element) -> str:
    return f' id="{node["ids"][0]}"' if node.get("ids") else ""


def visit_inline(translator: Any, node: nodes.Element) -> None:
    """Write a formula inside a line."""
    _visit(translator, node, block=False)


def visit_block(translator: Any, node: nodes.Element) -> None:
    """Write a formula by itself."""
    _visit(translator, node, block=True)


def setup(app: Any) -> dict[str, bool]:
    """Register the renderer under the name ``mathml``."""
    app.add_html_math_renderer("mathml", (visit_inline, None), (visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
