"""The files of ``bumpstop program --out``: the program, and every segment as a scenario that anybody can evaluate."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.collision.scenario.settings_file import scenario_data
from bumpstop.errors import InputError, where_else
from bumpstop.output_files import write_bytes
from bumpstop.program.cell import write_trajectory
from bumpstop.program.source import data_beside, read_bytes
from bumpstop.text_files import to_toml, write_text

if TYPE_CHECKING:
    from bumpstop.program.evaluation import ProgramResult


def check_target(path: Path, folder: Path) -> None:
    """Refuse the folder of the program itself, before any work is done.

    Raises:
        InputError: it is.
    """
    if Path(os.path.realpath(folder)) == Path(os.path.realpath(path)).parent:
        raise InputError("--out", f"{str(folder)!r} is where the program is", "give another folder")


def write_program(result: ProgramResult, path: Path, folder: Path) -> list[Path]:
    """Write the program with its new speeds, its segments and a summary; returns the files.

    Args:
        result: what was found.
        path: of the program that was read; the new one has its name.
        folder: made where it is missing.

    Raises:
        InputError: the folder cannot be written.
    """
    target = folder / result.source.file_name(path)
    files = [target]
    try:
        segments = folder / "segments"
        segments.mkdir(parents=True, exist_ok=True)
        for old in (*segments.glob("[0-9]*.toml"), *segments.glob("[0-9]*.csv")):
            if old.stem.isdecimal():
                old.unlink()  # of another run, they would be taken for this program's
        result.source.write(result.factors, target)
        for beside in data_beside(path):
            write_bytes(folder / beside.name, read_bytes(beside))  # as it is: the program is nothing without it
            files.append(folder / beside.name)
        for number, one in enumerate(result.segments, start=1):
            if one.written.cell is None:
                continue
            file = segments / f"{number}.csv"
            write_trajectory(file, one.segment.at(one.factor))
            scenario = one.written.cell.of(file, one.written.worst_s)
            data = scenario_data(scenario)
            data["motion"]["file"] = file.name
            write_text(segments / f"{number}.toml", to_toml(data))
            files.append(segments / f"{number}.toml")
        summary = json.dumps(result.to_json(), allow_nan=False, indent=2)
        write_text(folder / "summary.json", summary + "\n")
    except OSError as error:
        problem = f"{str(folder)!r} cannot be written ({error.filename or folder}: {error.strerror or error})"
        raise InputError("--out", problem, where_else(error)) from None
    return [*files, folder / "summary.json"]
