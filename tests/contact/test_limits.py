"""Limit tables: the figures, the five classic mistakes, which pressure area counts, and unknown names."""

from __future__ import annotations

import dataclasses
import doctest
import re
from pathlib import Path
from typing import Any

import pytest

from bumpstop.contact import LimitTable, PressureArea, Region, builtin_tables
from bumpstop.errors import InputError
from contact.table_cases import REGION, area, load

BGIA = LimitTable.load("bgia2011")
TS = LimitTable.load("ts15066")

# region: clamping [N], impact [N], stress [N/cm²], compression constant [N/mm]
BGIA_ROWS = {
    "cranium_forehead": (130, 175, 30, 150),
    "face": (65, 90, 20, 75),
    "neck_side": (145, 190, 50, 50),
    "neck_front": (35, 35, 10, 10),
    "back_shoulders": (210, 250, 70, 35),
    "chest": (140, 210, 45, 25),
    "stomach": (110, 160, 35, 10),
    "pelvis": (180, 250, 75, 25),
    "bottom": (210, 250, 80, 15),
    "upper_arm_elbow": (150, 190, 50, 30),
    "lower_arm_wrist": (160, 220, 50, 40),
    "hand_finger": (135, 180, 60, 75),
    "thigh_knee": (220, 250, 80, 50),
    "lower_leg": (140, 170, 45, 60),
    "foot_toes_ankle": (125, 160, 45, 75),
}

# region: quasi-static force [N], transient force [N] (None: not permitted), spring [N/mm], mass [kg]
TS_ROWS = {
    "skull_forehead": (130, None, 150, 4.4),
    "face": (65, None, 75, 4.4),
    "neck": (150, 300, 50, 1.2),
    "back_shoulders": (210, 420, 35, 40),
    "chest": (140, 280, 25, 40),
    "abdomen": (110, 220, 10, 40),
    "pelvis": (180, 360, 25, 40),
    "upper_arm_elbow": (150, 300, 30, 3),
    "lower_arm_wrist": (160, 320, 40, 2),
    "hand_finger": (140, 280, 75, 0.6),
    "thigh_knee": (220, 440, 50, 75),
    "lower_leg": (130, 260, 60, 75),
}

# number, label, region, quasi-static pressure [N/cm²], transient pressure (None: not permitted), status
TS_AREAS = [
    (1, "middle of forehead", "skull_forehead", 130, None, "multi"),
    (2, "temple", "skull_forehead", 110, None, "multi"),
    (3, "masticatory muscle", "face", 110, None, "multi"),
    (4, "neck muscle", "neck", 140, 280, "multi"),
    (5, "seventh neck (cervical) vertebra/muscle", "neck", 210, 420, "multi"),
    (6, "shoulder joint", "back_shoulders", 160, 320, "multi"),
    (7, "fifth lumbar vertebra", "back_shoulders", 210, 420, "single"),
    (8, "sternum", "chest", 120, 240, "multi"),
    (9, "pectoral muscle", "chest", 170, 340, "multi"),
    (10, "abdominal muscle", "abdomen", 140, 280, "single"),
    (11, "pelvic bone", "pelvis", 210, 420, "single"),
    (12, "deltoid muscle", "upper_arm_elbow", 190, 380, "multi"),
    (13, "humerus", "upper_arm_elbow", 220, 440, "multi"),
    (14, "radial bone", "lower_arm_wrist", 190, 380, "multi"),
    (15, "forearm muscle", "lower_arm_wrist", 180, 360, "multi"),
    (16, "arm nerve", "lower_arm_wrist", 180, 360, "multi"),
    (17, "forefinger pad (dominant)", "hand_finger", 300, 600, "multi"),
    (18, "forefinger pad (non_dominant)", "hand_finger", 270, 540, "single"),
    (19, "forefinger end joint (dominant)", "hand_finger", 280, 560, "multi"),
    (20, "forefinger end joint (non_dominant)", "hand_finger", 220, 440, "single"),
    (21, "thenar eminence", "hand_finger", 200, 400, "multi"),
    (22, "palm (dominant)", "hand_finger", 260, 520, "multi"),
    (23, "palm (non_dominant)", "hand_finger", 260, 520, "single"),
    (24, "back of hand (dominant)", "hand_finger", 200, 400, "multi"),
    (25, "back of hand (non_dominant)", "hand_finger", 190, 380, "single"),
    (26, "thigh muscle", "thigh_knee", 250, 500, "multi"),
    (27, "kneecap", "thigh_knee", 220, 440, "single"),
    (28, "middle of shin", "lower_leg", 220, 440, "single"),
    (29, "calf muscle", "lower_leg", 210, 420, "single"),
]


# The figures.


