"""Where alarms before contact come too often no speed is safe: a slower motion is a longer one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import bumpstop as bs
from bumpstop.program.evaluation import evaluate_program
from cli.support import run
from program.corpora import EXAMPLES

THERE = "[0.12, -1.57, 1.57, -1.57, -1.57, 0]"


@pytest.mark.usefixtures("unsaved_pictures")
def test_no_speed_is_called_safe_and_the_reason_is_told(tmp_path: Path) -> None:
    path = tmp_path / "p.script"
    path.write_text(f"movej({THERE}, v=0.4)\n", encoding="utf-8")
    known = evaluate_program(path, bs.load_scenario(EXAMPLES / "cell.toml"))
    assert (known.segments[0].safe_factor, known.segments[0].limited_by) == (pytest.approx(0.3, abs=0.2), "limits")
    alarms = known.segments[0].written.verdict
    assert alarms is not None
    accepted = 0.5 * alarms.false_alarm_probability
    assert accepted > 0
    option = ("--set", f"verdict.max_false_alarm={accepted!r}")
    done = run("program", path, "--scenario", EXAMPLES / "cell.toml", *option, "--out", tmp_path / "out")
    assert done.status == 3
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    (one,) = summary["segments"]
    assert (one["safe_factor"], one["factor"], one["limited_by"]) == (0.0, 1.0, "false_alarms")
    assert (summary["present"], summary["written"], one["won_s"]) == ("FAIL", "FAIL", 0.0)
    assert "as written: " in done.out
    assert one["written"]["reason"] in " ".join(done.out.split())
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "false alarms before contact" in page
    assert "as written: " in page
