"""Programs as files: what is read from them, and the same files with new speeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from bumpstop.errors import InputError
from bumpstop.output_files import write_bytes
from bumpstop.program.interpreter import Interpreter
from bumpstop.program.languages.blocks import moves_unseen
from bumpstop.program.languages.statements import SpeedSlot
from bumpstop.program.languages.syntax import edited
from bumpstop.program.segment import MoveSegment, Segment

if TYPE_CHECKING:
    from bumpstop.program.cell import Cell
    from bumpstop.program.languages.statements import ReadProgram

_MAX_BYTES = 5_000_000
_URSCRIPT, _KRL, _RAPID = (".script", ".urscript"), (".src",), (".mod", ".modx", ".prg", ".sys")
_MESSAGES = (".yaml", ".yml", ".json")
_CONFIG = "$config"


class Source(Protocol):
    """A program."""

    @property
    def language(self) -> str:
        """As people call it."""
        ...

    @property
    def segments(self) -> Sequence[Segment]:
        """In the order of the file."""
        ...

    @property
    def not_understood(self) -> Sequence[tuple[int, str]]:
        """Lines and their text."""
        ...

    @property
    def moves_unseen(self) -> bool:
        """Something that is not understood may move the arm."""
        ...

    @property
    def notes(self) -> Sequence[str]:
        """What was taken for granted."""
        ...

    def file_name(self, path: Path) -> str:
        """Of what is written."""
        ...

    def may_be_raised(self, place: object) -> bool:
        """Whether all that a place makes faster is known."""
        ...

    def write(self, factors: Mapping[Segment, float], target: Path) -> None:
        """Write it to a path with the speeds of segments multiplied."""
        ...


@dataclass(frozen=True, eq=False)
class TextProgram:
    """A program in a robot's language."""

    read: ReadProgram
    segments: Sequence[MoveSegment]
    still: Sequence[int] = ()

    @property
    def language(self) -> str:  # noqa: D102
        return self.read.language

    @property
    def not_understood(self) -> Sequence[tuple[int, str]]:  # noqa: D102
        return self.read.not_understood

    @property
    def moves_unseen(self) -> bool:  # noqa: D102
        return any(moves_unseen(body) for body in self.read.functions.values())

    @property
    def notes(self) -> Sequence[str]:  # noqa: D102
        lines = ", ".join(str(line) for line in self.still)
        return (*self.read.notes, *([f"line {lines}: the arm is at its target already"] if lines else []))

    def file_name(self, path: Path) -> str:  # noqa: D102
        return path.name

    def may_be_raised(self, place: object) -> bool:  # noqa: D102
        if not isinstance(place, SpeedSlot) or not place.setting:
            return True
        # What is not understood may move by a setting, too, and what cannot be judged by one of several.
        return not self.not_understood and not any(one.why and one.may_obey(place) for one in self.segments)

    def write(self, factors: Mapping[Segment, float], target: Path) -> None:  # noqa: D102
        write_bytes(target, self.written(factors))

    def written(self, factors: Mapping[Segment, float]) -> bytes:
        """The program with other speeds."""
        edits = []
        for segment in self.segments:
            factor = factors.get(segment)
            # A speed that the program did not say is written even where it is the first that was tried.
            if factor is not None and (factor != 1.0 or not segment.speed_known):
                edits += [one for slot in segment.places() for one in slot.edits(segment.new_value(slot, factor))]
        return edited(self.read.source, edits)


