"""What a program is read into: moves, settings, calls, loops and branches, whatever its language."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Literal

from bumpstop.program.languages.expression import Expression
from bumpstop.program.languages.syntax import Edit
from bumpstop.rounding import rounded

MIN_TIME_S = 0.2  # of a move whose time is given: two ramps of its acceleration leave some
Jump = Literal["loop", "round", "function", "program", "cycle"]
Measure = Literal["tool", "joint", "axes"]
Frame = Literal["tool", "base", "shift"]


@dataclass(frozen=True)
class SpeedSlot:
    """A place of the program that says how fast moves go.

    Attributes:
        start, end: of the bytes of its value; the same where there is none yet.
        value: as the program writes it; None where it is not known before the program runs.
        template: what is written there, with ``{}`` for the number.
        most: greatest value that the language takes; of a time the least.
        unit: as people read it.
        factor: of the value to SI.
        setting: it holds for all moves that follow, not for one.
        whole: the language takes whole numbers.
        time: it is the time that the move takes [s], not a speed.
        shown: first and last byte of comments that show its value, and from which a teach pendant may write it anew.
    """

    start: int
    end: int
    value: float | None
    template: str = "{}"
    most: float = 1e9
    unit: str = ""
    factor: float = 1.0
    setting: bool = False
    whole: bool = False
    time: bool = False
    shown: tuple[tuple[int, int], ...] = ()

    def scaled(self, value: float, factor: float) -> float:
        """What stands for a value at so many times its speed."""
        return value / factor if self.time else value * factor

    def headroom(self, value: float) -> float:
        """The greatest factor of a value that the language takes."""
        return value / self.most if self.time else self.most / value

    def rounded(self, value: float) -> str:
        """A value as the language takes it, not faster; of whole numbers 1 at least."""
        if self.time:
            return short(max(value, self.most), up=True)
        value = min(value, self.most)
        return str(max(1, math.floor(value + 1e-9))) if self.whole else short(value)

    def edit(self, value: float) -> Edit:
        """A new value for it."""
        return Edit(self.start, self.end, self.template.format(self.rounded(value)))

    def edits(self, value: float) -> list[Edit]:
        """A new value for it and for the comments that show it."""
        return [self.edit(value), *(Edit(start, end, self.rounded(value)) for start, end in self.shown)]


def short(value: float, *, up: bool = False) -> str:
    """A number of four digits, never above the value, or never below it."""
    if value <= 0:
        return "0"
    # Not every controller reads powers of ten.
    return f"{Decimal(f'{rounded(value, 4, up=up):.4g}'):f}"


@dataclass(frozen=True)
class Target:
    """Where a move goes.

    Attributes:
        joints: positions [rad or m], or None.
        pose: translation [m] and rotation vector [rad] of the tool in the base frame, six numbers, or None.
        why: neither is known; else empty.
        external: external axes that the target names and where they go, in the language's units; None: not known.
        within: least and greatest position of joints, by number from 0, that the target names beside its pose [rad].
        near: joint positions of whose posture a joint move to the pose ends in the nearest, or None [rad or m].
    """

    joints: tuple[float, ...] | None = None
    pose: tuple[float, ...] | None = None
    why: str = ""
    external: tuple[tuple[str, float | None], ...] = ()
    within: tuple[tuple[int, float, float], ...] = ()
    near: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Move:
    """A statement that moves the arm.

    Attributes:
        line: from 1.
        word: the language's own, as the program writes it.
        linear: the tool goes on a straight line, or an arc; else the joints go straight.
        target: where to.
        own: what is set for it alone.
        planner: whose move it is, where a controller has several; moves of two are not blended into each other.
        via: a place on the arc to the target, whose orientation does not count; None: no arc.
        measure: what the speed is of: the tool [m/s], the leading joint [rad/s], or a share of the joints' own limits.
        speed: where its own speed is written; empty where a setting's is in force.
        default: slot for an own speed where nothing says any.
        default_speed: of moves of this kind, in SI; None where the controller knows it alone.
        acceleration: in the measure's unit per second; None: the cell's joint acceleration.
        blend: how far before its target it goes over into the next [m]; infinite: not known; None: as a setting says.
        why: it cannot be judged; else empty.
    """

    line: int
    word: str
    linear: bool
    target: Target
    measure: Measure
    speed: tuple[SpeedSlot, ...] = ()
    default: SpeedSlot | None = None
    default_speed: float | None = None
    acceleration: float | None = None
    blend: float | None = 0.0
    why: str = ""
    via: Target | None = None
    own: tuple[Node, ...] = ()
    planner: str = ""


@dataclass(frozen=True)
class Setting:
    """A statement that sets the speed, acceleration or blend distance of moves that follow.

    Attributes:
        key: ``"tool"``, ``"axes"``, or ``"axes[3]"`` of joint 3; with ``"acceleration "`` before it, that; ``"blend"``.
        slot: where its value is written; None: set to what is not known.
    """

    line: int
    key: str
    slot: SpeedSlot | None


@dataclass(frozen=True)
class Call:
    """A call of a function of the program, without arguments."""

    line: int
    name: str


@dataclass(frozen=True)
class Opaque:
    """What is not understood: left as it is.

    Attributes:
        text: of the statement.
        moves: the arm may be elsewhere afterwards.
        resets: speeds may be others afterwards.
        reframes: what may be another one afterwards, tool, frame or displacement.
        leads: it moves nothing itself, and leads to other statements or comes from them.
    """

    line: int
    text: str
    moves: bool = True
    resets: bool = False
    reframes: tuple[Frame, ...] = ()
    leads: bool = False


@dataclass(frozen=True)
class Frames:
    """The tool or the frame of poses changes, or their displacement in it.

    Attributes:
        pose: of the tool in the flange, of the frame in the base, or of the displacement in the frame: translation [m]
            and rotation vector [rad]; None: not known, nor are targets given as poses from here on.
    """

    line: int
    which: Frame
    pose: tuple[float, ...] | None


@dataclass(frozen=True)
class Loop:
    """Statements that are run again and again.

    Attributes:
        certain: they are run once at least.
        endless: only a jump leaves it.
    """

    line: int
    body: tuple[Node, ...]
    certain: bool = False
    endless: bool = False


@dataclass(frozen=True)
class Branch:
    """Statements of which one group or none is run."""

    line: int
    bodies: tuple[tuple[Node, ...], ...]


@dataclass(frozen=True)
class Leave:
    """A jump out of the innermost loop, to its next round, out of the function, or to the program's end or begin."""

    line: int
    what: Jump


@dataclass(frozen=True)
class Wait:
    """The program goes no further for a while: a move before it may end at its target, blended or not."""

    line: int


Node = Move | Setting | Call | Opaque | Frames | Loop | Branch | Leave | Wait


@dataclass(frozen=True)
class ReadProgram:
    """What a reader understood of a program.

    Attributes:
        language: as people call it.
        source: the bytes.
        functions: bodies by name; the main part may have the empty name.
        not_understood: lines and their text.
        notes: what was taken for granted.
        main: the function that the program begins with, whose start is the cell's; None: not known which.
        frames: what the language's statements and functions set, of tool, frame and displacement.
        cycles: where it ends the controller may begin it again.
        skips_overlaps: its controller skips a move whose blend reaches into another one.
    """

    language: str
    source: bytes
    functions: Mapping[str, tuple[Node, ...]]
    not_understood: tuple[tuple[int, str], ...] = ()
    notes: tuple[str, ...] = ()
    constants: Mapping[str, Expression] = field(default_factory=dict)
    main: str | None = ""
    frames: tuple[Frame, ...] = ()
    cycles: bool = False
    skips_overlaps: bool = False
