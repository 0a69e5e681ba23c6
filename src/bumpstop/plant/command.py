"""What the plant's controller asks of the joints: a motion, and the reactions it can turn into."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal, Protocol, get_args

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.collision.stopping.deceleration import Deceleration
from bumpstop.errors import InputError, near_matches

if TYPE_CHECKING:
    from bumpstop.collision.trajectory.trajectory import Trajectory
    from bumpstop.model import Robot

# Of Schroeder's controller: rates are resolved every 0.2 ms, positions given every 1 ms.
COMMAND_STEP = 1e-3
SUBSTEPS = 5
_MAX_DURATION_S = 3600.0
MAX_LATENCY_S = 10.0
_AFTERWARDS_S = 0.25
_MAX_BRAKING_ROWS = 20_000


Turn = Literal["reverse", "stop"]
Start = Literal["moving", "rest"]
Task = Literal["pose", "position"]


@dataclass(frozen=True, kw_only=True)
class PlantReaction:
    """What a callback answers to have the arm react.

    Attributes:
        kind: ``"reverse"`` goes back the way it came, ``"stop"`` stays.
        joint_acceleration: limit of every joint, or one each [rad/s2 or m/s2].
        latency_s: from the sample to the reaction; rounded up to whole milliseconds.
        deceleration: how the joints slow down.
    """

    kind: Turn = "reverse"
    joint_acceleration: float | Sequence[float] = 4.5
    latency_s: float = 0.0
    deceleration: Deceleration = field(default_factory=Deceleration)

    def __post_init__(self) -> None:
        _check_name("reaction.kind", self.kind, get_args(Turn))
        if not 0 <= as_number(self.latency_s, "reaction.latency_s") <= MAX_LATENCY_S:
            raise InputError("reaction.latency_s", f"is {self.latency_s} s", f"wanted 0 to {MAX_LATENCY_S:g}")
        if self.deceleration.independent and self.kind == "reverse":
            problem = "is 'reverse', which joints that brake by themselves cannot"
            raise InputError("reaction.kind", problem, "wanted 'stop'")


class _Reactions(Protocol):
    def __call__(
        self, command: Command, knot: int, reaction: PlantReaction, limit: FloatArray, rest: float, /
    ) -> Command: ...


@dataclass(frozen=True, eq=False)
class Command:
    """Joint positions every millisecond.

    Attributes:
        q, qd: (K, dof) positions and rates at 0, 1, 2, ... ms.
        react: what a command turns into if the arm reacts at a millisecond of it, with limits of the joints'
            accelerations and a rest [s]; the first row is the command's own.
        notes: what was cut short.
        go_on: positions and rates of so many milliseconds beyond the end; None: it holds its end.
    """

    q: FloatArray
    qd: FloatArray
    react: _Reactions
    notes: tuple[str, ...] = field(default=())
    go_on: Callable[[int], tuple[FloatArray, FloatArray]] | None = None

    @property
    def duration(self) -> float:
        """[s]."""
        return (len(self.q) - 1) * COMMAND_STEP

    def reaction(self, knot: int, reaction: PlantReaction, rest: float = _AFTERWARDS_S) -> Command:
        """The motion from millisecond ``knot`` on, if the arm reacts there.

        It ends ``rest`` seconds after the arm stands, or goes back as fast as it came.
        """
        limit = _accelerations(reaction.joint_acceleration, self.q.shape[1], "reaction.joint_acceleration")
        return self.react(self.until(knot), knot, reaction, limit, rest)

    def until(self, knot: int) -> Command:
        """The same motion, told up to millisecond ``knot`` at least.

        Beyond its end a line goes on, or brakes where joints or singularities end it, and a press goes on back; a
        trajectory and a reaction hold their ends.
        """
        missing = knot + 1 - len(self.q)
        if missing <= 0:
            return self
        given = self.go_on
        if given is None:
            q, qd = np.tile(self.q[-1], (missing, 1)), np.zeros((missing, self.q.shape[1]))
        else:
            q, qd = given(missing)

        def go_on(count: int) -> tuple[FloatArray, FloatArray]:
            farther, faster = given(missing + count)  # type: ignore[misc]
            return farther[missing:], faster[missing:]

        q, qd = np.concatenate([self.q, q]), np.concatenate([self.qd, qd])
        return Command(q, qd, self.react, self.notes, None if given is None else go_on)


def _check_name(field: str, name: str, names: tuple[str, ...]) -> None:
    if name not in names:
        raise InputError(field, f"{name!r} is none", near_matches(str(name), names))


def _accelerations(value: float | Sequence[float], n: int, field: str) -> FloatArray:
    """A limit for all joints or one each, as (n,)."""
    limit = np.full(n, as_number(value, field)) if np.ndim(value) == 0 else as_float_array(value, field, (n,))
    if not (limit > 0).all():
        raise InputError(field, f"is {limit.min():g}", "wanted numbers above 0")
    return limit


def line(
    robot: Robot,
    q: npt.ArrayLike,
    velocity: Sequence[float],
    *,
    duration: float,
    start: Start = "moving",
    task: Task = "pose",
    held_joints: Sequence[int] = (),
    joint_acceleration: float | Sequence[float] = 4.5,
    hold: float = 0.0,
) -> Command:
    """The resolved-rate motion of ``collision``: the tip along a straight line at constant speed.

    Args:
        robot: the arm.
        q: start pose (dof,) [rad or m].
        velocity: of the tip, base frame (3,) [m/s].
        duration: of the motion [s].
        start: with the full rates, or from rest.
        task: hold the orientation, or only follow the line.
        held_joints: that do not move, from 1.
        joint_acceleration: limits while the arm gathers speed [rad/s2].
        hold: how long it then stands at the end, after stopping within the same limits [s].

    Raises:
        InputError: the start is singular or outside the limits, a joint or a length cannot be used.
    """
    n = robot.dof
    pose = as_float_array(q, "pose", (n,))
    target = as_float_array(velocity, "velocity", (3,))
    outside = np.flatnonzero(robot.beyond_limits(pose))
    if outside.size:
        j = int(outside[0])
        raise InputError(
            f"pose[{j + 1}]",
            f"{pose[j]:.6g} is outside the limits of joint {j + 1}",
            f"valid: {robot.lower[j]:.6g} to {robot.upper[j]:.6g}",
        )
    if not COMMAND_STEP <= as_number(duration, "duration") <= _MAX_DURATION_S:
        raise InputError("duration", f"is {duration} s", f"wanted {COMMAND_STEP} to {_MAX_DURATION_S:g}")
    if not 0 <= as_number(hold, "hold") <= _MAX_DURATION_S:
        raise InputError("hold", f"is {hold} s", f"wanted 0 to {_MAX_DURATION_S:g}")
    _check_name("start", start, get_args(Start))
    _check_name("task", task, get_args(Task))
    limit = _accelerations(joint_acceleration, n, "joint_acceleration")
    held = [number - 1 for number in held_joints if number in range(1, n + 1)]
    if len(held) < len(held_joints):
        raise InputError("held_joints", f"{list(held_joints)} names a joint that is none", f"valid: 1 to {n}")
    free = [j for j in range(n) if j not in held]
    rows = 6 if task == "pose" else 3
    if len(free) < rows:
        raise InputError("task", f"{task!r} needs {rows} free joints, {len(free)} are free", "free more of them")
    setup = _setup(robot, limit, "stop")
    line, timing = setup.motion, setup.timing
    line.tip = setup.contact.point
    line.task_rows, line.free_joints = rows, free
    line.velocity_limit, line.lower, line.upper = robot.velocity, robot.lower, robot.upper
    if target.any():
        setup.contact.along_motion = False
        setup.contact.normal = (target / np.linalg.norm(target)).tolist()
    timing.from_rest = start == "rest"
    begin = _native.line_start(setup, pose, target)
    if begin.singular:
        raise InputError("pose", "is singular: no finite joint rates move the tip as asked", "give another pose")
    resolver = _Resolver(robot, free, rows)

    def traced(steps: int) -> tuple[FloatArray, FloatArray, str]:
        """Positions and rates of so many milliseconds, or fewer, and what ends them."""
        timing.steps = steps
        path = _native.stopping_curve(setup, pose, target, None, _native.Contact())
        states = path.reaction_state
        positions = np.tile(pose, (len(states) + 1, 1))
        rates = np.zeros_like(positions)
        rates[0] = np.zeros(n) if start == "rest" else begin.qd
        positions[1:, free], rates[1:, free] = states[:, 0], states[:, 1]
        return positions, rates, path.end

    def halted(positions: FloatArray, rates: FloatArray, rest: float) -> tuple[FloatArray, FloatArray]:
        """The same, and how the arm then brakes and stands [s]."""
        q_stop, qd_stop = resolver.brake(positions[-1], rates[-1], None, limit, rest)
        return np.concatenate([positions, q_stop[1:]]), np.concatenate([rates, qd_stop[1:]])

    def react(command: Command, knot: int, reaction: PlantReaction, limit: FloatArray, rest: float, /) -> Command:
        # From where that command has got: it need not be this line any more.
        aim = None if reaction.kind == "stop" else -target
        q, qd = resolver.brake(command.q[knot], command.qd[knot], aim, limit, rest, reaction.deceleration)
        return Command(q, qd, react)

    def go_on(count: int) -> tuple[FloatArray, FloatArray]:
        """Along the line, as a path of ``collision`` while a latency outlasts it."""
        longer, faster, end = traced(len(positions) - 1 + count)
        if end != "motion_end":
            longer, faster = halted(longer, faster, count * COMMAND_STEP)
        return longer[len(positions) :][:count], faster[len(positions) :][:count]

    positions, rates, end = traced(round(duration / COMMAND_STEP))
    notes = () if end == "motion_end" else (f"The line ends after {(len(positions) - 1) * COMMAND_STEP:.3g} s: {end}.",)
    if hold > 0:
        return Command(*halted(positions, rates, hold), react, notes)
    return Command(positions, rates, react, notes, go_on)


def _setup(robot: Robot, limit: FloatArray, reaction: str) -> _native.CollisionSetup:
    """The tip hits. A tick comes after every step, as the path of the joints is told at ticks."""
    setup = _native.CollisionSetup(robot.chain)
    link, point = robot.frame(None)
    setup.contact.point = setup.motion.tip = robot.chain.link_point(link, point.tolist())
    setup.motion.step, setup.motion.substeps = COMMAND_STEP, SUBSTEPS
    setup.motion.acceleration_limit = limit
    setup.timing.period, setup.timing.latency = 1, 0
    setup.reaction = _native.ReactionKind[reaction]
    return setup


class _Resolver:
    """Rates of the joints that move the tip as wanted, in the manner of ``line_motion.hpp``."""

    def __init__(self, robot: Robot, free: list[int], rows: int) -> None:
        self._robot, self._free, self._rows = robot, np.array(free), rows
        self._place = robot.frame(None)
        self._velocity_limit = robot.velocity[self._free]

    def rates(self, q: FloatArray, velocity: FloatArray) -> FloatArray:
        """(free,), scaled as a whole to the velocity limits."""
        jacobian = self._robot.chain.jacobians(q[None], *self._place)[0][: self._rows, self._free]
        target = np.zeros(self._rows)
        target[:3] = velocity
        found: FloatArray = np.linalg.lstsq(jacobian, target, rcond=None)[0]
        return found / max(1.0, float(np.max(np.abs(found) / self._velocity_limit)))

    def brake(
        self,
        q: FloatArray,
        qd: FloatArray,
        velocity: FloatArray | None,
        limit: FloatArray,
        rest: float,
        law: Deceleration | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """From a state to a velocity of the tip, None: to rest; then ``rest`` seconds more."""
        law = law or Deceleration()
        scale, slowing = law.profile(self._robot, q, qd, limit)
        slowed, substep = scale[self._free], 0
        ramp = law.ramp_time * SUBSTEPS / COMMAND_STEP if law.law == "ramp" else 0.0
        slowing = slowing * SUBSTEPS / COMMAND_STEP if velocity is not None else np.inf
        q, qd, free = q.copy(), qd.copy(), self._free
        step = COMMAND_STEP / SUBSTEPS
        most = limit[free] * step
        positions, rates = [q.copy()], [qd.copy()]
        left = None
        while left is None or left > 0:
            for _ in range(SUBSTEPS):
                wanted = np.zeros(len(free)) if velocity is None else self.rates(q, velocity)
                change = wanted - qd[free]
                share = slowed if substep < slowing else np.ones(len(free))
                share = share * (min(1.0, (substep + 0.5) / ramp) if ramp else 1.0)
                by_joint = np.abs(change) / (most * share)
                over = float(np.max(by_joint))
                divisor = np.maximum(1.0, by_joint if law.independent else over)
                qd[free] = wanted if over <= 1 else qd[free] + change / divisor
                substep += 1
                q[free] += qd[free] * step
            positions.append(q.copy())
            rates.append(qd.copy())
            if left is not None:
                left -= 1
            elif over <= 1:
                left = round(rest / COMMAND_STEP)
            elif len(positions) > _MAX_BRAKING_ROWS:
                break
        return np.array(positions), np.array(rates)


def along(trajectory: Trajectory, robot: Robot, hold: float = 0.0) -> Command:
    """Follow a joint trajectory, then hold its end.

    Args:
        trajectory: of ``collision``.
        robot: the arm.
        hold: how long it stands at the end [s].
    """
    count = int(np.floor(trajectory.duration / COMMAND_STEP + 1e-9)) + 1
    t: FloatArray = np.arange(count, dtype=np.float64) * COMMAND_STEP
    q, qd = trajectory.at(t), trajectory.at(t, 1)
    if hold > 0:
        rows = round(hold / COMMAND_STEP)
        q, qd = np.concatenate([q, np.tile(q[-1], (rows, 1))]), np.concatenate([qd, np.zeros((rows, robot.dof))])

    def react(command: Command, knot: int, reaction: PlantReaction, limit: FloatArray, rest: float, /) -> Command:
        if knot >= count - 1:  # the arm stands
            way = t[-1:]
        elif reaction.deceleration.independent:
            raise InputError("reaction.stop_category", "0 is not available along a trajectory", "valid: 1 or 2")
        else:
            setup = _setup(robot, limit, reaction.kind)
            setup.motion.deceleration = reaction.deceleration.native
            kernel = _native.Trajectory(setup, trajectory.time, trajectory.coefficients)
            # Tick k comes after step k + 1, and its path begins there: a reaction at once waits for the first.
            way = kernel.reaction(max(0, knot - 1))
            way = way if knot > 0 else np.concatenate([t[:1], way])
        final = -1.0 if reaction.kind == "reverse" else 0.0
        slowed = len(way) - 1
        way = np.concatenate([way, way[-1] + final * np.arange(1, round(rest / COMMAND_STEP) + 1) * COMMAND_STEP])
        way = np.clip(way, 0.0, trajectory.duration)
        speed = np.gradient(way, COMMAND_STEP) if len(way) > 1 else np.zeros(1)  # along the path
        speed[slowed] = final
        found, rates = trajectory.at(way), trajectory.at(way, 1) * speed[:, None]
        rates[0] = command.qd[knot]
        return Command(found, rates, _reacts_once)

    return Command(q, qd, react)


def _reacts_once(command: Command, knot: int, reaction: PlantReaction, limit: FloatArray, rest: float, /) -> Command:
    raise InputError("reaction", "has begun along this trajectory", "leave out the second")
