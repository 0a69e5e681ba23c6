"""The report: what it says is what the distribution says, it renders whatever the distribution is, and it renders the
same every time."""

import dataclasses
import math
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from io import BytesIO
from pathlib import Path

import matplotlib
import matplotlib.image
import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.probability_text import percent
from bumpstop.contact import LimitTable
from bumpstop.errors import InputError
from bumpstop.report import write_report
from bumpstop.report.collision.page import FIGURES, Page
from bumpstop.report.collision.rollout import Rollouts
from report.cases import Outline, evaluate, with_limits

_SECTIONS = [
    "Verdict",
    "The arm and its motion",
    "From touch to release",
    "Peak force and pressure",
    "Detection",
    "Limits over contact area",
    "All figures",
    "Where the figures come from",
    "Settings",
    "Assumptions and limits of this report",
]


@pytest.fixture(scope="module")
def law():
    return evaluate()


@pytest.fixture(scope="module")
def written(law, tmp_path_factory):
    folder = tmp_path_factory.mktemp("report") / "made" / "here"
    path = write_report(law, folder, details={"command": "bumpstop evaluate <file>"})
    return path, Outline(path.read_text(encoding="utf-8"))


def test_files(written):
    path, _ = written
    assert path.name == "report.html"
    names = {"report.html", *(f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg"))}
    assert {file.name for file in path.parent.iterdir()} == names


@pytest.mark.parametrize("name", FIGURES)
def test_figures_are_pictures(written, name):
    folder = written[0].parent
    data = (folder / f"{name}.png").read_bytes()
    assert data.startswith(b"\x89PNG\r\n\x1a\n")
    grey = matplotlib.image.imread(BytesIO(data))[..., :3].mean(axis=2)
    assert grey.shape[1] == 600
    assert (grey < 0.5).mean() > 0.005
    # Nothing is cut off: a margin of paper all around.
    border = np.concatenate([grey[:2].ravel(), grey[-2:].ravel(), grey[:, :2].ravel(), grey[:, -2:].ravel()])
    assert border.min() == 1
    root = ElementTree.fromstring((folder / f"{name}.svg").read_text(encoding="utf-8"))
    assert root.tag.endswith("svg")
    assert len(list(root.iter())) > 50


def test_page_has_every_section_in_order(written):
    _, page = written
    assert [text for tag, text in page.headings if tag == "h2"] == _SECTIONS
    assert [text for tag, text in page.headings if tag == "h1"] == [
        "Yaskawa Motoman SIA5D at 50 mm/s against Hand/Finger (bgia2011)"
    ]
    anchors = [address[1:] for address in page.addresses if address.startswith("#")]
    assert set(anchors) <= set(page.ids)


def test_verdict_stands_first_in_words(written, law):
    page = written[1]
    assert law.verdict.acceptable is True
    assert re.search(r"Verdict Acceptable " + re.escape(law.verdict.reason), page.text)


def test_page_fetches_nothing(written):
    raw = written[0].read_text(encoding="utf-8")
    assert all(address.startswith("#") for address in written[1].addresses)
    assert "://" not in raw
    assert "<script" not in raw
    assert "@import" not in raw
    assert set(re.findall(r"url\((.)", raw)) == {"#"}


def test_figures_have_words_for_those_who_do_not_see_them(written, law):
    labels = " ".join(written[1].labels)
    assert f"p99 {law.peak_force.quantile(0.99):.4g} N" in labels
    assert "joint 2 99.99" in labels
    assert "Two views of the arm" in labels


def test_every_figure_is_the_laws(written, law):
    page = written[1]
    rows = {
        "peak force [N]": (law.peak_force, 1),
        "peak pressure [N/cm²]": (law.pressure, 1),
        "deformation [mm]": (law.compression, 1),
        "force at detection [N]": (law.force_at_detection, 1),
        "detection delay [ms]": (law.detection_delay, 1e3),
        "contact duration [ms]": (law.contact_duration, 1e3),
    }
    for name, (quantity, factor) in rows.items():
        figures = " ".join(f"{factor * value:.4g}" for value in quantity.to_json().values())
        assert f"{name} {figures}" in page.text
    limits = law.problem.limits
    # The quantile of the accepted probability.
    assert f"(p99.9) {law.peak_force.quantile(0.999):.4g} N {limits.force_N:g} N below" in page.text
    assert f"(p99.9) {law.pressure.quantile(0.999):.4g} N/cm² {limits.pressure_N_cm2:g} N/cm² below" in page.text


def test_sources_settings_and_assumptions_are_stated(written, law):
    text = written[1].text
    limits, robot = law.problem.limits, law.problem.robot
    for said in (robot.source, robot.note, limits.force_source, limits.pressure_source, *law.notes):
        assert " ".join(said.split()) in text
    assert "status: single" in text
    assert LimitTable.load("bgia2011").note in text
    assert "detector.thresholds_Nm [20, 10, 20, 20, 20, 20, 20]" in text
    assert "simulation.step_s 0.001" in text  # a default
    assert f"bumpstop {bs.__version__}" in text
    assert "command bumpstop evaluate <file>" in text
    assert "not a certified safety function" in text
    assert "bought copy" in text


def test_same_law_same_bytes(written, tmp_path):
    with matplotlib.rc_context({"font.size": 31, "axes.grid": True, "svg.hashsalt": "other"}):
        mine = dict(matplotlib.rcParams)
        write_report(evaluate(), tmp_path, details={"command": "bumpstop evaluate <file>"})
        assert dict(matplotlib.rcParams) == mine  # the reader's own settings neither matter nor suffer
    for file in sorted(tmp_path.iterdir()):
        assert file.read_bytes() == (written[0].parent / file.name).read_bytes(), file.name


def test_hostile_text_is_only_text(law, tmp_path):
    nasty = "<script>alert('$x$')</script> & \"Hand\" </svg>"
    limits = dataclasses.replace(law.problem.limits, label=nasty, force_source=nasty)
    changed = with_limits(law, limits)
    robot = dataclasses.replace(law.problem.robot, title=nasty)
    changed = dataclasses.replace(changed, problem=dataclasses.replace(changed.problem, robot=robot))
    path = write_report(changed, tmp_path, details={nasty: nasty})
    raw = path.read_text(encoding="utf-8")
    assert "<script" not in raw
    page = Outline(raw)
    assert nasty in page.text
    assert any(nasty in label for label in page.labels)
    ElementTree.fromstring((tmp_path / "limits_over_area.svg").read_text(encoding="utf-8"))


def test_not_acceptable():
    law = evaluate({"contact.body": "lower_arm_wrist", "motion.velocity_mm_s": [0.0, 0.0, -75.0]})
    page = Outline(Page(law).html())
    assert law.verdict.acceptable is False
    assert f"Not acceptable {law.verdict.reason}" in page.text
    over = percent(law.verdict.p_over_pressure)
    assert f"Probability of exceeding the pressure limit {over} at most 0.1 % too high" in page.text
    assert "50 N/cm² above" in page.text


def test_what_the_verdict_rests_on_tells_figures_from_what_is_accepted():
    tiny = {"motion.velocity_mm_s": [0.0, 0.0, -40.0], "verdict.accepted_probability": 1e-13}
    text = Outline(Page(evaluate(tiny)).html()).text
    assert "Peak force that 99.99999999999 % of collisions stay below (p99.99999999999)" in text
    assert re.search(r"Probability of exceeding the force limit (less than 1e-10|[0-9.e-]+) % at most 1e-11 %", text)
    law = evaluate({"contact.body": "lower_arm_wrist", "motion.velocity_mm_s": [0.0, 0.0, -75.0]})
    p = law.verdict.p_over_pressure
    near = evaluate(
        {
            "contact.body": "lower_arm_wrist",
            "motion.velocity_mm_s": [0.0, 0.0, -75.0],
            "verdict.accepted_probability": p / 1.001,
        }
    )
    text = Outline(Page(near).html()).text
    told, accepted = re.search(r"exceeding the pressure limit ([0-9.]+) % at most ([0-9.]+) % too high", text).groups()
    assert float(told) > float(accepted)


def test_a_report_does_not_deny_its_model_of_the_arm():
    denied = "Compliance of the gears and the controller is not modelled; it may lower or raise the force"
    scenario = bs.load_scenario(Path(__file__).parents[2] / "examples" / "05_ur10e.toml")
    for model in ("rigid", "elastic"):
        found = bs.evaluate(scenario.with_values({"arm.model": model}), samples=1000)
        page = Outline(Page(found).html())
        assert (denied in page.text) == (model == "rigid")


def test_no_body_no_limits():
    law = evaluate({"contact.body": None, "contact.stiffness_N_m": 20000.0})
    page = Page(law)
    outline = Outline(page.html())
    assert "No limits to judge by" in outline.text
    assert [text for tag, text in outline.headings if tag == "h2"] == [s for s in _SECTIONS if "area" not in s]
    assert "against a spring of 20000 N/m" in outline.text
    assert "limits_over_area" not in [figure.picture.name for figure in page.figures]


def test_never_detected():
    law = evaluate({"detector.thresholds_Nm": [1e6] * 7, "motion.duration_s": 0.5})
    assert np.isnan(law.trigger_joint_probability).all()
    page = Page(law)
    text = Outline(page.html()).text
    assert "peak force [N] unbounded unbounded unbounded unbounded unbounded unbounded" in text
    assert "detection delay [ms] none none none none none none" in text
    assert "No collision is ever detected" in text
    # There is one way not to be detected, and nothing to say about which joint detects, or when.
    names = [figure.picture.name for figure in page.figures]
    assert names == ["arm", "force_over_time_median", "limits_over_area"]


def test_undetected_share_leaves_a_bounded_median():
    law = evaluate({"motion.duration_s": 0.12})
    assert math.isfinite(law.peak_force.quantile(0.5))
    assert law.peak_force.quantile(0.99) == math.inf
    page = Page(law)
    text = Outline(page.html()).text
    assert "(p99.9) unbounded 135 N above" in text
    assert "are not detected within 0.12 s (motion.duration_s) and count as beyond every force" in text
    assert f"In {percent(law.no_contact_probability)} of cases the arm does not press" in text
    assert "peak_force" in [figure.picture.name for figure in page.figures]


def test_stop_has_no_contact_time():
    law = evaluate({"reaction.kind": "stop"})
    assert law.contact_duration is None
    assert "contact duration [ms] not released" in Outline(Page(law).html()).text


def test_not_permitted(law):
    changed = with_limits(law, LimitTable.load("ts15066").contact_limits("face", "free"))
    page = Page(changed)
    text = Outline(page.html()).text
    assert f"Not acceptable {changed.problem.limits.reason}" in text
    assert "none permitted above" in text
    assert "limits_over_area" not in [figure.picture.name for figure in page.figures]


def test_no_pressure_limit(law):
    limits = dataclasses.replace(
        law.problem.limits, pressure_N_cm2=None, pressure_area=None, pressure_source=None, pressure_status=None
    )
    text = Outline(Page(with_limits(law, limits)).html()).text
    assert "The table has no pressure limit for Hand/Finger" in text
    assert "pressure limit none in this table" in text


@pytest.mark.parametrize(
    ("changes", "samples"),
    [
        pytest.param({"motion.velocity_mm_s": [0.0, 50.0, 0.0]}, None, id="lateral"),
        pytest.param({"contact.limits": "ts15066", "contact.peak_factor": 2.0, "contact.area_cm2": 1.0}, None, id="ts"),
        pytest.param(
            {
                "robot": "ur10e",
                "pose_deg": [20.0, -70.0, 110.0, -130.0, -90.0, 0.0],
                "motion.held_joints": [],
                "motion.velocity_mm_s": [60.0, 40.0, -100.0],
                "detector.thresholds_Nm": [30.0, 30.0, math.inf, 10.0, 10.0, 10.0],
                "detector.noise_sd_Nm": 2.0,
            },
            None,
            id="ur10e",
        ),
        pytest.param({"detector.thresholds_Nm": [9.0, 5.0, 9.0, 9.0, 9.0, 9.0, 9.0]}, None, id="false-alarms"),
        pytest.param({"contact.offset_law": "fixed", "contact.offset_mm": 8.0}, 50, id="sampled-fixed"),
        pytest.param({}, 1, id="one-sample"),
    ],
)
def test_other_laws_render(changes, samples):
    law = evaluate(changes, samples)
    page = Page(law)
    outline = Outline(page.html())
    assert law.verdict.reason in outline.text
    assert [text for tag, text in outline.headings if tag == "h2"] == _SECTIONS
    for figure in page.figures:
        ElementTree.fromstring(figure.svg)
    if samples is not None:
        assert f"sampled distribution: {samples} collisions, seed 0" in outline.text


@pytest.mark.parametrize("samples", [None, 60])
@pytest.mark.parametrize("changes", [{}, {"motion.contact_onset_s": 1.4, "reaction.kind": "reverse"}])
def test_trajectories_render(changes, samples):
    path = Path(__file__).parents[2] / "examples" / "06_pick_and_place_trajectory.toml"
    law = bs.evaluate(bs.load_scenario(path, changes), samples=samples)
    page = Page(law)
    outline = Outline(page.html())
    assert [text for tag, text in outline.headings if tag == "h2"] == _SECTIONS
    assert "SIA5D along a trajectory of 3 s against Lower arm/Wrist" in outline.text
    assert "hardest moment to be hit: contact that begins after" in outline.text
    assert "not detectable" in outline.text, "joint 7 does not, all others do at the moment that is shown"
    assert outline.text.count("not detectable") == 1
    for note in law.notes:
        assert " ".join(note.split()) in outline.text
    for figure in page.figures:
        ElementTree.fromstring(figure.svg)


def test_rollouts_of_a_trajectory_are_its_runs():
    path = Path(__file__).parents[2] / "examples" / "06_pick_and_place_trajectory.toml"
    law = bs.evaluate(bs.load_scenario(path, {"reaction.kind": "reverse"}), samples=200)
    rollouts = Rollouts(law)
    for run in range(40):
        rollout = rollouts.rollout(run)
        assert rollout.peak_force == pytest.approx(law.runs["peak_force"][run], rel=1e-3, abs=1e-6)
        if law.runs["tick"][run] >= 0:
            assert rollout.touch == 0
            assert rollout.detection + law.runs["onset"][run] == pytest.approx(
                0.004 * law.runs["tick"][run] + 0.001, abs=2e-4
            )


def test_a_folder_used_again_keeps_no_figure_of_another_law(tmp_path):
    (tmp_path / "peak_force.png").write_bytes(b"of another distribution")
    (tmp_path / "notes.txt").write_text("mine")
    write_report(evaluate({"detector.thresholds_Nm": [1e6] * 7, "motion.duration_s": 0.5}), tmp_path)
    assert not (tmp_path / "peak_force.png").exists()
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_unwritable_folder(law, tmp_path):
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(InputError, match="cannot be written") as error:
        write_report(law, tmp_path / "taken" / "below")
    assert error.value.field == "--out"


def test_import_bumpstop_leaves_matplotlib_alone():
    code = "import sys, bumpstop, bumpstop.collision; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
