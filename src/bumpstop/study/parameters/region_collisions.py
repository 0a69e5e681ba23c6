"""Collisions with one body region from one direction, at any speed and contact area."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from bumpstop.collision.verdict.finer_steps import fails_with_finer_steps
from bumpstop.study.answer_warnings import warnings_of
from bumpstop.study.requirement.sampling_ripple import SLOWER_MAY_FAIL, risk_may_fall
from bumpstop.study.variable import Variable

if TYPE_CHECKING:
    from collections.abc import Callable

    from bumpstop.collision import CollisionResult, Scenario
    from bumpstop.contact.regions import Region
    from bumpstop.study.requirement.requirement import Requirement

MIN_SPEED_MM_S = 1.0
SPEED_STEP_MM_S = 0.1
_SCAN = 10


def keys_of_the_body(region: Region) -> tuple[str, ...]:
    """Keys of ``[contact]`` that say what another body is like, and are left out where this region is hit.

    A gauge is such a body. A mass stays where the table gives none of the region: free contact needs one.
    """
    keys = ("stiffness_N_m", "stiffness_N_mm", "pressure_area", "gauge_spring_N_m", "gauge_mass_kg")
    return keys if region.effective_mass_kg is None else (*keys, "body_mass_kg")


class RegionCollisions:
    """Distributions of one body and direction, kept by speed: the area changes only how they are judged.

    Args:
        scenario: of the study.
        scenario_of: the scenario of a speed [mm/s] and an area [cm2].
        highest_speed_mm_s: up to which a safe speed is looked for.
    """

    def __init__(
        self, scenario: Scenario, scenario_of: Callable[[float, float], Scenario], highest_speed_mm_s: float
    ) -> None:
        self._scenario = scenario
        self._scenario_of = scenario_of
        self._highest_speed_mm_s = highest_speed_mm_s
        self._known: dict[tuple[float, float | None], CollisionResult] = {}
        self._at_risk: dict[float, float] = {}
        self._requirements: dict[float, Requirement] = {}

    @property
    def _two_phases(self) -> bool:
        scenario = self._scenario
        return scenario.verdict.clamped_limit == "two_phase" and scenario.contact.kind == "clamped"

    def result(self, speed: float, area: float) -> CollisionResult:
        """The distribution at a speed; where contact has two phases, the area belongs to it."""
        from bumpstop.collision import evaluate

        key = speed, area if self._two_phases else None
        if key not in self._known:
            self._known[key] = evaluate(self._scenario_of(speed, area))
        return self._known[key]

    def force_at_risk(self, speed: float, area: float) -> float:
        """Peak force passed with the accepted risk [N]."""
        result = self.result(speed, area)
        if speed not in self._at_risk:
            self._at_risk[speed] = result.peak_force.quantile(1 - self._scenario.verdict.accepted_probability)
        return self._at_risk[speed]

    def over(self, speed: float, area: float) -> tuple[float | None, float | None]:
        """Probabilities of passing the force and the pressure limit with an area; None where there is no limit."""
        result = self.result(speed, area)
        limits = result.problem.limits
        assert limits is not None
        if self._two_phases:
            return result.verdict.p_over_force, result.verdict.p_over_pressure
        force = result.peak_force
        over_force = force.exceedance(limits.force_N)
        if limits.pressure_N_cm2 is None:
            return over_force, None
        allowed = limits.force_at_pressure_limit_N(area, result.scenario.contact.peak_factor)
        return over_force, force.exceedance(allowed)

    def judged(self, speed: float, area: float) -> tuple[bool, str]:
        """Whether a speed is acceptable on an area, and what stands against it or comes nearest to.

        What hits nothing in most cases is not acceptable but ``"untouched"``.
        """
        within, binding = self._within(speed, area)
        return (False, "untouched") if within and self.result(speed, area).verdict.nothing_hit else (within, binding)

    def _within(self, speed: float, area: float) -> tuple[bool, str]:
        """The same as if every case hit something.

        By the quantile of the accepted risk, which costs a thousandth of a far tail.
        """
        settings = self._scenario.verdict
        result = self.result(speed, area)
        limits = result.problem.limits
        assert limits is not None
        if result.false_alarm_probability > settings.max_false_alarm:
            return False, "false_alarm"
        if self._two_phases:
            force, pressure = (p or 0.0 for p in self.over(speed, area))
            return max(force, pressure) <= settings.accepted_probability, "pressure" if pressure > force else "force"
        factor = result.scenario.contact.peak_factor
        within = self.force_at_risk(speed, area) <= limits.allowed_force_N(area, factor)
        return within, limits.governing(area, factor)

    def collision(self, speed: float, area: float) -> dict[str, Any]:
        """One row: the distribution at a speed, judged on an area."""
        over = self.over(speed, area)
        acceptable, binding = self.judged(speed, area)
        result = self.result(speed, area)
        limits = result.problem.limits
        assert limits is not None
        force = result.peak_force
        triggers = {f"trigger_{j + 1}": float(p) for j, p in enumerate(result.trigger_joint_probability)}
        return {
            "kind": "collision",
            "area_cm2": area,
            "speed_mm_s": speed,
            "limit_force_N": limits.force_N,
            "limit_pressure_N_cm2": limits.pressure_N_cm2,
            "mean_N": force.mean,
            "sd_N": force.sd,
            "p99_N": force.quantile(0.99),
            "p999_N": force.quantile(0.999),
            "false_alarm": result.false_alarm_probability,
            "undetected": result.undetected_probability,
            "several_joints": result.multi_joint_probability,
            **triggers,
            "p_over_force": over[0],
            "p_over_pressure": over[1],
            "acceptable": None if binding == "untouched" else acceptable,
        }

    def safe_speed(self, area: float) -> dict[str, Any]:
        """:meth:`_safe_speed` with the warnings that stand beside its verdict."""
        found = self._safe_speed(area)
        speed = found.get("safe_speed_mm_s")
        # The distributions that are kept by speed belong to the area that asked first.
        warnings = () if speed is None else warnings_of(lambda: self._scenario_of(speed, area))
        if speed is not None and risk_may_fall(self._scenario) and not self._risk_may_fall:
            warnings = (SLOWER_MAY_FAIL, *warnings)
        return found | {"warnings": list(warnings), "fails_with_finer_steps": fails_with_finer_steps(warnings)}

    def _safe_speed(self, area: float) -> dict[str, Any]:
        """The highest speed below which every speed looked at is acceptable, in tenths of mm/s; None: not even 1 mm/s.

        A scan finds the first speed that is not acceptable, and bisection the edge below it. Where the risk may fall at
        a higher speed, a requirement looks at all crests, and the scan only at false alarms and at whether anything is
        hit.
        """
        found: dict[str, Any] = {"kind": "safe_speed", "area_cm2": area, "reason": ""}
        top = self._highest_speed_mm_s
        judged, beyond = self.judged, "none"
        if self._risk_may_fall:
            required = self._required(area)
            if required.binding == "untouched":
                return found | {"reason": required.reason}
            if required.value is None:
                return found | {"binding": required.binding, "reason": f"Not acceptable even at {required.low:g} mm/s."}
            if required.binding != "range":
                tenths = math.floor(required.value / SPEED_STEP_MM_S + 1e-6)
                top, beyond = round(tenths * SPEED_STEP_MM_S, 1), required.binding
            judged = self._alarms_judged
        ratio = (top / MIN_SPEED_MM_S) ** (1 / (_SCAN - 1))
        scan = sorted({round(MIN_SPEED_MM_S * ratio**i, 1) for i in range(_SCAN - 1)} | {top})
        low = None
        for speed in scan:
            acceptable, binding = judged(speed, area)
            if not acceptable:
                break
            low = speed
        else:
            reason = f"Nothing stands against it up to {top:g} mm/s." if beyond == "none" else ""
            return found | {"safe_speed_mm_s": top, "binding": beyond, "reason": reason}
        if low is None and binding == "untouched":
            return found | {"reason": self.result(scan[0], area).verdict.nothing_hit}
        if low is None:
            return found | {"binding": binding, "reason": f"Not acceptable even at {scan[0]:g} mm/s."}
        # Whole tenths, so that the speed returned is one that was looked at.
        below, above = math.floor(low / SPEED_STEP_MM_S + 1e-6), math.ceil(speed / SPEED_STEP_MM_S - 1e-6)
        tries = 0
        while above - below > 1:
            # By straight lines through the logarithms, and every third time by halves.
            tries += 1
            middle = (below + above) // 2 if tries % 3 == 0 else self._crossing(below, above, area)
            acceptable, against = judged(round(middle * SPEED_STEP_MM_S, 1), area)
            if acceptable:
                below = middle
            else:
                above, binding = middle, against
        return found | {"safe_speed_mm_s": round(below * SPEED_STEP_MM_S, 1), "binding": binding}

    @property
    def _risk_may_fall(self) -> bool:
        """Whether the risk may fall at a higher speed, and has an integrated distribution."""
        scenario = self._scenario
        return risk_may_fall(scenario) and scenario.detector.residuals is None

    def _required(self, area: float) -> Requirement:
        """The highest speed that meets the risk, with every slower one; slower arms get longer to go as far."""
        from bumpstop.study.requirement.requirement import solve_requirement

        own = Variable("motion.speed").value(self._scenario)
        scenario = self._scenario_of(own, area)
        limits = self.result(own, area).problem.limits
        assert limits is not None
        # Without phases the area decides nothing but the force that is allowed.
        key = area if self._two_phases else limits.allowed_force_N(area, scenario.contact.peak_factor)
        if key not in self._requirements:
            highest = self._highest_speed_mm_s
            self._requirements[key] = solve_requirement(scenario, "motion.speed", low=MIN_SPEED_MM_S, high=highest)
        return self._requirements[key]

    def _alarms_judged(self, speed: float, area: float) -> tuple[bool, str]:
        """As :meth:`judged`, by false alarms and by whether anything is hit: a requirement answers for the risk."""
        result = self.result(speed, area)
        if result.false_alarm_probability > self._scenario.verdict.max_false_alarm:
            return False, "false_alarm"
        return not result.verdict.nothing_hit, "untouched"

    def _crossing(self, below: int, above: int, area: float) -> int:
        """Whole tenths between two others where the force at risk should reach what is allowed; else the middle."""
        middle = (below + above) // 2
        if self._two_phases or below == 0:
            return middle
        ends = [round(tenths * SPEED_STEP_MM_S, 1) for tenths in (below, above)]
        limits = self.result(ends[0], area).problem.limits
        assert limits is not None
        allowed = limits.allowed_force_N(area, self._scenario.contact.peak_factor)
        low, high = (self.force_at_risk(speed, area) for speed in ends)
        if not 0 < low < high < math.inf or not low <= allowed < high:
            return middle
        share = math.log(allowed / low) / math.log(high / low)
        # The nearest tenth above: where the guess is good the next one closes the bracket from below.
        found: int = math.ceil(below * math.exp(share * math.log(above / below)))
        return min(max(found, below + 1), above - 1)
