"""``bumpstop evaluate --out``: every file is there, readable, and enough to repeat the evaluation."""

from __future__ import annotations

import tomllib
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import bumpstop as bs
from bumpstop.text_files import to_toml, write_text
from cli.support import EXAMPLE, REPOSITORY, evaluate, run, strict_json

# What is the same in every file of the sampled distribution, and what a joint adds.
RUN_COLUMNS = [
    "run",
    "offset_m",
    "detected",
    "detection_tick",
    "detection_time_s",
    "false_alarm",
    "force_at_detection_N",
    "peak_force_N",
    "pressure_N_cm2",
    "compression_mm",
    *[f"{name}_{axis}_{unit}" for axis in "xyz" for name, unit in (("peak_force", "N"), ("contact", "m"))],
    "condition_number_at_detection",
    "step_s",
    "feedback_period_s",
    "stiffness_N_m",
    *[f"velocity_{axis}_m_s" for axis in "xyz"],
]
JOINT_COLUMNS = [
    "triggered_{}",
    "residual_at_detection_{}_Nm",
    "noise_at_detection_{}_Nm",
    "q_start_{}",
    "joint_acceleration_{}",
    "threshold_{}_Nm",
    "noise_mean_{}_Nm",
    "noise_sd_{}_Nm",
]


