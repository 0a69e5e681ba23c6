"""Detection: residuals, thresholds and their tuning, the detector, undetectable forces, and scores."""

from bumpstop.detection.detection_run import DetectionRun
from bumpstop.detection.detector import Detector
from bumpstop.detection.events import Event
from bumpstop.detection.loop.detector_file import describe_detector, save_detector
from bumpstop.detection.offline import detect, residual_record
from bumpstop.detection.scoring.labels import Label, load_labels
from bumpstop.detection.scoring.score import Score
from bumpstop.detection.scoring.scoring import Roc, Tolerance, event_times, gaps, roc, scaled_residual, score
from bumpstop.detection.sensitivity import (
    UndetectableForces,
    UndetectableStretch,
    largest_undetected_force,
    largest_undetected_torque,
    required_torque,
    undetectable_force_along,
    undetectable_forces,
    undetectable_stretches,
)
from bumpstop.detection.settings import DetectorSettings
from bumpstop.detection.thresholds import Thresholds
from bumpstop.detection.tuning.residual_file import ResidualSeries
from bumpstop.detection.tuning.residual_record import ResidualRecord
from bumpstop.detection.tuning.result import MAX_EXTRAPOLATION, Tuning
from bumpstop.detection.tuning.tuning import tune

__all__ = [
    "MAX_EXTRAPOLATION",
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
    "UndetectableForces",
    "UndetectableStretch",
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
    "undetectable_force_along",
    "undetectable_forces",
    "undetectable_stretches",
]
