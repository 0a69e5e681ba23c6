"""The report's parts: what is drawn and counted, words for numbers, safe HTML."""

import math
import re
import warnings
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import bumpstop as bs
from bumpstop.collision.probability_text import percent
from bumpstop.detection import Label, score
from bumpstop.identification.comparison import Comparison
from bumpstop.joint.parameters import Parameter
from bumpstop.recording import Recording
from bumpstop.report.collision.area import AreaSection
from bumpstop.report.collision.arm import ArmSection
from bumpstop.report.collision.chain import _numbers, chain_picture
from bumpstop.report.collision.detection import DetectionSection
from bumpstop.report.collision.distribution import DistributionSection, bins
from bumpstop.report.collision.force_over_time import ForceOverTimeSection
from bumpstop.report.collision.tables import FiguresSection, ProvenanceSection
from bumpstop.report.collision.verdict import VerdictSection
from bumpstop.report.detection.scoring import DetectionsPart
from bumpstop.report.formatting import with_error
from bumpstop.report.identification.recording import recording_picture
from bumpstop.report.identification.validation import OverTimePart, WherePart
from bumpstop.report.markup import Html, element, table
from bumpstop.report.picture import WIDTH, Picture, axes, spread
from bumpstop.terminal import number
from bumpstop.view.answer import Answer
from bumpstop.view.plots.distribution import distribution_plot
from report.cases import Outline, evaluate, with_limits


@pytest.fixture(scope="module")
def law():
    return evaluate()


def test_headings_are_words_and_not_names_of_classes():
    sources = sorted(Path(bs.__file__).parent.joinpath("report").rglob("*.py"))
    text = "\n".join(path.read_text(encoding="utf-8") for path in sources)
    headings = re.findall(r'(?:\btitle = |set_title\()f?"([^"]+)"', text)
    assert len(headings) > 60
    assert [each for each in headings if re.search(r"[a-z][A-Z]", each.replace("MuJoCo", ""))] == []


def test_the_drawn_arm_is_the_arm(law):
    chain = ArmSection(law)._chain
    assert chain.shape == (9, 3)
    np.testing.assert_allclose(chain[-1], law.curve.start, atol=1e-12)
    np.testing.assert_allclose(chain[1], [0, 0, 0.31])


def test_area_section_states_the_crossing(law):
    text = " ".join(AreaSection(law).content())
    assert "from 2.25 cm² on" in text
    assert "120 N are allowed" in text


def test_what_false_alarms_keep_away_touches_nothing():
    """Such cases are no cases of no contact, which ends without an alarm."""
    kept_away = evaluate({"detector.noise_sd_Nm": 12.0, "contact.offset_law": "fixed", "contact.offset_mm": 30.0})
    assert kept_away.no_contact_probability < 1e-6 < 0.999 < kept_away.false_alarm_probability
    for words in (" ".join(DistributionSection(kept_away).content()), str(distribution_plot(Answer(kept_away)))):
        assert re.search(r"[oN]\w* figure: over 99\.9999 % of cases touch nothing\.", words), words


def test_what_presses_nothing_is_told_with_its_own_cause():
    """A contact point that turns back is no alarm, and forces at the hardest moment do not hold at others."""
    path = Path(__file__).parents[2] / "examples" / "06_pick_and_place_trajectory.toml"
    result = bs.evaluate(bs.load_scenario(path))
    cause = (
        "In 0.015 % of cases the arm does not press at all, as the motion ends before contact: the contact point turns"
    )
    assert cause in " ".join(DistributionSection(result).content())
    assert "smallest of them is detected at that moment." in " ".join(DetectionSection(result).content())
    assert "There is no contact duration:" in " ".join(FiguresSection(result).content())


def test_bins_reach_the_end_of_the_bounded_part(law):
    edges = bins(law.peak_force, None)
    density = law.peak_force.density(edges)
    assert density @ np.diff(edges) == pytest.approx(1, abs=3e-4)
    partly = evaluate({"motion.duration_s": 0.01})  # a median of zero, some contacts, some never detected
    edges = bins(partly.peak_force, None)
    share = 1 - partly.undetected_probability - partly.no_contact_probability - partly.false_alarm_probability
    assert partly.peak_force.density(edges) @ np.diff(edges) == pytest.approx(share, abs=3e-4)