@pytest.fixture(scope="module")
def sampled(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Folder and JSON of a sampled distribution with false alarms and undetected collisions among its runs."""
    folder = tmp_path_factory.mktemp("sampled") / "made" / "on the way"
    result = evaluate(
        "motion.duration_s=0.1",
        "detector.noise_sd_Nm=[6, 3, 6, 6, 6, 6, 6]",
        options=("--sampled", 500, "--seed", 7, "--out", folder),
    )
    assert result.status == 3
    assert result.err == ""
    return folder, result.out


@pytest.fixture(scope="module")
def exact(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Folder and JSON of an integrated distribution judged by a limit table of the user's own, beside the scenario."""
    home = tmp_path_factory.mktemp("exact")
    table = (REPOSITORY / "src/bumpstop/contact/data/bgia2011.toml").read_text(encoding="utf-8")
    (home / "own").mkdir()
    (home / "own" / 'limits "5".toml').write_text(table.replace('name = "bgia2011"', 'name = "own"'), encoding="utf-8")
    scenario = home / "scenario.toml"
    text = EXAMPLE.read_text(encoding="utf-8").replace('"bgia2011"', "'own/limits \"5\".toml'")
    scenario.write_text(text.replace("area_cm2 = 2.0\n", ""), encoding="utf-8")
    result = evaluate(scenario=scenario, options=("--out", home / "out"))
    assert result.err == ""
    assert strict_json(result.out)["verdict"]["limit_table"] == "own"
    return home / "out", result.out


def test_the_page_and_its_figures(sampled: tuple[Path, str], exact: tuple[Path, str]) -> None:
    for folder, _ in (sampled, exact):
        page = (folder / "report.html").read_text(encoding="utf-8")
        assert page.startswith("<!DOCTYPE html>")
        assert page.rstrip().endswith("</html>")
        pictures = {path.stem for path in folder.glob("*.png")}
        assert pictures == {path.stem for path in folder.glob("*.svg")}
        assert {"arm", "peak_force"} <= pictures
        for name in pictures:
            assert (folder / f"{name}.png").read_bytes().startswith(b"\x89PNG\r\n\x1a\n")
            assert ElementTree.parse(folder / f"{name}.svg").getroot().tag == "{http://www.w3.org/2000/svg}svg"


def test_a_row_for_every_run(sampled: tuple[Path, str]) -> None:
    folder, out = sampled
    law = strict_json(out)
    table = pl.read_parquet(folder / "law.parquet")
    expected = [*RUN_COLUMNS, *[name.format(j) for j in range(1, 8) for name in JOINT_COLUMNS]]
    expected += [f"singular_value_at_detection_{i}" for i in range(1, 7)]
    assert sorted(table.columns) == sorted(expected)
    assert table["run"].to_list() == list(range(500))
    detected, alarm = table["detected"].to_numpy(), table["false_alarm"].to_numpy()
    offset, peak = table["offset_m"].to_numpy(), table["peak_force_N"].to_numpy()
    # All three fates occur, in the shares the JSON gives.
    assert alarm.mean() == law["false_alarm_probability"] > 0
    reached = ~detected & (peak > 0)
    assert reached.mean() == law["undetected_probability"] > 0
    assert (~detected & ~reached).mean() == pytest.approx(law["no_contact_probability"])
    assert np.isinf(peak[reached]).all()
    assert not (alarm & ~detected).any()
    assert (table["detection_tick"].to_numpy() >= 0).tolist() == detected.tolist()
    # Figures of a run belong together.
    assert np.median(peak) == pytest.approx(law["peak_force_N"]["p50"], rel=0.02)
    force = table["force_at_detection_N"].to_numpy()
    assert np.isfinite(force).tolist() == detected.tolist()
    assert (force[detected] <= peak[detected] + 1e-9).all()
    assert (table["pressure_N_cm2"] / table["peak_force_N"]).drop_nans().to_numpy() == pytest.approx(0.5)
    assert (offset >= 0).all()
    # The arm moves straight down: all of the force is along z, and the body lies below.
    finite = np.isfinite(peak)
    assert table["peak_force_z_N"].to_numpy()[finite] == pytest.approx(peak[finite])
    assert table["peak_force_x_N"].to_numpy()[finite] == pytest.approx(0, abs=1e-9)
    assert np.ptp(table["contact_z_m"].to_numpy() + offset) == pytest.approx(0, abs=1e-9)
    # A joint has triggered where its residual passes its threshold, and at least one has wherever there is an alarm.
    triggered = np.column_stack([table[f"triggered_{j}"].to_numpy() for j in range(1, 8)])
    residual = np.column_stack([table[f"residual_at_detection_{j}_Nm"].to_numpy() for j in range(1, 8)])
    threshold = np.column_stack([table[f"threshold_{j}_Nm"].to_numpy() for j in range(1, 8)])
    assert threshold[0].tolist() == [20, 10, 20, 20, 20, 20, 20]
    assert (triggered[detected] == (np.abs(residual[detected]) > threshold[detected])).all()
    assert triggered.any(axis=1).tolist() == detected.tolist()
    assert triggered[detected].mean(axis=0) == pytest.approx(law["trigger_joint_probability"])


def test_quantiles_of_the_exact_law(exact: tuple[Path, str]) -> None:
    folder, out = exact
    law = strict_json(out)
    table = pl.read_parquet(folder / "law.parquet")
    assert set(table.columns) == {
        "probability",
        "peak_force_N",
        "force_at_detection_N",
        "detection_delay_s",
        "contact_duration_s",
        "pressure_N_cm2",
        "compression_mm",
    }
    assert table["probability"].is_sorted()
    for name in table.columns:
        assert table[name].is_sorted(), name
    for quantile, p in (("p50", 0.5), ("p95", 0.95), ("p99", 0.99), ("p999", 0.999)):
        (row,) = table.filter((pl.col("probability") - p).abs() < 1e-12).to_dicts()
        for name in ("peak_force_N", "pressure_N_cm2", "compression_mm", "force_at_detection_N", "contact_duration_s"):
            assert row[name] == pytest.approx(law[name][quantile], rel=1e-9), (quantile, name)


def test_settings_repeat_the_sampled_law(sampled: tuple[Path, str], monkeypatch: pytest.MonkeyPatch) -> None:
    folder, out = sampled
    settings = folder / "settings.toml"
    first = settings.read_text(encoding="utf-8").splitlines()[0]
    assert first == "# To repeat: bumpstop evaluate settings.toml --sampled 500 --seed 7"
    made_by = tomllib.loads(settings.read_text(encoding="utf-8"))["made_by"]
    assert made_by["law"] == "sampled"
    assert (made_by["samples"], made_by["seed"]) == (500, 7)
    assert {"bumpstop", "numpy", "python", "instruction_set"} <= set(made_by)
    # As the line says.
    monkeypatch.chdir(folder)
    again = run(*first.removeprefix("# To repeat: bumpstop ").split(), "--json")
    assert (again.status, again.out) == (3, out)


def test_settings_repeat_the_exact_law(
    exact: tuple[Path, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, out = exact
    # From another folder, and from a copy elsewhere: the own limit table is still found.
    copy = tmp_path / "copy.toml"
    copy.write_bytes((folder / "settings.toml").read_bytes())
    monkeypatch.chdir(tmp_path)
    assert evaluate(scenario=folder / "settings.toml").out == out
    assert evaluate(scenario=copy).out == out
    # The area was assumed then, and is so still.
    assert "Contact area not given: 1 cm² assumed." in strict_json(out)["notes"]
    # All other defaults are spelt out.
    written = tomllib.loads(copy.read_text(encoding="utf-8"))
    assert written["simulation"] == {"step_s": 0.001, "substeps": 5}
    assert written["made_by"]["law"] == "exact"
    assert "samples" not in written["made_by"]


def test_keys_without_effect_are_named_everywhere(tmp_path: Path) -> None:
    change = "contact.offset_law=uniform"
    words = 'contact.offset_sd_s has no effect with contact.offset_law = "uniform".'
    result = run("evaluate", EXAMPLE, "--set", change, "--out", tmp_path)
    assert f"note: {words}" in result.out
    notes = strict_json(evaluate(change).out)["notes"]
    assert words in notes
    assert words.split()[0] in (tmp_path / "report.html").read_text(encoding="utf-8")
    # A copy says the same, and not more: defaults without effect are not spelt out in it.
    assert strict_json(evaluate(scenario=tmp_path / "settings.toml").out)["notes"] == notes
    assert "has no effect" not in run("evaluate", EXAMPLE).out


@pytest.mark.parametrize(
    "changes",
    [
        ["contact.padding_N_m=20000", "motion.velocity_mm_s=[0, 0, -30]"],
        ["contact.kind=free", "contact.body_mass_kg=0.6", "contact.stiffness_N_m=12345"],
        ["contact.limits=ts15066", "verdict.clamped_limit=two_phase", "motion.velocity_mm_s=[0, 0, -10]"],
    ],
)
def test_every_row_of_the_summary_is_one_line_with_all_its_digits(
    changes: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    options = [part for change in changes for part in ("--set", change)]
    lines = run("evaluate", EXAMPLE, *options).out.splitlines()
    (begin,) = [number for number, line in enumerate(lines) if "p99.9" in line]
    table = lines[begin + 1 : begin + 7]
    names = [
        "peak force, N", "pressure, N/cm²", "deformation, mm", "force at detection, N", "detection delay, ms",
        "contact duration, ms",
    ]  # fmt: skip
    assert all(line.startswith(f"{name} ") for name, line in zip(names, table, strict=True))
    assert max(len(line.rstrip()) for line in table) <= 80
    law = strict_json(run("evaluate", EXAMPLE, *options, "--json").out)
    keys = (
        "peak_force_N", "pressure_N_cm2", "compression_mm", "force_at_detection_N", "detection_delay_s",
        "contact_duration_s",
    )  # fmt: skip
    for name, line, key in zip(names, table, keys, strict=True):
        factor = 1e3 if key.endswith("_s") else 1.0
        figures = [float(each) for each in line.removeprefix(name).split()[:6]]
        assert figures == pytest.approx([factor * value for value in law[key].values()], rel=5e-4)


def test_any_scenario_survives_the_file() -> None:
    law = bs.evaluate(
        bs.load_scenario(EXAMPLE).with_values(
            {
                "pose_rad": [0.1, 0.5, -0.0, -1 / 3, 1e-7, -0.7, 0.0],
                "detector.thresholds_Nm": [20, 10, float("inf"), 20, 20, 20, 1e9],
                "detector.noise_mean_Nm": [0.1, 0, 0, -0.2, 0, 0, 0],
                "contact.normal": [0.1, 0.0, -1.0],
                "contact.point_m": [0.01, 0.0, -1e-5],
                "contact.offset_law": "fixed",
                "contact.offset_mm": 1.5,
            }
        )
    )
    read = bs.Scenario.from_dict(tomllib.loads(to_toml(law.scenario.to_dict())))
    assert read.to_dict() == law.scenario.to_dict()
    assert bs.evaluate(read).to_json() == law.to_json()


def test_texts_of_any_letters_are_written() -> None:
    odd = {"a": 'q"\\\n\t\x00\x7f\u00e9\u2028\U0001f600', "t": {"flag": True, "list": [1, 2.5, 1e300, -0.0], "s": "x"}}
    assert tomllib.loads(to_toml(odd)) == odd


def test_numbers_of_numpy_are_written_as_numbers() -> None:
    mine = {"f": np.float64(0.1), "i": np.int64(7), "l": [np.float64(1e-7), np.float32(0.5)], "no": [np.inf, -np.inf]}
    assert tomllib.loads(to_toml(mine)) == {"f": 0.1, "i": 7, "l": [1e-7, 0.5], "no": [np.inf, -np.inf]}


@pytest.mark.parametrize(("name", "text", "why"), [("a\0b", "x", "null"), ("there", "robot = \udcff", "no text")])
def test_what_cannot_be_written_is_said_and_leaves_what_was_there(
    tmp_path: Path, name: str, text: str, why: str
) -> None:
    (tmp_path / "there").write_text("old")
    with pytest.raises(bs.InputError, match=why):
        write_text(tmp_path / name, text)
    assert (tmp_path / "there").read_text() == "old"


def test_what_was_there_before_is_replaced(tmp_path: Path) -> None:
    old = ("report.html", "settings.toml", "law.parquet", "arm.png", "arm.svg")
    for name in old:
        (tmp_path / name).write_text("old")
    (tmp_path / "mine.txt").write_text("mine")
    result = run("evaluate", EXAMPLE, "--sampled", 50, "--seed", 2, "--out", tmp_path)
    assert result.status == 0
    assert result.out.splitlines()[-1] == f"report: {tmp_path / 'report.html'}"
    for name in old:
        assert (tmp_path / name).read_bytes() != b"old"
    assert (tmp_path / "mine.txt").read_text() == "mine"
    law = strict_json(evaluate(options=("--sampled", 50, "--seed", 2)).out)
    assert pl.read_parquet(tmp_path / "law.parquet")["peak_force_N"].mean() == pytest.approx(
        law["peak_force_N"]["mean"]
    )


def test_a_scenario_is_not_written_over(tmp_path: Path) -> None:
    """A scenario in the folder has another name, or the command is refused; a copy elsewhere repeats it."""
    settings = tmp_path / "settings.toml"
    text = "# my remark\n" + EXAMPLE.read_text(encoding="utf-8")
    settings.write_text(text, encoding="utf-8")
    (tmp_path / "link").symlink_to(tmp_path)
    refused = f"error: --out: {str(settings)!r} is read, and would be written over; give another folder\n"
    for scenario in (settings, tmp_path / "link" / "settings.toml"):
        assert run("evaluate", scenario, "--out", tmp_path) == (2, "", refused)
    assert run("study", "workspace", settings, "--poses", 1, "--out", tmp_path).status == 2
    assert settings.read_text(encoding="utf-8") == text
    assert {path.name for path in tmp_path.iterdir()} == {"settings.toml", "link"}
    assert run("evaluate", settings, "--out", tmp_path / "out").status == 0
    assert run("evaluate", tmp_path / "out" / "settings.toml", "--out", tmp_path / "again").status == 0


def test_two_phases_print_both_limits() -> None:
    changes = ("contact.limits=ts15066", "contact.area_cm2=1", "verdict.clamped_limit=two_phase")
    lines = run("evaluate", EXAMPLE, *(part for change in changes for part in ("--set", change))).out.splitlines()
    for name, limits in (("peak force", "280/140"), ("pressure", "380/190")):
        (row,) = [line.split() for line in lines if line.startswith(name + ",")]
        assert row[-3:] == [limits, "<", "1e-12"]


def test_no_run_over_a_limit_is_no_bound_on_its_probability() -> None:
    """The quadrature knows how improbable it is; of a thousand runs that none was seen says little."""
    integrated, drawn = (run("evaluate", EXAMPLE, *options).out for options in ((), ("--sampled", "1000")))
    assert "never detected < 1e-12" in integrated
    assert "never detected 0.0000" in drawn
    assert "< 1e-12" not in drawn


def test_a_motion_that_ends_before_contact_says_so_where_the_verdict_is_read() -> None:
    """Half a second at 50 mm/s does not reach a body 500 mm away: no verdict, for nothing is hit."""
    far = ("contact.offset_law=fixed", "contact.offset_mm=500", "motion.duration_s=0.5")
    status, printed, _ = run("evaluate", EXAMPLE, *(part for change in far for part in ("--set", change)))
    assert status == 4
    assert " INCONCLUSIVE " in printed
    assert "of cases the motion ends before contact." in printed
    assert "ends before contact" not in run("evaluate", EXAMPLE).out
