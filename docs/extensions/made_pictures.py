"""Figures and pages that the program makes while the site is built: ``{made-figure}`` and ``{gallery}``."""

from __future__ import annotations

import html
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
PROGRAM = "from bumpstop.cli.main import main; main()"
_HAND, _SIGNED = "examples/01_hand_downward.toml", '--cell Press --author "A. Smith" --revision A'
_PROGRAM = "program examples/programs/place.mod --scenario examples/programs/cell.toml"
# Name of the page, the command that makes it, the picture on it that stands for it, what it shows.
GALLERY = (
    ("hand", f"evaluate {_HAND}", "peak_force", "A collision that is acceptable"),
    ("lower_arm", "evaluate examples/02_lower_arm_downward.toml", "limits_over_area", "A collision that is not"),
    ("uncertain", "evaluate examples/07_hand_uncertain.toml", "exceedance_band", "A verdict with an interval"),
    ("cell", "evaluate examples/register/sia5d_downward.csv", "use_of_limits", "All contact situations of a cell"),
    ("dossier", f"report examples/register/sia5d_downward.csv {_SIGNED}", "use_of_limits", "A dossier to sign"),
    ("parameters", f"study parameters {_HAND} --vary motion.speed=10:100", "parameter_1", "What lowers the force"),
    ("effectiveness", f"study effectiveness {_HAND}", "effectiveness", "Who may be hit, and how fast"),
    (
        "speed_limits",
        "study speed-limits examples/06_pick_and_place_trajectory.toml",
        "speed_limits",
        "The highest safe speed along a trajectory",
    ),
    ("program", _PROGRAM, "segments", "A robot program, move by move"),
    ("stopping", "stopping examples/stopping/tm5_700.toml", "stopping_1", "How an arm slows down"),
    ("plan", f"measure plan {_HAND}", "expected_forces", "What to measure with a gauge"),
    ("gauge", "measure read examples/measure/hand.csv", "recording_1", "A recording of a force gauge"),
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
    """Pictures that commands draw, each a link to its page, with its command."""

    def run(self) -> list[nodes.Node]:
        """An entry for each page."""
        text = ['<div class="gallery">']
        for name, command, picture, title in GALLERY:
            image = f'<img src="made/{name}/{picture}.svg" alt="">'
            shown = html.escape(f"bumpstop {command} --out out/{name}", quote=False)
            text.append(f'<figure><a href="made/{name}/report.html">{image}{title}</a><code>{shown}</code></figure>')
        return [nodes.raw("", "\n".join([*text, "</div>"]), format="html")]


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
    for name, command, _, _ in GALLERY:
        out = Path(app.outdir) / "made" / name
        shutil.rmtree(out, ignore_errors=True)
        words = [sys.executable, "-c", PROGRAM, *shlex.split(command), "--out", str(out)]
        done = subprocess.run(words, cwd=ROOT, env=os.environ, capture_output=True, text=True, check=False)
        if done.returncode not in (0, 3, 4) or not (out / "report.html").exists():
            raise RuntimeError(f"bumpstop {command}: exit status {done.returncode}\n{done.stdout}{done.stderr}")


def setup(app: Any) -> dict[str, bool]:
    """Register the directives and what they show."""
    app.add_directive("made-figure", MadeFigure)
    app.add_directive("gallery", Gallery)
    app.connect("builder-inited", draw)
    app.connect("build-finished", make_pages)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
