"""What measured pressures say of outcomes: each is held against the limit of its phase of contact."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

import bumpstop as bs
from bumpstop.register import RegisterError, RegisterResult
from bumpstop.register.measured import judge_by_shots, judged_shots
from bumpstop.register.shots import COLUMNS, Shot, load_shots
from bumpstop.report.register.dossier import DossierHead, write_dossier
from register.cases import write_register

ROW: dict[str, Any] = {"name": "a", "speed_mm_s": 50}
TWO_PHASES = ROW | {"contact.limits": "ts15066", "verdict.clamped_limit": "two_phase"}


def shot(pressure: float, speed: float = 50.0, **known: Any) -> Shot:
    made = Shot(situation="a", shot="1", speed_mm_s=speed, predicted_N=88, low_N=80, high_N=95, measured_N=90)
    return replace(made, pressure_N_cm2=pressure, **known)


def result_of(folder: Path, row: dict[str, Any]) -> RegisterResult:
    return bs.evaluate_register(bs.load_register(write_register(folder, row)))


def without_pressure_limit(result: RegisterResult) -> RegisterResult:
    """As of a table that has none for the region."""
    (one,) = result.results
    assert one.verdict.limits is not None
    limits = replace(one.verdict.limits, pressure_N_cm2=None)
    return RegisterResult(result.register, (replace(one, verdict=replace(one.verdict, limits=limits)),))


def test_a_pressure_above_its_limit_fails(tmp_path: Path) -> None:
    result = result_of(tmp_path, ROW)
    (one,) = result.results
    assert one.outcome == "pass"
    assert one.verdict.limits is not None
    limit = one.verdict.limits.pressure_N_cm2
    assert limit is not None
    for pressure, speed, outcome in (
        (limit + 0.01, 50, "fail"),
        (limit, 50, "pass"),
        (limit + 0.01, 40, "fail"),
        (limit + 0.01, 51, "pass"),
        (math.nan, 50, "pass"),
    ):
        assert judge_by_shots(result, [shot(pressure, speed)]).outcome == outcome, (pressure, speed)
        # Without a limit of pressure the shot is as if it had none.
        (told,), (bare,) = (
            judge_by_shots(without_pressure_limit(result), [shot(each, speed)]).results for each in (pressure, math.nan)
        )
        assert (told.outcome, told.reason) == (bare.outcome, bare.reason)
        assert told.outcome != "fail"
    (found,) = judge_by_shots(result, [shot(limit + 0.01), shot(limit + 1.25)]).results
    said = f"at 50 mm/s measured a pressure of {limit + 1.25:.15g} N/cm², above the limit of {limit:g} N/cm²."
    assert said in found.reason
    (found,) = judge_by_shots(result, [shot(math.nan, lasting_pressure_N_cm2=limit + 1)]).results
    assert found.outcome == "fail"
    assert f"measured a pressure of {limit + 1:g} N/cm² after the first 0.5 s, above the limit of" in found.reason
    failing = RegisterResult(result.register, (replace(one, outcome="fail", reason="as computed"),))
    assert judge_by_shots(failing, [shot(1.0)]).results == failing.results


def test_each_phase_of_a_pressure_has_its_limit(tmp_path: Path) -> None:
    """Contact judged in two phases: the transient limit is that of the first half second, not of what lasts."""
    result = result_of(tmp_path, TWO_PHASES)
    (one,) = result.results
    assert one.outcome == "pass"
    assert one.verdict.limits is not None
    assert one.verdict.transient is not None
    limit, first = one.verdict.limits.pressure_N_cm2, one.verdict.transient.pressure_N_cm2
    assert limit is not None
    assert first is not None
    assert first > limit
    for pressure, lasting, outcome in (
        (limit + 1, 40, "pass"),
        (limit + 1, limit + 0.5, "fail"),
        (first + 1, 40, "fail"),
    ):
        made = shot(pressure, lasting_pressure_N_cm2=lasting)
        assert judge_by_shots(result, [made]).outcome == outcome, (pressure, lasting)


def test_a_pressure_without_a_peak_force(tmp_path: Path) -> None:
    """A film of which nobody wrote the force down, and a recording whose force cannot be relied on."""
    result = result_of(tmp_path, ROW)
    for pressure, known, outcome, said in (
        (1000.0, {}, "fail", "Shot 1 at 50 mm/s measured a pressure of 1000 N/cm², above the limit of"),
        (1000.0, {"unusable_recording": "s.csv"}, "fail", "measured a pressure of 1000 N/cm², above the limit of"),
        (40.0, {}, "inconclusive", "Shot 1 at 50 mm/s has no peak force: fill it in, or repeat the shot."),
        (40.0, {"unusable_recording": "s.csv"}, "inconclusive", "its recording 's.csv' cannot be relied on"),
    ):
        (found,) = judge_by_shots(result, [shot(pressure, measured_N=math.nan, **known)]).results
        assert found.outcome == outcome, (pressure, known)
        assert said in found.reason
    (bare,) = judged_shots(result, [shot(40.0, measured_N=math.nan)])
    assert bare.words == "no peak force"


def test_pressures_of_a_file_of_shots(tmp_path: Path) -> None:
    """Both may lack; a number above zero each, or nothing."""
    register = bs.load_register(write_register(tmp_path, ROW))
    path = tmp_path / "shots.csv"
    path.write_text(f"{','.join(COLUMNS)},pressure_N_cm2,lasting_pressure_N_cm2\na,1,50,,,,90,180.5,\n")
    (found,) = load_shots(path, register.situations)
    assert found.pressure_N_cm2 == 180.5
    assert math.isnan(found.lasting_pressure_N_cm2)
    for bad in ("0", "-3", "much", "inf", "nan"):
        path.write_text(f"{','.join(COLUMNS)},pressure_N_cm2\na,1,50,,,,90,{bad}\n")
        with pytest.raises(RegisterError) as refused:
            load_shots(path, register.situations)
        (fault,) = refused.value.faults
        said = f"row 2, pressure_N_cm2: '{bad}' cannot be used; wanted a number above 0 and up to 1e+06, or nothing"
        assert str(fault).endswith(said)


def test_the_dossier_shows_pressures_where_there_are_some(tmp_path: Path) -> None:
    result = result_of(tmp_path, ROW)
    head = DossierHead(cell="c", author="a", revision="b")
    shots = [
        shot(10.25, lasting_pressure_N_cm2=20.5),
        shot(math.nan, shot="2"),
        shot(31.5, shot="3", lasting_pressure_N_cm2=20.5),
    ]
    page = write_dossier(result, tmp_path / "out", head, shots).read_text(encoding="utf-8")
    (part,) = [text for text in page.split("<section") if 'id="measurements"' in text]
    assert "pressure, N/cm²" in part
    assert "10.25, 20.5 after 0.5 s" in part
    assert "31.5, 20.5" not in part
    page = write_dossier(result, tmp_path / "out", head, shots[1:2]).read_text(encoding="utf-8")
    (part,) = [text for text in page.split("<section") if 'id="measurements"' in text]
    assert "pressure" not in part