def test_delays_far_beyond_the_others_are_left_out_and_counted(law):
    path = Path(__file__).parents[2] / "examples" / "06_pick_and_place_trajectory.toml"
    long = bs.evaluate(bs.load_scenario(path))  # a slow start that is detected after seconds, one in a hundred
    for each, cut in ((law, False), (long, True)):
        picture = next(p for p in DetectionSection(each).pictures() if p.name == "detection_delay")
        found = re.search(r"([\d.]+) % lie beyond the right edge", picture.caption)
        assert bool(found) == cut
        if found:
            delay = each.detection_delay.scaled(1e3)
            share = float(found[1]) / 100
            assert delay.quantile(1 - share) == pytest.approx(1.5 * delay.quantile(0.99), rel=0.05)


@pytest.mark.parametrize("name", bs.robots())
def test_the_labels_of_an_arm_lie_inside_its_picture(name):
    picture = chain_picture(bs.Robot.load(name))
    with picture.style():
        figure = Figure(figsize=(WIDTH, picture.height))
        picture.draw(figure)
        FigureCanvasAgg(figure).draw()
    for panel in figure.axes:
        box = panel.get_tightbbox()
        assert box.x0 >= 0
        assert box.x1 <= figure.bbox.x1


@pytest.mark.parametrize("kind", ["svg", "png"])
def test_names_in_any_script_are_drawn_without_a_word(kind: str) -> None:
    """The font of a PNG has no such letters; that is nothing to tell a person of, least of all about our lines."""
    picture = Picture("names", "", "", lambda figure: axes(figure).set_title("関節 1, Achse ö, 手"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drawn = getattr(picture.render(), kind)
    assert len(drawn) > 1000


def texts_on(panel, renderer):
    """Boxes of the numbers at the scales of a panel, those that are seen."""
    for axis, (low, high) in ((panel.xaxis, panel.get_xlim()), (panel.yaxis, panel.get_ylim())):
        ticks = [(tick, label) for tick, label in zip(axis.get_majorticklocs(), axis.get_ticklabels(), strict=True)]
        yield [label.get_window_extent(renderer) for tick, label in ticks if low <= tick <= high and label.get_text()]


@pytest.mark.parametrize(
    "values",
    [(5e3, 2e5), (0.0015, 0.0093), (-3.0, 4.0), (1e6, 3.4e6), (0.0, 1e-4)],
)
def test_numbers_of_a_scale_do_not_touch(values):
    """As they are drawn, whatever was reckoned with."""

    def draw(figure):
        axes(figure).plot(values, (0.0, 1.0))

    rendered = Picture("numbers", "", "", draw).render()
    renderer = FigureCanvasAgg(rendered.figure).get_renderer()
    rendered.figure.draw_without_rendering()
    across, _ = texts_on(rendered.figure.axes[0], renderer)
    assert len(across) >= 3
    for one, other in pairwise(across):
        assert one.x1 + 2 < other.x0


@pytest.mark.parametrize("values", [(-0.000351, 0.000472), (-0.000436, 0.00033), (0.045955445, 0.046027223)])
def test_three_numbers_that_touch_on_a_narrow_panel_become_two(values, monkeypatch):
    """matplotlib keeps three of these however few are asked for: the drawing went on for ever."""
    asked = 0
    original = Axes.locator_params

    def counted(*args, **options):
        nonlocal asked
        asked += 1
        assert asked < 20
        original(*args, **options)

    monkeypatch.setattr(Axes, "locator_params", counted)
    picture = Picture("narrow", "", "", lambda figure: figure.add_axes((0.1, 0.2, 0.39, 0.7)).set_xlim(values))
    rendered = picture.render()
    rendered.figure.draw_without_rendering()
    across, _ = texts_on(rendered.figure.axes[0], FigureCanvasAgg(rendered.figure).get_renderer())
    assert len(across) == 2
    assert across[0].x1 < across[1].x0


def test_quantiles_at_the_foot_of_the_tail_are_above_the_scale():
    """The 99.9 % quantile of 300 runs stands at the lowest share that is drawn."""
    (picture,) = DistributionSection(evaluate(samples=300)).pictures()
    rendered = picture.render()
    renderer = FigureCanvasAgg(rendered.figure).get_renderer()
    rendered.figure.draw_without_rendering()
    tail = rendered.figure.axes[1]
    across, _ = texts_on(tail, renderer)
    labels = [text for text in tail.texts if text.get_text().startswith("p99.9 ")]
    assert len(labels) == 1
    assert labels[0].get_window_extent(renderer).y0 > max(number.y1 for number in across)


def test_delays_that_differ_by_rounding_are_drawn_at_one_time():
    labels = tuple(Label(t, t + 1) for t in (10.0, 20.0, 30.0, 40.0))
    (picture,) = DetectionsPart(score([10.008, 20.008, 30.008], labels=labels, monitored=(0.0, 60.0))).pictures()
    rendered = picture.render()
    rendered.figure.draw_without_rendering()
    (panel,) = rendered.figure.axes
    low, high = panel.get_xlim()
    assert low == 0
    assert 8 < high < 20
    shown = [label.get_text() for label in panel.get_xticklabels()]
    assert "8" in shown
    assert panel.xaxis.get_offset_text().get_text() == ""
    step = panel.lines[0]
    share = [step.get_ydata()[np.searchsorted(step.get_xdata(), late, side="right") - 1] for late in (7.9, 8.1)]
    assert share == [0.0, 0.75]


def test_labels_are_spread():
    assert spread([], 1, 0, 10) == []
    assert spread([5.0, 1.0], 1, 0, 10) == [5.0, 1.0]
    assert spread([5.0, 5.0, 5.2], 1, 0, 10) == [5.0, 6.0, 7.0]
    assert spread([9.9, 9.8], 1, 0, 10) == [10.0, 9.0]
    assert spread([0.0, 3.0, 3.0], 9, 0, 10) == [0.0, 5.0, 10.0]  # no room: the gap shrinks


@pytest.mark.parametrize(
    ("group", "text"), [([0], "1"), ([0, 1], "1, 2"), ([0, 1, 2], "1-3"), ([0, 2, 3, 4], "1, 3-5"), ([1, 4], "2, 5")]
)
def test_joint_numbers(group, text):
    assert _numbers(group) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [(None, "unknown"), (Parameter(0.24125, None), "0.2412"), (Parameter(0.24125, 0.0131), "0.2412 ± 0.013")],
)
def test_parameters_have_their_standard_error_where_there_is_one(value, text):
    assert with_error(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (math.inf, "unbounded"),
        (math.nan, "none"),
        (0.0, "0"),
        (95.0295, "95.03"),
        (18490.3, "18490"),
        (1e-7, "0"),
        (2e-6, "2e-06"),
    ],
)
def test_numbers(value, text):
    assert number(value) == text


