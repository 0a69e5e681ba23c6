"""Scenarios of all that the page computes, drawn at random."""

from __future__ import annotations

from typing import Any

import numpy as np

from bumpstop.contact import LimitTable
from bumpstop.model import Robot, robots


def random_tables(seed: int) -> dict[str, Any]:
    """Tables of a scenario; some cannot be computed, as nobody chose their pose."""
    rng = np.random.default_rng(seed)
    robot = Robot.load(robots()[seed % len(robots())])
    dof = robot.dof
    q = rng.uniform(np.maximum(robot.lower, -2.5), np.minimum(robot.upper, 2.5))
    direction = rng.normal(size=3)
    speed = rng.uniform(20, 250)
    noise = rng.uniform(0.5, 4, dof)
    tables: dict[str, Any] = {
        "robot": robot.name,
        "motion": {"velocity_mm_s": (speed * direction / np.linalg.norm(direction)).round(3).tolist()},
        "contact": _contact(rng, robot),
        "detector": {
            "thresholds_Nm": (noise * rng.uniform(4.5, 6.5, dof)).round(3).tolist(),
            "noise_sd_Nm": noise.round(3).tolist(),
        },
        "reaction": {"kind": str(rng.choice(["stop", "reverse"])), "joint_acceleration_rad_s2": rng.uniform(3, 15)},
    }
    if rng.random() < 0.5:
        tables["pose_rad"] = q.tolist()
    else:
        tables["pose_deg"] = np.degrees(q).round(1).tolist()
    _vary(rng, tables, dof)
    return tables


def _contact(rng: np.random.Generator, robot: Robot) -> dict[str, Any]:
    contact: dict[str, Any] = {}
    table = LimitTable.load(str(rng.choice(["bgia2011", "ts15066"])))
    if rng.random() < 0.8:
        region = table.regions[rng.integers(len(table.regions))]
        contact |= {"limits": table.name, "body": region.name}
        areas = table.areas_of(region.name)
        if areas and rng.random() < 0.3:
            contact["pressure_area"] = areas[0].label
    if not contact or rng.random() < 0.3:
        contact["stiffness_N_mm"] = rng.uniform(10, 150)
    if rng.random() < 0.7:
        contact["area_cm2"] = rng.uniform(0.5, 6)
    if rng.random() < 0.3:
        contact["padding_N_m"] = rng.uniform(2e4, 2e5)
    if rng.random() < 0.2:
        contact["peak_factor"] = 1.5
    if rng.random() < 0.3:
        contact["link"] = robot.joints[-2].link
        contact["point_m"] = rng.uniform(-0.1, 0.1, 3).tolist()
    law = str(rng.choice(["half_normal", "uniform", "fixed"]))
    contact["offset_law"] = law
    if law == "half_normal":
        contact["offset_sd_s"] = rng.uniform(0.05, 0.3)
    elif law == "fixed":
        contact["offset_mm"] = rng.uniform(1, 30)
    return contact


def _vary(rng: np.random.Generator, tables: dict[str, Any], dof: int) -> None:
    """Some of the keys that few scenarios have, each with a share of its own."""
    motion, contact, detector, reaction = (tables[name] for name in ("motion", "contact", "detector", "reaction"))
    changes = (
        (0.2, motion, {"task": "position"}),
        (0.2 if dof > 6 else 0.0, motion, {"held_joints": [dof]}),
        (0.1, motion, {"damping": 0.02}),
        (0.15, motion, {"start": "rest"}),
        (0.15, motion, {"duration_s": 0.2}),
        (0.15, contact, {"normal": motion["velocity_mm_s"]}),
        (0.2, detector, {"feedback_period_s": 0.002}),
        # Small tails of correlated noise take seconds, the more cycles the longer.
        (0.15, detector, {"noise_correlation": 0.5, "feedback_period_s": 0.008}),
        (0.15, detector, {"residual": "observer", "observer_gain_1_s": 80}),
        (0.15, detector, {"arming_delay_s": 0.05}),
        (0.15, detector, {"noise_mean_Nm": 0.2}),
        (0.5, reaction, {"latency_s": 0.0035}),
        (0.2, reaction, {"dead_time_s": 0.01}),
        (0.2, tables, {"verdict": {"accepted_probability": 1e-7, "confidence": 0.9}}),
        (0.2, tables, {"simulation": {"step_s": 0.0005, "substeps": 3}}),
    )
    for share, table, keys in changes:
        if rng.random() < share:
            table |= keys
    if rng.random() < 0.2:
        detector["thresholds_Nm"][0] = float("inf")
    law = rng.random()
    if law < 0.2:
        reaction |= {"deceleration": "constant_time", "stopping_time_s": 0.15}
    elif law < 0.4:
        reaction |= {"deceleration": "ramp", "ramp_time_s": 0.03}
    if reaction["kind"] == "stop" and law >= 0.2 and rng.random() < 0.3:
        reaction["stop_category"] = 0
