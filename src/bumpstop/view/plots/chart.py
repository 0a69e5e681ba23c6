"""A chart as SVG: axes, lines, areas and limits with their names.

matplotlib needs a tenth of a second for a figure, which is the time that a slider has for everything.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.report.colours import EVENT, FAINT, INK, LIMIT
from bumpstop.report.markup import Html, element, escape

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray

WIDTH, _LEFT, _RIGHT, _TOP, _BOTTOM = 380.0, 46.0, 10.0, 22.0, 34.0
_LETTER, _ROW = 5.6, 13.0  # width of a letter at the size of labels, and from one line of text to the next
_LABEL = {"font_size": "11", "font_family": "system-ui, sans-serif"}


class Chart:
    """A chart of one x and one y axis.

    Args:
        title: above it.
        x, y: first and last value of the axes; the y axis may be logarithmic.
        x_label, y_label: quantity and unit.
        height: [px] of a chart that is 380 px wide; it grows with the panel.
        log_y: powers of ten on the y axis.
        name: by which the page and tests find it.
    """

    def __init__(
        self,
        title: str,
        x: tuple[float, float],
        y: tuple[float, float],
        *,
        labels: tuple[str, str],
        height: float = 190.0,
        log_y: bool = False,
        name: str = "",
    ) -> None:
        self._title, self._height, self._log_y, self._name = title, height, log_y, name
        self._x = x if x[1] > x[0] else (x[0] - 1.0, x[0] + 1.0)
        self._y = y if y[1] > y[0] else (y[0], y[0] + 1.0)
        self._labels = labels
        self._parts: list[Html] = []
        self._over: list[Html] = []
        self._taken: list[tuple[float, float, float, float]] = []

    def to_x(self, value: float) -> float:
        """Where a value of the x axis stands [px]."""
        low, high = self._x
        return _LEFT + (value - low) / (high - low) * (WIDTH - _LEFT - _RIGHT)

    def to_y(self, value: float) -> float:
        """Where a value of the y axis stands [px]."""
        low, high = self._y
        if self._log_y:
            value, low, high = (math.log10(max(v, 1e-300)) for v in (value, low, high))
        share = min(1.0, max(0.0, (value - low) / (high - low)))
        return _TOP + (1 - share) * (self._height - _TOP - _BOTTOM)

    def _points(self, x: FloatArray, y: FloatArray) -> str:
        low, high = self._x
        kept = (x >= low) & (x <= high) & np.isfinite(y)
        values, (bottom, top) = y[kept], self._y
        if self._log_y:
            values, bottom, top = np.log10(np.maximum(values, 1e-300)), math.log10(bottom), math.log10(top)
        across = _LEFT + (x[kept] - low) / (high - low) * (WIDTH - _LEFT - _RIGHT)
        share = np.clip((values - bottom) / (top - bottom), 0.0, 1.0)
        up = _TOP + (1 - share) * (self._height - _TOP - _BOTTOM)
        return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(across.tolist(), up.tolist(), strict=True))

    def line(self, x: FloatArray, y: FloatArray, colour: str, *, dash: str | None = None, width: float = 1.6) -> None:
        """A line through points; values beyond the y axis stand at its end."""
        self._parts.append(
            element(
                "polyline",
                points=self._points(x, y),
                fill="none",
                stroke=colour,
                stroke_width=f"{width}",
                stroke_dasharray=dash,
            )
        )

    def area(self, x: FloatArray, y: FloatArray, colour: str, line: str) -> None:
        """The area between a line and the x axis, and the line."""
        if x.size:
            base = self.to_y(self._y[0])
            # The way is closed for filling alone: one list of points serves area and line.
            points = f"{self.to_x(float(x[0])):.1f},{base} {self._points(x, y)} {self.to_x(float(x[-1])):.1f},{base}"
            self._parts.append(
                element("polyline", points=points, fill=colour, fill_opacity="0.45", stroke=line, stroke_width="1.6")
            )

    def beyond(self, x: float) -> None:
        """Hatch what lies beyond a value of the x axis."""
        left = max(self.to_x(max(x, self._x[0])), _LEFT)
        if left < WIDTH - _RIGHT:
            self._parts.append(
                element(
                    "rect",
                    x=f"{left:.1f}",
                    y=f"{_TOP}",
                    width=f"{WIDTH - _RIGHT - left:.1f}",
                    height=f"{self._height - _TOP - _BOTTOM:.1f}",
                    fill="url(#hatch)",
                )
            )

    def vertical(self, x: float, label: str, colour: str = LIMIT, *, dash: str = "6 3") -> None:
        """A line across at a value of the x axis, its label at its side; an arrow where it stands beyond the axis."""
        if x > self._x[1]:
            self._note(f"{label} →", colour, (WIDTH - _RIGHT - 2, _TOP + 11, "end"))
            return
        at = self.to_x(max(x, self._x[0]))
        self._across(at, at, _TOP, self._height - _BOTTOM, colour, dash)
        left = at + 5 + _LETTER * len(label) > WIDTH - _RIGHT
        self._note(label, colour, (at - 4, _TOP + 11, "end") if left else (at + 4, _TOP + 11, "start"))

    def horizontal(self, y: float, label: str, colour: str = LIMIT, *, dash: str = "6 3") -> None:
        """A line across at a value of the y axis, its label at its right end, above it if that is free."""
        at = self.to_y(y)
        self._across(_LEFT, WIDTH - _RIGHT, at, at, colour, dash)
        above, right = at - 3 if at > _TOP + 14 else at + 12, WIDTH - _RIGHT - 2
        self._note(label, colour, (right, above, "end"), (_LEFT + 2, above, "start"), (right, at + 12, "end"))

    def mark(self, x: float, y: float, label: str = "", colour: str = INK, *, below: bool = False) -> None:
        """A dot, and what it is, above it or ``below`` if that is free."""
        if not (self._x[0] <= x <= self._x[1]) or not math.isfinite(y):
            return
        at, up = self.to_x(x), self.to_y(y)
        self._over.append(element("circle", cx=f"{at:.1f}", cy=f"{up:.1f}", r="4", fill=colour, stroke="white"))
        self._taken.append((at - 4, up - 4, at + 4, up + 4))
        left = at + 8 + _LETTER * len(label) > WIDTH - _RIGHT
        place, anchor = (at - 7, "end") if left else (at + 7, "start")
        heights = [max(up - 6, _TOP + 10), up + 16]
        self._note(label, colour, *((place, height, anchor) for height in (heights[::-1] if below else heights)))

    def bar(self, y: float, share: float, label: str, value: str, *, over: bool, chosen: bool) -> None:
        """A horizontal bar of a list: its label before it, its value behind it.

        Args:
            y: top of its row [px].
            share: of the x axis' unit.
            label: text before the bar.
            value: text behind it.
            over: it exceeds the limit: hatched.
            chosen: the row of the scenario on screen.
        """
        left, end = 128.0, 128.0 + min(share, self._x[1]) / self._x[1] * (WIDTH - 128.0 - 52.0)
        weight = "bold" if chosen else "normal"
        common = {"y": f"{y:.1f}", "height": "11", "x": f"{left}", "width": f"{max(end - left, 0.5):.1f}"}
        self._parts.append(element("rect", fill=LIMIT if over else EVENT, fill_opacity="0.55", **common))
        if over:
            self._parts.append(element("rect", fill="url(#hatch)", **common))
        self._over.append(_text(label, left - 5, y + 9.5, "end", INK, weight))
        self._over.append(_text(value, end + 4, y + 9.5, "start", INK, weight))

    def rule(self, x: float, label: str) -> None:
        """The line that bars must not pass, at a value of the x axis."""
        at = 128.0 + x / self._x[1] * (WIDTH - 128.0 - 52.0)
        self._across(at, at, _TOP, self._height - 6, LIMIT, "6 3")
        self._note(label, LIMIT, (at, _TOP + 7, "middle"))

    def _across(self, x1: float, x2: float, y1: float, y2: float, colour: str, dash: str | None) -> None:
        places = {"x1": f"{x1:.1f}", "x2": f"{x2:.1f}", "y1": f"{y1:.1f}", "y2": f"{y2:.1f}"}
        self._parts.append(element("line", stroke=colour, stroke_width="1.5", stroke_dasharray=dash, **places))

    def _note(self, text: str, colour: str, *places: tuple[float, float, str]) -> None:
        """A label at the first of some places (x, y, anchor) where it meets no other, else near the last of them."""
        if not text:
            return
        x, y, anchor = places[-1]
        # Row by row away from there, below and above.
        rows = np.arange(_TOP + 11 + (y - _TOP - 11) % _ROW, self._height - _BOTTOM, _ROW)
        near = ((x, float(row), anchor) for row in sorted(rows, key=lambda row: abs(row - y)))
        found, box = next(
            ((place, box) for place in (*places, *near) if self._is_free(box := _box(text, *place))),
            (places[0], _box(text, *places[0])),
        )
        self._taken.append(box)
        self._over.append(_text(text, *found, colour))

    def _is_free(self, box: tuple[float, float, float, float]) -> bool:
        left, top, right, bottom = box
        return not any(left < x1 and x0 < right and top < y1 and y0 < bottom for x0, y0, x1, y1 in self._taken)

    def svg(self, *, axes: bool = True) -> Html:
        """The chart; it fills the width that it is given."""
        parts = [_HATCH]
        if axes:
            parts += self._axes()
        title = _text(self._title, 4.0, 13.0, "start", INK, "bold")
        return element(
            "svg",
            *parts,
            *self._parts,
            *self._over,
            title,
            viewBox=f"0 0 {WIDTH:g} {self._height:g}",
            width="100%",
            style="display:block;background:white",
            role="img",
            aria_label=self._title,
            data_chart=self._name or None,
            **_LABEL,
        )

    def _axes(self) -> list[Html]:
        bottom, parts = self._height - _BOTTOM, []
        for value in ticks(*self._x, 6):
            at = self.to_x(value)
            parts.append(_stroke(at, at, _TOP, bottom, "#e4e4e4"))
            parts.append(_text(_number(value), at, bottom + 12, "middle", FAINT))
        for value in powers(*self._y) if self._log_y else ticks(*self._y, 4):
            at = self.to_y(value)
            parts.append(_stroke(_LEFT, WIDTH - _RIGHT, at, at, "#e4e4e4"))
            parts.append(_text(_number(value), _LEFT - 4, at + 4, "end", FAINT))
        parts.append(_stroke(_LEFT, WIDTH - _RIGHT, bottom, bottom, FAINT))
        parts.append(_stroke(_LEFT, _LEFT, _TOP, bottom, FAINT))
        parts.append(_text(self._labels[0], (_LEFT + WIDTH - _RIGHT) / 2, self._height - 6, "middle", INK))
        parts.append(_text(self._labels[1], WIDTH - _RIGHT, 13.0, "end", FAINT))
        return parts


_HATCH = Html(
    '<defs><pattern id="hatch" width="7" height="7" patternTransform="rotate(45)" patternUnits="userSpaceOnUse">'
    f'<line x1="0" y1="0" x2="0" y2="7" stroke="{LIMIT}" stroke-width="1.6" stroke-opacity="0.55"/></pattern></defs>'
)


def _stroke(x1: float, x2: float, y1: float, y2: float, colour: str) -> Html:
    places = {"x1": f"{x1:.1f}", "x2": f"{x2:.1f}", "y1": f"{y1:.1f}", "y2": f"{y2:.1f}"}
    return element("line", stroke=colour, stroke_width="1", **places)


def _text(text: str, x: float, y: float, anchor: str, colour: str, weight: str = "normal") -> Html:
    # A white edge keeps a label readable on a line.
    return element(
        "text",
        escape(text),
        x=f"{x:.1f}",
        y=f"{y:.1f}",
        text_anchor=anchor,
        fill=colour,
        font_weight=None if weight == "normal" else weight,
        stroke="white",
        stroke_width="3",
        paint_order="stroke",
    )


def _box(text: str, x: float, y: float, anchor: str) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of a label [px]."""
    width = _LETTER * len(text) + 4
    left = x - {"start": 2.0, "middle": width / 2, "end": width - 2.0}[anchor]
    return left, y - _ROW + 3, left + width, y + 3


