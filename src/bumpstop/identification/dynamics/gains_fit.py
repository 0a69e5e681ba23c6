"""Base inertial parameters, drive gains and friction together, from motor currents alone.

The current of a joint is its torque over its gain. Alone it says the joint's parameters up to that gain. Joints share
the parameters of the links they both move, and so the ratios of their gains show; one factor for all of them shows only
beside something known: a load that some recordings carry and others do not, or the gain of one joint.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.dynamics.dynamics_fit import DynamicsFit
from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
from bumpstop.identification.dynamics.dynamics_model_selection import ENOUGH_TO_CHOOSE, best_friction, choose_cutoff
from bumpstop.identification.dynamics.dynamics_system import FIT_PER_CUTOFF
from bumpstop.identification.segments.seen_motion import SeenMotion
from bumpstop.identification.segments.torque_samples import TorqueSamples, as_list, joints_at_rest
from bumpstop.identification.statistics.clusters import clustered_covariance
from bumpstop.identification.statistics.independent_columns import condition_of, independent, label_of, triangle_of
from bumpstop.identification.statistics.robust_fit import visible_share
from bumpstop.model.dynamics import STANDARD_GRAVITY

if TYPE_CHECKING:
    from bumpstop.identification.dynamics.dynamics_system import System
    from bumpstop.identification.payload.payload import Payload
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# A gain is not seen when all the rest makes up its column to this share, or when its standard error is above a quarter
# of it.
_DEPENDENT, _KNOWN_TO = 1e-3, 0.25
# Rows behind the filter that are enough, as every step of the search goes through all of them; of more, blocks.
_ENOUGH = 10_000
# Of the joints' weights: so many from every start, and so many at most from the best of them until they settle.
_ROUNDS, _MAX_ROUNDS, _SETTLED = 3, 20, 1e-6
# Gains by linear least squares come out too small, as the current is noisy; the search also starts from multiples.
_MULTIPLES = (1.0, 2.0, 4.0)
_STEPS, _DONE = 30, 1e-8  # of the search: most of them, and the change of the cost that ends it
_HALVINGS = 12


def identify_gains(
    recordings: Recording | Sequence[Recording],
    robot: Robot,
    *,
    payloads: Sequence[Payload | None] = (),
    known: Mapping[str, float] | None = None,
    cutoff_hz: float | None = None,
    gravity: tuple[float, float, float] = STANDARD_GRAVITY,
) -> DynamicsFit:
    """Fit base parameters, gains and friction to motor currents.

    Weighted nonlinear least squares of currents, i_j = (Y_j p + payload_j) / k_j: the noise is on the current, which as
    a regressor would shrink the gains. Cut-off and friction are chosen as for torques, joint by joint. Standard errors
    hold under residuals correlated in time and between joints, and those of the parameters know that gains are found.

    Args:
        recordings: with motor currents; one or more.
        robot: its kinematic chain; inertia it may have is not used.
        payloads: what each recording carried, known; it gives the scale where recordings differ in it.
        known: gains by joint [Nm/A or N/A], not fitted.
        cutoff_hz: of the filter; default: the best by the error on held-out fifths.
        gravity: acceleration of free fall in the base frame, of a base on a wall or a ceiling not along -z [m/s2].

    Returns:
        A fit whose model has ``gains``, with ``gain_errors``. Gains that the recordings do not show are named in
        ``unobservable`` (``gain_4``), with an infinite error.

    Raises:
        InputError: no currents, an unknown joint, nothing that gives a scale, or no gain that can be seen.
    """
    logs = as_list(recordings)
    fixed = _fixed(robot, known or {})
    scales = np.isfinite(fixed).any()
    if not scales and not _loads_differ(payloads, len(logs)):
        alike = "all recordings carry the same" if any(payloads) else "nothing known is carried"
        raise InputError(
            "gains",
            f"their scale is not identifiable: {alike}, and a load that never changes is as good as a part of the arm",
            "wanted recordings with and without a known payload, or a known gain",
        )
    still = joints_at_rest(logs, robot)
    held_out: dict[float, float] = {}
    if cutoff_hz is None:
        cutoff_hz, held_out = choose_cutoff(logs, robot, (), payloads, currents=True, gravity=gravity)
    filters = (FIT_PER_CUTOFF * cutoff_hz,)
    rows, few = (
        TorqueSamples.of(
            logs,
            robot,
            cutoff_hz,
            payloads,
            currents=True,
            limit=limit,
            filters_hz=filters,
            ends=ends,
            gravity=gravity,
        )
        for limit, ends in ((_ENOUGH, True), (ENOUGH_TO_CHOOSE, False))
    )
    system = best_friction(few, robot, cutoff_hz, (), of=rows)
    fit = _found(system, fixed, held_out)
    if system.loads:
        # The loads were those of each current alone, in amperes: now they are torques of one arm.
        every = np.zeros(system.raw.shape[2])
        every[list(fit.model.columns)], every[-1] = fit.model.values, 1.0
        fit = _found(system.reloaded(every), fixed, held_out)
    return replace(fit, still=still, created_from=tuple(log.source for log in logs))


def _fixed(robot: Robot, known: Mapping[str, float]) -> FloatArray:
    """Given gains (n,), NaN where they are to be found."""
    names = [joint.name for joint in robot.joints]
    fixed = np.full(robot.dof, np.nan)
    for name, gain in known.items():
        if name not in names:
            raise InputError("known", f"{name!r} is no joint of {robot.name}", f"valid: {', '.join(names)}")
        if not (np.isfinite(gain) and gain != 0):
            raise InputError("known", f"the gain of {name} is {gain}", "wanted a number other than 0")
        fixed[names.index(name)] = gain
    return fixed


def _loads_differ(payloads: Sequence[Payload | None], recordings: int) -> bool:
    loads = {None if load is None or load.mass == 0 else load for load in payloads}
    return len(loads) > 1 and len(payloads) == recordings


@dataclass(frozen=True, eq=False)
class _Currents:
    """Currents as a function of inverse gains and base parameters.

    Attributes:
        columns: (N, n, p) of the base parameters [Nm per unit].
        carried: (N, n) torque of known loads [Nm].
        wanted: (N, n) currents [A].
        free: joints whose gain is to be found.
        count: (n,) of the rows that these stand for.
    """

    columns: FloatArray
    carried: FloatArray
    wanted: FloatArray
    free: np.ndarray
    count: FloatArray

    def condensed(self) -> _Currents:
        """Rows with the same squares, no more of them than columns: all that the search asks for.

        A joint's residual is linear in its columns, its load and its current, whatever gain and parameters are tried.
        """
        together = np.concatenate([self.columns, self.carried[:, :, None], self.wanted[:, :, None]], axis=2)
        few = triangle_of(together.transpose(1, 0, 2)).transpose(1, 0, 2)
        return _Currents(few[:, :, :-2], few[:, :, -2], few[:, :, -1], self.free, self.count)

    def spread(self, left: FloatArray) -> FloatArray:
        """Root mean square (n,) of what is left of the currents or torques (N, n)."""
        size: FloatArray = np.sqrt((left**2).sum(axis=0) / self.count)
        return size

    def start(self, inverse: FloatArray, spread: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Inverse gains (n,) and values (p,) by linear least squares of torques, k i = Y p + payload."""
        rows, n = self.wanted.shape
        gains = np.where(self.free, 0.0, 1 / inverse)
        matrix = np.zeros((rows, n, self.free.sum() + self.columns.shape[2]))
        for place, j in enumerate(np.flatnonzero(self.free)):
            matrix[:, j, place] = -self.wanted[:, j]
        matrix[:, :, self.free.sum() :] = self.columns
        target = gains * self.wanted - self.carried
        # Joints weigh by their noise in amperes times a gain that is not known yet: once by what is left of the first.
        weight = 1 / spread
        for _ in range(2):
            found = _least_squares(matrix * weight[None, :, None], target * weight)
            weight = 1 / np.maximum(self.spread(target - matrix @ found), 1e-12)
        gains[self.free] = found[: self.free.sum()]
        usual = float(np.median(np.abs(gains[gains != 0]))) if (gains != 0).any() else 1.0
        gains[np.abs(gains) < 1e-3 * usual] = usual
        return 1 / gains, found[self.free.sum() :]

    def starts(self, inverse: FloatArray, spread: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Inverse gains (n,) and values (p,) to search from: the squares have several valleys.

        Beside :meth:`start` and its multiples all gains alike, as great as the known ones where there are any.
        """
        first, values = self.start(inverse, spread)
        yield first, values
        given = first[self.free] if self.free.all() else inverse[~self.free]
        alike = np.where(self.free, float(np.median(np.abs(given))), inverse)
        for tried in (*(np.where(self.free, first / multiple, first) for multiple in _MULTIPLES[1:]), alike):
            matrix = self.columns * tried[None, :, None] / spread[None, :, None]
            yield tried, _least_squares(matrix, (self.wanted - self.carried * tried) / spread)

    def settled(
        self, inverse: FloatArray, values: FloatArray, spread: FloatArray, rounds: int
    ) -> tuple[FloatArray, FloatArray, FloatArray, float]:
        """Inverse gains, values, what is left of every current, and the sum of its logarithms: less is likelier."""
        floor = 1e-9 * np.maximum(self.spread(self.wanted), 1e-12)
        height = np.inf
        for _ in range(rounds):
            before = height
            inverse, values = self.solved(inverse, values, spread)
            spread = np.maximum(self.spread(self.wanted - self.predicted(inverse, values)), floor)
            height = float(np.log(spread).sum())
            if before - height < _SETTLED:
                break
        return inverse, values, spread, height

    def predicted(self, inverse: FloatArray, values: FloatArray) -> FloatArray:
        """Currents (N, n)."""
        current: FloatArray = (self.columns @ values + self.carried) * inverse
        return current

    def slope(self, inverse: FloatArray, values: FloatArray, spread: FloatArray) -> FloatArray:
        """Derivative (N, n, free + p) of the currents in standard deviations, by inverse gains, then by values."""
        rows, n = self.wanted.shape
        count = int(self.free.sum())
        matrix = np.zeros((rows, n, count + values.size))
        torque = self.columns @ values + self.carried
        for place, j in enumerate(np.flatnonzero(self.free)):
            matrix[:, j, place] = torque[:, j]
        matrix[:, :, count:] = self.columns * inverse[None, :, None]
        return matrix / spread[None, :, None]

    def solved(self, inverse: FloatArray, values: FloatArray, spread: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gauss-Newton with halved steps from a start."""
        count = int(self.free.sum())

        def cost(inverse: FloatArray, values: FloatArray) -> float:
            with np.errstate(over="ignore", invalid="ignore"):  # a step too far costs infinitely much
                return float((((self.wanted - self.predicted(inverse, values)) / spread) ** 2).sum())

        least = cost(inverse, values)
        for _ in range(_STEPS):
            residual = (self.wanted - self.predicted(inverse, values)) / spread
            step = _least_squares(self.slope(inverse, values, spread), residual)
            for halving in range(_HALVINGS):
                share = 0.5**halving
                tried = inverse.copy()
                tried[self.free] += share * step[:count]
                reached = cost(tried, values + share * step[count:])
                if reached < least:
                    break
            else:
                break
            inverse, values = tried, values + share * step[count:]
            if least - reached < _DONE * least:
                break
            least = reached
        return inverse, values


def _found(system: System, fixed: FloatArray, held_out: dict[float, float]) -> DynamicsFit:
    n = system.robot.dof
    columns, carried = system.columns[:, :, :-1], system.columns[:, :, -1]
    usual = np.maximum(system.wanted.std(axis=0), 1e-12)
    length = np.sqrt((columns**2).sum(axis=(0, 1)))
    seen = np.flatnonzero(length > 1e-9 * length.max())
    per_joint = np.maximum(np.sqrt((columns[:, :, seen] ** 2).sum(axis=(0, 2))), 1e-12)
    chosen, groups = independent((columns[:, :, seen] / per_joint[None, :, None]).reshape(-1, seen.size))
    own = [int(seen[c]) for c in chosen]
    free = ~np.isfinite(fixed)
    whole = _Currents(columns[:, :, own], carried, system.wanted, free, system.counts)
    few = whole.condensed()
    inverse = np.where(free, 1.0, 1 / np.where(free, 1.0, fixed))
    spread = np.maximum(np.sqrt(system.held_out()), 1e-6 * usual)
    found = [few.settled(*start, spread, _ROUNDS) for start in few.starts(inverse, spread)]
    inverse, values, spread, _ = min(found, key=lambda one: one[3])
    inverse, values, spread, _ = few.settled(inverse, values, spread, _MAX_ROUNDS)
    residual = whole.wanted - whole.predicted(inverse, values)
    matrix = whole.slope(inverse, values, spread).reshape(-1, int(free.sum()) + values.size)
    covariance = clustered_covariance(matrix, (residual / spread).ravel(), n)
    spreads = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    errors = np.zeros(n)
    count = int(free.sum())
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):  # no current at all: infinitely unsure
        gains = 1 / inverse
        errors[free] = spreads[:count] * gains[free] ** 2
    hidden = np.zeros(n, dtype=bool)
    hidden[free] = (visible_share(matrix)[:count] < _DEPENDENT) | (spreads[:count] > _KNOWN_TO * np.abs(inverse[free]))

    joints = [joint.name for joint in system.robot.joints]
    if hidden[free].all() and free.any():
        raise InputError(
            "gains",
            f"not identifiable: {', '.join(name for name, lost in zip(joints, hidden, strict=True) if lost)}",
            "wanted a heavier known payload, faster motion of several joints at once, or a known gain",
        )
    essential = system.essential(own, values, 1 / spread, inverse)
    predicting, takes = essential if essential is not None else (None, np.ones(n, dtype=bool))
    names = system.names
    unobservable = [name for i, name in enumerate(names) if i not in set(seen.tolist())]
    unobservable += [f"gain_{j + 1}" for j in np.flatnonzero(hidden)]
    return DynamicsFit(
        model=DynamicsModel(
            robot=system.robot,
            columns=tuple(own),
            values=values,
            predicting=predicting,
            predicted_by_all=tuple(np.flatnonzero(~takes).tolist()),
            sign_speed=system.sign_speed,
            presliding=system.presliding,
            top_speed=system.top_speed,
            loaded=tuple(sorted(system.loads)),
            cutoff_hz=system.cutoff_hz,
            gravity=system.rows.reach.motion.gravity,
            gains=gains,
            unscaled=tuple(np.flatnonzero(hidden).tolist()),
        ),
        names=tuple(label_of(names, seen, int(c), groups[i]) for i, c in enumerate(chosen)),
        errors=spreads[count:],
        gain_errors=np.where(hidden, np.inf, errors),
        held_out=held_out,
        unobservable=tuple(unobservable),
        rows_used=system.wanted.shape[0],
        covariance=covariance[count:, count:],
        rows_left=system.rows.rows_left,
        rows_beside_gaps=system.rows.rows_beside_gaps,
        rows_at_ends=system.rows.rows_at_ends,
        rows_at_rest=(~system.rows.used).sum(axis=0),
        rows_whole=system.rows.rows_whole,
        condition=condition_of(matrix),
        unexplained=system.unexplained(),
        usual_torque=np.abs(gains) * np.sqrt((system.rows.torque**2).mean(axis=0)),
        seen=SeenMotion.of(system.rows.motion),
    )


def _least_squares(matrix: FloatArray, target: FloatArray) -> FloatArray:
    """Shortest least squares (p,) of rows (N, n, p) and (N, n), columns brought to length one."""
    flat = matrix.reshape(-1, matrix.shape[2])
    length = np.maximum(np.linalg.norm(flat, axis=0), 1e-300)
    values: FloatArray = np.linalg.lstsq(flat / length, target.ravel(), rcond=1e-9)[0] / length
    return values
