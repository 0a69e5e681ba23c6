"""A register of calibrated scenarios: the situations of a plan under their names, ready for the dossier."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from bumpstop.measure.learning.calibrated_scenario import calibrated_values
from bumpstop.measure.planning.plan_file import REGISTER, inputs_of_register
from bumpstop.register.situation import statements_without
from bumpstop.register.statements import Statement
from bumpstop.text_files import to_toml

if TYPE_CHECKING:
    from bumpstop.measure.learning.calibration import Calibration
    from bumpstop.measure.planning.plan_file import PlanFolder

HEAD = "# Calibrated by measured peak forces: the situations of the plan, each with its calibrated scenario."
"""First line of the file, by which it is known."""


def calibrated_register(calibration: Calibration, plan: PlanFolder, files: Mapping[str, str]) -> str:
    """The register as a file.

    Rows keep what the plan's registers say besides scenarios. Of values that were learned that is no more true, but for
    what keeps a situation from passing; where the shots tell a value, it is identified.

    Args:
        calibration: what the shots say.
        plan: that was filled in.
        files: of the calibrated scenarios, beside the register, by name of the situation.
    """
    learned = {key for _, scenario in plan.named for key in calibrated_values(calibration, scenario)}
    told = {each.key for each in calibration.found if each.shown} & learned
    source = f"{len(calibration.shots)} measured peak forces"
    statements = statements_without(plan.statements, learned)
    statements |= {key: Statement("identified", source) for key in sorted(told)}
    rows: list[dict[str, Any]] = [
        {"name": name, "scenario": files[name], **plan.facts.get(name, {})} for name, _ in plan.named
    ]
    lines = (HEAD, f"# The dossier to file: bumpstop report {REGISTER} --shots shots.csv, with its other options.")
    tables = [("situation", row) for row in rows] + [("input", row) for row in inputs_of_register(statements)]
    # As people write registers: a row can be added to them.
    return "\n".join(lines) + "\n" + "".join(f"\n[[{name}]]\n{to_toml(row)}" for name, row in tables)
