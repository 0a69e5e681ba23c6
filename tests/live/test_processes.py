"""``bumpstop monitor`` as a process: ended, killed, on a full disk, and refused."""

from __future__ import annotations

import json
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from live.cases import FILLING, detector_file, motion

COMMAND = [sys.executable, "-c", "from bumpstop.cli.main import main; main()", "monitor"]


def arguments(folder: Path, *more: str, rows: int = 1500) -> list[str]:
    log = folder / "log.parquet"
    if not log.exists():
        motion(rows, push_Nm=25.0, at=100, until=150).save(log)
    return [*COMMAND, str(log), "--detector", str(detector_file(folder)), *more]


def began(path: Path, process: subprocess.Popen[str]) -> None:
    """Wait for the alarm."""
    end = time.monotonic() + 20
    while time.monotonic() < end and process.poll() is None:
        if path.exists() and '"alarm"' in path.read_text():
            return
        time.sleep(0.02)
    pytest.fail(f"no alarm: {process.communicate()}")


def messages(path: Path) -> list[int]:
    from mcap.reader import make_reader

    with path.open("rb") as file:
        return [m.log_time for _, _, m in make_reader(file).iter_messages(topics=["/joint_states"])]


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_a_terminated_monitor_ends_cleanly(tmp_path: Path, number: signal.Signals) -> None:
    lines = tmp_path / "a.jsonl"
    words = arguments(tmp_path, "--jsonl", str(lines), "--mcap", str(tmp_path / "a.mcap"))
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        began(lines, process)
        process.send_signal(number)
        out, err = process.communicate(timeout=10)
    assert (process.returncode, err) == (3, "")
    assert "COLLISION 1 at 0.4" in out
    assert "collisions: 1" in out
    assert json.loads(lines.read_text().splitlines()[-1])["kind"] == "end"
    assert len(messages(tmp_path / "a_0001.mcap")) > 100
    assert not list(tmp_path.glob("*.part"))


def test_a_killed_monitor_loses_a_second_at_most_and_the_next_goes_on(tmp_path: Path) -> None:
    lines = tmp_path / "a.jsonl"
    words = arguments(tmp_path, "--jsonl", str(lines), "--mcap", str(tmp_path / "a.mcap"))
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        began(lines, process)
        time.sleep(0.7)
        process.kill()
        killed = time.time()
    (part,) = tmp_path.glob("*.part")
    done = subprocess.run([*words, "--speed", "max"], capture_output=True, text=True, check=False)
    assert done.returncode == 3
    assert "a_0001.mcap was left unfinished by a monitor that was killed; it is complete now" in done.stderr
    kept = messages(tmp_path / "a_0001.mcap")
    assert len(kept) > 100
    assert 0 <= killed - kept[-1] / 1e9 < 1.0
    np.testing.assert_allclose(np.diff(kept) / 1e9, 0.004, atol=0.1)
    assert len(messages(tmp_path / "a_0002.mcap")) == 1500
    assert not part.exists()


def test_a_pause_in_a_recording_is_lost_samples_at_any_speed(tmp_path: Path) -> None:
    """Played faster, its clock gains on ours all the time, and has not jumped."""
    log = motion(500)
    log.t[250:] += 2.0
    log.save(tmp_path / "log.parquet")
    for speed in ("10", "max"):
        words = arguments(tmp_path, "--speed", speed, "--stop-after-s", "5", "--json")
        done = subprocess.run(words, capture_output=True, text=True, check=False)
        assert json.loads(done.stdout)["found"] == {"lost": 500}, speed


def test_a_recording_that_is_played_slowly_does_not_stop(tmp_path: Path) -> None:
    """Its samples come every 0.2 s, as they must at this speed."""
    words = arguments(tmp_path, "--speed", "0.02", "--duration-s", "3", "--json")
    done = json.loads(subprocess.run(words, capture_output=True, text=True, check=False).stdout)
    assert done["found"] == {}
    assert done["judged"] > 0


