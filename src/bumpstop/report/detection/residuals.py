"""Figure: residuals against their thresholds, with alarms and stretches without data."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.report.picture import EVENT, FAINT, INK, LAW, LIMIT, PAPER, Picture, stack

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bumpstop.arrays import FloatArray
    from bumpstop.detection import DetectionRun

# No more can be told apart at a figure's width; each keeps its lowest and its highest value.
_STRIPES = 600
_MAX_EVENTS = 200
_PANEL = 0.95  # [inch]
_NAME_SHARE = 0.3  # of a panel's range, above what is drawn in it


def residual_picture(run: DetectionRun, names: tuple[str, ...], units: tuple[str, ...]) -> Picture:
    """A panel for every joint: residual, thresholds, alarms, and where the detector had no data or arming."""
    n = run.residual.shape[1]
    no_data, arming = (_stretches(run.t, rows) for rows in (run.no_data, run.state == 1))

    def draw(figure: Figure) -> None:
        panels = stack(figure, [1.0] * n, left=0.78, right=0.2, top=0.62)
        for j, panel in enumerate(panels):
            t, low, high = _envelope(run.t, run.residual[:, j])
            panel.fill_between(t, low, high, color=LAW, linewidth=0.9, label="residual")
            # Rows without data have the threshold of the row before: the first ones, of none, have zero.
            given = run.threshold[:, j]
            limit = np.where(np.isfinite(given) & (given > 0), given, np.nan)
            monitored = bool(np.isfinite(limit).any())
            if monitored:
                at, lowest, _ = _envelope(run.t, limit)
                panel.plot(at, lowest, color=LIMIT, linestyle="--", linewidth=1.1, label="threshold")
                panel.plot(at, -lowest, color=LIMIT, linestyle="--", linewidth=1.1)
            for event in run.events[:_MAX_EVENTS]:
                mine = j in event.joints or j in event.fast_joints
                panel.axvline(
                    event.t, color=EVENT, linewidth=1.6 if mine else 0.7, linestyle="-" if mine else ":", label="alarm"
                )
            for (start, end), colour, label in (
                *((stretch, FAINT, "no data") for stretch in no_data),
                *((stretch, EVENT, "arming") for stretch in arming),
            ):
                panel.axvspan(start, end, color=colour, alpha=0.25, linewidth=0, label=label)
            panel.set_ylabel(f"{j + 1}, {units[j]}")
            # Room for the joint's name above its curve.
            low_end, high_end = panel.get_ylim()
            panel.set_ylim(low_end, high_end + _NAME_SHARE * (high_end - low_end))
            panel.text(
                0.01,
                0.96,
                names[j] + ("" if monitored else ": not monitored"),
                transform=panel.transAxes,
                va="top",
                color=INK,
                fontsize=8,
                bbox=PAPER,
            )
        handles = {
            str(label): handle
            for panel in panels
            for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)
        }
        panels[0].legend(
            handles.values(), handles, ncols=len(handles), loc="lower left", bbox_to_anchor=(0, 1.0), fontsize=8.5
        )
        panels[-1].set_xlabel("time, s")
        figure.align_ylabels(panels)

    count = len(run.events)
    alarms = f"{count} alarm{'' if count == 1 else 's'}"
    alt = f"Residuals of {n} joints over {run.t[-1] - run.t[0]:.4g} s with their thresholds and {alarms}"
    caption = (
        "Estimated minus predicted torque by joint. Dashed: thresholds. Lines across: alarms, thick at the joints that "
        f"raised them. Grey: the detector had no data, {run.no_data_s:.3g} s in all."
    )
    return Picture("residuals", alt, caption, draw, 1.1 + _PANEL * n)


def _stretches(t: FloatArray, rows: np.ndarray) -> list[tuple[float, float]]:
    """Begin and end of every run of marked rows, each from the row before it."""
    edges = np.flatnonzero(np.diff(rows.astype(np.int8), prepend=0, append=0))
    return [(float(t[max(a - 1, 0)]), float(t[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _envelope(t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, lowest and highest values of a few hundred stretches; a stretch without numbers is left blank."""
    if t.size <= _STRIPES:
        return t, x, x
    edges = np.linspace(0, t.size, _STRIPES + 1).astype(np.int64)[:-1]
    low = np.minimum.reduceat(np.where(np.isnan(x), np.inf, x), edges)
    high = np.maximum.reduceat(np.where(np.isnan(x), -np.inf, x), edges)
    nothing = low > high
    return t[edges], np.where(nothing, np.nan, low), np.where(nothing, np.nan, high)
