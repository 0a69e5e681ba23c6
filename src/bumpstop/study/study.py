"""What every study has in common: a scenario, settings, and a summary of all rows."""

from __future__ import annotations

import hashlib
from abc import abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Any

from bumpstop.collision.scenario.scenario import Scenario
from bumpstop.collision.scenario.settings_file import files_of, scenario_data
from bumpstop.collision.verdict.as_given import doubts_as_given
from bumpstop.collision.verdict.finer_steps import fails_with_finer_steps
from bumpstop.errors import InputError
from bumpstop.shards import ShardedJob, code_digest, digest, to_jsonable, versions
from bumpstop.study.answer_warnings import AnswerWarnings, told_once

if TYPE_CHECKING:
    import polars as pl


# Of quantiles: 1 less a smaller risk has no digits left.
MIN_RISK = 1e-13


def check_risk(scenario: Scenario) -> None:
    """Refuse a risk whose quantile a double cannot hold.

    Raises:
        InputError: verdict.accepted_probability is too small.
    """
    risk = scenario.verdict.accepted_probability
    if risk < MIN_RISK:
        problem = f"{risk:g} is too small for a search by quantiles"
        raise InputError("verdict.accepted_probability", problem, f"wanted at least {MIN_RISK:g}")


@dataclass(frozen=True)
class Study(ShardedJob):
    """A question asked of many distributions, whose rows come in numbered shards.

    Attributes:
        scenario: what all distributions share.
    """

    scenario: Scenario

    @abstractmethod
    def summary(self, rows: pl.DataFrame) -> dict[str, Any]:
        """What the rows of all shards say, as the object of ``--json``; a pure function of study and rows.

        Numbers that are not finite may stand in it: :func:`to_jsonable` makes them None.
        """

    def answer_warnings(self, rows: pl.DataFrame, summary: Mapping[str, Any]) -> list[AnswerWarnings]:
        """What is to be read beside the answers of a summary: of each, or of those that stand for all."""
        return []

    def summarise(self, volumes: Iterable[pl.DataFrame]) -> dict[str, Any]:  # noqa: D102
        import polars as pl

        rows, given = pl.concat(list(volumes)), doubts_as_given(self.scenario)
        summary = self.summary(rows)
        beside = self.answer_warnings(rows, summary)
        summary["fails_with_finer_steps"] = any(fails_with_finer_steps(found.warnings) for found in beside)
        notes = [*given, *told_once(beside, given)]
        return summary | ({"notes": notes} if notes else {})

    def settings(self) -> dict[str, Any]:
        """Everything but the scenario that decides the rows, by the names of the fields."""
        return {
            field.name: to_jsonable(getattr(self, field.name)) for field in fields(self) if field.name != "scenario"
        }

    def document(self) -> tuple[str, dict[str, Any]]:  # noqa: D102
        return "A scenario", scenario_data(self.scenario)

    def fingerprint(self) -> str:
        """Differs where rows may differ: scenario, files it names, settings, code, versions, instruction set."""
        files = {
            key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in sorted(files_of(self.scenario).items())
        }
        return digest(
            [self.name, scenario_data(self.scenario), files, self.settings(), code_digest(), *versions().values()]
        )
