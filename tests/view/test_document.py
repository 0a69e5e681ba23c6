"""What is on screen is always a scenario, and every change can be undone."""

from __future__ import annotations

import itertools
import re
import threading
import tomllib
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.model import Robot
from bumpstop.view.answer import Answer
from bumpstop.view.controls import NOT_GIVEN, Control, controls_of
from bumpstop.view.document import ViewDocument, scenario_text, taken_out, with_keys
from bumpstop.view.field_text import spec_of, text_of
from bumpstop.view.latest import LatestWins
from bumpstop.view.plots.distribution import distribution_plot, exceedance_plot
from bumpstop.view.plots.risk import body_parts_plot, risk_plot
from view.control_cases import needed, other_value

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
HAND = bs.load_scenario(EXAMPLES / "01_hand_downward.toml")
CONTROLS = controls_of(HAND, Robot.load("sia5d"))


@pytest.mark.parametrize("name", ["01_hand_downward", "05_ur10e", "06_pick_and_place_trajectory", "07_hand_uncertain"])
def test_text_is_the_scenario_on_screen(name: str, tmp_path: Path) -> None:
    scenario = bs.load_scenario(EXAMPLES / f"{name}.toml")
    file = tmp_path / "elsewhere.toml"
    file.write_text(scenario_text(scenario), encoding="utf-8")
    again = bs.load_scenario(file)
    assert again.with_values({}).as_given().keys() == scenario.as_given().keys()
    assert Answer.of(again).figures == Answer.of(scenario).figures


def test_files_that_a_scenario_names_are_found_from_everywhere() -> None:
    there = bs.load_scenario(EXAMPLES / "01_hand_downward.toml", {"arm.model": "elastic", "arm.file": "train.toml"})
    assert tomllib.loads(scenario_text(there))["arm"]["file"] == str(EXAMPLES / "train.toml")


def test_random_walks_can_be_undone() -> None:
    rng = np.random.default_rng(0)
    document = ViewDocument(HAND)
    seen = [document.scenario]
    for _ in range(60):
        choice = rng.integers(4)
        if choice == 0:
            document = document.undo()
        elif choice == 1:
            document = document.redo()
        else:
            speed = float(rng.integers(10, 200))
            document = document.edit({"motion.velocity_mm_s": [0, 0, -speed]}, same_step=bool(rng.integers(2)))
        assert tomllib.loads(document.text)["robot"] == "sia5d"
        seen.append(document.scenario)
    while document.future:
        document = document.redo()
    steps = [document.scenario]
    while document.past:
        document = document.undo()
        steps.append(document.scenario)
    assert document.scenario == HAND
    assert all(step in seen for step in steps)
    # Forward again through the same scenarios.
    for step in reversed(steps[:-1]):
        document = document.redo()
        assert document.scenario == step
    assert not document.future


def test_a_slider_that_moves_is_one_step() -> None:
    document = ViewDocument(HAND)
    for speed in range(60, 90):
        document = document.edit({"motion.velocity_mm_s": [0, 0, -speed]}, same_step=True)
    document = document.edit({"contact.area_cm2": 3.0}, same_step=True)
    assert len(document.past) == 2
    assert document.undo().undo().scenario == HAND
    assert document.undo().redo().scenario == document.scenario


def test_what_is_refused_changes_nothing() -> None:
    document = ViewDocument(HAND)
    with pytest.raises(bs.InputError) as refused:
        document.edit({"contact.area_cm2": -1.0})
    with pytest.raises(bs.InputError) as by_the_command:
        bs.load_scenario(EXAMPLES / "01_hand_downward.toml", {"contact.area_cm2": -1.0})
    assert str(refused.value) == str(by_the_command.value)
    assert document.scenario == HAND


@pytest.mark.parametrize("control", CONTROLS, ids=[control.key for control in CONTROLS])
def test_every_control_shows_and_sets_its_key(control: Control) -> None:
    """What is written is read back, other controls keep what they show, and the scenario of the text is the same."""
    assert control.write(HAND, control.read(HAND)) is not None
    other = other_value(control)
    changed = with_keys(HAND, needed(control) | control.write(HAND, other))
    assert control.read(changed) == pytest.approx(other) if isinstance(other, float | tuple) else other
    text = bs.Scenario.from_dict(tomllib.loads(scenario_text(changed)))
    assert text.to_dict() == changed.to_dict()
    if changed != HAND and not needed(control):
        before = {each.key: each.read(HAND) for each in CONTROLS}
        after = {each.key: each.read(changed) for each in controls_of(changed, Robot.load("sia5d"))}
        differ = {key for key in before if key in after and before[key] != pytest.approx(after[key])}
        may = {control.key, *control.write(HAND, other), "contact.pressure_area", "contact.arm", "contact.body_mass_kg"}
        assert differ <= may


