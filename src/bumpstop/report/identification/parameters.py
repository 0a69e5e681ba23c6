"""The parameters of a fit with their errors, and what its recordings were, on its page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.report.markup import Html, bullets, paragraph, table
from bumpstop.report.section import Part
from bumpstop.terminal import number

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bumpstop.identification.fit import Quantity

_TOLD = 2.0  # standard errors from zero


class ParametersPart(Part):
    """Value, standard error and unit of every parameter."""

    title = "Parameters"
    anchor = "parameters"

    def __init__(
        self,
        parameters: Mapping[str, Quantity],
        standard_errors: Mapping[str, float | None],
        unobservable: Sequence[str] = (),
    ) -> None:
        self._parameters, self._errors, self._unobservable = parameters, standard_errors, unobservable

    def content(self) -> list[Html]:
        """One row for each, and what the motion did not show."""
        rows = [
            (name, *self._figures(found.value, self._errors[name]), "" if found.unit == "1" else found.unit)
            for name, found in self._parameters.items()
        ]
        found = [
            paragraph(
                "Standard errors hold where residuals are correlated in time and between joints. A parameter that is "
                f"less than {_TOLD:g} of them from zero is not distinguishable from it."
            ),
            table(("parameter", "value", "standard error", "unit"), rows, caption="Parameters", numbers=True),
        ]
        if self._unobservable:
            found.append(paragraph(f"Not visible in this motion: {', '.join(self._unobservable)}."))
        return found

    @staticmethod
    def _figures(value: float | None, error: float | None) -> tuple[str, str]:
        if value is None:
            return "not seen", ""
        if error is None:
            return number(value), "not known"
        return number(value), "given" if error == 0 else f"{error:.2g}"


class RecordingsPart(Part):
    """Rows that were used, dropped and noted."""

    title = "Recordings"
    anchor = "recordings"

    def __init__(self, lines: Sequence[str]) -> None:
        self._lines = lines

    def applies(self) -> bool:
        """Where there is anything to say."""
        return bool(self._lines)

    def content(self) -> list[Html]:
        """A line each."""
        return [bullets([line.removeprefix("note: ") for line in self._lines])]
