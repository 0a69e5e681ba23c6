"""A payload that was planted is found, from torques and from currents; what is not identifiable is None."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification import (
    DynamicsFit,
    PayloadFit,
    identify_dynamics,
    identify_joint_model,
    identify_payload,
    inertial_regressor,
    judge_payload,
    with_payload,
)
from bumpstop.identification.payload.tip_parameters import parameters_of, pseudo_inertia
from bumpstop.identification.statistics.robust_fit import visible_share
from bumpstop.model import LinkInertia, inverse_dynamics, with_rotors
from bumpstop.recording import Recording
from identification.drives import driven, drives, fourier, planted

MASS, CENTER = 2.5, (0.03, -0.02, 0.09)


def test_parameters_and_pseudo_inertia_are_one_thing_said_twice() -> None:
    parameters = np.random.default_rng(0).normal(size=10)
    np.testing.assert_allclose(parameters_of(pseudo_inertia(parameters)), parameters, atol=1e-14)


@pytest.mark.parametrize("falls", [(0.0, 0.0, 9.80665), (-9.80665, 0.0, 0.0)])
def test_an_arm_that_was_mounted_another_way_is_told_so(falls: tuple[float, float, float]) -> None:
    """Of one on the ceiling the mass was hardly known, or negative for signs that were right."""
    robot = bs.Robot.load("ur5e")
    t, q, qd, qdd = fourier(robot, 15.0, 100.0, 1)
    torque = inverse_dynamics(with_payload(robot, MASS, CENTER), q, qd, qdd, gravity=falls)
    log = Recording(t=t, q=q, qd=qd, tau=torque + np.random.default_rng(1).normal(0, 0.2, q.shape))
    told = f"free fall along {','.join(f'{x:g}' for x in falls)} explains the recording far better"
    assert any(fault.startswith(told) for fault in judge_payload(identify_payload(log, robot), log, robot).faults)
    right = judge_payload(identify_payload(log, robot, gravity=falls), log, robot)
    assert not any("free fall" in fault for fault in right.faults)


def test_from_currents_with_a_joint_model() -> None:
    robot = bs.Robot.load("ur5e")
    carrying = with_payload(robot, MASS, CENTER)
    motion = fourier(robot, 30.0, 100.0, 1)
    model = drives(robot, inverse_dynamics(with_rotors(carrying, 0.0), *motion[1:]))
    inside = []
    for seed in range(4):
        fit = identify_payload(driven(carrying, motion, model, seed), robot, model=model)
        assert fit.unobservable == ()
        assert fit.center is not None
        assert fit.center_errors is not None
        assert fit.standard_errors["m"] is not None
        inside += [abs(fit.parameters["m"].value - MASS) / fit.standard_errors["m"]]
        inside += [abs(c - truth) / e for c, truth, e in zip(fit.center, CENTER, fit.center_errors, strict=True)]
        assert fit.parameters["m"].value == pytest.approx(MASS, rel=0.05)
    # Sixteen intervals at 95 %: three outside has a chance of 1 in 25, four 1 in 140.
    assert sum(z < 1.96 for z in inside) >= 13, inside


def test_from_torques_beside_friction_and_with_second_moments() -> None:
    robot = bs.Robot.load("panda")
    carrying = with_payload(robot, MASS, CENTER)
    t, q, qd, qdd = fourier(robot, 30.0, 100.0, 2)
    tau = inverse_dynamics(carrying, q, qd, qdd) + 2.0 * np.sign(qd) + 1.5 * qd + 0.4
    tau += 0.05 * np.random.default_rng(3).normal(size=tau.shape)
    fit = identify_payload(Recording(t=t, q=q, tau=tau), robot, inertia=True, cutoff_hz=8.0)
    assert fit.parameters["m"].value == pytest.approx(MASS, rel=0.03)
    assert fit.center == pytest.approx(CENTER, abs=0.01)
    assert set(fit.parameters) >= {"Ixx", "Iyz"}


@pytest.mark.parametrize("lost", [(), ((5.0, 6.0), (9.0, 11.0))])
def test_an_arm_that_moves_at_the_ends_of_stretches_shows_its_payload(lost: tuple[tuple[float, float], ...]) -> None:
    """Filters know one side of the motion there, and what stands in a gap is made up: neither may pull the mass."""
    robot = bs.Robot.load("ur5e")
    carrying = with_payload(robot, MASS, CENTER)
    deviations = []
    for seed in range(16):
        t, q, qd, qdd = fourier(robot, 20.0, 250.0, seed)
        tau = inverse_dynamics(carrying, q, qd, qdd) + 3 * np.tanh(qd / 0.01) + 2 * qd
        tau += 0.3 * np.random.default_rng(seed).normal(size=tau.shape)
        kept = np.ones(t.size, dtype=bool)
        for start, end in lost:
            kept &= (t <= start) | (t >= end)
        fit = identify_payload(Recording(t=t[kept], q=q[kept], tau=tau[kept]), robot)
        mass, error = fit.parameters["m"].value, fit.standard_errors["m"]
        assert mass is not None
        assert error is not None
        assert mass == pytest.approx(MASS, abs=0.05)
        deviations.append((mass - MASS) / error)
        # 0.2 s at 5 Hz at each end of each segment.
        assert fit.rows_left == pytest.approx(50 * 2 * (1 + len(lost)), abs=4)
    # The mean of sixteen, in standard errors of the mean.
    assert abs(np.mean(deviations)) * 4 < 3


def test_a_pose_that_stands_still_does_not_show_every_moment() -> None:
    robot = bs.Robot.load("ur5e")
    carrying = with_payload(robot, MASS, CENTER)
    t = np.arange(0, 10, 0.01)
    q = np.tile(np.array([0.2, -1.0, 1.2, -0.4, 0.5, 0.1]), (t.size, 1)) + 1e-4 * np.sin(t)[:, None]
    still = np.zeros_like(q)
    model = drives(robot, inverse_dynamics(with_rotors(carrying, 0.0), q, still, still) + 1.0)
    fit = identify_payload(driven(carrying, (t, q, still, still), model, 1), robot, model=model)
    # Along gravity a shift of the centre changes no torque.
    assert fit.unobservable
    assert fit.center is None


def test_a_pose_that_never_changes_shows_nothing_beside_offsets() -> None:
    """Whatever a payload asks for there, the offsets of the joints could as well."""
    robot = bs.Robot.load("ur5e")
    t = np.arange(0, 10, 0.01)
    q = np.tile(np.array([0.2, -1.0, 1.2, -0.4, 0.5, 0.1]), (t.size, 1))
    torque = inverse_dynamics(with_payload(robot, MASS, CENTER), q, 0 * q, 0 * q)
    for seed in range(5):
        noise = 0.01 * np.random.default_rng(seed).normal(size=q.shape)
        fit = identify_payload(Recording(t=t, q=q, tau=torque + noise), robot)
        assert fit.unobservable == ("m", "mx", "my", "mz")


def test_a_moment_that_no_joint_can_feel_is_not_seen() -> None:
    """Two slides, and one joint about y: where the centre lies along y changes nothing, but for rounding."""
    link = LinkInertia(mass=2.0, center=(0.02, 0.03, 0.1), tensor=((0.03, 0, 0), (0, 0.02, 0), (0, 0, 0.01)))
    robot = bs.Robot(
        name="gantry",
        joints=tuple(
            bs.Joint(
                name=name, link=f"link_{name}", kind=kind, axis=axis, lower=-3.0, upper=3.0, velocity=3.0, inertia=link
            )
            for name, kind, axis in (
                ("x", "prismatic", (1.0, 0.0, 0.0)),
                ("z", "prismatic", (0.0, 0.0, 1.0)),
                ("tilt", "revolute", (0.0, 1.0, 0.0)),
            )
        ),
    )
    t, q, qd, qdd = fourier(robot, 20.0, 200.0, 1)
    tau = inverse_dynamics(with_payload(robot, MASS, (0.05, 0.0, 0.1)), q, qd, qdd) + 2 * np.tanh(qd / 0.01)
    tau += 0.2 * np.random.default_rng(2).normal(size=tau.shape)
    log = Recording(t=t, q=q, tau=tau)
    fit = identify_payload(log, robot, mass=MASS)
    assert fit.unobservable == ("my",)
    assert fit.center is None
    assert fit.parameters["mx"].value == pytest.approx(0.05 * MASS, abs=0.03)
    assert fit.parameters["mz"].value == pytest.approx(0.1 * MASS, abs=0.03)
    # Neither the known mass nor what loads no joint is fitted.
    assert fit.condition is not None
    assert 1 <= fit.condition < 100

    # Both slides feel the mass as they would feel rotors of theirs, and its weight as an offset.
    fit = identify_payload(log, robot)
    assert fit.unobservable == ("m", "my")
    assert "--dynamics" in judge_payload(fit, log, robot).faults[0]


def test_rotors_that_an_inertia_of_links_lacks_are_no_payload() -> None:
    """Torques of motors turn rotors as well, which neither a URDF nor a built-in robot has."""
    for name, rotors in (("ur5e", (3.0, 3.0, 2.0, 0.3, 0.3, 0.2)), ("panda", (1.0, 1.0, 0.8, 0.8, 0.3, 0.3, 0.2))):
        robot = bs.Robot.load(name)
        carrying = with_payload(with_rotors(robot, rotors), MASS, CENTER)
        deviations = []
        for seed in range(4):
            t, q, qd, qdd = fourier(robot, 20.0, 100.0, seed)
            tau = inverse_dynamics(carrying, q, qd, qdd) + 3 * np.tanh(qd / 0.02) + 2 * qd
            tau += 0.2 * np.random.default_rng(40 + seed).normal(size=tau.shape)
            fit = identify_payload(Recording(t=t, q=q, tau=tau), robot)
            assert fit.center is not None
            assert fit.center_errors is not None
            mass, error = fit.parameters["m"].value, fit.standard_errors["m"]
            assert mass is not None
            assert error is not None
            deviations.append((mass - MASS) / error)
            deviations += [(c - truth) / e for c, truth, e in zip(fit.center, CENTER, fit.center_errors, strict=True)]
        # The sum of sixteen squares: chi-squared is above 34 once in 200.
        assert sum(z * z for z in deviations) < 34, deviations


def test_the_rotor_of_a_slide_is_no_payload() -> None:
    """Of a SCARA two joints turn the mass about, which tells it from the rotor of the slide that lifts it."""

    def joint(name: str, kind: str, x: float, mass: float) -> bs.Joint:
        link = LinkInertia(mass=mass, center=(0.1, 0.0, 0.0), tensor=((0.01, 0, 0), (0, 0.02, 0), (0, 0, 0.02)))
        where = {"origin": (x, 0.0, 0.0), "axis": (0.0, 0.0, 1.0), "lower": -3.0, "upper": 3.0, "velocity": 3.0}
        return bs.Joint(name=name, link=f"link_{name}", kind=kind, inertia=link, **where)  # type: ignore[arg-type]

    joints = (joint("shoulder", "revolute", 0.0, 4.0), joint("elbow", "revolute", 0.3, 3.0))
    robot = bs.Robot(name="scara", joints=(*joints, joint("slide", "prismatic", 0.25, 0.9)))
    t, q, qd, qdd = fourier(robot, 30.0, 100.0, 7)
    tau = inverse_dynamics(with_payload(with_rotors(robot, (0.5, 0.3, 3.0)), MASS), q, qd, qdd) + 2 * np.tanh(qd / 0.02)
    tau += 0.2 * np.random.default_rng(8).normal(size=tau.shape)
    fit = identify_payload(Recording(t=t, q=q, tau=tau), robot)
    error = fit.standard_errors["m"]
    assert error is not None
    assert fit.parameters["m"].value == pytest.approx(MASS, abs=3 * error)


def test_visible_share_is_what_is_left_after_the_other_columns() -> None:
    """Against the residual of a regression, column by column, also of columns that stand twice."""
    rng = np.random.default_rng(6)
    for copies in (0, 1, 2):
        columns = rng.normal(size=(40, 6)) @ (np.eye(6) + 0.5 * rng.normal(size=(6, 6)))
        columns = np.concatenate([columns, 3 * columns[:, :copies], np.zeros((40, 1))], axis=1)
        left = []
        for k in range(columns.shape[1]):
            others = np.delete(columns, k, axis=1)
            rest = columns[:, k] - others @ np.linalg.lstsq(others, columns[:, k])[0]
            left.append(np.linalg.norm(rest) / max(np.linalg.norm(columns[:, k]), 1e-300))
        np.testing.assert_allclose(visible_share(columns), left, atol=3e-7)
    assert visible_share(np.zeros((40, 3))).tolist() == [0.0, 0.0, 0.0]
    assert visible_share(np.zeros((40, 0))).size == 0  # all of a fit may be known already


def test_columns_of_a_payload_are_the_difference_it_makes() -> None:
    robot = bs.Robot.load("panda")
    _, q, qd, qdd = fourier(robot, 0.5, 100.0, 4)
    plain = inertial_regressor(robot, q, qd, qdd, (0.0, 0.0, -9.80665))
    assert plain.shape == (50, 7, 70)
    more = inverse_dynamics(with_payload(robot, MASS), q, qd, qdd) - inverse_dynamics(robot, q, qd, qdd)
    at = np.asarray(robot.tip_origin)
    point = MASS * np.array([1, *at])
    tensor = MASS * (at @ at * np.eye(3) - np.outer(at, at))
    moments = np.array([*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]])
    np.testing.assert_allclose(plain[:, :, 60:] @ np.concatenate([point, moments]), more, atol=1e-9)


def test_what_cannot_be_fitted_is_refused() -> None:
    robot = bs.Robot.load("ur5e")
    t, q, _, _ = fourier(robot, 2.0, 100.0, 5)
    log = Recording(t=t, q=q)
    with pytest.raises(bs.InputError, match="has no joint torque"):
        identify_payload(log, robot)
    model = drives(robot, np.ones((1, 6)))
    with pytest.raises(bs.InputError, match="has no motor current"):
        identify_payload(log, robot, model=model)
    with pytest.raises(bs.InputError, match="has 6 joints"):
        identify_payload(replace(log, tau=q), bs.Robot.load("panda"))


def test_a_model_of_another_arm_is_refused() -> None:
    """All arms of one maker share the names of their joints: 2 kg came out as 1.26 with dynamics of a neighbour."""
    robot, other = bs.Robot.load("ur5e"), bs.Robot.load("ur10")
    motion = fourier(robot, 10.0, 100.0, 5)
    model, currents = planted(robot, motion, 1)
    t, q, qd, qdd = motion
    log = replace(currents, t=t, q=q, current=None, tau=inverse_dynamics(robot, q, qd, qdd) + np.sign(qd))
    dynamics = identify_dynamics(log, robot, cutoff_hz=5.0).model
    said = "robot: is 'ur10', and the model was fitted to 'ur5e'"
    with pytest.raises(bs.InputError, match=said):
        identify_payload(currents, other, model=model)
    with pytest.raises(bs.InputError, match=said):
        identify_payload(log, other, dynamics=dynamics)
    # The path of a URDF tells nothing of the arm.
    assert identify_payload(currents, robot, model=replace(model, robot="here/arm.urdf")).parameters["m"].value
    renamed = replace(robot.joints[1], name="j_2")
    turned = replace(robot, joints=(robot.joints[0], renamed, *robot.joints[2:]))
    with pytest.raises(bs.InputError, match="has a joint 'j_2' where the model's ur5e has 'shoulder_lift_joint'"):
        identify_payload(currents, turned, model=model)


def test_a_payload_moved_beyond_what_the_model_saw_is_told() -> None:
    """``validate`` said so of the same recording; the payload was "usable" with errors of ten standard errors."""
    robot = bs.Robot.load("ur5e")
    carrying = with_payload(robot, MASS, CENTER)
    small, wide = fourier(robot, 20.0, 100.0, 5), fourier(robot, 20.0, 100.0, 6)
    t, q, qd, qdd = small
    still = 0.3
    q, qd, qdd = q.mean(axis=0) + still * (q - q.mean(axis=0)), still * qd, still * qdd

    def torques(arm: bs.Robot, motion: tuple[np.ndarray, ...], seed: int) -> Recording:
        t, q, qd, qdd = motion
        noise = 0.2 * np.random.default_rng(seed).normal(size=q.shape)
        return Recording(t=t, q=q, tau=inverse_dynamics(arm, q, qd, qdd) + 3 * np.tanh(qd / 0.01) + 2 * qd + noise)

    fit = identify_dynamics(torques(robot, (t, q, qd, qdd), 1), robot, cutoff_hz=5.0)
    for motion, told in (((t, q, qd, qdd), False), (wide, True)):
        log = torques(carrying, motion, 2)
        warnings = judge_payload(identify_payload(log, robot, dynamics=fit), log, robot).warnings
        for words in ("the positions of the fit", "the speeds of the fit"):
            assert any(words in one for one in warnings) == told, warnings
    log = torques(carrying, wide, 2)
    unknown = judge_payload(identify_payload(log, robot, dynamics=replace(fit, seen=None)), log, robot).warnings
    assert any("does not say what motion it was fitted to" in one for one in unknown)

    model = drives(robot, inverse_dynamics(with_rotors(carrying, 0.0), *wide[1:]))
    log = driven(carrying, wide, model, 3)
    for currents, speed, told in (((-8.0, 8.0), (0.0, 9.0), False), ((-0.5, 0.5), (0.0, 0.1), True)):
        joints = tuple(replace(joint, current_range=currents, speed_range=speed) for joint in model.joints)
        found = identify_payload(log, robot, model=replace(model, joints=joints))
        warnings = judge_payload(found, log, robot).warnings
        for words in ("want joint currents outside those of the fit", "are faster than the fit saw"):
            assert any(words in one for one in warnings) == told, warnings


def test_noise_takes_no_current_out_of_the_range_of_its_own_recording() -> None:
    """A range is that of the currents that a motion wants, by the model; a tenth of the recorded ones lay outside."""
    robot = bs.Robot.load("ur5e")
    motion = fourier(robot, 20.0, 100.0, 6)
    model = drives(robot, inverse_dynamics(with_rotors(robot, 0.0), *motion[1:]))
    log = driven(robot, motion, model, 3)
    assert log.current is not None
    noisy = replace(log, current=log.current + np.random.default_rng(5).normal(0, 3.0, log.current.shape))
    fit = identify_joint_model(noisy, robot)
    found = identify_payload(noisy, robot, model=fit.model)
    assert not any("want joint currents" in one for one in judge_payload(found, noisy, robot).warnings)


@pytest.mark.parametrize("mass", [1e-9, 1e-6])
def test_an_arm_that_carries_nothing_has_no_moments_that_a_far_centre_would_make(mass: float) -> None:
    """Errors of first moments over next to no mass are a centre kilometres away, whose inertia outweighs the arm."""
    robot = bs.Robot.load("panda")
    t, q, qd, qdd = fourier(robot, 20.0, 100.0, 3)
    tau = inverse_dynamics(robot, q, qd, qdd) + 2.0 * np.sign(qd) + 0.2 * np.random.default_rng(5).normal(size=q.shape)
    found = identify_payload(Recording(t=t, q=q, tau=tau), robot, mass=mass, cutoff_hz=8.0)
    for name in ("mx", "my", "mz"):
        value, error = found.parameters[name].value, found.standard_errors[name]
        assert value is not None
        assert error is not None
        assert abs(value) < max(4 * error, 1e-3), name
    assert (found.rmse < 1.05 * found.rmse_without).all()


def deviations(found: PayloadFit) -> list[float]:
    """Of mass and centre, in standard errors."""
    assert found.center is not None
    assert found.center_errors is not None
    mass, error = found.parameters["m"].value, found.standard_errors["m"]
    assert mass is not None
    assert error is not None
    return [(mass - MASS) / error, *((np.array(found.center) - CENTER) / np.array(found.center_errors))]


def test_errors_of_fitted_dynamics_are_in_those_of_the_payload(tmp_path: Path) -> None:
    """In intervals of noise alone these deviations lie too rarely; errors of a file of an older version are larger."""
    robot = bs.Robot.load("ur5e")
    squares: dict[str, list[float]] = {name: [] for name in ("fit", "file", "old", "model")}
    for seed in range(8):
        logs = []
        for part, arm in enumerate((robot, with_payload(robot, MASS, CENTER))):
            t, q, qd, qdd = fourier(robot, (10.0, 40.0)[part], 100.0, 30 + seed)
            noise = 0.5 * np.random.default_rng(2 * seed + part).normal(size=q.shape)
            tau = inverse_dynamics(arm, q, qd, qdd) + 3 * np.tanh(qd / 0.01) + 2 * qd + noise
            logs.append(Recording(t=t, q=q, tau=tau))
        fit = identify_dynamics(logs[0], robot, cutoff_hz=5.0)
        fit.save(tmp_path / "arm.toml")
        of_file, old = DynamicsFit.load(tmp_path / "arm.toml"), replace(fit, covariance=None)
        for name, dynamics in (("fit", fit), ("file", of_file), ("old", old), ("model", fit.model)):
            found = identify_payload(logs[1], robot, dynamics=dynamics)
            squares[name] += [z * z for z in deviations(found)]
            warnings = judge_payload(found, logs[1], robot).warnings
            assert any("do not know of errors of the dynamics" in one for one in warnings) == (name == "model")
    means = {name: float(np.mean(each)) for name, each in squares.items()}
    assert means["file"] == pytest.approx(means["fit"], rel=0.01)
    assert means["old"] < means["fit"] < 0.6 * means["model"]
    # Four deviations of one fit hang together: the mean of 32 is above 2 less than once in 100.
    assert means["fit"] < 2


def test_an_uncertain_inertia_is_in_the_errors_of_the_payload() -> None:
    """Masses off by 5 %: in the gains, which were fitted to them, and in the torque that the arm takes."""
    robot = bs.Robot.load("ur5e")
    squares: dict[float, list[float]] = {0.0: [], 0.05: []}
    for seed in range(6):
        rng = np.random.default_rng(seed)
        joints = []
        for joint in robot.joints:
            assert joint.inertia is not None
            mass, far = joint.inertia.mass * (1 + 0.05 * rng.normal()), np.linalg.norm(joint.inertia.center)
            center = tuple((np.array(joint.inertia.center) + 0.05 * far * rng.normal(size=3)).tolist())
            joints.append(replace(joint, inertia=replace(joint.inertia, mass=mass, center=center)))
        true = replace(robot, joints=tuple(joints))
        carrying, motion = with_payload(true, MASS, CENTER), fourier(robot, 20.0, 100.0, 50 + seed)
        model = drives(true, inverse_dynamics(with_rotors(carrying, 0.0), *motion[1:]), kind="linear")
        bare, log = driven(true, motion, model, seed), driven(carrying, motion, model, 100 + seed)
        for share, found in squares.items():
            fit = identify_joint_model(
                bare, robot, cutoff_hz=5.0, maps=["linear"], frictions=["power"], inertia_uncertainty=share
            )
            payload = identify_payload(log, robot, model=fit.model, inertia_uncertainty=share)
            found += [z * z for z in deviations(payload)]
    assert np.mean(squares[0.05]) < 2 < np.mean(squares[0.0])