@pytest.mark.parametrize(("typed", "said"), [("0", "0"), ("-5", "-5"), ("nan", "nan"), ("1e999", "inf"), ("", "")])
def test_a_speed_is_refused_as_a_speed(typed: str, said: str) -> None:
    control = next(each for each in CONTROLS if each.key == "motion.speed")
    words = f"the speed {said!r} cannot be used; wanted a number of mm/s above 0"
    with pytest.raises(bs.InputError, match=re.escape(words)):
        control.write(HAND, typed)


@pytest.mark.parametrize(
    ("typed", "of"),
    [
        ("contact.body_mass_kg", {"contact.kind": "free"}),
        ("contact.offset_mm", {"contact.offset_law": "fixed"}),
        ("reaction.stopping_time_s", {"reaction.deceleration": "constant_time"}),
        ("reaction.ramp_time_s", {"reaction.deceleration": "ramp"}),
    ],
)
def test_a_number_of_a_choice_makes_the_choice(typed: str, of: dict[str, str]) -> None:
    """Neither may stand alone: a person who types one after the other would be refused twice."""
    (control,) = (each for each in CONTROLS if each.key == typed)
    with pytest.raises(bs.InputError):
        bs.evaluate(with_keys(HAND, of))
    with pytest.raises(bs.InputError):
        bs.evaluate(with_keys(HAND, {typed: 0.2}))
    changes = control.write(HAND, "0.2")
    assert changes.items() >= of.items()
    assert bs.evaluate(with_keys(HAND, changes)).to_json()["verdict"]["conclusion"]


def test_the_tail_is_drawn_where_the_command_says_it_is() -> None:
    """The dot at the limit stands at the probability of the verdict, and on the line."""
    answer = Answer.of(with_keys(bs.load_scenario(EXAMPLES / "02_lower_arm_downward.toml"), {"contact.area_cm2": 2.2}))
    drawn = str(exceedance_plot(answer))
    x, y = (float(re.search(rf'<circle[^>]*{name}="([0-9.]+)"', drawn)[1]) for name in ("cx", "cy"))  # type: ignore[index]
    p = answer.result.verdict.p_over_pressure
    assert p is not None
    assert 1e-5 < p < 1e-2
    # From 1 at the top to 1e-6 at the bottom, 190 px high with 22 px and 34 px beyond the axes.
    assert y == pytest.approx(22 + 134 * np.log10(p) / -6, abs=0.1)
    points = re.search(r'<polyline points="([^"]+)"', drawn)
    assert points is not None
    assert f"{x:.1f},{y:.1f}" in points[1].split()


@pytest.mark.parametrize(
    ("text", "spec"),
    [
        ("5 %", {"distribution": "normal", "relative_sd": 0.05}),
        ("1.8 to 2.5", {"interval": [1.8, 2.5]}),
        ('{ distribution = "lognormal", sigma = 0.1 }', {"distribution": "lognormal", "sigma": 0.1}),
        ("{ relative = [0.9, 1.2], assumed = true }", {"relative": [0.9, 1.2], "assumed": True}),
    ],
)
def test_what_is_uncertain_is_written_in_a_line(text: str, spec: dict[str, object]) -> None:
    assert spec_of(text) == spec
    assert text_of(spec) == text


def test_what_is_uncertain_is_undone_and_refused_as_the_command_does() -> None:
    control = next(each for each in CONTROLS if each.key == "uncertainty.contact.area_cm2")
    document = ViewDocument(HAND).edit(control.write(HAND, "1.8 to 2.5"))
    assert document.scenario.uncertainty == {"contact.area_cm2": {"interval": [1.8, 2.5]}}
    assert Answer.of(document.scenario).word == "COMPUTING"
    assert "uncertainty" not in tomllib.loads(document.edit(control.write(document.scenario, "")).text)
    assert document.undo().scenario == HAND
    with pytest.raises(bs.InputError, match=r'uncertainty\."contact\.area_cm2"'):
        document.edit(control.write(document.scenario, "about two"))


