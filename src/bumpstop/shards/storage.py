"""Where the files of a job are: a folder of this machine, or a place that fsspec knows, such as ``s3://bucket/run``."""

from __future__ import annotations

import hashlib
import io
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError, where_else
from bumpstop.output_files import write_bytes, write_parquet

if TYPE_CHECKING:
    import polars as pl

Location = str | os.PathLike[str]


class Storage(ABC):
    """Files by their names below one place. Every file appears whole or not at all."""

    @abstractmethod
    def __str__(self) -> str:
        """The place, as errors name it."""

    def unusable(self, error: OSError) -> InputError:
        """What a person is told of an error of the place."""
        problem = f"{str(self)!r} cannot be used ({error.filename or self}: {error.strerror or error})"
        return InputError("--out", problem, where_else(error))

    @abstractmethod
    def make(self) -> None:
        """Make the place where it is missing."""

    @abstractmethod
    def read(self, name: str) -> bytes:
        """The content of a file; FileNotFoundError where there is none, OSError where it cannot be read."""

    @abstractmethod
    def write(self, name: str, content: bytes) -> None:
        """Write a file; OSError where that fails, as in a folder that is gone."""

    @abstractmethod
    def write_rows(self, name: str, rows: pl.DataFrame, metadata: dict[str, str]) -> str:
        """Write a Parquet file; returns the SHA-256 of its bytes. OSError where that fails."""

    @abstractmethod
    def delete(self, name: str) -> None:
        """Remove a file, if it is there."""

    @abstractmethod
    def sizes(self, folder: str) -> dict[str, int]:
        """Bytes of each file in a folder of the place by its own name; empty where there is no such folder.

        What comes or goes meanwhile may be among them or not; all else is. A folder of this machine leaves out hidden
        files.
        """

    @abstractmethod
    def remove_folder(self, folder: str) -> None:
        """Remove a folder with all files of this module in it, as far as that is possible."""

    @contextmanager
    def lock(self, share: str | None) -> Iterator[None]:
        """Keep others away while the block runs, where the place can do that.

        Args:
            share: name of a share of the shards, which others may accompany with other shares; None: the whole job.

        Raises:
            InputError: somebody else holds it, or the place cannot be used.
        """
        yield


def storage_at(location: Location) -> Storage:
    """The storage of a path or URL.

    Raises:
        InputError: the URL cannot be used, or fsspec is not installed.
    """
    text = os.fspath(location)
    return RemoteStorage(text) if "://" in text else LocalStorage(Path(text))


