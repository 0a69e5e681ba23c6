"""Read mutated files with every reader, count what happens, and keep what should not have."""

from __future__ import annotations

import argparse
import multiprocessing
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from fuzz.reading import NUMBER, ROOT, case, corpus, read_many
from fuzz.targets import TARGETS

# By the wall, where others use the machine too, an execution is ended after this long.
_HANG_SECONDS = 40.0
_MAX_STARTS = 200


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the command line asks for; 1 where anything was found."""
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=5.0, help="for each target")
    parser.add_argument("--only", action="append", choices=list(TARGETS), metavar="NAME", help=", ".join(TARGETS))
    parser.add_argument("--seed", type=int, default=0, help="of the mutations; those of another seed are others")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "fuzz", help="folder for what was found")
    options = parser.parse_args(arguments)
    print(f"{'target':18} {'executions':>10} {'read':>8} {'rejected':>9}  found")
    total, found = Counter[str](), 0
    for name in options.only or TARGETS:
        counts, findings = fuzz(name, options.seconds, options.seed, options.out)
        total.update(counts)
        found += len(findings)
        done = counts["read"] + counts["rejected"] + counts["found"]
        print(f"{name:18} {done:>10} {counts['read']:>8} {counts['rejected']:>9}  {'; '.join(findings) or 'nothing'}")
    print(f"{total['read'] + total['rejected'] + total['found']} executions, {found} kinds of findings")
    return 1 if found else 0


def fuzz(name: str, seconds: float, seed: int, out: Path) -> tuple[Counter[str], list[str]]:
    """Read mutated files with one reader; counts, and one line for each kind of finding."""
    run = _Run(name, seed, out, seconds)
    with tempfile.TemporaryDirectory(prefix="bumpstop-fuzz-") as folder:
        while run.seconds > 0 and run.starts < _MAX_STARTS:
            run.watch(Path(folder))
    return run.counts, [f"{kind} ({file})" for kind, file in run.kinds.items()]


@dataclass
class _Run:
    """One target: a process that reads, started again where it died.

    Attributes:
        name: of the target.
        seed: of the mutations.
        out: folder for what is found.
        seconds: that are left.
        number: of the next file.
        starts: of processes.
        counts: of executions, by what became of them.
        kinds: of findings, with the file of the first of each.
    """

    name: str
    seed: int
    out: Path
    seconds: float
    number: int = 0
    starts: int = 0
    counts: Counter[str] = field(default_factory=Counter)
    kinds: dict[str, str] = field(default_factory=dict)

    def watch(self, folder: Path) -> None:
        """Start the process, take what it says, and end it where a file takes too long."""
        self.starts += 1
        place = folder / "number"
        place.write_bytes(NUMBER.pack(self.number, time.monotonic()))
        ours, theirs = multiprocessing.Pipe(duplex=False)
        process = multiprocessing.get_context("spawn").Process(
            target=read_many, args=(self.name, self.seed, self.number, self.seconds, str(folder), theirs), daemon=True
        )
        process.start()
        theirs.close()
        begun = None
        hung = False
        while True:
            try:
                if ours.poll(0.2):
                    kind, count, text = ours.recv()
                    begun = time.monotonic() if kind == "begun" else begun
                    self._take(kind, count, text)
                    continue
            except EOFError:
                break
            since = NUMBER.unpack(place.read_bytes())[1]
            if begun is not None and time.monotonic() - since > _HANG_SECONDS:
                hung = True
                process.kill()
                break
        process.join()
        self.number = int(NUMBER.unpack(place.read_bytes())[0])
        if hung or process.exitcode:
            self._take("found", self.number, "hang" if hung else f"the process ended with {process.exitcode}")
        self.number += 1
        self.seconds -= 0.0 if begun is None else time.monotonic() - begun

    def _take(self, kind: str, number: int, text: str) -> None:
        if kind == "begun":
            return
        self.counts[kind] += 1 if kind == "found" else number
        if kind == "found":
            _keep(self.name, self.seed, number, text, self.out, self.kinds)


def _keep(name: str, seed: int, number: int, text: str, out: Path, kinds: dict[str, str]) -> None:
    """Keep the file of the first finding of a kind."""
    kind = text.splitlines()[-1][:200]
    if kind in kinds:
        return
    place = out / f"{name}-{seed}-{number}"
    place.mkdir(parents=True, exist_ok=True)
    file, content = case(*corpus(TARGETS[name]), name, seed, number)
    (place / file).write_bytes(content)
    (place / "what.txt").write_text(text, encoding="utf-8")
    kinds[kind] = str(place / file)


if __name__ == "__main__":
    sys.exit(main())
