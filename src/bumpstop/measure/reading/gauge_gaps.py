"""Samples that are missing from a recording of a gauge, and whether the peak may be among them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S
from bumpstop.measure.reading.gauge_fault import GaugeFault

if TYPE_CHECKING:
    from bumpstop.measure.reading.gauge_curve import GaugeCurve

# Of the median time between samples.
_GAP = 1.8
_UNEVEN, _MAX_UNEVEN_SHARE = 0.2, 0.05
# Where more than this share of the peak is shown, the peak itself may be missing.
_TOP_SHARE = 0.8
# A half sine that takes the time t to 80 % of its peak falls by 1 % within 0.15 t on either side of it.
_HIDING_SHARE = 0.3


def step_faults(curve: GaugeCurve) -> list[GaugeFault]:
    """Gaps in time that no dropped row explains, and steps of uneven length."""
    steps = np.diff(curve.time)
    step = curve.step
    wide = steps > _GAP * step
    missing = np.round(steps / step) - 1
    lost = np.sort(curve.lost)
    explained = np.diff(np.searchsorted(lost, curve.time, side="left"))
    gaps = wide & (missing > explained)
    found = []
    if gaps.any():
        text = f"{gaps.sum()} gaps in time, the longest of {1e3 * float(steps[gaps].max()):.3g} ms."
        found.append(GaugeFault("gaps", int(gaps.sum()), text))
    uneven = int(((np.abs(steps - step) > _UNEVEN * step) & ~wide).sum())
    if uneven > _MAX_UNEVEN_SHARE * steps.size:
        found.append(GaugeFault("uneven", uneven, f"{uneven} of {steps.size} samples are unevenly spaced."))
    return found


def hidden_peak(curve: GaugeCurve, at: int, first: int, onset: float) -> list[GaugeFault]:
    """Whether the peak may be among samples that are missing, dropped rows among them.

    It may where they are missing beside the highest sample, or anywhere in the top for so long that a smooth peak
    would rise by 1 % above what is shown.

    Args:
        curve: zeroed, pressing positive.
        at: the highest sample of the first phase.
        first: the first sample in contact.
        onset: when contact begins [s].
    """
    steps = np.diff(curve.time)
    high = curve.force >= _TOP_SHARE * curve.force[at]
    rise = float(curve.time[first + int(np.argmax(high[first:]))]) - onset
    sample = np.arange(steps.size)
    top = (high[:-1] | high[1:]) & (sample >= first - 1) & (curve.time[:-1] - onset <= FIRST_PHASE_S)
    beside = (sample == at - 1) | (sample == at)
    hiding = (steps > _GAP * curve.step) & (beside | (top & (steps > _HIDING_SHARE * rise)))
    if not hiding.any():
        return []
    text = (
        f"Samples are missing at the top of the curve, for {1e3 * float(steps[hiding].max()):.3g} ms: the peak may be "
        "among them."
    )
    return [GaugeFault("gaps", int(hiding.sum()), text, spoils=True)]
