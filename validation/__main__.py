"""Run the comparisons, print what they find and write the page."""

from __future__ import annotations

import argparse
import contextlib
import os
import platform
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import bumpstop as bs
from bumpstop import _native
from validation import page
from validation.comparisons import COMPARISONS, run_all
from validation.findings import Findings

REPOSITORY = Path(__file__).resolve().parent.parent


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the command line asks for; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m validation", description=__doc__)
    parser.add_argument("--out", type=Path, default=REPOSITORY / "out/validation", help="folder of the results")
    parser.add_argument("--quick", action="store_true", help="small sizes, for the tests")
    known = ", ".join(COMPARISONS)
    parser.add_argument(
        "--only", choices=list(COMPARISONS), metavar="NAME", action="append", help=f"may be repeated; of: {known}"
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=os.cpu_count() or 1,
        metavar="N",
        help="comparisons at a time; as many as processors",
    )
    options = parser.parse_args(arguments)
    names = list(dict.fromkeys(options.only or COMPARISONS))
    made_by = {
        "bumpstop": bs.__version__,
        "kernels": _native.target,
        "Python": platform.python_version(),
        "NumPy": np.__version__,
        "machine": f"{platform.system()} {platform.machine()}",
        "sizes": "quick" if options.quick else "full",
    }
    sections: list[Findings] = []
    not_run = names
    begin = time.perf_counter()
    with contextlib.suppress(KeyboardInterrupt):
        for findings in run_all(names, quick=options.quick, jobs=options.jobs):
            sections = sorted([*sections, findings], key=lambda each: names.index(each.name))
            not_run = [name for name in not_run if name != findings.name]
            # Hours may lie between the first comparison and the last: what is found stands on the page at once.
            made_by["time"] = f"{time.perf_counter() - begin:.0f} s"
            page.write(options.out, sections, made_by, not_run=not_run)
    checks = [check for findings in sections for check in findings.checks]
    failed = [check for check in checks if not check.passed]
    where = f"{made_by['time']}; {options.out / 'index.html'}" if sections else "nothing is written"
    print(f"\n{len(checks) - len(failed)} of {len(checks)} checks pass; {where}")
    for check in failed:
        print(f"  {check.line}")
    if not_run:
        print(f"interrupted; not run: {', '.join(not_run)}")
        return 130
    return 0 if all(findings.passed for findings in sections) else 1


if __name__ == "__main__":
    sys.exit(main())
