"""Residuals that thresholds were tuned on, as the noise of scenarios."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from bumpstop.detection.tuning.found_with import SAME_GAIN

if TYPE_CHECKING:
    from bumpstop.collision import Scenario
    from bumpstop.detection import ResidualSeries

_SAME_PERIOD = 0.01  # what measured residuals of a scenario may differ from its feedback period


class ScenarioNoise:
    """Residuals as files that scenarios take as their noise, for as long as the context lasts.

    Attributes:
        period: between their rows [s].
    """

    def __init__(self, series: Sequence[ResidualSeries]) -> None:
        self.period = series[0].period
        # Of those that say it: they are of one kind.
        self._found: Mapping[str, Any] = next((one.found_with for one in series if one.found_with), {})
        self._series = series
        self._folder = TemporaryDirectory(prefix="bumpstop-")

    def __enter__(self) -> ScenarioNoise:
        return self

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()

    def why_not(self, scenario: Scenario) -> str | None:
        """Why a scenario keeps its own noise; None: it does not."""
        detector = scenario.detector
        kept = "its own noise is kept, and its alarms are not those of the rates here."
        if self._stride(detector.feedback_period_s) is None:
            return (
                f"its feedback period is {detector.feedback_period_s:g} s, and the thresholds were found at "
                f"{self.period:.4g} s: {kept}"
            )
        residual = self._found.get("residual", detector.residual)
        if residual != detector.residual:
            return f"its residual is {detector.residual!r}, and the thresholds were found for {residual!r}: {kept}"
        own = detector.observer_gain_1_s
        gain = self._found.get("observer_gain_1_s", own)
        if residual == "observer" and abs(gain - own) > SAME_GAIN * gain:
            return f"its observer has {own:g} 1/s, and the thresholds were found for {gain:g}: {kept}"
        return None

    def of(self, scenario: Scenario) -> Scenario:
        """A scenario with these residuals as its noise, or the scenario itself where they do not fit it."""
        import numpy as np

        from bumpstop.collision import Scenario
        from bumpstop.collision.scenario.keys import leave_out
        from bumpstop.detection.tuning.residual_record import write_residuals

        period = scenario.detector.feedback_period_s
        stride = self._stride(period)
        if stride is None or self.why_not(scenario):
            return scenario
        path = Path(self._folder.name).resolve() / f"{stride}-{period!r}.parquet"
        if not path.exists():
            # Rows are resampled in blocks: where one recording ends and the next begins is a seam like others.
            rows = np.concatenate([one.rows[::stride] for one in self._series])
            write_residuals(path, np.arange(len(rows), dtype=np.float64) * period, rows)
        data = scenario.to_dict()
        leave_out(data, [f"detector.{key}" for key in ("noise_sd_Nm", "noise_mean_Nm", "noise_correlation")])
        data["detector"]["residuals"] = str(path)
        return Scenario.from_dict(data, scenario.folder)

    def _stride(self, feedback_period_s: float) -> int | None:
        """Rows of a feedback period; None: it is not a whole number of them."""
        stride = max(1, round(feedback_period_s / self.period))
        near = abs(stride * self.period - feedback_period_s) <= _SAME_PERIOD * feedback_period_s
        return stride if near else None
