"""The comparisons by name, and how they are run: one after the other, or several at a time."""

from __future__ import annotations

import contextlib
import io
import multiprocessing
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from typing import Protocol

from validation import plant, urdf
from validation.campaign import faults, scale
from validation.collision import (
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
from validation.detection import (
    sample_paths,
    tuning,
    undetectable_force,
)
from validation.facts import MissingFacts
from validation.findings import Findings
from validation.identification import (
    drives,
    gain_intervals,
    gains,
    generic_fit,
    tx40,
)
from validation.live import closed_loop, fuzz_sources, latency
from validation.measure import commissioning
from validation.program import fuzz, programs
from validation.schroeder2013 import (
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
# They race with processes and clocks of this machine: nothing else runs beside them.
ALONE = frozenset({"closed_loop", "faults", "live", "scale"})


def run_all(names: Sequence[str], *, quick: bool, jobs: int) -> Iterator[Findings]:
    """Each comparison's findings as it ends: several at a time, then those that run alone."""
    together = [name for name in names if name not in ALONE]
    if jobs > 1 and len(together) > 1:
        yield from _run_together(together, quick=quick, jobs=jobs)
    else:
        yield from (run(name, quick=quick) for name in together)
    yield from (run(name, quick=quick) for name in names if name in ALONE)


def _run_together(names: Sequence[str], *, quick: bool, jobs: int) -> Iterator[Findings]:
    """Run each comparison in a process of its own; what it prints is printed when it ends."""
    spawning = multiprocessing.get_context("spawn")
    # A process for each: what one has read and computed, gigabytes of it, is not kept beside the next.
    with ProcessPoolExecutor(jobs, mp_context=spawning, max_tasks_per_child=1) as pool:
        running = {pool.submit(_run_told, name, quick=quick): name for name in names}
        try:
            while running:
                # Polars restarts system calls after a signal: Ctrl-C is heard between two waits only.
                for ended in wait(running, timeout=1, return_when=FIRST_COMPLETED).done:
                    yield _result(ended, running.pop(ended))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for process in multiprocessing.active_children():
                process.terminate()
            raise


def _run_told(name: str, *, quick: bool) -> tuple[Findings, str]:
    with contextlib.redirect_stdout(io.StringIO()) as told:
        return run(name, quick=quick), told.getvalue()


def _result(ended: Future[tuple[Findings, str]], name: str) -> Findings:
    try:
        findings, told = ended.result()
    except Exception as error:  # the process has died, or its findings cannot be sent
        findings = Findings(name, COMPARISONS[name].TITLE)
        print(f"\n{name}: {findings.title}")
        findings.check("The comparison's process tells what it finds", False, f"{type(error).__name__}: {error}")
    else:
        print(told, end="", flush=True)
    return findings


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
