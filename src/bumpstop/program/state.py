"""What is known of arm and program at a place of it: where the arm is, and what is set."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.arrays import FloatArray
    from bumpstop.program.languages.statements import Move, SpeedSlot

_SAME = 1e-6  # [rad or m] what is less apart is the same: a place is found again from another one


@dataclass
class State:
    """Where the arm and external axes are and what is set; None: not known. ``dead``: nothing runs on from here."""

    q: FloatArray | None
    tool: FloatArray | None = field(default_factory=lambda: np.eye(4))
    base: FloatArray | None = field(default_factory=lambda: np.eye(4))
    shift: FloatArray | None = field(default_factory=lambda: np.eye(4))
    speeds: dict[str, SpeedSlot | None] = field(default_factory=dict)
    external: dict[str, float | None] = field(default_factory=dict)
    dead: bool = False

    def copy(self) -> State:
        """Its own to change."""
        return replace(self, speeds=dict(self.speeds))

    def set(self, other: State) -> None:
        """Make it another one."""
        self.q, self.tool, self.base, self.shift = other.q, other.tool, other.base, other.shift
        self.speeds, self.external, self.dead = dict(other.speeds), other.external, other.dead

    def reach(self, end: FloatArray | None, external: dict[str, float | None]) -> None:
        """Have moved somewhere; of an arm that may be anywhere external axes may be, too."""
        self.q, self.external = end, {**(dict.fromkeys(self.external) if end is None else self.external), **external}

    @property
    def frame(self) -> FloatArray | None:
        """Of targets, in the base."""
        return None if self.base is None or self.shift is None else self.base @ self.shift


def equal(a: FloatArray | None, b: FloatArray | None) -> bool:
    """Whether two values are the same, or neither is known."""
    if a is None or b is None:
        return a is b
    return a.shape == b.shape and bool(np.abs(a - b).max(initial=0.0) < _SAME)


def agreed(states: Sequence[State]) -> State:
    """What is known where one of some states holds."""
    first = states[0]

    def common(name: str) -> FloatArray | None:
        values = [getattr(state, name) for state in states]
        return values[0] if all(equal(values[0], value) for value in values) else None

    keys = {key for state in states for key in state.speeds}
    speeds = {
        key: first.speeds.get(key) if all(s.speeds.get(key, 0) == first.speeds.get(key, 0) for s in states) else None
        for key in keys
    }
    axes = {name for state in states for name in state.external}
    external = {
        name: first.external.get(name) if len({state.external.get(name) for state in states}) == 1 else None
        for name in axes
    }
    return State(common("q"), common("tool"), common("base"), common("shift"), speeds, external)


def alike(one: State, other: State) -> bool:
    """Whether the same is known of two states."""
    pairs = ((one.q, other.q), (one.tool, other.tool), (one.base, other.base), (one.shift, other.shift))
    same = one.speeds == other.speeds and one.external == other.external
    return same and all(equal(a, b) for a, b in pairs)


def slots_of(move: Move, state: State, dof: int) -> tuple[tuple[SpeedSlot, ...], str]:
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


def acceleration_of(move: Move, state: State) -> float | None:
    """Of a move in its measure's unit per second; None: the joints'."""
    if move.acceleration is not None:
        return move.acceleration
    slot = state.speeds.get("acceleration tool") if move.measure == "tool" else None
    return slot.value * slot.factor if slot is not None and slot.value else None


def blend_of(move: Move, state: State) -> float:
    """How far before its target a move goes over into the next [m]; infinite: not known, half of the way at most.

    It is a distance of the tool: of an unknown one it is not known.
    """
    slot, blend = state.speeds.get("blend"), move.blend
    if blend is None:
        blend = math.inf if slot is None or slot.value is None else slot.value * slot.factor
    return math.inf if blend > 0 and state.tool is None else blend
