"""Every fault of a register, told at once."""

from __future__ import annotations

from collections.abc import Sequence

from bumpstop.errors import InputError


class RegisterError(InputError):
    """A register that cannot be evaluated; it names the faults of all of its rows, and a single one in its own words.

    Attributes:
        faults: one for each key of a row that cannot be used, in the order of the rows.
    """

    def __init__(self, file: str, faults: Sequence[InputError]) -> None:
        self.faults = tuple(faults)
        self._file = file
        first, *others = self.faults
        if others:
            problem = f"{len(self.faults)} entries cannot be used"
            super().__init__(file, problem, "no situation is evaluated until all can be")
        else:
            super().__init__(first.field, first.problem, first.valid)

    def __str__(self) -> str:
        listed = [f"  {fault}" for fault in self.faults] if len(self.faults) > 1 else []
        return "\n".join([super().__str__(), *listed])

    def __reduce__(self) -> tuple[type[InputError], tuple[str, tuple[InputError, ...]]]:  # type: ignore[override]
        """Pickled by its parts."""
        return type(self), (self._file, self.faults)