def test_bgia_rows() -> None:
    rows = {
        region.name: (region.force_N, region.transient_force_N, area.pressure_N_cm2, region.spring_N_mm)
        for region, area in zip(BGIA.regions, BGIA.areas, strict=True)
        if region.name == area.region
    }
    assert rows == BGIA_ROWS
    assert all(region.effective_mass_kg is None for region in BGIA.regions)


def test_ts15066_rows() -> None:
    rows = {
        region.name: (region.force_N, region.transient_force_N, region.spring_N_mm, region.effective_mass_kg)
        for region in TS.regions
    }
    assert rows == TS_ROWS
    areas = [
        (
            area.number,
            area.label,
            area.region,
            area.pressure_N_cm2,
            area.transient_pressure_N_cm2,
            area.status,
        )
        for area in TS.areas
    ]
    assert areas == TS_AREAS


@pytest.mark.parametrize("name", builtin_tables())
def test_every_row_carries_source_and_status(name: str) -> None:
    table = LimitTable.load(name)
    assert table.name == name
    assert table.title
    assert table.note
    rows: list[Region | PressureArea] = [*table.regions, *table.areas]
    for row in rows:
        assert len(row.source) > 10
        assert row.status in ("single", "multi", "unrecorded")


def test_no_ts15066_region_claims_an_agreement_nobody_recorded() -> None:
    assert {region.status for region in TS.regions} == {"unrecorded"}


def test_objects_are_immutable() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        BGIA.regions[0].force_N = 1000.0  # type: ignore[misc]
    with pytest.raises(dataclasses.FrozenInstanceError):
        BGIA.contact_limits("chest", "clamped").force_N = 1000.0  # type: ignore[misc]


# The five classic mistakes in public code that encodes these tables.


def test_mistake_1_quasi_static_and_transient_are_neither_swapped_nor_halved() -> None:
    clamped, free = (TS.contact_limits("lower_arm_wrist", kind) for kind in ("clamped", "free"))
    assert (clamped.force_N, clamped.pressure_N_cm2) == (160, 180)
    assert (free.force_N, free.pressure_N_cm2) == (320, 360)
    clamped, free = (BGIA.contact_limits("lower_arm_wrist", kind) for kind in ("clamped", "free"))
    assert (clamped.force_N, clamped.pressure_N_cm2) == (160, 50)
    assert (free.force_N, free.pressure_N_cm2) == (220, 50)


def test_mistake_2_newtons_and_newtons_per_cm2_are_not_swapped() -> None:
    # 140 N and 120 N/cm² on the chest are close enough to be mistaken for each other.
    chest = TS.contact_limits("chest", "clamped")
    assert (chest.force_N, chest.pressure_N_cm2) == (140, 120)
    assert chest.allowed_force_N(0.5) == 60
    assert chest.crossing_area_cm2 == pytest.approx(140 / 120, rel=1e-15)
    # The spring is tabulated in N/mm and handed on in N/m.
    assert chest.stiffness_N_m == 25_000


def test_mistake_3_the_two_tables_are_not_mixed() -> None:
    for region in {row.name for row in BGIA.regions} & {row.name for row in TS.regions}:
        bgia, ts = (table.contact_limits(region, "clamped") for table in (BGIA, TS))
        assert (bgia.table, ts.table) == ("bgia2011", "ts15066")
        assert "BGIA" in bgia.force_source
        assert "BGIA" in str(bgia.pressure_source)
        assert "15066" in ts.force_source
        assert "15066" in str(ts.pressure_source)
        assert bgia.effective_mass_kg is None
        assert ts.effective_mass_kg is not None
        assert bgia.pressure_N_cm2 is not None
        assert ts.pressure_N_cm2 is not None
        assert ts.pressure_N_cm2 > 2 * bgia.pressure_N_cm2
    assert BGIA.contact_limits("hand_finger", "clamped").force_N == 135
    assert TS.contact_limits("hand_finger", "clamped").force_N == 140


@pytest.mark.parametrize("region", ["skull_forehead", "face"])
def test_mistake_4_no_transient_limit_for_the_head(region: str) -> None:
    free = TS.contact_limits(region, "free")
    assert not free.permitted
    assert "does not permit transient contact" in free.reason
    assert (free.force_N, free.pressure_N_cm2) == (0, 0)
    assert free.crossing_area_cm2 is None
    assert free.allowed_force_N(100.0) == 0
    clamped = TS.contact_limits(region, "clamped")
    assert clamped.permitted
    assert clamped.reason == ""
    assert clamped.force_N > 0


def test_mistake_4_bgia_has_its_own_impact_values_for_the_head() -> None:
    assert BGIA.contact_limits("cranium_forehead", "free").force_N == 175
    assert BGIA.contact_limits("face", "free").force_N == 90


