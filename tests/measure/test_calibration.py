"""Learning from shots: against quadrature where there is one parameter, and planted truth elsewhere."""

from __future__ import annotations

import math
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.errors import InputError
from bumpstop.measure import MeasuredShot
from bumpstop.measure.learning.calibrated_scenario import calibrated_toml, uncertainty
from bumpstop.measure.learning.calibration import calibrate
from bumpstop.measure.learning.peak_force_ensemble import PeakForceEnsemble, Surfaces
from bumpstop.measure.learning.posterior import ErrorModel, forces_after, sample_posterior
from bumpstop.measure.learning.reading_doubts import reading_doubts
from bumpstop.measure.learning.response_surface import ResponseSurface, normal_points
from bumpstop.measure.parameters import (
    CONTACT,
    DECELERATION,
    LATENCY,
    PADDING,
    STOPPING_TIME,
    THRESHOLDS,
    Parameters,
)
from bumpstop.measure.peak_force_model import shot_force
from bumpstop.measure.planning.measured_situation import situations_of
from bumpstop.measure.planning.plan import conditions_of
from measure.cells import elastic, rigid


@cache
def ensemble() -> PeakForceEnsemble:
    """A rigid arm at two places and speeds, and one place more that is never measured."""
    named = [
        ("hand", rigid()),
        ("belly", rigid(contact__body="abdomen", motion__velocity_mm_s=[0, 0, -200])),
        ("side", rigid(contact__body="chest", motion__velocity_mm_s=[0, 150, 0])),
    ]
    situations = situations_of(named)
    parameters = Parameters.of([each.measured for each in situations])
    conditions = conditions_of(situations, parameters, (0.5, 1.0))
    return PeakForceEnsemble.of(parameters, conditions, points=96, seed=3)


def shots_at(z: np.ndarray, columns: list[int], *, bad: dict[int, float] | None = None) -> list[MeasuredShot]:
    """Shots without gauge error of a cell whose parameters are z."""
    found = []
    for number, c in enumerate(columns, start=1):
        condition = ensemble().conditions[c]
        force = np.exp(shot_force(ensemble().parameters.at(condition.scenario, z)).log_mean)
        force *= (bad or {}).get(number, 1.0)
        found.append(MeasuredShot(condition.situation.name, condition.speed_mm_s, float(force), number))
    return found


def _line(slope: float, scatter: float) -> Surfaces:
    z = np.linspace(-3, 3, 41)[:, None]
    surface = ResponseSurface.fit(z, 4.0 + slope * z)
    return Surfaces(ResponseSurface(surface.coefficients, np.array([1e-9])), np.array([scatter]))


def test_posterior_against_quadrature() -> None:
    """One parameter and the gauge's error on a fine grid."""
    slope, errors = 0.2, ErrorModel(gauge=0.05, gauge_spread=0.5, model=0.05)
    measured = 4.0 + np.array([0.08, 0.11, 0.14, 0.9])
    surfaces = _line(slope, 0.03)
    found = sample_posterior(surfaces, np.zeros(4, dtype=np.int64), measured, errors, parameters=1, seed=1)
    z, w = np.meshgrid(np.linspace(-4, 6, 801), np.linspace(-4, 4, 401), indexing="ij")
    variance = (0.05 * np.exp(0.5 * w)) ** 2 + 0.03**2 + 4 * 0.05**2
    log = -0.5 * (z**2 + w**2)
    for y in measured:
        log += -2.5 * np.log1p((y - 4.0 - slope * z) ** 2 / (4 * variance)) - 0.5 * np.log(variance)
    p = np.exp(log - log.max())
    p /= p.sum()
    mean = float((p * z).sum())
    sd = math.sqrt(float((p * (z - mean) ** 2).sum()))
    # 2000 draws, of which so many count effectively.
    assert found.effective > 800
    assert found.z.mean() == pytest.approx(mean, abs=5 * sd / math.sqrt(800))
    assert found.z.std() == pytest.approx(sd, rel=0.12)
    assert found.shot_weight[3] < 0.25 < found.shot_weight[:3].min()


def test_without_information_the_posterior_is_the_prior() -> None:
    found = sample_posterior(_line(0.0, 0.03), np.zeros(3, dtype=np.int64), np.full(3, 4.0), ErrorModel(), parameters=1)
    assert found.z.mean() == pytest.approx(0, abs=0.12)
    assert found.z.std() == pytest.approx(1, abs=0.08)