@pytest.mark.parametrize(
    ("value", "limits", "text"),
    [
        (160.03, (160.0,), "160.03"),
        (159.996, (320.0, 160.0), "159.996"),
        (160.03, (None, 0.0), "160"),
        (123456.7, (123500.0,), "123460"),
        (1234.9, (1235.0,), "1234.9"),
        (math.inf, (160.0,), "unbounded"),
    ],
)
def test_numbers_beside_limits_are_told_from_them(value, limits, text):
    assert number(value, *limits) == text


def test_a_quantile_is_told_from_the_limit_beside_it():
    """On the page and on the terminal: with four digits both would be the same."""
    result = evaluate()
    peak = result.peak_force.quantile(0.999)
    limit = float(f"{peak:.4g}")
    close = with_limits(result, replace(result.problem.limits, force_N=limit))
    told, word = number(peak, limit), "above" if peak > limit else "below"
    assert (float(told) > limit) == (peak > limit)
    assert float(told) != limit
    row = Outline("".join(VerdictSection(close).content())).text
    assert f"(p99.9) {told} N {limit:g} N {word} Peak" in row
    assert re.search(rf"peak force, N .* {told} +{limit:g} ", str(close))
    # A limit of more digits has all of them.
    close = with_limits(result, replace(result.problem.limits, force_N=limit + 0.0125))
    assert f" N {limit + 0.0125:.15g} N below Peak" in Outline("".join(VerdictSection(close).content())).text


