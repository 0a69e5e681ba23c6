"""What a report says where other limits hold than those of lasting contact."""

import matplotlib.figure
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from bumpstop.report.collision.page import Page
from bumpstop.report.collision.verdict import VerdictSection
from bumpstop.report.picture import WIDTH
from report.cases import Outline, evaluate


def test_a_free_body_that_nobody_notices_is_no_failure():
    result = evaluate({"contact.kind": "free", "contact.limits": "ts15066", "motion.velocity_mm_s": [0, 0, -120]})
    assert result.undetected_probability > 0.4
    assert result.verdict.p_over_force < 1e-6
    text = Outline(Page(result).html()).text
    assert "A body that gets away undetected counts with the force it has met." in text
    assert "count as over every limit" not in text
    assert "count as beyond every force" not in text


def test_two_phases_have_two_limits():
    """Hand and finger by ISO/TS 15066: 140 N and 190 N/cm² for long, twice as much in the first half second."""
    changes = {"contact.limits": "ts15066", "contact.area_cm2": 1.0, "motion.velocity_mm_s": [0, 0, -90]}
    result = evaluate({**changes, "verdict.clamped_limit": "two_phase"})
    assert result.verdict.acceptable
    assert 190 < result.peak_force.quantile(0.99) < 280
    page = Page(result)
    text = Outline(page.html()).text
    assert f"(p99.9) {result.peak_force.quantile(0.999):.4g} N 280 N at first, 140 N later Peak pressure" in text
    assert "On 1 cm² that is 280 N at first, 140 N later." in text
    assert "stands the probability of exceeding it" not in text
    assert "but not the one at first. Pressure is force over 1 cm², so its scale runs along the top." in text
    figures = {figure.picture.name: figure.picture for figure in page.figures}
    assert "limit later at 140 N; limit at first at 280 N" in figures["peak_force"].alt
    # Only beyond the first limit any force is too much, and the contact is over before the other holds.
    drawn = {name: matplotlib.figure.Figure() for name in ("peak_force", "force_over_time_bad")}
    for name, figure in drawn.items():
        figures[name].draw(figure)
    (hatched,) = [patch for patch in drawn["peak_force"].axes[0].patches if patch.get_hatch()]
    assert hatched.get_x() == 280
    words = [text.get_text() for text in drawn["force_over_time_bad"].axes[0].texts]
    assert "limit 280 N" in words
    assert "limit 140 N" not in words
    # An arm that stays is there when the other does.
    staying = Page(evaluate({**changes, "verdict.clamped_limit": "two_phase", "reaction.kind": "stop"}))
    (bad,) = [figure.picture for figure in staying.figures if figure.picture.name == "force_over_time_bad"]
    figure = matplotlib.figure.Figure((WIDTH, bad.height))
    bad.draw(figure)
    (limits,) = [text for text in figure.axes[0].texts if text.get_text() == "limit 280 N, 140 N from 0.5 s on"]
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw(renderer)
    drawn_texts = [text for text in figure.axes[0].get_children() if isinstance(text, Text)]
    (title,) = [text.get_window_extent(renderer) for text in drawn_texts if text.get_text() == "A bad collision"]
    assert not title.overlaps(limits.get_window_extent(renderer))
    assert title.y1 <= figure.bbox.y1


@pytest.mark.parametrize("two_phase", [False, True])
@pytest.mark.parametrize("speed", [30, 90, 160])
def test_the_table_tells_which_limits_a_peak_is_above(speed, two_phase):
    """Of two limits only a peak above that at first, or below that for later, can be told by itself."""
    changes = {"contact.limits": "ts15066", "contact.area_cm2": 1.0, "motion.velocity_mm_s": [0, 0, -speed]}
    if two_phase:
        changes["verdict.clamped_limit"] = "two_phase"
    result = evaluate(changes)
    peak = result.peak_force.quantile(0.999)
    assert {30: peak < 140, 90: 140 < peak < 280, 160: peak > 280}[speed]
    limit = "280 N at first, 140 N later" if two_phase else "140 N"
    word = {30: "below ", 90: "" if two_phase else "above ", 160: "above "}[speed]
    text = Outline("".join(VerdictSection(result).content())).text
    assert f"(p99.9) {peak:.4g} N {limit} {word}Peak pressure" in text
