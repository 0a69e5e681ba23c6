"""The part of a protocol's page that shows the general fit on the same recordings."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.report.formatting import with_error
from bumpstop.report.markup import Html, bullets, paragraph, table
from bumpstop.report.picture import EVENT, FAINT, INK, LAW, LIMIT, Picture, axes
from bumpstop.report.section import Part

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bumpstop.reproduction.schroeder2013.fit_comparison import FitComparison, JointComparison

_PARAMETERS = ("A", "B", "D", "F", "hysteresis", "inertia", "coulomb", "viscous", "load")
_FAR = 6.0  # standard errors; what differs by more is drawn there
_MARKS = ((LAW, "o"), (LIMIT, "^"), (EVENT, "s"), (INK, "D"), (LAW, "v"), (LIMIT, "P"),
          (EVENT, "x"), (INK, "+"), (LAW, "*"))  # of these parameters  # fmt: skip


class BesidePart(Part):
    """The general fit on the same recordings."""

    title = "Beside the general fit"
    anchor = "general"

    def __init__(self, beside: FitComparison | None) -> None:
        self._beside = beside

    def applies(self) -> bool:
        """Where a general fit was tried."""
        return self._beside is not None

    def content(self) -> list[Html]:
        """A row for each parameter of each joint, or why there is none."""
        beside = self._beside
        assert beside is not None
        missing: list[Html] = []
        if beside.why_not:
            missing.append(paragraph(f"The recordings as a whole cannot be fitted: {beside.why_not}."))
        if not beside.joints:
            return missing
        rows = [
            (
                f"{pair.general.name}, {name}",
                *(with_error(value) for value in pair.pair(name)),
                "none" if (difference := pair.difference(name)) is None else f"{difference:+.2f}",
            )
            for pair in beside.joints
            for name in _PARAMETERS
            if name in pair.protocol.parameters
        ]
        said = [
            f"{pair.general.name}: {name} is not seen by the general fit: {reason}"
            for pair in beside.joints
            for name, reason in pair.general.unobservable.items()
        ]
        said += [
            f"{pair.general.name}: the general fit takes the {pair.general.parameters.map} map, the protocol the "
            f"{pair.protocol.map} one: A and B are not compared"
            for pair in beside.joints
            if pair.general.parameters.map != pair.protocol.map
        ]
        return [
            *missing,
            paragraph(
                f"All {beside.rows_used} rows of the same recordings fitted at once, as for any motion: filtered at "
                f"{beside.cutoff_hz:g} Hz, under Huber's loss. Differences are protocol less general fit, in combined "
                "standard errors. Both see the same noise, so that most should be well below 2; one far beyond says "
                "that the joint model or one of the fits misses something."
            ),
            table(
                ("joint, parameter", "protocol", "general fit", "difference"),
                rows,
                caption="Protocol and general fit",
                numbers=True,
            ),
            *([bullets(said)] if said else []),
        ]

    def pictures(self) -> list[Picture]:
        """Differences of all parameters, joint by joint."""
        beside = self._beside
        assert beside is not None
        pairs = beside.joints
        if not pairs:
            return []

        def draw(figure: Figure) -> None:
            panel = axes(figure, left=1.1, bottom=0.5, top=0.6)
            _draw_differences(panel, pairs)

        alt = "Difference of every parameter between protocol and general fit, in combined standard errors, by joint."
        caption = (
            "Protocol less general fit. Within the dotted lines both agree as 95 % intervals would; what lies "
            f"beyond {_FAR:g} is drawn there."
        )
        return [Picture("general", alt, caption, draw, height=1.8 + 0.34 * len(pairs))]


def _draw_differences(panel: Axes, pairs: Sequence[JointComparison]) -> None:
    """A row for each joint, a mark for each parameter."""
    for k, name in enumerate(_PARAMETERS):
        points = [(pair.difference(name), j) for j, pair in enumerate(pairs)]
        shown = [(max(-_FAR, min(_FAR, x)), j + 0.1 * (k - 2.5)) for x, j in points if x is not None]
        colour, mark = _MARKS[k]
        if not shown:
            continue
        panel.plot([x for x, _ in shown], [y for _, y in shown], mark, color=colour, markersize=4.5, label=name)
    panel.axvline(0, color=FAINT, linewidth=0.6)
    for side in (-1.96, 1.96):
        panel.axvline(side, color=FAINT, linewidth=0.9, linestyle=":")
    panel.set_yticks(range(len(pairs)), [pair.general.name for pair in pairs])
    panel.set_ylim(len(pairs) - 0.5, -0.5)
    panel.set_xlim(-1.05 * _FAR, 1.05 * _FAR)
    panel.set_xlabel("protocol less general fit [combined standard errors]")
    panel.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.1)
