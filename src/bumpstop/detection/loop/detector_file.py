"""Detectors as text that C++ programs read without a library: include/bumpstop/detection/detector_description.hpp."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError
from bumpstop.model import describe
from bumpstop.text_files import write_text

if TYPE_CHECKING:
    from collections.abc import Iterable
    from pathlib import Path

    from bumpstop.detection.detector import Detector

_TORQUE = ("A", "B", "D", "F", "coulomb", "viscous", "stribeck", "stribeck_speed", "load", "hysteresis", "inertia")
_OF_SAMPLES = (
    "period",
    "shortest_interval",
    "late_interval",
    "longest_interval",
    "resolution",
    "measured_rates",
    "frozen_time",
)
_OF_THRESHOLDS = ("constant", "speed", "acceleration", "rest", "rest_speed", "fast")
_OF_DECISION = ("arming_delay", "rest_time", "low_hz", "high_hz", "event_pause")
_OF_DETECTOR = ("observer_gain", "window", "degree", "max_no_data_time", "unknown")
_RANGES = ("rest_speed", "current_low", "current_high", "speed_high")


def save_detector(detector: Detector, path: str | Path) -> None:
    """Write robot, joint model, thresholds and settings as one text for ``read_detector`` of C++.

    Raises:
        InputError: the settings have no period, or the file cannot be written.
    """
    write_text(path, describe_detector(detector))


def describe_detector(detector: Detector) -> str:
    """The text of :func:`save_detector`: that of ``describe``, then a line for each setting, with all digits.

    Raises:
        InputError: the settings have no period.
    """
    if detector.settings.period_s is None:
        raise InputError("period_s", "is not known", "a loop's detector needs the time between its samples")
    links, joints, errors = detector.parts()
    robot = replace(
        detector.robot,
        joints=tuple(
            replace(joint, rotor_inertia=rotor) for joint, (_, rotor) in zip(detector.robot.joints, links, strict=True)
        ),
    )
    kernel, n = detector.kernel_settings(detector.settings.period_s), robot.dof
    samples, decision, watch = kernel.samples, kernel.alarm, kernel.payload_monitor
    law = decision.thresholds
    number, point = robot.frame(detector.settings.link, detector.settings.point)
    lines = [
        "bumpstop-detector 2",
        f"residual {kernel.residual.name}",
        f"source {kernel.source.name}",
    ]
    for parameters, error in zip(joints, errors, strict=True):
        figures = _numbers(getattr(parameters, name) for name in (*_TORQUE, *_RANGES))
        lines.append(f"joint_torque {parameters.map.name} {parameters.friction.name} {figures}")
        lines.append(f"joint_errors {_numbers(getattr(error, name) for name in (*_TORQUE, 'friction'))}")
    lines += [] if detector.fitted is None else detector.fitted.lines()
    lines += [f"{name} {_numbers([getattr(samples, name)])}" for name in (*_OF_SAMPLES, "unmonitored", "endless")]
    lines += [f"{name} {_first(getattr(samples, name), n)}" for name in ("lower", "upper", "velocity", "signal")]
    lines += [f"{name} {_first(getattr(law, name), n)}" for name in _OF_THRESHOLDS]
    lines += [f"{name} {_numbers([getattr(decision, name)])}" for name in _OF_DECISION]
    lines += [f"{name} {_numbers([getattr(kernel, name)])}" for name in _OF_DETECTOR]
    lines += [
        f"model_errors {_numbers([law.model_errors])}",
        f"noise_sd {_first(kernel.noise_sd, n)}",
        f"dead_zone {_first(kernel.dead_zone, n)}",
        f"gravity {_numbers(kernel.gravity)}",
        f"direction {_numbers(kernel.direction)}",
        f"contact {number} {_numbers(point)}",
        f"payload {_numbers([kernel.payload.mass, *kernel.payload.center])}",
        f"payload_monitor {_numbers([watch.window])}",
        f"payload_interval {_numbers([watch.interval])}",
        f"payload_least {_numbers([watch.min_mass])}",
        f"payload_share {_numbers([watch.min_share])}",
        f"payload_change {_numbers([watch.min_change])}",
        "end",
    ]
    return describe(robot) + "\n".join(lines) + "\n"


def _numbers(values: Iterable[Any]) -> str:
    return " ".join(repr(float(value)) for value in values)


def _first(values: Any, count: int) -> str:
    return _numbers(list(values)[:count])