def test_another_body_part_has_its_own_data() -> None:
    """What was given of the former part was taken for that of the new one: a chest as light and stiff as a finger."""
    table = {"contact.kind": "free", "contact.limits": "ts15066", "motion.velocity_mm_s": [0, 0, -250]}
    measured = {
        "contact.body_mass_kg": 0.1,
        "contact.stiffness_N_mm": 5.0,
        "uncertainty.contact.body_mass_kg": {"relative": [0.9, 1.2]},
        "uncertainty.contact.stiffness_N_mm": {"interval": [4.0, 6.0]},
        "uncertainty.contact.area_cm2": {"interval": [1.8, 2.5]},
    }
    finger = with_keys(HAND, table | measured)
    body = next(each for each in CONTROLS if each.key == "contact.body")
    changes = body.write(finger, "chest")
    document = ViewDocument(finger).edit(changes)
    chest = document.scenario
    assert chest.contact.stiffness_N_m is chest.contact.body_mass_kg is None
    # A factor says something of every part, and so does what is not of the body.
    kept = ("uncertainty.contact.body_mass_kg", "uncertainty.contact.area_cm2")
    assert chest.uncertainty.keys() == {key.removeprefix("uncertainty.") for key in kept}
    assert bs.evaluate(chest.without_uncertainty()).problem.stiffness == 25_000
    assert taken_out(finger, changes) == {key: measured[key] for key in measured if key not in kept}
    assert document.undo().scenario == finger
    # Without a name the body is what is given of it.
    assert with_keys(finger, body.write(finger, NOT_GIVEN)).contact.stiffness_N_m == 5_000


def test_an_emptied_stiffness_is_that_of_the_table() -> None:
    """Nothing happened where the file gives it in N/mm: the field went on showing it."""
    given = with_keys(HAND, {"contact.stiffness_N_mm": 20.0})
    (control,) = (each for each in CONTROLS if each.key == "contact.stiffness_N_m")
    assert control.read(given) == "20000"
    emptied = ViewDocument(given).edit(control.write(given, ""))
    assert control.read(emptied.scenario) == ""
    assert bs.evaluate(emptied.scenario).problem.stiffness == bs.evaluate(HAND).problem.stiffness != 20_000
    assert emptied.undo().scenario == given


def test_the_pad_of_a_gauge_is_no_body() -> None:
    """A body behind a gauge that stood for another one, or as soft as the pad, was judged by too little force."""
    gauge = with_keys(HAND, {"contact.stiffness_N_m": 10e3, "contact.gauge_spring_N_m": 75e3})
    body, kind = (next(each for each in CONTROLS if each.key == key) for key in ("contact.body", "contact.kind"))
    for changed in (body.write(gauge, "chest"), kind.write(gauge, "free") | {"contact.body_mass_kg": 2.0}):
        contact = ViewDocument(gauge).edit(changed).scenario.contact
        assert contact.stiffness_N_m is contact.gauge_spring_N_m is None


def test_another_law_of_slowing_down_needs_no_table(tmp_path: Path) -> None:
    columns = ",".join(f"distance_{j}_deg" for j in range(1, 8))
    rows = (f"{speed}" + f",{0.1 * speed}" * 7 for speed in (5, 90))
    (tmp_path / "stops.csv").write_text("\n".join([f"speed_deg_s,{columns}", *rows]), encoding="utf-8")
    table = {"deceleration": "table", "stopping_table": "stops.csv", "kind": "stop"}
    data = HAND.to_dict()
    data["reaction"] |= table
    given = bs.Scenario.from_dict(data, tmp_path)
    (control,) = (each for each in CONTROLS if each.key == "reaction.deceleration")
    changed = ViewDocument(given).edit(control.write(given, "constant")).scenario
    assert changed.reaction.stopping_table is None
    assert bs.evaluate(changed).verdict.reason


def test_a_mass_stays_where_the_table_has_none() -> None:
    """Free contact needs one."""
    free = with_keys(HAND, {"contact.kind": "free", "contact.body_mass_kg": 2.0})
    body = next(each for each in CONTROLS if each.key == "contact.body")
    assert with_keys(free, body.write(free, "chest")).contact.body_mass_kg == 2.0


def test_only_the_newest_request_is_answered() -> None:
    answered: list[int] = []
    begun, go_on = threading.Event(), threading.Event()

    def work(request: int) -> None:
        begun.set()
        go_on.wait(5)
        answered.append(request)

    worker = LatestWins(work, "test")
    worker.submit(0)
    assert begun.wait(5)
    for request in range(1, 50):
        worker.submit(request)
    assert worker.has_newer()
    go_on.set()
    for _ in range(200):
        if len(answered) == 2:
            break
        threading.Event().wait(0.01)
    assert answered == [0, 49]
    assert worker.dropped == 48
    worker.close(5)
    assert not worker.alive


def test_long_work_that_nobody_waits_for_is_given_up() -> None:
    """A body so soft that it is pressed for seconds, typed on the way to a stiff one."""
    soft = HAND.with_values({"contact.stiffness_N_m": 1.0, "contact.damping_Ns_m": 5.0, "contact.offset_sd_s": 1.0})
    begun = threading.Event()
    answered: list[str] = []

    def work(request: str) -> None:
        begun.set()
        if request == "soft":
            for _ in range(1000):
                bs.evaluate(soft)
        answered.append(request)

    worker = LatestWins(work, "test")
    worker.submit("soft")
    assert begun.wait(5)
    worker.submit("stiff")
    for _ in range(600):
        if answered:
            break
        threading.Event().wait(0.05)
    assert answered == ["stiff"]
    assert worker.dropped == 1
    worker.close(5)
    assert not worker.alive


