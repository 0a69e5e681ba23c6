"""The page of the plant: its session, its experiment, its tables."""

from __future__ import annotations

import doctest
import re
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic_core import PydanticUndefined

from bumpstop.plant import Experiment, PlantObject, gauge_regions, object_kinds
from bumpstop.plant.experiment_tables import TABLES
from bumpstop.plant.objects import rubber_modulus
from docs.pages import AS_DOCTEST, blocks, code, read, rows, section

PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "robot" / "plant.md"


def test_session() -> None:
    test = doctest.DocTestParser().get_doctest("\n".join(blocks(PAGE, "pycon")), {}, PAGE.name, str(PAGE), 0)
    assert test.examples
    assert doctest.DocTestRunner(optionflags=AS_DOCTEST).run(test).failed == 0


def test_experiment() -> None:
    (text,) = blocks(PAGE, "toml")
    run = Experiment.from_dict(tomllib.loads(text)).run()
    assert run.reaction_time is not None
    assert 20 < run.peak_force < 100


@pytest.mark.parametrize("table", ["", *TABLES])
def test_every_key_and_its_default(table: str) -> None:
    heading = "### top level" if not table else f"### `[{table}]`" if table != "object" else "### `[[object]]`"
    text = section("\n" + section(read("docs/reference/robot/plant.md"), "## Every key"), heading)
    documented = {code(row[0])[0]: row[1] for row in rows(text, "key")}
    model: Any = Experiment if not table else TABLES[table]
    fields = {name: field for name, field in model.model_fields.items() if name != "folder"}
    assert list(documented) == list(fields)
    for name, default in documented.items():
        known = fields[name].default
        if default == "required":
            assert known is PydanticUndefined, name
        elif default == "none":
            assert known is None or name in TABLES, name
        else:
            assert tomllib.loads(f"value = {code(default)[0]}")["value"] == known, name


def test_objects_of_the_table() -> None:
    listed = {code(row[0])[0]: row[1:] for row in rows(read("docs/reference/robot/plant.md"), "object")}
    assert set(object_kinds()) <= set(listed)
    for kind, (stiffness, status) in listed.items():
        if kind == "a body region":
            continue
        name = "hand_finger" if "region" in kind else kind
        thing = PlantObject.of(name, position=[0, 0, 0], normal=[0, 0, 1])
        assert thing.stiffness == float(re.findall(r"\d+", stiffness)[-1])
        assert thing.status == status


def test_gauges_of_the_table() -> None:
    listed = {code(row[0])[0]: row[1:] for row in rows(read("docs/reference/robot/plant.md"), "gauge")}
    assert list(listed) == [f"gauge_{region}" for region in gauge_regions()]
    for kind, (spring, shore) in listed.items():
        gauge = PlantObject.of(kind, position=[0, 0, 0], normal=[0, 0, 1])
        assert gauge.spring == 1e3 * float(spring)
        assert gauge.stiffness == pytest.approx(rubber_modulus(float(shore)) * 0.05)


def test_derived_stiffness() -> None:
    """Of fiberboard: growth of force after detection beside Plexiglas, tables 4.3 and 4.4, typed a second time."""
    plexiglas = np.array([[23.6, 34.4989], [19.8, 52.2063], [22.3, 108.977], [24.8, 122.42]])
    fiberboard = np.array([[27.42, 67.00], [31.16, 97.24], [36.47, 140.33], [32.12, 142.28]])
    ratio = np.diff(fiberboard, axis=1) / np.diff(plexiglas, axis=1)
    thing = PlantObject.of("fiberboard", position=[0, 0, 0], normal=[0, 0, 1])
    assert 19100 * np.median(ratio) == pytest.approx(thing.stiffness, rel=0.01)
