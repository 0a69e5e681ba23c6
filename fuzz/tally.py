"""How many files a reader has had, over as many runs as it took."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, field
from pathlib import Path

from bumpstop.output_files import write_bytes


@dataclass
class Tally:
    """Of one target and one seed.

    Attributes:
        executions: files that were read, with the numbers from 0 up to this one.
        read: of them without an error.
        rejected: of them by an ``InputError``.
        found: the rest.
        kinds: of findings, with the file of the first of each.
    """

    executions: int = 0
    read: int = 0
    rejected: int = 0
    found: int = 0
    kinds: dict[str, str] = field(default_factory=dict)


@dataclass
class Tallies:
    """Of all targets and seeds.

    Attributes:
        path: of the file that keeps them; None: nothing does.
        by_key: target and seed, as the file names them.
    """

    path: Path | None
    by_key: dict[str, Tally] = field(default_factory=dict)

    @classmethod
    def load(cls, path: Path | None) -> Tallies:
        """Those of a file, or none where there is no such file yet."""
        if path is None or not path.exists():
            return cls(path)
        return cls(path, {key: Tally(**one) for key, one in json.loads(path.read_text(encoding="utf-8")).items()})

    def of(self, name: str, seed: int) -> Tally:
        """The tally of a target and a seed, which may be changed."""
        return self.by_key.setdefault(f"{name} {seed}", Tally())

    def save(self) -> None:
        """Write the file, whole or not at all."""
        if self.path is not None:
            write_bytes(
                self.path, json.dumps({key: asdict(one) for key, one in self.by_key.items()}, indent=1).encode()
            )
