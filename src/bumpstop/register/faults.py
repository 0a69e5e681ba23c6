"""Every fault of a register, told at once."""

from __future__ import annotations

from collections.abc import Sequence

from bumpstop.errors import InputError


class RegisterError(InputError):
    """A register that cannot be evaluated; it names the faults of all of its rows.

    Attributes:
        faults: one for each key of a row that cannot be used, in the order of the rows.
    """

    def __init__(self, file: str, faults: Sequence[InputError]) -> None:
        self.faults = tuple(faults)
        count = len(self.faults)
        super().__init__(
            file,
            f"{count} {'entry' if count == 1 else 'entries'} cannot be used",
            "no situation is evaluated until all can be",
        )

    def __str__(self) -> str:
        return "\n".join([super().__str__(), *(f"  {fault}" for fault in self.faults)])

    def __reduce__(self) -> tuple[type[InputError], tuple[str, tuple[InputError, ...]]]:  # type: ignore[override]
        """Pickled by its parts."""
        return type(self), (self.field, self.faults)
