"""What a program does, as far as it is known before it runs: its moves one after the other, with where they begin."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError
from bumpstop.program.languages.statements import (
    Branch,
    Call,
    Frames,
    Loop,
    Move,
    Node,
    Opaque,
    ReadProgram,
    Setting,
    SpeedSlot,
    Target,
)
from bumpstop.program.motion.kinematics import joint_line, tool_arc, tool_line, transform
from bumpstop.program.motion.path import Leg

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.model import Robot

_MAX_VISITS, _MAX_DEPTH = 5000, 12
_AWAY = 1e-9  # [rad] joints that turn less do not move


@dataclass(frozen=True, eq=False)
class Visit:
    """One run of a move.

    Attributes:
        move: the statement.
        leg: its path; None where it is not known.
        slots: where its speed is written.
        why: it cannot be judged; else empty.
        still: the arm stands at its target already.
    """

    move: Move
    leg: Leg | None
    slots: tuple[SpeedSlot, ...]
    why: str = ""
    still: bool = False


@dataclass
class _State:
    q: FloatArray | None
    tool: FloatArray | None = field(default_factory=lambda: np.eye(4))
    base: FloatArray | None = field(default_factory=lambda: np.eye(4))
    speeds: dict[str, SpeedSlot | None] = field(default_factory=dict)


def _equal(a: FloatArray | None, b: FloatArray | None) -> bool:
    return (a is None and b is None) or (a is not None and b is not None and np.array_equal(a, b))


class Interpreter:
    """Runs through a program.

    A loop is run through twice, for its first move begins where its last one ends from then on. After a branch only
    what all its ways agree on is known. Functions of the program are run through where they are called.
    """

    def __init__(self, program: ReadProgram, robot: Robot, start: FloatArray | None, field_name: str) -> None:
        """Prepare.

        Args:
            program: as read.
            robot: whose program it is.
            start: joint positions when it starts (dof,), or None.
            field_name: how errors call the program.
        """
        self._program, self._robot, self._start, self._field = program, robot, start, field_name
        self._visits = 0
        self._chains: list[list[Visit]] = []
        self._goes_on = False

    def chains(self) -> list[tuple[Visit, ...]]:
        """Moves that go over into each other, chain by chain, each once.

        Raises:
            InputError: the program runs through too many moves.
        """
        called = set(_called(self._program.functions.values()))
        for name, body in self._program.functions.items():
            if name not in called:
                self._goes_on = False
                state = _State(self._start, speeds={})
                self._run(body, state, 0)
        found: dict[object, tuple[Visit, ...]] = {}
        for chain in self._chains:
            found.setdefault(_identity(chain), tuple(chain))
        return list(found.values())

    def _run(self, body: Sequence[Node], state: _State, depth: int) -> None:
        for node in body:
            if isinstance(node, Move):
                self._move(node, state)
            elif isinstance(node, Setting):
                state.speeds = {k: v for k, v in state.speeds.items() if not k.startswith(f"{node.key}[")}
                state.speeds[node.key] = node.slot
            elif isinstance(node, Frames):
                setattr(state, node.which, None if node.pose is None else transform(node.pose))
            elif isinstance(node, Call):
                self._call(node, state, depth)
            elif isinstance(node, Opaque):
                self._opaque(node, state)
            elif isinstance(node, Loop):
                # Once more from where its end leaves the arm.
                before = replace(state)
                self._run(node.body, state, depth)
                self._run(node.body, state, depth)
                if not node.certain:
                    self._set(state, _agreed([before, state]))
            elif isinstance(node, Branch):
                self._branch(node, state, depth)

    def _branch(self, node: Branch, state: _State, depth: int) -> None:
        ends = []
        for body in (*node.bodies, ()):
            self._goes_on = False
            own = replace(state, speeds=dict(state.speeds))
            self._run(body, own, depth)
            ends.append(own)
        self._set(state, _agreed(ends))

    def _set(self, state: _State, other: _State) -> None:
        self._goes_on = False
        state.q, state.tool, state.base, state.speeds = other.q, other.tool, other.base, other.speeds

    def _call(self, node: Call, state: _State, depth: int) -> None:
        body = self._program.functions.get(node.name)
        if body is None or depth >= _MAX_DEPTH:
            self._opaque(Opaque(node.line, node.name, resets=True, reframes=("tool", "base")), state)
        else:
            self._run(body, state, depth + 1)

    def _opaque(self, node: Opaque, state: _State) -> None:
        if node.moves:
            state.q = None
            self._goes_on = False
        if node.resets:
            state.speeds = dict.fromkeys(("tool", "axes", "acceleration tool", "acceleration axes"))
        for which in node.reframes:
            setattr(state, which, None)

    def _move(self, move: Move, state: _State) -> None:
        self._visits += 1
        if self._visits > _MAX_VISITS:
            raise InputError(self._field, f"runs through more than {_MAX_VISITS} moves", "give its parts one by one")
        visit, end = self._visit(move, state)
        if self._goes_on and self._chains:
            self._chains[-1].append(visit)
        else:
            self._chains.append([visit])
        self._goes_on = move.blend > 0
        state.q = end

    def _visit(self, move: Move, state: _State) -> tuple[Visit, FloatArray | None]:
        slots, why = _slots(move, state, self._robot.dof)
        why = move.why or why
        q, end = self._samples(move, state)
        if isinstance(q, str):
            return Visit(move, None, slots, why if why else q), end
        if float(np.abs(q - q[0]).max()) < _AWAY:
            return Visit(move, None, slots, "", still=True), end
        assert state.tool is not None or move.target.pose is None
        tool = np.eye(4) if state.tool is None else state.tool
        leg = Leg(q, tool, move.measure, move.blend, _acceleration(move, state))
        return Visit(move, leg, slots, why), end

    def _samples(self, move: Move, state: _State) -> tuple[FloatArray | str, FloatArray | None]:
        """Joint positions along a move, or why they are not known; and those at its end."""
        target, robot = move.target, self._robot
        if target.why:
            return target.why, None
        if move.via is not None:
            q = self._arc(move, move.via, state)
            return q, None if isinstance(q, str) else q[-1]
        begin = "where it begins is not known"
        if target.joints is not None:
            if len(target.joints) != robot.dof:
                return f"its target has {len(target.joints)} joints, {robot.name} has {robot.dof}", None
            end = np.array(target.joints)
            if state.q is None:
                return begin, end
            if not move.linear:
                return joint_line(state.q, end), end
            tool = np.eye(4) if state.tool is None else state.tool
            q = tool_line(robot, state.q, robot.pose(end) @ tool, tool)
        else:
            assert target.pose is not None
            if state.q is None:
                return begin, None
            if state.tool is None or state.base is None:
                return "the tool or frame of its target is not known", None
            q = tool_line(robot, state.q, state.base @ transform(target.pose), state.tool)
        if isinstance(q, str):
            return q, None
        return (q, q[-1]) if move.linear else (joint_line(q[0], q[-1]), q[-1])

    def _arc(self, move: Move, via: Target, state: _State) -> FloatArray | str:
        if via.why:
            return via.why
        if state.q is None:
            return "where it begins is not known"
        middle, end, tool = self._pose(via, state), self._pose(move.target, state), state.tool
        if middle is None or end is None or tool is None:
            return "the tool or frame of its target is not known"
        return tool_arc(self._robot, state.q, middle[:3, 3], end, tool)

    def _pose(self, target: Target, state: _State) -> FloatArray | None:
        """Of the tool at a target, in the base (4, 4); None where it is not known."""
        if target.joints is not None and state.tool is not None and len(target.joints) == self._robot.dof:
            return np.asarray(self._robot.pose(np.array(target.joints)) @ state.tool)
        return None if target.pose is None or state.base is None else state.base @ transform(target.pose)


def _slots(move: Move, state: _State, dof: int) -> tuple[tuple[SpeedSlot, ...], str]:
    """Where the speed of a move is written, and why it is not known."""
    if move.speed:
        return move.speed, ""
    kind = "tool" if move.measure == "tool" else "axes"
    if kind == "axes" and any(key.startswith("axes[") for key in state.speeds):
        each = [state.speeds.get(f"axes[{j + 1}]", state.speeds.get("axes")) for j in range(dof)]
        known = tuple(slot for slot in each if slot is not None and slot.value is not None)
        return (known, "") if len(known) == dof else ((), "the speed of some axes is set outside the program")
    slot = state.speeds.get(kind)
    if slot is not None:
        return (slot,), "" if slot.value is not None else "its speed is not known before the program runs"
    if kind in state.speeds:
        return (), "its speed may be one of several"
    return ((move.default,) if move.default else ()), ""


def _acceleration(move: Move, state: _State) -> float | None:
    if move.acceleration is not None:
        return move.acceleration
    slot = state.speeds.get("acceleration tool") if move.measure == "tool" else None
    return slot.value * slot.factor if slot is not None and slot.value else None


def _agreed(states: Sequence[_State]) -> _State:
    first = states[0]

    def common(name: str) -> FloatArray | None:
        values = [getattr(state, name) for state in states]
        return values[0] if all(_equal(values[0], value) for value in values) else None

    keys = {key for state in states for key in state.speeds}
    speeds = {
        key: first.speeds.get(key) if all(s.speeds.get(key, 0) == first.speeds.get(key, 0) for s in states) else None
        for key in keys
    }
    return _State(common("q"), common("tool"), common("base"), speeds)


def _called(bodies: Iterable[Sequence[Node]]) -> Iterable[str]:
    for body in bodies:
        for node in body:
            if isinstance(node, Call):
                yield node.name
            elif isinstance(node, Loop):
                yield from _called([node.body])
            elif isinstance(node, Branch):
                yield from _called(node.bodies)


def _identity(chain: Sequence[Visit]) -> object:
    return tuple(
        (v.move.line, v.move.word, id(v.move), v.why, None if v.leg is None else v.leg.q[0].tobytes(), v.slots)
        for v in chain
    )
