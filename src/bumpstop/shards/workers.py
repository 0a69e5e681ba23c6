"""Who computes shards: threads, processes of this machine, or a cluster of dask.distributed."""

from __future__ import annotations

import contextlib
import logging
import os
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool, ProcessPoolExecutor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.shards.result_folder import ResultFolder
    from bumpstop.shards.sharded_job import ShardedJob

# A worker that dies this often without a shard done in between dies of the shards.
_MAX_DEATHS = 3
# Groups that wait in the queue of a pool, for each worker: enough that none is idle, few enough to forget quickly.
_WAITING = 2


@dataclass(frozen=True)
class Receipt:
    """That a shard is done.

    Attributes:
        number: of the shard.
        rows: how many it has.
        size: bytes of its file; 0: kept in memory.
        seconds: that it took, its file included.
        kept: its rows, where they are kept in memory.
    """

    number: int
    rows: int
    size: int
    seconds: float
    kept: pl.DataFrame | None = None


Done = Callable[[list[Receipt]], None]


@dataclass(frozen=True)
class Workers:
    """How many compute, and what they are.

    Attributes:
        threads: of this process.
        processes: of this machine; 0: none but this one.
        cluster: address of a scheduler of dask.distributed, ``"tcp://host:port"``; empty: none.
        tell: told in a sentence what a person should know while it goes on.
    """

    threads: int = 1
    processes: int = 0
    cluster: str = ""
    tell: Callable[[str], None] = field(default=lambda note: None, compare=False)

    def __post_init__(self) -> None:
        if self.threads < 1:
            raise InputError("threads", f"{self.threads} is too few", "wanted at least 1")

    @property
    def count(self) -> int:
        """Groups of shards computed at once."""
        return self.processes or self.threads

    def compute(self, job: ShardedJob, folder: ResultFolder | None, groups: Sequence[list[int]], done: Done) -> None:
        """Compute groups of shards, in any order.

        Args:
            job: whose.
            folder: where they put their rows; None: into the receipts.
            groups: numbers of shards, computed in one go each.
            done: told of each group.

        Raises:
            InputError: a shard cannot be computed or kept, workers die again and again, or the cluster is lost.
        """
        if self.cluster:
            assert folder is not None
            _in_cluster(job, folder, groups, done, self)
        elif self.processes:
            _in_processes(job, folder, groups, done, self.processes)
        elif self.threads == 1:
            for group in groups:
                done(compute_group(job, folder, group))
        else:
            pool = ThreadPoolExecutor(self.threads)
            try:
                _drain(lambda group: _submitted(pool, job, folder, group), iter(groups), len(groups), done)
            finally:
                # After an interruption nothing new is begun; what is done is kept.
                pool.shutdown(cancel_futures=True)


def compute_group(job: ShardedJob, folder: ResultFolder | None, numbers: list[int]) -> list[Receipt]:
    """Compute some shards and keep them in a folder that is there; what every worker does."""
    begin = time.perf_counter()
    if folder is not None:
        folder.check_there()
    shards = job.shard_batch(numbers)
    if folder is not None and job.fingerprint() != folder.fingerprint:
        # Files are read again and again: rows of two of their versions would stand side by side.
        problem = "a file of the scenario, or bumpstop, has changed since the work began: these rows are not kept"
        raise InputError("--out", problem, "give it its content back, or give another folder")
    sizes = [0 if folder is None else folder.put(n, rows) for n, rows in zip(numbers, shards, strict=True)]
    seconds = (time.perf_counter() - begin) / max(1, len(numbers))
    return [
        Receipt(n, rows.height, size, seconds, rows if folder is None else None)
        for n, rows, size in zip(numbers, shards, sizes, strict=True)
    ]


def _submitted(
    pool: ThreadPoolExecutor, job: ShardedJob, folder: ResultFolder | None, group: list[int]
) -> Future[list[Receipt]]:
    try:
        return pool.submit(compute_group, job, folder, group)
    except RuntimeError as error:  # the pool begins a thread with each of the first groups
        raise InputError("threads", f"no more can be started ({error})", "wanted fewer") from None


def _drain(submit: Callable[[list[int]], Any], groups: Iterator[list[int]], waiting: int, done: Done) -> None:
    """Keep ``waiting`` groups submitted until all are done."""
    running: dict[Future[list[Receipt]], list[int]] = {}

    def fill() -> None:
        for group in groups:
            running[submit(group)] = group
            if len(running) >= waiting:
                return

    fill()
    while running:
        for future in wait(running, return_when=FIRST_COMPLETED).done:
            del running[future]
            done(future.result())
        if len(running) < waiting:
            fill()


# --- Processes ---------------------------------------------------------------------------------------------------


_OF_THIS_PROCESS: list[Any] = []


def _begin_process(job: ShardedJob, folder: ResultFolder | None) -> None:
    """What a process does first: remember the job, and end when its parent ends."""
    import threading
    from multiprocessing import parent_process

    _OF_THIS_PROCESS[:] = [job, folder]
    parent = parent_process()

    def follow() -> None:
        assert parent is not None
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


def _compute_here(numbers: list[int]) -> list[Receipt]:
    job, folder = _OF_THIS_PROCESS
    return compute_group(job, folder, numbers)


