"""Parameters of any fit for programs."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bumpstop.identification import Fit


def parameters_json(fit: Fit) -> dict[str, dict[str, float | None]]:
    """Value and standard error of every parameter by its name; null where the recordings do not show it."""
    return {
        name: {"value": found.value, "standard_error": None if found.value is None else fit.standard_errors[name]}
        for name, found in fit.parameters.items()
    }
