"""The folder of a job: settings first, then shards as they are done, in the end rows, summary and manifest."""

from __future__ import annotations

import hashlib
import io
import json
import platform
from collections.abc import Callable, Iterator
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError
from bumpstop.shards.settings_file import SETTINGS, damage, differing, read_made_by, settings_content
from bumpstop.shards.sharded_job import to_jsonable
from bumpstop.shards.storage import Location, Storage, storage_at

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.shards.sharded_job import ShardedJob

MANIFEST, SUMMARY = "manifest.json", "summary.json"
# Bytes behind the rows of a shard that say whose they are.
_SEAL_SIZE = hashlib.sha256().digest_size
# Key of the Parquet file's own metadata, with the job's fingerprint.
_STUDY = "study"


class DamagedError(InputError):
    """A file of a job that was cut short, overwritten, cannot be read, or was copied from another job.

    Attributes:
        name: of the file below the folder.
    """

    def __init__(self, name: str, place: str, why: str = "is damaged, or of another study") -> None:
        self.name, self.place, self.why = name, place, why
        problem = f"{f'{place}/{name}'!r} {why}"
        super().__init__("--out", problem, "delete that file: what it held is computed again")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.name, self.place, self.why)


class ResultFolder:
    """Where a job keeps what it has done. Every file appears whole or not at all, and has a checksum.

    While the job runs: ``settings.toml`` and ``shards/<number>.arrow``, each with its checksum behind its rows. When it
    is done: ``settings.toml``, the rows of all shards in order in ``rows.parquet`` (or, of a job with volumes, in
    ``rows/<number>.parquet``), ``summary.json``, and ``manifest.json`` with the checksums of all three. Every file with
    rows says of which job they are, and a shard which one it is: what is copied here from elsewhere is not taken for
    the job's own. The folder can be sent to a worker, which puts its shards there.

    Attributes:
        storage: the place.
    """

    def __init__(self, location: Location | Storage, job: ShardedJob, fingerprint: str = "") -> None:
        """Of a job whose folder may not be there yet.

        Args:
            location: a path, or a URL that fsspec knows.
            job: whose rows it holds.
            fingerprint: of the job when its rows were computed, to read what another build has left; default: now.
        """
        self.storage = location if isinstance(location, Storage) else storage_at(location)
        self.count = job.shards
        self.fingerprint = fingerprint or job.fingerprint()
        self._volume_shards = job.volume_shards
        self.made = False

    def open(self, job: ShardedJob, command: str = "") -> None:
        """Make the folder, or check that it is this job's; what begins a run does it, once.

        Args:
            job: whose rows it holds.
            command: that made it, kept in the settings.

        Raises:
            InputError: it holds another job, or rows without settings, or cannot be written, or the job has files whose
                names are no text.
        """
        try:
            try:
                self._check(self.storage.read(SETTINGS), job)
            except FileNotFoundError:
                self._refuse_orphans()
                settings = settings_content(job, self.fingerprint, command)
                self.storage.make()
                self.storage.write(SETTINGS, settings)
                self.made = True
        except OSError as error:
            raise self._unwritable(error) from None

    def check_there(self) -> None:
        """Check that what :meth:`open` has made is still there, and seen from here, without making anything.

        Shards that are put into another folder than that are where nobody looks for them.

        Raises:
            InputError: there are no settings of this job.
        """
        try:
            settings = self.storage.read(SETTINGS)
        except FileNotFoundError:
            settings = b""
        except OSError as error:
            raise self._unwritable(error) from None
        if self.fingerprint.encode() not in settings:
            problem = f"{str(self.storage)!r} holds no {SETTINGS} of this run, seen from {platform.node()}"
            raise InputError(
                "--out", problem, "give a folder that all workers see, and leave it there until it is done"
            )

    # --- Shards -------------------------------------------------------------------------------------------------

    def done(self) -> set[int]:
        """Numbers of the shards that are there, by themselves or in a file of the result."""
        try:
            found = {number for number in map(self._number_of, self.storage.sizes("shards")) if number is not None}
            kept = self.manifest().get("files", {})
            for volume in range(self._volumes):
                if self._volume_name(volume) in kept and self._volume_there(volume):
                    found |= set(self._shards_of(volume))
        except OSError as error:
            raise self._unwritable(error) from None
        return found

    def put(self, number: int, rows: pl.DataFrame) -> int:
        """Keep the rows of a shard; returns the bytes they take."""
        # As a stream without compression: shards are many, small and short-lived.
        stream = io.BytesIO()
        rows.write_ipc_stream(stream)
        content = stream.getvalue()
        try:
            self.storage.write(self._shard(number), content + self._checksum(number, content))
        except OSError as error:
            raise self._unwritable(error) from None
        return len(content) + _SEAL_SIZE

    def get(self, number: int) -> pl.DataFrame:
        """The rows of a shard.

        Raises:
            DamagedError: its file is not what was written, or cannot be read.
        """
        import polars as pl

        try:
            kept = self.storage.read(self._shard(number))
        except OSError as error:
            reason = error.strerror or str(error)
            raise DamagedError(self._shard(number), str(self.storage), f"cannot be read ({reason})") from None
        content, seal = kept[:-_SEAL_SIZE], kept[-_SEAL_SIZE:]
        if seal != self._checksum(number, content):
            raise DamagedError(self._shard(number), str(self.storage))
        return pl.read_ipc_stream(io.BytesIO(content))

    def has_shard(self, number: int) -> bool:
        """Whether a shard has a file of its own."""
        return self._shard(number).rpartition("/")[2] in self.storage.sizes("shards")

    def drop(self, damaged: DamagedError) -> None:
        """Remove a damaged file: what it held counts as not computed."""
        try:
            self.storage.delete(damaged.name)
        except OSError as error:
            raise self._unwritable(error) from None

    def discard(self) -> None:
        """Leave the folder to others, if that is possible: this run has made it, and nothing can be computed."""
        with suppress(OSError):
            if not self.made or any(map(self._is_shard, self.storage.sizes("shards"))):
                return
            self.storage.delete(SETTINGS)
            self.storage.remove_folder("shards")
            self.storage.remove_folder("")

    # --- The result ---------------------------------------------------------------------------------------------

    def manifest(self) -> dict[str, Any]:
        """Checksums of the files of the result; empty before there is one.

        Raises:
            DamagedError: it is not what was written.
            InputError: it cannot be read.
        """
        try:
            found = json.loads(self.storage.read(MANIFEST))
        except FileNotFoundError:
            return {}
        except ValueError:
            raise DamagedError(MANIFEST, str(self.storage)) from None
        except OSError as error:
            raise self._unwritable(error) from None
        expected = {SUMMARY, *(self._volume_name(volume) for volume in range(self._volumes))}
        if (
            not isinstance(found, dict)
            or (found.get("fingerprint"), found.get("shards")) != (self.fingerprint, self.count)
            or not isinstance(found.get("files"), dict)
            or found["files"].keys() != expected
        ):
            raise DamagedError(MANIFEST, str(self.storage))
        return found

    def finish(self, summarise: Callable[[Iterator[pl.DataFrame]], dict[str, Any]]) -> dict[str, Any]:
        """Join the shards, which must all be there, and keep the summary.

        What has been joined before is checked, and left as it is.

        Args:
            summarise: makes the summary of the rows, given volume by volume.

        Returns:
            The summary.

        Raises:
            DamagedError: a shard or a file of the result is not what was written.
            InputError: the folder is not there any more, or cannot be written.
        """
        self.check_there()
        try:
            known = dict(self.manifest().get("files", {}))
            files: dict[str, str] = {}
            if SUMMARY in known and SUMMARY in self.storage.sizes(""):
                self.read_summary()

            def volumes() -> Iterator[pl.DataFrame]:
                for volume in range(self._volumes):
                    name = self._volume_name(volume)
                    if name in known and self._volume_there(volume):
                        rows, files[name] = self._checked_rows(volume, known[name]), known[name]
                    else:
                        rows = self._joined(volume)
                        files[name] = self.storage.write_rows(name, rows, {_STUDY: self.fingerprint})
                    yield rows

            summary = summarise(volumes())
            text = json.dumps(to_jsonable(summary), allow_nan=False, indent=1) + "\n"
            self.storage.write(SUMMARY, text.encode("utf-8"))
            files[SUMMARY] = hashlib.sha256(text.encode("utf-8")).hexdigest()
            manifest = {"fingerprint": self.fingerprint, "shards": self.count, "files": files}
            self.storage.write(MANIFEST, (json.dumps(manifest, indent=1) + "\n").encode())
            self.storage.remove_folder("shards")
            return summary
        except OSError as error:
            raise self._unwritable(error) from None

    def damaged_settings(self) -> list[str]:
        """Whether the settings file is another than was written, in one sentence; empty: it is not."""
        try:
            what = damage(self.storage.read(SETTINGS))
        except OSError as error:
            return [DamagedError(SETTINGS, str(self.storage), f"cannot be read ({error.strerror})").problem]
        return [DamagedError(SETTINGS, str(self.storage), what).problem] if what else []

    def missing_manifest(self) -> list[str]:
        """Whether a result has lost its manifest, in one sentence; empty: it has not.

        Shards stay until there is a manifest, so that a result without either is one whose manifest is gone.
        """
        # Shards first: a run that ends meanwhile writes the manifest before it takes them away.
        if any(map(self._is_shard, self.storage.sizes("shards"))):
            return []
        here = self.storage.sizes("")
        if MANIFEST in here:
            return []
        names = here.keys() | {f"rows/{name}" for name in self.storage.sizes("rows")}
        if names.isdisjoint({SUMMARY, *map(self._volume_name, range(self._volumes))}):
            return []
        return [DamagedError(MANIFEST, str(self.storage), "is not there, although there is a result").problem]

    def damaged_results(self) -> list[str]:
        """What is wrong with files of the result that the manifest names, one sentence each."""
        found = []
        for name, checksum in self.manifest().get("files", {}).items():
            try:
                if hashlib.sha256(self.storage.read(name)).hexdigest() != checksum:
                    found.append(DamagedError(name, str(self.storage)).problem)
            except FileNotFoundError:
                found.append(DamagedError(name, str(self.storage), "is not there").problem)
            except OSError as error:
                found.append(DamagedError(name, str(self.storage), f"cannot be read ({error.strerror})").problem)
        return found

    def read_summary(self) -> str:
        """The summary, compared with its checksum.

        Raises:
            DamagedError: it is not what was written.
        """
        try:
            content = self.storage.read(SUMMARY)
        except OSError as error:
            raise DamagedError(SUMMARY, str(self.storage), f"cannot be read ({error.strerror})") from None
        if hashlib.sha256(content).hexdigest() != self.manifest().get("files", {}).get(SUMMARY):
            raise DamagedError(SUMMARY, str(self.storage))
        return content.decode("utf-8")

    @property
    def complete(self) -> bool:
        """The rows of all shards are joined, and the summary is there."""
        return SUMMARY in self.manifest().get("files", {}) and all(map(self._volume_there, range(self._volumes)))

    # --- Names --------------------------------------------------------------------------------------------------

    @property
    def _volumes(self) -> int:
        return -(-self.count // self._volume_shards) if self._volume_shards else 1

    def _volume_name(self, volume: int) -> str:
        return f"rows/{volume:05d}.parquet" if self._volume_shards else "rows.parquet"

    def _shards_of(self, volume: int) -> range:
        size = self._volume_shards or self.count
        return range(volume * size, min(self.count, (volume + 1) * size))

    def _volume_there(self, volume: int) -> bool:
        folder, _, name = self._volume_name(volume).rpartition("/")
        return name in self.storage.sizes(folder)

    def _is_shard(self, name: str) -> bool:
        return name.endswith(".arrow")

    def _shard(self, number: int) -> str:
        return f"shards/{number:06d}.arrow"

    def _number_of(self, name: str) -> int | None:
        """Of a shard's file; None for any other."""
        stem = name.removesuffix(".arrow")
        if stem == name or not stem.isascii() or not stem.isdigit():
            return None
        number = int(stem)
        return number if number < self.count and self._shard(number) == f"shards/{name}" else None

    # --- Checks -------------------------------------------------------------------------------------------------

    def _checksum(self, number: int, content: bytes) -> bytes:
        return hashlib.sha256(f"{self.fingerprint} {number} ".encode() + content).digest()

    def _joined(self, volume: int) -> pl.DataFrame:
        import polars as pl

        return pl.concat([self.get(number) for number in self._shards_of(volume)], rechunk=True)

    def _checked_rows(self, volume: int, checksum: str) -> pl.DataFrame:
        import polars as pl

        name = self._volume_name(volume)
        content = self.storage.read(name)
        if hashlib.sha256(content).hexdigest() != checksum:
            raise DamagedError(name, str(self.storage))
        return pl.read_parquet(io.BytesIO(content))

    def _refuse_orphans(self) -> None:
        """Rows without settings belong to an unknown job: they are not resumed."""
        here = self.storage.sizes("")
        rows = [name for name in here if name in ("rows.parquet", "rows")]
        rows += [f"shards/{name}" for name in sorted(self.storage.sizes("shards")) if self._is_shard(name)]
        if rows:
            problem = f"{str(self.storage)!r} holds {rows[0]} without the settings.toml that says what made it"
            raise InputError("--out", problem, "give another folder, or delete this one")

    def _check(self, settings: bytes, job: ShardedJob) -> None:
        made_by = read_made_by(settings)
        if made_by.get("fingerprint") == self.fingerprint:
            return
        differ = differing(made_by, job)
        what = f"differs in {', '.join(differ)}" if differ else "differs in the scenario, its files or the code"
        raise InputError(
            "--out",
            f"{str(self.storage)!r} holds results made otherwise ({what})",
            "give another folder, or delete this one",
        )

    def _unwritable(self, error: OSError) -> InputError:
        return self.storage.unusable(error)