class LocalStorage(Storage):
    """A folder of this machine."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[type[LocalStorage], tuple[Path]]:
        """Sent to a worker, whose current folder may be another."""
        return type(self), (self.path.absolute(),)

    def __str__(self) -> str:
        return str(self.path)

    def make(self) -> None:  # noqa: D102
        self.path.mkdir(parents=True, exist_ok=True)

    def read(self, name: str) -> bytes:  # noqa: D102
        return (self.path / name).read_bytes()

    def write(self, name: str, content: bytes) -> None:  # noqa: D102
        try:
            write_bytes(self.path / name, content, durable=True)
        except FileNotFoundError:
            self._make_folder_of(name)
            write_bytes(self.path / name, content, durable=True)

    def write_rows(self, name: str, rows: pl.DataFrame, metadata: dict[str, str]) -> str:  # noqa: D102
        self._make_folder_of(name)
        write_parquet(self.path / name, rows, metadata, durable=True)
        with (self.path / name).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    def delete(self, name: str) -> None:  # noqa: D102
        (self.path / name).unlink(missing_ok=True)

    def sizes(self, folder: str) -> dict[str, int]:  # noqa: D102
        try:
            listing = os.scandir(self.path / folder)
        except (FileNotFoundError, NotADirectoryError):
            return {}
        found = {}
        with listing as entries:
            for entry in entries:
                # What is being written has a name that begins with a dot until all of it is there.
                if not entry.name.startswith("."):
                    with suppress(FileNotFoundError):  # gone in between
                        found[entry.name] = entry.stat(follow_symlinks=False).st_size
        return found

    def remove_folder(self, folder: str) -> None:  # noqa: D102
        import shutil

        if folder:
            shutil.rmtree(self.path / folder, ignore_errors=True)
            return
        with suppress(OSError):  # what else is in it is not ours
            self.path.rmdir()

    @contextmanager
    def lock(self, share: str | None) -> Iterator[None]:
        """The kernel's lock of the folder, which ends with its holder, however that ends.

        Shares hold the folder's lock together, and each the lock of a file of its own.
        """
        try:
            import fcntl
        except ModuleNotFoundError:  # a system without such locks
            yield
            return
        held = []

        def opened(name: str, flags: int) -> int:
            try:
                self._make_folder_of("shards/")
                held.append(os.open(self.path / name, flags, 0o644))
            except OSError as error:
                raise self.unusable(error) from None
            return held[-1]

        try:
            self._take(opened("", os.O_RDONLY), fcntl.LOCK_EX if share is None else fcntl.LOCK_SH)
            if share is not None:
                self._take(opened(f"shards/.share-{share}", os.O_RDWR | os.O_CREAT), fcntl.LOCK_EX)
            yield
        finally:
            for handle in held:
                os.close(handle)

    def _make_folder_of(self, name: str) -> None:
        """Make the folder of a file inside the place; never the place itself, which may have been moved away."""
        below = name.rpartition("/")[0]
        if below:
            (self.path / below).mkdir(exist_ok=True)

    def _take(self, handle: int, kind: int) -> None:
        import fcntl

        try:
            fcntl.flock(handle, kind | fcntl.LOCK_NB)
        except BlockingIOError:
            problem = f"{str(self.path)!r} is in use: another process computes the same shards there"
            raise InputError("--out", problem, "wait for it, or give another folder") from None
        except OSError:
            pass  # a file system without locks: parts are the same whoever writes them


class RemoteStorage(Storage):
    """A place that fsspec knows. Its writes are taken for whole or nothing, as those of object stores are."""

    def __init__(self, url: str) -> None:
        try:
            import fsspec
        except ModuleNotFoundError:
            problem = f"{url!r} is a URL, which needs the package fsspec"
            raise InputError("--out", problem, "pip install 'bumpstop[campaign]'") from None
        self.url = url.rstrip("/")
        try:
            self._system, self._root = fsspec.core.url_to_fs(self.url)
        except Exception as error:  # of any file system's own kind, or a package of it that is not there
            reason = " ".join(str(error).split())[:200]
            raise InputError("--out", f"{url!r} cannot be used ({reason})", "for example s3://bucket/run") from None

    def __reduce__(self) -> tuple[type[RemoteStorage], tuple[str]]:
        return type(self), (self.url,)

    def __str__(self) -> str:
        return self.url

    def make(self) -> None:  # noqa: D102
        self._call(self._system.makedirs, self._root, exist_ok=True)

    def read(self, name: str) -> bytes:  # noqa: D102
        return bytes(self._call(self._system.cat_file, self._path(name)))

    def write(self, name: str, content: bytes) -> None:  # noqa: D102
        parent = self._path(name).rpartition("/")[0]
        self._call(self._system.makedirs, parent, exist_ok=True)
        self._call(self._system.pipe_file, self._path(name), content)

    def write_rows(self, name: str, rows: pl.DataFrame, metadata: dict[str, str]) -> str:  # noqa: D102
        content = io.BytesIO()
        rows.write_parquet(content, metadata=metadata)
        self.write(name, content.getvalue())
        return hashlib.sha256(content.getvalue()).hexdigest()

    def delete(self, name: str) -> None:  # noqa: D102
        with suppress(FileNotFoundError):
            self._call(self._system.rm_file, self._path(name))

    def sizes(self, folder: str) -> dict[str, int]:  # noqa: D102
        self._system.invalidate_cache()
        try:
            found = self._call(self._system.ls, self._path(folder), detail=True)
        except FileNotFoundError:
            return {}
        return {str(each["name"]).rpartition("/")[2]: int(each.get("size") or 0) for each in found}

    def remove_folder(self, folder: str) -> None:  # noqa: D102
        with suppress(OSError):
            self._call(self._system.rm, self._path(folder), recursive=bool(folder))

    def _path(self, name: str) -> str:
        return f"{self._root}/{name}" if name else self._root

    def _call(self, function: Any, *arguments: Any, **options: Any) -> Any:
        """Call the file system; whatever it raises becomes an OSError."""
        try:
            return function(*arguments, **options)
        except OSError:
            raise
        except Exception as error:  # each file system raises kinds of its own
            raise OSError(f"{type(error).__name__}: {' '.join(str(error).split())[:200]}") from None