def test_mistake_4_only_the_head_is_barred_from_transient_contact() -> None:
    barred = {row.name for row in TS.regions if not TS.contact_limits(row.name, "free").permitted}
    assert barred == {"skull_forehead", "face"}
    assert all(BGIA.contact_limits(row.name, "free").permitted for row in BGIA.regions)


def test_mistake_5_a_regions_force_is_not_the_limit_of_one_small_area() -> None:
    # 140 N is for the whole hand; a 0.25 cm² edge on the back of the hand may push with 190 N/cm² x 0.25 cm².
    hand = TS.contact_limits("hand_finger", "clamped")
    assert hand.allowed_force_N(0.25) == 47.5
    assert hand.governing(0.25) == "pressure"
    # The force limit belongs to the region whichever spot is hit, the pressure limit to the spot.
    for spot in TS.areas_of("hand_finger"):
        limits = TS.contact_limits("hand_finger", "clamped", spot.label)
        assert limits.force_N == 140
        assert limits.pressure_N_cm2 == spot.pressure_N_cm2
    # A spot's limit is not available to another region.
    with pytest.raises(InputError, match=r"'palm' is not a pressure area of chest"):
        TS.contact_limits("chest", "clamped", "palm")


# Which pressure area counts.


@pytest.mark.parametrize(
    ("wanted", "label", "pressure", "status"),
    [
        (None, "back of hand (non_dominant)", 190, "single"),
        ("forefinger pad", "forefinger pad (non_dominant)", 270, "single"),
        ("forefinger pad (dominant)", "forefinger pad (dominant)", 300, "multi"),
        ("palm", "palm (dominant)", 260, "multi"),
        ("thenar eminence", "thenar eminence", 200, "multi"),
    ],
)
def test_pressure_area(wanted: str | None, label: str, pressure: float, status: str) -> None:
    limits = TS.contact_limits("hand_finger", "clamped", wanted)
    assert (limits.pressure_area, limits.pressure_N_cm2, limits.pressure_status) == (label, pressure, status)
    assert limits.force_status == "unrecorded"


def test_lowest_area_is_the_lowest_for_that_kind_of_contact(tmp_path: Path) -> None:
    table = load(
        tmp_path,
        REGION
        + area('name = "soft"', pressure=100, transient="transient_pressure_N_cm2 = 300")
        + area('name = "hard"', pressure=150, transient="transient_pressure_N_cm2 = 160"),
    )
    assert table.contact_limits("tail", "clamped").pressure_area == "soft"
    assert table.contact_limits("tail", "free").pressure_area == "hard"


def test_unknown_pressure_area_offers_the_regions_own() -> None:
    with pytest.raises(InputError) as refusal:
        TS.contact_limits("hand_finger", "clamped", "plam")
    assert refusal.value.field == "contact.pressure_area"
    assert "'palm'" in refusal.value.valid
    with pytest.raises(InputError) as refusal:
        TS.contact_limits("chest", "clamped", "xyz")
    assert refusal.value.valid == "valid: sternum, pectoral muscle"


# Unknown names.


def test_unknown_table() -> None:
    with pytest.raises(InputError) as refusal:
        LimitTable.load("bgia")
    assert refusal.value.field == "contact.limits"
    assert "did you mean 'bgia2011'?" in refusal.value.valid


def test_unknown_region_names_near_matches() -> None:
    with pytest.raises(InputError) as refusal:
        TS.region("hand_fingers")
    assert refusal.value.field == "contact.body"
    assert "'hand_finger'" in refusal.value.valid


@pytest.mark.parametrize(("table", "name", "owner"), [(BGIA, "abdomen", "ts15066"), (TS, "stomach", "bgia2011")])
def test_region_of_the_other_table(table: LimitTable, name: str, owner: str) -> None:
    with pytest.raises(InputError, match=f"not a region of {table.name} but of {owner}"):
        table.contact_limits(name, "clamped")


def test_unknown_kind() -> None:
    wrong: Any = "transient"
    with pytest.raises(InputError, match=r"contact\.kind: 'transient'.*'free' \(transient limits\)"):
        TS.contact_limits("chest", wrong)


# The page about all this.

PAGE = Path(__file__).parents[2] / "docs" / "reference" / "contact.md"


def test_the_page_tells_the_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = PAGE.read_text(encoding="utf-8")
    (example,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    (tmp_path / "press_cell.toml").write_text(example, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    session = "\n".join(re.findall(r"```pycon\n(.*?)```", text, re.DOTALL))
    test = doctest.DocTestParser().get_doctest(session, {}, PAGE.name, str(PAGE), 0)
    assert len(test.examples) > 10
    report: list[str] = []
    failed, _ = doctest.DocTestRunner(verbose=False).run(test, out=report.append)
    assert failed == 0, "".join(report)
