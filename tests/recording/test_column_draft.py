"""Files whose columns say nothing: what they hold is listed, and a column file to start from is printed."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from bumpstop import InputError
from bumpstop.recording import Recording
from bumpstop.recording.column_draft import MissingColumnsError
from cli.support import run, strict_json
from recording.cases import real

NAMES = {
    "plain": ("time_ms", "pos{}", "vel{}", "current{}"),
    "words": ("Timestamp", "Axis {} position [deg]", "Axis {} speed [deg/s]", "Axis {} current [mA]"),
    "short": ("TimeStamp [s]", "Axis{}_Pos [deg]", "Axis{}_Vel [deg/s]", "Axis{}_Cur [A]"),
    "camels": ("clock", "j{}ActualAngle", "j{}ActualVelocity", "j{}Torque"),
    "signs": ("t [s]", "q({})", "dq({})", "tau({})"),
}


@pytest.mark.parametrize("kind", list(NAMES))
def test_a_draft_of_names_reads_its_file(kind: str, tmp_path: Path) -> None:
    time, *stems = NAMES[kind]
    names = [time, "status_3", *(stem.format(j) for stem in stems for j in range(1, 4)), "digital_in_1"]
    t = np.arange(200) * (10 if "ms" in time else 0.01)
    q = np.sin(np.arange(200)[:, None] * 0.01 + np.arange(3))
    table = np.column_stack([t, 0 * t, q, np.cos(q), 2 * q, 0 * t])
    path = tmp_path / "run.csv"
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.10g")
    result = run("recording", "info", path)
    assert result.status == 2
    assert len(result.err.splitlines()) == 1
    assert f"has no columns t and q_1, but {len(names)} others: {time}, status_3, {names[2]}" in result.err
    draft = tmp_path / "columns.toml"
    draft.write_text(result.out, encoding="utf-8")
    found = Recording.load(path, columns=draft)
    assert found.rate_hz == pytest.approx(100)
    scale = np.pi / 180 if "deg" in stems[0] else 1.0
    np.testing.assert_allclose(found.q, scale * q, rtol=1e-8)
    assert found.qd is not None
    np.testing.assert_allclose(found.qd, scale * np.cos(q), rtol=1e-8)
    third = found.tau if kind in ("camels", "signs") else found.current
    assert third is not None
    np.testing.assert_allclose(third, (1e-3 if "mA" in stems[2] else 1) * 2 * q, rtol=1e-8)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_a_sign_for_degrees_is_read_in_every_encoding(encoding: str, tmp_path: Path) -> None:
    """As traces of KUKA controllers: the draft said rad, and names with another letter than the file has."""
    t = 0.01 * np.arange(200)
    q = np.sin(t[:, None] + np.arange(2))
    rows = [";".join(f"{x:.9f}".replace(".", ",") for x in row) for row in np.column_stack([t, np.degrees(q)])]
    path = tmp_path / "trace.csv"
    path.write_text("\n".join(["Zeit;$AXIS_ACT.A1 [°];$AXIS_ACT.A2 [°]", *rows]) + "\n", encoding=encoding)
    draft = run("recording", "info", path).out
    assert """["$AXIS_ACT.A1 [°]", "$AXIS_ACT.A2 [°]"], unit = "deg" """ in draft
    (tmp_path / "columns.toml").write_text(draft, encoding="utf-8")
    np.testing.assert_allclose(Recording.load(path, columns=tmp_path / "columns.toml").q, q, atol=1e-9)


def test_a_draft_of_numbers_reads_its_file(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    np.savetxt(path, np.column_stack([0.01 * np.arange(99), np.ones((99, 6))]), delimiter=",")
    result = run("identify", path, "--robot", "ur5e")
    assert result.status == 2
    assert "has no header, and 7 columns; say with --columns" in result.err
    (tmp_path / "columns.toml").write_text(result.out, encoding="utf-8")
    assert Recording.load(path, columns=tmp_path / "columns.toml").dof == 2


def test_no_draft_where_a_program_reads(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("a,b\n1,2\n2,3\n")
    assert run("identify", path, "--robot", "ur5e", "--json").out == ""
    with pytest.raises(InputError) as caught:
        Recording.load(path)
    again = pickle.loads(pickle.dumps(caught.value))
    assert isinstance(again, MissingColumnsError)
    assert str(again) == str(caught.value)
    assert "position = { columns = []" in again.draft


def test_a_draft_of_a_matlab_file_reads_it(tmp_path: Path) -> None:
    t = 0.01 * np.arange(300)
    q = np.sin(t + np.arange(3)[:, None])
    path = tmp_path / "run.mat"
    para = {"u": np.ones(3)}
    scipy.io.savemat(path, {"rec": {"time": t, "act_pos_deg": np.degrees(q), "motor_current": 2 * q}, "para": para})
    result = run("recording", "info", path)
    assert result.status == 2
    assert "its variables are rec.time, rec.act_pos_deg, rec.motor_current, para.u" in result.err
    assert "#   rec.act_pos_deg: 3 x 300" in result.out
    assert 'time = { variable = "rec.time", unit = "s" }' in result.out
    (tmp_path / "columns.toml").write_text(result.out, encoding="utf-8")
    found = Recording.load(path, columns=tmp_path / "columns.toml")
    np.testing.assert_allclose(found.q, q.T, rtol=1e-9)
    assert found.current is not None


def test_a_draft_of_a_real_matlab_file(tmp_path: Path) -> None:
    path = real("kuka_kr300/run_a.mat")
    result = run("recording", "info", path)
    assert "rec.act_pos_mot_deg" in result.err
    (tmp_path / "columns.toml").write_text(result.out, encoding="utf-8")
    found = Recording.load(path, columns=tmp_path / "columns.toml")
    assert found.q.shape == (2501, 6)
    assert found.rate_hz == pytest.approx(250)


def test_both_times_are_said(tmp_path: Path) -> None:
    """``info`` prints the recording's own time, ``--from`` counts from its beginning."""
    t = 1000 + 0.01 * np.arange(3000)
    q = np.sin(t[:, None] + np.arange(6)) * np.linspace(0.5, 1, 6)
    path = tmp_path / "run.csv"
    Recording(t=t, q=q, tau=np.cos(q) + 0.1 * np.sign(np.cos(t[:, None] + np.arange(6)))).save(path)
    assert (
        "--from and --until count from its beginning: 0 to 29.99 s are 1000 to 1029.99 s here"
        in run("recording", "info", path).out
    )
    result = run("identify", path, "--robot", "ur5e", "--from", "1010")
    assert result.status == 2
    assert "valid: 0 to 29.99 s, counted from its beginning, which is 1000 s of its own time" in result.err
    result = run("identify", path, "--robot", "ur5e", "--cutoff", 5, "--from", "10", "--until", "25")
    assert f"part: {path}: 10 to 25 s from its beginning, 1010 to 1025 s of its own time" in result.out
    assert strict_json(run("identify", path, "--robot", "ur5e", "--cutoff", 5, "--from", "10", "--json").out)


