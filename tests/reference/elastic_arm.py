"""One collision of an arm whose gears give, step by step: what the library's contact dynamics is tested against.

Links and rotors are joined by springs, and a position servo holds the rotors on the reference path. Deviations from
that path are small, so everything is linear about the pose of contact:

    M dq''  = Kg (dth - dq) + Dg (dth' - dq') - a F - (1 - ff) M q_r''
    B dth'' = -Kg (dth - dq) - Dg (dth' - dq') - P dth - D dth' - (1 - ff) B q_r''
    F       = K d + c d', with the compression d = s(t) - o + a' dq - x, where d > 0 and F > 0; else 0

x is how far the face of the body has moved. A clamped body's face does not; a free body's has x'' m = F; a gauge's
face, behind its pad K, has a mass and a spring to ground, and what is measured is the force of that spring.

That is a controller whose feedforward reaches the links at once. One that feeds its motors, whose torque has to wind up
the gears first, is the second kind: the links then lack all of M q_r'', and the rotors get ff M q_r'' besides.

The classical Runge-Kutta method with steps of some 20 us; a step in which contact begins or ends is cut there by
bisection. Nothing is known here of modes or of matrix exponentials.

Units are SI; for a prismatic joint read m for rad and N for Nm.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class ElasticArm:
    """Arm, gears and servo about the pose of contact.

    Attributes:
        mass_matrix: M of the links, without rotors (n, n).
        rotor_inertia: B, reflected to the joints (n,).
        gear_stiffness, gear_damping: Kg, Dg (n,).
        servo_stiffness, servo_damping: P, D (n,).
        feedforward: ff, share of the reference acceleration that the controller feeds forward, 0 to 1; one or (n,).
        feeds_motors: it reaches the links through the gears only.
        gap_lever: what the compression follows the links with, a' in d (n,); None: ``lever``. The two differ where the
            force acts in the pose of the links and the distance is counted from the path far ahead of them.
        rates: joint rates per unit of speed along the normal (n,); needed unless all is fed forward to the links.
        lever: a = J' n (n,).
    """

    mass_matrix: npt.ArrayLike
    rotor_inertia: npt.ArrayLike
    gear_stiffness: npt.ArrayLike
    gear_damping: npt.ArrayLike
    servo_stiffness: npt.ArrayLike
    servo_damping: npt.ArrayLike
    lever: npt.ArrayLike
    rates: npt.ArrayLike | None = None
    feedforward: npt.ArrayLike = 1.0
    feeds_motors: bool = False
    gap_lever: npt.ArrayLike | None = None

    @classmethod
    def of_servo(
        cls,
        mass_matrix: npt.ArrayLike,
        rotor_inertia: npt.ArrayLike,
        gear_stiffness: npt.ArrayLike,
        lever: npt.ArrayLike,
        *,
        gear_damping_ratio: float | npt.ArrayLike = 0.0,
        velocity_bandwidth: float | npt.ArrayLike = 0.0,
        position_gain: float | npt.ArrayLike = 0.0,
        **more: Any,
    ) -> ElasticArm:
        """From a servo's bandwidth w_v [rad/s] and gain w_p [1/s], and damping as a share of critical.

        D = w_v (B + diag M), P = w_p D, Dg = 2 zeta sqrt(Kg / (1 / B + 1 / M_jj)).
        """
        inertia, rotor = np.diag(np.asarray(mass_matrix, dtype=float)), np.asarray(rotor_inertia, dtype=float)
        gear = np.asarray(gear_stiffness, dtype=float)
        servo = np.asarray(velocity_bandwidth) * (rotor + inertia)
        return cls(
            mass_matrix=mass_matrix,
            rotor_inertia=rotor,
            gear_stiffness=gear,
            gear_damping=2 * np.asarray(gear_damping_ratio) * np.sqrt(gear / (1 / rotor + 1 / inertia)),
            servo_stiffness=np.asarray(position_gain) * servo,
            servo_damping=servo,
            lever=lever,
            **more,
        )


@dataclass(frozen=True, kw_only=True)
class Body:
    """What is hit.

    Attributes:
        stiffness: K: of the body, or of a gauge's pad.
        damping: c, in parallel with it.
        mass: of a free body's, or a gauge's, face; None: clamped.
        spring: of a gauge, from its face to ground; None: nothing holds the face.
        spring_damping: in parallel with it.
    """

    stiffness: float
    damping: float = 0.0
    mass: float | None = None
    spring: float | None = None
    spring_damping: float = 0.0


@dataclass(frozen=True)
class ElasticCollision:
    """One collision over time; rows are the ends of the tiny steps, the first row is the start.

    Attributes:
        time: (T,).
        force: between arm and body (T,).
        measured_force: what a gauge shows, else the force (T,).
        residual: gear torque minus that which the links need at the rotors' acceleration (T, n); outside a reaction as
            if the path's speed changed evenly within steps, not in jumps at their begins.
        link, link_rate, rotor, rotor_rate: deviations from the reference path (T, n).
        face, face_rate: of the body (T,).
        compression: of the body, or of a gauge's pad; 0 without contact (T,).
        contacts: begin and end of each contact; the end of one that lasts is nan.
        stored: energy of motion, gears, servo, body and gauge (T,).
        lost: in dampers, since the start (T,).
        work: done by the moving path on the arm, since the start (T,).
    """

    time: Array
    force: Array
    measured_force: Array
    residual: Array
    link: Array
    link_rate: Array
    rotor: Array
    rotor_rate: Array
    face: Array
    face_rate: Array
    compression: Array
    contacts: tuple[tuple[float, float], ...]
    stored: Array
    lost: Array
    work: Array

    @property
    def peak_force(self) -> float:
        return float(self.force.max())

    @property
    def peak_time(self) -> float:
        return float(self.time[np.argmax(self.force)])

    @property
    def peak_measured(self) -> float:
        return float(self.measured_force.max())

    @property
    def contact_duration(self) -> float:
        """Of the first contact; nan: none, or it lasts."""
        return self.contacts[0][1] - self.contacts[0][0] if self.contacts else math.nan


def collide(
    arm: ElasticArm, body: Body, path: npt.ArrayLike, step: float, *, offset: float = 0.0, tiny: float = 2e-5
) -> ElasticCollision:
    """One collision.

    Args:
        arm: about the pose of contact.
        body: what is hit.
        path: s along the normal at the ends of simulation steps, the first at time 0; straight between. The arm is on
            it and moves with it at time 0.
        step: between samples of the path.
        offset: o: where the body begins.
        tiny: the longest step of the integration.
    """
    steps = _Steps(arm, body)
    return steps.run(np.asarray(path, dtype=float), step, offset, max(1, math.ceil(step / tiny - 1e-9)))


def first_order(time: Array, values: Array, rate: float) -> Array:
    """A momentum observer's residual: y' = rate (values - y), from y = 0, by the trapezium rule (T, ...)."""
    out = np.zeros_like(values)
    for k in range(1, len(time)):
        h = rate * (time[k] - time[k - 1])
        out[k] = ((1 - h / 2) * out[k - 1] + h / 2 * (values[k] + values[k - 1])) / (1 + h / 2)
    return out


class _Steps:
    """State: dq, dth, dq', dth', x, x', s - o, s'. The last does not change within a simulation step."""

    def __init__(self, arm: ElasticArm, body: Body) -> None:
        M = np.asarray(arm.mass_matrix, dtype=float)
        n = self.n = len(M)

        def each(value: npt.ArrayLike) -> Array:
            return np.broadcast_to(np.asarray(value, dtype=float), (n,))

        self.M, self.B, self.a = M, each(arm.rotor_inertia), each(arm.lever)
        self.Kg, self.Dg = each(arm.gear_stiffness), each(arm.gear_damping)
        self.P, self.D = each(arm.servo_stiffness), each(arm.servo_damping)
        self.body, self.reacts = body, arm.feeds_motors
        inverse = np.linalg.inv(M)
        # What a unit change of the path's speed adds to the rates of the deviations.
        self.link_jump, self.rotor_jump, self.unlike = np.zeros((3, n))
        if arm.feeds_motors or np.any(each(arm.feedforward) < 1):
            lacking, rates = 1 - each(arm.feedforward), each(arm.rates)
            self.link_jump, self.rotor_jump = -inverse @ (lacking * (M @ rates)), -lacking * rates
            # What joints that are fed other shares than their neighbours see of the acceleration.
            if not arm.feeds_motors:
                self.unlike = M @ (lacking * rates) - lacking * (M @ rates)
            if arm.feeds_motors:
                self.link_jump = -rates
                self.rotor_jump = self.rotor_jump + (1 - lacking) * (M @ rates) / self.B
        q, th, qd, thd = (slice(i * n, (i + 1) * n) for i in range(4))
        x, xd, s, sd = range(4 * n, 4 * n + 4)
        self.size = 4 * n + 4

        self.compression, self.compressing, ground = np.zeros((3, self.size))
        along = self.a if arm.gap_lever is None else each(arm.gap_lever)
        self.compression[s], self.compression[q], self.compression[x] = 1.0, along, -1.0
        self.compressing[sd], self.compressing[qd], self.compressing[xd] = 1.0, along, -1.0
        ground[x], ground[xd] = body.spring or 0.0, body.spring_damping
        self.law = body.stiffness * self.compression + body.damping * self.compressing
        gear = np.zeros((n, self.size))
        gear[:, q], gear[:, th] = -np.diag(self.Kg), np.diag(self.Kg)
        gear[:, qd], gear[:, thd] = -np.diag(self.Dg), np.diag(self.Dg)
        servo = np.zeros((n, self.size))
        servo[:, th], servo[:, thd] = np.diag(self.P), np.diag(self.D)
        self.gear = gear
        self.rotors = (-gear - servo) / self.B[:, None]
        self.flow = []
        for touches in (False, True):
            force = self.law if touches else np.zeros(self.size)
            A = np.zeros((self.size, self.size))
            A[q, qd] = A[th, thd] = np.eye(n)
            A[qd] = inverse @ (gear - np.outer(self.a, force))
            A[thd] = self.rotors
            A[s, sd] = 1.0
            if body.mass is not None:
                A[x, xd] = 1.0
                A[xd] = (force - ground) / body.mass
            self.flow.append(A)

    def touches(self, y: Array) -> bool:
        return bool(self.compression @ y > 0 and self.law @ y > 0)

    def advance(self, y: Array, h: float, touching: bool) -> Array:
        """One step of the classical Runge-Kutta method."""
        A = self.flow[touching]
        k1 = A @ y
        k2 = A @ (y + h / 2 * k1)
        k3 = A @ (y + h / 2 * k2)
        k4 = A @ (y + h * k3)
        return np.asarray(y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4))

    def run(self, path: Array, step: float, offset: float, parts: int) -> ElasticCollision:
        n, h = self.n, step / parts
        # The step's four stages, taken for every unit vector at once: the same sums, done beforehand.
        whole = [
            np.column_stack([self.advance(unit, h, touching) for unit in np.eye(self.size)])
            for touching in (False, True)
        ]
        speeds = np.diff(path) / step
        count = len(speeds) * parts + 1
        rows = np.empty((count, self.size))
        y = np.zeros(self.size)
        y[-2], y[-1] = path[0] - offset, speeds[0]
        touching = self.touches(y)
        in_contact, ahead, change = np.zeros(count, dtype=bool), np.zeros(count), np.zeros(count)
        rows[0], in_contact[0] = y, touching
        contacts: list[tuple[float, float]] = [(0.0, math.nan)] if touching else []
        at = 0
        for i, speed in enumerate(speeds):
            y[2 * n : 3 * n] += self.link_jump * (speed - y[-1])
            y[3 * n : 4 * n] += self.rotor_jump * (speed - y[-1])
            # How far the path's speed is ahead of one that changes evenly.
            own = slice(at + 1, at + 1 + parts)
            change[own] = (speed - y[-1]) / step
            ahead[own] = (speed - y[-1]) * (0.5 - np.arange(1, parts + 1) / parts)
            y[-2], y[-1] = path[i] - offset, speed
            for _ in range(parts):
                after = whole[touching] @ y
                if self.touches(after) != touching:
                    after, touching = self._cut(y, h, touching, at * h, contacts)
                at += 1
                y = rows[at] = after
                in_contact[at] = touching
        even = rows.copy()
        residual = np.outer(change, self.unlike)
        if not self.reacts:
            even[:, 2 * n : 3 * n] -= np.outer(ahead, self.link_jump)
            even[:, 3 * n : 4 * n] -= np.outer(ahead, self.rotor_jump)
        residual += even @ self.gear.T - (even @ self.rotors.T) @ self.M
        return self._told(rows, residual, in_contact, h, tuple(contacts))

    def _cut(
        self, y: Array, h: float, touching: bool, begin: float, contacts: list[tuple[float, float]]
    ) -> tuple[Array, bool]:
        """A step in which contact begins or ends, perhaps more than once."""
        done = 0.0
        for _ in range(100):
            rest = h - done
            after = self.advance(y, rest, touching)
            if self.touches(after) == touching:
                return after, touching
            low, high = 0.0, rest
            for _ in range(60):
                middle = (low + high) / 2
                if self.touches(self.advance(y, middle, touching)) == touching:
                    low = middle
                else:
                    high = middle
            y, done, touching = self.advance(y, high, touching), done + high, not touching
            if touching:
                contacts.append((begin + done, math.nan))
            else:
                contacts[-1] = (contacts[-1][0], begin + done)
        raise ArithmeticError("contact begins and ends without end within one step")

    def _told(
        self,
        y: Array,
        residual: Array,
        touching: npt.NDArray[np.bool_],
        h: float,
        contacts: tuple[tuple[float, float], ...],
    ) -> ElasticCollision:
        n, body = self.n, self.body
        q, th, qd, thd = (y[:, i * n : (i + 1) * n] for i in range(4))
        x, xd, speed = y[:, 4 * n], y[:, 4 * n + 1], y[:, 4 * n + 3]
        force = np.where(touching, y @ self.law, 0.0)
        compression = np.where(touching, y @ self.compression, 0.0)
        moving = 0.5 * (np.einsum("ti,ij,tj->t", qd, self.M, qd) + thd**2 @ self.B)
        springs = 0.5 * ((th - q) ** 2 @ self.Kg + th**2 @ self.P + body.stiffness * compression**2)
        outside = 0.5 * ((body.mass or 0.0) * xd**2 + (body.spring or 0.0) * x**2)
        loss = (thd - qd) ** 2 @ self.Dg + thd**2 @ self.D + body.spring_damping * xd**2
        loss = loss + np.where(touching, body.damping * (y @ self.compressing) ** 2, 0.0)
        return ElasticCollision(
            time=h * np.arange(len(y)),
            force=force,
            measured_force=force if body.spring is None else body.spring * x,
            residual=residual,
            link=q,
            link_rate=qd,
            rotor=th,
            rotor_rate=thd,
            face=x,
            face_rate=xd,
            compression=compression,
            contacts=contacts,
            stored=moving + springs + outside,
            lost=_integral(loss, h),
            work=_integral(force * speed, h),
        )


def _integral(values: Array, h: float) -> Array:
    return np.concatenate([[0.0], np.cumsum(values[1:] + values[:-1]) * h / 2])
