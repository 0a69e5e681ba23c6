"""The page of networks is true: what an address may say, where answers are, which topics there are."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from bumpstop.errors import InputError
from bumpstop.live.answer import ANSWERS
from bumpstop.live.dds.publishers import ANSWER_TOPIC
from bumpstop.live.rtde.source import ANSWER_FIELDS, output_fields
from bumpstop.live.sources.names import source_of
from docs.pages import ROOT, code, read, rows, section

PAGE = read("docs/how_to/live_sources.md")
DETECTOR: Any = SimpleNamespace(
    dof=8,
    joints=tuple("abcdefgh"),
    units=("Nm",) * 8,
    signal="current",
    takes_current=True,
    measured_rates=False,
    period_s=0.004,
)


@pytest.mark.parametrize(("scheme", "heading"), [("rtde", "## RTDE"), ("dds", "## DDS")])
def test_what_an_address_may_say(scheme: str, heading: str) -> None:
    keys = [code(key)[0].rstrip("=") for key, *_ in rows(section(PAGE, heading), "in the address")]
    with pytest.raises(InputError) as refused:
        source_of(f"{scheme}://a?nothing_like_it=1", DETECTOR)
    assert set(refused.value.valid.removeprefix("valid: ").split(", ")) == set(keys)
    (example,) = re.findall(rf"^    ({scheme}://\S+)$", section(PAGE, heading), re.MULTILINE)
    source = source_of(example, DETECTOR)
    assert source.name == {"rtde": "rtde://10.0.0.2:30004", "dds": "dds://rt/arm_1/joint_states"}[scheme]
    assert getattr(source, "_frequency", 250) == 250
    assert getattr(source, "_domain", 3) == 3


@pytest.mark.parametrize("address", ["rtde://a?signal=", "dds://a?effort="])
def test_a_signal_that_the_detector_does_not_take(address: str) -> None:
    """Not one sample could be judged."""
    for given in ("torque", "torques"):
        with pytest.raises(InputError, match=rf"is '{given}'; the detector takes currents: 'current'"):
            source_of(address + given, DETECTOR)


def test_a_domain_is_a_whole_number() -> None:
    for given in ("2.9", "-1", "x"):
        with pytest.raises(InputError, match=f"domain is '{given}'; wanted a whole number"):
            source_of(f"dds://a?domain={given}", DETECTOR)


def test_fields() -> None:
    text = section(PAGE, "## RTDE")
    listed = {name for field, _ in rows(text, "field") for name in code(field)}
    wanted = set(output_fields(7, "current")) | set(output_fields(6, "torque"))
    assert listed == wanted - {"output_double_register_25"}


def test_answers() -> None:
    table = rows(section(PAGE, "## Answers"), "over")
    registers = [code(where)[0] for over, where, _ in table if over == "RTDE"]
    assert registers == list(ANSWER_FIELDS)
    assert [word.split()[1] for word in table[0][2].split(", ")] == ["nothing", *ANSWERS[1:]]
    assert "rt" + code(table[-1][1])[0] == ANSWER_TOPIC


def test_topics_of_the_monitor() -> None:
    source = (ROOT / "src" / "bumpstop" / "live" / "dds" / "output.py").read_text()
    topics = [code(topic)[0] for topic, *_ in rows(section(read("docs/how_to/live.md"), "## Topics of ROS 2"), "topic")]
    names = re.findall(r'^            "(\w+)": types\.', source, re.MULTILINE)
    assert topics == [f"/bumpstop/{name}" for name in names]


def test_examples_are_there() -> None:
    for path in ("examples/cpp/05_rtde.cpp", "examples/ros2_control/README.md"):
        assert f"../{path}" in PAGE
        assert Path(ROOT / path).is_file()
