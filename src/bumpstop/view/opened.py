"""What a page begins with: a scenario, and what else was opened with it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.collision import Scenario, load_scenario
from bumpstop.collision.scenario.scenario_file import robot_of
from bumpstop.errors import InputError, near_matches
from bumpstop.register.starting_scenario import DEFAULT_ROBOT, starting_scenario
from bumpstop.text_files import parse_toml

if TYPE_CHECKING:
    from bumpstop.model import Robot


@dataclass(frozen=True, eq=False)
class Opened:
    """What a page begins with.

    Attributes:
        scenario: on screen at first.
        robot: of the scenario.
        title: what was opened.
        notes: what was assumed to open it.
    """

    scenario: Scenario
    robot: Robot
    title: str
    notes: tuple[str, ...] = ()


def open_source(source: str | None) -> Opened:
    """Open what the command line names.

    Args:
        source: path of a scenario; name of a built-in robot, or path of its URDF. None: the built-in robot
            that ``bumpstop new`` starts with.

    Raises:
        InputError: it is none of these, or cannot be used.
    """
    from bumpstop.model import robots

    if source is None or source in robots():
        name = source or DEFAULT_ROBOT
        scenario = Scenario.from_dict(parse_toml(starting_scenario(name), name))
        notes: tuple[str, ...] = (
            "A scenario to start from: thresholds, noise and deceleration stand for those of your cell.",
        )
        return Opened(scenario, robot_of(scenario), name, notes)
    path = Path(source)
    if path.suffix == ".toml":
        scenario = load_scenario(path)
        return Opened(scenario, robot_of(scenario), str(path))
    if path.suffix in (".urdf", ".xml"):
        from bumpstop.view.urdf_scenario import urdf_scenario

        scenario, robot, notes = urdf_scenario(path)
        return Opened(scenario, robot, str(path), notes)
    valid = f"wanted a scenario (.toml), a URDF, or a built-in robot; {near_matches(source, robots())}"
    raise InputError("SOURCE", f"{source!r} cannot be opened", valid)
