"""The process that reads mutated files, one after another."""

from __future__ import annotations

import gc
import mmap
import os
import random
import struct
import time
import traceback
import zlib
from multiprocessing.connection import Connection
from pathlib import Path

from fuzz.guarded import GuardedReader
from fuzz.mutations import mutated
from fuzz.targets import TARGETS, Target

ROOT = Path(__file__).resolve().parents[1]
# An execution may take this much time of the processor, and memory on top of what the process has.
MAX_SECONDS, MAX_MEMORY = 1.0, 512_000_000
# Which file is read, since when, and how many were read and rejected: kept where the process that watches can see it.
STATE = struct.Struct("<qdqq")


def corpus(target: Target) -> tuple[dict[str, bytes], list[str]]:
    """Files to begin from, and the names of those that are mutated."""
    files = dict(target.corpus())
    for pattern in target.files:
        files |= {path.name: path.read_bytes() for path in sorted(ROOT.glob(pattern))}
    # Where all but one kind only help to read it, that kind is damaged.
    beside = (
        {"columns.toml"} if "r.mat" in files else {file for file in files if "cell.csv" in files and "csv" not in file}
    )
    return files, sorted(files.keys() - beside)


def case(files: dict[str, bytes], names: list[str], target: str, seed: int, number: int) -> tuple[str, bytes]:
    """Name and content of a mutated file: a pure function of corpus, target, seed and number."""
    rng = random.Random(zlib.crc32(f"{target} {seed} {number}".encode()))
    name = rng.choice(names)
    others = [files[other] for other in names if other != name]
    return name, mutated(files[name], others, rng)


def read_many(name: str, seed: int, first: int, last: int, seconds: float, folder: str, pipe: Connection) -> None:
    """In a process of its own: read the files from ``first`` up to before ``last``, one after another."""
    import resource
    import warnings

    import bumpstop as bs

    warnings.simplefilter("ignore")
    home = Path(folder) / "files"
    home.mkdir(exist_ok=True)
    os.chdir(home)
    target = TARGETS[name]
    files, names = corpus(target)
    for file, content in files.items():
        Path(file).write_bytes(content)
    for file in names:  # imports and caches are not counted
        _read(target, Path(file), bs.InputError)
    gc.collect()
    gc.freeze()
    guarded = GuardedReader()
    space = 4096 * int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (space + MAX_MEMORY, resource.RLIM_INFINITY))
    with (Path(folder) / "state").open("r+b") as handle:
        state = mmap.mmap(handle.fileno(), STATE.size)
    counts = {"read": 0, "rejected": 0}
    pipe.send(("begun", 0, ""))
    parent, end, number = os.getppid(), time.monotonic() + seconds, first
    while number < last and (begin := time.monotonic()) < end and os.getppid() == parent:
        # In one piece: pack_into would write zeros first, which the process that watches may see.
        state[:] = STATE.pack(number, begin, *counts.values())
        file, content = case(files, names, name, seed, number)
        Path(file).write_bytes(content)
        begin = time.process_time()
        kind, text = _read(target, Path(file), bs.InputError)
        own = time.process_time() - begin
        seconds_there, memory_there = guarded.used()
        if kind != "found" and own + seconds_there > MAX_SECONDS:
            kind, text = "found", f"took more than {MAX_SECONDS:g} s"
        if kind != "found" and memory_there > MAX_MEMORY:
            kind, text = "found", f"its reader took more than {MAX_MEMORY / 1e6:g} MB"
        if kind == "found":
            pipe.send(("found", number, text))
        else:
            counts[kind] += 1
        number += 1
    state[:] = STATE.pack(number, time.monotonic(), *counts.values())


def _read(target: Target, path: Path, refusal: type[Exception]) -> tuple[str, str]:
    try:
        target.read(path)
    except refusal as error:
        # Of several faults each has a line of its own.
        message = max((str(fault) for fault in getattr(error, "faults", ()) or (error,)), key=len)
        if len(message) > 1500 or not message.strip() or "\n\n\n" in message:
            return "found", f"a message of {len(message)} letters"
        return "rejected", ""
    except KeyboardInterrupt:
        raise
    except BaseException:  # whatever a library raises, Rust's panics among it
        return "found", traceback.format_exc()
    if Path("pwned").exists():
        Path("pwned").unlink()
        return "found", "code of the file was run"
    return "read", ""