def test_a_full_disk_is_named_and_monitoring_goes_on(tmp_path: Path) -> None:
    """Files may not grow beyond 20 kB: the recording ends there, the verdicts do not."""
    words = arguments(
        tmp_path, "--speed", "40", "--json", "--mcap", str(tmp_path / "a.mcap"), "--jsonl", str(tmp_path / "a.jsonl")
    )

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    done = subprocess.run(words, capture_output=True, text=True, check=False, preexec_fn=limited)
    assert done.stderr == ""
    found = json.loads(done.stdout)
    assert (found["samples"], found["judged"], found["alarms"]) == (1500, 1500 - FILLING, 1)
    assert any("cannot be written (File too large); monitoring goes on" in problem for problem in found["problems"])
    assert any("were lost" in problem for problem in found["problems"])
    # What fitted can be read.
    subprocess.run([*words, "--duration-s", "0.1"], capture_output=True, check=False)
    assert messages(tmp_path / "a_0001.mcap")


@pytest.mark.parametrize(
    ("more", "why"),
    [
        (["nowhere.parquet"], "error: SOURCE: 'nowhere.parquet' does not exist; wanted a recording's file, plant:"),
        (["rtdf://here"], "error: SOURCE: 'rtdf://here': 'rtdf' is no kind of source; did you mean 'rtde'?"),
        (["rtde://:30104"], "error: SOURCE: 'rtde://:30104' names no host; wanted a recording's file, plant:"),
        (["plant:"], "error: SOURCE: 'plant:' names no experiment"),
        (["log.parquet", "--speed", "0"], "error: --speed: is '0'; wanted a number above zero, or max"),
        (["log.parquet", "--shell"], "error: --shell: has no meaning without --on-collision"),
        (["log.parquet", "--command-timeout-s", "5"], "error: --command-timeout-s: has no meaning without --on-coll"),
        (["log.parquet", "--rotate-s", "0"], "error: --rotate-s: has no meaning without --mcap; leave it out"),
        (["log.parquet", "--duration-s", "-1"], "error: --duration-s: is -1; wanted more than zero"),
        (["panda.parquet"], "error: SOURCE: 'panda.parquet' has 7 joints; the detector's ur5e has 6"),
        (["currents.parquet"], "error: SOURCE: 'currents.parquet' has no torque; the detector takes torques"),
    ],
)  # fmt: skip
def test_what_cannot_be_watched_is_refused_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, more: list[str], why: str
) -> None:
    from dataclasses import replace

    from bumpstop.cli.main import main
    from bumpstop.recording import Recording

    monkeypatch.chdir(tmp_path)
    log = motion(50)
    log.save("log.parquet")
    Recording(t=log.t, q=np.zeros((50, 7)), tau=np.zeros((50, 7))).save("panda.parquet")
    replace(log, tau=None, current=log.tau).save("currents.parquet")
    with pytest.raises(SystemExit) as ended:
        main(["monitor", *more, "--detector", str(detector_file(tmp_path))])
    assert ended.value.code == 2
    err = capsys.readouterr().err
    assert err.startswith(why)
    assert err.count("\n") == 1


def test_another_file_is_no_detector(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from bumpstop.cli.main import main

    path = detector_file(tmp_path)
    path.write_text(path.read_text().replace("residual direct", "residual dirct"))
    with pytest.raises(SystemExit):
        main(["monitor", "x", "--detector", str(path)])
    err = capsys.readouterr().err
    assert "'residual' wants direct or observer; wanted a file that 'bumpstop detector' wrote" in err
    assert "line " in err
    path.write_text("# thresholds\n[thresholds]\nconstant_Nm = [20, 20]\n")
    with pytest.raises(SystemExit):
        main(["monitor", "x", "--detector", str(path)])
    told = f"error: --detector: {str(path)!r} is no file of a detector; wanted a file that 'bumpstop detector' wrote\n"
    assert capsys.readouterr().err == told
