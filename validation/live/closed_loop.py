"""Collisions of Schroeder (2013), detected by a monitor in another process that has the plant go back."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from bumpstop.detection import save_detector
from bumpstop.live.bench import BenchLink, BenchRun, DdsLink, PlantBench, RtdeLink
from bumpstop.plant import Plant, PlantReaction
from bumpstop.reproduction.schroeder2013.collisions import PERIOD_S, Collision, CollisionExperiment
from validation.findings import Findings

TITLE = "The control loop closed over RTDE and DDS"
EXPERIMENT = "plexiglas"  # tables 4.2 and 4.3
PROTOCOLS = ("RTDE", "DDS")
TOPIC = "/closed_loop/joint_states"
# Of the offline experiment's peak force.
MAX_PEAK_DIFFERENCE = 0.05
# How long a monitor may take to begin [s].
_WAIT_S = 60.0
# Without a sample for longer the monitor forgets the past [s]: a plant that others keep from computing is no robot that
# stopped.
_STOP_AFTER_S = 5.0
# Both sides come before other work where the system allows it, as loops of controllers do.
_PRIORITY = -10


@dataclass(frozen=True, eq=False, kw_only=True)
class ClosedLoop:
    """One collision of the closed loop beside the same of the offline experiment.

    Attributes:
        offline: in one process; the reaction begins one feedback period after the sample that alarms.
        as_late: the same with a reaction as late as that of the closed loop.
        bench: with the monitor in another process.
        monitor: its summary.
    """

    offline: Collision
    as_late: Collision
    bench: BenchRun
    monitor: dict[str, object]

    @property
    def reversed(self) -> bool:
        """The monitor answered, and the arm went back."""
        return self.bench.answer is not None and self.bench.run.reaction_time is not None

    @property
    def peak_ratio(self) -> float:
        """Peak force over the offline experiment's."""
        return self.bench.run.peak_force / self.offline.peak

    @property
    def added_s(self) -> float:
        """How much later than offline the reaction began, by the plant's clock [s]."""
        return added_latency(self.bench, self.offline)


def added_latency(bench: BenchRun, offline: Collision) -> float:
    """How much later the reaction of the bench began, by the plant's clock [s]; NaN: one of them did not react."""
    begun, wanted = bench.run.reaction_time, offline.run.reaction_time
    return float("nan") if begun is None or wanted is None else begun - wanted


def closed_loop(
    experiment: CollisionExperiment, protocol: str, speed: float, seed: int, folder: Path, domain: int, pace: float
) -> ClosedLoop:
    """Run one collision with a monitor in another process, and the same offline; ``pace`` 1 is real time."""
    file = folder / "arm.detector"
    save_detector(experiment.detector(), file)
    plant = experiment.plant(speed, seed)
    link = _link(plant, protocol, domain)
    bench = PlantBench(plant, [link], PlantReaction(joint_acceleration=experiment.joint_acceleration), pace)
    where = link.address if protocol == "RTDE" else f"dds://{TOPIC.lstrip('/')}?domain={domain}"
    command = [sys.executable, "-c", "from bumpstop.cli.main import main; main()", "monitor", where]
    command += ["--detector", str(file), "--answer", "reverse", "--json", "--rearm-s", "inf"]
    command += ["--stop-after-s", str(_STOP_AFTER_S)]
    monitor = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=os.environ | {"ROS_LOCALHOST_ONLY": "1"})
    before = os.getpriority(os.PRIO_PROCESS, 0)
    with contextlib.suppress(PermissionError):
        for process in (monitor.pid, 0):
            os.setpriority(os.PRIO_PROCESS, process, _PRIORITY)
    try:
        if not bench.wait_for_client(_WAIT_S):
            raise RuntimeError(f"no monitor came to {where}")
        run = bench.run(experiment.command(speed))
    finally:
        with contextlib.suppress(PermissionError):
            os.setpriority(os.PRIO_PROCESS, 0, before)
        bench.close()
        monitor.terminate()
        printed, _ = monitor.communicate(timeout=_WAIT_S)
    offline = experiment.run(speed, seed)
    added = added_latency(run, offline)
    late = replace(experiment, latency_s=experiment.latency_s + added) if added > 1e-9 else None
    as_late = offline if late is None else late.run(speed, seed)
    return ClosedLoop(offline=offline, as_late=as_late, bench=run, monitor=_summary(printed))


