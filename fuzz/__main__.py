"""Read mutated files with every reader, count what happens, and keep what should not have."""

from __future__ import annotations

import argparse
import multiprocessing
import os
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fuzz.reading import ROOT, STATE, case, corpus, read_many
from fuzz.tally import Tallies, Tally
from fuzz.targets import TARGETS

# By the wall, where others use the machine too, an execution is ended after this long.
_HANG_SECONDS = 40.0
_SAVE_SECONDS = 20.0
_MAX_STARTS = 200


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the command line asks for; 1 where anything was found."""
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__)
    parser.add_argument(
        "--seconds", type=float, help="for each target; 5 without --executions, else as long as it takes"
    )
    parser.add_argument("--executions", type=int, default=sys.maxsize, help="of each target and seed, at most")
    parser.add_argument("--only", action="append", choices=list(TARGETS), metavar="NAME", help=", ".join(TARGETS))
    parser.add_argument("--seed", type=int, default=0, help="of the mutations; those of another seed are others")
    parser.add_argument("--counts", type=Path, help="file of counts that a run goes on from, and adds to")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "fuzz", help="folder for what was found")
    options = parser.parse_args(arguments)
    seconds = options.seconds or (5.0 if options.executions == sys.maxsize else float("inf"))
    # The files are small: further threads would only be woken.
    os.environ.setdefault("POLARS_MAX_THREADS", "1")
    tallies = Tallies.load(options.counts)
    print(f"{'target':18} {'executions':>10} {'read':>8} {'rejected':>9}  found", flush=True)
    total, found = 0, 0
    for name in options.only or TARGETS:
        tally = fuzz(name, options.seed, options.executions, seconds, options.out, tallies)
        total += tally.executions
        found += len(tally.kinds)
        kinds = "; ".join(f"{kind} ({file})" for kind, file in tally.kinds.items()) or "nothing"
        print(f"{name:18} {tally.executions:>10} {tally.read:>8} {tally.rejected:>9}  {kinds}", flush=True)
    print(f"{total} executions, {found} kinds of findings")
    return 1 if found else 0


def fuzz(name: str, seed: int, executions: int, seconds: float, out: Path, tallies: Tallies) -> Tally:
    """Read mutated files with one reader, from where its tally ends up to so many executions; the tally."""
    run = _Run(name, seed, executions, seconds, out, tallies)
    # Files are written and read once: in memory, where there is a place for them.
    place = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(prefix="bumpstop-fuzz-", dir=place) as folder:
        while run.seconds > 0 and run.starts < _MAX_STARTS and run.tally.executions < executions:
            run.watch(Path(folder))
    return run.tally


@dataclass
class _Run:
    """One target: a process that reads, started again where it died.

    Attributes:
        name: of the target.
        seed: of the mutations.
        last: number of executions to end at.
        seconds: that are left.
        out: folder for what is found.
        tallies: of all targets, written down while it reads.
        starts: of processes.
    """

    name: str
    seed: int
    last: int
    seconds: float
    out: Path
    tallies: Tallies
    starts: int = 0

    @property
    def tally(self) -> Tally:
        """Of this target and seed; the next file has the number of its executions."""
        return self.tallies.of(self.name, self.seed)

    def watch(self, folder: Path) -> None:
        """Start the process, take what it says, and end it where a file takes too long."""
        self.starts += 1
        place = folder / "state"
        place.write_bytes(STATE.pack(self.tally.executions, time.monotonic(), 0, 0))
        before = replace(self.tally)
        ours, theirs = multiprocessing.Pipe(duplex=False)
        process = multiprocessing.get_context("spawn").Process(
            target=read_many,
            args=(self.name, self.seed, before.executions, self.last, self.seconds, str(folder), theirs),
            daemon=True,
        )
        process.start()
        theirs.close()
        begun, saved, hung = None, time.monotonic(), False
        while True:
            now = time.monotonic()
            try:
                if ours.poll(0.2):
                    kind, number, text = ours.recv()
                    if kind == "begun":
                        begun = now
                    else:
                        self._found(number, text)
                    continue
            except EOFError:
                break
            since = self._count(place, before)
            if begun is not None and now - since > _HANG_SECONDS:
                hung = True
                process.kill()
                break
            if now - saved > _SAVE_SECONDS:
                self.tallies.save()
                saved = now
        process.join()
        self._count(place, before)
        if hung or process.exitcode:
            self._found(self.tally.executions, "hang" if hung else f"the process ended with {process.exitcode}")
            self.tally.executions += 1
        self.tallies.save()
        self.seconds -= 0.0 if begun is None else time.monotonic() - begun

    def _count(self, place: Path, before: Tally) -> float:
        """Take the state of the process; since when it reads the file it is at [s]."""
        self.tally.executions, since, read, rejected = STATE.unpack(place.read_bytes())
        self.tally.read, self.tally.rejected = before.read + read, before.rejected + rejected
        return float(since)

    def _found(self, number: int, text: str) -> None:
        """Count a finding, and keep the file of the first of its kind."""
        self.tally.found += 1
        kind = text.splitlines()[-1][:200]
        if kind in self.tally.kinds:
            return
        place = self.out / f"{self.name}-{self.seed}-{number}"
        place.mkdir(parents=True, exist_ok=True)
        file, content = case(*corpus(TARGETS[self.name]), self.name, self.seed, number)
        (place / file).write_bytes(content)
        (place / "what.txt").write_text(text, encoding="utf-8")
        self.tally.kinds[kind] = str(place / file)


if __name__ == "__main__":
    sys.exit(main())
