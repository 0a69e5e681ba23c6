"""What the page is given of scenarios, robots and limits: needs no compiler, so a new key is noticed everywhere."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from web.build import HERE, SCRIPTS
from web.exports import page_data

from bumpstop.cli.completion import scenario_keys
from bumpstop.contact import LimitTable
from bumpstop.model import Robot, robots

DATA = json.loads(json.dumps(page_data(), allow_nan=False))
# Without [uncertainty], which the page refuses, it changes nothing.
WITHOUT_EFFECT = {"verdict.confidence"}
# Of tables that the page refuses whole.
REFUSED_TABLES = ("arm.", "uncertainty")


def test_every_key_is_computed_or_refused() -> None:
    """A key that changes the command's numbers and not the page's would be passed over in silence."""
    source = "".join((HERE / f"{name}.js").read_text(encoding="utf-8") for name in SCRIPTS)
    unread = {key for key in scenario_keys() if not re.search(rf"\b{re.escape(key.rpartition('.')[2])}\b", source)}
    assert {key for key in unread if not key.startswith(REFUSED_TABLES)} == WITHOUT_EFFECT


@pytest.mark.parametrize("name", robots())
def test_frames_are_where_the_robot_has_them(name: str) -> None:
    robot, given = Robot.load(name), DATA["robots"][name]
    point = np.array([0.1, -0.2, 0.3])
    assert robot.tip_name in given["frames"]
    for link, frame in given["frames"].items():
        number, wanted = robot.frame(link, point)
        assert frame["link"] == number
        turned = np.reshape(frame["rotation"], (3, 3)) @ point
        np.testing.assert_allclose(np.array(frame["origin"]) + turned, wanted, rtol=0, atol=1e-15)
    limits = [[joint[key] for key in ("lower", "upper", "velocity")] for joint in given["joints"]]
    assert limits == [[joint.lower, joint.upper, joint.velocity] for joint in robot.joints]


@pytest.mark.parametrize("name", ["bgia2011", "ts15066"])
def test_limits_are_those_of_clamped_contact(name: str) -> None:
    table, given = LimitTable.load(name), DATA["limits"][name]
    assert list(given) == [region.name for region in table.regions]
    for region, found in given.items():
        wanted = table.contact_limits(region, "clamped")
        assert (found["any"]["force_N"], found["any"]["pressure_N_cm2"]) == (wanted.force_N, wanted.pressure_N_cm2)
        for area, limits in found["areas"].items():
            named = table.contact_limits(region, "clamped", area)
            assert (limits["pressure_N_cm2"], limits["pressure_area"]) == (named.pressure_N_cm2, named.pressure_area)


def test_the_examples_are_those_of_rigid_arms_and_known_numbers() -> None:
    assert [example["name"][:2] for example in DATA["examples"]] == ["01", "02", "03", "04", "05"]
