"""Highest safe speeds: what is written is acceptable, and a little more is not, whoever asks."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.cli.main import main
from bumpstop.model import Robot
from bumpstop.model.urdf.writer import write_urdf
from bumpstop.program.cell import Cell, write_trajectory
from bumpstop.program.evaluation import ProgramResult, evaluate_program
from bumpstop.program.safe_speed import greatest_factor, highest_safe
from bumpstop.program.segment import MoveSegment
from bumpstop.program.trajectories.trajectory_segment import TrajectorySegment
from bumpstop.program.worst_onset import worst_onset
from bumpstop.study.requirement.sampling_ripple import SLOWER_MAY_FAIL
from bumpstop.study.speed.trajectory.onset_shares import onset_shares
from program.corpora import EXAMPLES, bell, cell, segments

SHORT = "[0.12, -1.57, 1.57, -1.57, -1.57, 0]"
BACK = "[0, -1.57, 1.57, -1.57, -1.57, 0]"


def found(text: str, folder: Path, **options: bool) -> ProgramResult:
    (folder / "p.script").write_text(text)
    return evaluate_program(folder / "p.script", bs.load_scenario(EXAMPLES / "cell.toml"), **options)  # type: ignore[arg-type]


def test_what_is_written_is_acceptable_and_a_little_more_is_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = f"movej({SHORT}, v=0.4)  # too fast\nmovel(p[-0.63, -0.25, 0.6, 3.1, 0, 0.1], v=0.01)\n"
    (tmp_path / "p.script").write_text(text)
    mine, stale = (tmp_path / "out" / "segments" / name for name in ("2024_log.csv", "7.toml"))
    mine.parent.mkdir(parents=True)
    mine.write_text("mine")
    stale.write_text("of another run")
    with pytest.raises(SystemExit) as ended:
        main(
            [
                "program",
                str(tmp_path / "p.script"),
                "--scenario",
                str(EXAMPLES / "cell.toml"),
                "--json",
                "-o",
                str(tmp_path / "out"),
            ]
        )
    assert ended.value.code == 3
    assert (mine.read_text(), stale.exists()) == ("mine", False)
    printed = json.loads(capsys.readouterr().out)
    assert (printed["present"], printed["written"]) == ("FAIL", "PASS")
    down, up = printed["segments"]
    assert down["factor"] < 1 < up["factor"]
    assert down["won_s"] < 0 < up["won_s"]
    assert down["present"]["duration_s"] - down["written"]["duration_s"] == pytest.approx(down["won_s"])
    for number, one in enumerate((down, up), start=1):
        file = tmp_path / "out" / "segments" / f"{number}.toml"
        result = bs.evaluate(bs.load_scenario(file))
        assert result.verdict.acceptable
        assert result.peak_force.quantile(0.999) == pytest.approx(one["written"]["force_N"], rel=1e-9)
        assert result.peak_force.quantile(0.999) > 0.97 * 160
    # Read again, the program has the speeds that were judged, and 5 % more is too fast.
    again = evaluate_program(tmp_path / "out" / "p.script", bs.load_scenario(EXAMPLES / "cell.toml"))
    for one, first in zip(again.segments, (down, up), strict=True):
        assert one.present.conclusion == "acceptable"
        assert one.present.force == pytest.approx(first["written"]["force_N"], rel=1e-6)
        assert again.cell.judge(one.segment.at(1.05)).conclusion == "not_acceptable"
        # What was written once stays.
        assert one.factor == 1.0


@pytest.mark.parametrize(("model", "told"), [("rigid", False), ("elastic", True)])
def test_a_note_says_where_slower_motions_may_fail(model: str, told: bool, tmp_path: Path) -> None:
    (tmp_path / "p.script").write_text(f"movej({SHORT}, v=0.2)")
    scenario = bs.load_scenario(EXAMPLES / "cell.toml", {"arm.model": model})
    assert (SLOWER_MAY_FAIL in evaluate_program(tmp_path / "p.script", scenario, faster=False).notes) is told


def test_no_place_is_worse_than_the_worst(tmp_path: Path) -> None:
    result = found(f"movej({SHORT}, v=0.3)", tmp_path)
    (one,) = result.segments
    file = tmp_path / "m.csv"
    write_trajectory(file, one.segment.at(1.0))
    problem = bs.CollisionProblem.from_scenario(result.cell.of(file))
    # The force rises abruptly once in every control cycle: at all of them, and closely within.
    t = np.arange(0, one.present_s, problem.period_steps * problem.scenario.simulation.step_s / 16)
    force = 160 * onset_shares(problem, t).exceeded_with(1e-3)
    assert force.max() <= one.present.force * (1 + 1e-4)
    # Two routes: the distribution of a whole evaluation of a contact there.
    for k in (t.size // 3, 2 * t.size // 3):
        whole = bs.evaluate(result.cell.of(file, float(t[k])))
        assert whole.peak_force.quantile(0.999) == pytest.approx(force[k], rel=1e-6)


def test_a_rise_between_two_times_that_are_looked_at_first_is_found() -> None:
    """An elastic arm whose force doubles within a control cycle, in one that looks harmless."""
    (segment,) = segments(
        "movej([0.0205, -1.5602, 1.5752, -1.5381, -1.5909, 0.0216], a=1.32, v=0.3201, r=0.03)\n"
        "movej([0.0316, -1.5829, 1.5357, -1.5354, -1.5718, -0.0067], a=2.231, v=0.15, r=0.03)\n"
        "movej([0.0244, -1.543, 1.5972, -1.6042, -1.5861, -0.0231], a=13.17, v=0.0763, r=0)\n"
    )
    changes: dict[str, object] = {
        "arm.model": "elastic",
        "detector.feedback_period_s": 0.016,
        "simulation.step_s": 0.001,
        "reaction.kind": "reverse",
        "reaction.latency_s": 0.0,
        "reaction.joint_acceleration_rad_s2": 10.0,
        "contact.stiffness_N_m": 50e3,
        "detector.thresholds_Nm": [40.0, 40.0, 30.0, 12.0, 12.0, 12.0],
        "detector.noise_sd_Nm": [10.0, 10.0, 7.5, 3.0, 3.0, 3.0],
    }
    slow = Cell(bs.load_scenario(EXAMPLES / "cell.toml", changes))
    problem = slow.problem(segment.at(1.0))
    assert problem.trajectory is not None
    accepted = problem.scenario.verdict.accepted_probability
    finely = onset_shares(problem, np.arange(0, problem.trajectory.duration, 0.016 / 64)).exceeded_with(accepted)
    assert worst_onset(problem)[1] > 0.999 * finely.max()


def test_a_place_that_is_too_hard_is_enough_and_another_is_not() -> None:
    problem = cell().problem(across().at(1.0))
    assert problem.trajectory is not None
    time, hardest = worst_onset(problem)
    near, about = worst_onset(problem, near=time, enough=0.99 * hardest)
    assert (near, about) == (pytest.approx(time, abs=1e-3), pytest.approx(hardest, rel=1e-4))
    early = 0.1 * problem.trajectory.duration
    assert worst_onset(problem, near=early) == (time, hardest)
    near, about = worst_onset(problem, near=early, enough=0.0)
    assert near == pytest.approx(early, abs=0.05)
    assert 0 < about < hardest
    assert worst_onset(problem, threads=3) == (time, hardest)


def test_only_slower_raises_nothing(tmp_path: Path) -> None:
    result = found(f"movej({SHORT}, v=0.05)\nmovej({BACK}, v=0.3)", tmp_path, faster=False)
    assert result.segments[0].factor == 1.0
    assert result.segments[1].factor < 1.0
    text = (tmp_path / "p.script").read_bytes()
    assert result.source.written(result.factors).split(b"\n")[0] == text.split(b"\n")[0]  # type: ignore[attr-defined]


def test_moves_of_one_setting_share_the_lowest_speed(tmp_path: Path) -> None:
    text = """DEF p()
