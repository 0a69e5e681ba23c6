"""Results that show themselves: as a figure, and in a notebook as text with that figure."""

from __future__ import annotations

import html
import io
from abc import abstractmethod
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes

# Okabe and Ito's colours, those of the pages.
CURVE, LIMIT, EVENT, FAINT, ASSUMED = "#0072B2", "#D55E00", "#009E73", "#767676", "#E69F00"
_MAX_PARAMETERS = 40  # in a figure: more are a smear


class Displayed:
    """A result with a figure of its own. ``str`` says the same in words."""

    def plot(self, axes: Axes | None = None) -> Axes:
        """Draw the result.

        Args:
            axes: to draw into; None makes a figure by pyplot.

        Returns:
            The axes, to be changed or saved: ``result.plot().figure.savefig("result.png")``.
        """
        if axes is None:
            import matplotlib.pyplot as plt

            axes = plt.subplots(layout="constrained")[1]
        self._draw(axes)
        return axes

    @abstractmethod
    def _draw(self, axes: Axes) -> None:
        """Draw into axes."""

    def _repr_html_(self) -> str:
        """Text and figure, for a notebook."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
        self._draw(figure.add_subplot())
        drawing = io.StringIO()
        figure.savefig(drawing, format="svg", metadata=dict.fromkeys(("Date", "Creator", "Format", "Type")))
        svg = drawing.getvalue()
        return f"<div><pre>{html.escape(str(self))}</pre>{svg[svg.index('<svg') :]}</div>"


def draw_parameters(axes: Axes, values: Mapping[str, Any], errors: Mapping[str, float | None]) -> None:
    """Draw how many standard errors each parameter is from zero, those best known first.

    Args:
        axes: to draw into.
        values: parameters by name.
        errors: standard errors of the same names; a parameter without one, or that was given, is left out.

    Raises:
        InputError: no parameter has a standard error.
    """
    known = {name: abs(_value(values[name]) or 0.0) / error for name, error in errors.items() if error}
    if not known:
        raise InputError("plot", "no parameter of the fit has a standard error", "wanted a fit to a recording")
    best = sorted(known, key=lambda name: -known[name])[:_MAX_PARAMETERS]
    axes.barh(best, [known[name] for name in best], color=CURVE)
    axes.axvline(2, color=LIMIT)
    axes.invert_yaxis()
    axes.set_xscale("symlog", linthresh=1)
    axes.tick_params(axis="y", labelsize="x-small")
    left_out = f"; {len(known) - len(best)} more" if len(known) > len(best) else ""
    axes.set_xlabel(f"size over standard error (2: told from zero{left_out})")


def parameter_frame(parameters: Mapping[str, Any], errors: Mapping[str, float | None]) -> pl.DataFrame:
    """Data frame with a row for each parameter of a fit: ``name``, ``value``, ``standard_error``."""
    import polars as pl

    rows = [(name, _value(one), errors.get(name)) for name, one in parameters.items()]
    schema = {"name": pl.String, "value": pl.Float64, "standard_error": pl.Float64}
    return pl.DataFrame(rows, schema=schema, orient="row")


def _value(quantity: Any) -> float | None:
    value = getattr(quantity, "value", quantity)
    return None if value is None else float(value)
