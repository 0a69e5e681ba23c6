"""Detection: residuals, where the arm is blind, thresholds tuned to a rate of false alarms, and scores."""

from bumpstop.detection.labels import Label, load_labels
from bumpstop.detection.residual_file import ResidualSeries
from bumpstop.detection.residuals import ResidualRecord
from bumpstop.detection.scoring import Roc, Score, Tolerance, event_times, gaps, roc, scaled_residual, score
from bumpstop.detection.sensitivity import (
    BlindForces,
    blind_force_along,
    blind_forces,
    largest_undetected_force,
    largest_undetected_torque,
    required_torque,
)
from bumpstop.detection.tuning import FARTHEST, Tuning, tune

__all__ = [
    "FARTHEST",
    "BlindForces",
    "Label",
    "ResidualRecord",
    "ResidualSeries",
    "Roc",
    "Score",
    "Tolerance",
    "Tuning",
    "blind_force_along",
    "blind_forces",
    "event_times",
    "gaps",
    "largest_undetected_force",
    "largest_undetected_torque",
    "load_labels",
    "required_torque",
    "roc",
    "scaled_residual",
    "score",
    "tune",
]
