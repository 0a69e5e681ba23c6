"""What a person clicks in the picture and on buttons, in a real browser."""

from __future__ import annotations

import time
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import bumpstop as bs
from browsers import CHROMIUM
from bumpstop.study import WorkspaceStudy
from bumpstop.view.answer import Answer
from bumpstop.view.document import scenario_text
from bumpstop.view.opened import open_source
from bumpstop.view.page.front import MAX_MOVING_POINTS
from bumpstop.view.page.server import ViewServer
from view.cases import LOWER_ARM, ROOT
from view.screen import WAIT_MS, Screen

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: apt-get install chromium")


def test_clicks_on_the_arm_and_on_the_person(browser: Any) -> None:
    server = ViewServer(open_source(str(LOWER_ARM)))
    screen = Screen(browser, server, (1280, 800))
    screen.wait_for_the_picture()
    try:
        scene = next(iter(server.pages.values())).scene
        problem = bs.CollisionProblem.from_scenario(bs.load_scenario(LOWER_ARM))
        elbow, wrist = (problem.robot.pose(problem.q, problem.robot.joints[j].link)[:3, 3] for j in (3, 5))
        middle = (elbow + wrist) / 2
        before = screen.number("peak_force_N.p99")
        screen.press_at(server, middle)
        screen.until("point_m")
        contact = tomllib.loads(screen.scenario())["contact"]
        assert contact["link"] in [joint.link for joint in problem.robot.joints[3:5]]
        # The point that was clicked is on the arm's surface, near the ray through the middle of the lower arm.
        place = problem.robot.pose(problem.q, contact["link"], contact["point_m"])[:3, 3]
        assert np.linalg.norm(place - middle) < 0.15
        screen.page.wait_for_function(
            f"Number(document.querySelector(\"[data-figure='peak_force_N.p99']\").dataset.value) !== {before!r}"
        )
        page = next(iter(server.pages.values()))
        page.change({"contact.stiffness_N_m": 50_000.0}, "contact.stiffness_N_m")
        screen.until("stiffness_N_m")
        given = screen.scenario()
        screen.press_at(server, scene.place_of("chest"))
        screen.until('body = "chest"')
        # Its own stiffness counts, and the page says which it was.
        assert "stiffness_N_m" not in screen.scenario()
        assert "contact.stiffness_N_m = 50000.0" in screen.page.text_content("[data-notice]")
        assert screen.page.locator("[data-notice]").is_visible()
        screen.page.get_by_role("button", name="Undo").click()
        screen.until_same_as(given)
        screen.until_so_many("[data-notice]", 0)
        # What has no control is refused there.
        page.change({"detector.gravity": 1.0}, "detector.gravity")
        screen.page.wait_for_selector("[data-notice]", timeout=WAIT_MS)
        assert screen.page.text_content("[data-notice]").startswith("✖ detector.gravity: ")
        assert not screen.faults
    finally:
        screen.page.close()
        server.stop()


def test_a_click_on_a_point_of_a_study(browser: Any, tmp_path: Path) -> None:
    scenario = bs.load_scenario(LOWER_ARM)
    rows = WorkspaceStudy(scenario=scenario, poses=60).shard(0)
    rows.write_parquet(tmp_path / "rows.parquet")
    (tmp_path / "settings.toml").write_text(scenario_text(scenario), encoding="utf-8")
    opened = open_source(str(tmp_path))
    assert opened.points is not None
    server = ViewServer(opened)
    screen = Screen(browser, server, (1280, 800))
    screen.wait_for_the_picture()
    try:
        # The highest point: nothing stands before it.
        row = int(opened.points.place[:, 2].argmax())
        screen.press_at(server, opened.points.place[row])
        screen.page.wait_for_selector("[data-point]", timeout=WAIT_MS)
        chosen = int(screen.page.get_attribute("[data-point]", "data-point"))
        assert np.linalg.norm(opened.points.place[chosen] - opened.points.place[row]) < 0.1
        pose = np.degrees(opened.points.q[chosen])
        screen.until(f"{round(float(pose[0]), 2):g}")
        assert tomllib.loads(screen.scenario())["pose_deg"] == pytest.approx(pose, abs=0.01)
        assert not screen.faults
    finally:
        screen.page.close()
        server.stop()


def test_what_a_page_saves(browser: Any, tmp_path: Path) -> None:
    server = ViewServer(open_source(str(LOWER_ARM)))
    screen = Screen(browser, server, (1280, 800))
    screen.wait_for_the_picture()
    try:
        saved = {}
        for name in ("Scenario", "Picture", "Report"):
            with screen.page.expect_download(timeout=WAIT_MS) as download:
                screen.page.get_by_role("button", name=name, exact=True).click()
            download.value.save_as(tmp_path / download.value.suggested_filename)
            saved[name] = tmp_path / download.value.suggested_filename
        assert saved["Scenario"].read_text(encoding="utf-8") == screen.scenario()
        assert saved["Picture"].read_bytes().startswith(b"\x89PNG")
        assert bs.load_scenario(saved["Scenario"]).to_dict() == bs.load_scenario(LOWER_ARM).to_dict()
        assert "lower_arm_wrist" in saved["Report"].read_text(encoding="utf-8")
        screen.page.context.grant_permissions(["clipboard-read", "clipboard-write"], origin=server.url)
        screen.page.get_by_role("button", name="Copy as TOML").click()
        assert screen.page.evaluate("navigator.clipboard.readText()") == screen.scenario()
        assert not screen.faults
    finally:
        screen.page.close()
        server.stop()


