"""What a program does, as far as it is known before it runs: its moves one after the other, with where they begin."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError
from bumpstop.program.languages.blocks import called_by, idles
from bumpstop.program.languages.statements import (
    Branch,
    Call,
    Frames,
    Leave,
    Loop,
    Move,
    Node,
    Opaque,
    ReadProgram,
    Setting,
    Target,
    Wait,
)
from bumpstop.program.motion.kinematics import (
    joint_line,
    other_posture,
    solution_near,
    tool_arc,
    tool_line,
    tool_positions,
    transform,
)
from bumpstop.program.motion.path import Leg
from bumpstop.program.state import State, acceleration_of, agreed, alike, blend_of, equal, slots_of
from bumpstop.program.visit import Visit, identity, same_motion

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.model import Robot

_MAX_VISITS, _MAX_STEPS, _MAX_DEPTH = 5000, 200_000, 12
_MAX_RECURSION = 2  # calls of a function inside itself: the second shows what the first leaves to its beginning
_MAX_ROUNDS = 4  # of a loop that are run through before what changes is given up
_SPEEDS = ("tool", "axes", "acceleration tool", "acceleration axes", "blend")
_OVERLAP = 1e-6  # [m] blends that overlap by less only meet
_AWAY = 1e-9  # [rad] joints that turn less do not move


class Interpreter:
    """Runs through a program.

    A loop is run through until its rounds begin as one before did, for its first move begins where its last one ends
    from then on. After a branch, a loop or a function only what all its ways agree on is known. Functions of the
    program are run through where they are called; those that nothing understood calls begin anywhere.
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
        self.notes: list[str] = []
        self._visits = self._steps = 0
        self._chains: list[list[Visit]] = []
        # The move before is blended; the program has waited since the move before.
        self._goes_on = self._waits = False
        self._ran: set[str] = set()
        self._running: list[str] = []
        # States at jumps out of the loops and functions that are being run through, and to the next round.
        self._breaks: list[list[State]] = []
        self._rounds: list[list[State]] = []
        self._returns: list[list[State]] = []
        self._cycles: list[State] = []  # at jumps to where the program begins

    def chains(self) -> list[tuple[Visit, ...]]:
        """Moves that go over into each other, chain by chain, each once.

        Raises:
            InputError: the program runs through too many moves.
        """
        functions, main, ends = self._program.functions, self._program.main, list[State]()
        if main is not None and main in functions:
            self._function(main, state := State(self._start), 0)
            ends += [state] if self._program.cycles and not state.dead else []
        self._goes_on = False
        called = set(called_by(functions.values()))
        mentioned = set(re.findall(r"\w+", " ".join(text for _, text in self._program.not_understood).lower()))
        # What is called by something not understood begins anywhere, too; what calls itself alone as well.
        anywhere = [name for name in functions if name != main and (name not in called or name in mentioned)]
        for name in (*anywhere, *functions):
            if name in anywhere or name not in self._ran:
                state = State(None)
                self._forget(state)
                self._function(name, state, 0)
                self._end_blend()
        ends, once = [*ends, *self._cycles], len(self._chains)
        if main is not None and main in functions and ends:
            self._function(main, agreed(ends), 0)
        # A jump to the begin is the program's own, and what follows it counts.
        again = range(0) if self._cycles else range(once, len(self._chains))
        found: dict[object, list[tuple[Visit, ...]]] = {}
        each: list[tuple[Visit, ...]] = []
        for number, chain in enumerate(self._chains):
            same = found.setdefault(identity(chain), [])
            if any(same_motion(chain, other) for other in same):
                continue
            if number not in again:
                same.append(tuple(chain))
                each.append(same[-1])
            elif not self.notes and not all(visit.still for visit in chain):
                self.notes = [f"line {chain[0].move.line}: in cycles it begins where main ends; that is not judged"]
        return each

    def _run(self, body: Sequence[Node], state: State, depth: int) -> None:
        for node in body:
            self._steps += 1
            if self._steps > _MAX_STEPS:
                raise InputError(self._field, f"runs through more than {_MAX_STEPS} statements", "give its parts alone")
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
                self._loop(node, state, depth)
            elif isinstance(node, Branch):
                self._branch(node, state, depth)
            elif isinstance(node, Leave):
                self._leave(node, state)
            elif isinstance(node, Wait):
                self._waits = True

    def _loop(self, node: Loop, state: State, depth: int) -> None:
        if not self._may_move((node,)):
            # It may go round until something happens.
            self._waits = self._waits or not node.certain
        elif not node.certain:
            self._end_blend()
        before, heads, ends = state.copy(), [(state.copy(), self._blended)], list[State]()
        self._breaks.append([])
        while True:
            self._rounds.append([])
            self._run(node.body, state, depth)
            again = self._rounds.pop() + ([] if state.dead else [state.copy()])
            if not again:
                break
            head = agreed(again)
            ends.append(head)
            blended = self._blended
            if len(heads) > 1 and any(alike(head, other) and same_motion(blended, last) for other, last in heads):
                break
            if len(heads) >= _MAX_ROUNDS:
                # What changes from round to round is not known.
                head = agreed([*(other for other, _ in heads), head])
                if alike(head, heads[-1][0]):
                    break
            heads.append((head, blended))
            state.set(head)
        jumps = self._breaks.pop()
        # Where the end of a certain loop goes over into what follows, that is its last round's.
        if (jumps or not node.certain) and self._may_move((node,)):
            self._end_blend()
        self._meet(state, [*jumps, *([] if node.certain else [before]), *([] if node.endless else ends)])

    @property
    def _blended(self) -> Sequence[Visit]:
        """The move that goes over into the next, if one does."""
        return self._chains[-1][-1:] if self._goes_on else ()

    def _branch(self, node: Branch, state: State, depth: int) -> None:
        moves = self._may_move((node,))
        if moves:
            self._end_blend()
        ends = []
        for body in (*node.bodies, ()):
            own = state.copy()
            self._run(body, own, depth)
            if moves:
                self._end_blend()
            if not own.dead:
                ends.append(own)
        self._meet(state, ends)

    def _meet(self, state: State, ends: Sequence[State]) -> None:
        """What is known where ways meet; of none nothing is: no way that is understood leads to what follows."""
        if ends:
            state.set(agreed(ends))
        else:
            self._forget(state)
            state.dead = True

    def _forget(self, state: State) -> None:
        state.reach(None, {})
        state.speeds = dict.fromkeys(_SPEEDS)
        for which in self._program.frames:
            setattr(state, which, None)

    def _leave(self, node: Leave, state: State) -> None:
        if node.what in ("program", "cycle"):
            self._goes_on = False
            self._cycles += [state.copy()] if node.what == "cycle" and not state.dead else []
        else:
            self._end_blend()
            jumps = {"loop": self._breaks, "round": self._rounds, "function": self._returns}[node.what]
            if not state.dead:
                (jumps or self._returns)[-1].append(state.copy())
        self._forget(state)
        state.dead = True

    def _call(self, node: Call, state: State, depth: int) -> None:
        again = self._running.count(node.name) >= _MAX_RECURSION
        if node.name not in self._program.functions or depth >= _MAX_DEPTH or again:
            self._opaque(Opaque(node.line, node.name, resets=True, reframes=self._program.frames), state)
        else:
            self._function(node.name, state, depth + 1)

    def _function(self, name: str, state: State, depth: int) -> None:
        self._ran.add(name)
        self._running.append(name)
        outer, self._breaks, self._rounds = (self._breaks, self._rounds), [], []
        self._returns.append([])
        self._run(self._program.functions[name], state, depth)
        self._breaks, self._rounds = outer
        jumps = self._returns.pop()
        self._running.pop()
        if jumps:
            self._end_blend()
        self._meet(state, [*jumps, *([] if state.dead else [state.copy()])])

    def _opaque(self, node: Opaque, state: State) -> None:
        started = re.match(r"run\s+(\w+)", node.text)
        body = self._program.functions.get(f"thread {started[1].lower()}") if started else None
        if body is not None and idles(body):
            return
        if node.moves:
            # A jump may come here, too.
            state.reach(None, {})
            state.dead = False
            self._end_blend()
        if node.resets:
            state.speeds = dict.fromkeys(_SPEEDS)
        for which in node.reframes:
            setattr(state, which, None)

    def _end_blend(self, why: str = "the move that it is blended into is not known") -> None:
        """The move before, if it is blended, goes over into one that is not known."""
        if self._goes_on:
            last = self._chains[-1][-1]
            self._chains[-1][-1] = replace(last, why=last.why or why)
        self._goes_on = False

    def _may_move(self, nodes: Sequence[Node], depth: int = 0) -> bool:
        """Whether the arm may move in statements, or they may jump; of calls in calls it is taken that it may."""
        for node in nodes:
            if isinstance(node, (Move, Leave)) or (isinstance(node, Opaque) and node.moves):
                return True
            bodies: Sequence[Sequence[Node]] = ()
            if isinstance(node, Loop):
                bodies = (node.body,)
            elif isinstance(node, Branch):
                bodies = node.bodies
            elif isinstance(node, Call):
                if depth >= 2 or node.name not in self._program.functions:
                    return True
                bodies = (self._program.functions[node.name],)
            if any(self._may_move(body, depth + isinstance(node, Call)) for body in bodies):
                return True
        return False

    def _move(self, move: Move, state: State) -> None:
        self._visits += 1
        if self._visits > _MAX_VISITS:
            raise InputError(self._field, f"runs through more than {_MAX_VISITS} moves", "give its parts one by one")
        if self._waits:
            self._end_blend("the program waits before the move that it is blended into")
        self._waits = False
        own = state.copy()
        self._run(move.own, own, 0)
        if (blend := blend_of(move, own)) == math.inf:
            told = f"line {move.line}: how far it is blended is not known; half of the way is taken"
            self.notes += [told] if told not in self.notes else []
        visit, end = self._visit(move, own, blend)
        if visit.still:
            self._end_blend("the move that it is blended into goes nowhere")
        if self._goes_on and _with_other_tools(self._chains[-1][-1], visit):
            self._end_blend("the tool changes before the move that it is blended into")
        if self._goes_on and self._chains[-1][-1].move.planner != move.planner:
            self._end_blend("only one of it and the move that it is blended into is a spline move")
        if self._program.skips_overlaps and self._overlaps(visit):
            visit = replace(visit, why=visit.why or "its blend and the one before it overlap, where a move is skipped")
        if self._goes_on and self._chains:
            self._chains[-1].append(visit)
        else:
            self._chains.append([visit])
        self._goes_on = blend > 0
        state.reach(end, dict(move.target.external))

    def _overlaps(self, visit: Visit) -> bool:
        """Whether the blends at begin and end of a move are longer than it is."""
        if (leg := visit.leg) is None:
            return False
        begin, end = tool_positions(self._robot, leg.q[[0, -1]], leg.tool)
        blends = sum(one.move.blend or 0.0 for one in (*self._blended, visit))
        return blends > 0 and blends > float(np.linalg.norm(end - begin)) + _OVERLAP

    def _visit(self, move: Move, state: State, blend: float) -> tuple[Visit, FloatArray | None]:
        slots, why = slots_of(move, state, self._robot.dof)
        q, end = self._samples(move, state)
        others = [
            f"external axis {axis} may move, too, and is not followed"
            for axis, value in move.target.external
            if value is None or value != state.external.get(axis, value)
        ]
        why = move.why or why or "".join(others[:1])
        if isinstance(q, str):
            return Visit(move, None, slots, why if why else q), end
        if float(np.abs(q - q[0]).max()) < _AWAY and not others:
            return Visit(move, None, slots, "", still=True), end
        if state.tool is None and move.measure == "tool":
            why = why or "the tool whose speed it gives is not known"
        tool = np.eye(4) if state.tool is None else state.tool
        leg = Leg(q, tool, move.measure, blend, acceleration_of(move, state))
        return Visit(move, leg, slots, why), end

    def _samples(self, move: Move, state: State) -> tuple[FloatArray | str, FloatArray | None]:
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
            if state.tool is None or state.frame is None:
                return "the tool or frame of its target is not known", None
            pose = state.frame @ transform(target.pose)
            if target.near is not None and not move.linear:
                found = solution_near(robot, np.array(target.near), pose, state.tool)
                if isinstance(found, str):
                    return found, None
                return (begin if state.q is None else joint_line(state.q, found)), found
            if state.q is None:
                return begin, None
            q = tool_line(robot, state.q, pose, state.tool)
        if isinstance(q, str) or move.linear:
            return q, None if isinstance(q, str) else q[-1]
        why = other_posture(robot, q[0], q[-1], target.within)
        return (why, None) if why else (joint_line(q[0], q[-1]), q[-1])

    def _arc(self, move: Move, via: Target, state: State) -> FloatArray | str:
        if via.why:
            return via.why
        if state.q is None:
            return "where it begins is not known"
        middle, end, tool = self._pose(via, state), self._pose(move.target, state), state.tool
        if middle is None or end is None or tool is None:
            return "the tool or frame of its target is not known"
        return tool_arc(self._robot, state.q, middle[:3, 3], end, tool)

    def _pose(self, target: Target, state: State) -> FloatArray | None:
        """Of the tool at a target, in the base (4, 4); None where it is not known."""
        if target.joints is not None and state.tool is not None and len(target.joints) == self._robot.dof:
            return np.asarray(self._robot.pose(np.array(target.joints)) @ state.tool)
        return None if target.pose is None or state.frame is None else state.frame @ transform(target.pose)


def _with_other_tools(one: Visit, other: Visit) -> bool:
    """Whether a line goes over into a move of another tool, or into one from it: the tool's path is not one."""
    if one.leg is None or other.leg is None or not (one.move.linear or other.move.linear):
        return False
    return not equal(one.leg.tool, other.leg.tool)
