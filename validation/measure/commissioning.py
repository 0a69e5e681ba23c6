"""Commissionings with planted parameters: whether intervals of the peak force hold, what the order of shots saves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

import bumpstop as bs
from bumpstop.measure.learning.calibration import Calibration, calibrate
from bumpstop.measure.learning.peak_force_ensemble import Condition, PeakForceEnsemble
from bumpstop.measure.learning.posterior import ErrorModel
from bumpstop.measure.learning.response_surface import normal_points
from bumpstop.measure.learning.shots import MeasuredShot
from bumpstop.measure.parameters import GEARS, ROTORS, SERVO, Parameters
from bumpstop.measure.peak_force_model import ShotForce, shot_force
from bumpstop.measure.planning.design import Belief, greedy_design
from bumpstop.measure.planning.measured_situation import situations_of
from bumpstop.measure.planning.plan import conditions_of, target_weights
from validation.findings import Findings
from validation.measure.other_truths import plant_shot, reference_force

TITLE = "Commissionings with planted parameters"

Array = npt.NDArray[np.float64]

_BASE: dict[str, Any] = {
    "robot": "ur10e",
    "pose_deg": [0, -75.7, 102.6, -116.9, -90, 0],
    "motion": {"velocity_mm_s": [0, 0, -200]},
    "contact": {"body": "hand_finger", "limits": "ts15066", "area_cm2": 2.0},
    "arm": {"model": "elastic"},
    "detector": {
        "thresholds_Nm": [40, 40, 30, 12, 12, 12],
        "noise_sd_Nm": [4, 4, 3, 1, 1, 1],
        "feedback_period_s": 0.002,
    },
    "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 10, "latency_s": 0.01},
}
# Pose, velocity and body region of each situation; the last four are never measured where coverage is asked for.
_FOLDED, _REACHING = [0, -75.7, 102.6, -116.9, -90, 0], [20, -50, 80, -120, -90, 0]
_SITUATIONS: dict[str, tuple[list[float], list[float], str]] = {
    "hand, down": (_FOLDED, [0, 0, -200], "hand_finger"),
    "arm, down": (_FOLDED, [0, 0, -200], "lower_arm_wrist"),
    "belly, outward": (_FOLDED, [-220, 0, 0], "abdomen"),
    "chest, sideways": (_FOLDED, [0, 250, 0], "chest"),
    "thigh, reaching": (_REACHING, [0, 0, -200], "thigh_knee"),
    "back, sideways": (_REACHING, [0, -250, 0], "back_shoulders"),
    "upper arm, down": (_REACHING, [0, 0, -180], "upper_arm_elbow"),
    "hand, outward": (_REACHING, [-180, -60, 0], "hand_finger"),
    "chest, slant": (_FOLDED, [-150, 0, -150], "chest"),
}
_UNMEASURED = 4
_SHARES = (0.5, 0.75, 1.0)
_SHOTS, _BAD = 30, 2
_COVERAGE = 0.93
# Model error told for cells in MuJoCo, shots of one, and runs that make the truth at a place.
_PLANT_ERROR, _PLANT_SHOTS, _PLANT_REPEATS = 0.1, 12, 3
# What is planted besides the parameters: of factors on damping and position gain, of residuals by friction as a share
# of the thresholds, of each shot by the gauge, and what friction in the gauge takes away at most.
_OTHER_SD, _FRICTION_SHARE, _GAUGE_SD, _GAUGE_FRICTION = 0.2, 0.05, 0.03, 0.02


def compare(findings: Findings, *, quick: bool) -> None:
    """Coverage, order of the shots."""
    cell = Cell(points=56 if quick else 768, situations=3 if quick else len(_SITUATIONS))
    findings.say(
        f"A UR10e whose gears give, {len(cell.names)} contact situations at {len(_SHARES)} speeds. Planted: latency, "
        "deceleration, thresholds, gears, servos, rotors and pads, as assumed beforehand; besides them damping and "
        f"position gains of other values (sd {100 * _OTHER_SD:g} %), friction that shifts the residuals of each motion "
        f"(sd {100 * _FRICTION_SHARE:g} % of the thresholds), gauges with friction and {100 * _GAUGE_SD:g} % of noise."
    )
    _coverage(findings, cell, runs=6 if quick else 1000, quick=quick)
    _coverage(findings, cell, runs=6 if quick else 1000, quick=quick, by_joint=True)
    _order(findings, cell, runs=1 if quick else 24, quick=quick)
    _reference(findings, cell, runs=1 if quick else 12)
    if not quick:
        _plant(findings, cell, runs=4)


@dataclass
class Cell:
    """Situations, and the ensemble that all commissionings share.

    Attributes:
        points: of the ensemble.
        situations: how many of them.
    """

    points: int
    situations: int

    @cached_property
    def names(self) -> list[str]:
        """Of the situations: measured ones first."""
        names = list(_SITUATIONS)
        return names if self.situations == len(names) else names[: self.situations - 2] + names[-2:]

    @property
    def unmeasured(self) -> list[str]:
        """Situations without a shot where coverage is asked for."""
        return self.names[-(_UNMEASURED if self.situations == len(_SITUATIONS) else 2) :]

    @cached_property
    def ensemble(self) -> PeakForceEnsemble:
        """Peak forces of all conditions at points of the parameters."""
        base = bs.Scenario.from_dict(_BASE)
        named = [
            (name, base.with_values({"pose_deg": pose, "motion.velocity_mm_s": velocity, "contact.body": body}))
            for name, (pose, velocity, body) in _SITUATIONS.items()
            if name in self.names
        ]
        situations = situations_of(named)
        parameters = Parameters.of([each.measured for each in situations])
        conditions = conditions_of(situations, parameters, _SHARES)
        ensemble = PeakForceEnsemble.of(parameters, conditions, points=self.points, seed=1)
        return ensemble.where_detected()[0]

    def columns(self, *, measured: bool) -> list[int]:
        """Conditions of the situations that are measured, or of the others at their own speed."""
        found = []
        for c, each in enumerate(self.ensemble.conditions):
            unmeasured = each.situation.name in self.unmeasured
            if unmeasured != measured and (measured or each.own_speed):
                found.append(c)
        return found


class Truth:
    """One cell as it is: planted parameters, and what the model does not know of.

    Args:
        cell: what is assumed.
        seed: of all that is planted.
        by_joint: gears, servos and rotors are off in each joint by itself, by as much as is assumed of all alike.
    """

    def __init__(self, cell: Cell, seed: int, *, by_joint: bool = False) -> None:
        self._cell = cell
        self.random = np.random.default_rng(seed)
        self.z = self.random.standard_normal(len(cell.ensemble.parameters))
        self._damping, self._gain = np.exp(_OTHER_SD * self.random.standard_normal(2))
        self._friction = _FRICTION_SHARE * self.random.standard_normal((len(cell.ensemble.conditions), 6))
        self._gauge_friction = _GAUGE_FRICTION * self.random.random()
        self._known: dict[int, ShotForce] = {}
        self._of_joints: dict[str, Array] = {}
        for parameter in cell.ensemble.parameters.each if by_joint else ():
            if parameter.key in (GEARS, SERVO, ROTORS):
                self.z[cell.ensemble.parameters.index(parameter.key)] = 0.0
                name = parameter.key.partition(".")[2]
                self._of_joints[name] = np.exp(parameter.sd * self.random.standard_normal(6))

    def scenario(self, column: int) -> bs.Scenario:
        """A condition as it is."""
        found = self._cell.ensemble.parameters.at(self._cell.ensemble.conditions[column].scenario, self.z)
        train = bs.collision.CollisionProblem.from_scenario(found).drive_train
        thresholds = np.array(found.detector.thresholds_Nm)
        arm = found.arm.model_copy(
            update={
                "gear_damping": (self._damping * train.gear_damping).tolist(),
                "servo_position_gain_1_s": (self._gain * train.servo_position_gain).tolist(),
            }
            | {key: (np.array(getattr(found.arm, key)) * factor).tolist() for key, factor in self._of_joints.items()}
        )
        detector = found.detector.model_copy(update={"noise_mean_Nm": (self._friction[column] * thresholds).tolist()})
        return found.model_copy(update={"arm": arm, "detector": detector})

    def force(self, column: int) -> ShotForce:
        """Peak forces of shots of a condition."""
        if column not in self._known:
            self._known[column] = shot_force(self.scenario(column))
        return self._known[column]

    def shot(self, column: int, number: int, *, bad: bool = False) -> MeasuredShot:
        """What the gauge shows of one shot; a bad one is far off."""
        found = self.force(column)
        drawn = self.random.choice(found.force, p=found.probability / found.probability.sum())
        shown = drawn * (1 - self._gauge_friction) * np.exp(_GAUGE_SD * self.random.standard_normal())
        if bad:
            shown *= self.random.choice([0.4, 0.6, 1.6, 2.2])
        condition: Condition = self._cell.ensemble.conditions[column]
        return MeasuredShot(condition.situation.name, condition.speed_mm_s, float(shown), number)


def commission(
    cell: Cell, seed: int, columns: list[int], *, bad: int = _BAD, by_joint: bool = False
) -> tuple[Truth, Calibration] | None:
    """Shots of these conditions, some of them bad, and what is learned; None: the planted arm never detects a gauge."""
    truth = Truth(cell, seed, by_joint=by_joint)
    try:
        spoilt = set(truth.random.choice(len(columns), bad, replace=False).tolist())
        shots = [truth.shot(c, n + 1, bad=n in spoilt) for n, c in enumerate(columns)]
    except bs.InputError:
        return None
    return truth, calibrate(cell.ensemble, shots, refine=0, seed=seed)


def _coverage(findings: Findings, cell: Cell, *, runs: int, quick: bool, by_joint: bool = False) -> None:
    measured, asked = cell.columns(measured=True), cell.columns(measured=False)
    columns = (measured * _SHOTS)[:_SHOTS]
    inside, single, widths, before, named, undetected = [], [], [], [], [], 0
    for seed in range(runs):
        done = commission(cell, seed, columns, by_joint=by_joint)
        if done is None:
            undetected += 1
            continue
        truth, made = done
        for c in asked:
            try:
                found = truth.force(c)
            except bs.InputError:
                undetected += 1
                continue
            force, low, high = np.exp(found.log_mean), *made.forces[c].expected_N[1:]
            inside.append(low <= force <= high)
            one = truth.shot(c, 0).force_N
            single.append(made.forces[c].single_N[0] <= one <= made.forces[c].single_N[1])
            widths.append((high - low) / force)
            before.append((made.forces[c].before_N[2] - made.forces[c].before_N[1]) / force)
        named.append(len(made.bad_shots))
        if (seed + 1) % 50 == 0:
            findings.progress(f"{seed + 1} commissionings: {100 * np.mean(inside):.1f} % inside")
    share, one_share = float(np.mean(inside)), float(np.mean(single))
    of_joints = ", gears, servos and rotors off in each joint by itself" if by_joint else ""
    findings.table(
        f"{runs} commissionings with {_SHOTS} shots, {_BAD} of them bad, at places that were not measured{of_joints}",
        ["", "Value"],
        ["", ".3g"],
        [
            ["expected peak force inside its 95 % interval [%]", 100 * share],
            ["single shot inside its 95 % interval [%]", 100 * one_share],
            ["median width of the interval, as a share of the force [%]", 100 * float(np.median(widths))],
            ["the same before the shots [%]", 100 * float(np.median(before))],
            ["shots named as bad, mean", float(np.mean(named))],
            ["places or cells left out, as the planted arm never detects the gauge there", undetected],
        ],
    )
    wanted = 0.8 if quick else _COVERAGE
    findings.check(
        "The 95 % interval of the peak force at unmeasured places holds the truth in "
        f"{100 * wanted:.0f} % or more{of_joints}",
        share >= wanted,
        f"{100 * share:.1f} % of {len(inside)}",
    )
    findings.check(f"The shots narrow the interval{of_joints}", np.median(widths) < np.median(before))
    findings.figures["coverage by joint" if by_joint else "coverage"] = {
        "expected": share,
        "single": one_share,
        "cases": len(inside),
    }


def orders(cell: Cell, shots: int) -> tuple[list[int], list[int]]:
    """Conditions of the shots of an ordered plan, and of a grid that takes every situation at every speed in turn."""
    ensemble, errors = cell.ensemble, ErrorModel()
    surfaces = ensemble.surfaces()
    z = normal_points(2048, len(ensemble.parameters), 2)
    belief = Belief(surfaces(z), surfaces, errors, target_weights(ensemble))
    own = np.array([each.own_speed for each in ensemble.conditions])
    ordered = greedy_design(belief, shots, repeats=3, own_speed=own).condition.tolist()
    return ordered, (list(range(len(ensemble.conditions))) * 3)[:shots]


def _order(findings: Findings, cell: Cell, *, runs: int, quick: bool) -> None:
    count = _SHOTS
    ordered, grid = orders(cell, count)
    half = count // 2
    targets = [c for c, each in enumerate(cell.ensemble.conditions) if each.own_speed]
    sizes = sorted({max(2, half // 2), half, count})
    widths: dict[tuple[str, int], list[float]] = {}
    for seed in range(5000, 5000 + runs):
        for name, order in (("ordered", ordered), ("grid", grid)):
            for size in sizes:
                done = commission(cell, seed, order[:size], bad=0)
                if done is None:
                    continue
                forces = [done[1].forces[c] for c in targets]
                # As the plan weighs them: by the share of the limit.
                spread = [(each.expected_N[2] - each.expected_N[1]) / each.limit_N for each in forces]
                widths.setdefault((name, size), []).append(float(np.mean(spread)))
    mean = {key: float(np.mean(values)) for key, values in widths.items()}
    findings.table(
        "Mean width of the 95 % interval of the peak force over all situations, as a share of the limit",
        ["Shots", "Ordered plan [%]", "Fixed grid [%]"],
        ["", ".3g", ".3g"],
        [[f"{size}", 100 * mean["ordered", size], 100 * mean["grid", size]] for size in sizes],
    )
    findings.check(
        "After as many shots the plan's order leaves narrower intervals than the fixed grid",
        mean["ordered", half] < mean["grid", half],
        f"{100 * mean['ordered', half]:.1f} % and {100 * mean['grid', half]:.1f} % after {half} shots",
    )
    if not quick:
        findings.check(
            f"Half the shots in the plan's order are as good as all of a fixed grid of {count}",
            mean["ordered", half] <= mean["grid", count],
            f"{100 * mean['ordered', half]:.1f} % after {half} shots, {100 * mean['grid', count]:.1f} % after {count}",
        )
    findings.figures["order"] = {f"{name} {size}": value for (name, size), value in mean.items()}


def _reference(findings: Findings, cell: Cell, *, runs: int) -> None:
    differences = []
    for seed in range(9000, 9000 + runs):
        truth = Truth(cell, seed)
        for c in cell.columns(measured=False):
            try:
                found = truth.force(c)
            except bs.InputError:
                continue
            other = reference_force(truth.scenario(c))
            differences += [other.quantile(p) / found.quantile(p) - 1 for p in (0.05, 0.5, 0.95)]
    worst = float(np.abs(differences).max())
    findings.check(
        "Quantiles of shots of planted cells are those of the reference simulator's arm within 0.5 %",
        worst < 5e-3,
        f"worst {100 * worst:.2g} % of {len(differences)}",
    )


def _plant(findings: Findings, cell: Cell, *, runs: int) -> None:
    errors = ErrorModel(model=_PLANT_ERROR)
    measured, asked = cell.columns(measured=True), cell.columns(measured=False)
    own = [c for c in measured if cell.ensemble.conditions[c].own_speed]
    inside, misses = [], []
    for seed in range(7000, 7000 + runs):
        truth = Truth(cell, seed)

        def shot(c: int, truth: Truth = truth) -> float:
            return plant_shot(truth.scenario(c), cell.ensemble.conditions[c], truth.random)

        try:
            shots = []
            for number, c in enumerate((own * 3)[:_PLANT_SHOTS], start=1):
                condition = cell.ensemble.conditions[c]
                shots.append(MeasuredShot(condition.situation.name, condition.speed_mm_s, shot(c), number))
            truths = {c: float(np.mean(np.log([shot(c) for _ in range(_PLANT_REPEATS)]))) for c in asked}
        except bs.InputError:
            continue
        made = calibrate(cell.ensemble, shots, errors=errors, refine=0, seed=seed)
        for c, found in truths.items():
            middle, low, high = made.forces[c].expected_N
            inside.append(low <= np.exp(found) <= high)
            misses.append(float(np.exp(found) / middle - 1))
        findings.progress(f"{len(inside)} places in MuJoCo: {100 * np.mean(inside):.0f} % inside")
    share = float(np.mean(inside))
    findings.say(
        f"Cells in MuJoCo, whose controller feeds its acceleration through the motors and whose gauges have a mass of "
        f"their own: with a model error of {100 * _PLANT_ERROR:g} % told and {_PLANT_SHOTS} shots, peak forces at "
        f"places that were not measured are off by {100 * float(np.median(np.abs(misses))):.1f} % in the median."
    )
    findings.check(
        f"In MuJoCo the 95 % interval at unmeasured places holds the truth in {100 * _COVERAGE:.0f} % or more",
        share >= _COVERAGE,
        f"{100 * share:.0f} % of {len(inside)}",
    )
