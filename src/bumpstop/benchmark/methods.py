"""Detectors of collisions from the literature, each written small: what it makes of a recording, and its lag.

All give an estimate of what the environment exerts on the joints, with the sign of the residual. They see the same
positions, torques and rates.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.benchmark.signals import Signals


class Method(ABC):
    """A way to detect collisions.

    Attributes:
        name: of the method.
        source: paper.
    """

    name: ClassVar[str]
    source: ClassVar[str]

    @abstractmethod
    def residual(self, signals: Signals) -> FloatArray:
        """(runs, rows, joints), minus the external torque or what stands for it [Nm or N]."""

    @property
    @abstractmethod
    def lag_s(self) -> float:
        """How far it is behind a contact torque that grows evenly, in theory [s]; NaN where it does not follow."""


@dataclass(frozen=True)
class DirectResidual(Method):
    """Motor torque minus Newton-Euler torque, at accelerations fitted to a window: bumpstop's own.

    A contact torque shows at once. Accelerations are half a window late, which is noise, no lag.
    """

    name: ClassVar[str] = "direct residual (bumpstop)"
    source: ClassVar[str] = "Schroeder (2013), eq 4.1"

    def residual(self, signals: Signals) -> FloatArray:  # noqa: D102
        return signals.direct

    @property
    def lag_s(self) -> float:  # noqa: D102
        return 0.0


@dataclass(frozen=True)
class MomentumObserver(Method):
    """First-order observer of the generalised momentum: dr/dt = K (tau_ext - r). bumpstop has it, too.

    Attributes:
        gain_1_s: K.
    """

    name: ClassVar[str] = "momentum observer"
    source: ClassVar[str] = "De Luca and Mattone, IROS 2003"
    gain_1_s: float = 50.0

    def residual(self, signals: Signals) -> FloatArray:  # noqa: D102
        from scipy.signal import lfilter

        kept = math.exp(-self.gain_1_s * signals.dt)
        return -np.asarray(lfilter([1 - kept], [1, -kept], signals.mean_external_torque, axis=1))

    @property
    def lag_s(self) -> float:  # noqa: D102
        return 1 / self.gain_1_s


@dataclass(frozen=True)
class SecondOrderObserver(Method):
    """Second-order observer of the momentum: r'' + 2 zeta omega r' + omega^2 r = omega^2 tau_ext.

    Attributes:
        omega_rad_s: natural frequency.
        damping: zeta.
    """

    name: ClassVar[str] = "second-order momentum observer"
    source: ClassVar[str] = "second-order form of De Luca and Mattone, IROS 2003"
    omega_rad_s: float = 80.0
    damping: float = 0.8

    def residual(self, signals: Signals) -> FloatArray:  # noqa: D102
        from scipy.signal import cont2discrete, lfilter

        square = self.omega_rad_s**2
        numerator, denominator, _ = cont2discrete(
            ([square], [1, 2 * self.damping * self.omega_rad_s, square]), signals.dt, "bilinear"
        )
        return -np.asarray(lfilter(numerator.ravel(), denominator, signals.mean_external_torque, axis=1))

    @property
    def lag_s(self) -> float:  # noqa: D102
        return 2 * self.damping / self.omega_rad_s


@dataclass(frozen=True)
class KalmanObserver(Method):
    """Kalman filter of momentum and external torque, the torque a random walk.

    Of spectral densities q of the walk and r of the measured momentum the steady filter of continuous time is a
    Butterworth filter of second order at omega = (q / r)^(1/4), whose lag is sqrt(2) / omega.

    Attributes:
        omega_rad_s: (q / r)^(1/4).
    """

    name: ClassVar[str] = "Kalman disturbance observer"
    source: ClassVar[str] = "Wahrburg et al., T-ASE 2018"
    omega_rad_s: float = 60.0

    def gains(self, dt: float) -> tuple[float, float]:
        """Steady gains on the momentum [1] and on the torque [1/s], from the Riccati equation of discrete time."""
        from scipy.linalg import solve_discrete_are

        walk, noise = self.omega_rad_s**4, 1 / dt  # r = 1
        step = np.array([[1, dt], [0, 1]])
        process = walk * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        seen = np.array([[1.0], [0.0]])
        covariance = solve_discrete_are(step.T, seen, process, np.array([[noise]]))
        gain = covariance[:, 0] / (covariance[0, 0] + noise)
        return float(gain[0]), float(gain[1])

    def residual(self, signals: Signals) -> FloatArray:  # noqa: D102
        (on_momentum, on_torque), dt = self.gains(signals.dt), signals.dt
        momentum, torque = signals.momentum[:, 0].copy(), np.zeros_like(signals.momentum[:, 0])
        found, force = np.zeros_like(signals.momentum), signals.mean_force
        for k in range(1, found.shape[1]):
            momentum += dt * (force[:, k] + torque)
            innovation = signals.momentum[:, k] - momentum
            momentum += on_momentum * innovation
            torque += on_torque * innovation
            found[:, k] = -torque
        return found

    @property
    def lag_s(self) -> float:  # noqa: D102
        return math.sqrt(2) / self.omega_rad_s


@dataclass(frozen=True)
class SlidingModeObserver(Method):
    """Super-twisting observer of the momentum: exact in finite time, as long as the torque changes slowly enough.

    With the error e of the momentum, dp/dt = b + k1 sqrt(|e|) sign(e) + s and ds/dt = k2 sign(e), s is the external
    torque. Where that changes by less than the bound L a second it is followed without a lag (Levant: k1 = 1.5 sqrt(L),
    k2 = 1.1 L); a step of size A takes A / k2 at least. In discrete time s chatters by k2 dt.

    Attributes:
        rate_Nm_s: L.
    """

    name: ClassVar[str] = "sliding-mode observer"
    source: ClassVar[str] = "Garofalo et al., ICRA 2019"
    rate_Nm_s: float = 200.0

    def residual(self, signals: Signals) -> FloatArray:  # noqa: D102
        first, second, dt = 1.5 * math.sqrt(self.rate_Nm_s), 1.1 * self.rate_Nm_s, signals.dt
        momentum, torque = signals.momentum[:, 0].copy(), np.zeros_like(signals.momentum[:, 0])
        found, force = np.zeros_like(signals.momentum), signals.mean_force
        for k in range(1, found.shape[1]):
            error = signals.momentum[:, k - 1] - momentum
            sign = np.sign(error)
            momentum += dt * (force[:, k] + first * np.sqrt(np.abs(error)) * sign + torque)
            torque += dt * second * sign
            found[:, k] = -torque
        return found

    @property
    def lag_s(self) -> float:  # noqa: D102
        return 0.0


@dataclass(frozen=True)
class BandPass(Method):
    """Direct residual through a band-pass: what is slow is taken for a model error, what is fast for noise.

    An even growth ends as a constant, so there is no lag; a step shows most after ln(w2 / w1) / (w2 - w1).

    Attributes:
        low_hz, high_hz: corners w1, w2 of a low-pass and of what a slower one leaves over.
    """

    name: ClassVar[str] = "band-pass of the direct residual"
    source: ClassVar[str] = "Kouris, Dimeas and Aspragathos, RA-L 2018"
    low_hz: float = 2.0
    high_hz: float = 20.0

    def residual(self, signals: Signals) -> FloatArray:  # noqa: D102
        from scipy.signal import lfilter

        slow, fast = (math.exp(-2 * math.pi * corner * signals.dt) for corner in (self.low_hz, self.high_hz))
        smooth = lfilter([1 - fast], [1, -fast], signals.direct, axis=1)
        return np.asarray(smooth - lfilter([1 - slow], [1, -slow], smooth, axis=1))

    @property
    def lag_s(self) -> float:  # noqa: D102
        return math.nan

    @property
    def peak_s(self) -> float:
        """When a step shows most [s]."""
        return math.log(self.high_hz / self.low_hz) / (2 * math.pi * (self.high_hz - self.low_hz))


@dataclass(frozen=True)
class FixedTorque(Method):
    """The torque of the motors against fixed thresholds, without a model: they lie above all that the work needs."""

    name: ClassVar[str] = "fixed torque threshold"
    source: ClassVar[str] = "current limits of industrial controllers"

    def residual(self, signals: Signals) -> FloatArray:  # noqa: D102
        return signals.torque

    @property
    def lag_s(self) -> float:  # noqa: D102
        return 0.0


METHODS: tuple[Method, ...] = (
    DirectResidual(),
    MomentumObserver(),
    SecondOrderObserver(),
    SlidingModeObserver(),
    KalmanObserver(),
    BandPass(),
    FixedTorque(),
)
"""The methods that are compared, ours first, with settings that the page on the benchmark gives reasons for."""
