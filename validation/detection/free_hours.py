"""Hours of contact-free work of the plant, and the residuals of the detector over them."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.detection import Detector, ResidualSeries
from bumpstop.joint import JointTorqueModel
from bumpstop.plant import Command, Gears, Plant
from bumpstop.plant.drive import ScatterPer
from bumpstop.plant.motions import workspace
from bumpstop.recording import Recording
from bumpstop.reproduction.schroeder2013.collisions import PERIOD_S, CollisionExperiment, Residual
from plant.cases import ROTORS, SENSORS, source_arm

_STANDS = 1e-4  # a joint slower than that has come to the end of a move [rad/s]


def moves(number: int, count: int) -> list[Command]:
    """The moves of a workspace motion of Schroeder (2013) one by one, each from rest to rest."""
    whole = workspace(source_arm(), number, count)
    slow = np.flatnonzero(np.abs(whole.qd).max(axis=1) < _STANDS)
    # Of the milliseconds around each halt the slowest; a move is longer than a tenth of a second.
    halts = [
        int(group[np.abs(whole.qd[group]).max(axis=1).argmin()])
        for group in np.split(slow, np.flatnonzero(np.diff(slow) > 100) + 1)
    ]
    parts = []
    for first, last in itertools.pairwise(halts):
        qd = whole.qd[first : last + 1].copy()
        qd[0] = qd[-1] = 0.0
        parts.append(Command(whole.q[first : last + 1], qd, whole.react))
    return parts


def recordings(parts: list[Command], count: int, scatter_per: ScatterPer, first_seed: int = 0) -> list[Recording]:
    """The moves one after another, ``count`` times, with friction and noise of other seeds each time.

    All that is random lies in what the sensors report: the arm is moved once, and every recording is, to the last bit,
    that of a plant of its own. With scatter per motion, every move has its own friction.
    """
    plant = Plant(
        source_arm(),
        JointTorqueModel.load("sia5d"),
        friction=Gears(rotor_inertia=ROTORS, scatter_per=scatter_per),
        sensors=SENSORS,
    )
    rows: list[list[tuple[FloatArray, FloatArray, FloatArray]]] = [[] for _ in range(count)]
    begin = 0.0
    for number, part in enumerate(parts):
        seeds = [first_seed + number * count + k for k in range(count)]
        runs = plant.runs(part, [(SENSORS, seed) for seed in seeds])
        for one, run in zip(rows, runs, strict=True):
            log = run.recording
            assert log.current is not None
            one.append((begin + log.t, log.q, log.current))
        # A move ends between two samples; the next goes on in the rhythm of the controller.
        begin += PERIOD_S * len(log.t)
    logs = []
    for one in rows:
        t, q, current = (np.concatenate(column) for column in zip(*one, strict=True))
        logs.append(replace(log, t=t, q=q, current=current, wrench=None))
    return logs


def residuals(logs: list[Recording], kind: Residual) -> Iterator[ResidualSeries]:
    """Residuals of the joints that Schroeder (2013) monitored, as a loop would have them."""
    made = CollisionExperiment(name="plexiglas", residual=kind).detector()
    settings = replace(made.settings, arming_delay_s=0.0)
    detector = Detector(made.robot, made.model, made.thresholds, settings)
    monitored = [j for j in range(made.robot.dof) if np.isfinite(made.thresholds.constant[j])]
    for log in logs:
        run = detector.run(log)
        seen = ~run.no_data
        yield ResidualSeries(run.t[seen], np.ascontiguousarray(run.residual[seen][:, monitored]))
