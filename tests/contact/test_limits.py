"""Limit tables: the figures, the five classic mistakes, every refusal, and the limits of one contact."""

from __future__ import annotations

import dataclasses
import doctest
import math
import re
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bumpstop.contact import ContactLimits, LimitTable, PressureArea, Region, builtin_tables
from bumpstop.errors import InputError

BGIA = LimitTable.load("bgia2011")
TS = LimitTable.load("ts15066")

# region: clamping [N], impact [N], stress [N/cm2], compression constant [N/mm]
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

# number, label, region, quasi-static pressure [N/cm2], transient pressure (None: not permitted), status
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
    # 140 N and 120 N/cm2 on the chest are close enough to be mistaken for each other unnoticed.
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
    # 140 N is for the whole hand; a 0.25 cm2 edge on the back of the hand may push with 190 N/cm2 x 0.25 cm2.
    hand = TS.contact_limits("hand_finger", "clamped")
    assert hand.allowed_force_N(0.25) == 47.5
    assert hand.governing(0.25) == "pressure"
    # The force limit belongs to the region whichever spot is hit, the pressure limit to the spot.
    for area in TS.areas_of("hand_finger"):
        limits = TS.contact_limits("hand_finger", "clamped", area.label)
        assert limits.force_N == 140
        assert limits.pressure_N_cm2 == area.pressure_N_cm2
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


# Where force and pressure limits cross.


def test_crossing_area_of_the_cranium() -> None:
    cranium = BGIA.contact_limits("cranium_forehead", "clamped")
    crossing = cranium.crossing_area_cm2
    assert crossing == pytest.approx(130 / 30, rel=1e-15)
    # The source's two examples around figure 6.1: 1 cm2 at 40 N fails by pressure, 5 cm2 at 140 N by force.
    assert (cranium.governing(1.0), cranium.allowed_force_N(1.0)) == ("pressure", 30)
    assert (cranium.governing(5.0), cranium.allowed_force_N(5.0)) == ("force", 130)


def test_peak_factor_moves_the_crossing_outwards() -> None:
    cranium = BGIA.contact_limits("cranium_forehead", "clamped")
    assert (cranium.governing(5.0, 2.0), cranium.allowed_force_N(5.0, 2.0)) == ("pressure", 75)
    assert cranium.governing(2 * 130 / 30 + 0.01, 2.0) == "force"


def test_limits_met_together_are_called_force() -> None:
    chest = TS.contact_limits("chest", "clamped", "pectoral muscle")
    even = dataclasses.replace(chest, force_N=340.0)
    assert even.governing(2.0) == "force"


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_impossible_area_is_refused(bad: float) -> None:
    limits = TS.contact_limits("chest", "clamped")
    with pytest.raises(InputError, match=r"contact\.area_cm2"):
        limits.allowed_force_N(bad)
    with pytest.raises(InputError, match=r"contact\.area_cm2"):
        limits.governing(bad)


@pytest.mark.parametrize("bad", [0.99, -1.0, math.nan, math.inf])
def test_impossible_peak_factor_is_refused(bad: float) -> None:
    limits = TS.contact_limits("chest", "clamped")
    with pytest.raises(InputError, match=r"contact\.peak_factor"):
        limits.allowed_force_N(1.0, bad)


ALL_LIMITS = [
    table.contact_limits(region.name, kind)
    for table in (BGIA, TS)
    for region in table.regions
    for kind in ("clamped", "free")
]
permitted_limits = st.sampled_from([limits for limits in ALL_LIMITS if limits.permitted])
areas_cm2 = st.floats(1e-3, 1e3)
peak_factors = st.floats(1.0, 10.0)


@given(st.sampled_from(ALL_LIMITS), areas_cm2, areas_cm2, peak_factors)
def test_allowed_force_never_falls_as_the_area_grows(
    limits: ContactLimits, one: float, other: float, peak_factor: float
) -> None:
    small, large = sorted((one, other))
    assert limits.allowed_force_N(small, peak_factor) <= limits.allowed_force_N(large, peak_factor)


