"""One collision in time: the force of a median and of a bad one."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.report.collision.rollout import Rollouts
from bumpstop.report.colours import EVENT, LAW
from bumpstop.report.markup import Html
from bumpstop.terminal import number
from bumpstop.view.plots.chart import Chart

if TYPE_CHECKING:
    from bumpstop.report.collision.rollout import Rollout
    from bumpstop.view.answer import Answer

_NAME = "force-over-time"


def force_over_time_plot(answer: Answer) -> Html:
    """Contact force from the touch until it is gone, of runs near the median and the 99 % quantile."""
    rollouts = Rollouts(answer.result)
    bad, median = rollouts.nearest(0.99), rollouts.nearest(0.5)
    end = 1.1 * max(_end(bad), _end(median), 0.02)
    top = max(bad.peak_force, median.peak_force, 1.0)
    limit = answer.peak_limit_N
    if limit < 1.6 * top:
        top = max(top, limit)
    top *= 1.45  # room for the word on detection above a peak that it comes with
    chart = Chart(
        "One collision in time",
        (-0.1 * end * 1e3, end * 1e3),
        (0.0, top),
        labels=("time after touch [ms]", "force [N]"),
        height=170,
        name=_NAME,
    )
    for rollout, dash in ((median, "3 3"), (bad, None)):
        shown = (rollout.time >= -0.1 * end) & (rollout.time <= end)
        chart.line(1e3 * rollout.time[shown], rollout.force[shown], LAW, dash=dash)
        at = float(rollout.time[int(np.argmax(rollout.force))])
        name = "p99" if dash is None else "median"
        chart.mark(1e3 * at, rollout.peak_force, f"{name} {number(rollout.peak_force)} N", LAW, below=name == "median")
    for name, force in answer.marked_limits_N:
        if force <= top:
            chart.horizontal(force, f"{name} {number(force)} N")
    if bad.detection is not None and bad.detection < end:
        chart.vertical(1e3 * bad.detection, "detected", EVENT, dash="8 3 2 3")
    return chart.svg()


def _end(rollout: Rollout) -> float:
    """When the force is gone, or nothing more is known [s]."""
    pressed = rollout.time[rollout.force > 0]
    return float(pressed[-1]) if pressed.size else 0.0