def _summary(printed: str) -> dict[str, object]:
    """Of the monitor; one that was still looking for its source has seen nothing."""
    return dict(json.loads(printed)) if printed.strip() else {"samples": 0}


def _link(plant: Plant, protocol: str, domain: int) -> BenchLink:
    return RtdeLink(plant, 0) if protocol == "RTDE" else DdsLink(plant, TOPIC, domain=domain)


def compare(findings: Findings, *, quick: bool) -> None:
    """All speeds of the table over both protocols."""
    experiment = CollisionExperiment(name=EXPERIMENT)
    rows = experiment.rows()[1:2] if quick else experiment.rows()
    seeds = range(1 if quick else 5)
    # A test may run beside others, and half the speed leaves them the time they take.
    pace = 0.5 if quick else 1.0
    findings.say(
        f"The SIA5D runs into {EXPERIMENT} at the speeds of {experiment.table}. The plant moves in real time behind a "
        "protocol; a monitor in another process sees its samples and answers its alarm on the same way. Offline, "
        "the detector is called in the plant's own process, and the reaction begins one feedback period "
        f"({1e3 * PERIOD_S:g} ms) after the sample that alarms. In the closed loop it begins at the first sample after "
        "the answer."
    )
    domain = 100 + os.getpid() % 100
    with tempfile.TemporaryDirectory() as folder:
        for protocol in PROTOCOLS:
            done = {
                row.speed_mm_s: [
                    closed_loop(experiment, protocol, row.speed_mm_s / 1e3, seed, Path(folder), domain, pace)
                    for seed in seeds
                ]
                for row in rows
            }
            _report(findings, protocol, done)


def _report(findings: Findings, protocol: str, done: dict[float, list[ClosedLoop]]) -> None:
    shown = []
    for speed, runs in done.items():
        found = sum(run.reversed for run in runs)
        findings.check(f"{protocol}, {speed:g} mm/s: found and reversed", found == len(runs), f"{found} of {len(runs)}")
        ratios = np.array([run.peak_ratio for run in runs])
        worst = float(np.abs(ratios - 1).max())
        findings.check(
            f"{protocol}, {speed:g} mm/s: peak forces as offline within {MAX_PEAK_DIFFERENCE:.0%}",
            worst <= MAX_PEAK_DIFFERENCE,
            f"at most {worst:.2%} apart",
        )
        exact = [abs(run.bench.run.peak_force / run.as_late.peak - 1) for run in runs]
        findings.check(
            f"{protocol}, {speed:g} mm/s: peak forces as offline with the latency that was measured",
            max(exact) <= 1e-9,
            f"at most {max(exact):.1e} apart",
        )
        peaks = float(np.median([run.bench.run.peak_force for run in runs]))
        offline = float(np.median([run.offline.peak for run in runs]))
        false = sum(run.offline.false_alarm for run in runs)
        late = sum(run.added_s > 1e-9 for run in runs)
        shown.append([f"{speed:g} mm/s", len(runs), false, peaks, offline, 1e2 * worst, late])
    findings.table(
        f"Peak forces over {protocol}",
        [
            "Speed",
            "Runs",
            "Alarms before contact",
            "Median [N]",
            "Offline [N]",
            "Apart at most [%]",
            "Later than offline",
        ],
        ["", "d", "d", ".1f", ".1f", ".2f", "d"],
        shown,
    )
    every = [run for runs in done.values() for run in runs]
    trips = np.array([1e3 * trip[1] for run in every if (trip := run.bench.round_trip()) is not None])
    added = np.array([1e3 * run.added_s for run in every])
    slips = [run.bench.slipped_s for run in every]
    findings.say(
        f"{protocol}: from the sample to the answer at the plant {np.median(trips):.2f} ms in the median, "
        f"{trips.max():.2f} ms at most, of {len(trips)} runs. By the plant's clock the reaction began "
        f"{np.nanmean(added):.2f} ms later than offline in the mean, {np.nanmax(added):.0f} ms at most. The plant "
        f"computed up to {max(slips):.2f} s of a motion too slowly for this machine; its clock waited meanwhile."
    )
    findings.figures[protocol] = {"answer_ms": trips.tolist(), "added_ms": added.tolist()}
    samples = [(len(run.bench.published), run.monitor["samples"]) for run in every]
    lost = sum(sent - int(str(seen)) for sent, seen in samples)
    findings.check(f"{protocol}: no sample is lost", lost == 0, f"{lost} of {sum(sent for sent, _ in samples)}")