def test_a_fault_loses_one_answer_and_no_other(capsys: pytest.CaptureFixture[str]) -> None:
    answered: list[int] = []

    def work(request: int) -> None:
        if request == 0:
            raise ZeroDivisionError("a fault")
        answered.append(request)

    worker = LatestWins(work, "test")
    for request in range(2):
        worker.submit(request)
        for _ in range(200):
            if worker.done > request:
                break
            threading.Event().wait(0.01)
    worker.close(5)
    assert answered == [1]
    assert "ZeroDivisionError: a fault" in capsys.readouterr().err


def test_waiting_for_a_newer_request_ends_with_it() -> None:
    found: list[bool] = []
    begun = threading.Event()

    def work(_: int) -> None:
        begun.set()
        found.append(worker.newer_within(5.0 if not found else 0.02))

    worker = LatestWins(work, "test")
    worker.submit(0)
    assert begun.wait(5)
    worker.submit(1)
    for _ in range(300):
        if len(found) == 2:
            break
        threading.Event().wait(0.01)
    worker.close(5)
    assert found == [True, False]


def bars_of(answer: Answer) -> dict[str, str]:
    """What stands behind the bar of each body part."""
    texts = re.findall(r"<text[^>]*>([^<]+)</text>", str(body_parts_plot(answer, lambda: False)))
    return {name: value for name, value in itertools.pairwise(texts) if value.endswith(("%", "ed"))}


def test_two_phases_are_not_judged_by_the_later_limit_alone() -> None:
    """A peak that is gone in time is acceptable beyond it, and stood there as 130 % of the limit."""
    keys = {"contact.limits": "ts15066", "contact.area_cm2": 4.0, "verdict.clamped_limit": "two_phase"}
    gone = Answer.of(with_keys(HAND, keys | {"motion.velocity_mm_s": [0, 0, -80]}))
    assert gone.word == "ACCEPTABLE"
    assert gone.marked_limits_N == [("limit later", 140.0), ("limit at first", 280.0)]
    assert 140.0 < gone.result.peak_force.quantile(0.99) < 280.0
    assert bars_of(gone)["Hand/Finger"] == "65.1 %"
    assert ">limit later 140 N<" in str(exceedance_plot(gone))
    drawn = str(distribution_plot(gone))
    assert ">limit later 140 N<" in drawn
    assert "limit at first 280 N" in drawn
    assert "url(#hatch)" not in drawn.partition("</defs>")[2]
    # An arm that stops goes on pressing.
    stays = Answer.of(with_keys(gone.scenario, {"reaction.kind": "stop"}))
    assert stays.word == "NOT ACCEPTABLE"
    share = stays.result.peak_force.quantile(0.99) / 140.0
    assert bars_of(stays)["Hand/Finger"] == f"{100 * share:.0f} %"


def test_every_body_part_has_its_own_mass_and_stiffness() -> None:
    """But for the one on screen: a light body pushes back a tenth of what a heavy one does."""
    free = with_keys(HAND, {"contact.kind": "free", "contact.limits": "ts15066", "motion.velocity_mm_s": [0, 0, -250]})
    light = Answer.of(with_keys(free, {"contact.body_mass_kg": 0.1, "contact.stiffness_N_mm": 5.0}))
    chest = Answer.of(with_keys(free, {"contact.body": "chest"}))
    bars = bars_of(light)
    for label, answer in (("Hand/Finger", light), ("Chest", chest)):
        share = answer.result.peak_force.quantile(0.99) / answer.peak_limit_N
        assert bars[label] == f"{100 * share:.0f} %"


def test_a_force_without_a_bound_is_called_so() -> None:
    """Contact with these parts is permitted: the detector does not feel how soft they are."""
    bars = bars_of(Answer.of(with_keys(HAND, {"detector.thresholds_Nm": [2000.0] * 7})))
    assert "unbounded" in bars.values()
    assert "not permitted" not in bars.values()


def test_the_risk_of_an_elastic_arm_is_drawn_finely_against_the_speed() -> None:
    """Its crests are narrow."""
    changes = {"arm.model": "elastic", "simulation.step_s": 0.002}
    answers = [Answer.of(HAND), Answer.of(with_keys(HAND, changes))]
    rigid, elastic = (str(risk_plot(answer, lambda: False)).count(",") for answer in answers)
    assert elastic > rigid + 50