def test_a_measured_place_is_known_by_its_own_shots() -> None:
    """What the model is off at a place is learned there, whatever the parameters say."""
    surfaces, columns = _line(0.01, 0.01), np.zeros(20, dtype=np.int64)
    measured = np.full(20, 4.05)
    errors = ErrorModel(gauge=0.02, model=0.05)
    found = sample_posterior(surfaces, columns, measured, errors, parameters=1)
    forces = np.log(forces_after(found, surfaces, columns, measured, errors))
    assert forces.mean() == pytest.approx(4.05, abs=0.006)
    assert forces.std() < 0.012


def test_surfaces_meet_a_polynomial_of_the_second_degree() -> None:
    random = np.random.default_rng(0)
    z, A = random.standard_normal((60, 3)), random.standard_normal((3, 3))
    values = (1 + z @ [1.0, 2.0, 3.0] + np.einsum("ij,jk,ik->i", z, A, z))[:, None]
    found = ResponseSurface.fit(z, values)
    assert found(z) == pytest.approx(values, abs=2e-3)
    assert found.error[0] < 5e-3


def test_left_out_error_is_that_of_refits_without_the_point() -> None:
    random = np.random.default_rng(1)
    z = random.standard_normal((40, 2))
    values = np.abs(z[:, :1]) + z[:, 1:]
    found = ResponseSurface.fit(z, values)
    missed = []
    for i in range(40):
        others = np.arange(40) != i
        missed.append(float(ResponseSurface.fit(z[others], values[others])(z[i : i + 1])[0, 0] - values[i, 0]))
    assert found.error[0] == pytest.approx(np.sqrt(np.mean(np.square(missed))), rel=1e-3)


def test_points_are_standard_normal_numbers() -> None:
    z = normal_points(512, 3, 1)
    assert np.abs(z.mean(axis=0)).max() < 0.02
    assert z.std(axis=0) == pytest.approx(1, abs=0.03)
    assert np.array_equal(z[:256], normal_points(256, 3, 1))


def test_planted_parameters_are_recovered() -> None:
    parameters = ensemble().parameters
    z = np.zeros(len(parameters))
    z[parameters.index(THRESHOLDS)], z[parameters.index(LATENCY)] = 1.2, -0.8
    made = calibrate(ensemble(), shots_at(z, [0, 1, 2, 3] * 4), refine=0)
    found = {each.key: each for each in made.found}
    thresholds = found[THRESHOLDS]
    assert thresholds.shown
    assert thresholds.low < math.exp(1.2 * thresholds.sd_before) < thresholds.high
    # The place that no shot has seen.
    for c in (4, 5):
        truth = np.exp(shot_force(parameters.at(ensemble().conditions[c].scenario, z)).log_mean)
        _, low, high = made.forces[c].expected_N
        _, before_low, before_high = made.forces[c].before_N
        assert made.forces[c].shots == 0
        assert low < truth < high
        assert high - low < 0.75 * (before_high - before_low)


def test_what_the_shots_do_not_tell_stays_as_assumed() -> None:
    made = calibrate(ensemble(), shots_at(np.zeros(len(ensemble().parameters)), [0, 1, 0]), refine=0)
    for each in made.assumed:
        assert each.sd > 0.7 * each.sd_before
        assert each.label in made.notes[0]
    assert any(each.key == CONTACT for each in made.assumed)


def test_a_bad_shot_is_named_and_hardly_counts() -> None:
    z = np.zeros(len(ensemble().parameters))
    columns = [0, 1, 2, 3, 0, 1, 2, 3, 1, 3]
    whole = calibrate(ensemble(), shots_at(z, columns), refine=0)
    spoilt = calibrate(ensemble(), shots_at(z, columns, bad={6: 2.0}), refine=0)
    assert whole.bad_shots == ()
    (bad,) = spoilt.bad_shots
    assert bad.shot.number == 6
    assert bad.ratio == pytest.approx(2.0, rel=0.15)
    for a, b in zip(whole.forces, spoilt.forces, strict=True):
        assert b.expected_N[0] == pytest.approx(a.expected_N[0], rel=0.03)


