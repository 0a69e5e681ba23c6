"""Figures and pages that the program makes while the site is built: ``{made-figure}`` and ``{gallery}``."""

from __future__ import annotations

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from figures import PICTURES
from sphinx.util.docutils import SphinxDirective

ROOT = Path(__file__).resolve().parents[2]
_HAND, _SIGNED = "examples/01_hand_downward.toml", '--cell Press --author "A. Smith" --revision A'
# Name of the page, the command that makes it, its first page, what it shows.
GALLERY = (
    ("hand", f"evaluate {_HAND}", "report.html", "A collision that is acceptable"),
    ("lower_arm", "evaluate examples/02_lower_arm_downward.toml", "report.html", "A collision that is not"),
    ("uncertain", "evaluate examples/07_hand_uncertain.toml", "report.html", "A verdict with an interval"),
    ("cell", "evaluate examples/register/sia5d_downward.csv", "report.html", "All contact situations of a cell"),
    ("dossier", f"report examples/register/sia5d_downward.csv {_SIGNED}", "report.html", "A dossier to print and sign"),
    ("parameters", f"study parameters {_HAND} --vary motion.speed=10:100", "report.html", "What lowers the force"),
    ("gauge", "measure read examples/measure/hand.csv", "report.html", "A recording of a force gauge"),
)


class MadeFigure(SphinxDirective):
    """A figure that :mod:`figures` draws, with its caption."""

    required_arguments = 1
    has_content = True
    option_spec: ClassVar[dict[str, Any]] = {"name": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        """An image of the file that was drawn before the pages were read."""
        (picture,) = [picture for picture in PICTURES if picture.name == self.arguments[0]]
        image = nodes.image(uri=f"/made/{picture.name}.svg", alt=picture.alt, classes=["made"])
        image["uri"] = f"/made/{picture.name}.svg"
        caption = nodes.caption()
        caption += self.parse_inline(" ".join(self.content))[0]
        return [nodes.figure("", image, caption)]


class Gallery(SphinxDirective):
    """Links to pages that commands make, each with its command."""

    def run(self) -> list[nodes.Node]:
        """An entry for each page."""
        text = []
        for name, command, page, title in GALLERY:
            text += [f"### {title}", "", f'<a href="made/{name}/{page}">Open the page</a>', ""]
            text += ["```sh", f"bumpstop {command} --out out/{name}", "```", ""]
        return self.parse_text_to_nodes("\n".join(text), allow_section_headings=True)


def draw(app: Any) -> None:
    """Draw every figure anew, before pages are read."""
    folder = Path(app.srcdir) / "made"
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    for picture in PICTURES:
        (folder / f"{picture.name}.svg").write_text(picture.render().svg, encoding="utf-8")


def make_pages(app: Any, failure: Exception | None) -> None:
    """Run the commands of the gallery into the built site."""
    if failure is not None or app.builder.name != "html":
        return
    program = "from bumpstop.cli.main import main; main()"
    for name, command, page, _ in GALLERY:
        out = Path(app.outdir) / "made" / name
        shutil.rmtree(out, ignore_errors=True)
        words = [sys.executable, "-c", program, *shlex.split(command), "--out", str(out)]
        done = subprocess.run(words, cwd=ROOT, env=os.environ, capture_output=True, text=True, check=False)
        if done.returncode not in (0, 3, 4) or not (out / page).exists():
            raise RuntimeError(f"bumpstop {command}: exit status {done.returncode}\n{done.stdout}{done.stderr}")


def setup(app: Any) -> dict[str, bool]:
    """Register the directives and what they show."""
    app.add_directive("made-figure", MadeFigure)
    app.add_directive("gallery", Gallery)
    app.connect("builder-inited", draw)
    app.connect("build-finished", make_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
