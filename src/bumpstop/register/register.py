"""Registers of contact situations: every situation of a cell that is judged, read from files and checked at once."""

from __future__ import annotations

import hashlib
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from bumpstop.collision.scenario.scenario_file import read_tables
from bumpstop.collision.scenario.settings_file import files_of
from bumpstop.errors import InputError
from bumpstop.register.faults import RegisterError
from bumpstop.register.register_file import RegisterFile, is_register, read_register
from bumpstop.register.rows import FORMULA, MAX_NAME, Base, Fault, Row, is_set
from bumpstop.register.situation import Situation
from bumpstop.text_files import as_path


@dataclass(frozen=True)
class Register:
    """The contact situations of a cell, in the order of their files.

    Attributes:
        situations: at least one, each with a name of its own.
        checksums: SHA-256 of every file that they rest on, as it was when they were read: registers and scenarios in
            the order in which they were met, then the files that scenarios name.
    """

    situations: tuple[Situation, ...]
    checksums: Mapping[Path, str]


def load_register(*paths: str | os.PathLike[str], changes: Mapping[str, Any] | None = None) -> Register:
    """Read registers and scenarios.

    Args:
        paths: of registers (``.toml`` with ``[[situation]]`` rows, or ``.csv``) and of scenario files, each of which is
            one situation named after its file, with the folder where two have one name.
        changes: dotted keys and values that replace those of all situations.

    Raises:
        RegisterError: rows that cannot be used; it names the faults of all of them.
        InputError: a file that cannot be read, or no file at all.
    """
    if not paths:
        raise InputError("register", "is not given", "wanted the path of a register or of scenarios")
    reader = _Reader(dict(changes or {}))
    names = [as_path(path, "register") for path in paths]
    stems = Counter(path.stem for path in names)
    for path in names:
        if is_register(path):
            reader.read(read_register(path))
        else:
            name = path.stem if stems[path.stem] == 1 else str(path)
            if len(name) > MAX_NAME:  # may be cut where no name begins
                name = name[-MAX_NAME:].lstrip("".join(FORMULA))
            reader.read(RegisterFile(path, [Row(path, "", {"name": name})], path.name))
    if reader.faults:
        raise RegisterError(", ".join(dict.fromkeys(str(path) for path in names)), reader.faults)
    files = [*reader.files, *(path for each in reader.situations for path in files_of(each.scenario).values())]
    return Register(tuple(reader.situations), {path: checksum(path) for path in dict.fromkeys(files)})


def as_register(value: Any) -> Register:
    """What registers are evaluated from; a path must be read first.

    Raises:
        InputError: it is something else.
    """
    if isinstance(value, Register):
        return value
    problem = f"a value of type {type(value).__name__} is no register"
    raise InputError("register", problem, "wanted load_register(path)")


def checksum(path: Path) -> str:
    """SHA-256 of a file's bytes, in hexadecimal; why not, where it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        return f"cannot be read ({error.strerror or error})"


@dataclass
class _Reader:
    """Situations and faults of the files read so far."""

    changes: dict[str, Any]
    situations: list[Situation] = field(default_factory=list)
    faults: list[InputError] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)
    _bases: dict[Path, Base | InputError] = field(default_factory=dict)
    _named: dict[str, Row] = field(default_factory=dict)

    def read(self, file: RegisterFile) -> None:
        """Add the situations of a file."""
        self.files.append(file.path)
        self.faults += file.faults
        found: list[tuple[Row, Path, list[Fault]]] = []
        for row in file.rows:
            base = self._base_of(row, file)
            faults = self._name_fault(row)
            if isinstance(base, InputError):
                error = InputError(f"{row.where}, scenario", _words(base), base.valid)
                of_row = "scenario" in row.values or not row.place
                faults += [*row.own_faults(), Fault("scenario", "scenario", of_row, error if row.place else base)]
            else:
                situation, others = row.check(base, self.changes, file.statements)
                faults += others
                if situation is not None:
                    self.situations.append(situation)
            found.append((row, file.path if isinstance(base, InputError) else base.path, faults))
        self._attribute(found)

    def _name_fault(self, row: Row) -> list[Fault]:
        earlier = self._named.setdefault(row.name, row) if row.name else row
        if earlier is row:
            return []
        where = (earlier.place if earlier.file == row.file else earlier.where) or str(earlier.file)
        problem = f"{row.name!r} is the name of {where}, too"
        return [Fault("name", "name", True, InputError(f"{row.where}, name", problem, "give each situation its own"))]

    def _base_of(self, row: Row, file: RegisterFile) -> Base | InputError:
        written = row.values.get("scenario", file.scenario)
        if not isinstance(written, str) or not written:
            return InputError("scenario", "is missing", "wanted the path of the scenario that the row stands on")
        path = file.path.parent / written
        if path not in self._bases:
            try:
                self._bases[path] = Base(path, read_tables(path))
                self.files.append(path)
            except InputError as error:
                self._bases[path] = error
        return self._bases[path]

    def _attribute(self, found: Sequence[tuple[Row, Path, list[Fault]]]) -> None:
        """Name each fault under where it was written: a row, the file that all of its rows stand on, or a change."""
        rows_of = Counter(base for _, base, _ in found)
        having = Counter((base, fault.field, fault.error.problem) for _, base, faults in found for fault in faults)
        told: set[tuple[str, str]] = set()
        for _, base, faults in found:
            for fault in faults:
                error = fault.error
                if is_set(self.changes, fault.key):
                    error = InputError(fault.field, error.problem, error.valid)
                elif not fault.of_row and having[base, fault.field, error.problem] == rows_of[base]:
                    error = InputError(f"{base}, {fault.field}", error.problem, error.valid)
                if (error.field, error.problem) not in told:
                    told.add((error.field, error.problem))
                    self.faults.append(error)


def _words(error: InputError) -> str:
    """What is wrong with a scenario that a row names."""
    return error.problem if error.field == "scenario" else f"{error.field}: {error.problem}"
