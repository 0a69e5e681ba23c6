"""Greatest force of an undetected arm: what its drives can press with."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.collision.curve import AT_REST, StoppingCurve, states_at_reactions, stopping_curve
from bumpstop.model import gravity_torque, mass_matrix
from bumpstop.model.drive_train.assumed import torque_limit_doubt
from bumpstop.model.dynamics import STANDARD_GRAVITY

if TYPE_CHECKING:
    from bumpstop.collision.problem import CollisionProblem
    from bumpstop.collision.scenario.scenario import Scenario

# Standard deviations of a half-normal gap within which a body may be: the rest is rarer than 1e-8.
_REACH_SD = 6.0


@dataclass(frozen=True, kw_only=True)
class PressingLimit:
    """The most that the drives of an arm press a clamped body with, undetected.

    Attributes:
        static_force: in the end, when a joint's motor gives all it can [N].
        peak_force: at most, the blow on top of it [N].
        joint: that gives way first, from 1.
    """

    static_force: float
    peak_force: float
    joint: int

    def to_json(self) -> dict[str, Any]:
        """The object that ``bumpstop evaluate --json`` prints."""
        return {"static_force_N": self.static_force, "peak_force_N": self.peak_force, "joint": self.joint}

    def words(self, scenario: Scenario) -> str:
        """Both forces, and what the first rests on: a part of a sentence."""
        upright = tuple(scenario.gravity_m_s2) == STANDARD_GRAVITY
        held = "with the base upright" if upright else "with gravity_m_s2 as given"
        return (
            f"{self.static_force:.4g} N at the torque limit of joint {self.joint} {held}, {self.peak_force:.4g} N with "
            "the blow"
        )

    @classmethod
    def greatest(cls, static: FloatArray, joint: npt.NDArray[np.int64], peak: FloatArray) -> PressingLimit | None:
        """Of what :meth:`Drives.press` tells of poses, one or more; None where a pose has no bound."""
        if not np.isfinite(static).all():
            return None
        worst = int(peak.argmax())
        return cls(static_force=float(static.max()), peak_force=float(peak[worst]), joint=int(joint[worst]) + 1)


def pressing_limit(problem: CollisionProblem, curve: StoppingCurve) -> PressingLimit | None:
    """The pressing limit of a line, the greatest of the poses of contact; None where there is none.

    A motor holds the contact force F and its share of the arm's weight g while |a| F <= torque limit + |g|, a = J^T n,
    so the weakest joint bounds the static force. Limits below |g| are none of that arm: they bound nothing. The sign of
    g is taken on the safe side. An arm of kinetic energy E
    that such a force drives on deforms a body of stiffness K until K x^2 / 2 = E + F x: F + sqrt(F^2 + 2 E K). A gauge
    of spring K2 takes in F^2 / (2 K2) besides, and may give it back: F + sqrt(F^2 (1 + K / K2) + 2 E K). A damper
    c adds no more than c v, with v the speed of the contact point: a point that speeds up is pressed on by F alone.
    A body gets away or holds; an arm that stands at the end of its line presses with what the line gives.

    Raises:
        InputError: the inertia of a link is not known.
    """
    if not knows_torque_limits(problem) or problem.trajectory is not None or not curve.ticks:
        return None
    largest = problem.offset_size * (_REACH_SD if problem.scenario.contact.offset_law == "half_normal" else 1.0)
    # Undetected there is no reaction, and no latency before one: the arm is met as it moves at the ticks themselves.
    own = stopping_curve(replace(problem, latency_steps=0)) if problem.latency_steps else curve
    q, qd = states_at_reactions(problem, own)
    touches = max(1, int((own.tick_distance <= largest).sum()))
    drives = Drives.at(problem, q[:touches], qd[:touches])
    static, joint, peak = drives.press(own.torque_per_newton[:touches])
    return PressingLimit.greatest(static, joint, peak)


@dataclass(frozen=True)
class Drives:
    """What the drives give at some poses.

    Attributes:
        holding: torque that each holds against a contact force (N, dof) [Nm]; infinite: unknown.
        doubled_energy: twice the kinetic energy of links and rotors (N,) [J].
        rates: of the joints (N, dof) [rad/s or m/s].
        stiffness, damping: of the body [N/m, Ns/m].
        given_back: 1, or with a gauge of spring K2 that carries a mass 1 + K / K2 [1].
    """

    holding: FloatArray
    doubled_energy: FloatArray
    rates: FloatArray
    stiffness: float
    damping: float
    given_back: float

    @classmethod
    def at(cls, problem: CollisionProblem, q: FloatArray, qd: FloatArray) -> Drives:
        """At joint positions and rates (N, dof).

        Raises:
            InputError: the inertia of a link is not known.
        """
        robot, train, contact = problem.robot, problem.drive_train, problem.scenario.contact
        # Without a mass the spring of a gauge is part of the stiffness.
        spring = contact.gauge_spring_N_m if contact.gauge_mass_kg is not None else None
        inertia = mass_matrix(robot, q) + np.diag(train.rotor_inertia)
        weight = _weight(problem, q)
        # Motors that cannot hold the arm are not those that do: nobody knows what the others give.
        known = np.all(train.torque_limit >= weight, axis=1, keepdims=True)
        return cls(
            holding=np.where(known, train.torque_limit + weight, math.inf),
            doubled_energy=np.einsum("ki,kij,kj->k", qd, inertia, qd),
            rates=qd,
            stiffness=problem.stiffness,
            damping=contact.damping_Ns_m,
            given_back=1 if spring is None else 1 + problem.stiffness / spring,
        )

    def press(
        self, torque_per_newton: FloatArray, rows: slice | npt.NDArray[Any] = slice(None)
    ) -> tuple[FloatArray, npt.NDArray[np.int64], FloatArray]:
        """Static force [N], the number from 0 of the joint that bounds it, and the greatest force [N], by pose.

        Args:
            torque_per_newton: a = J^T n (rows, dof) [Nm/N].
            rows: the poses that these are of.
        """
        with np.errstate(divide="ignore"):
            holds = self.holding[rows] / np.abs(torque_per_newton)
        static = holds.min(axis=1)
        approach = np.maximum(np.einsum("kj,kj->k", torque_per_newton, self.rates[rows]), 0.0)
        energy = static**2 * self.given_back + self.doubled_energy[rows] * self.stiffness
        peak = static + np.sqrt(energy) + self.damping * approach
        return static, holds.argmin(axis=1), peak


def knows_torque_limits(problem: CollisionProblem) -> bool:
    """Whether drives bound what presses a body: the arm is elastic, the body holds, and a joint's limit is known.

    Limits that no arm of such a weight has are not known: :func:`torque_limit_doubt`.
    """
    return _has_torque_limits(problem) and not torque_limit_doubt(problem.robot, problem.drive_train.torque_limit)


def doubted_limits(problem: CollisionProblem) -> str:
    """Why torque limits that are given bound nothing, in a sentence; empty where they do, or where there are none.

    Raises:
        InputError: the inertia of a link is not known.
    """
    if not (problem.elastic and not problem.gets_away):
        return ""
    limits, robot = problem.drive_train.torque_limit, problem.robot
    given = next((e.values for e in robot.drive_train_entries if e.quantity == "torque_limit"), limits)
    doubt = torque_limit_doubt(robot, limits if np.isfinite(limits).any() else given)
    if doubt or not _has_torque_limits(problem):
        return doubt
    poses = problem.q[None] if problem.trajectory is None else problem.trajectory.position
    weight = _weight(problem, poses).max(axis=0)
    joint = int(np.argmin(limits - weight))
    if limits[joint] >= weight[joint]:
        return ""
    unit = "Nm" if robot.joints[joint].kind == "revolute" else "N"
    return (
        f"The torque limits of {robot.name} cannot hold the arm where it is: joint {joint + 1} has "
        f"{limits[joint]:.4g} {unit}, and its weight takes {weight[joint]:.4g} {unit}. They count as unknown, and "
        "collisions that are never detected as unbounded."
    )


def _has_torque_limits(problem: CollisionProblem) -> bool:
    return problem.elastic and not problem.gets_away and bool(np.isfinite(problem.drive_train.torque_limit).any())


def _weight(problem: CollisionProblem, q: FloatArray) -> FloatArray:
    """Torque that holds the arm's own weight at joint positions (N, dof) [Nm or N]."""
    return np.abs(gravity_torque(problem.robot, q, gravity=problem.scenario.gravity_m_s2))


def presses_on(problem: CollisionProblem, curve: StoppingCurve) -> bool:
    """Whether a body that is never detected is pressed on: it has not got away, nor has the motion ended by itself."""
    return not problem.gets_away and curve.end not in AT_REST


def undetected_force(problem: CollisionProblem, curve: StoppingCurve) -> float | None:
    """What a body that is never detected is pressed on with [N], infinite where nobody knows; None where it is not."""
    if not presses_on(problem, curve):
        return None
    limit = pressing_limit(problem, curve)
    return math.inf if limit is None else limit.peak_force
