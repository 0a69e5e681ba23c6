"""What every fit of this room gives: its parameters with their errors, what it predicts, how well, and a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple, Protocol, runtime_checkable

if TYPE_CHECKING:
    import os

    from bumpstop.identification.comparison import Comparison, JointScore
    from bumpstop.recording import Recording


class Quantity(NamedTuple):
    """A fitted parameter.

    Attributes:
        value: of it [unit]; None: the recordings do not show it.
        unit: as it is printed, ``"1"`` of what has none.
    """

    value: float | None
    unit: str


@runtime_checkable
class Fit(Protocol):
    """A model and what is known of its parameters.

    Joint models, dynamics (with gains or without), payloads, physically consistent inertias and the protocol of
    Schroeder (2013) are fits. What a detector needs is the model alone: a ``JointTorqueModel`` or a ``DynamicsModel``.
    """

    @property
    def parameters(self) -> Mapping[str, Quantity]:
        """Parameters by name; those of one joint begin with its name (``elbow.B``) or end in its number (``Izz_3``)."""
        ...

    @property
    def standard_errors(self) -> Mapping[str, float | None]:
        """Of the same names, in the same units; None: not known; 0: the parameter was given."""
        ...

    def predict(self, recording: Recording) -> Comparison:
        """What the fit says of a recording, beside what was measured.

        Raises:
            InputError: the recording lacks what is predicted, is of other joints, or too short.
        """
        ...

    def score(self, recording: Recording) -> tuple[JointScore, ...]:
        """How well each joint of a recording is predicted; :meth:`predict`'s errors."""
        ...

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the fit in the format of its kind.

        Raises:
            InputError: the file cannot be written.
        """
        ...
