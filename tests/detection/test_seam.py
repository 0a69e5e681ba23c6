"""The two sides of the seam: every enum and struct of the detector's headers has its counterpart in Python."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

from bumpstop import _native
from bumpstop.detection.detection_run import FAULTS, STATES
from bumpstop.detection.settings import ResidualKind

HEADERS = Path(__file__).resolve().parents[2] / "include/bumpstop"
TEXT = re.sub(
    r"//.*",
    "",
    "\n".join(
        path.read_text(encoding="utf-8")
        for path in (*sorted((HEADERS / "detection").glob("*.hpp")), *sorted((HEADERS / "joint").glob("*.hpp")))
    ),
)
# Structs that Python fills or reads, and what of them it has another way to.
STRUCTS = {
    "JointTorqueErrors": set(),
    "SampleLimits": set(),
    "ThresholdModel": set(),
    "AlarmSettings": set(),
    "Payload": set(),
    "PayloadMonitorSettings": set(),
    # A function of the binding sets where the force of an event is given.
    "DetectorSettings": {"contact"},
    "ContactEstimate": set(),
    "DetectorEvent": set(),
    "DetectorOutput": set(),
}


def body(kind: str, name: str) -> str:
    # What a joint or every lane may have is a template by another name.
    found = re.search(rf"{kind} {name}(?:Of)? {{(.*?)^}};", TEXT, re.DOTALL | re.MULTILINE)
    assert found is not None, f"{kind} {name} is in no header"
    return found[1]


@pytest.mark.parametrize("name", sorted(re.findall(r"enum class (\w+)", TEXT)))
def test_enums_have_the_names_and_values_of_cpp(name: str) -> None:
    names = [part.strip() for part in body("enum class", name).split(",") if part.strip()]
    kind = getattr(_native, name)
    assert {member.name: member.value for member in kind} == {one: value for value, one in enumerate(names)}


def test_names_in_python_are_those_of_the_enums() -> None:
    for names, kind in (
        (STATES, _native.DetectorState),
        (FAULTS, _native.SampleFault),
        (get_args(ResidualKind), _native.ResidualKind),
        (("current", "torque"), _native.TorqueSource),
    ):
        assert tuple(member.name for member in sorted(kind, key=lambda member: member.value)) == names
    assert _native.detector_states == len(STATES)
    assert _native.sample_faults == len(FAULTS)


@pytest.mark.parametrize("name", STRUCTS)
def test_structs_have_the_fields_of_cpp(name: str) -> None:
    text = re.sub(r"\([^()]*\)|<[^;]*?>|{[^{}]*}", "", body("struct", name))
    fields: set[str] = set()
    for statement in text.split(";"):
        found = re.match(
            r"\s*(?!static|friend|using)(?:[\w:]+)\s+(\w+(?:\s*=\s*[^,]+)?(?:\s*,\s*\w+(?:\s*=\s*[^,]+)?)*)\s*$",
            statement,
        )
        if found:
            fields |= {part.split("=")[0].strip() for part in found[1].split(",")}
    assert len(fields) >= 2
    kind = getattr(_native, name)
    bound = {key for key in vars(kind) if not key.startswith("_")}
    assert fields - bound == STRUCTS[name]
    assert bound <= fields | {key for key in bound if callable(getattr(kind, key))}
