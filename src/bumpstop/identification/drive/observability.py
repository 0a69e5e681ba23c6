"""What the motion of a joint can show of its model, where a fit begins, and within what bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.identification.drive.drive_model import DriveModel
from bumpstop.identification.drive.drive_model_selection import linear_columns
from bumpstop.identification.segments.drive_samples import DriveSamples
from bumpstop.identification.statistics.robust_fit import RobustFit, long_run_errors

if TYPE_CHECKING:
    from bumpstop.model import Robot

# A gain whose standard error is above this share of it is not seen.
SURE_GAIN = 0.25
# Moving rows whose speeds, between the 10 % and the 90 % quantile, differ by less than this factor are of one speed.
_ONE_SPEED = 1.3
# An exponent is seen when its standard error is below this.
_SURE_EXPONENT = 0.5
# An inertia is seen when its standard error is below this share of itself or of the link's inertia about the joint.
_SURE_INERTIA = 0.5
# Hysteresis is seen when a joint rests this often, at least so long [s], and rests after motion both ways.
_RESTS, _REST_S = 4, 0.25
# Mean speed of such a rest, in speeds of rest, at most: a joint that turns round passes through it at one half.
_RESTING = 0.35
# A map's bend is seen when its effect at the largest torque is known to this share of that torque.
_SURE_BEND = 0.1
# Rows near reversals are left out of the fit where at least this share of all rows remains.
_ENOUGH_AWAY = 0.4
# Columns that the others make up to this share of their length say nothing.
_DEPENDENT = 1e-3
_TOO_LITTLE = "the torque varies too little against the noise of the current, its gain stays unknown"
OPPOSITE_SIGN = "current falls as torque rises: is its sign right? The gain stays unknown"
_NOT_FROM_GAIN = "it cannot be told from the gain"


@dataclass(frozen=True, eq=False)
class DriveObservability:
    """What a joint's motion can show, by a linear map with Coulomb and viscous friction.

    Attributes:
        name: of the joint.
        gain, acceleration, coulomb, viscous: of the linear fit: current per torque, per acceleration, constant and per
            rate.
        braking: standard errors by which friction at a usual speed is above zero; negative: it drives the joint.
        gain_unobservable: the gain is not identifiable.
        single_speed, static: what it says.
        hysteresis: whether it can be seen.
        leaves_reversals: whether rows near reversals are left out of the fit; where the joint rests often enough to
            show hysteresis they say most, and where it hardly moves nearly all of them would go.
        unobservable: parameters that is not identifiable, with reasons.
        fixed: what is put in their place.
        speeds: (2,) quartiles of the speeds of moving rows.
        speed_range: slowest and fastest of them; or None.
        link_inertia: mean inertia of the arm about the joint [kg m2 or kg].
        torque: largest absolute torque [Nm or N].
    """

    name: str
    gain: float
    acceleration: float
    coulomb: float
    viscous: float
    braking: float
    gain_unobservable: bool
    single_speed: bool
    static: bool
    hysteresis: bool
    leaves_reversals: bool
    unobservable: Mapping[str, str]
    fixed: Mapping[str, float]
    speeds: tuple[float, float]
    speed_range: tuple[float, float] | None
    link_inertia: float
    torque: float
    rest_speed: float

    def fitted_rows(self, rows: DriveSamples, j: int) -> npt.NDArray[np.bool_]:
        """Rows (N,) that joint ``j`` is fitted to."""
        if self.leaves_reversals:
            return rows.away_from_reversals(j, self.rest_speed)
        return np.ones(rows.t.size, dtype=bool)

    def refused(self, law: DriveModel, fit: RobustFit) -> str:
        """Why the parameters of a law cannot be told apart in this motion; or empty."""
        values = {**law.fixed, **dict(zip(law.names, fit.values.tolist(), strict=True))}
        errors = dict(zip(law.names, fit.standard_errors.tolist(), strict=True))
        for name, share in zip(law.names, fit.visible.tolist(), strict=True):
            if share < _DEPENDENT and name not in ("inertia", "F"):
                return f"{name} cannot be told from the others in this motion"
        if "A" in errors and errors["A"] * (self.torque / values["B"]) > _SURE_BEND * values["B"]:
            return "A cannot be told from B: the torques are too small or too much alike"
        if "stribeck_speed" in errors and not errors["stribeck_speed"] < values["stribeck_speed"]:
            return "the speed of the Stribeck effect is not identifiable"
        return ""

    def ambiguous(self, law: DriveModel, fit: RobustFit) -> dict[str, tuple[float, str]]:
        """Parameters of a fit that it leaves open: what to put in their place, and why."""
        values = {**law.fixed, **dict(zip(law.names, fit.values.tolist(), strict=True))}
        errors = dict(zip(law.names, fit.standard_errors.tolist(), strict=True))
        found: dict[str, tuple[float, str]] = {}
        if "F" in errors and not errors["F"] < _SURE_EXPONENT:
            found["F"] = (0.0, "friction hardly changes with speed in this motion, F is fixed at 0 (friction D)")
        if "inertia" in errors:
            sure = _SURE_INERTIA * max(values["inertia"], self.link_inertia)
            if not errors["inertia"] < sure:
                found["inertia"] = (0.0, "the joint hardly accelerates, its inertia stays unknown and counts as 0")
        share = dict(zip(law.names, fit.visible.tolist(), strict=True)).get("A", 1.0)
        if "A" in errors and not (share >= _DEPENDENT and errors["A"] * self.torque < _SURE_BEND * values["B"] ** 2):
            found["A"] = (
                0.0,
                "the torques are too small or too much alike to show that the gain bends, A is fixed at 0",
            )
        return found

    def without_gain(self, law: DriveModel, fit: RobustFit) -> DriveObservability | None:
        """What is seen where the whole fit leaves the gain open, as a linear one did not; None: it does not either."""
        errors = dict(zip(law.names, fit.standard_errors.tolist(), strict=True))
        gain = dict(zip(law.names, fit.values.tolist(), strict=True)).get("B")
        if self.gain_unobservable or gain is None or errors["B"] < SURE_GAIN * gain:
            return None
        reasons = {"B": _TOO_LITTLE, "inertia": _NOT_FROM_GAIN}
        return replace(self, gain_unobservable=True, unobservable={**self.unobservable, **reasons})


# A torque that varies by less than this share of its size, while the joint rests, says nothing of the gain.
_SAME = 0.02
_AT_REST = "the joint rests and its torque stays the same, friction may carry any part of it: its gain stays unknown"


def assess(rows: DriveSamples, j: int, arm: Robot, rest_speed: float, known: Mapping[str, float]) -> DriveObservability:
    """Find out what the motion of joint ``j`` can show."""
    from bumpstop.model import mass_matrix

    name = arm.joints[j].name
    raw = linear_columns(rows, j, rest_speed)
    speed = np.abs(raw[:, 3])
    moving = np.sort(speed[speed > 2 * rest_speed])
    never = moving.size < 0.01 * speed.size
    quantile = np.quantile(moving, [0.1, 0.25, 0.75, 0.9]) if moving.size else np.full(4, rest_speed)
    single_speed = bool(quantile[3] < _ONE_SPEED * quantile[0])
    unobservable: dict[str, str] = {}
    fixed: dict[str, float] = {}
    if never:
        unobservable["D"] = "the joint does not move, D and F are fixed at 0"
        unobservable["F"] = unobservable["D"]
        fixed |= {"D": 0.0, "F": 0.0}
    elif single_speed:
        unobservable["F"] = (
            f"all speeds lie about {np.median(moving):.3g} rad/s, F is fixed at 0: D is the friction at that speed"
        )
        fixed["F"] = 0.0
    # A joint that rests shows hysteresis, and little else shows it. One that creeps through its reversals shows none.
    away = rows.away_from_reversals(j, rest_speed)
    stays = _rests(rows, raw[:, 4], speed, _RESTING * rest_speed)
    leaves_reversals = not stays and not never and bool(away.mean() >= _ENOUGH_AWAY)
    fitted = away if leaves_reversals else np.ones(away.size, dtype=bool)
    hysteresis = not leaves_reversals and _rests(rows, raw[:, 4], speed, rest_speed)
    if not hysteresis and "hysteresis" not in known:
        unobservable["hysteresis"] = f"the joint does not rest {_RESTS} times after motion both ways"
    values, errors = _linear_fit(rows, j, raw, hysteresis, known, fitted)
    gain = float(values[0])
    # Friction at rest may carry any part of a torque that never changes, or changes by the noise of the encoders alone.
    held = never and "B" not in known
    if held and float(raw[:, 0].std()) >= _SAME * float(np.abs(raw[:, 0]).max()):
        beside, unsure = _linear_fit(rows, j, raw, hysteresis, known, fitted, constant=True)
        held = not unsure[0] < SURE_GAIN * abs(float(beside[0]))
    gain_unobservable = "B" not in known and (held or not (gain > 0 and errors[0] < SURE_GAIN * gain))
    if gain_unobservable:
        unobservable["B"] = _AT_REST if held else _why_unobservable(gain, float(errors[0]), raw)
        unobservable["inertia"] = _NOT_FROM_GAIN
    near = rows.q[:: max(1, rows.t.size // 50)]
    return DriveObservability(
        name=name,
        gain=gain if gain > 0 else 1 / known.get("B", 1.0),
        acceleration=float(values[1]),
        coulomb=max(float(values[2]), 0.0),
        viscous=max(float(values[3]), 0.0),
        braking=0.0 if never else _braking(rows, j, raw, hysteresis, known, fitted, float(np.median(moving))),
        gain_unobservable=gain_unobservable,
        single_speed=single_speed,
        static=never,
        hysteresis=hysteresis,
        leaves_reversals=leaves_reversals,
        unobservable={key: reason for key, reason in unobservable.items() if key not in known},
        fixed=fixed,
        speeds=(float(quantile[1]), float(quantile[2])),
        speed_range=(float(moving[0]), float(moving[-1])) if moving.size > 1 and moving[0] < moving[-1] else None,
        link_inertia=float(mass_matrix(arm, near)[:, j, j].mean()),
        torque=float(np.abs(raw[:, 0]).max()),
        rest_speed=rest_speed,
    )


def _braking(
    rows: DriveSamples,
    j: int,
    raw: FloatArray,
    hysteresis: bool,
    known: Mapping[str, float],
    fitted: npt.NDArray[np.bool_],
    usual: float,
) -> float:
    """Friction of a linear map at a usual speed, in its standard errors; 0: it is not seen.

    There its Coulomb and viscous parts are known together, and a law that falls or rises with speed does not matter.
    """
    there = raw.copy()
    there[:, 3] -= usual * there[:, 2]
    values, errors = _linear_fit(rows, j, there, hysteresis, known, fitted)
    return float(values[2] / errors[2]) if np.isfinite(errors[2]) and errors[2] > 0 else 0.0


def starting_values(observability: DriveObservability, fixed: Mapping[str, float]) -> dict[str, float]:
    """Where fits begin, by name."""
    slow, fast = observability.speeds
    fast = max(fast, 1.05 * slow)
    lower, upper = (max(observability.coulomb + observability.viscous * speed, 1e-6) for speed in (slow, fast))
    exponent = float(np.clip(np.log(upper / lower) / np.log(fast / slow), 0.02, 2.0))
    exponent = fixed.get("F", exponent)
    B = fixed.get("B", 1 / observability.gain)
    return {
        "torque": observability.gain,
        "acceleration": observability.acceleration,
        "A": 0.0,
        "B": B,
        "inertia": max(observability.acceleration * B, 0.0),
        "D": float(0.5 * (lower / slow**exponent + upper / fast**exponent)),
        "F": exponent,
        "coulomb": observability.coulomb,
        "viscous": observability.viscous,
        "stribeck": 0.2 * observability.coulomb,
        "stribeck_speed": max(0.5 * slow, 2 * observability.rest_speed),
        "load": 0.02,
        "hysteresis": 0.0,
    }


def bounds(names: Sequence[str], observability: DriveObservability) -> tuple[FloatArray, FloatArray]:
    """Least and largest values of parameters."""
    B = 1 / observability.gain
    own = {
        "B": (1e-2 * B, 1e2 * B),
        "D": (0.0, np.inf),
        "F": (0.0, 3.0),
        "coulomb": (0.0, np.inf),
        "viscous": (0.0, np.inf),
        "stribeck": (0.0, np.inf),
        "stribeck_speed": (0.5 * observability.rest_speed, 10 * max(observability.speeds[1], observability.rest_speed)),
        "load": (0.0, 0.9),
        "inertia": (0.0, np.inf),
    }
    pairs = [own.get(name, (-np.inf, np.inf)) for name in names]
    return np.array([low for low, _ in pairs]), np.array([high for _, high in pairs])


def _rests(rows: DriveSamples, held: FloatArray, speed: FloatArray, mean: float) -> bool:
    """Whether the joint rests often enough, after motion both ways, at a mean speed of at most ``mean``."""
    after = {1.0: 0, -1.0: 0}
    for segment, rate in zip(rows.segments, rows.rate_hz, strict=True):
        own = held[segment]
        edges = np.flatnonzero(np.diff(own)) + 1
        for run, fast in zip(np.split(own, edges), np.split(speed[segment], edges), strict=True):
            if abs(run[0]) == 1 and run.size >= max(2.0, _REST_S * rate) and fast.mean() <= mean:
                after[float(run[0])] += 1
    return min(after.values()) > 0 and sum(after.values()) >= _RESTS


def _linear_fit(
    rows: DriveSamples,
    j: int,
    raw: FloatArray,
    hysteresis: bool,
    known: Mapping[str, float],
    fitted: npt.NDArray[np.bool_],
    *,
    constant: bool = False,
) -> tuple[FloatArray, FloatArray]:
    """Values and standard errors of a linear map's columns at ``fitted`` rows; a known inertia goes with the torque.

    With ``constant`` a current that never changes has a column of its own.
    """
    both = rows.filtered(np.column_stack([raw, np.ones(raw.shape[0]), rows.current[:, j]]))[fitted]
    columns, current = both[:, :6], both[:, 6]
    free = [0, 1, 2, 3, *([4] if hysteresis else []), *([5] if constant else [])]
    if "inertia" in known:
        columns = columns.copy()
        columns[:, 0] += known["inertia"] * columns[:, 1]
        free.remove(1)
    length = np.linalg.norm(columns, axis=0)
    free = [c for c in free if length[c] > 1e-9 * np.sqrt(current.size) and length[c] > 0]
    values, errors = np.zeros(6), np.full(6, np.inf)
    if free:
        scaled = columns[:, free] / length[free]
        found, *_ = np.linalg.lstsq(scaled, current, rcond=1e-8)
        residual = current - scaled @ found
        spread = float(np.median(np.abs(residual))) * 1.4826
        values[free] = found / length[free]
        errors[free] = long_run_errors(scaled, residual, max(2.5 * spread, 1e-12))[0] / length[free]
        for place, c in enumerate(free):
            others = np.delete(scaled, place, axis=1)
            if others.shape[1]:
                rest = scaled[:, place] - others @ np.linalg.lstsq(others, scaled[:, place], rcond=1e-8)[0]
                if np.linalg.norm(rest) < _DEPENDENT:
                    errors[c] = np.inf
    return values, errors


def _why_unobservable(gain: float, error: float, raw: FloatArray) -> str:
    torque, acceleration = raw[:, 0], raw[:, 1]
    if np.abs(torque).max() < 1e-6:
        return "nothing that the arm does takes torque of this joint, its gain stays unknown"
    if gain < -2 * error:
        return OPPOSITE_SIGN
    own = np.std(torque) * np.std(acceleration)
    if own > 0 and abs(float(np.mean((torque - torque.mean()) * (acceleration - acceleration.mean())))) > 0.9 * own:
        return "its torque is little but its own acceleration, as that of reflected inertia is: the gain stays unknown"
    return _TOO_LITTLE
