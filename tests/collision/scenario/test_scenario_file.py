"""Scenario files: what editors write is read, and what is damaged is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from bumpstop.collision import load_scenario
from bumpstop.errors import InputError
from collision.scenario_cases import EXAMPLE


def file_refusal(path: Path, content: bytes | str) -> InputError:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError) as caught:
        load_scenario(path)
    return caught.value


def test_bytes_that_windows_editors_write_are_read(tmp_path: Path) -> None:
    text = EXAMPLE.read_text(encoding="utf-8").replace("\n", "\r\n")
    path = tmp_path / "notepad.toml"
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert load_scenario(path).to_dict() == load_scenario(EXAMPLE).to_dict()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "robot: is missing"),
        (b"  \n\n", "robot: is missing"),
        (b"\0\0abc", "is not valid TOML"),
        (bytes(range(256)), "is not UTF-8 text (byte 129)"),
        ("# größer\n".encode("latin-1"), "is not UTF-8 text (byte 5); wanted a scenario file, saved as UTF-8"),
        ('robot = "sia5d"'.encode("utf-16"), "is not UTF-8 text (byte 1)"),
        ('{"robot": "sia5d"}', "is not valid TOML"),
        ("[motion\n", "is not valid TOML: Expected ']'"),
        ("robot = sia5d\n", "is not valid TOML: Invalid value (at line 1, column 9)"),
        ('robot = "a"\nrobot = "b"\n', "is not valid TOML: Cannot overwrite a value"),
        ("[motion]\n[motion]\n", "is not valid TOML: Cannot declare ('motion',) twice"),
        ("x = " + "[" * 20000 + "]" * 20000, "is nested too deeply"),
        (".".join("a" * 20000) + " = 1", "is nested too deeply"),
        ("x = " + "9" * 5000, "holds a number of thousands of digits"),
        ("x = 1\n" * 200_000, "is longer than 1000000 bytes"),
    ],
)
def test_damaged_files_are_refused(tmp_path: Path, content: bytes | str, message: str) -> None:
    path = tmp_path / "damaged.toml"
    error = file_refusal(path, content)
    assert message in str(error)
    if not message.startswith("robot"):
        assert error.field == str(path)


def test_a_comment_may_be_as_dotted_as_it_likes(tmp_path: Path) -> None:
    path = tmp_path / "dots.toml"
    path.write_text("# " + "." * 5000 + "\n" + EXAMPLE.read_text(encoding="utf-8"), encoding="utf-8")
    assert load_scenario(path).robot == "sia5d"


@pytest.mark.parametrize("name", ["absent.toml", "", "a\0b.toml", "x" * 300])
def test_what_is_no_file_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=r"(cannot be read \(.+\)|is a folder); wanted a scenario file"):
        load_scenario(tmp_path / name)
