"""What the monitor prints: a terminal or pipe that takes nothing, or is closed, holds up no sample and no end."""

from __future__ import annotations

import io
import json
import os
import pty
import re
import subprocess
import threading
import time
from pathlib import Path

import pytest
from rich.console import Console

from bumpstop.live import SourceEvent, SourceEventKind
from bumpstop.live.monitor import Monitor, MonitorSettings
from bumpstop.live.unbuffered_text import UnbufferedText, standard_output, warn
from bumpstop.live.view import MonitorView
from bumpstop.terminal import terminal
from live.cases import DT, ScriptedSource, at, loaded, motion, samples
from live.test_processes import arguments

PAGE = b"x" * 1024


def full(descriptor: int) -> None:
    """Write until nothing more is taken."""
    os.set_blocking(descriptor, False)
    try:
        while True:
            os.write(descriptor, PAGE)
    except BlockingIOError:
        os.set_blocking(descriptor, True)


@pytest.mark.parametrize("made", [os.pipe, pty.openpty], ids=["pipe", "terminal"])
def test_who_does_not_read_holds_nothing_up(tmp_path: Path, made: object) -> None:
    """Every sample is judged in its time, the alarm is told elsewhere, and the end comes."""
    lines = tmp_path / "a.jsonl"
    words = arguments(tmp_path, "--speed", "4", "--jsonl", str(lines))
    reading, writing = made()  # type: ignore[operator]
    full(writing)
    begin = time.monotonic()
    with subprocess.Popen(words, stdin=subprocess.DEVNULL, stdout=writing, stderr=writing) as process:
        try:
            assert process.wait(timeout=20) == 3
        finally:
            process.kill()
            os.close(writing)
            os.close(reading)
    assert time.monotonic() - begin < 15
    told = [json.loads(line) for line in lines.read_text().splitlines()]
    assert [line["event"] for line in told if line["kind"] == "source"] == ["started", "ended"]
    assert [line["number"] for line in told if line["kind"] == "alarm"] == [1]
    assert told[-1] == told[-1] | {"kind": "end", "lost": 0}


def test_a_closed_pipe_is_said_once_and_monitoring_goes_on(tmp_path: Path) -> None:
    lines = tmp_path / "a.jsonl"
    words = arguments(tmp_path, "--speed", "4", "--jsonl", str(lines))
    reading, writing = os.pipe()
    os.close(reading)
    done = subprocess.run(words, stdout=writing, stderr=subprocess.PIPE, text=True, check=False)
    os.close(writing)
    assert done.returncode == 3
    said = done.stderr.splitlines()
    assert said[0] == "warning: standard output cannot be written (nobody reads it any more); monitoring goes on"
    assert "lines or messages were lost" in said[-1]
    assert len(said) == 2, said
    told = [json.loads(line) for line in lines.read_text().splitlines()]
    assert [line["number"] for line in told if line["kind"] == "alarm"] == [1]
    assert [line["fault"] for line in told if line["kind"] == "state"][-1] == "ended"
    assert told[-1]["kind"] == "end"


class Held(io.StringIO):
    """Takes nothing until it is let go."""

    def __init__(self) -> None:
        super().__init__()
        self.free = threading.Event()

    def write(self, text: str) -> int:
        self.free.wait(20)
        return super().write(text)


def test_what_a_slow_terminal_does_not_take_is_counted(tmp_path: Path) -> None:
    file = Held()
    view = MonitorView(loaded(tmp_path), Console(file=file, width=200), "scripted")
    view.every(Monitor(loaded(tmp_path), ScriptedSource([]), [view]))
    event = SourceEvent(SourceEventKind.LOST, "one is missing")
    with view:
        view.source_event(event, 0.0)
        time.sleep(0.3)
        begin = time.monotonic()
        for _ in range(1500):
            view.source_event(event, 0.0)
        assert time.monotonic() - begin < 1.0
        file.free.set()
        view.conclude(["collisions: 0"])
    assert file.getvalue().count("source lost: one is missing\n") == 1001
    assert file.getvalue().endswith("collisions: 0\n")
    assert "standard output is too slow: 500 lines or messages were left out" in view.problems()