def test_a_draft_without_torques_and_currents_has_lines_for_them(tmp_path: Path) -> None:
    """Names like ``m1`` tell nothing, and nothing said how the torques are named that ``identify`` wants."""
    path, draft = tmp_path / "run.csv", tmp_path / "columns.toml"
    table = np.column_stack([0.01 * np.arange(99), np.sin(0.01 * np.arange(99)[:, None] + np.arange(4))])
    np.savetxt(path, table, delimiter=",", header="t,pos1,pos2,m1,m2", comments="")
    text = run("recording", "info", path).out
    (line,) = (line for line in text.splitlines() if line.startswith("# torque = "))
    assert '# current = { columns = [], unit = "A" }' in text
    draft.write_text(text.replace(line, line.removeprefix("# ").replace("[]", '["m1", "m2"]')), encoding="utf-8")
    np.testing.assert_allclose(np.array(Recording.load(path, columns=draft).tau), table[:, 3:])
    matlab = tmp_path / "run.mat"
    scipy.io.savemat(matlab, {"t": table[:, 0], "pos": table[:, 1:3], "m": table[:, 3:]})
    assert '# torque = { variable = "", unit = "Nm" }' in run("recording", "info", matlab).out
    # Where a current was found, nothing lacks.
    np.savetxt(path, table, delimiter=",", header="t,pos1,pos2,cur1,cur2", comments="")
    assert "# torque" not in run("recording", "info", path).out
