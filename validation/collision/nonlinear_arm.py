"""Arms whose gears give, moving with all their nonlinear terms: many collisions of one robot at once.

    M(q) q'' + C(q, q') q' = Kg (th - q) + Dg (th' - q') - J(q)' n F + ff u
    B th''                 = -Kg (th - q) - Dg (th' - q') - P (th - q_r) - D (th' - q_r') + ff B q_r''
    F                      = K max(0, n (x(q) - x(q_r(0))) - x_body)

with u = M(q_r) q_r'' + C(q_r, q_r') q_r' and gravity carried. Kinematics and dynamics are those of ``bumpstop.model``,
which the tests hold against Pinocchio and MuJoCo; nothing of the collision room is used. Classical Runge-Kutta steps of
50 us: the fastest swing, of a wrist on its gear, takes twenty of them or more.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop.model import Robot, coriolis_torque, mass_matrix, with_rotors

Array = npt.NDArray[np.float64]
# Between knots of the reference path [s].
KNOT = 1e-3


@dataclass(frozen=True)
class Drives:
    """Gears and servo of N arms; all (N, n) but ``feedforward`` (N,).

    Attributes:
        rotor_inertia: B [kg m2].
        gear_stiffness: Kg [Nm/rad].
        gear_damping: Dg [Nm s/rad].
        servo_stiffness: P [Nm/rad].
        servo_damping: D [Nm s/rad].
        feedforward: share of the torque of the reference path that the controller gives beforehand.
    """

    rotor_inertia: Array
    gear_stiffness: Array
    gear_damping: Array
    servo_stiffness: Array
    servo_damping: Array
    feedforward: Array


@dataclass(frozen=True)
class Reference:
    """Joint paths that N arms are told to follow, at knots (T, N, n), straight in their accelerations between.

    Attributes:
        q, qd: positions [rad] and rates [rad/s].
        distance: of the contact point along the normal since the start (T, N) [m].
    """

    q: Array
    qd: Array
    distance: Array


@dataclass(frozen=True)
class Collisions:
    """What N arms did.

    Attributes:
        peak_force: (N,) [N].
        peak_time: (N,) [s].
        force: at the knots (T, N) [N].
        deviation: greatest of a link from its path (N,) [rad].
    """

    peak_force: Array
    peak_time: Array
    force: Array
    deviation: Array


def bare(robot: Robot) -> Robot:
    """The same arm without rotors, which stand on the other side of the gears."""
    return with_rotors(robot, 0.0)


def line_rates(robot: Robot, q: Array, velocity: Array) -> Array:
    """Least-norm joint rates that move the tip at ``velocity`` (N, 3), its orientation free (N, n)."""
    rates: Array = np.einsum("nij,nj->ni", np.linalg.pinv(robot.jacobian(q)[:, :3]), velocity)
    return rates


def references(
    robot: Robot, q0: Array, velocity: Array, reaction_at: Array, reverse: Array, acceleration: Array, knots: int
) -> Reference:
    """A straight line, and from ``reaction_at`` on a stop or a way back with no joint above ``acceleration``.

    Args:
        robot: the arm.
        q0: where contact begins (N, n) [rad].
        velocity: of the tip (N, 3) [m/s].
        reaction_at: (N,) [s], rounded to knots; infinite: none.
        reverse: back along the line (N,), else stop.
        acceleration: limit of every joint (N,) [rad/s2].
        knots: how many.
    """
    q, qd = q0.copy(), line_rates(robot, q0, velocity)
    normal = velocity / np.linalg.norm(velocity, axis=1, keepdims=True)
    begin = robot.pose(q0)[:, :3, 3]
    paths, rates, distance = [], [], []
    parts = 4
    for k in range(knots):
        paths.append(q)
        rates.append(qd)
        distance.append(np.einsum("ni,ni->n", robot.pose(q)[:, :3, 3] - begin, normal))
        reacting = KNOT * k >= reaction_at - KNOT / 2
        for _ in range(parts):
            h = KNOT / parts
            on = line_rates(robot, q + h / 2 * qd, velocity)
            wanted = np.where(reacting[:, None], np.where(reverse[:, None], -on, 0.0), on)
            change = wanted - qd
            most = np.abs(change).max(axis=1) / (acceleration * h)
            change = np.where(reacting[:, None], change / np.maximum(1.0, most)[:, None], change)
            q, qd = q + h * (qd + change / 2), qd + change
    return Reference(np.array(paths), np.array(rates), np.array(distance))


def simulate(
    robot: Robot,
    drives: Drives,
    reference: Reference,
    normal: Array,
    stiffness: Array,
    *,
    body_mass: Array | None = None,
    steps_per_knot: int = 20,
    frozen: Collection[str] = (),
    motor_feedforward: bool = False,
) -> Collisions:
    """Follow the references into bodies that begin where the arms are at the start.

    Args:
        robot: with inertia.
        drives: of each arm.
        reference: their paths.
        normal: (N, 3), of length 1.
        stiffness: of the bodies (N,) [N/m].
        body_mass: of the bodies (N,) [kg], infinite where clamped; None: all are.
        steps_per_knot: how fine.
        frozen: of ``"mass"`` (M), ``"jacobian"`` (J in the contact force and torque) and ``"coriolis"`` (C and the
            reference's torque beyond M q_r'') those that stay as in the first pose; to find out what a difference is
            due to.
        motor_feedforward: the motors give the torque of the reference path, which reaches the links through the
            gears; else the links get it at once, as in the linear equations.
    """
    arm = bare(robot)
    count = len(stiffness)
    q, qd = reference.q[0].copy(), reference.qd[0].copy()
    th, thd = q.copy(), qd.copy()
    away = np.zeros((2, count))
    mass = np.full(count, np.inf) if body_mass is None else body_mass
    M0, J0 = mass_matrix(arm, q), arm.jacobian(q)[:, :3]
    x0 = arm.pose(q)[:, :3, 3]
    lever0 = np.einsum("nij,ni->nj", J0, normal)
    B, Kg, Dg = drives.rotor_inertia, drives.gear_stiffness, drives.gear_damping
    P, D, ff = drives.servo_stiffness, drives.servo_damping, drives.feedforward[:, None]
    still = {"mass", "jacobian", "coriolis"} & set(frozen)

    def told(k: int) -> tuple[Array, Array]:
        """Acceleration and torque of the path between knots k and k + 1, halfway."""
        between, rate = (reference.q[k] + reference.q[k + 1]) / 2, (reference.qd[k] + reference.qd[k + 1]) / 2
        accelerating = (reference.qd[k + 1] - reference.qd[k]) / KNOT
        M = M0 if "mass" in still else mass_matrix(arm, between)
        torque = np.einsum("nij,nj->ni", M, accelerating)
        return accelerating, torque if "coriolis" in still else torque + coriolis_torque(arm, between, rate)

    def flow(y: list[Array], share: float, k: int, accelerating: Array, torque: Array) -> tuple[list[Array], Array]:
        q, th, qd, thd, away = y
        late = share * KNOT
        path = reference.q[k] + late * reference.qd[k] + late**2 / 2 * accelerating
        rate = reference.qd[k] + late * accelerating
        gear = Kg * (th - q) + Dg * (thd - qd)
        if "jacobian" in still:
            lever = lever0
            s = (1 - share) * reference.distance[k] + share * reference.distance[k + 1]
            deep = s + np.einsum("ni,ni->n", lever, q - path)
        else:
            lever = np.einsum("nij,ni->nj", arm.jacobian(q)[:, :3], normal)
            deep = np.einsum("ni,ni->n", arm.pose(q)[:, :3, 3] - x0, normal)
        force = stiffness * np.maximum(0.0, deep - away[0])
        push = gear - lever * force[:, None]
        motor = ff * (B * accelerating)
        if motor_feedforward:
            motor = motor + ff * torque
        else:
            push = push + ff * torque
        if "coriolis" not in still:
            push = push - coriolis_torque(arm, q, qd)
        M = M0 if "mass" in still else mass_matrix(arm, q)
        link = np.linalg.solve(M, push[..., None])[..., 0]
        rotor = (-gear - P * (th - path) - D * (thd - rate) + motor) / B
        return [qd, thd, link, rotor, np.stack([away[1], force / mass])], force

    h = KNOT / steps_per_knot
    knots = len(reference.q)
    forces = np.zeros((knots, count))
    peak, when, deviation = np.zeros(count), np.zeros(count), np.zeros(count)
    y = [q, th, qd, thd, away]
    for k in range(knots - 1):
        parts = told(k)
        for i in range(steps_per_knot):
            a, b, c = (i / steps_per_knot, (i + 0.5) / steps_per_knot, (i + 1) / steps_per_knot)
            k1, force = flow(y, a, k, *parts)
            if i == 0:
                forces[k] = force
            higher = force > peak
            peak, when = np.where(higher, force, peak), np.where(higher, (k + a) * KNOT, when)
            k2, _ = flow([u + h / 2 * v for u, v in zip(y, k1, strict=True)], b, k, *parts)
            k3, _ = flow([u + h / 2 * v for u, v in zip(y, k2, strict=True)], b, k, *parts)
            k4, _ = flow([u + h * v for u, v in zip(y, k3, strict=True)], c, k, *parts)
            y = [u + h / 6 * (a1 + 2 * a2 + 2 * a3 + a4) for u, a1, a2, a3, a4 in zip(y, k1, k2, k3, k4, strict=True)]
        deviation = np.maximum(deviation, np.abs(y[0] - reference.q[k + 1]).max(axis=1))
    _, forces[-1] = flow(y, 1.0, knots - 2, *parts)
    return Collisions(peak, when, forces, deviation)
