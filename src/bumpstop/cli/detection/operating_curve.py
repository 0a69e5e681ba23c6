"""Alarms an hour against newtons: what tuned thresholds mean for the collisions of a cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError
from bumpstop.text_files import other_robot

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.cli.detection.scenario_noise import ScenarioNoise
    from bumpstop.collision import Scenario
    from bumpstop.detection import Tuning
    from bumpstop.identification import DynamicsModel
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot

# Of the wanted rate.
_TIMES = (0.01, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)
_SAMPLES = 20_000  # runs of a distribution with measured noise


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """One rate of false alarms, and the forces its thresholds let through.

    Attributes:
        per_hour: false alarms an hour.
        thresholds: (dof,) that give it [Nm or N].
        extrapolated: it lies more than 100 times beyond the recording.
        forces: by scenario: ``p50 p95 p999`` of the peak force, ``anywhere`` the largest that stays undetected
            in any direction [N, None: unbounded], ``limit`` [N or None], ``acceptable``, and what is not: ``fails_by``,
            of ``"force"``, ``"pressure"`` and ``"false_alarm"``.
    """

    per_hour: float
    thresholds: FloatArray
    extrapolated: bool
    forces: dict[str, dict[str, Any]]

    def to_json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "per_hour": self.per_hour,
            "thresholds_Nm": [float(x) if x < float("inf") else None for x in self.thresholds],
            "extrapolated_too_far": self.extrapolated,
            "scenarios": self.forces,
        }


def load_scenarios(paths: Sequence[Path]) -> dict[str, Scenario]:
    """Scenarios by their files, checked against their robots.

    Raises:
        InputError: one cannot be used.
    """
    from bumpstop.collision import CollisionProblem, load_scenario

    loaded = {str(path): load_scenario(path) for path in paths}
    for scenario in loaded.values():
        CollisionProblem.from_scenario(scenario)
    return loaded


def check_joints(scenarios: Mapping[str, Scenario], dof: int) -> None:
    """Refuse scenarios for a robot with another number of joints than the residuals are of.

    Raises:
        InputError: one has.
    """
    for name, scenario in scenarios.items():
        count = len(scenario.detector.thresholds_Nm)
        if count != dof:
            raise InputError(name, f"has thresholds for {count} joints", f"the residuals have {dof}")


def operating_curve(
    tuning: Tuning,
    scenarios: Mapping[str, Scenario],
    noise: ScenarioNoise,
    robot: Robot | None = None,
    model: JointTorqueModel | DynamicsModel | None = None,
) -> list[OperatingPoint]:
    """Force laws of scenarios at the thresholds of several rates around the wanted one.

    Everything but the constant thresholds and the noise stays as the scenario says. The noise is what was tuned on,
    where that fits the scenario. Joints of unknown gain count as not monitored: their thresholds are no torques.

    Args:
        tuning: what gives the thresholds.
        scenarios: by their files.
        noise: what was tuned on.
        robot: the arm whose residuals were tuned on; default: not known, and every threshold counts.
        model: that made residuals of what was recorded; default: none.
    """
    from bumpstop.detection import MAX_EXTRAPOLATION
    from bumpstop.detection.loop.unknown_gains import force_thresholds

    points = []
    noisy = {name: noise.of(scenario) for name, scenario in scenarios.items()}
    for times in _TIMES:
        rate = times * tuning.target
        if rate >= tuning.tail.rate:
            continue
        thresholds = tuning.thresholds(rate)
        counted = thresholds if robot is None else force_thresholds(robot, model, thresholds)[0]
        forces = {name: _forces(scenario, counted) for name, scenario in noisy.items()}
        points.append(OperatingPoint(rate, thresholds, tuning.extrapolation(rate) > MAX_EXTRAPOLATION, forces))
    return points


def _forces(scenario: Scenario, thresholds: FloatArray) -> dict[str, Any]:
    from bumpstop.collision import evaluate
    from bumpstop.detection import undetectable_forces

    # Measured noise is sampled, and seven rates take their time.
    samples = None if scenario.detector.residuals is None else _SAMPLES
    law = evaluate(scenario.with_values({"detector.thresholds_Nm": thresholds.tolist()}), samples=samples)
    problem, contact, verdict = law.problem, scenario.contact, law.verdict
    peak = law.peak_force.to_json()
    forces = undetectable_forces(problem.robot, problem.q, thresholds, link=contact.link, point=contact.point_m)
    largest = float(forces.largest)
    return {
        **{key: peak[key] for key in ("p50", "p95", "p999")},
        "anywhere": largest if largest < float("inf") else None,
        "limit": law.problem.limits.force_N if law.problem.limits else None,
        "acceptable": verdict.acceptable,
        "fails_by": list(verdict.fails_by),
    }


def notes(
    points: Sequence[OperatingPoint],
    scenarios: Mapping[str, Scenario],
    noise: ScenarioNoise,
    *,
    robot: str,
    terms: bool,
) -> list[str]:
    """Whose arm and noise it is that a scenario's forces and alarms are told with, and what of it is left out.

    Args:
        points: of the curve.
        scenarios: by their files.
        noise: what was tuned on.
        robot: whose recordings were tuned on; empty: not known.
        terms: thresholds were tuned that grow with the motion.
    """
    from bumpstop.collision.scenario.scenario_file import robot_of
    from bumpstop.collision.verdict.as_given import as_given

    found = []
    for path, scenario in scenarios.items():
        name, arm = Path(path).stem, robot_of(scenario).name
        if other_robot(arm, robot):
            found.append(f"{name}: its robot is {arm!r}, and the thresholds were tuned for {robot!r}.")
        if terms:
            found.append(f"{name}: its forces are those of the constant thresholds alone; motion adds to them.")
        found += [f"{name}: {note}" for note in as_given(scenario)]
        why = noise.why_not(scenario)
        if why is None:
            found.append(f"{name}: its noise is the residuals of the recordings, in place of its own.")
            continue
        found.append(f"{name}: {why}")
        count = sum("false_alarm" in point.forces[path]["fails_by"] for point in points)
        if count and scenario.detector.residuals is None:
            found.append(
                f"{name}: at {count} of {len(points)} rates alarms before contact are more probable than "
                f"{scenario.verdict.max_false_alarm:g}. They are those of its detector.noise_sd_Nm, not of what was "
                "recorded."
            )
    return found
