"""An alarm that stands is ended by what the detector sees, never by what it does not see."""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import pytest

from bumpstop.live import JointSample, SourceEvent, SourceEventKind
from bumpstop.live.answer import AnswerOutput
from bumpstop.live.monitor import Monitor, MonitorSettings
from live.cases import DT, Heard, ScriptedSource, at, loaded, motion, samples

AT, UNTIL, CUT = 150, 180, 200
Script = list[JointSample | SourceEvent | None]


def later(rows: list[JointSample], by: float) -> list[JointSample]:
    return [at(one, stamp_s=one.stamp_s + by) for one in rows]


def silence(s: list[JointSample]) -> Script:
    return [*s[:CUT], None, None, None, *later(s[CUT:], 0.15)]


def connection_made_anew(s: list[JointSample]) -> Script:
    return [*s[:CUT], SourceEvent(SourceEventKind.RESTARTED, "connected again"), *s[CUT:]]


def clock_begins_again(s: list[JointSample]) -> Script:
    return [*later(s[:CUT], 50.0), *s[CUT:]]


def flood(s: list[JointSample]) -> Script:
    close = [at(s[CUT], stamp_s=s[CUT].stamp_s + 1e-4 * k) for k in range(1, 30)]
    return [*s[:CUT], *close, *s[CUT + 1 :]]


CHANGES = (silence, connection_made_anew, clock_begins_again, flood)


def watch(folder: Path, script: Script, rearm_s: float, **detector: object) -> tuple[Heard, list[tuple[str, int]]]:
    heard, said = Heard(), []
    source = SimpleNamespace(answer=lambda answer, number: said.append((answer, number)))
    settings = MonitorSettings(stop_after_s=0.1, rearm_s=rearm_s)
    Monitor(loaded(folder, **detector), ScriptedSource(script), [AnswerOutput(source, "stop"), heard], settings).run()
    return heard, said


@pytest.mark.parametrize("change", CHANGES)
def test_the_first_alarm_stands_for_good(tmp_path: Path, change: object) -> None:
    """With an infinite time to rearm: over a silence, too, behind which there is even another push."""
    log = motion(700, push_Nm=25.0, at=AT, until=UNTIL)
    assert log.tau is not None
    log.tau[400:430, 1] += 25.0
    heard, said = watch(tmp_path, change(samples(log)), math.inf)  # type: ignore[operator]
    assert len(heard.alarms) == 1
    first = next(k for k, tick in enumerate(heard.ticks) if tick.alarm)
    assert {(tick.alarm, tick.stop) for tick in heard.ticks[first:]} == {(True, True)}
    assert {tick.state for tick in heard.ticks[first:]} == {"alarm", "no_data"}
    assert [loss.alarm for loss in heard.losses] == [True] * len(heard.losses)
    # What the robot was told is not taken back.
    assert said == [("stop", 1)]


@pytest.mark.parametrize("change", CHANGES)
def test_what_is_not_seen_does_not_count_as_quiet(tmp_path: Path, change: object) -> None:
    """Behind a silence the alarm stands until so long a time was judged and quiet."""
    log = motion(700, push_Nm=25.0, at=AT, until=UNTIL)
    heard, said = watch(tmp_path, change(samples(log)), 0.5)  # type: ignore[operator]
    states = [tick.state for tick in heard.ticks]
    (end,) = [k for k, (a, b) in enumerate(pairwise(states)) if (a, b) == ("alarm", "monitoring")]
    last_without = max(k for k in range(end) if states[k] == "no_data")
    quiet = heard.ticks[end].stamp_s - heard.ticks[last_without + 1].stamp_s
    assert quiet == pytest.approx(0.5, abs=1.5 * DT)
    assert said == [("stop", 1), ("none", 1)]


def test_a_detector_that_arms_itself_judges_nothing(tmp_path: Path) -> None:
    """Behind a silence it begins so: the alarm stands until it is over, and so long a time was quiet."""
    arming, rearm, cut = 0.4, 0.2, 350
    s = samples(motion(900, push_Nm=25.0, at=300, until=320))
    heard, _ = watch(tmp_path, [*s[:cut], None, None, None, *later(s[cut:], 0.15)], rearm, arming_delay_s=arming)
    assert len(heard.alarms) == 1
    (end,) = [k for k, (a, b) in enumerate(pairwise(tick.alarm for tick in heard.ticks)) if (a, b) == (True, False)]
    (again,) = [k for k, (a, b) in enumerate(pairwise(tick.stamp_s for tick in heard.ticks)) if b - a > 0.1]
    assert heard.ticks[end].stamp_s - heard.ticks[again + 1].stamp_s > arming + rearm - 2 * DT