@pytest.mark.parametrize("share", [0.3, 0.001])
def test_readings_that_are_too_low_for_a_cell_are_doubted(share: float) -> None:
    """A third of the force asks for a latency below zero, which was cut off without a word."""
    z = np.zeros(len(ensemble().parameters))
    columns = [0, 1, 2, 3] * 2
    assert calibrate(ensemble(), shots_at(z, columns), refine=0).warnings == ()
    low = [replace(shot, force_N=share * shot.force_N) for shot in shots_at(z, columns)]
    made = calibrate(ensemble(), low, refine=0)
    assert made.warnings[0].startswith("8 of 8 shots lie below the least that was believed before")
    assert "Are readings in another unit, or does the gauge show too little?" in made.warnings[0]
    assert made.to_json()["warnings"] == list(made.warnings)
    written = calibrated_toml(made, ensemble().conditions[0].situation.scenario)
    assert f"# WARNING: {made.warnings[0]}" in written
    latency = next(each for each in made.found if each.key == LATENCY)
    given = min(condition.scenario.reaction.latency_s for condition in ensemble().conditions)
    below = [warning for warning in made.warnings if "which would be below zero and counts as 0" in warning]
    assert len(below) == (given + latency.high < 0)
    assert all("too low to be explained by a latency" in warning for warning in below)


def test_a_latency_is_doubted_where_chance_does_not_take_it_below_zero() -> None:
    """About 0 ms half of all honest shots have a median below it: of -0.1 ms, -7 to 6, every scenario had a warning."""
    shots, conditions = shots_at(np.zeros(len(ensemble().parameters)), [0]), ensemble().conditions
    given = min(condition.scenario.reaction.latency_s for condition in conditions)
    believed = [(shots[0].force_N, 0.5 * shots[0].force_N, 2 * shots[0].force_N)]
    assert reading_doubts(believed, shots, conditions, (-given - 1e-4, 6e-3), (0.03, 0.03)) == ()
    (warning,) = reading_doubts(believed, shots, conditions, (-given - 7e-3, -given - 1e-4), (0.03, 0.03))
    assert "below zero and counts as 0: a latency alone does not explain them" in warning


def test_shots_that_all_lie_below_belief_are_doubted() -> None:
    """A gauge that shows 0.6 of the force: parameters explain it, and scenarios promised it without a word."""
    z = np.zeros(len(ensemble().parameters))
    columns = [0, 1, 2, 3] * 2
    low = [replace(shot, force_N=0.6 * shot.force_N) for shot in shots_at(z, columns)]
    (warning,) = calibrate(ensemble(), low, refine=0).warnings
    assert warning.startswith(
        "8 of 8 shots lie below the least that was believed before, 0.59 times the expected force"
    )
    assert "gauge, speed and place" in warning
    # A cell that is milder than assumed, as many are.
    milder = [replace(shot, force_N=0.85 * shot.force_N) for shot in shots_at(z, columns)]
    assert calibrate(ensemble(), milder, refine=0).warnings == ()


def test_a_parameter_far_from_belief_is_told() -> None:
    """Else the deceleration is blamed for what a latency does that is longer than was told."""
    z = np.zeros(len(ensemble().parameters))
    z[ensemble().parameters.index(LATENCY)] = 3.3
    (warning,) = calibrate(ensemble(), shots_at(z, [0, 1, 2, 3] * 4), refine=0).warnings
    assert warning.startswith("The shots put the latency")
    assert "standard deviations above what was told or assumed of it before" in warning
    z[ensemble().parameters.index(LATENCY)] = 1.6
    assert calibrate(ensemble(), shots_at(z, [0, 1, 2, 3] * 4), refine=0).warnings == ()


@pytest.mark.parametrize(
    ("columns", "factors"),
    [
        ([0, 1, 2, 3] * 2, [0.6] * 4 + [1.0] * 4),
        ([1, 1], [0.5, 1.6]),
        # Shots of the full speed that were made at half of it.
        ([0, 0, 1, 1, 2, 3], [1, 1, 0.56, 0.56, 1, 1]),
    ],
)
def test_shots_that_contradict_each_other_are_told(columns: list[int], factors: list[float]) -> None:
    """No single one was far enough off to be named."""
    shots = shots_at(np.zeros(len(ensemble().parameters)), columns)
    mixed = [replace(shot, force_N=factor * shot.force_N) for shot, factor in zip(shots, factors, strict=True)]
    (warning,) = calibrate(ensemble(), mixed, refine=0).warnings
    assert "shots contradict each other" in warning
    assert "3 % was told of the gauge" in warning


