"""A scenario to start from: it runs as it is, and its comments say which figures stand for those of the cell."""

from __future__ import annotations

import math
import tomllib
from functools import cache
from importlib import resources
from typing import Any

from bumpstop.errors import InputError, near_matches
from bumpstop.model import Robot
from bumpstop.text_files import is_path, toml_value

DEFAULT_ROBOT = "ur10e"
# Of the torque limit; and thresholds over noise, as in Schroeder (2013).
_THRESHOLD_SHARE, _THRESHOLD_OVER_NOISE = 1 / 8, 5.5
_ACCELERATION_RAD_S2 = 5.0
_LATENCY_S = 0.02

_TEXT = """\
# A scenario of bumpstop: how hard a {title} hits a hand on the table under its tip.
# It runs as it is: bumpstop evaluate FILE
#
# REPLACE marks what stands for figures of your cell. Until they are known the verdict is about another one.
# Every key is explained in docs/reference/collision.md, and where its figure comes from in docs/how_to/inputs.md.

# Figures that stand for those of your cell. Delete a key here when its own figure stands below: until then every
# verdict says that it is assumed, and a register is INCONCLUSIVE.
assumed = {assumed}

robot = {robot}                # bumpstop robots lists the built-in ones; or the path of a URDF
pose_deg = {pose}  # REPLACE: joint positions where contact is most likely to be hard

[motion]
velocity_mm_s = [0, 0, -50]    # REPLACE: of the tip, in the base frame; z is up
{held}
[contact]
body = "hand_finger"           # REPLACE: body region; bumpstop bodies lists them
limits = "ts15066"             # table of limits, from public transcriptions: compare with a bought copy
kind = "clamped"               # the body cannot get away; "free" where it can
area_cm2 = 2.0                 # REPLACE: smallest area that touches, an engineering choice
# link = "..."                 # the part of the arm that hits; without it the tip
# point_m = [0, 0, 0]          # the point on it, in the frame of the link

[detector]
# REPLACE: thresholds of the collision detection, one for each joint.
# {thresholds_from}
thresholds_Nm = {thresholds}
# REPLACE: standard deviation of the residual in free motion; bumpstop tune finds it in recordings.
# {noise_from}
noise_sd_Nm = {noise}
# Period of the feedback. {period_from}
feedback_period_s = {period}

[reaction]
kind = "stop"                  # or "reverse"
# REPLACE: deceleration of the joints in a stop; bumpstop stopping finds it in a table of stopping distances.
# {acceleration_from}
joint_acceleration_rad_s2 = {acceleration}
# REPLACE: from detection until the arm begins to slow down. A placeholder: nobody's figure stands behind it.
latency_s = {latency}

[verdict]
accepted_probability = 0.001   # of exceeding a limit in one contact: an engineering choice, not a risk (ISO 12100)
max_false_alarm = 0.001        # of an alarm before contact: an engineering choice
"""


def starting_scenario(robot: str = DEFAULT_ROBOT) -> str:
    """The text of a scenario file for a built-in robot.

    The tip moves down at 50 mm/s onto a clamped hand. Thresholds and noise of robots whose own are not known are shares
    of the published torque limits.

    Args:
        robot: name of a built-in robot.

    Raises:
        InputError: there is none of that name.
    """
    points = _points()
    if is_path(robot):
        valid = f"wanted a built-in robot ({', '.join(points)}): write its scenario, then set robot and pose in it"
        raise InputError("ROBOT", f"{robot!r} is a path", valid)
    if robot not in points:
        raise InputError("ROBOT", f"{robot!r} is unknown", near_matches(robot, points))
    point, known = points[robot], Robot.load(robot)
    thresholds, noise, thresholds_from, noise_from = _detector(point, known)
    source = point.get("acceleration_source")
    assumed = [] if "thresholds_Nm" in point else ["detector.thresholds_Nm", "detector.noise_sd_Nm"]
    assumed += ["detector.feedback_period_s"] if point["period_source"] == "placeholder" else []
    assumed += [] if source else ["reaction.joint_acceleration_rad_s2"]
    assumed.append("reaction.latency_s")
    return _TEXT.format(
        title=known.title or known.name,
        assumed=toml_value(assumed),
        robot=toml_value(robot),
        pose=toml_value(point["pose_deg"]),
        held=_held(point),
        thresholds=toml_value(thresholds),
        noise=toml_value(noise),
        thresholds_from=thresholds_from,
        noise_from=noise_from,
        period=toml_value(point["feedback_period_s"]),
        period_from=_sentence(point["period_source"]),
        acceleration=toml_value(point.get("joint_acceleration_rad_s2", _ACCELERATION_RAD_S2)),
        acceleration_from=f"From {source}." if source else "A placeholder: nobody's figure stands behind it.",
        latency=toml_value(_LATENCY_S),
    )


@cache
def _points() -> dict[str, Any]:
    text = (resources.files("bumpstop.register") / "data" / "starting_points.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def _held(point: dict[str, Any]) -> str:
    held = point.get("held_joints")
    return f"held_joints = {toml_value(held)}              # joints that stand still\n" if held else ""


def _detector(point: dict[str, Any], robot: Robot) -> tuple[list[float], list[float], str, str]:
    """Thresholds and noise [Nm], and where they come from."""
    if "thresholds_Nm" in point:
        source = f"From {point['detector_source']}."
        return point["thresholds_Nm"], point["noise_sd_Nm"], source, source
    train = robot.drive_train
    thresholds = [float(f"{_THRESHOLD_SHARE * limit:.2g}") for limit in train.torque_limit]
    assert all(map(math.isfinite, thresholds))
    noise = [float(f"{threshold / _THRESHOLD_OVER_NOISE:.2g}") for threshold in thresholds]
    return (
        thresholds,
        noise,
        f"A placeholder: an eighth of the torque limits, which are {train.status['torque_limit']}.",
        f"A placeholder: the thresholds over {_THRESHOLD_OVER_NOISE:g}.",
    )


def _sentence(text: str) -> str:
    if text == "placeholder":
        return "REPLACE: a placeholder, nobody's figure stands behind it."
    return f"{text[0].upper()}{text[1:]}."
