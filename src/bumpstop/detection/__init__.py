"""Detection: residuals, thresholds and their tuning, the detector, where the arm is blind, and scores."""

from bumpstop.detection.detector import Detector
from bumpstop.detection.detector_file import describe_detector, save_detector
from bumpstop.detection.events import DetectionRun, Event
from bumpstop.detection.offline import detect, residual_record
from bumpstop.detection.scoring.labels import Label, load_labels
from bumpstop.detection.scoring.scoring import Roc, Score, Tolerance, event_times, gaps, roc, scaled_residual, score
from bumpstop.detection.sensitivity import (
    BlindForces,
    BlindStretch,
    blind_force_along,
    blind_forces,
    blind_stretches,
    largest_undetected_force,
    largest_undetected_torque,
    required_torque,
)
from bumpstop.detection.settings import DetectorSettings
from bumpstop.detection.thresholds import Thresholds
from bumpstop.detection.tuning.residual_file import ResidualSeries
from bumpstop.detection.tuning.residual_record import ResidualRecord
from bumpstop.detection.tuning.tuning import FARTHEST, Tuning, tune

__all__ = [
    "FARTHEST",
    "BlindForces",
    "BlindStretch",
    "DetectionRun",
    "Detector",
    "DetectorSettings",
    "Event",
    "Label",
    "ResidualRecord",
    "ResidualSeries",
    "Roc",
    "Score",
    "Thresholds",
    "Tolerance",
    "Tuning",
    "blind_force_along",
    "blind_forces",
    "blind_stretches",
    "describe_detector",
    "detect",
    "event_times",
    "gaps",
    "largest_undetected_force",
    "largest_undetected_torque",
    "load_labels",
    "required_torque",
    "residual_record",
    "roc",
    "save_detector",
    "scaled_residual",
    "score",
    "tune",
]
