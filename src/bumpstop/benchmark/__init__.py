"""Detectors of collisions of the literature beside bumpstop's own, on contacts that are known."""

from bumpstop.benchmark.comparison import DetectorBenchmark, OperatingPoint, compare_detectors, compare_signals
from bumpstop.benchmark.methods import (
    METHODS,
    BandPass,
    DirectResidual,
    FixedTorque,
    KalmanObserver,
    Method,
    MomentumObserver,
    SecondOrderObserver,
    SlidingModeObserver,
)
from bumpstop.benchmark.planted import PlantedRuns, planted_runs
from bumpstop.benchmark.recorded import compare_on_recording
from bumpstop.benchmark.signals import Signals, signals_of_motion, signals_of_residual

__all__ = [
    "METHODS",
    "BandPass",
    "DetectorBenchmark",
    "DirectResidual",
    "FixedTorque",
    "KalmanObserver",
    "Method",
    "MomentumObserver",
    "OperatingPoint",
    "PlantedRuns",
    "SecondOrderObserver",
    "Signals",
    "SlidingModeObserver",
    "compare_detectors",
    "compare_on_recording",
    "compare_signals",
    "planted_runs",
    "signals_of_motion",
    "signals_of_residual",
]
