"""``bumpstop stopping``: what it prints, writes and refuses."""

from __future__ import annotations

import json
import math
import re
import tomllib
from pathlib import Path

import pytest

import bumpstop as bs
from bumpstop.cli.main import main
from bumpstop.collision.stopping import load_stopping_table

ROOT = Path(__file__).resolve().parents[2]
TM5_700 = str(ROOT / "examples" / "stopping" / "tm5_700.toml")


def run(*arguments: str) -> int:
    with pytest.raises(SystemExit) as ended:
        main(["stopping", *arguments])
    assert isinstance(ended.value.code, int)
    return ended.value.code


def test_a_folder_gets_page_pictures_and_reaction(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "out"
    assert run(TM5_700, "-o", str(folder)) == 0
    printed = capsys.readouterr().out
    written = tomllib.loads((folder / "reaction.toml").read_text(encoding="utf-8"))
    assert written["reaction"]["deceleration"] == "constant_time"
    assert f"stopping_time_s = {written['reaction']['stopping_time_s']}" in printed
    for joint in (1, 2, 3):
        assert (folder / f"stopping_{joint}.png").read_bytes().startswith(b"\x89PNG")
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert all(f"stopping_{joint}-" in page for joint in (1, 2, 3))
    assert page.count("<tr>") > 18


def test_a_file_gets_the_reaction_alone(tmp_path: Path) -> None:
    file = tmp_path / "reaction.toml"
    assert run(TM5_700, "-o", str(file), "--deceleration", "constant") == 0
    assert tomllib.loads(file.read_text(encoding="utf-8"))["reaction"]["deceleration"] == "constant"
    assert [path.name for path in tmp_path.iterdir()] == ["reaction.toml"]


@pytest.mark.parametrize("name", ["cell.toml", "out/reaction.toml"])
@pytest.mark.parametrize(
    "text", ["[reaction]\nkind = 'stop'  # as measured\n", "# Stops of x\nrobot = 'ur5e'\n", "no TOML ["]
)
def test_a_file_that_is_somebody_elses_stays(
    name: str, text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / name
    file.parent.mkdir(exist_ok=True)
    file.write_text(text, encoding="utf-8")
    assert run(TM5_700, "-o", str(file if file.parent == tmp_path else file.parent)) == 2
    expected = f"error: --out: {str(file)!r} exists, and is no file of this command; give another"
    assert expected in capsys.readouterr().err
    assert file.read_text(encoding="utf-8") == text
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == [file]


def test_the_table_itself_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "table.toml"
    table.write_bytes(Path(TM5_700).read_bytes())
    assert run(str(table), "-o", str(table)) == 2
    assert f"{str(table)!r} exists" in capsys.readouterr().err
    assert table.read_bytes() == Path(TM5_700).read_bytes()


def test_its_own_file_is_written_again(tmp_path: Path) -> None:
    file = tmp_path / "reaction.toml"
    for law in ("constant", "ramp"):
        for out in (file, tmp_path):
            assert run(TM5_700, "-o", str(out), "--deceleration", law) == 0
        assert tomllib.loads(file.read_text(encoding="utf-8"))["reaction"]["deceleration"] == law


def test_json_says_what_the_terminal_says(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(TM5_700, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert found["law"] == "constant_time"
    assert found["rows"] == 18
    assert set(found["exponent"]) == {"joint 1", "joint 2", "joint 3"}
    assert found["fits"]["constant_time"]["worst_error"] < 0.15


def test_the_full_speed_of_the_command_counts(capsys: pytest.CaptureFixture[str]) -> None:
    """Twice as fast over the same distance is half the time."""
    times = []
    for speed in ("180", "360,360,360"):
        assert run(TM5_700, "--json", "--full-speed-deg-s", speed) == 0
        times.append(json.loads(capsys.readouterr().out)["reaction"]["stopping_time_s"])
    assert times[1] == pytest.approx(times[0] / 2, abs=1e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([TM5_700, "--full-speed-deg-s", "0"], "--full-speed-deg-s: '0' cannot be used"),
        ([TM5_700, "--full-speed-deg-s", "1,2"], "full_speed_deg_s: [1.0, 2.0] cannot be used"),
        ([TM5_700, "--deceleration", "linear"], "--deceleration: 'linear' is no law"),
        (["nowhere.csv"], "nowhere.csv: cannot be read"),
        (["table.png"], "table.png: has the extension '.png'"),
        ([TM5_700, "-o", "nowhere/reaction.toml"], "--out: 'nowhere/reaction.toml' cannot be written"),
    ],
)
def test_refusals(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(*arguments) == 2
    assert message in capsys.readouterr().err


def test_what_a_table_does_not_state_is_asked_for_as_it_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """``evaluate`` named an option that it has not, and nothing said how a CSV states it."""
    table, head = tmp_path / "table.csv", "speed_percent,distance_1_deg,distance_2_deg,distance_3_deg"
    rows = "".join(f"{p},{0.2 * p},{0.25 * p},{0.3 * p}\n" for p in (33, 66, 100))
    table.write_text(f"{head}\n{rows}")
    assert run(str(table)) == 2
    line = "# full_speed_deg_s = 180, 180, 180"
    told = f"full_speed_deg_s: is missing; wanted the joints' full speed beside speeds in percent: a line '{line}'"
    own = f"{told} of its own in the file"
    assert f"{own}, or --full-speed-deg-s\n" in capsys.readouterr().err
    with pytest.raises(bs.InputError) as refused:
        load_stopping_table(table)
    assert own in str(refused.value)
    assert "--" not in str(refused.value)
    table.write_text(f"{line}\n{head}\n{rows}")
    assert run(str(table)) == 0
    toml = tmp_path / "table.toml"
    toml.write_text(
        f"columns = {json.dumps(head.split(','))}\nrows = [[33, 5, 6, 7], [66, 10, 12, 14], [100, 20, 24, 28]]"
    )
    capsys.readouterr()
    assert run(str(toml)) == 2
    assert "a key full_speed_deg_s = [180, 180, 180], or --full-speed-deg-s" in capsys.readouterr().err
    table.write_text("speed_deg_s,extension_mm,distance_1_deg\n50,600,10\n100,600,20\n")
    assert run(str(table)) == 2
    assert "'# reach_mm = 1300' of its own in the file, or --reach-mm" in capsys.readouterr().err


@pytest.mark.parametrize("law", ["constant_time", "constant", "ramp"])
def test_a_scenario_takes_what_is_written(law: str, tmp_path: Path) -> None:
    """And collides harder than with the deceleration of the full-speed row, which it goes far below."""
    file = tmp_path / "reaction.toml"
    assert run(TM5_700, "-o", str(file), "--deceleration", law) == 0
    written = tomllib.loads(file.read_text(encoding="utf-8"))["reaction"]
    data = bs.load_scenario(ROOT / "examples" / "01_hand_downward.toml").to_dict()
    full_speed = math.radians(180) / 0.3
    forces = [
        bs.evaluate(bs.Scenario.from_dict(data | {"reaction": reaction})).peak_force.quantile(0.99)
        for reaction in (written, {"kind": "stop", "joint_acceleration_rad_s2": full_speed})
    ]
    assert forces[0] > 1.5 * forces[1]


def test_of_several_stop_categories_the_option_is_asked_for(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = tmp_path / "table.csv"
    table.write_text("speed_deg_s,category,distance_1_deg\n50,0,1\n99,0,4\n50,1,2\n99,1,4\n", encoding="utf-8")
    assert run(str(table)) == 2
    assert "error: --category: is not given, and" in capsys.readouterr().err
    assert run(str(table), "--category", "1") == 0


def test_errors_are_percent_without_powers_of_ten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """They were 1e+02 % and inf % on terminal and page."""
    table, folder = tmp_path / "wild.toml", tmp_path / "out"
    table.write_text('columns = ["speed_deg_s", "distance_1_deg"]\nrows = [[30, 10], [60, 5], [90, 100]]\n')
    assert run(str(table), "-o", str(folder)) == 0
    texts = [capsys.readouterr().out, (folder / "report.html").read_text(encoding="utf-8")]
    texts.append((folder / "reaction.toml").read_text(encoding="utf-8"))
    for text in texts:
        assert re.search(r"\b567 %", text)
        assert not re.search(r"\de\+\d+ %|\binf\b", text)
    assert re.search(r"^ramp +none +none$", texts[0], re.MULTILINE)
    assert re.search(r"^# .*joint_acceleration_rad_s2 stays: a scenario needs it with every", texts[2], re.MULTILINE)


def test_the_page_lists_the_speed_of_every_joint(tmp_path: Path) -> None:
    """Two of three joints with one full speed had one speed together."""
    text = (
        Path(TM5_700)
        .read_text(encoding="utf-8")
        .replace("full_speed_deg_s = 180", "full_speed_deg_s = [178, 149, 178]")
    )
    (tmp_path / "table.toml").write_text(text, encoding="utf-8")
    assert run(str(tmp_path / "table.toml"), "-o", str(tmp_path / "out")) == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert ">178 149 178<" in page
    assert run(TM5_700, "-o", str(tmp_path / "same")) == 0
    assert ">180<" in (tmp_path / "same" / "report.html").read_text(encoding="utf-8")
