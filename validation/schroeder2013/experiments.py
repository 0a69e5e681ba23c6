"""Schroeder's collisions of chapter 4 on the plant."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import RegularGridInterpolator

from bumpstop.reproduction.schroeder2013.collision_table import CollisionTable
from bumpstop.reproduction.schroeder2013.collisions import CollisionExperiment
from validation.findings import Findings

TITLE = "Collisions of chapter 4"
# Stiffnesses [N/m] and latencies [s] between which the fit interpolates.
GRIDS = {
    "fiberboard": ((8e3, 15e3, 30e3, 60e3, 120e3), (0.0, 0.02, 0.04, 0.08, 0.12)),
    "banana": ((6e3, 12e3, 25e3, 50e3, 100e3), (0.0, 0.015, 0.03, 0.06, 0.12)),
}


def compare(findings: Findings, *, quick: bool) -> None:
    """Detection and forces, and the fit of two objects."""
    _collisions(findings, runs=1 if quick else 100, speeds=1 if quick else None)
    if not quick:
        for name in GRIDS:
            _fit(findings, name, runs=100)


def _collisions(findings: Findings, *, runs: int, speeds: int | None) -> None:
    for name in ("plexiglas", "fiberboard", "glass", "banana"):
        made = CollisionExperiment(name=name)
        chosen = [row.speed_mm_s for row in made.rows()][:speeds]
        table = CollisionTable.measure(made, runs=runs, speeds_mm_s=chosen)
        shown = []
        for row in table.rows:
            assert row.source is not None
            where = f"{name}, {row.speed_mm_s:g} mm/s"
            forces = row.forces or [0.0]
            if row.source.detected:
                findings.check(f"{where}: detected", len(row.hits) == runs, f"{len(row.hits)} of {runs} runs")
            findings.check(
                f"{where}: force at detection inside the band of eq 4.4",
                min(forces) > 0 and max(forces) <= row.bound_N,
                f"{min(forces):.1f} to {max(forces):.1f} N, bound {row.bound_N:.1f} N",
            )
            peaks = [run.peak for run in row.hits] or [0.0]
            if name == "plexiglas" and row.speed_mm_s == 25 and row.source.peak_N is not None and runs > 1:
                ratio = float(np.median(peaks)) / row.source.peak_N - 1
                findings.check(f"{where}: median peak within 25 % of Schroeder's", abs(ratio) <= 0.25, f"{ratio:+.1%}")
            alarms = sum(run.false_alarm for run in row.runs)
            of_source = ["" if value is None else f"{value:.1f}" for value in (row.source.force_N, row.source.peak_N)]
            shown.append(
                [
                    where,
                    len(row.hits),
                    alarms,
                    float(np.median(forces)),
                    of_source[0],
                    float(np.median(peaks)),
                    of_source[1],
                ]
            )
        findings.table(
            f"{name}: {runs} runs a speed, medians",
            ["Object, speed", "Noticed", "False alarms", "At detection [N]", "Schroeder", "Peak [N]", "Schroeder"],
            ["", "d", "d", ".1f", "", ".1f", ""],
            shown,
        )


def fitted(name: str, seeds: int = 3) -> tuple[float, float]:
    """Stiffness [N/m] and reaction latency [s] that fit Schroeder's peaks at the two slowest speeds.

    Every point of the grid sees the same few draws of friction and place, so that only the two parameters differ.
    """
    rows = CollisionExperiment(name=name).rows()[:2]
    stiffness, latency = (np.array(axis) for axis in GRIDS[name])
    fine = np.meshgrid(
        np.geomspace(stiffness[0], stiffness[-1], 301), np.linspace(latency[0], latency[-1], 301), indexing="ij"
    )
    error = np.zeros(fine[0].shape)
    for row in rows:
        assert row.peak_N is not None
        peaks = [
            [
                np.median(
                    [
                        CollisionExperiment(name=name, stiffness=k, latency_s=late).run(row.speed_mm_s / 1e3, seed).peak
                        for seed in range(seeds)
                    ]
                )
                for late in latency.tolist()
            ]
            for k in stiffness.tolist()
        ]
        surface = RegularGridInterpolator((np.log(stiffness), latency), np.log(peaks))
        error += (surface((np.log(fine[0]), fine[1])) - np.log(row.peak_N)) ** 2
    best = np.unravel_index(np.argmin(error), error.shape)
    return float(fine[0][best]), float(fine[1][best])


def _fit(findings: Findings, name: str, *, runs: int) -> None:
    stiffness, latency = fitted(name)
    findings.say(
        f"{name}: Schroeder's peaks at the two slowest speeds are fitted best by {stiffness:.0f} N/m and a reaction "
        f"{1e3 * latency:.1f} ms after the alarm, within the ranges searched. The other speeds are predicted with them."
    )
    made = CollisionExperiment(name=name, stiffness=stiffness, latency_s=latency)
    shown = []
    for number, row in enumerate(made.rows()):
        if row.peak_N is None or not row.detected:
            continue
        found = float(np.median([made.run(row.speed_mm_s / 1e3, seed).peak for seed in range(runs)]))
        use = "fitted" if number < 2 else "predicted"
        shown.append([f"{row.speed_mm_s:g} mm/s, {use}", found, row.peak_N, 100 * (found / row.peak_N - 1)])
    findings.table(
        f"{name}: peaks after the fit, median of {runs} runs",
        ["Speed", "Plant [N]", "Schroeder [N]", "Difference [%]"],
        ["", ".1f", ".1f", "+.1f"],
        shown,
    )
