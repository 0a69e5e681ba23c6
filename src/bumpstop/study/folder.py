"""The folder of a study: settings first, then shards as they are done, in the end rows and summary."""

from __future__ import annotations

import hashlib
import io
import json
import os
import shutil
import tomllib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.collision.scenario.keys import MADE_BY
from bumpstop.collision.scenario.settings_file import scenario_data
from bumpstop.errors import InputError
from bumpstop.study.study import to_jsonable, versions
from bumpstop.text_files import to_toml

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.study.study import Study


# Bytes behind the rows of a shard that say whose they are.
_SEAL_SIZE = hashlib.sha256().digest_size
# Key of the Parquet file's own metadata, with the study's fingerprint.
_STUDY = "study"


class StudyFolder:
    """Where a study keeps what it has done. Every file appears whole or not at all.

    While the study runs: ``settings.toml`` and ``shards/<number>.arrow``. When it is done: ``settings.toml``,
    ``rows.parquet`` with the rows of all shards in order, and ``summary.json``. Every file with rows says of which
    study they are, and a shard which one it is: what is copied here from elsewhere is not taken for the study's own.

    Attributes:
        path: of the folder.
    """

    def __init__(self, path: Path, study: Study, command: str = "") -> None:
        """Open a folder for a study, or make it.

        Args:
            path: of the folder.
            study: whose rows it holds.
            command: that made it, kept in the settings.

        Raises:
            InputError: it holds another study, or rows without settings, or cannot be written.
        """
        self.path = path
        self._shards = path / "shards"
        self._count = study.shards
        self._made = False
        self._fingerprint = study.fingerprint()
        try:
            settings = path / "settings.toml"
            if settings.is_file():
                self._check(settings, study)
            else:
                self._refuse_orphans()
                self._shards.mkdir(parents=True, exist_ok=True)
                self._write(settings, _settings(study, self._fingerprint, command).encode("utf-8"))
                self._made = True
            self._shards.mkdir(exist_ok=True)
        except OSError as error:
            raise self._unwritable(error) from None

    @property
    def complete(self) -> bool:
        """The rows of all shards are together."""
        return (self.path / "rows.parquet").is_file()

    def done(self) -> set[int]:
        """Numbers of the shards that are there."""
        if self.complete:
            return set(range(self._count))
        there = set(self._arrows())
        return {number for number in range(self._count) if self._shard(number) in there}

    def put(self, number: int, rows: pl.DataFrame) -> None:
        """Keep the rows of a shard."""
        # As a stream without compression: shards are many, small and short-lived.
        stream = io.BytesIO()
        rows.write_ipc_stream(stream)
        content = stream.getvalue()
        try:
            self._write(self._shard(number), content + self._checksum(number, content))
        except OSError as error:
            raise self._unwritable(error) from None

    def discard(self) -> None:
        """Leave the folder to others: this run has made it, and nothing can be computed."""
        if not self._made or self._arrows():
            return
        try:
            (self.path / "settings.toml").unlink()
            self._shards.rmdir()
            self.path.rmdir()
        except OSError:
            pass  # what else is in it is not ours

    def finish(self) -> pl.DataFrame:
        """Join the shards, which must all be there, into ``rows.parquet``; returns the rows."""
        import polars as pl

        rows_file = self.path / "rows.parquet"
        try:
            if not self.complete:
                rows = pl.concat([self._rows_of(number) for number in range(self._count)], rechunk=True)
                waiting = _temporary(rows_file)
                rows.write_parquet(waiting, metadata={_STUDY: self._fingerprint})
                waiting.replace(rows_file)
            else:
                rows = self._all_rows(rows_file)
            shutil.rmtree(self._shards, ignore_errors=True)
            return rows
        except OSError as error:
            raise self._unwritable(error) from None

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Keep the summary, as ``--json`` prints it."""
        text = json.dumps(to_jsonable(summary), allow_nan=False, indent=1) + "\n"
        try:
            self._write(self.path / "summary.json", text.encode("utf-8"))
        except OSError as error:
            raise self._unwritable(error) from None

    def _refuse_orphans(self) -> None:
        """Rows without settings belong to an unknown study: they are not resumed."""
        found = "rows.parquet" if self.complete else next((f"shards/{file.name}" for file in self._arrows()), None)
        if found is not None:
            problem = f"{str(self.path)!r} holds {found} without the settings.toml that says what made it"
            raise InputError("--out", problem, "give another folder, or delete this one")

    def _arrows(self) -> list[Path]:
        return sorted(self._shards.glob("*.arrow"))

    def _shard(self, number: int) -> Path:
        return self._shards / f"{number:06d}.arrow"

    def _checksum(self, number: int, content: bytes) -> bytes:
        return hashlib.sha256(f"{self._fingerprint} {number} ".encode() + content).digest()

    def _rows_of(self, number: int) -> pl.DataFrame:
        """Of a shard, which must be there."""
        import polars as pl

        file = self._shard(number)
        kept = file.read_bytes()
        content, seal = kept[:-_SEAL_SIZE], kept[-_SEAL_SIZE:]
        if seal != self._checksum(number, content):
            raise _damaged(file)
        return pl.read_ipc_stream(io.BytesIO(content))

    def _all_rows(self, file: Path) -> pl.DataFrame:
        """Of a study that is done."""
        import polars as pl

        try:
            if pl.read_parquet_metadata(file).get(_STUDY) == self._fingerprint:
                return pl.read_parquet(file, glob=False)
        except (pl.exceptions.PolarsError, OSError) as error:
            # One with a number is the system's: there the file could not be opened at all.
            if isinstance(error, OSError) and error.errno is not None:
                raise
        raise _damaged(file)

    def _check(self, settings: Path, study: Study) -> None:
        try:
            made_by = tomllib.loads(settings.read_text(encoding="utf-8")).get(MADE_BY, {})
        except (UnicodeDecodeError, tomllib.TOMLDecodeError):
            made_by = {}
        if not isinstance(made_by, dict):
            made_by = {}
        if made_by.get("fingerprint") == self._fingerprint:
            return
        fresh = {"study": study.name} | study.settings() | versions()
        differ = [key for key, value in fresh.items() if made_by.get(key) != _toml_value(value)]
        what = f"differs in {', '.join(differ)}" if differ else "differs in the scenario, its files or the code"
        raise InputError(
            "--out",
            f"{str(self.path)!r} holds results made otherwise ({what})",
            "give another folder, or delete this one",
        )

    def _write(self, file: Path, content: bytes) -> None:
        waiting = _temporary(file)
        waiting.write_bytes(content)
        waiting.replace(file)

    def _unwritable(self, error: OSError) -> InputError:
        problem = f"{str(self.path)!r} cannot be used ({error.filename or self.path}: {error.strerror or error})"
        return InputError("--out", problem, "give another folder")


def _temporary(file: Path) -> Path:
    """Where a file is written before it takes its name."""
    return file.with_name(f".{file.name}.{os.getpid()}")


def _damaged(file: Path) -> InputError:
    """A file that was cut short, overwritten or copied from another study."""
    problem = f"{str(file)!r} is damaged, or of another study"
    return InputError("--out", problem, "delete that file: what it held is computed again")


def _settings(study: Study, fingerprint: str, command: str) -> str:
    made_by = {"study": study.name, **study.settings(), **versions(), "fingerprint": fingerprint}
    if command:
        made_by["command"] = command
    made_by = {key: _toml_value(value) for key, value in made_by.items() if value is not None}
    # A comment ends with its line, and holds no control characters.
    shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in command)
    head = f"# A scenario. Made by: {shown}\n" if command else "# A scenario.\n"
    return head + to_toml(scenario_data(study.scenario) | {MADE_BY: made_by})


def _toml_value(value: Any) -> Any:
    """Settings are numbers, texts and lists of them; what has more structure is kept as JSON text."""
    if isinstance(value, dict) or (isinstance(value, list) and any(isinstance(item, dict | list) for item in value)):
        return json.dumps(value)
    return value
