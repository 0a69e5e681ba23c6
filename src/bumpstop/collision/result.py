"""What came of a collision: distributions of its forces and times, probabilities, verdict, notes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import finite_or_none
from bumpstop.collision.arm.other_arm import other_arm
from bumpstop.collision.distribution.distribution import NEGLIGIBLE
from bumpstop.collision.notes import line_end_notes, notes_of
from bumpstop.collision.outcome import CollisionOutcome
from bumpstop.collision.scenario.unused_keys import unused_notes
from bumpstop.collision.summary import print_figures, print_other_arm, print_probabilities, print_verdict
from bumpstop.collision.tables import result_table
from bumpstop.collision.verdict.two_phase_use import TwoPhaseUse
from bumpstop.collision.verdict.verdict import Verdict, judge
from bumpstop.collision.verdict.verdict_notes import nothing_hit, verdict_notes
from bumpstop.display import CURVE, FAINT, LIMIT, Displayed
from bumpstop.terminal import text_of

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes
    from rich.console import Console

    from bumpstop.collision.scenario.scenario import Scenario


@dataclass(frozen=True, eq=False, repr=False)
class CollisionResult(CollisionOutcome, Displayed):
    """The distribution of one collision over contact offset and sensor noise.

    Attributes:
        problem: the checked scenario.
        curve: its stopping curve.
        kind: ``"exact"`` or ``"sampled"``; ``samples`` and ``seed`` belong to the latter.
        peak_force: [N]; a collision never detected counts with the greatest force of a motion that comes to rest, and
            as unbounded where only the simulated time ended the motion (:attr:`unbounded_because`).
        force_at_detection: [N], given a detection after contact.
        detection_delay: from contact to the tick that detects it [s], given the same.
        trigger_joint_probability: (dof,) joint over its threshold at the tick of detection, given detection. Sums to
            more than 1 where joints fire together.
        multi_joint_probability: two or more joints at that tick, given detection.
        false_alarm_probability: detection before contact.
        undetected_probability: contact, but no detection by the end of the motion.
        no_contact_probability: neither contact nor alarm by the end of the motion.
        runs: of the sampled distribution: offset [m], tick (-1: never), triggers (bit j: joint j + 1), noise and
            residual, and whether it was ``detected_after_contact``.
        kernel: the compiled distribution, of an integrated one; of a trajectory that.
        transient_contact_duration: of free contact, until the body has got away [s].
        evaluate: gives the result of another scenario, which this one is compared with: of the other model of the arm,
            or of finer steps.
    """

    evaluate: Callable[[Scenario], CollisionResult] = field(kw_only=True)

    def __repr__(self) -> str:
        """What hits how hard: its arrays would fill screens."""
        who, verdict = f"{self.problem.robot.name} {self.problem.motion_in_words}", self.verdict.acceptable
        return f"{type(self).__name__}({self.kind}, {who}, acceptable={verdict}, peak_force={self.peak_force!r})"

    @cached_property
    def verdict(self) -> Verdict:
        """Judged by the limits of the body region, or with ``acceptable`` None where only a stiffness was given.

        So it is, too, where most cases touch nothing. What else weakens the verdict is in :attr:`warnings`.
        """
        return judge(self, self._over_in_two_phases, nothing_hit(self))

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """What makes the verdict mean less than it says: to be read beside it."""
        return tuple(verdict_notes(self, self.verdict, self.evaluate))

    @cached_property
    def other_arm(self) -> CollisionResult | None:
        """The same collision of a rigid arm in the place of an elastic one, or the reverse; see :mod:`.other_arm`."""
        return other_arm(self.problem, self.evaluate)

    @cached_property
    def _over_in_two_phases(self) -> tuple[float, float | None] | None:
        """Probability of passing the force and the pressure limit of either phase; None where contact has one phase."""
        transient, lasting = self.problem.transient_limits, self.problem.limits
        if transient is None or lasting is None:
            return None
        if not transient.permitted:
            return 1.0, 1.0
        return TwoPhaseUse.of(self, transient, lasting).over()

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """What was assumed, and what was cut short."""
        return tuple(notes_of(self, self.warnings))

    def __str__(self) -> str:
        return text_of(self.print_to, width=80, wrapped=True)

    def print_to(self, console: Console, *, case: str = "") -> None:
        """Print verdict, figures and notes, as ``bumpstop evaluate`` does.

        Args:
            console: to print to.
            case: the name of the case where the result is one of several: its verdict is none by itself, and has no
                sign.
        """
        print_verdict(self, self.verdict, console, case=case)
        for warning in self.warnings:
            console.print(f"warning: {warning}")
        print_figures(self, self.verdict, console)
        if self.other_arm is not None:
            print_other_arm(self.other_arm, self.other_arm.verdict, console)
        print_probabilities(self, console)
        # What the figures above are not about; what was assumed otherwise is in the report.
        ends = (*self.end_notes(), *line_end_notes(self))
        for note in (*unused_notes(self.scenario, self.problem.deceleration), *ends):
            console.print(f"note: {note}")
        integrated = self.kind == "exact"
        kind = (
            "integrated distribution" if integrated else f"sampled distribution, {self.samples} runs, seed {self.seed}"
        )
        console.print(f"{kind}; {self.notes[-1][0].lower()}{self.notes[-1][1:]}", style="dim")

    def to_frame(self) -> pl.DataFrame:
        """Data frame of quantiles of an integrated distribution, or of the runs of a sampled one: ``law.parquet``."""
        return result_table(self)

    def _draw(self, axes: Axes) -> None:
        """Draw the probability of a larger peak force, with the force that the limits allow."""
        levels = 1 - np.logspace(-0.001, -9, 73)
        quantiles = {float(self.peak_force.quantile(float(p))) for p in levels}
        force = np.array(sorted(value for value in quantiles if np.isfinite(value)))
        shown = [max(self.peak_force.exceedance(float(value)), NEGLIGIBLE) for value in force]
        axes.semilogy(force, shown, color=CURVE)
        axes.axhline(self.verdict.accepted_probability, color=FAINT, linewidth=1, linestyle="--")
        if self.verdict.limits is not None:
            contact = self.scenario.contact
            allowed = self.verdict.limits.allowed_force_N(contact.area_cm2, contact.peak_factor)
            axes.axvline(allowed, color=LIMIT, label="allowed force")
            axes.legend()
        axes.set(xlabel="peak force, N", ylabel="probability of a larger one", ylim=(1e-9, 2), xlim=(0, None))

    def to_json(self) -> dict[str, Any]:
        """The object that ``bumpstop evaluate --json`` prints; figures that are not finite are None."""
        contact_duration = self.contact_duration
        result: dict[str, Any] = {
            "peak_force_N": self.peak_force.to_json(),
            "pressure_N_cm2": self.pressure.to_json(),
            "compression_mm": self.compression.to_json(),
            "force_at_detection_N": self.force_at_detection.to_json(),
            "detection_delay_s": self.detection_delay.to_json(),
            "contact_duration_s": None if contact_duration is None else contact_duration.to_json(),
            "trigger_joint_probability": [finite_or_none(p) for p in self.trigger_joint_probability],
            "multi_joint_probability": finite_or_none(self.multi_joint_probability),
            "false_alarm_probability": self.false_alarm_probability,
            "undetected_probability": self.undetected_probability,
            "no_contact_probability": self.no_contact_probability,
            "law": self.kind,
        }
        result["arm"] = self._arm_to_json()
        if self.impact_bounds is not None:
            result["impact_bounds"] = self.impact_bounds.to_json()
        if self.kind == "sampled":
            result |= {"samples": self.samples, "seed": self.seed}
        verdict = self.verdict.to_json() | {"warnings": list(self.warnings)}
        return result | {"verdict": verdict, "notes": list(self.notes)}

    def _arm_to_json(self) -> dict[str, Any]:
        problem, other, limit = self.problem, self.other_arm, self.pressing_limit
        arm: dict[str, Any] = {"model": problem.scenario.arm.model}
        if problem.elastic:
            arm["status"] = dict(problem.drive_train.status)
            arm["pressing_limit"] = None if limit is None else limit.to_json()
        if other is not None:
            arm["other"] = {
                "model": other.scenario.arm.model,
                "peak_force_N": other.peak_force.to_json(),
                "p_over_force": other.verdict.p_over_force,
                "p_over_pressure": other.verdict.p_over_pressure,
                "conclusion": other.verdict.conclusion,
            }
        return arm
