"""Curves that a gauge records of a mass that runs into its spring, whose closed form is known."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


def sprung_mass(
    mass: float, stiffness: float, speed: float, *, rate: float, before: float = 0.02, after: float = 0.7
) -> tuple[Array, Array, float]:
    """Time, force and peak force of a mass on a spring: v sqrt(m K) sin(w t) until they part."""
    omega = math.sqrt(stiffness / mass)
    time = np.arange(round((before + after) * rate)) / rate - before + 0.37 / rate
    peak = speed * math.sqrt(mass * stiffness)
    touched = (time > 0) & (time < math.pi / omega)
    return time, np.where(touched, peak * np.sin(omega * np.clip(time, 0, math.pi / omega)), 0.0), peak


def pressed(*, rate: float = 5000.0, noise: float = 0.3, seed: int = 0, after: float = 1.2) -> tuple[Array, Array]:
    """A clamped contact: a peak of about 140 N, 60 N that stay until 0.9 s, then free."""
    time = np.arange(round((0.05 + after) * rate)) / rate - 0.05
    rise = 1 - np.exp(-np.clip(time, 0, None) / 0.01)
    force = np.where(time > 0, 60 * rise + 110 * np.exp(-np.clip(time, 0, None) / 0.05) * rise, 0.0)
    force = np.where(time > 0.9, 0.0, force)
    return time, force + noise * np.random.default_rng(seed).standard_normal(time.size)


def write(
    path: Path,
    time: Array,
    force: Array,
    header: str = "Time [s];Force [N]",
    *,
    separator: str = ";",
    comma: bool = False,
) -> Path:
    """A recording as CSV."""
    lines = [header] + [f"{t!r}{separator}{f!r}" for t, f in zip(time.tolist(), force.tolist(), strict=True)]
    text = "\n".join(lines) + "\n"
    path.write_text(text.replace(".", ",") if comma else text, encoding="utf-8")
    return path


def write_with_pressure(path: Path, time: Array, force: Array, pressure: Array, unit: str = "N/cm2") -> Path:
    """A recording with a column of pressure."""
    rows = zip(time.tolist(), force.tolist(), pressure.tolist(), strict=True)
    text = "".join(f"{t!r};{f!r};{p!r}\n" for t, f, p in rows)
    path.write_text(f"Time [s];Force [N];Pressure [{unit}]\n{text}", encoding="utf-8")
    return path
