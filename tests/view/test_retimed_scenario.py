"""Safe speeds applied to a trajectory: the document holds the slowed one, and undo brings back the other."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

import bumpstop as bs
from bumpstop.view.answer import Answer
from bumpstop.view.document import ViewDocument
from bumpstop.view.retimed_scenario import retimed_scenario
from view.cases import LOWER_ARM, ROOT

PICK_AND_PLACE = bs.load_scenario(ROOT / "examples" / "06_pick_and_place_trajectory.toml")


def test_safe_speeds_make_a_trajectory_acceptable(tmp_path: Path) -> None:
    document = ViewDocument(PICK_AND_PLACE)
    found = retimed_scenario(document.scenario, tmp_path)
    assert found is not None
    slowed = document.edit(found.changes)
    assert (Answer.of(document.scenario).word, Answer.of(slowed.scenario).word) == ("NOT ACCEPTABLE", "ACCEPTABLE")
    assert found.acceptable
    # The times are those of the two files.
    problems = [bs.CollisionProblem.from_scenario(each.scenario) for each in (document, slowed)]
    times = [problem.trajectory.time for problem in problems if problem.trajectory is not None]
    assert [float(t[-1] - t[0]) for t in times] == pytest.approx([found.before_s, found.after_s], rel=1e-12)
    assert 1.05 * found.before_s < found.after_s < 2 * found.before_s
    assert slowed.undo().scenario == PICK_AND_PLACE
    assert tomllib.loads(slowed.text)["motion"]["file"] == str(found.file)


def test_a_moment_of_contact_stays_at_its_place_of_the_path(tmp_path: Path) -> None:
    scenario = PICK_AND_PLACE.with_values({"motion.contact_onset_s": 1.2})
    found = retimed_scenario(scenario, tmp_path)
    assert found is not None
    before = bs.CollisionProblem.from_scenario(scenario).trajectory
    after = bs.CollisionProblem.from_scenario(scenario.with_values(found.changes)).trajectory
    assert before is not None
    assert after is not None
    onset = found.changes["motion.contact_onset_s"]
    assert onset > 1.2
    # Rows are 20 ms apart, and joints turn at up to 1 rad/s.
    assert after.at(onset) == pytest.approx(before.at(1.2), abs=2e-3)
    # A second time it is a file of its own: the first is that of an earlier scenario.
    again = retimed_scenario(scenario, tmp_path)
    assert again is not None
    assert again.file != found.file


def test_a_line_has_no_safe_speeds_to_apply(tmp_path: Path) -> None:
    with pytest.raises(bs.InputError, match="no waypoints"):
        retimed_scenario(bs.load_scenario(LOWER_ARM), tmp_path)
