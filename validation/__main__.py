"""Run the comparisons, print what they find and write the page."""

from __future__ import annotations

import argparse
import contextlib
import platform
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

REPOSITORY = Path(__file__).resolve().parent.parent
# The reference simulator and the scenarios to compare live with the tests.
if str(REPOSITORY / "tests") not in sys.path:
    sys.path.insert(0, str(REPOSITORY / "tests"))

import numpy as np  # noqa: E402

import bumpstop as bs  # noqa: E402
from bumpstop import _native  # noqa: E402
from validation import page, plant, urdf  # noqa: E402
from validation.campaign import faults, scale  # noqa: E402
from validation.collision import (  # noqa: E402
    batches,
    convergence,
    elastic_arm,
    elastic_two_laws,
    endings,
    instruction_sets,
    measured_forces,
    prediction,
    random_contacts,
    reference_simulator,
    requirement,
    two_laws,
    uncertainty,
)
from validation.detection import (  # noqa: E402
    sample_paths,
    tuning,
    undetectable_force,
)
from validation.facts import MissingFacts  # noqa: E402
from validation.findings import Findings  # noqa: E402
from validation.identification import (  # noqa: E402
    drives,
    gain_intervals,
    gains,
    generic_fit,
    tx40,
)
from validation.live import closed_loop, fuzz_sources, latency  # noqa: E402
from validation.measure import commissioning  # noqa: E402
from validation.program import fuzz, programs  # noqa: E402
from validation.schroeder2013 import (  # noqa: E402
    chapter5,
    chapter6,
    experiments,
    false_alarms,
    protocol,
    reference_runs,
    rich_gears,
    workspace,
)


class Comparison(Protocol):
    """What a module of a comparison has."""

    TITLE: str
    compare: Callable[..., None]


COMPARISONS = {
    "reference": reference_runs,
    "two_laws": two_laws,
    "reference_simulator": reference_simulator,
    "batches": batches,
    "convergence": convergence,
    "chapter6": chapter6,
    "chapter5": chapter5,
    "workspace": workspace,
    "prediction": prediction,
    "requirement": requirement,
    "uncertainty": uncertainty,
    "instruction_sets": instruction_sets,
    "elastic_arm": elastic_arm,
    "elastic_two_laws": elastic_two_laws,
    "random_contacts": random_contacts,
    "measured_forces": measured_forces,
    "endings": endings,
    "urdf": urdf,
    "plant": plant,
    "protocol": protocol,
    "rich_gears": rich_gears,
    "experiments": experiments,
    "false_alarms": false_alarms,
    "undetectable_force": undetectable_force,
    "tuning": tuning,
    "sample_paths": sample_paths,
    "drives": drives,
    "gain_intervals": gain_intervals,
    "gains": gains,
    "generic_fit": generic_fit,
    "tx40": tx40,
    "commissioning": commissioning,
    "faults": faults,
    "scale": scale,
    "program_fuzz": fuzz,
    "programs": programs,
    "live": latency,
    "closed_loop": closed_loop,
    "fuzz_sources": fuzz_sources,
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the command line asks for; returns the exit status."""
    parser = argparse.ArgumentParser(prog="python -m validation", description=__doc__)
    parser.add_argument("--out", type=Path, default=REPOSITORY / "out/validation", help="folder of the results")
    parser.add_argument("--quick", action="store_true", help="small sizes, for the tests")
    known = ", ".join(COMPARISONS)
    parser.add_argument(
        "--only", choices=list(COMPARISONS), metavar="NAME", action="append", help=f"may be repeated; of: {known}"
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
    begin = time.perf_counter()
    with contextlib.suppress(KeyboardInterrupt):
        for number, name in enumerate(names, start=1):
            sections.append(run(name, quick=options.quick))
            # Hours may lie between the first comparison and the last: what is found stands on the page at once.
            made_by["time"] = f"{time.perf_counter() - begin:.0f} s"
            page.write(options.out, sections, made_by, not_run=names[number:])
    checks = [check for findings in sections for check in findings.checks]
    failed = [check for check in checks if not check.passed]
    where = f"{made_by['time']}; {options.out / 'index.html'}" if sections else "nothing is written"
    print(f"\n{len(checks) - len(failed)} of {len(checks)} checks pass; {where}")
    for check in failed:
        print(f"  {check.line}")
    if not_run := names[len(sections) :]:
        print(f"interrupted; not run: {', '.join(not_run)}")
        return 130
    return 0 if all(findings.passed for findings in sections) else 1


def run(name: str, *, quick: bool) -> Findings:
    """Run one comparison. Whatever goes wrong in it is a failed check, and the others still run."""
    module: Comparison = COMPARISONS[name]
    findings = Findings(name, module.TITLE)
    print(f"\n{name}: {module.TITLE}", flush=True)
    begin = time.perf_counter()
    try:
        module.compare(findings, quick=quick)
    except MissingFacts as missing:
        findings.check("The figures to compare with are there", False, str(missing))
    except Exception as error:
        traceback.print_exc()
        findings.check("The comparison ends without an error", False, f"{type(error).__name__}: {error}")
    findings.seconds = time.perf_counter() - begin
    print(f"  {findings.seconds:.1f} s", flush=True)
    return findings


if __name__ == "__main__":
    sys.exit(main())
