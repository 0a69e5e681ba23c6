"""The folder of a study: settings first, then shards as they are done, in the end rows and summary."""

from __future__ import annotations

import json
import os
import shutil
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.collision.scenario import MADE_BY
from bumpstop.collision.settings_file import scenario_data, to_toml
from bumpstop.errors import InputError
from bumpstop.study.study import plain, versions

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.study.study import Study


class StudyFolder:
    """Where a study keeps what it has done. Every file appears whole or not at all.

    While the study runs: ``settings.toml`` and ``shards/<number>.arrow``. When it is done: ``settings.toml``,
    ``rows.parquet`` with the rows of all shards in order, and ``summary.json``.

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
        print_of = study.fingerprint()
        try:
            settings = path / "settings.toml"
            if settings.is_file():
                self._check(settings, print_of, study)
            else:
                self._refuse_orphans()
                self._shards.mkdir(parents=True, exist_ok=True)
                self._write("settings.toml", _settings(study, print_of, command).encode("utf-8"))
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
        names = (path.stem for path in self._arrows())
        return {int(name) for name in names if name.isdigit() and int(name) < self._count}

    def put(self, number: int, rows: pl.DataFrame) -> None:
        """Keep the rows of a shard."""
        try:
            # As a stream without compression: shards are many, small and short-lived.
            self._write_table(self._shards / f"{number:06d}.arrow", rows.write_ipc_stream)
        except OSError as error:
            raise self._unwritable(error) from None

    def give_up(self) -> None:
        """Leave the folder to others: this run has made it, and nothing can be worked out."""
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
                files = [self._shards / f"{number:06d}.arrow" for number in range(self._count)]
                rows = pl.concat([_read(pl.read_ipc_stream, file) for file in files], rechunk=True)
                self._write_table(rows_file, rows.write_parquet)
            else:
                rows = _read(pl.read_parquet, rows_file)
            shutil.rmtree(self._shards, ignore_errors=True)
            return rows
        except OSError as error:
            raise self._unwritable(error) from None

    def write_summary(self, summary: dict[str, Any]) -> None:
        """Keep the summary, as ``--json`` prints it."""
        text = json.dumps(plain(summary), allow_nan=False, indent=1) + "\n"
        try:
            self._write("summary.json", text.encode("utf-8"))
        except OSError as error:
            raise self._unwritable(error) from None

    def _refuse_orphans(self) -> None:
        """Rows without settings are of nobody knows what, and must not be taken up."""
        found = "rows.parquet" if self.complete else next((f"shards/{file.name}" for file in self._arrows()), None)
        if found is not None:
            problem = f"{str(self.path)!r} holds {found} without the settings.toml that says what made it"
            raise InputError("--out", problem, "give another folder, or delete this one")

    def _arrows(self) -> list[Path]:
        return sorted(self._shards.glob("*.arrow"))

    def _check(self, settings: Path, fingerprint: str, study: Study) -> None:
        try:
            made_by = tomllib.loads(settings.read_text(encoding="utf-8")).get(MADE_BY, {})
        except (UnicodeDecodeError, tomllib.TOMLDecodeError):
            made_by = {}
        if made_by.get("fingerprint") == fingerprint:
            return
        fresh = {"study": study.name} | study.settings() | versions()
        differ = [key for key, value in fresh.items() if made_by.get(key) != _toml_value(value)]
        what = f"differs in {', '.join(differ)}" if differ else "differs in the scenario, its files or the code"
        raise InputError(
            "--out",
            f"{str(self.path)!r} holds results made otherwise ({what})",
            "give another folder, or delete this one",
        )

    def _write(self, name: str, content: bytes) -> None:
        waiting = self.path / f".{name}.{os.getpid()}"
        waiting.write_bytes(content)
        waiting.replace(self.path / name)

    def _write_table(self, path: Path, write: Callable[[Path], Any]) -> None:
        waiting = path.with_name(f".{path.name}.{os.getpid()}")
        write(waiting)
        waiting.replace(path)

    def _unwritable(self, error: OSError) -> InputError:
        problem = f"{str(self.path)!r} cannot be used ({error.filename or self.path}: {error.strerror or error})"
        return InputError("--out", problem, "give another folder")


def _read(reader: Callable[[Path], pl.DataFrame], path: Path) -> pl.DataFrame:
    """A table of this folder; one that somebody else has cut short or written over is refused by name."""
    import polars as pl

    try:
        return reader(path)
    except (pl.exceptions.PolarsError, OSError) as error:
        # One with a number is the system's: there the file could not be opened at all.
        if isinstance(error, OSError) and error.errno is not None:
            raise
        problem = f"{str(path)!r} is damaged"
        raise InputError("--out", problem, "delete that file: what it held is worked out anew") from None


def _settings(study: Study, fingerprint: str, command: str) -> str:
    made_by = {"study": study.name, **study.settings(), **versions(), "fingerprint": fingerprint}
    if command:
        made_by["command"] = command
    made_by = {key: _toml_value(value) for key, value in made_by.items() if value is not None}
    head = f"# A scenario. Made by: {command}\n" if command else "# A scenario.\n"
    return head + to_toml(scenario_data(study.scenario) | {MADE_BY: made_by})


def _toml_value(value: Any) -> Any:
    """Settings are numbers, texts and lists of them; what has more structure is kept as JSON text."""
    if isinstance(value, dict) or (isinstance(value, list) and any(isinstance(item, dict | list) for item in value)):
        return json.dumps(value)
    return value
