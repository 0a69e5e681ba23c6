"""Figures: what they look like, and how they become PNG, SVG and part of a page."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import matplotlib
import matplotlib.style
from matplotlib.figure import Figure

from bumpstop.report.colours import AREA, EVENT, FAINT, INK, LAW, LIMIT
from bumpstop.report.markup import Html, element

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis

__all__ = [
    "AREA",
    "EVENT",
    "FAINT",
    "INK",
    "LAW",
    "LIMIT",
    "PAPER",
    "WIDTH",
    "Picture",
    "Rendered",
    "axes",
    "plain_ticks",
    "scale_by",
    "spread",
    "stack",
]

# Box of a label that may lie on a line, which then does not run through it.
PAPER: dict[str, Any] = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 0.6}

# 5 inches fill a phone's width at about the size they have on paper, and half a desktop page.
WIDTH = 5.0

# Width of a digit, and what keeps two numbers apart, in units of the font's size.
_LETTER, _BETWEEN = 0.62, 0.4

_STYLE: dict[str, Any] = {
    "font.size": 9.5,
    "axes.titlesize": 10.5,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # saves a search for what stands above every panel, a tenth of the drawing
    "axes.labelsize": 9.5,
    "axes.edgecolor": FAINT,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "lines.linewidth": 1.8,
    "hatch.linewidth": 0.6,
    "legend.frameon": False,
    "axes.formatter.useoffset": False,  # of 8.001 and 8.002 both are read at the scale itself
    "svg.fonttype": "none",
    "text.parse_math": False,  # a dollar in a user's name is a dollar
}
# matplotlib's own; without a date and a version the same distribution makes the same bytes.
_NO_METADATA = {"svg": dict.fromkeys(("Date", "Creator", "Format", "Type")), "png": {"Software": None}}


@dataclass(frozen=True)
class Picture:
    """A figure to be drawn.

    Attributes:
        name: of its files, without extension; unique in a report.
        alt: what it shows, for those who do not see it.
        caption: the text below it.
        draw: puts the content into an empty figure.
        height: [inch]; every figure is as wide as the others.
    """

    name: str
    alt: str
    caption: str
    draw: Callable[[Figure], None]
    height: float = 3.2

    def render(self) -> Rendered:
        """Draw it."""
        with self.style():
            figure = Figure(figsize=(WIDTH, self.height))
            self.draw(figure)
            for panel in figure.axes:
                _thin_ticks(panel)
        return Rendered(self, figure)

    @contextmanager
    def style(self) -> Iterator[None]:
        """While open, matplotlib's defaults and the report's look hold, whatever the reader has set."""
        with matplotlib.style.context(["default", _STYLE | {"svg.hashsalt": self.name}]), warnings.catch_warnings():
            # Names in scripts that the font lacks: an SVG leaves letters to whoever shows it, a PNG has boxes for them.
            warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
            yield


@dataclass(frozen=True, eq=False)
class Rendered:
    """A drawn figure, as files and as part of a page; the same picture gives the same bytes.

    Attributes:
        picture: what was drawn.
        figure: the drawing.
    """

    picture: Picture
    figure: Figure

    @cached_property
    def svg(self) -> str:
        """A drawing of lines and text, as a file of its own."""
        return self._saved("svg").decode("utf-8")

    @cached_property
    def png(self) -> bytes:
        """A drawing of dots, 120 to the inch."""
        return self._saved("png")

    def _saved(self, kind: str) -> bytes:
        file = io.BytesIO()
        with self.picture.style():
            self.figure.savefig(file, format=kind, dpi=120, metadata=_NO_METADATA[kind])
        return file.getvalue()

    def html(self) -> Html:
        """The figure with its caption, drawn inside the page."""
        return element("figure", self._inline(), element("figcaption", self.picture.caption))

    def _inline(self) -> Html:
        """The drawing as an element of a page: no prolog, no fixed size, names that no other figure has."""
        name = self.picture.name
        drawing = self.svg[self.svg.index(">", self.svg.index("<svg")) + 1 : self.svg.rindex("</svg>")]
        # The style element would hold for the whole page; the page's own sheet says the same.
        drawing = re.sub(r"<style.*?</style>", "", drawing, flags=re.DOTALL)
        drawing = re.sub(r'\b(id|xlink:href)="(#?)', rf'\1="\2{name}-', drawing)
        drawing = drawing.replace("url(#", f"url(#{name}-")
        box = re.search(r'viewBox="([^"]*)"', self.svg)
        assert box is not None
        return element("svg", Html(drawing), viewBox=box[1], role="img", aria_label=self.picture.alt)


def axes(figure: Figure, *, left: float = 0.62, right: float = 0.15, bottom: float = 0.48, top: float = 0.32) -> Axes:
    """One pair of axes with margins in inches: fixed, so that figures side by side line up."""
    width, height = figure.get_size_inches()
    return figure.add_axes((left / width, bottom / height, 1 - (left + right) / width, 1 - (bottom + top) / height))


def stack(
    figure: Figure,
    heights: list[float],
    *,
    left: float = 0.62,
    right: float = 0.15,
    gap: float = 0.12,
    bottom: float = 0.48,
    top: float = 0.32,
) -> list[Axes]:
    """Panels above one another that share the horizontal axis; heights relative, margins in inches."""
    width, height = figure.get_size_inches()
    unit = (height - bottom - top - gap * (len(heights) - 1)) / sum(heights)
    panels: list[Axes] = []
    upper = height - top
    for share in heights:
        lower = upper - share * unit
        box = (left / width, lower / height, 1 - (left + right) / width, share * unit / height)
        panels.append(figure.add_axes(box, sharex=panels[0] if panels else None))
        upper = lower - gap
    for panel in panels[:-1]:
        panel.tick_params(labelbottom=False)
    return panels


def _thin_ticks(panel: Axes) -> None:
    """Fewer ticks on a horizontal scale whose labels would touch: matplotlib leaves room for three letters."""
    from matplotlib.ticker import MaxNLocator

    panel.apply_aspect()
    axis, (low, high) = panel.xaxis, panel.get_xlim()
    width = panel.bbox.width * 72 / panel.figure.dpi  # pt
    while isinstance(axis.get_major_locator(), MaxNLocator):
        ticks = [tick for tick in axis.get_majorticklocs() if low <= tick <= high]
        shown = axis.get_ticklabels()  # none on a panel above another
        if len(ticks) < 3 or not shown:
            return
        letters = max(len(label) for label in axis.get_major_formatter().format_ticks(ticks))
        size = shown[0].get_fontproperties().get_size_in_points()
        if (_LETTER * letters + _BETWEEN) * size <= width * (ticks[1] - ticks[0]) / (high - low):
            return
        if len(ticks) == 3:
            # Fewer may be impossible for matplotlib: it tries finer steps where the coarser has one tick alone.
            axis.set_ticks(ticks[::2])
            return
        panel.locator_params(axis="x", nbins=len(ticks) - 2)


def plain_ticks(axis: Axis, ticks: Sequence[float] | None = None) -> None:
    """Numbers at the ticks of a logarithmic axis, as powers would need mathematical text; none at minor ticks."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    if ticks is not None:
        axis.set_ticks(list(ticks))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def scale_by(factor: float) -> tuple[Callable[[Any], Any], Callable[[Any], Any]]:
    """Functions of a second scale that shows ``factor`` times the values of the first, and back."""
    return lambda value: value * factor, lambda value: value / factor


def spread(positions: list[float], gap: float, low: float, high: float) -> list[float]:
    """Move label positions apart until neighbours are ``gap`` away from each other, between ``low`` and ``high``.

    The order stays. Where there is no room for all, the gap shrinks.
    """
    n = len(positions)
    if n == 0:
        return []
    gap = min(gap, (high - low) / max(1, n - 1))
    order = sorted(range(n), key=positions.__getitem__)
    placed = [min(max(positions[i], low), high) for i in order]
    # Up past the neighbour below, then down from the ceiling: two passes settle it.
    for i in range(1, n):
        placed[i] = max(placed[i], placed[i - 1] + gap)
    placed[-1] = min(placed[-1], high)
    for i in range(n - 2, -1, -1):
        placed[i] = min(placed[i], placed[i + 1] - gap)
    result = [0.0] * n
    for i, position in zip(order, placed, strict=True):
        result[i] = position
    return result