def ticks(low: float, high: float, most: int) -> list[float]:
    """Round values between two numbers, at most ``most`` + 1 of them."""
    span = high - low
    if not span > 0 or not math.isfinite(span):
        return []
    step = 10.0 ** math.floor(math.log10(span / most))
    step *= next(factor for factor in (1, 2, 5, 10) if span / (factor * step) <= most)
    return [k * step for k in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)]


def powers(low: float, high: float) -> list[float]:
    """Powers of ten between two positive numbers, every second or third of many."""
    first, last = math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9)
    return [10.0**k for k in range(first, last + 1, max(1, (last - first) // 4))]


def _number(value: float) -> str:
    if value and not 1e-3 <= abs(value) < 1e5:
        return f"{value:.0e}".replace("e-0", "e-").replace("e+0", "e")
    return f"{value:.6g}"


def nothing(title: str, why: str, name: str) -> Html:
    """In the place of a chart: why there is none."""
    return element(
        "div",
        element("b", title),
        element("div", why),
        style=f"font-size:12px;color:{INK};padding:6px 4px",
        data_chart=name,
    )


def stairs(edges: FloatArray, heights: Sequence[float] | FloatArray) -> tuple[FloatArray, FloatArray]:
    """A histogram as a line."""
    x = np.array([edge for pair in pairwise(edges) for edge in pair])
    return x, np.repeat(np.asarray(heights, dtype=np.float64), 2)
