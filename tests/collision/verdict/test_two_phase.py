"""Clamped contact judged in two phases."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.verdict.two_phase_use import TwoPhaseUse
from bumpstop.report.formatting import in_phases
from collision.cases import control_group, reference_trace, swinging_forward, ur10e


def two_phase(**changes: Any) -> bs.CollisionResult:
    return bs.evaluate(
        control_group(
            **{"contact__limits": "ts15066", "verdict__clamped_limit": "two_phase", "contact__offset_law": "uniform"}
            | changes
        )
    )


def test_a_short_contact_is_judged_by_the_transient_limit() -> None:
    """The arm has let go long before half a second is over."""
    result = two_phase(motion__velocity_mm_s=[0, 0, -110], contact__area_cm2=20.0)
    assert result.contact_duration is not None
    assert result.contact_duration.quantile(0.999) < 0.4
    assert result.problem.transient_limits is not None
    limit = result.problem.transient_limits.force_N
    assert limit == 280
    assert 0.01 < result.peak_force.exceedance(limit) < 0.99
    assert result.verdict.p_over_force == pytest.approx(result.peak_force.exceedance(limit), abs=2e-4)
    assert result.verdict.p_over_force < result.peak_force.exceedance(140.0)


def test_a_limit_far_out_has_its_digits() -> None:
    """Where both phases have one limit, contact is judged as in one: at the risk that most scenarios accept."""
    changes = {
        "contact__limits": "bgia2011", "contact__offset_law": "half_normal", "contact__area_cm2": 2.0,
        "motion__velocity_mm_s": [0, 0, -58.54],
    }  # fmt: skip
    twice, once = two_phase(**changes), two_phase(**changes, verdict__clamped_limit="quasi_static")
    assert once.verdict.p_over_pressure == pytest.approx(1e-3, rel=0.1)
    assert twice.verdict.p_over_pressure == pytest.approx(once.verdict.p_over_pressure, rel=1e-3)


def test_an_arm_that_stays_is_judged_by_the_lasting_limit() -> None:
    result = two_phase(motion__velocity_mm_s=[0, 0, -72], contact__area_cm2=20.0, reaction__kind="stop")
    share = result.peak_force.exceedance(140.0)
    assert 0.001 < share < 0.999
    assert result.verdict.p_over_force == pytest.approx(share, abs=2e-4)


@pytest.mark.parametrize("reaction", ["stop", "reverse"])
def test_exact_against_sampled_and_against_each_path(reaction: str) -> None:
    """Slow joints keep contact longer than the first phase: both limits have a say."""
    changes = {
        "motion__velocity_mm_s": [0, 0, -100], "contact__stiffness_N_m": 9000.0, "contact__area_cm2": 4.0,
        "reaction__joint_acceleration_rad_s2": 0.35, "reaction__kind": reaction,
        "detector__thresholds_Nm": [9, 5, 9, 9, 9, 9, 9], "detector__noise_sd_Nm": 1.6,
    }  # fmt: skip
    result = two_phase(**changes)
    drawn = bs.evaluate(result.scenario, samples=4000, seed=2)
    for ours, theirs in (
        (result.verdict.p_over_force, drawn.verdict.p_over_force),
        (result.verdict.p_over_pressure, drawn.verdict.p_over_pressure),
    ):
        assert ours is not None
        assert theirs is not None
        assert abs(ours - theirs) < 4 * np.sqrt(max(ours * (1 - ours), 1 / 4000) / 4000) + 1e-6
    assert drawn.runs is not None
    # The greater force of both phases is the peak force, run by run.
    shares, detected = drawn.phase_shares(1.0, 1.0)
    found = drawn.runs["tick"] >= 0
    assert detected == found.mean()
    assert len(np.unique(drawn.runs["tick"])) > 3
    np.testing.assert_allclose(shares.values, drawn.runs["peak_force"][found], rtol=1e-9, atol=1e-9)  # type: ignore[attr-defined]
    over = []
    for run in range(0, 4000, 100):
        offset, tick = float(drawn.runs["offset"][run]), int(drawn.runs["tick"][run])
        begin = tick * result.problem.period_steps + 1
        reaction_path = result.curve.kernel.reaction_paths([tick], [offset])[0]
        path = np.concatenate([result.curve.distance[:begin], reaction_path])
        path = np.append(path, np.full(2000, path[-1] if reaction == "stop" else -1.0))
        force = 9000.0 * np.maximum(0.0, path - offset)
        touch = np.flatnonzero(force > 0)[0] - 1
        first, late = force[: touch + 500].max(), force[touch + 502 :].max()
        over.append(first > 280 or late > 140)
    share = float(np.mean(over))
    assert result.verdict.p_over_force is not None
    assert abs(share - result.verdict.p_over_force) < 4 * np.sqrt(max(share * (1 - share), 1 / 40) / 40)


def deepest(result: bs.CollisionResult) -> tuple[float, float]:
    """Greatest force [N] in the first phase and after it of a distribution with one outcome."""
    return result.phase_shares(1.0, 0.0)[0].mean, result.phase_shares(0.0, 1.0)[0].mean


@pytest.mark.parametrize(("offset_mm", "tick"), [(0.4, 11), (0.15, 4)])
def test_an_arm_that_swings_forward_again_is_judged_by_that(offset_mm: float, tick: int) -> None:
    """Beside a singularity the point lets go after some hundredths of a second and comes back far harder."""
    scenario = swinging_forward(offset_mm, tick, contact__limits="ts15066")
    result, reference = bs.evaluate(scenario), reference_trace(scenario)
    touch = reference.run.contact_start_s[0]
    assert reference.run.contact_duration_s[0] < 0.3
    at_end = np.interp(touch + 0.5, reference.time_s, reference.force_N)
    first, late = (
        max(float(reference.force_N[when].max()), at_end)
        for when in (reference.time_s < touch + 0.5, reference.time_s >= touch + 0.5)
    )
    assert late > first > 500
    assert deepest(result) == pytest.approx((first, late), rel=1e-9)
    # Nothing is touched later, and nothing harder.
    assert result.contact_duration is not None
    assert result.contact_duration.mean == pytest.approx(
        float(reference.time_s[reference.force_N > 0].max()) - touch, abs=1e-3
    )
    assert result.peak_force.mean == pytest.approx(late, rel=1e-9)


def test_an_arm_whose_motion_ends_within_the_latency_stays_in_contact() -> None:
    """It brakes at its joint limit and never goes back, though it was to reverse."""
    scenario = control_group(
        pose_deg=[0, 109.7, 0, -20, 0, -40, 0], motion__velocity_mm_s=[0, 0, -30], contact__limits="ts15066",
        contact__offset_law="fixed", contact__offset_mm=0.5, contact__stiffness_N_m=5000.0,
        reaction__latency_s=0.02, detector__noise_sd_Nm=0.0, detector__noise_mean_Nm=[0, 11, 0, 0, 0, 0, 0],
        detector__arming_delay_s=0.041,
    )  # fmt: skip
    result = bs.evaluate(scenario)
    stands = 5000.0 * (float(bs.stopping_curve(result.problem, whole=True).line.braking[-1]) - 0.5e-3)
    assert deepest(result) == pytest.approx((stands, stands), rel=1e-9)


def test_a_head_is_never_acceptable() -> None:
    result = two_phase(contact__body="face", motion__velocity_mm_s=[0, 0, -10])
    assert result.verdict.acceptable is False
    assert (result.verdict.p_over_force, result.verdict.p_over_pressure) == (1.0, 1.0)
    assert "does not permit transient contact" in result.verdict.reason
    assert result.verdict.to_json()["limit_kind"] == "two_phase"


SLOW_JOINTS: dict[str, Any] = {
    "motion__velocity_mm_s": [0, 0, -100], "contact__stiffness_N_m": 9000.0, "contact__area_cm2": 4.0,
    "reaction__joint_acceleration_rad_s2": 0.35,
    "detector__thresholds_Nm": [9, 5, 9, 9, 9, 9, 9], "detector__noise_sd_Nm": 1.6,
}  # fmt: skip


@pytest.mark.parametrize("reaction", ["stop", "reverse"])
def test_a_body_that_hardly_loses_energy_is_judged_as_a_spring(reaction: str) -> None:
    """Two routes: release times of a clamped spring, and the followed force of what gives way."""
    changes = SLOW_JOINTS | {"reaction__kind": reaction, "reaction__joint_acceleration_rad_s2": 0.6}
    spring = two_phase(**changes)
    damped = two_phase(**changes, contact__damping_Ns_m=1e-6)
    for first, later in ((1.0, 1.0), (0.5, 1.0), (1e-9, 1.0)):
        (ours, weight), (theirs, whole) = (each.phase_shares(first, later) for each in (spring, damped))
        assert whole == 1.0
        for p in (0.1, 0.5, 0.9):
            assert theirs.exceedance(ours.quantile(p)) == pytest.approx(weight * (1 - p), abs=1e-3)
    if reaction == "reverse":
        # The phases matter: after half a second the arm presses less.
        assert damped.phase_shares(1e-9, 1.0)[0].quantile(0.5) < 0.98 * damped.peak_force.quantile(0.5)


@pytest.mark.parametrize("reaction", ["stop", "reverse"])
@pytest.mark.parametrize("changes", [{"arm__model": "elastic"}, {"contact__damping_Ns_m": 300.0}], ids=["arm", "body"])
def test_what_gives_way_is_judged_alike_by_both_distributions(changes: dict[str, Any], reaction: str) -> None:
    integrated = two_phase(**SLOW_JOINTS, **changes, reaction__kind=reaction)
    runs = 20_000
    drawn = bs.evaluate(integrated.scenario, samples=runs, seed=3)
    for first, later in ((1 / 280, 1 / 140), (1 / 150, 1 / 75), (1 / 130, 1 / 40)):
        ours, theirs = integrated.phase_shares(first, later)[0], drawn.phase_shares(first, later)[0]
        for share in (0.5, 0.8, 1.0, 1.2):
            p = ours.exceedance(share)
            wide = 4 * np.sqrt(p * (1 - p) / runs) + 1e-3
            assert theirs.exceedance(share * 1.0003) - wide <= p <= theirs.exceedance(share * 0.9997) + wide
    lasting = drawn.runs["lasting_force"] if drawn.runs is not None else np.zeros(0)
    assert (lasting > 0).any() or reaction == "reverse"


def test_a_lasting_limit_above_the_transient_one_is_refused_where_something_gives_way() -> None:
    result = two_phase(contact__damping_Ns_m=100.0)
    with pytest.raises(bs.InputError, match="limit for what lasts"):
        result.phase_shares(1 / 100, 1 / 200)


SHORT: dict[str, Any] = {"motion__duration_s": 0.1, "contact__offset_law": "half_normal", "contact__offset_sd_s": 0.1}
MISSED = {
    "elastic": ur10e(arm__model="elastic", verdict__clamped_limit="two_phase", **SHORT),
    "rigid": ur10e(verdict__clamped_limit="two_phase", **SHORT),
    "at a joint limit": control_group(
        pose_deg=[0, 109.7, 0, -20, 0, -40, 0],
        motion__velocity_mm_s=[0, 0, -30],
        detector__noise_sd_Nm=3.0,
        contact__limits="ts15066",
        contact__area_cm2=0.5,
        verdict__clamped_limit="two_phase",
    ),
}


@pytest.mark.parametrize("scenario", MISSED.values(), ids=MISSED)
def test_the_use_of_the_limits_agrees_with_what_is_over(scenario: bs.Scenario) -> None:
    """Missed collisions were judged by the force's limit for the pressure's, and counted twice of an elastic arm."""
    result = bs.evaluate(scenario)
    problem = result.problem
    assert problem.transient_limits is not None
    assert problem.limits is not None
    use = TwoPhaseUse.of(result, problem.transient_limits, problem.limits)
    over = max(p for p in use.over() if p is not None)
    assert result.undetected_probability > 0.05
    assert over > 0.05
    for accepted in (0.001, 0.5 * over, 0.98 * over, 1.02 * over, 2 * over, 0.5):
        assert (over > accepted) == (use.utilisation(accepted) > 1), accepted


def test_a_line_that_ends_in_its_first_step() -> None:
    """The reaction to the first tick begins before there is any path: its contacts had no greatest distance."""
    result = bs.evaluate(
        bs.Scenario.from_dict({
            "robot": "panda",
            "pose_rad": [-1.93, 0.8458, -0.5388, -0.06981, -0.1156, 0.5557, 0.924],
            "motion": {"velocity_mm_s": [-165, 237, 10], "damping": 0.01},
            "contact": {"body": "thigh_knee", "limits": "ts15066"},
            "detector": {"thresholds_Nm": [30, 30, 30, 30, 30, 30, 30], "noise_sd_Nm": 4},
            "reaction": {"joint_acceleration_rad_s2": 10, "latency_s": 0.004},
            "verdict": {"clamped_limit": "two_phase"},
        })
    )  # fmt: skip
    assert result.curve.ticks <= 1
    assert not result.verdict.acceptable


def test_a_limit_that_both_phases_share_is_told_once() -> None:
    shared = two_phase(contact__limits="bgia2011", contact__area_cm2=1.0, motion__velocity_mm_s=[0, 0, -250])
    limits, first = shared.problem.limits, shared.problem.transient_limits
    assert limits is not None
    assert first is not None
    assert first.force_N > limits.force_N
    assert first.pressure_N_cm2 == limits.pressure_N_cm2 == 60
    assert f"exceeds {first.force_N:g} N at first or {limits.force_N:g} N later with" in shared.verdict.reason
    assert "the pressure exceeds 60 N/cm² with probability" in shared.verdict.reason
    assert (in_phases(60, 60, "N/cm²"), in_phases(60, 30, "N/cm²")) == ("60 N/cm²", "60 N/cm² at first, 30 N/cm² later")