def test_bad_shots_of_one_number_are_told_apart() -> None:
    """As of two plans that were measured one after the other."""
    columns = [0, 1, 2, 3, 0, 1, 2, 3, 1, 3]
    shots = shots_at(np.zeros(len(ensemble().parameters)), columns, bad={2: 2.0, 7: 0.5})
    numbered = [replace(shot, number=(shot.number - 1) % 5 + 1) for shot in shots]
    made = calibrate(ensemble(), numbered, refine=0)
    assert [each.shot for each in made.bad_shots] == [numbered[1], numbered[6]]
    notes = [note for note in made.notes if "hardly counts" in note]
    for each, note, shot in zip(made.to_json()["bad_shots"], notes, (numbered[1], numbered[6]), strict=True):
        about = (2, shot.situation, shot.speed_mm_s, shot.force_N)
        assert (each["shot"], each["situation"], each["speed_mm_s"], each["force_N"]) == about
        assert note.startswith(f"Shot 2, {shot.situation} at {shot.speed_mm_s:.4g} mm/s with {shot.force_N:.4g} N, ")


def test_joints_and_pads_may_be_off_each_by_itself() -> None:
    """One factor stands for all of them; where they are not alike, intervals elsewhere held the truth in 3 of 4."""
    condition = ensemble().conditions[3]
    scenario, parameters = condition.scenario, ensemble().parameters
    sd = parameters.each[parameters.index(CONTACT)].sd
    pad = scenario.contact.stiffness_N_m
    assert pad is not None
    low, high = (
        shot_force(scenario.with_values({"contact.stiffness_N_m": pad * math.exp(z * sd)})).log_mean for z in (-1, 1)
    )
    assert ensemble().own_error[3] == pytest.approx((high - low) / 2, rel=1e-9)
    # Many shots at other places do not make the belly known better than its pad.
    made = calibrate(ensemble(), shots_at(np.zeros(len(parameters)), [0, 1, 4, 5] * 8), refine=0)
    _, least, most = made.forces[3].expected_N
    assert math.log(most / least) > 3.8 * ensemble().own_error[3]
    known = Parameters.of([scenario], fixed=[CONTACT])
    (alone,) = PeakForceEnsemble.of(known, [condition], points=32).own_error
    assert alone == 0


def test_the_joints_of_an_elastic_arm_are_changed_one_by_one() -> None:
    scenario = elastic(arm__gear_stiffness_Nm_rad=20000.0)
    parameters = Parameters.of([scenario], fixed=[CONTACT])
    changed = parameters.apart(parameters.with_nominal(scenario), 1.0)
    assert len(changed) == 3 * 6
    gears = [each.arm.gear_stiffness_Nm_rad for each in changed[:6]]
    assert all(isinstance(each, list) for each in gears)
    first = np.array(gears) / 20000.0
    assert first == pytest.approx(1 + (math.exp(0.4) - 1) * np.eye(6), rel=1e-12)


def test_same_seed_same_figures() -> None:
    shots = shots_at(np.zeros(len(ensemble().parameters)), [0, 1, 2])
    one, two = (calibrate(ensemble(), shots, refine=0, seed=4).to_json() for _ in range(2))
    assert one == two


def test_next_shot_is_where_no_shot_was() -> None:
    made = calibrate(ensemble(), shots_at(np.zeros(len(ensemble().parameters)), [0, 1, 2, 3] * 3), refine=0)
    assert made.next_shot.situation == "side"
    assert made.next_shot.spread_after < made.next_shot.spread_now


def test_calibrated_scenario() -> None:
    z = np.zeros(len(ensemble().parameters))
    z[ensemble().parameters.index(THRESHOLDS)] = 1.5
    made = calibrate(ensemble(), shots_at(z, [0, 1, 2, 3] * 3), refine=0)
    scenario = rigid()
    data = tomllib.loads(calibrated_toml(made, scenario))
    spread = data.pop("uncertainty")
    carried = bs.Scenario.from_dict(data)
    factor = np.array(carried.detector.thresholds_Nm) / np.array(scenario.detector.thresholds_Nm)
    assert factor == pytest.approx(factor[0], rel=1e-5)
    found = {each.key: each for each in made.found}
    assert factor[0] == pytest.approx(found[THRESHOLDS].median, rel=1e-4)
    assert spread == uncertainty(made, scenario)
    assert spread[THRESHOLDS] == {"distribution": "lognormal", "sigma": pytest.approx(found[THRESHOLDS].sd, rel=1e-5)}
    # The pad belongs to the gauge, not to the body; what no shot told is marked as assumed.
    assert CONTACT not in spread
    assert all(spread[each.key].get("assumed") is True for each in made.assumed if each.key in spread)
    assert "assumed" not in spread[THRESHOLDS]


