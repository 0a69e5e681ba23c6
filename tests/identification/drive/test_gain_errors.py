"""Standard errors of gains know of the choice of the model and of an inertia that is not quite the published one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification import compare_currents, identify_joint_model, judge_currents
from bumpstop.identification.drive.error_sources import GainByModel, error_of_choice, weights_of
from bumpstop.joint import JointTorqueModel
from bumpstop.model import inverse_dynamics, with_rotors
from identification.drives import driven, drives, fourier

ROBOT = bs.Robot.load("ur5e")
MOTION = fourier(ROBOT, 20.0, 100.0, 3)
OPTIONS = {"maps": ["linear"], "frictions": ["power"], "cutoff_hz": 10.0, "rest_speed": 0.01}


def heavier(link: int, share: float) -> bs.Robot:
    joint = ROBOT.joints[link]
    assert joint.inertia is not None
    tensor = tuple(tuple((1 + share) * x for x in row) for row in joint.inertia.tensor)
    own = replace(joint.inertia, mass=(1 + share) * joint.inertia.mass, tensor=tensor)
    return replace(ROBOT, joints=(*ROBOT.joints[:link], replace(joint, inertia=own), *ROBOT.joints[link + 1 :]))


def test_weights_are_likelihoods_and_the_choice_adds_what_lies_between() -> None:
    alike = [GainByModel(10.0, 0.1, 0.5), GainByModel(11.0, 0.1, 0.5)]
    np.testing.assert_allclose(weights_of(alike, 100.0), [0.5, 0.5])
    assert error_of_choice(alike, 0, weights_of(alike, 100.0)) == pytest.approx(np.sqrt(0.5))
    # A tenth more error on a hundred independent rows: 1.1^-100.
    worse = [alike[0], replace(alike[1], held_out=0.55)]
    assert weights_of(worse, 100.0)[1] == pytest.approx(1.1**-100, rel=1e-3)
    assert error_of_choice(worse, 0, weights_of(worse, 100.0)) < 1e-2
    # One that knows its gain less well makes the chosen one less sure, one that knows it better does not.
    vague, sure = replace(alike[0], error=0.5), replace(alike[0], error=0.01)
    assert error_of_choice([alike[0], vague], 0, np.array([0.5, 0.5])) == pytest.approx(np.sqrt(0.5 * (0.25 - 0.01)))
    assert error_of_choice([alike[0], sure], 0, np.array([0.5, 0.5])) == 0.0


def test_a_heavier_link_moves_gains_as_foreseen() -> None:
    """Fits with one link heavier than published, link by link, make the error that the inertia is said to make."""
    truth = drives(ROBOT, inverse_dynamics(with_rotors(ROBOT, 0.0), *MOTION[1:]), kind="linear")
    log = driven(ROBOT, MOTION, truth, 1, noise=0.01)
    small = 0.002
    fit = identify_joint_model(log, ROBOT, inertia_uncertainty=small, **OPTIONS)  # type: ignore[arg-type]
    by_mass = np.zeros(3)
    for link in range(ROBOT.dof):
        other = identify_joint_model(log, heavier(link, small), inertia_uncertainty=0.0, **OPTIONS)  # type: ignore[arg-type]
        by_mass += [(other.model.joints[j].value("B") - fit.model.joints[j].value("B")) ** 2 for j in (1, 2, 3)]
    for place, j in enumerate((1, 2, 3)):
        foreseen = fit.joints[j].gain_errors["inertia"]
        # Masses are one part of it, places of centres the other, which can only add.
        assert np.sqrt(by_mass[place]) <= 1.05 * foreseen
        assert foreseen < 3 * np.sqrt(by_mass[place])
        gain = fit.model.joints[j].parameters["B"]
        assert gain is not None
        assert gain.standard_error == pytest.approx(np.linalg.norm(list(fit.joints[j].gain_errors.values())))
    plain = identify_joint_model(log, ROBOT, inertia_uncertainty=0.0, **OPTIONS)  # type: ignore[arg-type]
    assert plain.joints[1].gain_errors["inertia"] == 0.0
    with pytest.raises(bs.InputError, match=r"inertia_uncertainty: is -0\.1"):
        identify_joint_model(log, ROBOT, inertia_uncertainty=-0.1)


def test_intervals_hold_where_the_inertia_is_not_the_published_one() -> None:
    """Masses off by 5 %: by noise alone hardly one interval holds the gain."""
    scores, by_noise = [], []
    for seed in range(3):
        moved = ROBOT
        for link, off in enumerate(0.05 * np.random.default_rng(seed).normal(size=ROBOT.dof)):
            joint = heavier(link, float(off)).joints[link]
            moved = replace(moved, joints=(*moved.joints[:link], joint, *moved.joints[link + 1 :]))
        truth = drives(moved, inverse_dynamics(with_rotors(moved, 0.0), *MOTION[1:]), kind="linear")
        fit = identify_joint_model(driven(moved, MOTION, truth, seed), ROBOT, **OPTIONS)  # type: ignore[arg-type]
        for found, planted in zip(fit.joints[1:5], truth.joints[1:5], strict=True):
            gain = found.parameters.parameters["B"]
            assert gain is not None
            assert gain.standard_error is not None
            error = gain.value - planted.value("B")
            scores.append(abs(error) / gain.standard_error)
            by_noise.append(abs(error) / found.gain_errors["noise"])
    # Twelve intervals: two outside would have one chance in ten if they were independent.
    assert sum(score < 1.96 for score in scores) >= 10, scores
    assert sum(score < 1.96 for score in by_noise) <= 6, by_noise


@pytest.mark.parametrize("width", [1e-9, 0.03])
def test_friction_that_turns_over_in_its_own_way_moves_no_gain(width: float) -> None:
    """C tanh(qd / width) + V qd of joint 1, which has nothing but inertia to tell its gain by.

    Where rows near reversals counted, the gain was up to nine times the planted one.
    """
    scores = []
    for seed in (0, 1, 3):
        slow = 0.6  # so that the torque of inertia is small beside friction
        t, q, qd, qdd = fourier(ROBOT, slow * 40.0, 100.0 / slow, seed)
        t, qd, qdd = t / slow, qd * slow, qdd * slow**2
        torque = inverse_dynamics(with_rotors(ROBOT, 0.0), q, qd, qdd) + 6 * np.tanh(qd / width) + 8 * qd
        rng = np.random.default_rng(seed)
        current = torque / 12 + 0.03 * rng.normal(size=q.shape)
        log = bs.Recording(t=t, q=q + 2e-5 * rng.normal(size=q.shape), current=current)
        joint = identify_joint_model(log, ROBOT, joints=[0]).joints[0]
        gain = joint.parameters.parameters["B"]
        assert gain is not None
        assert gain.standard_error is not None
        assert gain.standard_error < 0.25 * gain.value
        scores.append((gain.value - 12) / gain.standard_error)
        assert joint.measured.size == joint.predicted.size == joint.qd.size
        assert 0 < joint.near_reversals < 0.6 * joint.measured.size
    assert np.abs(scores).max() < 1.96, scores


def without_the_elbow_s_gain() -> tuple[JointTorqueModel, JointTorqueModel, bs.Recording]:
    """Drives, the same with an unknown gain, and a recording of the drives."""
    truth = drives(ROBOT, inverse_dynamics(with_rotors(ROBOT, 0.0), *MOTION[1:]), kind="linear")
    elbow = truth.joints[2]
    unknown = replace(elbow, parameters={**elbow.parameters, "B": None, "inertia": None, "hysteresis": None})
    return (
        truth,
        replace(truth, joints=(*truth.joints[:2], unknown, *truth.joints[3:])),
        driven(ROBOT, MOTION, truth, 1),
    )


def test_a_joint_of_unknown_gain_is_scored_up_to_a_free_gain() -> None:
    """Its current is predicted as well as with the gain, whatever the gain is; a wrong motion is told all the same."""
    truth, gainless, log = without_the_elbow_s_gain()
    known, free = (compare_currents(model, log, ROBOT) for model in (truth, gainless))
    scores = free.current_scores()
    assert [score.free_gain for score in scores] == [False, False, True, False, False, False]
    assert scores[2].unit == "A"
    assert scores[2].r2 == pytest.approx(known.current_scores()[2].r2, abs=0.003)
    assert scores[2].r2 > 0.98
    assert free.torque_scores()[2] is None
    assert np.isnan(free.estimated[:, 2]).all()
    # The other way round in time the current belongs to another torque.
    assert log.current is not None
    turned = compare_currents(gainless, replace(log, current=log.current[::-1].copy()), ROBOT).current_scores()[2]
    assert turned.r2 < 0.5


def test_a_joint_of_unknown_gain_is_judged_by_the_rule_of_the_others() -> None:
    """A model was usable over any R2 of it, and nothing said that its gain is unknown."""
    _, gainless, log = without_the_elbow_s_gain()
    verdict = judge_currents(compare_currents(gainless, log, ROBOT))
    assert verdict.usable
    assert "the gain of elbow_joint is not known: currents are judged up to a free gain" in verdict.warnings
    assert log.current is not None
    other = log.current.copy()
    other[:, 2] = 0.01 * np.random.default_rng(1).normal(size=log.t.size)
    found = compare_currents(gainless, replace(log, current=other), ROBOT)
    assert found.current_scores()[2].r2 < 0
    (fault,) = judge_currents(found).faults
    assert "of the current of elbow_joint is not predicted" in fault
