"""Files appear whole or not at all, everywhere."""

from __future__ import annotations

import errno
import hashlib
import math
import os
import re
import resource
import signal
import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest

import bumpstop as bs
from bumpstop.output_files import replacing, write_bytes, write_csv, write_parquet
from bumpstop.recording.formats.parquet_excel import read_parquet
from bumpstop.shards.storage import LocalStorage
from bumpstop.text_files import parse_toml, write_text
from bumpstop.view.point_rows import read_rows
from cli.support import EXAMPLE, run

SOURCE = Path(bs.__file__).parent


def test_a_failed_write_leaves_what_was_there(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    write_bytes(file, b"before")
    file.chmod(0o640)
    broken = replacing(file)
    broken.__enter__().write_bytes(b"half")
    assert len(list(tmp_path.iterdir())) == 2
    assert not broken.__exit__(KeyError, KeyError("broken"), None)
    assert file.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [file]
    write_bytes(file, b"after", durable=True)
    assert file.read_bytes() == b"after"
    assert file.stat().st_mode & 0o777 == 0o640


def test_a_file_that_may_not_be_written_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A report that was made read-only is one that is kept, though its folder lets it be replaced."""
    file = tmp_path / "report.html"
    file.write_bytes(b"signed")
    file.chmod(0o444)
    # Nobody refuses root: what its tests see is what others are told.
    monkeypatch.setattr(os, "access", lambda path, _: bool(Path(path).stat().st_mode & 0o200))
    with pytest.raises(PermissionError) as error:
        write_bytes(file, b"after")
    assert (error.value.filename, error.value.strerror) == (str(file), "Permission denied")
    assert file.read_bytes() == b"signed"
    assert list(tmp_path.iterdir()) == [file]
    refused = f"error: --out: {str(file)!r} cannot be written (Permission denied); give another folder\n"
    assert run("evaluate", EXAMPLE, "--out", tmp_path) == (2, "", refused)
    assert list(tmp_path.iterdir()) == [file]


def test_links_are_followed_and_what_is_no_file_is_written_as_it_is(tmp_path: Path) -> None:
    write_bytes(tmp_path / "there", b"1")
    (tmp_path / "link").symlink_to("there")
    write_bytes(tmp_path / "link", b"2")
    assert (tmp_path / "there").read_bytes() == b"2"
    assert (tmp_path / "link").is_symlink()
    write_bytes("/dev/null", b"3")
    assert not Path("/dev/null").is_file()


def limited(code: str, path: Path) -> subprocess.CompletedProcess[str]:
    """Run code where no file may be longer than 4096 bytes."""

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))

    return subprocess.run(
        [sys.executable, "-c", code, str(path)],
        env=os.environ | {"PYTHONPATH": str(SOURCE.parent)},
        preexec_fn=limit,
        capture_output=True,
        text=True,
        check=False,
    )


def test_a_full_disk_is_named_and_leaves_nothing(tmp_path: Path) -> None:
    """A limit of the size of files stands for it: the system ends a write in the middle, too."""

    out = tmp_path / "cell.toml"
    code = "from bumpstop.text_files import parse_toml, write_text; import sys; write_text(sys.argv[1], 'x' * 9000)"
    done = limited(code, out)
    assert "cannot be written (File too large)" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "write",
    [
        "write_parquet(path / 'rows', rows)",
        "write_csv(path / 'rows', rows)",
        "LocalStorage(path).write_rows('rows', rows, {})",
    ],
)
def test_a_disk_that_is_full_in_the_middle_of_a_table_is_an_error_of_the_system(write: str, tmp_path: Path) -> None:
    """Polars has kinds of its own for it."""
    code = f"""
import sys
from pathlib import Path
import numpy as np
import polars as pl
from bumpstop.output_files import write_csv, write_parquet
from bumpstop.shards.storage import LocalStorage
path, rows = Path(sys.argv[1]), pl.DataFrame({{"x": np.random.default_rng(1).random(9000)}})
try:
    {write}
except OSError as error:
    print(error.errno, error.strerror, error.filename)
"""
    done = limited(code, tmp_path)
    assert done.stderr == ""
    assert done.stdout == f"{errno.EFBIG} File too large {tmp_path}/rows\n"
    assert list(tmp_path.iterdir()) == []


def test_tables_are_written_and_read_under_names_that_are_no_text(tmp_path: Path) -> None:
    folder = tmp_path / os.fsdecode(b"b\xff")
    folder.mkdir()
    rows = pl.DataFrame({"t": [0.0, 0.1, 0.2, 0.3], "q_1": [0.0, 0.1, 0.0, 0.1]})
    write_csv(folder / "rows.csv", rows)
    assert (folder / "rows.csv").read_text().startswith("t,q_1\n0.0,0.0\n")
    write_parquet(folder / "rows.parquet", rows, {"robot": "mine"})
    table = read_parquet(folder / "rows.parquet")
    assert (table.names, table.robot, table.filled.size) == (("t", "q_1"), "mine", 4)
    assert table.fetch([1])[:, 0].tolist() == [0.0, 0.1, 0.0, 0.1]
    assert read_rows(folder / "rows.parquet")["q_1"].tolist() == [0.0, 0.1, 0.0, 0.1]
    storage = LocalStorage(folder)
    checksum = storage.write_rows("rows/0.parquet", rows, {})
    assert hashlib.sha256(storage.read("rows/0.parquet")).hexdigest() == checksum


def test_errors_name_the_file_that_was_asked_for(tmp_path: Path) -> None:
    with pytest.raises(bs.InputError, match=r"nowhere/a\.toml: cannot be written \(No such file or directory\)$"):
        write_text(tmp_path / "nowhere" / "a.toml", "x")


def test_every_module_writes_through_the_one_writer() -> None:
    """Names of methods that would write under the name itself."""
    own = re.compile(r"\.(?:write_text|write_bytes|savefig|to_csv)\(|\.write_(?:parquet|csv)\((?!file|joined|content)")
    # Figures go into memory, or under the name that output_files.replacing lends.
    allowed = {"benchmark.py": 1, "display.py": 2, "output_files.py": 1, "picture.py": 1, "recorder.py": 1}
    for path in SOURCE.rglob("*.py"):
        found = [line for line in path.read_text(encoding="utf-8").splitlines() if own.search(line)]
        found = [line for line in found if "output_files." not in line]
        assert len(found) <= allowed.get(path.name, 0), (path, found)


def test_integers_that_no_float_holds_are_infinite() -> None:
    """So that whoever reads the field refuses it by its name."""
    many = "0" * 400
    assert parse_toml(f"a = 1{many}", "x.toml") == {"a": math.inf}
    assert parse_toml(f"[[t]]\nb = [1, {{c = -1{many}}}]", "x.toml") == {"t": [{"b": [1, {"c": -math.inf}]}]}
    assert parse_toml("a = 18446744073709551615", "x.toml") == {"a": 2**64 - 1}


def test_a_message_of_a_thousand_words_is_cut() -> None:
    said = str(bs.InputError("key", "no word of this " * 1000, "wanted less"))
    assert len(said) < 1500
    assert said.startswith("key: no word")
    assert "wanted less" in said