$VEL.CP=0.3
LIN {X -693,Y -250,Z 680,A 0,B 0,C 180}
LIN {X -693,Y -250,Z 560,A 0,B 0,C 180}
LIN XNOWHERE
END
"""
    (tmp_path / "p.src").write_text(text)
    result = evaluate_program(tmp_path / "p.src", bs.load_scenario(EXAMPLES / "cell.toml"))
    first, second, third = result.segments
    assert first.factor == second.factor == min(first.safe_factor, second.safe_factor) < 1
    assert third.present.verdict is None
    assert third.present.why == "line 5: its target is not known before the program runs"
    assert result.present == "FAIL"
    assert result.written_outcome == "INCONCLUSIVE"
    assert {one.written.conclusion for one in result.segments[:2]} == {"acceptable"}


DOWN = "LIN {X -693,Y -174,Z 660,A 0,B 0,C 180}\n"
ELSEWHERE = "[0.1, -1.5, 1.5, -1.57, -1.57, 0]"


@pytest.mark.parametrize(
    ("ending", "text"),
    [
        (".src", f"$VEL.CP=0.02\n{DOWN}LIN XNOWHERE\n"),
        (".src", "LIN {X -650,Y -174,Z 600,A 0,B 0,C 180}\nLIN XNOWHERE\n"),
        (".src", f"$VEL.CP=0.02\n{DOWN}IF $IN[1] THEN\n$VEL.CP=0.01\nENDIF\nLIN {{Z 700}}\n"),
        (".script", f"def go():\nmovej({ELSEWHERE}, v=0.05)\nend\ngo()\nfoo()\ngo()\n"),
    ],
)
def test_what_cannot_be_judged_is_never_made_faster(ending: str, text: str, tmp_path: Path) -> None:
    file = tmp_path / f"p{ending}"
    file.write_text(text)
    result = evaluate_program(file, bs.load_scenario(EXAMPLES / "cell.toml"))
    assert any(one.segment.why for one in result.segments)
    assert all(one.factor == 1 for one in result.segments)
    assert result.source.written(result.factors) == text.encode()  # type: ignore[attr-defined]


CELLS: dict[str, dict[str, object]] = {
    "rigid": {},
    "elastic": {"arm.model": "elastic"},
    "free": {"contact.kind": "free", "contact.body_mass_kg": 3.0},
    "elastic and free": {"arm.model": "elastic", "contact.kind": "free", "contact.body_mass_kg": 12.0},
    "gauge": {"contact.stiffness_N_m": 75e3, "contact.gauge_spring_N_m": 75e3, "contact.gauge_mass_kg": 2.0},
    "damping": {"contact.damping_Ns_m": 500.0},
    "observer": {"detector.residual": "observer"},
    "reversing": {"reaction.kind": "reverse"},
}


def across() -> MoveSegment:
    (segment,) = segments("movej([0.4, -1.5, 1.5, -1.5, -1.5, 0.3], a=20, v=0.2)")
    return segment


@pytest.mark.parametrize("changes", CELLS.values(), ids=CELLS)
def test_whatever_gives_way_is_judged_as_evaluate_judges_it(changes: dict[str, object]) -> None:
    other = Cell(bs.load_scenario(EXAMPLES / "cell.toml", changes))
    segment = across()
    judged = other.judge(segment.at(1.0))
    # The search's own force is that of a whole evaluation of a contact at the worst place.
    assert judged.share * other.allowed_force == pytest.approx(judged.force, rel=1e-9)
    safe = highest_safe(segment, other, 8.0, judged)
    assert safe.judged is not None
    assert safe.judged.conclusion == "acceptable"
    assert safe.limited_by == "limits"
    assert other.judge(segment.at(1.05 * safe.factor)).conclusion == "not_acceptable"


def test_the_hardest_of_several_bodies_counts() -> None:
    place = EXAMPLES / "place.script"
    arm, elbow = (bs.load_scenario(EXAMPLES / name) for name in ("cell.toml", "elbow.toml"))
    both = evaluate_program(place, arm, elbow).to_json()
    each = [evaluate_program(place, cell).to_json() for cell in (arm, elbow)]
    assert [body["body"] for body in both["bodies"]] == ["lower_arm_wrist", "upper_arm_elbow"]
    hit = set()
    for one, *alone in zip(both["segments"], *(found["segments"] for found in each), strict=True):
        share = [a["present"]["force_N"] / b["allowed_force_N"] for a, b in zip(alone, both["bodies"], strict=True)]
        worst = int(np.argmax(share))
        assert one["present"]["body"] == both["bodies"][worst]["body"]
        assert one["present"]["force_N"] == pytest.approx(alone[worst]["present"]["force_N"])
        assert one["factor"] == pytest.approx(min(a["factor"] for a in alone), rel=0.01)
        hit.add(worst)
    assert hit == {0, 1}


@pytest.mark.parametrize(
    ("changes", "what"), [({"robot": "ur5e"}, "robot"), ({"pose_deg": [1, -90, 90, -90, -90, 0]}, "start")]
)
def test_bodies_stand_beside_one_arm(changes: dict[str, object], what: str) -> None:
    arm = bs.load_scenario(EXAMPLES / "cell.toml")
    with pytest.raises(bs.InputError, match=f"two cells have another {what}; give cells of one {what}"):
        Cell(arm, arm.with_values(changes))


def test_the_chain_is_that_of_the_scenario(tmp_path: Path) -> None:
    """Of a URDF with several ends."""
    arm = Robot.load("ur10e")
    write_urdf(arm, tmp_path / "arm.urdf")
    beside = '<link name="eye"/><joint name="pan" type="fixed"><parent link="base_link"/><child link="eye"/></joint>'
    text = (tmp_path / "arm.urdf").read_text().replace("</robot>", f"{beside}</robot>")
    (tmp_path / "arm.urdf").write_text(text)
    own = bs.load_scenario(EXAMPLES / "cell.toml", {"robot": str(tmp_path / "arm.urdf"), "tip": "flange"})
    assert [joint.name for joint in Cell(own).robot.joints] == [joint.name for joint in arm.joints]
    five = {"tip": "wrist_2_link", "pose_deg": [0, -90, 90, -90, -90], "motion.task": "position"}
    five |= {"detector.thresholds_Nm": [40, 40, 30, 12, 12], "detector.noise_sd_Nm": 2}
    assert Cell(own.with_values(five)).robot.dof == 5
    with pytest.raises(bs.InputError, match="two cells have another robot"):
        Cell(own, own.with_values(five))


@pytest.mark.parametrize("arm", ["rigid", "elastic"])
def test_two_phases_are_judged_by_both_limits(arm: str) -> None:
    changes = {"verdict.clamped_limit": "two_phase", **CELLS["reversing"], **CELLS[arm]}
    other = Cell(bs.load_scenario(EXAMPLES / "cell.toml", changes))
    segment = across()
    safe = highest_safe(segment, other, 8.0, other.judge(segment.at(1.0)))
    assert safe.judged is not None
    assert safe.judged.conclusion == "acceptable"
    assert safe.judged.force > 1.2 * other.allowed_force  # of the quasi-static limit, which does not count at first
    assert other.judge(segment.at(1.05 * safe.factor)).conclusion == "not_acceptable"


def test_slow_motions_that_a_formula_finds_too_fast_have_a_safe_speed() -> None:
    begin = np.array([-0.077, -1.435, 2.036, -1.39, -1.675, -0.311])
    end = np.array([0.01, -1.181, 1.847, -1.749, -1.149, -0.031])
    t = np.linspace(0, 7.0, 351)
    robot, acceleration, q = cell().robot, cell().joint_acceleration, bell(begin, end, 7.0, t)
    segment = TrajectorySegment("s", range(1, 352), (0, 350), robot, t, q, None, acceleration, dense=True)
    present = cell().judge(segment.at(1.0))
    safe = highest_safe(segment, cell(), 3.0, present)
    assert present.conclusion == "acceptable"
    assert safe.factor > 1


def test_accelerations_stay_within_those_of_the_reaction() -> None:
    moves = "movej([0.9, -1.57, 1.57, -1.57, -1.57, 0], v=0.2, r=0.05)\nmovej([0.9, -1.2, 1.4, -1.77, -1.57, 0], v=0.2)"
    (segment,) = segments(moves)

    def greatest(factor: float) -> float:
        motion = segment.at(factor)
        return float(np.abs(motion.at(np.linspace(0, motion.duration, 5001), 2)).max())

    assert greatest(segment.max_factor(100.0)) > 20
    # The cell's joint acceleration is 10 rad/s2, to which the program's own 1.4 of its ramps may come.
    assert 9 < greatest(greatest_factor(segment, cell(), 100.0)) < 11.4


def test_a_time_is_not_shortened_beyond_the_accelerations() -> None:
    (segment,) = segments("movej([0.3, -1.57, 1.57, -1.57, -1.57, 0], t=4)")
    most = greatest_factor(segment, cell(), 100.0)
    # Up and down in half of the time each, less what rounds the ramp off: 2 d / t over t / 2 - 0.05 s.
    time = 4 / most
    assert 4 * 0.3 / time / (time - 0.1) == pytest.approx(10, rel=0.02)


def test_a_speed_that_nobody_said_keeps_to_them_too(tmp_path: Path) -> None:
    text = "DEF p()\nLIN {X -600,Y -174,Z 690,A 0,B 0,C 180} C_DIS\nLIN {X -600,Y -300,Z 690,A 0,B 0,C 180}\nEND\n"
    (tmp_path / "p.src").write_text(text.replace("LIN", "$APO.CDIS=5\nLIN", 1))
    # A body that feels next to nothing: the joints decide.
    soft = bs.load_scenario(EXAMPLES / "cell.toml", {"contact.stiffness_N_m": 200.0})
    (one,) = evaluate_program(tmp_path / "p.src", soft).segments
    assert one.segment.bends(1.0).max() > 20
    assert 9.8 < one.segment.bends(one.factor).max() < 10.2
    assert one.limited_by == "slower_only"


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"contact.kind": "free", "contact.arm": "two_mass"}, "contact.arm"),
        ({"contact.kind": "free", "contact.body": "skull_forehead"}, "contact.body"),
        ({"contact.link": "elbow"}, "contact.link"),
        ({"reaction.stop_category": 0}, "reaction.stop_category"),
    ],
)
def test_cells_that_cannot_judge(changes: dict[str, object], field: str) -> None:
    scenario = bs.load_scenario(EXAMPLES / "cell.toml")
    with pytest.raises(bs.InputError) as refused:
        Cell(scenario.with_values(changes))
    assert refused.value.field == field


def test_a_cell_keeps_all_but_the_motion() -> None:
    given = tomllib.loads((EXAMPLES / "cell.toml").read_text())
    kept = cell().scenario.to_dict()
    assert kept["detector"]["thresholds_Nm"] == given["detector"]["thresholds_Nm"]
    assert kept["contact"]["body"] == given["contact"]["body"]
    assert np.allclose(np.degrees(cell().start), given["pose_deg"])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["nowhere.script"], "nowhere.script: there is no such file"),
        (["{place}.dat"], "holds data of a KRL program"),
        (["{place}.script", "--max-speed", "0"], "--max-speed: 0 mm/s cannot be used"),
        (["{place}.script", "-o", "{folder}"], "is where the program is"),
        (["{place}.script", "-o", "loop"], "--out: 'loop' cannot be written (Not a directory)"),
        (["loop", "-o", "out"], "loop: there is no such file"),
        (["empty.mod"], "has no move that is understood as RAPID"),
    ],
)
def test_refusals(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("empty.mod").write_text("MODULE m ENDMODULE")
    Path("loop").symlink_to("loop")
    words = [word.format(place=EXAMPLES / "place", folder=EXAMPLES) for word in arguments]
    with pytest.raises(SystemExit) as ended:
        main(["program", *words, "--scenario", str(EXAMPLES / "cell.toml")])
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


def test_a_cell_is_not_written_over(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A segment of a run before may be the cell of the next one, but not in the same folder."""
    segment = tmp_path / "segments" / "1.toml"
    segment.parent.mkdir()
    segment.write_bytes((EXAMPLES / "cell.toml").read_bytes())
    with pytest.raises(SystemExit) as ended:
        main(["program", str(EXAMPLES / "place.script"), "--scenario", str(segment), "-o", str(tmp_path)])
    assert ended.value.code == 2
    assert f"--out: {str(segment)!r} is read, and would be written over" in capsys.readouterr().err
    assert segment.read_bytes() == (EXAMPLES / "cell.toml").read_bytes()


def test_without_ruckig(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "ruckig", None)
    with pytest.raises(SystemExit) as ended:
        main(["program", str(EXAMPLES / "place.script"), "--scenario", str(EXAMPLES / "cell.toml")])
    assert ended.value.code == 2
    assert capsys.readouterr().err == "error: program: ruckig is not installed; pip install 'bumpstop[program]'\n"
