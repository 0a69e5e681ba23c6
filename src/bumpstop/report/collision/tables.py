"""The report's tables: every figure, where it comes from, and what was put in."""

from __future__ import annotations

import math
import platform
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from bumpstop._native import target
from bumpstop.collision.distribution.distribution import QUANTILES, finite_mean
from bumpstop.collision.probability_text import percent
from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S
from bumpstop.contact import LimitTable, builtin_tables
from bumpstop.report.formatting import in_phases, method_words, percentile, quantity
from bumpstop.report.markup import Html, bullets, element, paragraph, table
from bumpstop.report.section import Section
from bumpstop.terminal import as_written, number

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bumpstop.collision import CollisionResult, Distribution, Scenario

# How docs/reference/contact.md explains the words of the limit tables.
_STATUS = {
    "multi": "two or more transcriptions give this figure",
    "single": "one transcription gives this figure",
    "unrecorded": "from public transcriptions; how many agree was not noted",
}


class FiguresSection(Section):
    """Mean, standard deviation and quantiles of every quantity."""

    title = "All figures"
    anchor = "figures"

    def content(self) -> list[Html]:
        """One table, and how to read it."""
        result = self.result
        rows: list[tuple[str, Distribution | None, float]] = [
            ("peak force [N]", result.peak_force, 1),
            ("peak pressure [N/cm²]", result.pressure, 1),
            ("deformation [mm]", result.compression, 1),
            ("force at detection [N]", result.force_at_detection, 1),
            ("detection delay [ms]", result.detection_delay, 1e3),
            ("contact duration [ms]", result.contact_duration, 1e3),
        ]
        headings = ("", "mean", "sd", *(percentile(name) for name in QUANTILES))
        free = result.problem.body_mass is not None
        given = "until arm and body have separated" if free else "given a reaction that ends the contact"
        damped = ""
        if result.scenario.contact.damping_Ns_m > 0:
            damped = "Deformation is that of the body's spring alone under the peak force, without its damper. "
        text = (
            "A quantile p99 is the value that 99 of 100 collisions stay below. Force at detection and delay are given "
            f"a detection after contact, contact duration {given}. {damped}“unbounded”: the "
            "quantile lies in the share that is never detected; “none”: no collision has one."
        )
        found = [
            paragraph(f"Computed with the {method_words(result)}. ", text),
            table(headings, [_row(*row) for row in rows], caption="Every quantity", numbers=True),
        ]
        if math.isinf(result.peak_force.mean) and not math.isnan(mean := finite_mean(result.peak_force)):
            words = quantity(mean, "N")
            found.append(paragraph(f"The mean peak force of the collisions that have a bound is {words}."))
        if result.contact_duration is None:
            found.append(paragraph("There is no contact duration: a stopped arm keeps the body clamped."))
        return found


def _row(name: str, distribution: Distribution | None, factor: float) -> list[str]:
    if distribution is None:
        return [name, *["not released"] * 6]
    figures = [distribution.mean, distribution.sd, *(distribution.quantile(p) for p in QUANTILES.values())]
    # Without a bound there is a mean (infinite) but no spread; both say the same to a reader.
    if math.isinf(distribution.mean):
        figures[1] = math.inf
    return [name, *(number(factor * value) for value in figures)]


