"""Figure: what a recording holds, joint by joint, with its gaps."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.recording import by_quantity
from bumpstop.report.picture import EVENT, LIMIT, Picture, stack

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bumpstop.arrays import FloatArray
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# No more can be told apart at a figure's width; each keeps its lowest and its highest value.
_STRIPES = 600
_MAX_GAPS = 200
# Okabe and Ito's without yellow, and line styles for those who see no colours.
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00", "#222222", "#767676")
_LINES = ("-", "--", "-.", ":")


def recording_picture(recording: Recording, robot: Robot | None = None) -> Picture:
    """The quantities of a recording over time, one panel each; a robot's limits are marked where touched."""
    panels = by_quantity(recording, robot) | {"wrench": recording.wrench}
    shown = [(label, value) for label, value in panels.items() if value is not None]
    height = 0.9 + 1.15 * len(shown)

    def draw(figure: Figure) -> None:
        axes = stack(figure, [1.0] * len(shown), left=0.72, right=0.75)
        for panel, (label, value) in zip(axes, shown, strict=True):
            for j in range(value.shape[1]):
                t, x = _thinned(recording.t, value[:, j])
                style = _LINES[(j // len(_COLOURS) + j) % len(_LINES)]
                colour = _COLOURS[j % len(_COLOURS)]
                panel.plot(t, x, color=colour, linestyle=style, linewidth=0.9, label=str(j + 1))
            for start, length in recording.report.gaps[:_MAX_GAPS]:
                panel.axvspan(start, start + length, color=EVENT, alpha=0.3, linewidth=0)
            panel.set_ylabel(label)
        if robot is not None:
            at_limit = ((recording.q <= robot.lower) | (recording.q >= robot.upper)).any(axis=1)
            rows = np.flatnonzero(at_limit)[:: max(1, int(at_limit.sum()) // _STRIPES)]
            axes[0].plot(recording.t[rows], recording.q[rows].max(axis=1), "v", color=LIMIT, markersize=4)
        axes[0].legend(loc="upper left", bbox_to_anchor=(1.0, 1.05), title="joint", handlelength=1.6)
        axes[0].set_title(Path(recording.source).name or "recording")
        axes[-1].set_xlabel("time, s")

    gaps = len(recording.report.gaps)
    alt = f"{', '.join(label for label, _ in shown)} of {recording.dof} joints over {recording.duration:.4g} s"
    caption = f"What was recorded, joint by joint. Shaded: {gaps} gaps."
    return Picture("recording", alt, caption, draw, height)


def _thinned(t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A line that looks the same: the lowest and the highest value of each of a few hundred stretches."""
    if t.size <= 4 * _STRIPES:
        return t, x
    edges = np.linspace(0, t.size, _STRIPES + 1).astype(np.int64)[:-1]
    low, high = np.minimum.reduceat(x, edges), np.maximum.reduceat(x, edges)
    return np.repeat(t[edges], 2), np.stack([low, high], axis=1).ravel()
