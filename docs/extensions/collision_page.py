"""A page that computes collisions in the browser: ``{collision-page}``. It is made where Emscripten is installed."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).resolve().parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

from web import build  # noqa: E402

# Where the files of the page stand in the site.
SCRIPT, STYLE = "_static/bumpstop.js", "_static/bumpstop.css"
MISSING = "Emscripten was not installed where this site was built: there is nothing to compute with here."


class CollisionPage(SphinxDirective):
    """The place that the script fills; one sentence where it could not be made."""

    def run(self) -> list[nodes.Node]:
        """The place, with its script and its style."""
        if build.compiler() is None:
            return [nodes.paragraph("", MISSING)]
        up = "../" * self.env.docname.count("/")
        text = (
            f'<link rel="stylesheet" href="{up}{STYLE}">\n'
            '<div id="bumpstop"><noscript>This needs a browser that runs scripts.</noscript></div>\n'
            f'<script src="{up}{SCRIPT}" defer></script>'
        )
        return [nodes.raw("", text, format="html")]


def make_script(app: Any, failure: Exception | None) -> None:
    """Write the files of the page into the built site."""
    if failure is not None or app.builder.name != "html" or build.compiler() is None:
        return
    script, style = Path(app.outdir) / SCRIPT, Path(app.outdir) / STYLE
    script.write_text(build.script(), encoding="utf-8")
    shutil.copyfile(build.HERE / "page.css", style)


def setup(app: Any) -> dict[str, bool]:
    """Register the directive and what it shows."""
    app.add_directive("collision-page", CollisionPage)
    app.connect("build-finished", make_script)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