def test_a_scenario_is_given_only_keys_that_it_has() -> None:
    """A cell of several kinds of links and stops: a rigid arm has no rotors, a bare link no padding."""
    table = Path(__file__).resolve().parents[2] / "examples" / "stopping" / "tm5_700.toml"
    named = {
        "bare": rigid(),
        "padded": rigid(contact__padding_N_m=50000.0),
        "elastic": elastic(),
        "constant time": rigid(reaction__deceleration="constant_time", reaction__stopping_time_s=0.05),
        "table": rigid(reaction__deceleration="table", reaction__stopping_table=str(table)),
    }
    situations = situations_of(list(named.items()))
    parameters = Parameters.of([each.measured for each in situations])
    conditions = conditions_of(situations, parameters, (1.0,))
    mixed = PeakForceEnsemble.of(parameters, conditions, points=32, seed=3)
    shots = [
        MeasuredShot(each.situation.name, each.speed_mm_s, 100.0, number) for number, each in enumerate(conditions)
    ]
    made = calibrate(mixed, shots, refine=0)
    for name, scenario in named.items():
        data = tomllib.loads(calibrated_toml(made, scenario))
        bs.Scenario.from_dict(data)
        spread = set(data["uncertainty"])
        assert ("arm.rotor_inertia_kg_m2" in spread) == (name == "elastic")
        assert (PADDING in spread) == (name == "padded")
        assert (DECELERATION in spread) == (name not in ("constant time", "table"))
        assert (STOPPING_TIME in spread) == (name == "constant time")
        assert LATENCY in spread


@pytest.mark.parametrize("size", [-1.2, 1.2])
def test_a_calibrated_scenario_gives_the_measured_forces(size: float) -> None:
    """Also by what no shot tells alone: many parameters that moved a little move the force by a lot."""
    made = calibrate(ensemble(), shots_at(np.full(len(ensemble().parameters), size), [0, 1, 2, 3] * 3), refine=0)
    assert made.assumed
    hand = max((each for each in made.forces if each.situation == "hand"), key=lambda each: each.speed_mm_s)
    carried = bs.Scenario.from_dict(tomllib.loads(calibrated_toml(made, rigid())))
    # The pad is the gauge's, and no key of the scenario.
    pad = made.parameters.index(CONTACT)
    z = np.zeros(len(made.parameters))
    z[pad] = np.median(made.posterior.z[:, pad])
    (situation,) = situations_of([("hand", carried)])
    found = float(np.exp(shot_force(made.parameters.at(situation.measured, z)).log_mean))
    low, high = hand.expected_N[1:]
    assert found == pytest.approx(hand.expected_N[0], rel=0.05)
    assert low < found < high
    assert abs(hand.expected_N[0] / hand.before_N[0] - 1) > 0.15


def test_shots_over_the_limit_and_beyond_belief_are_named() -> None:
    shots = shots_at(np.zeros(len(ensemble().parameters)), [0, 1] * 3)
    limit = 140.0
    over = [MeasuredShot(shot.situation, shot.speed_mm_s, 1.01 * limit, shot.number) for shot in shots]
    (hand,) = {force.limit_N for force in calibrate(ensemble(), over, refine=0).forces if force.situation == "hand"}
    assert hand == limit
    said = calibrate(ensemble(), over, refine=0).notes
    assert sum("3 of 3 shots exceed the limit of 140 N, up to 141.4 N" in note for note in said) == 2
    wild = [
        MeasuredShot(s.situation, s.speed_mm_s, s.force_N * factor, s.number)
        for s, factor in zip(shots, (1, 1, 4, 4, 9, 9), strict=True)
    ]
    assert any(
        "outside what single shots should show even now" in note for note in calibrate(ensemble(), wild, refine=0).notes
    )
    assert not any(
        "shots" in note and "limit" in note
        for note in calibrate(ensemble(), shots_at(np.zeros(len(ensemble().parameters)), [0]), refine=0).notes
    )


def test_bad_input() -> None:
    with pytest.raises(InputError, match="measured_peak_force_N: no shot is measured; fill in one row"):
        calibrate(ensemble(), [])
    with pytest.raises(InputError, match="shot 7: 'hand' at 33 mm/s is not among the conditions"):
        calibrate(ensemble(), [MeasuredShot("hand", 33.0, 100.0, 7)])
