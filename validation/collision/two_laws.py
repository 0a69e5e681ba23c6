"""The integrated distribution against the sampled distribution: two methods, nothing else between them."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.figure import Figure
from scipy import stats

import bumpstop as bs
from bumpstop.report.picture import LAW, LIMIT, Picture, axes
from collision.cases import FREE, REMEMBERING, VARIED
from validation.findings import Findings
from validation.scores import Score, bonferroni, law_scores, worst

TITLE = "Integrated distribution against sampled distribution"
# A single score passes this once in 16 000.
ALLOWED = 4.0


def compare(findings: Findings, *, quick: bool) -> None:
    """Score every output of every varied scenario."""
    runs = 20_000 if quick else 1_000_000
    scenarios = VARIED | REMEMBERING | FREE
    names = [*list(VARIED)[:3], *list(REMEMBERING)[1:2], *list(FREE)[2:3]] if quick else list(scenarios)
    findings.say(
        "Both distributions stand on the same stopping curve. One integrates over contact offset and noise, the other "
        f"draws {runs} collisions. Every output of every scenario is compared in standard errors of the sample: means, "
        "standard deviations, probabilities, trigger joints, and the share of runs above seven quantiles of the "
        "integrated distribution. Probabilities are scored by the binomial distribution itself."
    )
    everything: list[Score] = []
    rows = []
    for number, name in enumerate(names):
        scenario = scenarios[name]
        scores = law_scores(bs.evaluate(scenario), bs.evaluate(scenario, samples=runs, seed=1000 + number, threads=2))
        everything += scores
        far = worst(scores)
        findings.check(
            f"{name}: {len(scores)} figures within {ALLOWED:g} standard errors",
            abs(far.score) < ALLOWED,
            f"worst {far.score:+.2f}, {far.what}",
        )
        rows += [[name, score.what, score.known, score.sampled, score.score] for score in scores]
    findings.table(
        "Every figure of both distributions, and their difference in standard errors",
        ["Scenario", "Figure", "Exact", "Sampled", "Difference [standard errors]"],
        ["", "", ".6g", ".6g", "+.2f"],
        rows,
    )
    _check_spread(findings, everything)


def _check_spread(findings: Findings, everything: list[Score]) -> None:
    """Scores of all scenarios together: not too far out, neither too wide nor too narrow."""
    far, bound = worst(everything), bonferroni(len(everything))
    findings.check(
        f"Largest of all {len(everything)} scores within the Bonferroni bound of 1 in 1000",
        abs(far.score) < bound,
        f"{abs(far.score):.2f} against {bound:.2f}",
    )
    smooth = np.array([score.score for score in everything if score.smooth])
    spread = math.sqrt(float(np.mean(smooth**2)))
    # Figures of one scenario come from the same runs and lean on each other: as if there were about a quarter as many.
    slack = 4 * math.sqrt(1 / (2 * smooth.size / 4))
    findings.check(
        f"Root mean square of the {smooth.size} scores with many expected events is 1 within {slack:.2f}",
        abs(spread - 1) < slack,
        f"{spread:.3f}",
    )
    beyond = float(np.mean(np.abs(smooth) > 1.96))
    findings.say(f"{100 * beyond:.1f} % of these scores lie beyond 1.96, where a standard normal has 5 %.")
    findings.figures |= {"root_mean_square": spread, "beyond_1.96": beyond, "scores": smooth}

    def draw(figure: Figure) -> None:
        panel = axes(figure)
        ordered = np.sort(smooth)
        normal = stats.norm.ppf((np.arange(ordered.size) + 0.5) / ordered.size)
        panel.plot(normal, normal, color=LIMIT, linestyle="--", label="standard normal")
        panel.plot(normal, ordered, "o", color=LAW, markersize=2.5, label="scores")
        panel.set_xlabel("quantile of a standard normal")
        panel.set_ylabel("score [standard errors]")
        panel.set_title("Differences of the two distributions")
        panel.legend(loc="upper left")

    findings.picture(
        Picture(
            "two-laws",
            "Sorted scores against the quantiles of a standard normal; they lie along the diagonal.",
            "Scores of all scenarios against the quantiles of a standard normal. Along the diagonal nothing but chance "
            "lies between the two laws.",
            draw,
        )
    )
