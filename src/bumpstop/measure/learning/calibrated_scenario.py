"""Scenarios that carry what was learned: values, and how sure they are in ``[uncertainty]``."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision.scenario.keys import drop_assumed, set_key
from bumpstop.collision.scenario.settings_file import scenario_data
from bumpstop.measure.parameters import CONTACT, has_key, nominal
from bumpstop.measure.planning.gauge import gauge_of
from bumpstop.register.situation import says
from bumpstop.text_files import to_toml

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario
    from bumpstop.measure.learning.calibration import Calibration, FoundParameter

_DIGITS = 6
# A normal latency must not reach below zero.
_CLEAR_OF_ZERO = 2.0


def calibrated_values(calibration: Calibration, scenario: Scenario) -> dict[str, Any]:
    """Dotted keys of a scenario with their medians after the shots.

    Also those that the shots do not tell by themselves: only together do the medians give the measured forces.
    """
    parameters = calibration.parameters
    z = np.median(calibration.posterior.z, axis=0)
    values: dict[str, Any] = {}
    for found in calibration.found:
        if not _carried(calibration, found, scenario):
            continue
        index = parameters.index(found.key)
        values[found.key] = _rounded(parameters.each[index].changed(nominal(scenario, found.key), float(z[index])))
    return values


def uncertainty(calibration: Calibration, scenario: Scenario) -> dict[str, dict[str, Any]]:
    """The table ``[uncertainty]``: a distribution by dotted key, assumed where the shots do not tell.

    A factor is lognormal about the value that the scenario gives. A latency is normal, or uniform over its central 95 %
    where it may be zero. How parameters go together is not in it.
    """
    table: dict[str, dict[str, Any]] = {}
    for found in calibration.found:
        if not _carried(calibration, found, scenario):
            continue
        entry: dict[str, Any]
        if found.kind == "factor":
            entry = {"distribution": "lognormal", "sigma": _rounded(found.sd)}
        else:
            given = float(nominal(scenario, found.key))
            middle = max(0.0, given + found.median)
            if middle > _CLEAR_OF_ZERO * found.sd:
                entry = {"distribution": "normal", "mean": _rounded(middle), "sd": _rounded(found.sd)}
            else:
                low, high = max(0.0, given + found.low), max(0.0, given + found.high)
                entry = {"distribution": "uniform", "low": _rounded(low), "high": _rounded(max(high, low + found.sd))}
        table[found.key] = entry if found.shown else entry | {"assumed": True}
    return table


def calibrated_toml(calibration: Calibration, scenario: Scenario) -> str:
    """The scenario with what was learned, as a file, and a comment for each key that changed."""
    data = scenario_data(scenario)
    learned = uncertainty(calibration, scenario)
    # What was said before of other keys stays; of items of a learned list, or of its other spelling, it does not.
    before = data.pop("uncertainty", {}).items()
    spread = {key: entry for key, entry in before if not says(learned, key.partition("[")[0])} | learned
    values = calibrated_values(calibration, scenario)
    lines = ["# Calibrated by measured peak forces. Values are medians; [uncertainty] has their spread."]
    lines += [f"# WARNING: {warning}" for warning in calibration.warnings]
    for found in calibration.found:
        sure = f"factor {found.median:.3g} [{found.low:.3g}, {found.high:.3g}]"
        if found.kind == "shift":
            sure = f"{1e3 * found.median:+.3g} ms [{1e3 * found.low:+.3g}, {1e3 * found.high:+.3g}]"
        if not _carried(calibration, found, scenario):
            where = "of the gauge's pad" if found.key == CONTACT else "of other situations"
            lines.append(f"# {found.key}: {where}, {sure}; no key of this scenario")
        elif found.shown:
            lines.append(f"# {found.key}: measured, {sure}")
        else:
            lines.append(f"# {found.key}: still assumed, moved with the others, {sure}")
    for key, value in values.items():
        set_key(data, key, value)
    drop_assumed(data, [found.key for found in calibration.found if found.shown])
    return "\n".join(lines) + "\n" + to_toml(data) + "\n[uncertainty]\n" + _inline(spread)


def _carried(calibration: Calibration, found: FoundParameter, scenario: Scenario) -> bool:
    """Whether the scenario has a place for it: the pad of a gauge is none of a body, also of one with a stiffness."""
    if not has_key(scenario, found.key):
        return False
    conditions = calibration.ensemble.conditions
    own = gauge_of(scenario).is_own and any(condition.situation.gauge.is_own for condition in conditions)
    return found.key != CONTACT or own


def _inline(table: dict[str, dict[str, Any]]) -> str:
    from bumpstop.text_files import toml_value

    lines = []
    for key, entry in table.items():
        inside = ", ".join(f"{name} = {toml_value(value)}" for name, value in entry.items())
        lines.append(f'"{key}" = {{ {inside} }}\n')
    return "".join(lines)


def _rounded(value: Any) -> Any:
    if isinstance(value, list | tuple):
        return [_rounded(each) for each in value]
    value = float(value)
    return value if not np.isfinite(value) else float(f"{value:.{_DIGITS}g}")