def _in_processes(
    job: ShardedJob, folder: ResultFolder | None, groups: Sequence[list[int]], done: Done, processes: int
) -> None:
    import multiprocessing

    missing = {number: group for group in groups for number in group}
    deaths = 0

    def keep(receipts: list[Receipt]) -> None:
        nonlocal deaths
        deaths = 0
        for receipt in receipts:
            missing.pop(receipt.number, None)
        done(receipts)

    while missing:
        left = [group for group in groups if any(number in missing for number in group)]
        with _one_thread_each():
            pool = ProcessPoolExecutor(
                min(processes, len(left)), multiprocessing.get_context("spawn"), _begin_process, (job, folder)
            )

            def submit(group: list[int], pool: ProcessPoolExecutor = pool) -> Future[list[Receipt]]:
                with ctrl_c_blocked():  # the pool begins its processes with the first group
                    return pool.submit(_compute_here, group)

            try:
                _drain(submit, iter(left), _WAITING * processes, keep)
            except BrokenProcessPool:
                # Killed, or out of memory. Its shards are computed again by others.
                deaths += 1
                if deaths >= _MAX_DEATHS:
                    problem = f"workers died {deaths} times in a row with no shard done, the first of {min(missing)}"
                    raise InputError("--workers", problem, "is there memory for so many?") from None
            finally:
                pool.shutdown(cancel_futures=True)


@contextlib.contextmanager
def ctrl_c_blocked() -> Iterator[None]:
    """Processes that begin in this block leave Ctrl-C to their parent, while they import, too."""
    import signal

    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _one_thread_each() -> Iterator[None]:
    """Processes that begin in this block multiply matrices on one thread each: there are as many of them as cores."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update({name: value or "1" for name, value in before.items()})
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]


# --- Clusters ----------------------------------------------------------------------------------------------------


def _compute_far(job: ShardedJob, folder: ResultFolder, numbers: list[int]) -> list[Receipt]:
    """What a worker of a cluster does: it must compute the same, and see the same place."""
    try:
        return _compute_checked(job, folder, numbers)
    except OSError as error:  # to the client it would look like a lost connection
        what = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        problem = f"the worker on {os.uname().nodename} fails ({what})"
        raise InputError("--cluster", problem, "wanted input files that all workers see") from None


def _compute_checked(job: ShardedJob, folder: ResultFolder, numbers: list[int]) -> list[Receipt]:
    if job.fingerprint() != folder.fingerprint:
        problem = f"the worker on {os.uname().nodename} has another build, version, instruction set or input files"
        raise InputError("--cluster", problem, "install the same there; BUMPSTOP_TARGET chooses an instruction set")
    return compute_group(job, folder, numbers)


def _in_cluster(
    job: ShardedJob, folder: ResultFolder, groups: Sequence[list[int]], done: Done, workers: Workers
) -> None:
    address = workers.cluster
    try:
        from distributed import Client
    except ModuleNotFoundError:
        problem = f"{address!r} needs the package distributed"
        raise InputError("--cluster", problem, "pip install 'bumpstop[campaign]'") from None
    # What the client logs of a lost connection, with its tracebacks, is said in one sentence here. Its loggers have
    # levels of their own.
    for name in [*logging.root.manager.loggerDict, "distributed", "tornado", "asyncio"]:
        if name.partition(".")[0] in ("distributed", "tornado", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL + 1)
    lost = InputError("--cluster", f"the scheduler at {address!r} is lost", "what is done is kept: resume")
    try:
        client = Client(address, timeout="10s", set_as_default=False, name="bumpstop")
    except (OSError, ValueError, TimeoutError) as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError("--cluster", f"{address!r} cannot be reached ({reason})", "wanted tcp://host:port") from None
    try:
        with client.as_current():
            _submit_to(client, job, folder, groups, done, lost, workers.tell)
    finally:
        with contextlib.suppress(Exception):  # of a scheduler that is gone already
            client.close(timeout=2)


def _submit_to(
    client: Any,
    job: ShardedJob,
    folder: ResultFolder,
    groups: Sequence[list[int]],
    done: Done,
    lost: InputError,
    tell: Callable[[str], None],
) -> None:
    from distributed import CancelledError, KilledWorker, wait
    from distributed.comm.core import CommClosedError

    left, running = iter(groups), {}
    deaths = 0
    told = False

    def fill() -> None:
        cores = sum(client.ncores().values()) or 1
        for group in left:
            running[client.submit(_compute_far, job, folder, group, pure=False)] = group
            if len(running) >= _WAITING * cores:
                return

    try:
        fill()
        while running:
            try:
                found = wait(list(running), timeout=5, return_when="FIRST_COMPLETED").done
            except TimeoutError:
                if client.status != "running" or client.scheduler_comm is None or client.scheduler_comm.comm.closed():
                    raise lost from None
                deserted = not client.ncores()
                if deserted and not told:
                    tell(f"the scheduler at {client.scheduler.address!r} has no workers: shards wait until some come")
                told = deserted
                continue
            for future in found:
                group = running.pop(future)
                try:
                    done(future.result())
                    deaths = 0
                except KilledWorker:
                    deaths += 1
                    if deaths >= _MAX_DEATHS:
                        problem = f"workers died {deaths} times in a row with no shard done, the last of {group[0]}"
                        raise InputError("--cluster", problem, "is there memory on the workers?") from None
                    running[client.submit(_compute_far, job, folder, group, pure=False)] = group
            fill()
    except (CancelledError, CommClosedError, OSError) as error:
        raise lost from error
