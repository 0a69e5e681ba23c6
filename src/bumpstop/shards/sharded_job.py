"""What all work in shards has in common: settings, numbered shards, and a summary."""

from __future__ import annotations

import hashlib
import json
import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bumpstop import _native

if TYPE_CHECKING:
    import polars as pl


class ShardedJob(ABC):
    """Rows that come in numbered shards.

    A shard is a pure function of the job's fields and its number: it may be computed on any thread, process or
    machine, in any order, and again after a loss. Fields are plain values, so that a job can be sent anywhere.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    batch_size: ClassVar[int] = 1
    """Shards that are computed sooner in one go than one by one, at most."""
    volume_shards: ClassVar[int] = 0
    """Shards whose rows make one file of the result; 0: all of them."""

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
    def summarise(self, volumes: Iterable[pl.DataFrame]) -> dict[str, Any]:
        """What all rows say, as the object of ``--json``; a pure function of job and rows.

        Numbers that are not finite may stand in it: :func:`to_jsonable` makes them None.

        Args:
            volumes: the rows, in order, some shards at a time.
        """

    @abstractmethod
    def lines(self, summary: Mapping[str, Any]) -> list[str]:
        """What a person reads of a summary on the terminal, but for its notes."""

    def text(self, summary: Mapping[str, Any]) -> str:
        """All that a person reads of a summary: its lines, then its ``notes``."""
        return "\n".join([*self.lines(summary), *(f"note: {note}" for note in summary.get("notes", []))])

    @abstractmethod
    def settings(self) -> dict[str, Any]:
        """What decides the rows besides :meth:`document`, by name; plain values."""

    @abstractmethod
    def document(self) -> tuple[str, dict[str, Any]]:
        """What the settings file is (``"A scenario"``), and its tables."""

    @abstractmethod
    def fingerprint(self) -> str:
        """Differs where rows may differ: files, settings, code, versions, instruction set."""


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
    found = hashlib.sha256()
    files = [path for path in home.rglob("*") if path.suffix in (".py", ".toml")]
    for path in [*sorted(files), Path(str(_native.module.__file__))]:
        found.update(path.name.encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


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


def digest(value: Any) -> str:
    """SHA-256 of plain values, whatever the order of keys."""
    # Infinite thresholds are no JSON, but they tell one scenario from another.
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()
