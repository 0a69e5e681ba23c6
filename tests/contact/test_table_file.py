"""Tables of a user's own: what a file may hold, and every refusal."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bumpstop.contact import LimitTable, builtin_tables
from bumpstop.errors import InputError
from contact.table_cases import HEAD, REGION, TIP, area, load, refusal_of


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
    with pytest.raises(InputError, match=r"ts15066' cannot be read"):
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


def test_a_file_saved_with_a_byte_order_mark(tmp_path: Path) -> None:
    load(tmp_path, REGION)
    file = tmp_path / "mine.toml"
    marked = tmp_path / "marked.toml"
    marked.write_bytes(b"\xef\xbb\xbf" + file.read_bytes().replace(b"\n", b"\r\n"))
    assert LimitTable.load(marked) == LimitTable.load(file)


def test_absent_file(tmp_path: Path) -> None:
    with pytest.raises(InputError) as refusal:
        LimitTable.load("nothing.toml", relative_to=tmp_path)
    assert refusal.value.field == "contact.limits"
    assert str(tmp_path / "nothing.toml") in refusal.value.problem
    assert "bgia2011, ts15066" in refusal.value.valid


@pytest.mark.parametrize(("path", "why"), [("a\0b.toml", "cannot be read"), (".", "is a folder")])
def test_unreadable_file(tmp_path: Path, path: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        LimitTable.load(Path(path), relative_to=tmp_path)


@pytest.mark.parametrize("content", [b"name = ", b"\xff\xfe", b"x = 1" + b"0" * 5000, b"x = " + b"[" * 100_000])
def test_damaged_toml(tmp_path: Path, content: bytes) -> None:
    file = tmp_path / "damaged.toml"
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"damaged\.toml'? is not UTF-8 text|damaged\.toml: is not valid TOML"):
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
