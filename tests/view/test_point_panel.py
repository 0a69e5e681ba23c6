"""Points of a workspace: they are what the page would compute there, of the scenario that they say they are of."""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bumpstop.model import Robot
from bumpstop.study import WorkspaceStudy
from bumpstop.view.answer import Answer
from bumpstop.view.document import with_keys
from bumpstop.view.page import point_panel
from bumpstop.view.page.point_panel import PointPanel
from bumpstop.view.page.pose_keys import pose_values
from bumpstop.view.point_rows import PointRows
from view.cases import HAND
from view.panels import Host

ARM = Robot.load("sia5d")


def said(panel: PointPanel) -> str:
    return re.sub("<[^>]+>", "", panel._says.content)


def click(panel: PointPanel, rows: PointRows, row: int) -> None:
    ray = SimpleNamespace(ray_origin=rows.place[row] - [0, 0, 1e-3], ray_direction=[0, 0, 1.0])
    panel._clicked(ray)


def test_points_computed_on_a_page_are_what_it_says_there(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where a joint meets its limit, the motion ends for both."""
    monkeypatch.setattr(point_panel, "_POSES", 250)
    host: Any = Host(HAND)
    panel = PointPanel(host)
    panel._work(threading.Event())
    rows = panel._rows
    assert rows is not None
    assert "250 points" in said(panel)
    # Some of the lowest end at a limit.
    for row in np.argsort(rows.value)[[0, 1, 2, 125]]:
        scenario = with_keys(HAND, {"pose_deg": None, "pose_rad": rows.q[row].tolist()})
        scenario = with_keys(scenario, {"motion.velocity_mm_s": (1e3 * rows.velocity[row]).tolist()})
        assert Answer.of(scenario).result.peak_force.quantile(0.99) == pytest.approx(rows.value[row], rel=1e-6)


def points(limit_mm_s: float | None = None) -> PointRows:
    """Two rows: of velocities of their own, or with a limit in a direction each."""
    q = np.radians([HAND.pose_deg, [10, 30, 0, -20, 0, -40, 0]])
    place, aside = ARM.pose(q)[:, :3, 3], np.array([[0, 0, -1.0], [0.6, 0, -0.8]])
    value = np.array([50.0, 60.0] if limit_mm_s is None else [100.0, limit_mm_s])
    speed = np.array([0.05, 0.05]) if limit_mm_s is None else np.where(value > 0, value / 1e3, np.nan)
    direction = aside if limit_mm_s is not None else np.full((2, 3), np.nan)
    return PointRows(place, q, aside * speed[:, None], direction, value, "a value", np.arange(2))


def test_a_point_without_a_safe_speed_is_shown_in_its_own_direction() -> None:
    """The motion on screen before had nothing to do with it, and its verdict may be a good one."""
    host: Any = Host(HAND, points(limit_mm_s=0.0))
    panel = PointPanel(host)
    click(panel, host.opened.points, 0)
    assert host.document.scenario.motion.velocity_mm_s == pytest.approx([0, 0, -100])
    assert said(panel) == "row 1: a value 100"
    click(panel, host.opened.points, 1)
    assert host.document.scenario.motion.velocity_mm_s == pytest.approx([60, 0, -80])
    assert said(panel) == "row 2: a value 0, no speed is safe; on screen it is 100 mm/s"


@pytest.fixture
def shards(monkeypatch: pytest.MonkeyPatch) -> Iterator[threading.Semaphore]:
    """Has every part of a workspace wait until a test lets it go on."""
    go_on, of = threading.Semaphore(0), WorkspaceStudy.shard_columns

    def slow(study: WorkspaceStudy, _: int) -> Any:
        assert go_on.acquire(timeout=20)
        return of(study, 0)

    monkeypatch.setattr(point_panel, "_POSES", 60)
    monkeypatch.setattr(WorkspaceStudy, "shards", 3)
    monkeypatch.setattr(WorkspaceStudy, "shard_columns", slow)
    yield go_on
    go_on.release(20)


def until(panel: PointPanel, words: str) -> None:
    end = time.monotonic() + 20
    while words not in said(panel) and time.monotonic() < end:
        time.sleep(0.01)
    assert words in said(panel)


def ended(panel: PointPanel) -> None:
    assert panel._thread is not None
    panel._thread.join(20)
    assert not panel.alive


def test_what_is_computed_is_cancelled_by_its_button_alone(shards: threading.Semaphore) -> None:
    """ "Compute" cancelled what it had begun, and what was cancelled lost the words beside its points."""
    host: Any = Host(HAND)
    panel = PointPanel(host)
    panel._press("Compute")
    shards.release()
    until(panel, "; computing: 33 %")
    assert "points: p99 of the peak force" in said(panel)
    panel._press("Compute")
    shards.release()
    until(panel, "; computing: 0 %")
    shards.release(3)
    ended(panel)
    assert "computing" not in said(panel)
    assert "cancelled" not in said(panel)
    panel._press("Compute")
    panel._press("Cancel")
    shards.release()
    ended(panel)
    assert re.search(r"^\d+ points: p99 .*; click one to go there; cancelled at 0 %$", said(panel))
    assert host.drawn


def test_what_is_hidden_stays_hidden(shards: threading.Semaphore) -> None:
    """The part that was being computed drew all points again."""
    host: Any = Host(HAND)
    panel = PointPanel(host)
    panel._press("Compute")
    shards.release()
    until(panel, "; computing: 33 %")
    panel._press("Hide")
    assert (host.drawn, said(panel)) == ([], "")
    shards.release(3)
    ended(panel)
    assert (host.drawn, said(panel)) == ([], "")


def test_a_point_says_in_what_it_was_computed_otherwise() -> None:
    host: Any = Host(HAND, replace(points(), otherwise="computed with joint limits ignored"))
    panel = PointPanel(host)
    click(panel, host.opened.points, 1)
    assert said(panel) == "row 2: a value 60, computed with joint limits ignored"


def test_a_point_is_gone_to_with_all_its_digits() -> None:
    """A pose within 0.01 degrees had a p99 above the limit where the row had one below. A hand is there by eye."""
    rows = points()
    rows.q[1] += 1 / 3000
    host: Any = Host(HAND, rows)
    click(PointPanel(host), rows, 1)
    assert host.document.scenario.pose_deg == pytest.approx(np.degrees(rows.q[1]), rel=1e-11, abs=1e-12)
    key, values = pose_values(host.opened, HAND, rows.q[1], dragged=True)
    assert (key, values[:2]) == ("pose_deg", [10.02, 30.02])


def test_points_of_an_earlier_scenario_are_called_so() -> None:
    host: Any = Host(HAND, points())
    panel = PointPanel(host)
    assert "earlier" not in said(panel)
    click(panel, host.opened.points, 1)
    panel.follow(host.document.scenario)
    assert said(panel) == "row 2: a value 60"
    host.change({"contact.area_cm2": 3.0})
    panel.follow(host.document.scenario)
    assert said(panel) == "row 2: a value 60; these points are of an earlier scenario"
    host.document = host.document.undo()
    panel.follow(host.document.scenario)
    assert said(panel) == "row 2: a value 60"
    # Points that were computed here are of the velocity on screen, and not of any.
    panel._rows = points()
    panel._tell("2 points")
    assert said(panel) == "2 points"
    host.change({"motion.velocity_mm_s": [0, 0, -300]})
    panel.follow(host.document.scenario)
    assert "earlier" in said(panel)