class ProvenanceSection(Section):
    """Where geometry, limits and stiffness come from, and how well they are attested."""

    title = "Where the figures come from"
    anchor = "provenance"

    def content(self) -> list[Html]:
        """One table of sources."""
        result, robot = self.result, self.result.problem.robot
        rows = [
            ("robot", f"{robot.title or robot.name} ({robot.name})"),
            ("its geometry", robot.source or "not stated"),
        ]
        if robot.note:
            rows.append(("about it", robot.note))
        rows += self._limits()
        contact = result.scenario.contact
        given = contact.stiffness_N_m is not None
        source = "as the scenario says" if given else "from the limit table"
        rows.append(("stiffness", f"{result.problem.body_stiffness:g} N/m, {source}"))
        together = f"{result.problem.stiffness:.5g} N/m in series with the body"
        padding = contact.padding_N_m
        if padding is not None:
            rows.append(("padding", f"{padding:g} N/m, as the scenario says; {together}"))
        if (damping := contact.damping_Ns_m) > 0:
            rows.append(("damping", f"{damping:g} Ns/m beside the spring, as the scenario says"))
        if (spring := contact.gauge_spring_N_m) is not None:
            mass = contact.gauge_mass_kg
            carried = together if mass is None else f"{mass:g} kg move on it"
            rows.append(("spring of the gauge", f"{spring:g} N/m, as the scenario says; {carried}"))
        return [table(("", ""), rows, caption="Sources and their status")]

    def _limits(self) -> list[tuple[str, str]]:
        limits = self.result.problem.limits
        if limits is None:
            return [("limits", "none: no body region is named")]
        kind = "clamped (quasi-static limits)" if limits.kind == "clamped" else "free (transient limits)"
        first = self.result.problem.transient_limits
        if first is not None:
            kind = f"clamped (transient limits for {FIRST_PHASE_S:g} s, then quasi-static ones)"
        rows = [("limit table", limits.table), ("body region", f"{limits.label} ({limits.region}), {kind}")]
        if limits.table in builtin_tables():
            document = LimitTable.load(limits.table)
            rows[0] = ("limit table", f"{document.name}: {document.title}")
            if document.note:
                rows.append(("about the table", document.note))
        allowed = f"{as_written(limits.force_N)} N" if limits.permitted else f"none. {limits.reason}"
        if first is not None:
            allowed = in_phases(first.force_N, limits.force_N, "N")
        rows.append(("force limit", f"{allowed}; {_attested(limits.force_source, limits.force_status)}"))
        if limits.pressure_N_cm2 is None:
            rows.append(("pressure limit", "none in this table"))
        else:
            source, status = limits.pressure_source or "not stated", limits.pressure_status or "not stated"
            figure = f"{as_written(limits.pressure_N_cm2)} N/cm²"
            if first is not None and first.pressure_N_cm2 is not None:
                figure = in_phases(first.pressure_N_cm2, limits.pressure_N_cm2, "N/cm²")
            figure += f" ({limits.pressure_area})"
            rows.append(("pressure limit", f"{figure}; {_attested(source, status)}"))
        return rows


def _attested(source: str, status: str) -> str:
    meaning = f" ({_STATUS[status]})" if status in _STATUS else ""
    return f"{source}; status: {status}{meaning}"


class SettingsSection(Section):
    """The scenario in full, defaults included, and what computed it."""

    title = "Settings"
    anchor = "settings"

    def __init__(self, result: CollisionResult, details: Mapping[str, str], scenario: Scenario | None = None) -> None:
        super().__init__(result)
        self._details = details
        # As given, where the result is that of its central case.
        self._scenario = scenario or result.scenario

    def content(self) -> list[Html]:
        """Two tables: scenario keys, and versions."""
        made_by = {
            "law": method_words(self.result),
            "bumpstop": version("bumpstop"),
            "numpy": version("numpy"),
            "python": platform.python_version(),
            "instruction set": target,
            **self._details,
        }
        settings = [(element("code", key), value) for key, value in flat(self._scenario.to_dict())]
        return [
            table(("key", "value"), settings, caption="Scenario, defaults included"),
            table(("", ""), list(made_by.items()), caption="Made by"),
        ]


def flat(data: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Dotted keys and their values, in the order of the scenario's own tables."""
    rows: list[tuple[str, str]] = []
    for key, value in data.items():
        if isinstance(value, dict):
            rows += flat(value, f"{prefix}{key}.")
        else:
            rows.append((prefix + key, _shown(value)))
    return rows


def _shown(value: Any) -> str:
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_shown(item) for item in value) + "]"
    if value is None:
        return "not given"
    if isinstance(value, bool):  # as files have it
        return str(value).lower()
    return repr(value).removesuffix(".0") if isinstance(value, float) else str(value)


class AssumptionsSection(Section):
    """What the figures rest on, and what nobody should read into them."""

    title = "Assumptions and limits of this report"
    anchor = "assumptions"

    def content(self) -> list[Html]:
        """The distribution's notes, then what is not claimed."""
        result = self.result
        claims = [
            "bumpstop is an engineering tool, not a certified safety function. A risk assessment and a validation on "
            "the real cell are not replaced by it.",
            "The limits are transcriptions. Before claiming compliance with a standard, compare them with a bought "
            "copy of it, in its current edition.",
            "The model is not validated on your arm: noise, thresholds, deceleration and latency are those of the "
            "scenario. Measure them, or the figures are about another arm.",
            *(
                ()
                if result.problem.elastic
                else (
                    "Compliance of the gears and the controller is not modelled; it may lower or raise the force on "
                    "the body, and it can delay detection.",
                )
            ),
            "Probabilities far below the accepted risk are statements about the model's tails, not about an arm.",
            "One motion and one contact point are judged. Others may be worse."
            if result.problem.trajectory is not None
            else "One pose, one direction and one contact point are judged. Others may be worse.",
        ]
        found = [element("h3", "What was assumed"), bullets(result.notes)]
        if result.kind == "sampled":
            least = 1 / (result.samples or 1)
            found.append(
                paragraph(f"With {result.samples} sampled collisions, probabilities near {percent(least)} are coarse.")
            )
        return [*found, element("h3", "What is not claimed"), bullets(claims)]