@given(permitted_limits, st.floats(1.0 + 1e-12, 100.0), peak_factors)
def test_above_the_crossing_the_force_limit_governs(limits: ContactLimits, beyond: float, peak_factor: float) -> None:
    assert limits.crossing_area_cm2 is not None
    area_cm2 = limits.crossing_area_cm2 * peak_factor * beyond
    assert limits.governing(area_cm2, peak_factor) == "force"
    assert limits.allowed_force_N(area_cm2, peak_factor) == limits.force_N


@given(permitted_limits, st.floats(1e-3, 1.0 - 1e-12), peak_factors)
def test_below_the_crossing_the_pressure_limit_governs(limits: ContactLimits, share: float, peak_factor: float) -> None:
    assert limits.crossing_area_cm2 is not None
    area_cm2 = limits.crossing_area_cm2 * peak_factor * share
    assert limits.governing(area_cm2, peak_factor) == "pressure"
    # Four roundings of relative size 2^-53 lie between the two expressions.
    assert limits.allowed_force_N(area_cm2, peak_factor) == pytest.approx(limits.force_N * share, rel=1e-15)


# User tables.

HEAD = """
name = "mine"
title = "My own table"
source = "my measurements"
status = "measured once"
"""

REGION = """
[[region]]
name = "tail"
force_N = 100
transient_multiplier = 1.5
spring_N_mm = 20
"""


def area(lines: str, pressure: float = 200, transient: str = "transient_multiplier = 2") -> str:
    return f'[[area]]\nregion = "tail"\n{lines}\npressure_N_cm2 = {pressure}\n{transient}\n'


TIP = area('name = "tip"')


def load(folder: Path, rows: str, head: str = HEAD) -> LimitTable:
    (folder / "mine.toml").write_text(head + rows, encoding="utf-8")
    return LimitTable.load("mine.toml", relative_to=folder)


def refusal_of(folder: Path, rows: str, head: str = HEAD) -> InputError:
    with pytest.raises(InputError) as refusal:
        load(folder, rows, head)
    message = str(refusal.value)
    assert "mine.toml" in message
    assert "\n" not in message
    return refusal.value


def test_a_user_table(tmp_path: Path) -> None:
    table = load(tmp_path, REGION + TIP)
    region = table.region("tail")
    assert (region.label, region.effective_mass_kg) == ("tail", None)
    limits = table.contact_limits("tail", "free")
    assert (limits.force_N, limits.pressure_N_cm2, limits.stiffness_N_m) == (150, 400, 20_000)
    assert (limits.force_source, limits.force_status) == ("my measurements", "measured once")
    assert (limits.pressure_source, limits.pressure_status) == ("my measurements", "measured once")


def test_a_row_may_name_its_own_source_and_status(tmp_path: Path) -> None:
    own = 'source = "my neighbour"\nstatus = "guessed"\n'
    limits = load(tmp_path, REGION + own + TIP).contact_limits("tail", "clamped")
    assert (limits.force_source, limits.force_status) == ("my neighbour", "guessed")
    assert (limits.pressure_source, limits.pressure_status) == ("my measurements", "measured once")


def test_a_path_may_be_absolute(tmp_path: Path) -> None:
    load(tmp_path, REGION)
    file = tmp_path / "mine.toml"
    assert LimitTable.load(file) == LimitTable.load(str(file), relative_to="/nowhere")


