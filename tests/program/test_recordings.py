"""A recording is judged as it is, whatever its columns are called."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from bumpstop.errors import InputError
from bumpstop.program.source import Source, read_source
from cli.support import REPOSITORY, run
from program.corpora import bell, cell

MOTION = REPOSITORY / "examples" / "06_pick_and_place.csv"
CELL = REPOSITORY / "examples" / "06_pick_and_place_trajectory.toml"


@pytest.mark.usefixtures("unsaved_pictures")
def test_a_recording_of_other_column_names(tmp_path: Path) -> None:
    """From contacts that some of its motions never detect."""
    table = pl.read_csv(MOTION)
    joints = [name for name in table.columns if name.startswith("q_")]
    other = [f"axis{j}" for j in range(len(joints))]
    log = tmp_path / "log.csv"
    table.select(
        pl.col("t").alias("clock"), *(pl.col(q).alias(a) for q, a in zip(joints, other, strict=True))
    ).write_csv(log)
    columns = tmp_path / "columns.toml"
    columns.write_text(f'time = {{ column = "clock" }}\nposition = {{ columns = {other}, unit = "rad" }}\n')
    refused = run("program", log, "--scenario", CELL)
    assert refused.status == 2
    assert "--columns FILE.toml" in refused.err
    found = run("program", log, "--scenario", CELL, "--columns", columns, "--json")
    assert found.err == ""
    mine, own = json.loads(found.out), json.loads(run("program", MOTION, "--scenario", CELL, "--json").out)
    assert mine["segments"]
    assert mine["segments"] == own["segments"]
    assert found.status == {"PASS": 0, "FAIL": 3, "INCONCLUSIVE": 4}[mine["present"]]


def recorded(folder: Path, rate_hz: float = 500.0, *, unit: float = 1.0, lost: slice | None = None) -> Source:
    """A motion of two seconds between two of rest, which may lack rows."""
    t = np.arange(0, 6, 1 / rate_hz)
    home = np.array([0, -1.57, 1.57, -1.57, -1.57, 0])
    q = bell(home, np.array([0.6, -1.37, 1.47, -1.77, -1.57, 0]), 2.0, t - 2)
    table = np.column_stack([unit * t, q])
    kept = table if lost is None else np.delete(table, lost, axis=0)
    header = ",".join(["t", *(f"q_{j + 1}" for j in range(6))])
    np.savetxt(folder / "log.csv", kept, delimiter=",", header=header, comments="", fmt="%.6f")
    return read_source(folder / "log.csv", cell(), 0.25)


def test_the_hardest_row_is_one_of_the_file(tmp_path: Path) -> None:
    (segment,) = recorded(tmp_path).segments
    motion = segment.at(1.0)
    assert segment.lines == pytest.approx((1001, 2001), abs=20)
    assert segment.line_at(motion.duration / 2, motion) == pytest.approx(1501, abs=10)


def test_what_the_arm_did_where_rows_are_missing_is_not_judged(tmp_path: Path) -> None:
    said = "rows are missing for {} s after row {}"
    (whole,) = recorded(tmp_path, lost=slice(1300, 1305)).segments
    assert whole.why == ""
    source = recorded(tmp_path, lost=slice(1300, 1700))
    assert [segment.why for segment in source.segments] == [said.format("0.802", 1300)]
    assert source.notes[0] == said.format("0.802", 1300)
    rests = recorded(tmp_path, lost=slice(300, 700))
    assert ([segment.why for segment in rests.segments], rests.notes[0]) == ([""], said.format("0.802", 300))


def test_what_was_found_while_reading_is_told(tmp_path: Path) -> None:
    doubted = recorded(tmp_path, unit=1e3)
    assert all("if these are no seconds" in segment.why for segment in doubted.segments)
    recorded(tmp_path)
    log = tmp_path / "log.csv"
    lines = log.read_text().splitlines()
    lines[300:303] = [line[: line.rindex(",")] + ",nan" for line in lines[300:303]]
    log.write_text("\n".join(lines) + "\n")
    assert read_source(log, cell(), 0.25).notes[0] == "3 of 3000 rows were dropped while reading"


def test_columns_are_those_of_recordings() -> None:
    place = REPOSITORY / "examples" / "programs" / "place.script"
    done = run("program", place, "--scenario", REPOSITORY / "examples" / "programs" / "cell.toml", "--topic", "/states")
    assert (done.status, done.err) == (
        2,
        "error: --topic: has no meaning without a recording; leave it out, or name a recording\n",
    )


def test_an_ending_of_nothing_that_is_read_names_all_that_are(tmp_path: Path) -> None:
    (tmp_path / "place.toml").write_text("x = 1\n")
    with pytest.raises(
        InputError, match=r"'\.toml' is no known ending; valid: \.script, .*\.src, \.mod.*\.json, \.csv, "
    ):
        read_source(tmp_path / "place.toml", cell(), 1.0)