def test_every_failure_is_said_and_its_end(tmp_path: Path) -> None:
    """What was lost is not printed later."""
    disk, found = os.open(tmp_path / "disk", os.O_WRONLY | os.O_CREAT), list[str]()
    full_disk, writing = os.open("/dev/full", os.O_WRONLY), os.dup(disk)
    view = MonitorView(loaded(tmp_path), terminal(UnbufferedText(writing, "utf-8")), "scripted")
    with view:
        for number, goes_to in enumerate((full_disk, disk, full_disk, disk)):
            os.dup2(goes_to, writing)
            view.source_event(SourceEvent(SourceEventKind.LOST, f"number {number}"), 0.0)
            wait_for(view, found)
    fails = "standard output cannot be written (No space left on device); monitoring goes on"
    assert found == [fails, "standard output can be written again"] * 2
    assert view.problems() == ["standard output: 2 lines or messages were lost"]
    assert (tmp_path / "disk").read_text() == "source lost: number 1\nsource lost: number 3\n"
    for descriptor in (disk, full_disk, writing):
        os.close(descriptor)


def wait_for(view: MonitorView, found: list[str]) -> None:
    """Until the view says something of itself."""
    end, before = time.monotonic() + 10, len(found)
    while len(found) == before and time.monotonic() < end:
        time.sleep(0.02)
        found += view.problems()


def test_a_pipe_that_does_not_block_is_waited_for(tmp_path: Path) -> None:
    reading, writing = os.pipe()
    full(writing)
    os.set_blocking(writing, False)
    view = MonitorView(loaded(tmp_path), terminal(UnbufferedText(writing, "utf-8")), "scripted")
    with view:
        view.source_event(SourceEvent(SourceEventKind.LOST, "one is missing"), 0.0)
        time.sleep(0.3)
        got = os.read(reading, 1 << 20)
        view.conclude(["collisions: 0"])
    got += os.read(reading, 1 << 20)
    assert got.lstrip(b"x") == b"source lost: one is missing\ncollisions: 0\n"
    assert view.problems() == []
    os.close(reading)
    os.close(writing)


def test_closed_streams_are_none(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    for name in ("stdout", "stderr"):
        with (tmp_path / name).open("w") as file:
            monkeypatch.setattr(f"sys.{name}", file)
    assert standard_output() is None
    warn("nobody sees this")


def test_the_terminal_says_why_there_are_no_data(tmp_path: Path) -> None:
    log = samples(motion(100))
    frozen = [at(log[99], stamp_s=log[99].stamp_s + DT * i) for i in range(1, 400)]
    view = MonitorView(loaded(tmp_path), Console(file=io.StringIO()), "scripted")
    age = r"last sample \d+ ms ago"
    for script, words in (
        (log[:3], rf"INACTIVE: {age}, no data \(filling\), 0 alarms"),
        (log, rf"MONITORING: {age}, worst joint \w+ at \d+ % of its threshold, 0 alarms"),
        ([*log, *frozen], rf"INACTIVE: {age}, no data \(frozen\), 0 alarms"),
    ):
        monitor = Monitor(loaded(tmp_path), ScriptedSource([]), [view])
        for one in script:
            monitor.take(at(one, received_s=time.monotonic()))
        view.every(monitor)
        assert re.fullmatch(words, view.line())
    lines: list[str] = []

    def every(monitor: Monitor) -> None:
        view.every(monitor)
        lines.append(view.line())

    script = [*log, *[None] * 8]
    # Rates count from the monitor that the view saw first.
    view = MonitorView(loaded(tmp_path), Console(file=io.StringIO()), "scripted")
    Monitor(loaded(tmp_path), ScriptedSource(script), [view], MonitorSettings(stop_after_s=0.1)).run(every)
    assert re.fullmatch(rf"INACTIVE: {age}, no data \(stopped\), 0 alarms", lines[-1])
