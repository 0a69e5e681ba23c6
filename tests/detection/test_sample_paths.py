"""Samples in any order, with gaps, repeats, infinities: judged with finite residuals, or no data; never a crash."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from bumpstop.detection import Detector, DetectorSettings
from bumpstop.detection.detection_run import FAULTS, STATES
from bumpstop.joint import JointTorqueModel
from bumpstop.model import Robot

DT = 0.004
SIA5D = Robot.load("sia5d")
MODEL = JointTorqueModel.load("sia5d")
THRESHOLDS = [20.0] * 6 + [float("inf")]

numbers = st.floats(width=64) | st.sampled_from([0.0, -0.0, 1e308, -1e308, 5e-324, float("nan"), float("inf")])
# How far time goes on from the sample before, in periods.
steps = st.sampled_from([1.0, 1.0, 1.0, 1.0, 0.0, -1.0, -50.0, 2.0, 3.0, 400.0, 1e-9, 1 + 1e-12]) | numbers
# What becomes of a sample: nothing, mostly; or one number of it is replaced.
spoilt = st.none() | st.none() | st.tuples(st.integers(0, 13), numbers)
paths = st.lists(st.tuples(steps, spoilt), min_size=1, max_size=80)


@settings(max_examples=150, deadline=None)
@given(paths, st.sampled_from(["direct", "observer"]), st.booleans())
def test_any_path_is_judged_or_without_data(
    path: list[tuple[float, tuple[int, float] | None]], kind: str, patient: bool
) -> None:
    """Row by row as a loop would see them."""
    made = DetectorSettings(residual=kind, max_no_data_s=0.02 if patient else 0.0, period_s=DT)  # type: ignore[arg-type]
    loop = Detector(SIA5D, MODEL, THRESHOLDS, made).kernel()
    still = np.zeros(7)
    now, believed = 0.0, -np.inf
    for step, change in path:
        t = now + step * DT
        if np.isfinite(t):
            now = t
        sample = np.concatenate([0.3 * np.sin(min(abs(now), 1e6) + np.arange(7.0)), np.full(7, 40.0)])
        if change is not None:
            sample[change[0]] = change[1]
        found = loop.update(t, sample[:7], sample[7:], still)
        state, fault = STATES[int(found.state.value)], FAULTS[int(found.fault.value)]
        residual = np.asarray(found.residual)[:7]
        if state == "no_data":
            assert fault != "none"
            assert np.isnan(residual).all()
            assert found.stop or patient
            continue
        assert fault == "none"
        assert np.isfinite(residual).all()
        assert np.isfinite(np.asarray(found.qd)[:7]).all()
        assert np.isfinite(np.asarray(found.qdd)[:7]).all()
        assert np.isfinite(t)
        assert np.isfinite(sample).all()
        # Time runs forward among the samples that are judged.
        assert t > believed
        believed = t
        assert found.stop == (state == "alarm")


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(20, 190), st.sampled_from(["drop", "repeat", "swap", "nan", "inf"])), max_size=6))
def test_a_clean_stretch_after_any_fault_is_judged_as_ever(faults: list[tuple[int, str]]) -> None:
    """Whatever happened, the window of samples that follows is the same as if nothing had."""
    t = DT * np.arange(260)
    q = 0.2 * np.sin(t[:, None] + np.arange(7.0))
    current = np.tile(np.linspace(10.0, 70.0, 7), (len(t), 1))
    clean = Detector(SIA5D, MODEL, THRESHOLDS).run_rows(t, q, current)
    order = list(range(len(t)))
    for at, fault in faults:
        if fault == "drop":
            order[at : at + 1] = []
        elif fault == "repeat":
            order.insert(at, order[at])
        elif fault == "swap":
            order[at], order[at + 1] = order[at + 1], order[at]
        elif fault == "nan":
            q[order[at], 3] = np.nan
        else:
            current[order[at], 2] = np.inf
    run = Detector(SIA5D, MODEL, THRESHOLDS).run_rows(t[order], q[order], current[order])
    assert np.isfinite(run.residual[~run.no_data]).all()
    assert not run.no_data[-20:].any()
    np.testing.assert_allclose(run.residual[-20:], clean.residual[-20:], rtol=1e-6, atol=1e-6)
