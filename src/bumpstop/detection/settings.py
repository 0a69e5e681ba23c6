"""What the detector is told beside robot, joint model and thresholds."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, get_args

from bumpstop import _native
from bumpstop.arrays import as_float_array, as_number
from bumpstop.errors import InputError, near_matches
from bumpstop.model.inertia import vector3
from bumpstop.model.serial_chain import checked_point

ResidualKind = Literal["direct", "observer"]
Vector = tuple[float, float, float]
_PERIODS = (1e-5, 1.0)  # of loops, as a scenario's feedback_period_s


@dataclass(frozen=True, kw_only=True)
class DetectorSettings:
    """Settings, checked when they are made.

    Attributes:
        residual: ``"direct"`` or ``"observer"``.
        observer_gain_1_s: K of the momentum observer: it shows 1 - exp(-K t) of a torque.
        window_s: of the fit behind rates and accelerations, from its oldest to its newest sample [s]. At a given rate
            it is a number of samples: at least ``degree`` + 1, and at most 512.
        degree: of that fit, 2 to 5.
        measured_rates: take rates from the recording, and accelerations from them, instead of both from positions.
        period_s: between samples, 1e-5 to 1 [s]; None: that of the recording.
        late_periods: an interval longer than this many periods means lost samples: counted and said.
        longest_periods: beyond it the past is forgotten, and the detector without data until the window is full again.
        frozen_s: positions and signals of all joints may repeat for so long while the arm rests [s], and for five rows
            at least; while it moves, a repeat that its speed does not allow is frozen at once. Infinite: never frozen.
        limit_margin: positions this far outside their limits are impossible [rad or m].
        largest_signal: (n,) currents or torques beyond are impossible; None: any finite one will do.
        max_no_data_s: how long the detector may have no data before it asks for a stop [s].
        arming_delay_s: after a motion begins nothing is judged for so long [s]; Schroeder (2013) has 0.5.
        event_pause_s: while an alarm stands, a residual that passes its threshold after so long below is another event
            [s]; infinite: it never is.
        rest_time_s: all joints slower than their rest_speed for so long: the arm rests, and is judged [s].
        rest_speed: below it a joint rests where no joint model says so [rad/s or m/s].
        low_hz, high_hz: band of the band-pass channel.
        noise_sd: (n,) of the residual, for forces and links [Nm]; None: a third of the threshold.
        stiction: (n,) torque that friction can hide of a standing joint [Nm or N], NaN: not known; None: what the
            model says.
        link, point: where the force of an event is given; a link's name (None: the tip), and in its frame [m].
        direction: unit vector of the arm's force on the body, base frame.
        gravity: acceleration of free fall, base frame [m/s2]; None: that of the joint model, without one along -z. That
            of fitted dynamics is their own.
        causal: with fitted dynamics the motion is that of the window, as a loop has it; else zero-phase filters make
            it, which look ahead. Whatever else makes the torque is causal anyway.
        payload_kg: declared, a point mass.
        payload_center: of it, in the frame of the last link [m]; None: the tip.
        payload_change_kg: an undeclared change of at least this is looked for; 0: none is.
        payload_window_s: time over which what is known of it fades [s].
    """

    residual: ResidualKind = "direct"
    observer_gain_1_s: float = 50.0
    window_s: float = 0.07
    degree: int = 2
    measured_rates: bool = False
    period_s: float | None = None
    late_periods: float = 1.5
    longest_periods: float = 5.0
    frozen_s: float = 0.1
    limit_margin: float = 0.1
    largest_signal: tuple[float, ...] | None = None
    max_no_data_s: float = 0.0
    arming_delay_s: float = 0.0
    event_pause_s: float = 0.1
    rest_time_s: float = 0.1
    rest_speed: float = 0.01
    low_hz: float = 0.5
    high_hz: float = 30.0
    noise_sd: tuple[float, ...] | None = None
    stiction: tuple[float, ...] | None = None
    link: str | None = None
    point: Vector = (0.0, 0.0, 0.0)
    direction: Vector = (0.0, 0.0, -1.0)
    gravity: Vector | None = None
    causal: bool = False
    payload_kg: float = 0.0
    payload_center: Vector | None = None
    payload_change_kg: float = 0.0
    payload_window_s: float = 5.0

    def __post_init__(self) -> None:
        if self.residual not in get_args(ResidualKind):
            near = near_matches(str(self.residual), get_args(ResidualKind))
            raise InputError("residual", f"{self.residual!r} is no kind of residual", near)
        for name in ("measured_rates", "causal"):
            if not isinstance(getattr(self, name), bool):
                raise InputError(name, f"is {getattr(self, name)!r}", "wanted true or false")
        self._check_whole("degree", 2, _native.max_fit_degree)
        for name, low, high in (
            ("observer_gain_1_s", 1e-3, 1e5),
            ("window_s", 1e-5, 10.0),
            ("late_periods", 1.0, math.inf),
            ("longest_periods", 1.0, math.inf),
            ("limit_margin", 0.0, math.inf),
            ("max_no_data_s", 0.0, math.inf),
            ("arming_delay_s", 0.0, math.inf),
            ("rest_time_s", 0.0, math.inf),
            ("rest_speed", 1e-6, math.inf),
            ("low_hz", 1e-6, math.inf),
            ("high_hz", 1e-6, math.inf),
            ("payload_kg", 0.0, math.inf),
            ("payload_change_kg", 0.0, math.inf),
            ("payload_window_s", 1e-3, math.inf),
        ):
            if not low <= as_number(getattr(self, name), name) <= high:
                limits = f"at least {low:g}" if high == math.inf else f"from {low:g} to {high:g}"
                raise InputError(name, f"is {getattr(self, name)}", f"wanted {limits}")
        for name in ("frozen_s", "event_pause_s"):
            if not as_number(getattr(self, name), name, finite=False) > 0:
                raise InputError(name, f"is {getattr(self, name)}", "wanted more than zero; inf: never")
        if not self.low_hz < self.high_hz:
            raise InputError("low_hz", f"{self.low_hz:g} is not below high_hz = {self.high_hz:g}")
        if not self.late_periods <= self.longest_periods:
            raise InputError("late_periods", f"{self.late_periods:g} is above longest_periods")
        low, high = _PERIODS
        if self.period_s is not None and not low <= as_number(self.period_s, "period_s") <= high:
            raise InputError("period_s", f"is {self.period_s}", f"wanted from {low:g} to {high:g}")
        for name in ("point", "direction", "gravity", "payload_center"):
            if getattr(self, name) is not None:
                given = as_float_array(getattr(self, name), name, (3,))
                object.__setattr__(self, name, vector3(given))
        checked_point(self.point)
        if abs(math.hypot(*self.direction) - 1) > 1e-9:
            raise InputError("direction", f"has length {math.hypot(*self.direction):.6g}", "wanted a unit vector")

    def window_samples(self, period_s: float) -> int:
        """Samples in the window where there is one every ``period_s`` seconds."""
        return int(_native.window_samples(self.window_s, period_s, int(self.degree)))

    def _check_whole(self, name: str, low: int, high: int) -> None:
        value = getattr(self, name)
        if not (as_number(value, name).is_integer() and low <= value <= high):
            raise InputError(name, f"is {value!r}", f"wanted a whole number from {low} to {high}")


def settings_text(settings: Mapping[str, Any]) -> str:
    """Settings of a detector, by name."""

    def said(value: object) -> str:
        if value is None:
            return "never"
        return f"{value:g}" if isinstance(value, float) else str(value).lower()

    return ", ".join(f"{name} {said(value)}" for name, value in settings.items())


def check_rearm(rearm_s: float) -> None:
    """Refuse a time without alarms that is none; an infinite one never ends an alarm."""
    if not as_number(rearm_s, "rearm_s", finite=False) >= 0:
        raise InputError("rearm_s", f"is {rearm_s}", "wanted zero or more")
