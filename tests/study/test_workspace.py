"""The workspace study: every row is its own distribution, what is drawn follows its distribution, and nothing is
hidden."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import bumpstop as bs
from bumpstop import _native
from bumpstop.detection import undetectable_force_along
from bumpstop.report.studies.workspace import pages_of
from bumpstop.study import run
from bumpstop.study.capsules import self_collision
from bumpstop.study.directions import draw_directions, spread_directions
from bumpstop.study.workspace import predictors as predicting
from bumpstop.study.workspace import workspace as workspace_module
from bumpstop.study.workspace.workspace import WorkspaceStudy
from bumpstop.study.workspace.workspace_summary import summary_lines
from collision.cases import control_group, ur10e

SLOW = control_group(motion__velocity_mm_s=[0.0, 0.0, -10.0])
TRAJECTORY = Path(__file__).resolve().parents[2] / "examples/06_pick_and_place_trajectory.toml"
OWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def study() -> WorkspaceStudy:
    return WorkspaceStudy(SLOW, poses=60, speed_sd_mm_s=2.0, seed=5)


@pytest.fixture(scope="module")
def rows(study: WorkspaceStudy) -> pl.DataFrame:
    return run(study).rows


def test_every_row_is_the_law_of_its_pose(rows: pl.DataFrame) -> None:
    # Joint limits end some motions, and nothing may be left out for it.
    chosen = rows[:6] if rows.height >= 6 else rows
    for row in chosen.iter_rows(named=True):
        scenario = SLOW.with_values(
            {
                "pose_rad": [row[f"q_{j}"] for j in range(1, 8)],
                "motion.velocity_mm_s": [1e3 * row[f"velocity_{axis}_m_s"] for axis in "xyz"],
            }
        )
        result = bs.evaluate(scenario)
        assert result.curve.end == row["end"]
        assert row["p50_N"] == pytest.approx(result.peak_force.quantile(0.5), rel=1e-6)
        assert row["p_over_force"] == pytest.approx(result.verdict.p_over_force, rel=1e-5, abs=1e-9)
        assert row["p_over_pressure"] == pytest.approx(result.verdict.p_over_pressure, rel=1e-5, abs=1e-9)
        assert row["undetected"] == pytest.approx(result.undetected_probability, rel=1e-5, abs=1e-12)
        jacobian = bs.Robot.load("sia5d").jacobian([row[f"q_{j}"] for j in range(1, 8)])[:3, :6]
        assert row["smallest_singular_value"] == pytest.approx(math.sqrt(np.linalg.eigvalsh(jacobian @ jacobian.T)[0]))
        whole = bs.Robot.load("sia5d").jacobian([row[f"q_{j}"] for j in range(1, 8)])[:, :6]
        assert row["condition_number_six_rows"] == pytest.approx(np.linalg.cond(whole), rel=1e-9)


def test_threads_and_shards_change_nothing(
    study: WorkspaceStudy, rows: pl.DataFrame, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert study.shards == 1
    assert run(study, threads=3).rows.equals(rows)
    monkeypatch.setattr(workspace_module, "SHARD_ROWS", 20)
    small = WorkspaceStudy(SLOW, poses=60, seed=5)
    assert small.shards == 3
    assert run(small, threads=2).rows.equals(run(small).rows)
    assert run(small).rows["q_1"].n_unique() == 60, "every shard draws poses of its own"
    together = small.shard_batch([2, 0, 1])
    for number, shard in zip((2, 0, 1), together, strict=True):
        assert shard.equals(small.shard(number), null_equal=True), number
    # The first poses of a longer study are those of a shorter one.
    assert run(WorkspaceStudy(SLOW, poses=20, seed=5)).rows["q_1"].equals(run(small).rows["q_1"][:20])
    assert not run(WorkspaceStudy(SLOW, poses=20, seed=6)).rows["q_1"].equals(run(small).rows["q_1"][:20])


def test_held_joints_stay_and_the_others_fill_their_ranges() -> None:
    study = WorkspaceStudy(SLOW, poses=250, seed=1)
    q, redrawn = study._drawn(20_000, np.random.default_rng(1))
    robot = bs.Robot.load("sia5d")
    assert (q[:, 6] == 0).all()
    assert not redrawn.any()
    share = (q[:, :6] - robot.lower[:6]) / (robot.upper - robot.lower)[:6]
    assert ((share >= 0) & (share <= 1)).all()
    # Standard error of the mean of 20 000 even draws: 0.29 / 141 = 0.002; five of them.
    assert share.mean(axis=0) == pytest.approx(np.full(6, 0.5), abs=0.0102)


@pytest.mark.parametrize("spread", [False, True])
def test_directions_are_even_over_the_sphere_or_over_the_polar_angle(spread: bool) -> None:
    rng = np.random.default_rng(3)
    n = 40_000
    for result, low_cap in (("sphere", 0.5 * (1 - math.cos(0.5))), ("polar", 0.5 / math.pi)):
        vectors = spread_directions(result, OWN, n) if spread else draw_directions(result, OWN, n, rng)  # type: ignore[arg-type]
        assert np.linalg.norm(vectors, axis=1) == pytest.approx(np.ones(n))
        share = float((vectors[:, 2] > math.cos(0.5)).mean())
        assert share == pytest.approx(low_cap, abs=5 * math.sqrt(low_cap / n))
        assert vectors.mean(axis=0) == pytest.approx(np.zeros(3), abs=5 / math.sqrt(3 * n) + 1e-3)


@pytest.mark.parametrize("options", [{"poses": 12}, {"grid": 1, "grid_directions": 3}])
def test_directions_may_all_be_that_of_the_scenario(options: dict[str, int]) -> None:
    case = SLOW.with_values({"motion.velocity_mm_s": [6.0, 0.0, -8.0]})
    rows = run(WorkspaceStudy(case, directions="scenario", **options)).rows
    velocity = rows.select("velocity_x_m_s", "velocity_y_m_s", "velocity_z_m_s").to_numpy()
    assert len(velocity) >= 3
    np.testing.assert_allclose(velocity, np.tile([0.006, 0.0, -0.008], (len(velocity), 1)), atol=1e-15)


def test_speeds_have_the_spread_asked_for_and_are_never_backward() -> None:
    speeds = WorkspaceStudy(SLOW, poses=1, speed_sd_mm_s=9.0)._speeds(20_000, np.random.default_rng(0))
    assert (speeds > 0).all()
    narrow = WorkspaceStudy(SLOW, poses=1, speed_sd_mm_s=2.0)._speeds(20_000, np.random.default_rng(0))
    assert narrow.mean() == pytest.approx(10.0, abs=5 * 2 / math.sqrt(20_000))
    assert narrow.std() == pytest.approx(2.0, rel=0.03)


def test_a_grid_has_every_combination_once() -> None:
    scenario = ur10e(motion__held_joints=[4, 5, 6], motion__task="position")
    study = WorkspaceStudy(scenario, grid=3, grid_directions=2)
    rows, summary = run(study)
    assert rows.height == 27 * 2 == study.drawn
    for j in (1, 2, 3):
        low, high = bs.Robot.load("ur10e").lower[j - 1], bs.Robot.load("ur10e").upper[j - 1]
        values = sorted(set(rows[f"q_{j}"].to_list()))
        assert values == pytest.approx([low + (high - low) * share for share in (1 / 6, 1 / 2, 5 / 6)])
    assert rows.select("q_1", "q_2", "q_3", "velocity_z_m_s").unique().height == 54
    assert summary["laws"] + summary["singular_starts"] == 54


def test_singular_starts_are_reported_and_have_no_law() -> None:
    # The middle of all ranges is an outstretched arm.
    rows, summary = run(WorkspaceStudy(SLOW, grid=1, grid_directions=3))
    assert summary["singular_starts"] == 3
    assert summary["laws"] == 0
    assert rows["end"].to_list() == ["singular_start"] * 3
    assert rows["mean_N"].is_nan().all()


def test_without_joint_limits_none_ends_a_motion() -> None:
    settings: dict[str, Any] = {"poses": 60, "seed": 5}
    respected = run(WorkspaceStudy(SLOW, **settings)).summary
    ignored = run(WorkspaceStudy(SLOW, joint_limits="ignore", **settings)).summary
    assert respected["ends"]["joint_limit"] > 0
    assert ignored["ends"]["joint_limit"] == 0
    assert ignored["no_contact"]["mean"] < respected["no_contact"]["mean"]


def test_without_velocity_limits_arms_near_singularities_hit_harder_and_others_as_hard() -> None:
    settings: dict[str, Any] = {"poses": 60, "seed": 6, "joint_limits": "ignore"}
    respected, ignored = (
        run(WorkspaceStudy(SLOW, velocity_limits=limits, **settings)).rows for limits in ("respect", "ignore")
    )
    assert respected["q_1"].equals(ignored["q_1"])
    with_limits, without = respected["p50_N"].to_numpy(), ignored["p50_N"].to_numpy()
    # Most motions never come near a limit.
    assert (with_limits == without).sum() > 45
    # A joint at its limit slows the arm, and the force grows with the speed.
    assert without[np.isfinite(without)].max() > 2 * with_limits[np.isfinite(with_limits)].max()


def test_shares_are_those_of_the_rows(study: WorkspaceStudy, rows: pl.DataFrame) -> None:
    summary = study.summary(rows)
    assert summary["p_over_force"]["mean"] == pytest.approx(rows["p_over_force"].mean())
    assert summary["distribution"]["edges_N"][-1] == 300
    tails = np.array(rows["p_over_edges"].to_list())
    assert sum(summary["distribution"]["collisions"]) == pytest.approx(tails[:, 0].sum())
    assert summary["nothing_hit"]["mean"] == pytest.approx(1 - tails[:, 0].mean())
    assert (np.diff(tails, axis=1) <= 1e-12).all()


# --- Predicted forces -------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def predicted() -> tuple[WorkspaceStudy, pl.DataFrame, dict[str, Any]]:
    study = WorkspaceStudy(SLOW, poses=80, seed=4, predict=True)
    return study, *run(study)


def test_predicted_forces_stand_beside_their_laws(
    predicted: tuple[WorkspaceStudy, pl.DataFrame, dict[str, Any]],
) -> None:
    _, rows, summary = predicted
    trusted = rows.filter(rows["trusted"])
    assert summary["trusted"] == trusted.height > 30
    assert (trusted["bound_N"] >= trusted["p999_N"]).all()
    assert np.median(np.abs(trusted["expected_N"] / trusted["mean_N"] - 1)) < 0.05
    # Predicting adds columns and changes none.
    plain = run(WorkspaceStudy(SLOW, poses=80, seed=4)).rows
    assert rows.select(plain.columns).equals(plain)


def test_the_worst_direction_is_detected_last_of_all(
    predicted: tuple[WorkspaceStudy, pl.DataFrame, dict[str, Any]],
) -> None:
    _, rows, _ = predicted
    robot = bs.Robot.load("sia5d")
    q = rows.select([f"q_{j}" for j in range(1, 8)]).to_numpy()
    worst = rows.select([f"worst_{axis}" for axis in "xyz"]).to_numpy()
    largest = rows["worst_undetectable_N"].to_numpy()
    thresholds = SLOW.detector.thresholds_Nm
    assert np.linalg.norm(worst, axis=1) == pytest.approx(np.ones(len(worst)))
    finite = np.isfinite(largest)
    assert finite.sum() > 60
    along = undetectable_force_along(robot, q[finite], worst[finite], thresholds)
    assert along == pytest.approx(largest[finite], rel=1e-9)
    for other in np.random.default_rng(0).normal(size=(50, 3)):
        unit = other / np.linalg.norm(other)
        assert (undetectable_force_along(robot, q[finite], unit, thresholds) <= largest[finite] * (1 + 1e-9)).all()
    # At the same speed the arm is expected to hit harder there, but for what the joints add by braking longer.
    both = rows.filter(rows["trusted"] & rows["worst_trusted"])
    assert both.height > 20
    assert (both["worst_expected_N"] > both["expected_N"]).mean() > 0.8


@pytest.mark.parametrize(("area", "end"), [(1.0, 300), (2.0, 600), (2.9, 600), (3.0, 300), (12.0, 300)])
def test_bins_reach_a_pressure_limit_that_is_not_far_away(study: WorkspaceStudy, area: float, end: float) -> None:
    """190, 380, 551, 570 and 2280 N, beside a force limit of 140 N: what was beyond the last bin lay left of it."""
    scenario = study.scenario.with_values({"contact.limits": "ts15066", "contact.area_cm2": area})
    other = replace(study, scenario=scenario)
    force, pressure = other.force_limits
    assert (force, pressure) == (140.0, pytest.approx(190.0 * area))
    assert other.edges[-1] == end
    assert other.edges[-1] > pressure or pressure > 4 * force


def test_a_cut_leaves_equal_values_on_one_side() -> None:
    """Half of these poses are predicted without bound: all of them can be refused, or none."""
    rng = np.random.default_rng(8)
    unsafe = rng.uniform(size=40) < 0.5
    value = np.where(rng.uniform(size=40) < np.where(unsafe, 0.8, 0.3), np.inf, rng.uniform(size=40))
    columns = {column: value for column, _ in predicting._PREDICTORS.values()}
    found = predicting.predictors(pl.DataFrame(columns | {"p50_N": rng.uniform(size=40)}), unsafe, 0.5)

    def errors(cut: float) -> float:
        return float((unsafe & ~(value > cut)).sum() / unsafe.sum() + (~unsafe & (value > cut)).sum() / (~unsafe).sum())

    best = min(errors(cut) for cut in np.unique(value))
    assert found["expected_force"]["unsafe_missed"] + found["expected_force"]["safe_refused"] == pytest.approx(best)


def test_predictors_are_counted_as_a_table_of_errors_would_count_them(
    predicted: tuple[WorkspaceStudy, pl.DataFrame, dict[str, Any]],
) -> None:
    study, rows, summary = predicted
    known = rows.filter(rows["end"] != "singular_start")
    unsafe = np.fmax(known["p_over_force"].to_numpy(), known["p_over_pressure"].to_numpy()) > 1e-3
    found = summary["predictors"]
    assert found["bound"]["unsafe_missed"] == 0.0
    refused = ~(known["bound_N"].to_numpy() <= min(study.force_limits))
    assert found["bound"]["safe_refused"] == pytest.approx((refused & ~unsafe).sum() / (~unsafe).sum())
    for each in found.values():
        assert abs(each["rank_correlation"]) <= 1
        # A cut that errs least errs no more than refusing nothing or all.
        assert each["unsafe_missed"] + each["safe_refused"] <= 1 + 1e-12
    assert found["expected_force"]["rank_correlation"] > found["condition_number"]["rank_correlation"]


# --- Self-collision ---------------------------------------------------------------------------------------------


def test_distance_of_segments_against_brute_force() -> None:
    rng = np.random.default_rng(0)
    a, b, c, d = rng.normal(size=(4, 100, 3))
    b[:20] = a[:20] + 1.7 * (d[:20] - c[:20])  # parallel
    found = _native.segment_distances(a, b, c, d)
    share = np.linspace(0, 1, 301)[None, :, None]
    first, second = a[:, None] + share * (b - a)[:, None], c[:, None] + share * (d - c)[:, None]
    brute = np.array([np.linalg.norm(p[:, None] - r[None], axis=2).min() for p, r in zip(first, second, strict=True)])
    # A grid of 301 points a side is never nearer, and farther by less than a grid's step of each.
    step = (np.linalg.norm(b - a, axis=1) + np.linalg.norm(d - c, axis=1)) / 600
    assert (brute >= found - 1e-12).all()
    assert (brute <= found + step).all()


def test_an_arm_folded_onto_itself_is_found_and_a_straight_one_is_not() -> None:
    robot = bs.Robot.load("ur10e")
    q = np.radians([[0, -90, 0, -90, 0, 0], [0, -90, 179, 0, 0, 0]])
    assert self_collision(robot, q, 0.04).tolist() == [False, True]
    drawn = np.random.default_rng(2).uniform(robot.lower, robot.upper, size=(300, 6))
    hits = [int(self_collision(robot, drawn, radius).sum()) for radius in (0.01, 0.03, 0.05)]
    assert 0 < hits[0] <= hits[1]


def test_poses_in_self_collision_are_drawn_again_and_counted() -> None:
    study = WorkspaceStudy(ur10e(), poses=30, link_radius_mm=40.0, seed=1)
    rows, summary = run(study)
    q = rows.select([f"q_{j}" for j in range(1, 7)]).to_numpy()
    assert not self_collision(bs.Robot.load("ur10e"), q, 0.04).any()
    assert summary["self_collisions"]["poses_discarded"] == rows["redrawn"].sum() > 0


# --- What cannot be studied -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scenario", "options", "field"),
    [
        (SLOW, {}, "--poses"),
        (SLOW, {"poses": 1, "grid": 1}, "--grid"),
        (SLOW, {"grid": 2, "speed_sd_mm_s": 1.0}, "--speed-sd"),
        (SLOW, {"grid": 2, "seed": 1}, "--seed"),
        (SLOW, {"poses": 1, "grid_directions": 3}, "--grid-directions"),
        (SLOW, {"poses": 1, "speed_sd_mm_s": -1.0}, "--speed-sd"),
        (SLOW, {"poses": 1, "speed_sd_mm_s": 11.0}, "--speed-sd"),
        (SLOW, {"poses": 1, "link_radius_mm": math.nan}, "--link-radius"),
        (SLOW, {"poses": 1, "link_radius_mm": 900.0}, "--link-radius"),
        (bs.load_scenario(TRAJECTORY), {"poses": 1}, "motion.kind"),
        (SLOW, {"grid": 100}, "--grid"),
        (control_group(contact__kind="free", contact__body_mass_kg=1.0), {"poses": 1, "predict": True}, "--predict"),
        (control_group(arm__model="elastic"), {"poses": 1, "predict": True}, "--predict"),
        (
            control_group(contact__kind="free", contact__body_mass_kg=1.0, contact__arm="two_mass"),
            {"poses": 1},
            "contact.arm",
        ),
        (control_group(contact__normal=[0.0, 0.0, -1.0]), {"poses": 1}, "contact.normal"),
        (
            control_group(contact__limits="ts15066", verdict__clamped_limit="two_phase"),
            {"poses": 1},
            "verdict.clamped_limit",
        ),
        (control_group(detector__arming_delay_s=0.1), {"poses": 1, "predict": True}, "--predict"),
    ],
)
def test_a_study_that_makes_no_sense_is_refused_by_name(scenario: bs.Scenario, options: Any, field: str) -> None:
    with pytest.raises(bs.InputError) as refused:
        WorkspaceStudy(scenario, **options)
    assert refused.value.field == field


def test_motions_that_never_touch_are_counted_apart() -> None:
    """A body half a metre away, and poses beside joint limits: some motions end long before it."""
    study = WorkspaceStudy(
        control_group(contact__offset_law="fixed", contact__offset_mm=200.0, motion__velocity_mm_s=[0, 0, -200]),
        poses=40,
    )
    rows, summary = run(study)
    known = rows.filter(rows["end"] != "singular_start")
    pressed = known["p_over_edges"].list.first()
    never = known.filter(pressed <= 1e-6)
    assert 0 < never.height < known.height
    assert summary["never_touch"] == never.height
    touching = known.filter(pressed > 1e-6)
    assert summary["p_over_force_of_touching"]["mean"] == pytest.approx(touching["p_over_force"].mean())
    assert summary["p_over_force_of_touching"]["mean"] > summary["p_over_force"]["mean"]
    # None of them is a soft collision of the histogram.
    assert sum(summary["distribution"]["poses_by_median"]) == (pressed >= 0.5).sum()
    _, parts, _ = pages_of(study, rows, summary)
    assert parts[0].pictures()
    words = "".join(str(html) for part in parts for html in part.content())
    assert "never touch" in words


def test_bodies_reached_while_the_arm_brakes_are_hit() -> None:
    """A body beyond the end of most motions: some arms are pressed against it while they brake, as hard as any."""
    case = control_group(contact__offset_law="fixed", contact__offset_mm=12.0, motion__duration_s=0.04)
    study = WorkspaceStudy(case, poses=100)
    rows, summary = run(study)
    braking = rows.filter((rows["no_contact"] > 0.9) & (rows["p50_N"] > 135))
    assert braking.height > 0
    row = braking.row(0, named=True)
    keys = {
        "pose_rad": [row[f"q_{j}"] for j in range(1, 8)],
        "motion.velocity_mm_s": [1e3 * row[f"velocity_{axis}_m_s"] for axis in "xyz"],
    }
    drawn = bs.evaluate(case.with_values(keys), samples=50)
    assert drawn.peak_force.quantile(0.5) == pytest.approx(row["p50_N"], rel=1e-6)
    found = summary["distribution"]
    assert sum(found["poses_by_median"]) == braking.height
    assert found["poses_by_median"][-1] == (braking["p50_N"] > found["edges_N"][-1]).sum()
    assert summary["never_touch"] <= rows.height - braking.height
    # Here a motion that hits anything exceeds the limit: together they are all.
    assert summary["p_over_force_or_no_contact"]["mean"] == pytest.approx(1, abs=1e-6)
    assert sum(found["collisions"]) == pytest.approx(summary["p_over_force"]["mean"] * rows.height, rel=1e-4)
    words = "".join(str(html) for part in pages_of(study, rows, summary)[1] for html in part.content())
    assert "Cases in which nothing is hit are left out (98 % of all)" in words


@pytest.mark.parametrize(
    "given", [{"contact__offset_mm": 1.0, "contact__stiffness_N_m": 1e9}, {"motion__duration_s": 0.01}]
)
def test_no_force_is_most_common_where_none_is_within_the_bins(given: dict[str, Any]) -> None:
    """All are beyond the last, or nothing is hit."""
    case = {"contact__offset_law": "fixed", "contact__offset_mm": 200.0} | given
    study = WorkspaceStudy(control_group(**case), poses=5)
    rows, summary = run(study)
    assert summary["distribution"]["mode_of_collisions_N"] is None
    assert any(re.fullmatch(r"most common peak force: none up to \d+ N", line) for line in summary_lines(summary))
    words = "".join(str(html) for part in pages_of(study, rows, summary)[1] for html in part.content())
    assert "of the poses' medians: none up to" in words.replace("&#x27;", "'")