def test_a_path_object_is_a_path_even_if_it_reads_like_a_name(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot read '.*ts15066'"):
        LimitTable.load(Path("ts15066"), relative_to=tmp_path)


def test_without_pressure_areas_only_the_force_limit_counts(tmp_path: Path) -> None:
    table = load(tmp_path, REGION)
    limits = table.contact_limits("tail", "clamped")
    assert limits.pressure_N_cm2 is None
    assert (limits.pressure_area, limits.pressure_source, limits.pressure_status) == (None, None, None)
    assert limits.crossing_area_cm2 is None
    assert (limits.allowed_force_N(0.01), limits.governing(0.01)) == (100, "force")
    with pytest.raises(InputError, match="the region has no pressure limits"):
        table.contact_limits("tail", "clamped", "tip")


def test_a_user_table_may_bar_transient_contact(tmp_path: Path) -> None:
    barred = REGION.replace("1.5", "0")
    table = load(tmp_path, barred + area('name = "tip"', transient="transient_multiplier = 0"))
    limits = table.contact_limits("tail", "free")
    assert not limits.permitted
    assert limits.reason == "mine does not permit transient contact with this region (tail), at any force."


def test_absent_file(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refusal:
        LimitTable.load("nothing.toml", relative_to=tmp_path)
    assert refusal.value.field == "contact.limits"
    assert str(tmp_path / "nothing.toml") in refusal.value.problem
    assert "bgia2011, ts15066" in refusal.value.valid


@pytest.mark.parametrize("path", ["a\0b.toml", "."])
def test_unreadable_file(tmp_path: Path, path: str) -> None:
    with pytest.raises(InputError, match="cannot read"):
        LimitTable.load(Path(path), relative_to=tmp_path)


@pytest.mark.parametrize("content", [b"name = ", b"\xff\xfe", b"x = 1" + b"0" * 5000, b"x = " + b"[" * 100_000])
def test_damaged_toml(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "damaged.toml"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"damaged\.toml: damaged TOML"):
        LimitTable.load(file)


def test_unknown_keys(tmp_path: Path) -> None:
    error = refusal_of(tmp_path, REGION, head=HEAD + 'titel = "x"\n')
    assert (error.problem, error.valid) == ("unknown key 'titel'", "did you mean 'title'?")
    error = refusal_of(tmp_path, REGION + "spring_N_m = 75000\n")
    assert error.field.endswith("mine.toml [[region]] 1 ('tail')")
    assert "'spring_N_mm'" in error.valid
    error = refusal_of(tmp_path, REGION + TIP + "presure = 3\n")
    assert error.field.endswith("mine.toml [[area]] 1 ('tip')")


@pytest.mark.parametrize("key", ["name", "title", "source", "status"])
def test_missing_key_of_the_table(tmp_path: Path, key: str) -> None:
    error = refusal_of(tmp_path, REGION, head=re.sub(rf"(?m)^{key} = .*\n", "", HEAD))
    assert error.field.endswith(f"mine.toml {key}")
    assert error.problem == "missing"


@pytest.mark.parametrize("key", ["name", "force_N", "spring_N_mm"])
def test_missing_key_of_a_region(tmp_path: Path, key: str) -> None:
    error = refusal_of(tmp_path, re.sub(rf"(?m)^{key} = .*\n", "", REGION))
    assert error.field.endswith(f" {key}")
    assert error.problem == "missing"


@pytest.mark.parametrize("key", ["name", "region", "pressure_N_cm2"])
def test_missing_key_of_an_area(tmp_path: Path, key: str) -> None:
    error = refusal_of(tmp_path, REGION + re.sub(rf"(?m)^{key} = .*\n", "", TIP))
    assert error.field.endswith(f" {key}")
    assert error.problem == "missing"


def test_no_region_at_all(tmp_path: Path) -> None:
    assert refusal_of(tmp_path, "").problem == "no [[region]]"


@pytest.mark.parametrize("rows", ["[region]\nname = 'tail'\n", "region = 3\n", "region = [1, 2]\n"])
def test_single_brackets(tmp_path: Path, rows: str) -> None:
    assert refusal_of(tmp_path, rows).valid == "begin each row with [[region]]"


NO_NUMBERS = [
    '"many"',
    "true",
    "nan",
    "inf",
    "-inf",
    "-5",
    "0",
    "1e300",
    "1" + "0" * 400,
    "[1]",
    "2020-01-01",
]


@pytest.mark.parametrize("value", NO_NUMBERS)
@pytest.mark.parametrize("key", ["force_N", "spring_N_mm", "effective_mass_kg"])
def test_impossible_figure_in_a_region(tmp_path: Path, key: str, value: str) -> None:
    rows = re.sub(rf"(?m)^{key} = .*\n", "", REGION) + f"{key} = {value}\n"
    assert refusal_of(tmp_path, rows).field.endswith(f"mine.toml [[region]] 1 ('tail') {key}")


@pytest.mark.parametrize("value", NO_NUMBERS)
def test_impossible_transient_force(tmp_path: Path, value: str) -> None:
    rows = REGION.replace("transient_multiplier = 1.5", f"transient_force_N = {value}")
    assert refusal_of(tmp_path, rows).field.endswith(" transient_force_N")


@pytest.mark.parametrize("value", [value for value in NO_NUMBERS if value != "0"] + ["false"])
def test_impossible_multiplier(tmp_path: Path, value: str) -> None:
    error = refusal_of(tmp_path, REGION.replace("1.5", value))
    assert error.field.endswith(" transient_multiplier")
    assert "0 (not permitted)" in error.valid


@pytest.mark.parametrize("value", NO_NUMBERS)
@pytest.mark.parametrize("key", ["pressure_N_cm2", "transient_pressure_N_cm2"])
def test_impossible_pressure(tmp_path: Path, key: str, value: str) -> None:
    row = area('name = "tip"', transient="transient_pressure_N_cm2 = 300")
    rows = REGION + re.sub(rf"(?m)^{key} = .*\n", "", row) + f"{key} = {value}\n"
    assert refusal_of(tmp_path, rows).field.endswith(f"mine.toml [[area]] 1 ('tip') {key}")


@pytest.mark.parametrize("key", ["name", "label", "source", "status"])
@pytest.mark.parametrize("value", ["3", '""', '"  "'])
def test_text_keys_take_text(tmp_path: Path, key: str, value: str) -> None:
    rows = re.sub(rf"(?m)^{key} = .*\n", "", REGION) + f"{key} = {value}\n"
    assert refusal_of(tmp_path, rows).field.endswith(f" {key}")


@pytest.mark.parametrize("value", ["0", "-1", "1.5", "true", '"one"'])
def test_row_numbers_are_whole(tmp_path: Path, value: str) -> None:
    assert refusal_of(tmp_path, REGION + TIP + f"number = {value}\n").field.endswith(" number")


def test_exactly_one_transient_form(tmp_path: Path) -> None:
    assert "both of" in refusal_of(tmp_path, REGION + "transient_force_N = 200\n").problem
    error = refusal_of(tmp_path, REGION.replace("transient_multiplier = 1.5\n", ""))
    assert error.problem == "neither of transient_multiplier and transient_force_N given"
    both = TIP + "transient_pressure_N_cm2 = 500\n"
    assert "both of" in refusal_of(tmp_path, REGION + both).problem
    assert "neither of" in refusal_of(tmp_path, REGION + area('name = "tip"', transient="")).problem


@pytest.mark.parametrize("transient", ["transient_multiplier = 0.5", "transient_force_N = 99.9"])
def test_a_transient_limit_below_the_quasi_static_one(tmp_path: Path, transient: str) -> None:
    error = refusal_of(tmp_path, REGION.replace("transient_multiplier = 1.5", transient))
    assert "below the quasi-static force_N = 100" in error.problem
    assert "swapped?" in error.valid


def test_region_twice(tmp_path: Path) -> None:
    error = refusal_of(tmp_path, REGION + REGION)
    assert error.field.endswith("[[region]] 2 ('tail') name")
    assert "appears twice" in error.problem


def test_area_twice(tmp_path: Path) -> None:
    assert "'tip' appears twice in 'tail'" in refusal_of(tmp_path, REGION + TIP + TIP).problem
    sides = TIP + 'side = "left"\n' + TIP + 'side = "right"\n'
    assert len(load(tmp_path, REGION + sides).areas_of("tail")) == 2
    same_side = 2 * (TIP + 'side = "left"\n')
    assert "'tip (left)' appears twice in 'tail'" in refusal_of(tmp_path, REGION + same_side).problem


def test_area_of_an_unknown_region(tmp_path: Path) -> None:
    error = refusal_of(tmp_path, REGION + TIP.replace("tail", "tial"))
    assert "'tial' is not a region of this table" in error.problem
    assert error.valid == "did you mean 'tail'?"


def test_region_and_area_disagree_on_permission(tmp_path: Path) -> None:
    barred = area('name = "tip"', transient="transient_multiplier = 0")
    assert "disagrees with its region" in refusal_of(tmp_path, REGION + barred).problem
    assert "disagrees with its region" in refusal_of(tmp_path, REGION.replace("1.5", "0") + TIP).problem


@pytest.mark.parametrize("name", builtin_tables())
def test_a_user_table_may_not_pass_for_a_built_in_one(tmp_path: Path, name: str) -> None:
    error = refusal_of(tmp_path, REGION, head=HEAD.replace("mine", name))
    assert "is the name of a built-in table" in error.problem


# The page about all this.

PAGE = Path(__file__).parents[2] / "docs" / "contact.md"


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
