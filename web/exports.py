"""What the page knows of scenarios, robots and limits: written from the package, so that nothing stands twice."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from bumpstop import __version__
from bumpstop.collision.curve import AT_REST
from bumpstop.collision.distribution.distribution import FAR, NEGLIGIBLE, QUANTILES
from bumpstop.collision.probability_text import MIN_PERCENT, MIN_PRINTED_PROBABILITY
from bumpstop.collision.problem import MAX_STEPS
from bumpstop.collision.scenario import scenario_file
from bumpstop.collision.scenario import scenario_tables as tables
from bumpstop.collision.scenario.scenario import Scenario
from bumpstop.collision.scenario.scenario_file import load_scenario
from bumpstop.collision.scenario.spellings import SPELLINGS
from bumpstop.collision.stopping import braking_keys
from bumpstop.collision.verdict import finer_steps, verdict_notes
from bumpstop.contact import ContactLimits, LimitTable, builtin_tables
from bumpstop.model import Robot, robots
from bumpstop.model.dynamics import FREE_FALL

ROOT = Path(__file__).resolve().parents[1]


def page_data() -> dict[str, Any]:
    """Everything that ``scenario.js`` and ``verdict.js`` read, in JSON's types; infinite limits are None."""
    return {
        "version": __version__,
        "schema": Scenario.model_json_schema(),
        "spellings": SPELLINGS,
        "robots": {name: _robot(Robot.load(name)) for name in robots()},
        "limits": {name: _limits(LimitTable.load(name)) for name in builtin_tables()},
        "examples": _examples(),
        "quantiles": QUANTILES,
        "at_rest": AT_REST,
        "law_keys": braking_keys.OF_LAW,
        "needed_law_keys": braking_keys._NEEDED,
        "numbers": {
            "far": FAR,
            "negligible": NEGLIGIBLE,
            "max_steps": MAX_STEPS,
            "max_bytes": scenario_file._MAX_BYTES,
            "free_fall": FREE_FALL,
            "min_speed_mm_s": tables.MIN_SPEED_MM_S,
            "min_substep_s": tables._MIN_SUBSTEP_S,
            "min_threshold_Nm": tables._MIN_THRESHOLD_NM,
            "max_threshold_Nm": tables._MAX_THRESHOLD_NM,
            "min_percent": MIN_PERCENT,
            "min_printed": MIN_PRINTED_PROBABILITY,
            "max_untouched": verdict_notes.MAX_UNTOUCHED,
            "much_untouched": verdict_notes._MUCH_UNTOUCHED,
            "min_cosine": verdict_notes._MIN_COSINE,
            "full_speed": verdict_notes._FULL_SPEED,
            "finer": finer_steps._FINER,
            "min_step_s": finer_steps._MIN_STEP_S,
            "max_substeps": finer_steps._MAX_SUBSTEPS,
            "max_steps_looked_at": finer_steps._MAX_STEPS,
            "rise": finer_steps._RISE,
        },
    }


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _robot(robot: Robot) -> dict[str, Any]:
    """Chain, limits and the frames of which a contact point may be given."""
    axes = [np.array(joint.axis) / np.linalg.norm(joint.axis) for joint in robot.joints]
    joints = [
        {
            "prismatic": joint.kind == "prismatic",
            "origin": list(joint.origin),
            "rotation": [value for row in joint.rotation for value in row],
            "axis": axis.tolist(),
            "lower": _finite(joint.lower),
            "upper": _finite(joint.upper),
            "velocity": _finite(joint.velocity),
        }
        for joint, axis in zip(robot.joints, axes, strict=True)
    ]
    names = [*(joint.link for joint in robot.joints), *(frame.name for frame in robot.frames), robot.tip_name]
    return {
        "title": robot.title or robot.name,
        "tip_name": robot.tip_name,
        "warnings": list(robot.warnings),
        "joints": joints,
        "frames": {name: _frame(robot, name) for name in names},
    }


def _frame(robot: Robot, name: str) -> dict[str, Any]:
    """Number of the link that carries a frame, and where the frame is in it: origin [m] and axes, row by row."""
    link, origin = robot.frame(name)
    axes = np.array([robot.frame(name, unit)[1] - origin for unit in np.eye(3)]).T
    turned = [frame.rotation for frame in robot.frames if frame.name == name]
    if name == robot.tip_name:
        turned = [robot.tip_rotation]
    # Of one that is not turned the differences above may be off by a rounding.
    exact = np.array(turned[0]) if turned else np.eye(3)
    assert np.abs(axes - exact).max() < 1e-12
    return {"link": link, "origin": origin.tolist(), "rotation": exact.ravel().tolist()}


def _limits(table: LimitTable) -> dict[str, Any]:
    """Of every region the limits of clamped contact, for each spelling of a pressure area and for none."""
    found = {}
    for region in table.regions:
        areas = table.areas_of(region.name)
        names = dict.fromkeys(name for area in areas for name in (area.name, area.label))
        found[region.name] = {
            "any": _clamped(table.contact_limits(region.name, "clamped")),
            "areas": {name: _clamped(table.contact_limits(region.name, "clamped", name)) for name in names},
        }
    return found


def _clamped(limits: ContactLimits) -> dict[str, Any]:
    # The page has no warning for a region without one.
    assert limits.pressure_N_cm2 is not None, f"{limits.table} has no pressure limit for {limits.region}"
    return asdict(limits) | {"head_note": limits.head_note}


def _examples() -> list[dict[str, str]]:
    """The examples that the page can compute: rigid arms that clamp a body along a line, their numbers known."""
    found = []
    for path in sorted((ROOT / "examples").glob("[0-9]*.toml")):
        scenario = load_scenario(path)
        if scenario.motion.kind == "line" and not scenario.uncertainty:
            found.append({"name": path.name, "text": path.read_text(encoding="utf-8")})
    return found
