"""The answer of a monitor to an alarm: told to the robot on the connection that its samples come by."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol, cast, get_args

from bumpstop.errors import InputError, near_matches

if TYPE_CHECKING:
    from bumpstop.live.output import CollisionAlarm, DataLoss, MonitorTick
    from bumpstop.live.source import SourceEvent

Answer = Literal["none", "stop", "reverse"]
ANSWERS: tuple[Answer, ...] = get_args(Answer)


class AnsweringSource(Protocol):
    """What a source has beside reading, if it can tell its robot what to do."""

    def answer(self, answer: Answer, number: int) -> None:
        """Tell the robot at once, without waiting for it.

        Args:
            answer: what the arm shall do; ``"none"``: go on.
            number: of the alarm, from 1.
        """


class AnswerOutput:
    """Answers every alarm; the answer stands until the detector monitors again.

    Args:
        source: that was made to answer.
        answer: ``"stop"`` or ``"reverse"``.

    Raises:
        InputError: another answer, or a source that cannot.
    """

    def __init__(self, source: object, answer: str) -> None:
        if answer not in ANSWERS[1:]:
            raise InputError("--answer", f"{answer!r} is none", near_matches(str(answer), ANSWERS[1:]))
        if not hasattr(source, "answer"):
            raise InputError("--answer", "has no meaning with this source", "leave it out")
        self._source, self._answer = cast(AnsweringSource, source), answer
        self._standing = 0

    def alarm(self, alarm: CollisionAlarm) -> None:
        """Answer."""
        self._source.answer(self._answer, alarm.number)
        self._standing = alarm.number

    def tick(self, tick: MonitorTick) -> None:
        """Take the answer back once the detector monitors again."""
        if self._standing and tick.state == "monitoring":
            self._source.answer("none", self._standing)
            self._standing = 0

    def data_loss(self, loss: DataLoss) -> None:
        """Nothing to answer: a standing answer stays."""

    def source_event(self, event: SourceEvent, received_s: float) -> None:
        """Nothing to answer."""

    def flush(self, now_s: float) -> None:
        """Nothing is held back."""

    def problems(self) -> list[str]:
        """None: a source that cannot answer says so in its events."""
        return []

    def close(self) -> None:
        """Leave the last answer as it is: a robot that has stopped stays so."""
