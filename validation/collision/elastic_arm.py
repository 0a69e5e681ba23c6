"""Arms whose gears give: the linear equations about the pose of contact beside arms with all their nonlinear terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from bumpstop.model import Robot, mass_matrix, robots
from reference.elastic_arm import Body, ElasticArm, collide
from validation.collision.nonlinear_arm import KNOT, Array, Drives, Reference, bare, line_rates, references, simulate
from validation.findings import Findings

TITLE = "Elastic arms: linear equations beside the nonlinear arm"
# Drawn about these, which a study of the UR10e assumed, and scaled by the square of the reach [kg m2, Nm/rad].
_ROTORS = {6: (1.5, 1.5, 0.9, 0.3, 0.3, 0.3), 7: (1.5, 1.5, 0.9, 0.9, 0.3, 0.3, 0.3)}
_GEARS = {6: (30e3, 30e3, 20e3, 6e3, 6e3, 6e3), 7: (30e3, 30e3, 20e3, 20e3, 6e3, 6e3, 6e3)}
_REACH = 1.3
_KNOTS = 300
QUICK_ROBOTS = ("ur10e",)
# By how much the lever a = J' n may change, as a share of its length, in the bands of the table.
_BANDS = (0.0, 0.01, 0.02, 0.05, 0.1, np.inf)
# Peak forces beside a rigid arm's, of an independent study: UR10e at 0.8 m, the rotors and gears above, two servos, two
# speeds, 75 and 10 N/mm, reaction after 20 and 60 ms. Its servos and deceleration are not known.
_STUDY_RATIOS = (1.1, 8.7)
_STUDY_DIFFERENCE = 0.007


@dataclass(frozen=True)
class Case:
    """N collisions of one robot; per joint (N, n), else (N,) or (N, 3)."""

    robot: Robot
    q: Array
    velocity: Array
    normal: Array
    mass: Array
    drives: Drives
    stiffness: Array
    body_mass: Array
    reference: Reference

    def chosen(self, rows: Array) -> Case:
        """Some of them."""
        drives = Drives(*(getattr(self.drives, field.name)[rows] for field in fields(Drives)))
        path = self.reference
        reference = Reference(path.q[:, rows], path.qd[:, rows], path.distance[:, rows])
        own = (self.q, self.velocity, self.normal, self.mass)
        q, velocity, normal, mass = (value[rows] for value in own)
        stiffness, body_mass = self.stiffness[rows], self.body_mass[rows]
        return Case(self.robot, q, velocity, normal, mass, drives, stiffness, body_mass, reference)


def compare(findings: Findings, *, quick: bool) -> None:
    """The published cases, then random ones."""
    _published(findings)
    _random(findings, robots=QUICK_ROBOTS if quick else robots(), each=12 if quick else 286, motors=not quick)


@dataclass(frozen=True)
class Linear:
    """What the linear equations give for N collisions.

    Attributes:
        peak_force: (N,) [N].
        lever_change: greatest of ``|J(p)' n - a| / |a|`` until the peak, over the poses p of the reference path and of
            the links (N,) [1].
        levers: a = J' n where they would be better taken from, (N, 2, n): in the pose of the links at the peak, and
            halfway between it and that of the reference.
    """

    peak_force: Array
    lever_change: Array
    levers: Array


def linear(case: Case, *, feeds_motors: bool = False, levers: Array | None = None) -> Linear:
    """The linear equations, with levers of the pose of contact or with those given: of the force, of the distance."""
    robot, path = case.robot, case.reference
    lever = np.einsum("nij,ni->nj", robot.jacobian(case.q)[:, :3], case.normal)
    rates, drives = line_rates(robot, case.q, case.normal), case.drives
    peaks, change = np.empty(len(lever)), np.empty(len(lever))
    better = np.empty((len(lever), 2, robot.dof))
    for i in range(len(lever)):
        arm = ElasticArm(
            mass_matrix=case.mass[i],
            rotor_inertia=drives.rotor_inertia[i],
            gear_stiffness=drives.gear_stiffness[i],
            gear_damping=drives.gear_damping[i],
            servo_stiffness=drives.servo_stiffness[i],
            servo_damping=drives.servo_damping[i],
            lever=lever[i] if levers is None else levers[i, 0],
            gap_lever=None if levers is None else levers[i, 1],
            rates=rates[i],
            feedforward=float(drives.feedforward[i]),
            feeds_motors=feeds_motors,
        )
        mass = case.body_mass[i]
        body = Body(stiffness=float(case.stiffness[i]), mass=None if np.isinf(mass) else float(mass))
        found = collide(arm, body, path.distance[:, i], KNOT, tiny=5e-5)
        peaks[i] = found.peak_force
        until = max(2, round(found.peak_time / KNOT) + 1)
        links = path.q[:until, i] + found.link[:: round(KNOT / 5e-5)][:until]
        places = np.concatenate([path.q[:until, i], links])
        turned = robot.jacobian(places)[:, :3].transpose(0, 2, 1) @ case.normal[i] - lever[i]
        change[i] = np.linalg.norm(turned, axis=1).max() / np.linalg.norm(lever[i])
        ends = np.array([links[-1], (links[-1] + path.q[until - 1, i]) / 2])
        better[i] = robot.jacobian(ends)[:, :3].transpose(0, 2, 1) @ case.normal[i]
    return Linear(peaks, change, better)


def nonlinear(case: Case, *, frozen: Sequence[str] = (), motor_feedforward: bool = False) -> Array:
    """Peak forces of the nonlinear arm (N,) [N]."""
    return simulate(
        case.robot,
        case.drives,
        case.reference,
        case.normal,
        case.stiffness,
        body_mass=case.body_mass,
        frozen=frozen,
        motor_feedforward=motor_feedforward,
    ).peak_force


def published_cases(shares: Sequence[float] = (1.0,)) -> tuple[Case, list[tuple[float, float, float, float]]]:
    """UR10e, 0.8 m from its base, 0.4 m high, moving down: sixteen cases for each share that is fed forward."""
    robot = Robot.load("ur10e")
    pose = np.radians([0.0, -75.73668556, 102.56257975, -116.81005954, -90.0, 0.0])
    servos = ((60.0, 10.0), (150.0, 25.0))
    named = [(w, v, K, t) for w, _ in servos for v in (0.16, 0.36) for K in (75e3, 10e3) for t in (0.02, 0.06)]
    named = named * len(shares)
    count = len(named)
    bandwidth, speed, stiffness, at = np.array(named).T
    gain = np.where(bandwidth == servos[0][0], servos[0][1], servos[1][1])
    q = np.tile(pose, (count, 1))
    velocity = speed[:, None] * np.array([0.0, 0.0, -1.0])
    feedforward = np.repeat(np.asarray(shares, dtype=float), count // len(shares))
    rotors, gears = np.tile(_ROTORS[6], (count, 1)), np.tile(_GEARS[6], (count, 1))
    clamped = np.full(count, np.inf)
    mass = mass_matrix(bare(robot), q)
    drives = _drives(mass, rotors, gears, bandwidth, gain, np.full(count, 0.05), feedforward)
    path = references(robot, q, velocity, at, np.zeros(count, dtype=bool), np.full(count, 4.5), 250)
    return Case(robot, q, velocity, velocity / speed[:, None], mass, drives, stiffness, clamped, path), named


def draw(robot: Robot, count: int, seed: int) -> Case:
    """Random poses, directions, speeds, gears, servos, bodies and reactions.

    Speeds to 0.5 m/s with no joint above its limit on the path, contact stiffness 5 to 150 N/mm, one body in four free
    with 1 to 60 kg, reaction after 5 to 80 ms with 2 to 20 rad/s2, stop or reverse.
    """
    rng, n = np.random.default_rng(seed), robot.dof

    def spread(low: float, high: float, *shape: int) -> Array:
        return np.exp(rng.uniform(np.log(low), np.log(high), shape))

    lower, upper = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    most = np.minimum(robot.velocity, np.pi)
    parts: list[tuple[Array, Array, Reference]] = []
    while sum(len(q) for q, _, _ in parts) < count:
        q = rng.uniform(lower, upper, (count, n))
        way = rng.normal(size=(count, 3))
        velocity = way / np.linalg.norm(way, axis=1, keepdims=True) * spread(0.02, 0.5, count)[:, None]
        at, back = rng.uniform(0.005, 0.08, count), rng.random(count) < 0.5
        path = references(robot, q, velocity, at, back, spread(2.0, 20.0, count), _KNOTS)
        good = (np.abs(path.qd) <= 1.001 * most).all(axis=(0, 2))
        parts.append((q[good], velocity[good], Reference(*(x[:, good] for x in (path.q, path.qd, path.distance)))))
    q, velocity = (np.concatenate([part[i] for part in parts])[:count] for i in (0, 1))
    paths = [part[2] for part in parts]
    path = Reference(
        *(np.concatenate([getattr(p, name) for p in paths], axis=1)[:, :count] for name in ("q", "qd", "distance"))
    )
    size = (robot.reach / _REACH) ** 2
    rotors = np.array(_ROTORS[n]) * size * spread(0.5, 2.0, count, n)
    gears = np.array(_GEARS[n]) * size * spread(0.5, 2.0, count, n)
    mass = mass_matrix(bare(robot), q)
    drives = _drives(
        mass,
        rotors,
        gears,
        spread(20.0, 300.0, count),
        spread(2.0, 40.0, count),
        spread(0.01, 0.2, count),
        rng.choice([0.0, 0.5, 1.0], count),
    )
    body_mass = np.where(rng.random(count) < 0.25, spread(1.0, 60.0, count), np.inf)
    normal = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    return Case(robot, q, velocity, normal, mass, drives, spread(5e3, 150e3, count), body_mass, path)


def _drives(
    mass: Array, rotors: Array, gears: Array, bandwidth: Array, gain: Array, damping_ratio: Array, feedforward: Array
) -> Drives:
    inertia = np.diagonal(mass, axis1=1, axis2=2)
    servo = bandwidth[:, None] * (rotors + inertia)
    damping = 2 * damping_ratio[:, None] * np.sqrt(gears / (1 / rotors + 1 / inertia))
    return Drives(rotors, gears, damping, gain[:, None] * servo, servo, feedforward)


def _published(findings: Findings) -> None:
    case, named = published_cases()
    straight = linear(case).peak_force
    full = nonlinear(case)
    rigid = case.stiffness * case.reference.distance.max(axis=0)
    ratio, difference = rigid / full, straight / full - 1
    findings.say(
        "UR10e, 0.8 m from its base and 0.4 m high, moving down, stopping with 4.5 rad/s2. An independent study of "
        f"sixteen such collisions found a rigid arm's force {_STUDY_RATIOS[0]:g} to {_STUDY_RATIOS[1]:g} times too "
        f"high and the linear equations within {100 * _STUDY_DIFFERENCE:.1f} %; its servos and deceleration are not "
        "known, so ours differ."
    )
    findings.table(
        "Peak force of an arm whose gears give",
        ["Servo [rad/s], speed, K, reaction", "Nonlinear [N]", "Linear [N]", "Difference [%]", "Rigid / nonlinear"],
        ["", ".1f", ".1f", "+.2f", ".2f"],
        [
            [f"{w:g}, {1e3 * v:g} mm/s, {K / 1e3:g} N/mm, {1e3 * t:g} ms", *map(float, row)]
            for (w, v, K, t), row in zip(named, np.column_stack([full, straight, 100 * difference, ratio]), strict=True)
        ],
    )
    findings.check(
        "The linear equations are within 1 % of the nonlinear arm in all sixteen cases",
        np.abs(difference).max() < 0.01,
        f"worst {100 * np.abs(difference).max():.2f} %",
    )
    findings.check(
        "A rigid arm's force is too high in all of them, up to more than five times",
        ratio.min() > 1.05 and ratio.max() > 5,
        f"{ratio.min():.2f} to {ratio.max():.2f} times",
    )


def _random(findings: Findings, *, robots: Sequence[str], each: int, motors: bool) -> None:
    names, errors, changes, again, held, through, told = [], [], [], [], [], [], []
    for seed, name in enumerate(robots):
        case = draw(Robot.load(name), each, seed)
        first = linear(case)
        straight, change = first.peak_force, first.lever_change
        full = nonlinear(case)
        missed = np.flatnonzero(np.abs(straight / full - 1) > 0.01)
        if len(missed):
            held.append(straight[missed] / nonlinear(case.chosen(missed), frozen=("jacobian",)) - 1)
        if motors:
            through.append(_fed_through_motors(case, straight))
        again.append(linear(case, levers=first.levers).peak_force / full - 1)
        names += [name] * each
        errors.append(straight / full - 1)
        changes.append(change)
        told.append(np.column_stack([full, np.linalg.norm(case.velocity, axis=1), case.stiffness / 1e3]))
        findings.progress(f"{name}: {100 * np.mean(np.abs(errors[-1]) < 0.01):.0f} % within 1 %")
    error, change, what = np.concatenate(errors), np.concatenate(changes), np.concatenate(told)
    size = np.abs(error)
    findings.say(
        f"{len(error)} random collisions of {len(robots)} robots: poses, directions, speeds to 0.5 m/s, 5 to 150 N/mm, "
        "gears, servos and reactions. What decides is how much the lever a = J' n, which the linear equations take "
        "from the pose of contact, changes until the peak, along the reference path and along that of the links."
    )
    rows: list[list[str | int | float]] = []
    for low, high in pairwise(_BANDS):
        chosen = (change >= low) & (change < high)
        if chosen.any():
            found = size[chosen]
            label = f"{100 * low:g} to {100 * high:g} %" if np.isfinite(high) else f"over {100 * low:g} %"
            rows.append(
                [label, int(chosen.sum()), 100 * float(np.mean(found < 0.01))]
                + [100 * float(np.quantile(found, q)) for q in (0.5, 0.9, 1.0)]
            )
    rows.append(
        [
            "all",
            len(size),
            100 * float(np.mean(size < 0.01)),
            *(100 * float(np.quantile(size, q)) for q in (0.5, 0.9, 1.0)),
        ]
    )
    findings.table(
        "Difference of the peak force by how much the lever changes",
        ["Lever changes by", "Collisions", "Within 1 % [%]", "Median [%]", "90 of 100 [%]", "Worst [%]"],
        ["", "d", ".1f", ".2f", ".2f", ".1f"],
        rows,
    )
    small = size[change < _BANDS[1]]
    findings.check(
        "Where the lever changes by less than 1 %, 99 of 100 peaks are within 1 %",
        len(small) > 0 and np.mean(small < 0.01) >= 0.99,
        f"{100 * np.mean(small < 0.01):.1f} % of {len(small)}, worst {100 * small.max():.2f} %",
    )
    better = np.abs(np.concatenate(again))
    findings.say(
        "Solved once more with the force's lever of where the links were at that peak, and the distance's of halfway "
        f"between them and the reference, the same equations are within 1 % in {100 * np.mean(better < 0.01):.1f} % of "
        f"all cases and within {100 * np.quantile(better, 0.99):.1f} % in 99 of 100; worst {100 * better.max():.1f} %."
    )
    findings.check(
        "Levers of where the peak was make more peaks right: 95 of 100 within 1 %",
        np.mean(better < 0.01) >= 0.95,
        f"{100 * np.mean(better < 0.01):.1f} % instead of {100 * np.mean(size < 0.01):.1f} %",
    )
    beyond = size > 0.01 + 3 * change
    findings.say(
        f"In {int(beyond.sum())} of {len(beyond)} cases the difference is more than 1 % and three times the lever's "
        "change until the peak of the linear equations: there the nonlinear arm has its peak at another time."
    )
    if held:
        rest = np.abs(np.concatenate(held))
        findings.check(
            "Nine in ten of the differences above 1 % vanish where the Jacobian of the nonlinear arm is held as well",
            np.mean(rest < 0.01) >= 0.9,
            f"{100 * np.mean(rest < 0.01):.1f} % of {len(rest)}; mass matrix and Coriolis forces still vary",
        )
    if through:
        _report_motors(findings, np.concatenate(through))
    worst = np.argsort(-size)[:10]
    findings.table(
        "The ten greatest differences",
        ["Robot", "Difference [%]", "Lever changes by [%]", "Peak force [N]", "Speed [m/s]", "K [N/mm]"],
        ["", "+.1f", ".1f", ".0f", ".2f", ".0f"],
        [[names[i], 100 * float(error[i]), 100 * float(change[i]), *map(float, what[i])] for i in worst],
    )


def _fed_through_motors(case: Case, straight: Array) -> Array:
    """Peak forces over those of an arm whose feedforward goes through its motors, of some cases with full feedforward.

    Columns: of the equations that give it to the links, and to the rotors.
    """
    fed = np.flatnonzero(case.drives.feedforward == 1)
    some = fed[: max(1, len(fed) // 3)]
    full = nonlinear(case.chosen(some), motor_feedforward=True)
    to_rotors = linear(case.chosen(some), feeds_motors=True).peak_force
    return np.column_stack([straight[some], to_rotors]) / full[:, None]


def _report_motors(findings: Findings, through: Array) -> None:
    close = [float(np.mean(np.abs(through[:, i] - 1) < 0.03)) for i in (0, 1)]
    findings.say(
        "A controller whose feedforward goes through the motors has to wind up its gears before the links slow down. "
        f"Beside such an arm the equations that give it to the links are within 3 % in {100 * close[0]:.0f} % of "
        f"{len(through)} cases with full feedforward, lowest {100 * (through[:, 0].min() - 1):+.0f} %; those that give "
        f"it to the rotors in {100 * close[1]:.0f} %, lowest {100 * (through[:, 1].min() - 1):+.0f} %."
    )
    findings.figures["feedforward_through_motors"] = {"to_links": close[0], "to_rotors": close[1]}
