"""The frame of all studies: shards, threads, interruptions, and folders that hold something else."""

from __future__ import annotations

import io
import os
import subprocess
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import polars as pl
import pytest

import bumpstop as bs
from bumpstop.shards import code_digest
from bumpstop.study import Study, run
from bumpstop.text_files import shell_command
from collision.cases import control_group
from study.run_cases import Squares


class BrokenError(Exception):
    """What interrupts a study in the middle."""


@dataclass(frozen=True)
class Cubes(Squares):
    """Another study, with columns of its own."""

    name: ClassVar[str] = "cubes"

    def shard(self, number: int) -> pl.DataFrame:
        return super().shard(number).rename({"square": "cube"})

    def summary(self, rows: pl.DataFrame) -> dict[str, Any]:
        return {"sum": float(rows["cube"].sum())}


def breaking(at: int) -> Any:
    def progress(done: int, total: int) -> None:
        if done == at:
            raise BrokenError

    return progress


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("at", [0, 1, 4, 7])
def test_an_interrupted_study_ends_as_an_uninterrupted_one(tmp_path: Path, threads: int, at: int) -> None:
    study = Squares(control_group(), seed=3)
    whole, summary = run(study, tmp_path / "whole")
    with pytest.raises(BrokenError):
        run(study, tmp_path / "halves", threads=threads, progress=breaking(at))
    begun = tmp_path / "halves"
    kept = len(list((begun / "shards").glob("*.arrow")))
    assert kept >= at
    assert not (begun / "rows.parquet").exists()
    seen: list[int] = []
    rows, again = run(study, begun, threads=threads, progress=lambda done, _: seen.append(done))
    assert seen[0] == kept, "what was done is not done again"
    assert rows.equals(whole)
    assert again["sum"] == summary["sum"]
    assert files(begun) == files(tmp_path / "whole")


@dataclass(frozen=True)
class Grouped(Squares):
    """The same, some shards at a time."""

    batch_size: ClassVar[int] = 3
    count: int = 24


@pytest.mark.parametrize("threads", [1, 2])
def test_shards_worked_out_together_are_kept_one_by_one(tmp_path: Path, threads: int) -> None:
    study, alone = Grouped(control_group(), seed=3), Squares(control_group(), seed=3, count=24)
    done: list[int] = []

    def progress(at: int, total: int) -> None:
        # Groups end in any order, and the later ones are smaller: which sums come along is for the threads to say.
        done.append(at)
        if at >= 6:
            raise BrokenError

    with pytest.raises(BrokenError):
        run(study, tmp_path, threads=threads, progress=progress)
    assert done[0] == 0
    assert all(1 <= more <= 3 for more in np.diff(done))
    assert threads > 1 or done == [0, 3, 6]
    kept = list((tmp_path / "shards").glob("*.arrow"))
    assert len(kept) >= done[-1]
    kept[0].unlink()
    again: list[int] = []
    rows, _ = run(study, tmp_path, threads=threads, progress=lambda at, _: again.append(at))
    assert again[0] == len(kept) - 1
    assert again[-1] == 24
    assert rows.equals(run(alone).rows)


def test_without_a_folder_the_rows_are_the_same_and_in_order(tmp_path: Path) -> None:
    study = Squares(control_group(), seed=3)
    rows, _ = run(study, threads=4)
    assert rows.equals(run(study, tmp_path).rows)
    assert rows["shard"].to_list() == sorted(rows["shard"].to_list())
    assert not rows["x"].equals(run(Squares(control_group(), seed=4)).rows["x"])


@pytest.mark.parametrize(
    ("other", "names"),
    [
        (Squares(control_group(), seed=1), "seed"),
        (Squares(control_group(), factors=(1.0, 3.0)), "factors"),
        (Squares(control_group(contact__area_cm2=2.0)), "the scenario"),
    ],
)
def test_a_folder_of_another_study_is_refused_by_name(tmp_path: Path, other: Study, names: str) -> None:
    run(Squares(control_group()), tmp_path)
    before = files(tmp_path)
    with pytest.raises(bs.InputError, match=names) as refused:
        run(other, tmp_path)
    assert refused.value.field == "--out"
    assert files(tmp_path) == before


@pytest.mark.parametrize("complete", [True, False])
def test_rows_without_settings_are_taken_for_nobodys(tmp_path: Path, complete: bool) -> None:
    if complete:
        run(Squares(control_group()), tmp_path)
    else:
        with pytest.raises(BrokenError):
            run(Squares(control_group()), tmp_path, progress=breaking(3))
    (tmp_path / "settings.toml").unlink()
    before = files(tmp_path)
    with pytest.raises(bs.InputError, match=r"without the settings\.toml"):
        run(Squares(control_group(), seed=1), tmp_path)
    assert files(tmp_path) == before