def read_source(
    path: Path, cell: Cell, max_speed: float, *, columns: Path | None = None, topic: str | None = None
) -> Source:
    """Read a program, a trajectory or a recording by its name's ending.

    Args:
        path: of the file; of a bag also its folder.
        cell: whose robot it is for.
        max_speed: what is tried first where a program does not say how fast the tool goes [m/s].
        columns: of a recording: its column file.
        topic: of a recording: that of a bag with several.

    Raises:
        InputError: it cannot be read, or holds no motion; or what is for recordings is given of something else.
    """
    if not path.exists():
        raise InputError(str(path), "there is no such file", "wanted a program, a trajectory or a recording")
    source = _commanded(path, cell, max_speed)
    if source is None:
        from bumpstop.program.trajectories.recorded import read_recorded
        from bumpstop.recording.reading import ENDINGS

        if columns is None and path.is_file() and path.suffix.lower() not in ENDINGS:
            known = ", ".join(dict.fromkeys((*_URSCRIPT, *_KRL, *_RAPID, *_MESSAGES, *ENDINGS)))
            valid = f"valid: {known}, or --columns with the format of a recording"
            raise InputError(str(path), f"{path.suffix!r} is no known ending", valid)
        return read_recorded(path, cell, columns=columns, topic=topic)
    for option, given in (("--columns", columns), ("--topic", topic)):
        if given is not None:
            raise InputError(option, "has no meaning without a recording", "leave it out, or name a recording")
    return source


def _commanded(path: Path, cell: Cell, max_speed: float) -> Source | None:
    """What an arm is told to do; None of a recording."""
    ending = path.suffix.lower()
    if ending in (*_URSCRIPT, *_KRL, *_RAPID) and not path.is_dir():
        return _text_program(path, ending, cell, max_speed)
    if ending == ".dat":
        raise InputError(str(path), "holds data of a KRL program, and no moves", "give the .src beside it")
    if ending in _MESSAGES and not path.is_dir():
        from bumpstop.program.trajectories.messages import read_messages

        return read_messages(path, read_bytes(path), cell)
    from bumpstop.program.trajectories.bag import holds_trajectories, read_bag_trajectories

    if holds_trajectories(path):
        return read_bag_trajectories(path, cell)
    return None


def _text_program(path: Path, ending: str, cell: Cell, max_speed: float) -> TextProgram:
    read = _read(path, ending)
    interpreter = Interpreter(read, cell.robot, cell.start, str(path))
    chains = interpreter.chains()
    every = [MoveSegment(chain, cell.robot, cell.joint_acceleration, max_speed) for chain in chains]
    if not every:
        raise InputError(str(path), f"has no move that is understood as {read.language}", "see docs/how_to/program.md")
    still = sorted({segment.lines[0] for segment in every if segment.still})
    moving = sorted((segment for segment in every if not segment.still), key=lambda segment: segment.lines)
    return TextProgram(replace(read, notes=(*read.notes, *interpreter.notes)), moving, still)


def _read(path: Path, ending: str) -> ReadProgram:
    source = read_bytes(path)
    if ending in _URSCRIPT:
        from bumpstop.program.languages.urscript import read_urscript

        return read_urscript(source)
    if ending in _RAPID:
        from bumpstop.program.languages.rapid import read_rapid

        return read_rapid(source)
    from bumpstop.program.languages.krl import read_krl

    data = {other.stem.lower(): read_bytes(other) for other in data_beside(path)}
    return read_krl(source, data.get(path.stem.lower(), b""), data.get(_CONFIG, b""))


def data_beside(path: Path) -> list[Path]:
    """The ``.dat`` and the controller's ``$config.dat`` beside a KRL program, where they are; of nothing else any."""
    if path.suffix.lower() not in _KRL:
        return []
    stems = path.stem.lower(), _CONFIG
    files = {other.stem.lower(): other for other in path.parent.iterdir() if other.suffix.lower() == ".dat"}
    return [files[stem] for stem in stems if stem in files]


def read_bytes(path: Path) -> bytes:
    """The bytes of a program.

    Raises:
        InputError: it cannot be read, or is too long.
    """
    try:
        with path.open("rb") as file:
            content = file.read(_MAX_BYTES + 1)
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({error.strerror or error})", "wanted a program") from None
    if len(content) > _MAX_BYTES:
        raise InputError(str(path), f"is longer than {_MAX_BYTES} bytes", "wanted a program")
    return content
