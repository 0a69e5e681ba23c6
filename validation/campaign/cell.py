"""A small campaign whose processes can be killed and whose files can be damaged."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import bumpstop
from validation.facts import REPOSITORY

# Where the package stands that this process uses: processes that begin use the same.
PACKAGE = Path(bumpstop.__file__).resolve().parents[1]
_PROGRAM = "from bumpstop.cli.main import main; main()"
_TIMEOUT_S = 300.0


class Cell:
    """A campaign file in a folder, and the commands that run it.

    Attributes:
        folder: where everything is.
        file: of the campaign.
    """

    def __init__(self, folder: Path, *, poses: int = 20, shard_s: float = 0.02) -> None:
        self.folder = folder
        examples = REPOSITORY / "examples"
        text = (examples / "campaign" / "two_arms.toml").read_text(encoding="utf-8")
        text = text.replace("../", f"{examples}/").replace("poses = 20", f"poses = {poses}")
        self.file = folder / "campaign.toml"
        self.file.write_text(text.replace("shard_s = 0.1", f"shard_s = {shard_s}"), encoding="utf-8")

    def start(self, *arguments: object, environment: dict[str, str] | None = None) -> subprocess.Popen[str]:
        """Begin ``bumpstop campaign``, in a session of its own."""
        return subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, "campaign", *map(str, arguments)],
            env=os.environ | {"PYTHONPATH": str(PACKAGE)} | (environment or {}),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def run(self, *arguments: object, environment: dict[str, str] | None = None) -> tuple[int, str]:
        """Run ``bumpstop campaign`` to its end; exit status and everything it printed."""
        return finish(self.start(*arguments, environment=environment))


def finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit status of a process, and everything it printed."""
    out, err = process.communicate(timeout=_TIMEOUT_S)
    return process.returncode, out + err


def parts(out: Path) -> list[Path]:
    """Shards that are done."""
    return sorted((out / "shards").glob("*.arrow"))


def wait_for(condition: Callable[[], object], what: str) -> None:
    """Wait until a condition holds.

    Raises:
        TimeoutError: it does not.
    """
    end = time.monotonic() + _TIMEOUT_S
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError(what)
        time.sleep(0.005)


def workers_of(process: int) -> list[int]:
    """Processes that compute for a process."""
    found = []
    with contextlib.suppress(OSError):
        for child in Path(f"/proc/{process}/task/{process}/children").read_text(encoding="ascii").split():
            with contextlib.suppress(OSError):
                if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes():
                    found.append(int(child))
    return found


def is_running(process: int) -> bool:
    """Whether a process is there, and no zombie."""
    try:
        return "\nState:\tZ" not in Path(f"/proc/{process}/status").read_text(encoding="ascii")
    except OSError:
        return False


def result(out: Path) -> dict[str, str]:
    """Digests of the files of a result: rows, summary and manifest."""
    files = [*sorted((out / "rows").glob("*.parquet")), out / "summary.json", out / "manifest.json"]
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def flip(file: Path, share: float = 0.5) -> None:
    """Flip a bit in a file."""
    content = bytearray(file.read_bytes())
    content[int(share * (len(content) - 1))] ^= 4
    file.write_bytes(content)


@contextlib.contextmanager
def cluster(workers: int, folder: Path) -> Iterator[tuple[str, subprocess.Popen[bytes], list[subprocess.Popen[bytes]]]]:
    """A scheduler of dask.distributed and its workers; yields the address, the scheduler and the workers."""
    environment = os.environ | {"PYTHONPATH": str(PACKAGE)}

    def start(module: str, *arguments: str) -> subprocess.Popen[bytes]:
        code = f"from distributed.cli.{module} import main; main()"
        return subprocess.Popen(
            [sys.executable, "-c", code, *arguments],
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    place = folder / f"scheduler-{os.urandom(4).hex()}.json"
    scheduler = start(
        "dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(place)
    )
    own: list[subprocess.Popen[bytes]] = []
    try:
        wait_for(lambda: place.exists() and place.stat().st_size, "no scheduler")
        address = json.loads(place.read_text(encoding="utf-8"))["address"]
        for _ in range(workers):
            options = ("--nthreads", "1", "--no-dashboard", "--no-nanny", "--local-directory", str(folder))
            own.append(start("dask_worker", address, *options))
        yield address, scheduler, own
    finally:
        for process in [*own, scheduler]:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
