"""The page of the room is true: its sessions run, its tables are those of the code."""

from __future__ import annotations

import doctest
import json
import re
import shutil
from pathlib import Path

import pytest

from bumpstop.live import SourceEventKind
from bumpstop.live.outputs.ros_messages import TOPICS
from docs.pages import AS_DOCTEST, ROOT, WIDTH, blocks, code, read, rows, section
from docs.test_commands import COMMANDS, Shell


def test_the_sessions_run_and_use_every_option(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco")
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", WIDTH)
    shell = Shell(tmp_path, capsys)
    asked = ""
    for text in blocks(ROOT / "docs" / "how_to" / "live.md", "console"):
        parts = re.split(r"^\$ (.*)\n", text, flags=re.MULTILINE)
        for command, wanted in zip(parts[1::2], parts[2::2], strict=True):
            asked += command + " "
            printed = shell.run(command)
            assert doctest.OutputChecker().check_output(wanted, printed, AS_DOCTEST), f"$ {command}\n{printed}"
            assert shell.status == (2 if "error:" in wanted else shell.status)
            if "--json " in f"{command} ":
                table = section(read("docs/how_to/live.md"), "## The end")
                keys = {key for name, *_ in rows(table, "key") for key in code(name)}
                assert set(json.loads(printed)) == keys
            if "--jsonl" in command:
                lines = [json.loads(line) for line in Path("watch.jsonl").read_text().splitlines()]
                kinds = rows(section(read("docs/how_to/live.md"), "## JSON lines"), "`kind`")
                assert {line["kind"] for line in lines} == {code(kind)[0] for kind, _ in kinds}
    options = {p.opts[0] for p in COMMANDS["monitor"].params if p.param_type_name == "option" and p.name != "help"}
    without_example = {option for option in options if f"{option} " not in asked}
    assert without_example == set()


def test_the_tables_are_those_of_the_code() -> None:
    page = read("docs/how_to/live.md")
    events = [code(name)[0] for name, *_ in rows(page, "event")]
    assert sorted(events) == sorted(str(kind) for kind in SourceEventKind)
    topics = {code(topic)[0]: code(kind)[0] for topic, kind, _ in rows(section(page, "## MCAP"), "topic")}
    assert topics == TOPICS
