"""Whether steps and sub-steps of the simulated controller are fine enough for the force that is said."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from bumpstop.collision.distribution.distribution import Distribution
    from bumpstop.collision.outcome import CollisionOutcome
    from bumpstop.collision.scenario.scenario import Scenario
    from bumpstop.collision.verdict.verdict import Verdict

# A step is cut into so many, and so is a sub-step of the shorter step.
_FINER = 4
# More steps than these are not looked at again: they are fine, or the motion goes on for minutes.
_MAX_STEPS = 100_000
_MIN_STEP_S, _MIN_SUBSTEP_S, _MAX_SUBSTEPS = 1e-5, 1e-6, 1000
# A force that finer steps raise by less than this share is told well enough.
_RISE = 0.02
STEPS_DECIDE = "Finer simulation steps exceed the limits: the steps decide, not the arm."
"""Why an acceptable verdict that they turn settles nothing."""
_SWAPPED = ", and the verdict is NOT ACCEPTABLE"


class JudgedForce(Protocol):
    """What is compared of two results."""

    @property
    def peak_force(self) -> Distribution:
        """[N]."""

    @property
    def verdict(self) -> Verdict:
        """By the limits of the scenario."""


def finer_steps(result: CollisionOutcome, verdict: Verdict, evaluate: Callable[[Scenario], JudgedForce]) -> list[str]:
    """Compare a distribution with that of finer steps; where it hits harder, say how much.

    A reaction takes effect at the ends of sub-steps and the farthest point is looked for at the ends of steps, so that
    coarse ones make a braking distance shorter by up to half the speed times a sub-step.
    """
    given, trajectory = result.scenario, result.problem.trajectory
    duration = given.motion.duration_s if trajectory is None else trajectory.duration
    changes = _finer(given)
    if not changes:
        return []
    if result.problem.residuals is not None or duration / given.simulation.step_s * _FINER > _MAX_STEPS:
        return _by_formula(result)
    at = result.contact_alone()
    step, substeps = changes["simulation.step_s"], changes["simulation.substeps"]
    try:
        other = None if result.kind == "exact" and not at else evaluate(given.with_values(at))
        fine = evaluate(given.with_values(at | changes | _same_phase(result, given.simulation.step_s - step)))
    except InputError:  # an edge that only the finer steps reach, or only the coarse ones miss
        return []
    coarse, judged = (result.peak_force, verdict) if other is None else (other.peak_force, other.verdict)
    p = 1 - given.verdict.accepted_probability
    before, after = coarse.quantile(p), fine.peak_force.quantile(p)
    if not math.isfinite(before):
        p = 0.5
        before, after = coarse.quantile(p), fine.peak_force.quantile(p)
        if before == 0:  # half touch nothing, and the rest is unbounded: no force is told that steps could raise
            return []
    if not after > (1 + _RISE) * before:
        return []
    rise = f"{after:.4g} N, not {before:.4g} N" if math.isfinite(after) else f"without a bound, not {before:.4g} N"
    which = "" if not at else f" of the contact {at['motion.contact_onset_s']:.4g} s after the start"
    swapped = ""
    if judged.acceptable is True and fine.verdict.acceptable is False:
        swapped = _SWAPPED
    return [
        f"Simulation steps are coarse: with simulation.step_s = {step:g} and simulation.substeps = {substeps} the peak "
        f"force{which} (p{100 * p:.6g}) is {rise}{swapped}."
    ]


def fails_with_finer_steps(warnings: Iterable[str]) -> bool:
    """Whether one of a result's warnings says that finer steps make an acceptable verdict NOT ACCEPTABLE."""
    return any(_SWAPPED in warning for warning in warnings)


def _by_formula(result: CollisionOutcome) -> list[str]:
    """Where there is no other distribution to compare with: half the speed times a sub-step, as a force."""
    simulation = result.scenario.simulation
    way = result.curve.approach_speed * simulation.step_s / simulation.substeps / 2
    force = result.problem.stiffness * way
    said = result.peak_force.quantile(1 - result.scenario.verdict.accepted_probability)
    if not math.isfinite(said) or not force > _RISE * said:
        return []
    return [
        f"Simulation sub-steps of {simulation.step_s / simulation.substeps:g} s are coarse: braking distances are up "
        f"to {1e3 * way:.3g} mm shorter for them, which is {force:.3g} N. Give a smaller simulation.step_s or more "
        "simulation.substeps."
    ]


def _same_phase(result: CollisionOutcome, earlier: float) -> dict[str, float]:
    """Keys that move a single contact as far ahead as the control cycles, which follow the first step [s].

    The delay from contact to the next cycle is the same then, and what differs is due to the steps.
    """
    scenario = result.scenario
    if alone := result.contact_alone():
        return {key: max(0.0, begin - earlier) for key, begin in alone.items()}
    contact = scenario.contact
    if contact.offset_law != "fixed" or contact.offset_mm is None:
        return {}
    distance, step = result.curve.distance, scenario.simulation.step_s
    touch = int(np.argmax(distance > contact.offset_mm / 1e3))
    speed = float(distance[touch] - distance[touch - 1]) / step if touch else result.problem.approach_speed
    return {"contact.offset_mm": max(0.0, contact.offset_mm - 1e3 * speed * earlier)}


def _finer(scenario: Scenario) -> dict[str, Any]:
    """Finer steps and sub-steps, as far as they may be; empty where these are the finest."""
    step, substeps = scenario.simulation.step_s, scenario.simulation.substeps
    finer = step / _FINER if step / _FINER >= _MIN_STEP_S else step
    most = min(_MAX_SUBSTEPS, int(finer / _MIN_SUBSTEP_S * (1 + 1e-9)))
    more = max(1, min(substeps * _FINER, most))
    if finer / more >= step / substeps * (1 - 1e-9):
        return {}
    return {"simulation.step_s": finer, "simulation.substeps": more}