def test_settings_are_a_scenario_and_say_what_made_the_rows(tmp_path: Path) -> None:
    scenario = control_group(motion__velocity_mm_s=[0.0, 5.0, -20.0])
    run(Squares(scenario, seed=9), tmp_path, command="bumpstop study squares")
    assert bs.load_scenario(tmp_path / "settings.toml").to_dict() == scenario.to_dict()
    made_by = tomllib.loads((tmp_path / "settings.toml").read_text())["made_by"]
    assert (made_by["study"], made_by["seed"], made_by["command"]) == ("squares", 9, "bumpstop study squares")
    assert made_by["factors"] == [1.0, 2.0]
    assert {"bumpstop", "numpy", "python", "instruction_set"} <= set(made_by)


@pytest.mark.parametrize("word", ["two\nlines", 'a = "b"', "\x1b[31m", "\udcff", "it's", "plain word", "\x00"])
def test_settings_hold_whatever_stands_in_the_command(word: str, tmp_path: Path) -> None:
    command = shell_command(["bumpstop", "study", word])
    run(Squares(control_group()), tmp_path, command=command)
    text = (tmp_path / "settings.toml").read_bytes().decode("utf-8")
    assert bs.load_scenario(tmp_path / "settings.toml").to_dict() == control_group().to_dict()
    assert text.splitlines()[0] == f"# A scenario. Made by: {command}"
    assert tomllib.loads(text)["made_by"]["command"] == command
    if "\x00" not in word:
        said = subprocess.run(["bash", "-c", f"printf %s {command.split(' ', 2)[2]}"], capture_output=True, check=True)
        assert said.stdout == os.fsencode(word)
    # The same study goes on there.
    run(Squares(control_group()), tmp_path, command=command)


def test_a_file_that_a_scenario_names_belongs_to_the_study(tmp_path: Path) -> None:
    source = Path(bs.__file__).parent / "contact" / "data" / "bgia2011.toml"
    table = tmp_path / "own.toml"
    table.write_text(source.read_text(encoding="utf-8").replace('name = "bgia2011"', 'name = "own"'), encoding="utf-8")
    study = Squares(control_group(contact__limits=str(table)))
    run(study, tmp_path / "out")
    table.write_text(table.read_text(encoding="utf-8") + "\n# one more line\n", encoding="utf-8")
    with pytest.raises(bs.InputError, match="its files"):
        run(study, tmp_path / "out")


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(bs.InputError, match="--out"):
        run(Squares(control_group()), tmp_path / "file" / "below")


@pytest.mark.parametrize("name", ["shards/000003.arrow", "rows.parquet"])
@pytest.mark.parametrize("left", [0, 100])
def test_a_damaged_file_is_refused_by_name_and_worked_out_anew_without_it(tmp_path: Path, name: str, left: int) -> None:
    study = Squares(control_group())
    rows, _ = run(study, tmp_path / "whole")
    folder = tmp_path / "damaged"
    if name == "rows.parquet":
        run(study, folder)
    else:
        with pytest.raises(BrokenError):
            run(study, folder, progress=breaking(5))
    path = folder / name
    path.write_bytes(path.read_bytes()[:left])
    with pytest.raises(bs.InputError, match="is damaged"):
        run(study, folder)
    path.unlink()
    again, _ = run(study, folder)
    assert again.equals(rows)


@pytest.mark.parametrize("source", ["another seed", "another study", "another shard", "fewer rows"])
def test_a_shard_from_elsewhere_is_never_mixed_in(tmp_path: Path, source: str) -> None:
    """All of them whole tables, which read without an error."""
    study = Squares(control_group(), seed=1)
    others: dict[str, Study] = {"another seed": Squares(study.scenario, seed=2), "another study": Cubes(study.scenario)}
    for each, place in ((study, tmp_path / "own"), (others.get(source, study), tmp_path / "other")):
        with pytest.raises(BrokenError):
            run(each, place, progress=breaking(3))
    own = tmp_path / "own" / "shards" / "000001.arrow"
    brought = (tmp_path / "other" / "shards" / f"00000{0 if source == 'another shard' else 1}.arrow").read_bytes()
    if source == "fewer rows":
        few = io.BytesIO()
        pl.read_ipc_stream(io.BytesIO(brought)).head(2).write_ipc_stream(few)
        brought = few.getvalue()
    own.write_bytes(brought)
    refused_by_name_and_done_again(study, own)


@pytest.mark.parametrize("source", ["another seed", "another study", "fewer rows"])
def test_rows_from_elsewhere_are_never_taken_for_the_study_s(tmp_path: Path, source: str) -> None:
    study = Squares(control_group(), seed=1)
    others: dict[str, Study] = {"another seed": Squares(study.scenario, seed=2), "another study": Cubes(study.scenario)}
    run(study, tmp_path / "own")
    run(others.get(source, study), tmp_path / "other")
    own = tmp_path / "own" / "rows.parquet"
    own.write_bytes((tmp_path / "other" / "rows.parquet").read_bytes())
    if source == "fewer rows":
        pl.read_parquet(own).head(2).write_parquet(own)
    refused_by_name_and_done_again(study, own)


