"""The model of an arm's torques that fitted dynamics are: base parameters, friction and, of currents, gains."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.comparison import Comparison, joint_score, one_after_another
from bumpstop.identification.dynamics.coulomb_sign import coulomb_signs
from bumpstop.identification.dynamics.dynamics_system import FIT_PER_CUTOFF
from bumpstop.identification.dynamics.regressor import inertial_torque
from bumpstop.identification.dynamics.regressor_columns import BEND_AT_REST, column_names, torque_of
from bumpstop.identification.segments.torque_samples import TorqueSamples, as_list, recorded_motion
from bumpstop.model import unit_of
from bumpstop.model.dynamics import STANDARD_GRAVITY

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification.payload.payload import Payload
    from bumpstop.identification.segments.motion import UniformMotion
    from bumpstop.model import Robot
    from bumpstop.recording import Recording


@dataclass(frozen=True, kw_only=True, eq=False)
class DynamicsModel:
    """Joint torques of a motion, linear in inertial parameters, friction, rotors and offsets.

    Attributes:
        robot: the chain.
        columns: numbers of the columns of :func:`regressor_columns` that have a value; the others are 0.
        values: (p,) of these columns.
        predicting: (p,) values that predictions use in their place, 0 where the recordings cannot tell a parameter from
            zero; None: predictions use ``values``.
        predicted_by_all: joints (from 0) whose predictions use ``values`` all the same.
        sign_speed: (n + shared motors,) speed scale of Coulomb friction, of joints, then of shared motors; or (n,): a
            shared motor has the mean of its joints' [rad/s or m/s].
        presliding: (n + shared motors,) travel over which Coulomb friction turns round after a reversal, in place of
            the speed [rad or m]; NaN: it does so by the speed; None: all do.
        top_speed: (n + shared motors,) speed up to which friction bends [rad/s or m/s]; None: friction is a straight
            line of the speed.
        couplings: groups of joints that share a motor, as (joint, factor) pairs.
        loaded: joints (from 0) whose friction grows with the torque that loads the gear.
        cutoff_hz: of the motion's filter.
        gravity: acceleration of free fall in the base frame [m/s2].
        gains: (n,) torque per motor current [Nm/A or N/A], by which currents become torques; None: recordings must have
            torques.
        unscaled: joints (from 0) whose gain is not known: the scale of their torque means nothing.
        verdict: on the fit that gave it, in the words of :attr:`FitVerdict.status`; empty: it was not judged.
    """

    robot: Robot
    columns: tuple[int, ...]
    values: FloatArray
    predicting: FloatArray | None = None
    predicted_by_all: tuple[int, ...] = ()
    sign_speed: FloatArray
    presliding: FloatArray | None = None
    top_speed: FloatArray | None = None
    couplings: tuple[tuple[tuple[int, float], ...], ...] = ()
    loaded: tuple[int, ...] = ()
    cutoff_hz: float
    gravity: tuple[float, float, float] = STANDARD_GRAVITY
    gains: FloatArray | None = None
    unscaled: tuple[int, ...] = ()
    verdict: str = ""

    @property
    def column_names(self) -> list[str]:
        """Names of all columns, those without a value too."""
        return column_names(self.robot, self.couplings, self.top_speed, self.loaded)

    def weight(self, q: FloatArray) -> FloatArray:
        """Torques (N, n) that hold the links in poses (N, n) against gravity [Nm or N]."""
        inertial = self._every(self.values)[: 10 * self.robot.dof]
        still = np.zeros_like(q)
        return inertial_torque(self.robot, q, still, still, self.gravity, inertial)

    def friction_at_rest(self, held: FloatArray) -> FloatArray:
        """Friction (n,) of the joints towards speed 0, with that of shared motors [Nm or N].

        Coulomb friction, what the bend adds there, and its share of the torque on the gear: of the held one and of what
        it hides itself.

        Args:
            held: (n,) absolute torque that the joints hold [Nm or N].
        """
        n = self.robot.dof
        by_all = dict(zip(self.column_names, self._every(self.values), strict=True))
        essential = dict(zip(self.column_names, self._every(self._used), strict=True))
        found = np.zeros(n)
        for j in range(n):
            of = by_all if j in self.predicted_by_all else essential
            for owner, share in self._motors(j):
                found[j] += abs(share) * (
                    abs(of[f"coulomb_{owner}"]) + max(BEND_AT_REST * of.get(f"bend_{owner}", 0.0), 0.0)
                )
            load = max(of.get(f"load_{j + 1}", 0.0), 0.0)
            found[j] = (found[j] + load * held[j]) / (1 - load) if load < 1 else np.nan
        return found

    def _motors(self, j: int) -> list[tuple[str, float]]:
        """Names and shares of what turns joint ``j``: its own motor, then those that it shares."""
        shared = enumerate(self.couplings, start=1)
        return [(str(j + 1), 1.0), *((f"shared_{k}", share) for k, group in shared for i, share in group if i == j)]

    @property
    def _used(self) -> FloatArray:
        return self.values if self.predicting is None else self.predicting

    def torque(self, motion: UniformMotion, carried: FloatArray | None = None) -> FloatArray:
        """Joint torques (N, n) of a motion [Nm or N].

        Args:
            motion: of the robot.
            carried: (N, n) torque of a payload, which loads the gears but is not in the result; default: none.
        """
        loads, signs = self.loads(motion, carried), self.signs(motion)

        def of(values: FloatArray) -> FloatArray:
            every = self._every(values)
            return torque_of(self.robot, motion, every, signs, self.couplings, self.top_speed, loads)

        if self.predicting is None:
            return of(self.values)
        found = of(self.predicting)
        if self.predicted_by_all:
            own = list(self.predicted_by_all)
            found[:, own] = of(self.values)[:, own]
        return found

    def signs(self, motion: UniformMotion) -> FloatArray:
        """Signs (N, n + shared motors) of Coulomb friction, from -1 to 1; as for :meth:`torque`."""
        return coulomb_signs(motion, self.couplings, self.sign_speed, self.presliding)

    def loads(self, motion: UniformMotion, carried: FloatArray | None = None) -> dict[int, FloatArray]:
        """Torque (N,) that loads the gear, of joints whose friction grows with it [Nm or N]; as for :meth:`torque`."""
        if not self.loaded:
            return {}
        inertial = self._every(self.values)[: 10 * self.robot.dof]
        load = inertial_torque(self.robot, motion.q, motion.qd, motion.qdd, motion.gravity, inertial)
        load = load if carried is None else load + carried
        return {j: np.ascontiguousarray(load[:, j]) for j in self.loaded}

    def _every(self, values: FloatArray) -> FloatArray:
        """Values of all columns out of those of the base parameters."""
        every = np.zeros(len(self.column_names))
        every[list(self.columns)] = values
        return every

    def residual(self, recording: Recording) -> tuple[UniformMotion, FloatArray]:
        """Recorded minus predicted torque, unfiltered, of the same robot.

        Returns:
            The motion on its even grid, and the residual (N, n) there [Nm or N].

        Raises:
            InputError: no torque, other joints, or too few rows.
        """
        recording.check_robot(self.robot)
        motion, torque = recorded_motion(recording, self.cutoff_hz, self.gains)
        motion = replace(motion, gravity=self.gravity)
        return motion, torque - self.torque(motion)

    def rows(
        self,
        recordings: Recording | Sequence[Recording],
        payloads: Sequence[Payload | None] = (),
        *,
        limit: int | None = None,
        ends: bool = True,
    ) -> TorqueSamples:
        """Motion and torque of recordings as this fit filters them.

        Args:
            recordings: with torque, or with current where the fit has gains, of the same robot; one or more.
            payloads: what each of them carried beyond what the arm of the fit did; default: nothing.
            limit: rows that are enough, as for :meth:`TorqueSamples.of`; ``ENOUGH_TO_FIT``: those of the fit.
            ends: keep the rows where recordings begin and end, which a fit leaves away.
        """
        filters = (FIT_PER_CUTOFF * self.cutoff_hz, self.cutoff_hz)
        return TorqueSamples.of(
            as_list(recordings),
            self.robot,
            self.cutoff_hz,
            payloads,
            gains=self.gains,
            limit=limit,
            filters_hz=filters,
            ends=ends,
            gravity=self.gravity,
        )

    def compare(
        self,
        recordings: Recording | Sequence[Recording],
        *,
        filter_hz: float | None = None,
        payloads: Sequence[Payload | None] = (),
    ) -> Comparison:
        """Predicted torques beside recorded ones; of joints whose gain is not known, currents.

        Args:
            recordings: with torques, or with currents where gains are known, of the same robot; one or more.
            filter_hz: where they are compared filtered; default: the cut-off of the motion.
            payloads: what each of them carried beyond what the arm of the fit did; default: nothing.
        """
        return self.compare_rows(self.rows(recordings, payloads), filter_hz=filter_hz)

    def compare_rows(self, rows: TorqueSamples, *, filter_hz: float | None = None) -> Comparison:
        """The same of rows that :meth:`rows` has made."""
        size, units = self._scale()
        around = (self.torque(rows.reach.motion, rows.reach.carried) + rows.reach.carried) / size
        measured, predicted, cutoff = rows.torque / size, rows.reach.within(around), filter_hz or self.cutoff_hz
        smooth, smooth_predicted = rows.torque_below(cutoff) / size, rows.reach.filtered(around, cutoff)
        scores = tuple(
            joint_score(
                joint.name,
                (measured[:, j], predicted[:, j]),
                (smooth[:, j], smooth_predicted[:, j]),
                units[j],
                rests=rows.rests[:, j],
                free_gain=j in self.unscaled,
            )
            for j, joint in enumerate(self.robot.joints)
        )
        return Comparison(
            names=tuple(joint.name for joint in self.robot.joints),
            units=units,
            t=one_after_another(rows.motion.t, rows.segments),
            qd=rows.motion.qd,
            qdd=rows.motion.qdd,
            measured=measured,
            predicted=predicted,
            rate_hz=rows.motion.rate_hz,
            filter_hz=cutoff,
            given=scores,
        )

    def _scale(self) -> tuple[FloatArray, tuple[str, ...]]:
        """What torques (n,) are divided by to be told, and the units they are told in: currents of unknown gains."""
        units = [unit_of(joint) for joint in self.robot.joints]
        size = np.ones(self.robot.dof)
        for j in self.unscaled:
            assert self.gains is not None
            size[j], units[j] = self.gains[j], "A"
        return size, tuple(units)