@pytest.mark.parametrize(
    ("p", "text"),
    [
        (0.0, "0 %"),
        (1.0, "100 %"),
        (1 + 2e-16, "100 %"),
        (1e-20, "less than 0.0001 %"),
        (1 - 1e-9, "over 99.9999 %"),
        (0.99999, "99.999 %"),
        (0.999986, "99.9986 %"),
        (0.0001, "0.01 %"),
        (0.02987, "3 %"),
        (0.7244, "72.4 %"),
        (math.nan, "none"),
    ],
)
def test_probabilities(p, text):
    assert percent(p) == text


def test_markup_escapes_all_but_markup():
    assert element("p", "a < b", Html("<b>c</b>"), class_='"x"') == '<p class="&quot;x&quot;">a &lt; b<b>c</b></p>'
    assert "<thead>" not in table(("", ""), [("<a>", "b")], caption="c")
    assert "&lt;a&gt;" in table(("h", ""), [("<a>", "b")], caption="c")


def test_a_tiny_accepted_risk_is_told_apart_from_a_greater_one():
    reason = evaluate({"verdict.accepted_probability": 1e-14, "motion.velocity_mm_s": [0.0, 0.0, -53.0]}).verdict.reason
    assert "less than 0.0001 %" not in reason
    passed, accepted = (float(text) for text in re.findall(r"([0-9.e-]+) %", reason)[:2])
    assert passed > accepted == 1e-12


def test_the_body_s_stiffness_is_the_table_s_and_the_padding_the_scenario_s():
    """Springs of 75000 and 20000 N/m in series are one of 15789."""
    rows = " ".join(ProvenanceSection(evaluate({"contact.padding_N_m": 20000.0})).content())
    assert "75000 N/m, from the limit table" in rows
    assert "20000 N/m, as the scenario says; 15789 N/m in series with the body" in rows
    assert "padding" not in " ".join(ProvenanceSection(evaluate()).content())


def test_damper_and_gauge_of_the_scenario_have_rows():
    gauge = {"contact.gauge_spring_N_m": 60000.0}
    for changes, told in (
        ({"contact.damping_Ns_m": 200.0}, ["200 Ns/m beside the spring"]),
        (gauge, ["60000 N/m, as the scenario says; 33333 N/m in series with the body"]),
        (gauge | {"contact.gauge_mass_kg": 0.3}, ["60000 N/m, as the scenario says; 0.3 kg move on it"]),
    ):
        rows = " ".join(ProvenanceSection(evaluate({"contact.stiffness_N_m": 75000.0, **changes})).content())
        assert all(one in rows for one in told), changes


def test_a_damped_body_s_deformation_is_that_of_its_spring():
    damped = evaluate({"contact.damping_Ns_m": 200.0})
    for section in (FiguresSection, ForceOverTimeSection):
        assert "alone under" in " ".join(section(damped).content())
        assert "alone under" not in " ".join(section(evaluate()).content())


def test_a_slide_s_axes_are_in_metres_and_newtons():
    arm = bs.Robot.load("ur10e")
    mixed = replace(arm, joints=(replace(arm.joints[0], kind="prismatic"), *arm.joints[1:]))
    t, rows = np.arange(100) / 100, np.zeros((100, 6))
    log = Recording(t=t, q=rows, qd=rows, tau=rows)

    def labels(picture):
        return {label for panel in picture.render().figure.axes for label in (panel.get_xlabel(), panel.get_ylabel())}

    assert labels(recording_picture(log, arm)) >= {"q, rad", "qd, rad/s", "tau, Nm"}
    assert labels(recording_picture(log, mixed)) >= {"q, rad (m)", "qd, rad/s (m/s)", "tau, Nm (N)"}
    moved = np.random.default_rng(0).normal(size=(100, 2))
    compared = Comparison(
        names=("slide", "turn"), units=("N", "Nm"), t=t, qd=moved, qdd=moved, measured=moved, predicted=moved,
        rate_hz=100.0, filter_hz=10.0,
    )  # fmt: skip
    for part, (slide, turn) in (
        (OverTimePart, ({"N", "m/s2"}, {"Nm", "rad/s2"})),
        (WherePart, ({"speed [m/s]", "acceleration [m/s2]"}, {"speed [rad/s]", "acceleration [rad/s2]"})),
    ):
        first, second = (labels(picture) for picture in part(compared).pictures())
        assert slide <= first
        assert turn <= second