def refused_by_name_and_done_again(study: Study, file: Path) -> None:
    folder = file.parent.parent if file.parent.name == "shards" else file.parent
    with pytest.raises(bs.InputError, match="is damaged, or of another study") as refused:
        run(study, folder)
    assert file.name in refused.value.problem
    file.unlink()
    assert run(study, folder).rows.equals(run(study).rows)


@pytest.mark.parametrize("text", ["", "made_by = 3\n", "made_by = [", "\ufeff", "[made_by]\nfingerprint = []\n"])
def test_settings_that_are_none_are_refused(tmp_path: Path, text: str) -> None:
    with pytest.raises(BrokenError):
        run(Squares(control_group()), tmp_path, progress=breaking(3))
    (tmp_path / "settings.toml").write_text(text, encoding="utf-8")
    with pytest.raises(bs.InputError, match="made otherwise"):
        run(Squares(control_group()), tmp_path)


def test_files_that_are_no_shards_are_left_alone(tmp_path: Path) -> None:
    """A superscript two is a digit, too."""
    study = Squares(control_group())
    with pytest.raises(BrokenError):
        run(study, tmp_path, progress=breaking(2))
    shards = tmp_path / "shards"
    for name in ("2.arrow", "\u00b2.arrow", "000099.arrow"):
        (shards / name).write_bytes((shards / "000000.arrow").read_bytes())
    assert run(study, tmp_path).rows.equals(run(study).rows)


@dataclass(frozen=True)
class Unordered(Grouped):
    """Its first groups end last, as on a busy machine."""

    def several(self, numbers: Any) -> list[pl.DataFrame]:
        time.sleep(0.05 if 0 in numbers else 0.0)
        return super().shard_batch(numbers)


def test_groups_that_end_in_another_order_make_the_same_rows(tmp_path: Path) -> None:
    study = Unordered(control_group(), seed=3)
    seen: list[int] = []
    rows, _ = run(study, tmp_path, threads=3, progress=lambda at, _: seen.append(at))
    assert rows.equals(run(Squares(control_group(), seed=3, count=24)).rows)
    assert seen == sorted(seen)
    assert seen[-1] == 24


@pytest.mark.parametrize(
    "name", ["settings.toml", "shards/000002.arrow", "rows.parquet", "summary.json", "manifest.json"]
)
def test_a_file_whose_writing_breaks_off_is_not_there(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A crash in the middle of a write leaves no half file under the name that is looked for."""
    whole = tmp_path / "whole"
    rows, _ = run(Squares(control_group()), whole)
    folder, wanted = tmp_path / "cut", Path(name).name
    write_bytes, write_parquet = Path.write_bytes, pl.DataFrame.write_parquet

    def cut(self: Path, data: bytes) -> int:
        broken = wanted in self.name
        write_bytes(self, data[: len(data) // 2] if broken else data)
        if broken:
            raise BrokenError
        return len(data)

    def cut_parquet(self: pl.DataFrame, file: Any, **settings: Any) -> None:
        if wanted not in Path(file.name).name:
            return write_parquet(self, file, **settings)
        file.write(b"half")
        raise BrokenError

    monkeypatch.setattr(Path, "write_bytes", cut)
    monkeypatch.setattr(pl.DataFrame, "write_parquet", cut_parquet)
    with pytest.raises(BrokenError):
        run(Squares(control_group()), folder)
    assert not (folder / name).exists()
    monkeypatch.setattr(Path, "write_bytes", write_bytes)
    monkeypatch.setattr(pl.DataFrame, "write_parquet", write_parquet)
    assert run(Squares(control_group()), folder).rows.equals(rows)


def test_a_line_of_code_is_a_part_of_the_fingerprint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Rows of two builds are not mixed, whichever file of the package differs."""
    package = tmp_path / "bumpstop"
    for name in ("shards/sharded_job.py", "collision/result.py", "collision/data/table.toml", "errors.py", "kernel.so"):
        (package / name).parent.mkdir(parents=True, exist_ok=True)
        (package / name).write_text("x = 1\n")
    monkeypatch.setattr("bumpstop.shards.sharded_job.__file__", str(package / "shards/sharded_job.py"))
    monkeypatch.setattr("bumpstop._native.module.__file__", str(package / "kernel.so"))

    def fingerprint() -> str:
        code_digest.cache_clear()
        return Squares(control_group()).fingerprint()

    try:
        first = fingerprint()
        assert fingerprint() == first
        seen = {first}
        for file in sorted(package.rglob("*.*")):
            file.write_text("x = 2\n")
            seen.add(fingerprint())
        assert len(seen) == 6
    finally:
        code_digest.cache_clear()


def test_a_result_is_two_things_and_a_text() -> None:
    found = run(Squares(control_group(), seed=1))
    rows, summary = found
    assert rows is found.rows
    assert summary is found.summary
    assert str(found) == f"sum {(rows['x'] ** 2).sum():.6f}\ndone"
