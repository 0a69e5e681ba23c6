"""Where a name or a path belongs, nothing else is taken, and the refusal is ours."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.contact import LimitTable
from bumpstop.errors import InputError, near_matches
from bumpstop.joint import JointTorqueModel
from bumpstop.model import Robot
from bumpstop.recording import Recording
from bumpstop.report import write_report
from bumpstop.study import Variable
from bumpstop.text_files import read_text, write_text

EXAMPLE = Path(__file__).parents[2] / "examples" / "01_hand_downward.toml"
ROBOT, TABLE, SCENARIO = Robot.load("sia5d"), LimitTable.load("bgia2011"), bs.load_scenario(EXAMPLE)
TAKES: dict[str, Callable[[Any], object]] = {
    "frame": ROBOT.frame,
    "pose": lambda x: ROBOT.pose(np.zeros(7), x),
    "jacobian": lambda x: ROBOT.jacobian(np.zeros(7), x),
    "load": Robot.load,
    "from_urdf": Robot.from_urdf,
    "base": lambda x: Robot.from_urdf("arm.urdf", base=x),
    "table": LimitTable.load,
    "region": TABLE.region,
    "areas": TABLE.areas_of,
    "kind": lambda x: TABLE.contact_limits("hand_finger", x),
    "pressure area": lambda x: TABLE.contact_limits("hand_finger", "clamped", x),
    "scenario": bs.load_scenario,
    "tables": bs.Scenario.from_dict,
    "changes": SCENARIO.with_values,
    "robot key": lambda x: SCENARIO.with_values({"robot": x}),
    "evaluate": bs.evaluate,
    "seed": lambda x: bs.evaluate(SCENARIO, seed=x),
    "variable": Variable,
    "joint model": JointTorqueModel.load,
    "recording": Recording.load,
    "report": lambda x: write_report(bs.evaluate(SCENARIO), x),
    "factor": lambda x: bs.evaluate(SCENARIO).peak_force.scaled(x),
    "read_text": lambda x: read_text(x, "wanted text"),
    "write_text": lambda x: write_text(x, ""),
}


@pytest.mark.parametrize("bad", [np.array([1.0, 2.0]), [1, 2], {3}], ids=["array", "list", "set"])
@pytest.mark.parametrize("take", TAKES)
def test_what_is_no_name_is_refused_in_our_words(take: str, bad: Any) -> None:
    with pytest.raises(InputError):
        TAKES[take](bad)


def test_long_names_are_cut() -> None:
    for message in (
        str(InputError("contact." + "a" * 5000, "is not a key")),
        str(InputError("--set", f"{'b' * 5000!r} is no value")),
    ):
        assert len(message) < 250
        assert "letters)" in message
    error = InputError("c" * 500, "is odd")
    assert error.field == "c" * 500, "programs have it whole"
    path = "/".join(["folder"] * 60)
    assert path in str(InputError(path, "cannot be read")), "paths are not cut"
    assert len(near_matches("x" * 100_000, ["speed"])) < 60