def test_a_report_right_after_a_key_is_of_what_was_typed(browser: Any, tmp_path: Path, monkeypatch: Any) -> None:
    of = Answer.of

    def slow(scenario: bs.Scenario) -> Answer:
        time.sleep(3.0)
        return of(scenario)

    server = ViewServer(open_source(str(LOWER_ARM)))
    screen = Screen(browser, server, (1280, 800))
    screen.wait_for_the_picture()
    monkeypatch.setattr(Answer, "of", slow)
    try:
        field = screen.field("area, cm²")
        with screen.page.expect_download(timeout=WAIT_MS) as download:
            field.fill("3.5")
            field.press("Enter")
            screen.page.get_by_role("button", name="Report", exact=True).click()
        download.value.save_as(tmp_path / "report.html")
        assert "On 3.5 cm² the force limit" in (tmp_path / "report.html").read_text(encoding="utf-8")
        assert not screen.faults
    finally:
        screen.page.close()
        server.stop()


def test_safe_speeds_and_what_was_kept(browser: Any) -> None:
    """A trajectory slowed down at a click, beside the one before, and back."""
    opened = open_source(str(ROOT / "examples" / "06_pick_and_place_trajectory.toml"))
    server = ViewServer(opened)
    screen = Screen(browser, server, (1280, 800))
    screen.wait_for_the_picture()
    try:
        screen.page.get_by_role("button", name="Keep this").click()
        screen.page.wait_for_selector("[data-before]", timeout=WAIT_MS)
        screen.page.get_by_role("button", name="Apply safe speeds").click()
        screen.page.wait_for_selector("[data-verdict='acceptable']", timeout=WAIT_MS)
        before, after = map(float, str(screen.page.get_attribute("[data-times]", "data-times")).split())
        assert before == 3.0
        assert 3.1 < after < 4.5
        assert screen.page.text_content("[data-before]").startswith("Kept for comparison: NOT ACCEPTABLE")
        # Two curves in one chart: what is on screen, and dashed what was kept.
        screen.until_so_many("[data-chart='distribution'] polyline", 2)
        screen.until(str(opened.folder))
        motion = tomllib.loads(screen.scenario())["motion"]
        slowed = bs.CollisionProblem.from_scenario(opened.scenario.with_values({"motion.file": motion["file"]}))
        assert slowed.trajectory is not None
        assert float(slowed.trajectory.time[-1]) == after
        screen.page.get_by_role("button", name="Undo").click()
        screen.page.wait_for_selector("[data-verdict='not_acceptable']", timeout=WAIT_MS)
        assert not screen.faults
    finally:
        screen.page.close()
        server.stop()


# How many points each picture has, the latest last.
_COUNT_POINTS = """window.drawn = [];
const draw = WebGL2RenderingContext.prototype.drawArrays;
WebGL2RenderingContext.prototype.drawArrays = function (mode, first, count) {
  if (mode === this.POINTS) window.drawn.push(count);
  return draw.call(this, mode, first, count);
};"""


def test_a_picture_of_many_points_turns_with_some_of_them(browser: Any, tmp_path: Path) -> None:
    scenario = bs.load_scenario(LOWER_ARM)
    rows = WorkspaceStudy(scenario=scenario, poses=60).shard(0)
    many = pl.concat([rows] * 200)
    many.write_parquet(tmp_path / "rows.parquet")
    (tmp_path / "settings.toml").write_text(scenario_text(scenario), encoding="utf-8")
    server = ViewServer(open_source(str(tmp_path)))
    screen = Screen(browser, server, (1280, 800), before=_COUNT_POINTS)
    screen.wait_for_the_picture()
    page = screen.page
    try:
        page.wait_for_function(f"window.drawn.at(-1) === {many.height}", timeout=WAIT_MS)
        page.evaluate("window.drawn.length = 0")
        page.mouse.move(600, 700)
        page.mouse.down()
        for step in range(20):
            page.mouse.move(600 + 5 * step, 700)
            page.wait_for_timeout(30)
        page.mouse.up()
        turning = page.evaluate("window.drawn")
        assert turning.count(MAX_MOVING_POINTS) > turning.count(many.height)
        page.wait_for_function(f"window.drawn.at(-1) === {many.height}", timeout=WAIT_MS)
        assert not screen.faults
    finally:
        page.close()
        server.stop()
