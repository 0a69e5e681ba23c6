"""Runs of an experiment by speed, beside Schroeder's columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from bumpstop.errors import InputError, where_else
from bumpstop.output_files import write_bytes, write_parquet
from bumpstop.reproduction.schroeder2013.collisions import ARMING_S, PERIOD_S, Collision, CollisionExperiment, SourceRow
from bumpstop.text_files import to_toml


def median(values: Sequence[float | None]) -> float | None:
    """Of those that are there; None where none is."""
    given = [value for value in values if value is not None]
    return float(np.median(given)) if given else None


@dataclass(frozen=True, eq=False, kw_only=True)
class SpeedRow:
    """All runs at one speed.

    Attributes:
        speed_mm_s: of the hand.
        runs: one or more.
        source: what Schroeder (2013) has at this speed, or None.
        bound_N: of the force at detection, by eqs 4.2 to 4.4.
    """

    speed_mm_s: float
    runs: tuple[Collision, ...]
    source: SourceRow | None
    bound_N: float

    @property
    def hits(self) -> tuple[Collision, ...]:
        """Runs that detected the contact."""
        return tuple(run for run in self.runs if run.detected)

    @property
    def forces(self) -> list[float]:
        """At detection, of those [N]."""
        return [run.force for run in self.hits if run.force is not None]

    @property
    def joints(self) -> dict[int, int]:
        """How many of those each joint was over its threshold in, joints from 1."""
        count: dict[int, int] = {}
        for run in self.hits:
            for j in run.joints:
                count[j + 1] = count.get(j + 1, 0) + 1
        return dict(sorted(count.items()))

    def to_json(self) -> dict[str, Any]:
        """For programs; None where nothing was detected or Schroeder (2013) has no figure."""
        source = self.source
        return {
            "speed_mm_s": self.speed_mm_s,
            "runs": len(self.runs),
            "detected": len(self.hits),
            "false_alarms": sum(run.false_alarm for run in self.runs),
            "force_at_detection_N": median(self.forces),
            "least_force_at_detection_N": min(self.forces, default=None),
            "largest_force_at_detection_N": max(self.forces, default=None),
            "force_bound_N": self.bound_N,
            "torque_Nm": median([run.torque for run in self.hits]),
            "peak_force_N": median([run.peak for run in self.hits]),
            "largest_peak_force_N": max((run.peak for run in self.hits), default=None),
            "delay_s": median([run.delay for run in self.hits]),
            "joints": {str(joint): count for joint, count in self.joints.items()},
            "source": None
            if source is None
            else {
                "runs": source.runs,
                "false_alarms": source.false_alarms,
                "torque_Nm": source.torque_Nm,
                "force_at_detection_N": source.force_N,
                "peak_force_N": source.peak_N,
            },
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class CollisionTable:
    """An experiment at all its speeds.

    Attributes:
        experiment: what was run.
        rows: one for each speed.
        seed: of the first run at each speed; the others follow it.
    """

    experiment: CollisionExperiment
    rows: tuple[SpeedRow, ...]
    seed: int

    @classmethod
    def measure(
        cls,
        experiment: CollisionExperiment,
        *,
        runs: int = 10,
        seed: int = 0,
        speeds_mm_s: Sequence[float] = (),
        progress: Callable[[float], None] | None = None,
    ) -> CollisionTable:
        """Run it.

        Args:
            experiment: what to run.
            runs: at each speed.
            seed: of the first run at each speed.
            speeds_mm_s: instead of all of Schroeder's.
            progress: is given the share that is done after every run.

        Raises:
            InputError: a number cannot be used, or mujoco is not installed.
        """
        if not 1 <= runs <= 100_000:
            raise InputError("runs", f"is {runs}", "wanted 1 to 100000")
        if not 0 <= seed < 2**63:
            raise InputError("seed", f"is {seed}", "wanted a whole number from 0 to 2^63 - 1")
        known = {row.speed_mm_s: row for row in experiment.rows()}
        rows = []
        speeds = tuple(speeds_mm_s or known)
        for place, speed in enumerate(speeds):
            made = []
            for k in range(runs):
                made.append(experiment.run(speed / 1e3, seed + k))
                if progress is not None:
                    progress((place * runs + k + 1) / (len(speeds) * runs))
            rows.append(
                SpeedRow(
                    speed_mm_s=float(speed),
                    runs=tuple(made),
                    source=known.get(speed) if experiment.at == "hand" else None,
                    bound_N=experiment.force_bound(speed / 1e3),
                )
            )
        return cls(experiment=experiment, rows=tuple(rows), seed=seed)

    def settings(self) -> dict[str, Any]:
        """Everything that the runs follow from."""
        made, thing = self.experiment, self.experiment.object()
        return {
            "experiment": made.name,
            "source": made.table,
            "at": made.at,
            "stiffness_N_m": thing.stiffness,
            "stiffness_status": thing.status,
            "thresholds_Nm": made.thresholds.tolist(),
            "residual": made.residual,
            "reflected_inertia": made.reflected_inertia,
            "arming_delay_s": ARMING_S,
            "period_s": PERIOD_S,
            "reaction_latency_s": made.latency_s,
            "joint_acceleration_rad_s2": made.joint_acceleration,
            "loss": made.loss,
            "scatter_per": made.scatter_per,
            "threshold_force_N": made.threshold_force(),
            "speeds_mm_s": [row.speed_mm_s for row in self.rows],
            "runs": len(self.rows[0].runs),
            "seed": self.seed,
        }

    def to_json(self) -> dict[str, Any]:
        """For programs; an infinite threshold is None."""
        settings = self.settings()
        settings["thresholds_Nm"] = [None if np.isinf(x) else x for x in settings["thresholds_Nm"]]
        return settings | {"speeds": [row.to_json() for row in self.rows]}

    def save(self, folder: Path) -> list[Path]:
        """Write settings.toml, runs.parquet (a row for each run) and samples.parquet (force and residuals of all).

        Raises:
            InputError: the folder cannot be written.
        """
        import polars as pl

        runs: list[dict[str, Any]] = []
        samples = []
        for row in self.rows:
            for run in row.runs:
                key: dict[str, Any] = {"speed_mm_s": row.speed_mm_s, "seed": run.seed}
                runs.append(
                    key
                    | {
                        "detected": run.detected,
                        "false_alarm": run.false_alarm,
                        "contact_s": run.contact_s,
                        "alarm_s": run.alarm_s,
                        "joints": [j + 1 for j in run.joints],
                        "force_at_detection_N": run.force if run.detected else None,
                        "torque_Nm": run.torque,
                        "peak_force_N": run.peak,
                        "delay_s": run.delay,
                    }
                )
                log, found = run.run.recording, run.detection
                assert log.current is not None
                columns: dict[str, Any] = {name: np.full(len(log.t), value) for name, value in key.items()}
                columns |= {"t": log.t, "force_N": np.interp(log.t, run.run.trace.t, run.run.trace.contact_force[:, 0])}
                for stem, value in (("q", log.q), ("current", log.current), ("residual", found.residual)):
                    columns |= {f"{stem}_{j + 1}": value[:, j] for j in range(value.shape[1])}
                samples.append(pl.DataFrame(columns).fill_nan(None))
        names = [folder / name for name in ("settings.toml", "runs.parquet", "samples.parquet")]
        try:
            folder.mkdir(parents=True, exist_ok=True)
            write_bytes(names[0], to_toml(self.settings()).encode("utf-8"))
            write_parquet(names[1], pl.DataFrame(runs, infer_schema_length=None))
            write_parquet(names[2], pl.concat(samples))
        except OSError as error:
            problem = f"{str(folder)!r} cannot be written ({error.strerror or error})"
            raise InputError("--out", problem, where_else(error)) from None
        return names
