"""How the risk grows with the speed, and what would become of other body parts."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision import evaluate
from bumpstop.collision.probability_text import use_percent
from bumpstop.contact import LimitTable
from bumpstop.errors import InputError
from bumpstop.report.colours import LAW
from bumpstop.report.markup import Html
from bumpstop.study.requirement.sampling_ripple import risk_may_fall, slower_speeds
from bumpstop.terminal import UNBOUNDED, number
from bumpstop.view.answer import Answer
from bumpstop.view.controls import NOT_GIVEN, SPEED, body_changes, controls_of
from bumpstop.view.document import with_keys
from bumpstop.view.field_text import OFFERED
from bumpstop.view.latest import SupersededError
from bumpstop.view.plots.chart import Chart, nothing

if TYPE_CHECKING:
    from collections.abc import Callable


_SPEEDS, _MIN_RISK = 11, 1e-9
_MAX_ROWS = 12


def risk_of(answer: Answer) -> float:
    """Probability of exceeding the force or the pressure limit, the larger; NaN without limits."""
    verdict = answer.result.verdict
    return max((p for p in (verdict.p_over_force, verdict.p_over_pressure) if p is not None), default=math.nan)


def risk_plot(answer: Answer, superseded: Callable[[], bool]) -> Html:
    """Probability of exceeding a limit against the speed, with the speed on screen.

    Args:
        answer: of the scenario on screen.
        superseded: asked between two evaluations.

    Raises:
        SupersededError: another scenario is on screen.
    """
    name, title, scenario = "risk", "Risk against speed", answer.scenario
    if not answer.limits_N or scenario.motion.kind != "line":
        return nothing(title, "Drawn for straight lines that hit a body part with limits.", name)
    control = next(each for each in controls_of(scenario, answer.result.problem.robot) if each.key == SPEED)
    now = float(control.read(scenario))  # type: ignore[arg-type]
    low, high = max(1.0, 0.25 * now), 2 * now
    # Where the risk may fall again, its crests are narrow.
    tried = slower_speeds(high, low) if risk_may_fall(scenario) else np.linspace(low, high, _SPEEDS)
    speeds = np.unique(np.append(tried, now))
    risks = []
    for speed in speeds:
        if superseded():
            raise SupersededError
        try:
            there = with_keys(scenario.without_uncertainty(), control.write(scenario, float(speed)))
            risks.append(risk_of(Answer(evaluate(there))))
        except InputError:
            risks.append(math.nan)
    chart = Chart(
        title,
        (float(speeds[0]), float(speeds[-1])),
        (_MIN_RISK, 1.0),
        labels=("speed [mm/s]", "probability"),
        height=170,
        log_y=True,
        name=name,
    )
    chart.line(speeds, np.maximum(np.array(risks), _MIN_RISK), LAW)
    accepted = scenario.verdict.accepted_probability
    chart.horizontal(accepted, f"accepted {accepted:g}")
    chart.mark(now, max(risk_of(answer), _MIN_RISK), f"{number(now)} mm/s")
    return chart.svg()


def body_parts_plot(answer: Answer, superseded: Callable[[], bool]) -> Html:
    """p99 of the peak force as a share of what each body part takes, in the place of the one that is hit.

    Args:
        answer: of the scenario on screen.
        superseded: asked between two evaluations.

    Raises:
        SupersededError: another scenario is on screen.
    """
    name, title, scenario = "body-parts", "Body parts: p99 as a share of the limit", answer.scenario
    if scenario.motion.kind != "line":
        return nothing(title, "Drawn for straight lines.", name)
    table = LimitTable.load(scenario.contact.limits, relative_to=scenario.folder)
    chosen, known = scenario.contact.body or NOT_GIVEN, scenario.without_uncertainty()
    rows: list[tuple[float, str, str, str]] = []
    for region in table.regions:
        if superseded():
            raise SupersededError
        try:
            # Of the part on screen what the scenario says of its stiffness and mass holds.
            there = (
                answer
                if region.name == chosen
                else Answer(evaluate(with_keys(known, body_changes(known, region.name))))
            )
        except InputError:
            continue
        share, text = _share_of_limit(there)
        rows.append((share, region.name, region.label, text))
    rows.sort(key=lambda row: -row[0])
    # The worst, and the one on screen.
    kept = [row for place, row in enumerate(rows) if place < _MAX_ROWS or row[1] == chosen]
    finite = [share for share, *_ in kept if math.isfinite(share)]
    most = min(max([1.25, *(1.1 * share for share in finite)]), 4.0)
    chart = Chart(title, (0.0, most), (0.0, 1.0), labels=("", ""), height=34 + 15.0 * len(kept) + 8, name=name)
    for place, (share, region_name, label, text) in enumerate(kept):
        width = min(share, most * (1.0 if math.isfinite(share) else 0.8))
        chart.bar(34 + 15.0 * place, width, label[:22], text, over=share > 1, chosen=region_name == chosen)
    chart.rule(1.0, "limit")
    return chart.svg(axes=False)


def tornado_plot(answer: Answer) -> Html:
    """How far each uncertain input moves the result by itself; nothing of a scenario without them."""
    if answer.uncertain is None:
        return Html("")
    bars = answer.uncertain.tornado[:_MAX_ROWS]
    title = "Uncertain inputs: how far each moves the share of the limit"
    most = max([0.01, *(bar.swing for bar in bars)])
    chart = Chart(
        title, (0.0, 1.2 * most), (0.0, 1.0), labels=("", ""), height=30 + 15.0 * len(bars) + 8, name="tornado"
    )
    for place, bar in enumerate(bars):
        label = OFFERED.get(bar.key, bar.key.rpartition(".")[2])[:20]
        chart.bar(24 + 15.0 * place, bar.swing, label, number(bar.swing), over=False, chosen=bar.assumed)
    return chart.svg(axes=False)


def _share_of_limit(answer: Answer) -> tuple[float, str]:
    """The p99 of the peak force as a share of what is allowed, and the text of its bar."""
    share = answer.p99_share
    if answer.peak_limit_N == 0:
        return share, "not permitted"
    if math.isinf(answer.peak_limit_N):
        return share, "no limit"
    return share, use_percent(share) if math.isfinite(share) else UNBOUNDED
