"""What every study has in common: settings, numbered shards, and a summary."""

from __future__ import annotations

import hashlib
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bumpstop import _native
from bumpstop.collision.scenario.scenario import Scenario
from bumpstop.collision.scenario.settings_file import files_of, scenario_data
from bumpstop.errors import InputError

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
class Study(ABC):
    """A question asked of many distributions, whose rows come in numbered shards.

    A shard is a pure function of the study's fields and its number: it may be computed on any thread, process or
    machine, in any order, and again after a loss. Fields are plain values, so that a study can be sent anywhere.

    Attributes:
        scenario: what all distributions share.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    batch_size: ClassVar[int] = 1
    """Shards that are computed sooner in one go than one by one, at most."""

    scenario: Scenario

    @property
    @abstractmethod
    def shards(self) -> int:
        """Number of shards."""

    @abstractmethod
    def shard(self, number: int) -> pl.DataFrame:
        """Rows of one shard, counted from 0; every shard has the same columns."""

    def shard_batch(self, numbers: Sequence[int]) -> list[pl.DataFrame]:
        """Rows of several shards: the same bits as of each by itself."""
        return [self.shard(number) for number in numbers]

    @abstractmethod
    def summary(self, rows: pl.DataFrame) -> dict[str, Any]:
        """What the rows of all shards say, as the object of ``--json``; a pure function of study and rows.

        Numbers that are not finite may stand in it: :func:`to_jsonable` makes them None.
        """

    @abstractmethod
    def lines(self, summary: Mapping[str, Any]) -> list[str]:
        """What a person reads of a summary on the terminal."""

    def settings(self) -> dict[str, Any]:
        """Everything but the scenario that decides the rows, by the names of the fields."""
        return {
            field.name: to_jsonable(getattr(self, field.name)) for field in fields(self) if field.name != "scenario"
        }

    def fingerprint(self) -> str:
        """Differs where rows may differ: scenario, files it names, settings, code, versions, instruction set."""
        files = {
            key: hashlib.sha256(path.read_bytes()).hexdigest() for key, path in sorted(files_of(self.scenario).items())
        }
        return _digest(
            [self.name, scenario_data(self.scenario), files, self.settings(), code_digest(), *versions().values()]
        )


def versions() -> dict[str, str]:
    """What computes the rows, by name."""
    import platform

    return {
        "bumpstop": version("bumpstop"),
        "numpy": version("numpy"),
        "python": platform.python_version(),
        "instruction_set": _native.target,
    }


@lru_cache(maxsize=1)
def code_digest() -> str:
    """Digest of the package's own files: rows of two builds are not mixed even where the version is the same."""
    home = Path(__file__).resolve().parents[1]
    digest = hashlib.sha256()
    files = [path for path in home.rglob("*") if path.suffix in (".py", ".toml")]
    for path in [*sorted(files), Path(str(_native.module.__file__))]:
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def to_jsonable(value: Any) -> Any:
    """The same as JSON can hold it: arrays as lists, what is not finite as None."""
    if isinstance(value, Mapping):
        return {str(key): to_jsonable(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return to_jsonable(value.tolist())
    if isinstance(value, list | tuple):
        return [to_jsonable(item) for item in value]
    if isinstance(value, np.generic):
        return to_jsonable(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value.to_json() if hasattr(value, "to_json") else value


def _digest(value: Any) -> str:
    # Infinite thresholds are no JSON, but they tell one scenario from another.
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()
