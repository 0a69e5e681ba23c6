"""A recording is judged as it is, whatever its columns are called."""

from __future__ import annotations

import json
from pathlib import Path

import polars as pl
import pytest

from cli.support import REPOSITORY, run

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


def test_columns_are_those_of_recordings() -> None:
    place = REPOSITORY / "examples" / "programs" / "place.script"
    done = run("program", place, "--scenario", REPOSITORY / "examples" / "programs" / "cell.toml", "--topic", "/states")
    assert (done.status, done.err) == (
        2,
        "error: --topic: has no meaning without a recording; leave it out, or name a recording\n",
    )
