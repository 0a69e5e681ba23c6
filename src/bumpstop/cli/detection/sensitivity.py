"""``bumpstop sensitivity``: forces that no threshold detects at a pose."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bumpstop.cli.completion import complete_robot
from bumpstop.cli.detection.residual_source import thresholds_of
from bumpstop.cli.numbers import numbers
from bumpstop.cli.robots import load_robot
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.detection import DetectorSettings
    from bumpstop.identification import DynamicsModel
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot

    Vector = tuple[float, float, float]

_DIRECTION = "0,0,-1"
_PERIOD = 0.004


def command(
    robot: Annotated[
        str,
        typer.Argument(
            help="A built-in name, or the path of a URDF file.", show_default=False, autocompletion=complete_robot
        ),
    ],
    pose_deg: Annotated[
        str, typer.Option("--pose-deg", metavar="LIST", help="Joint positions [deg, or m]: 0,30,0.", show_default=False)
    ],
    thresholds: Annotated[
        str, typer.Option(metavar="LIST|FILE", help="Thresholds [Nm]: 20,10,inf, or a file.", show_default=False)
    ],
    direction: Annotated[str, typer.Option(metavar="LIST", help="In which the arm pushes, base frame.")] = _DIRECTION,
    link: Annotated[str | None, typer.Option(help="Link the force acts on.", show_default="the tip")] = None,
    point_m: Annotated[str, typer.Option("--point-m", metavar="LIST", help="Where, in that link's frame.")] = "0,0,0",
    noise_sd: Annotated[str, typer.Option(metavar="LIST", help="Noise of the residual [Nm].")] = "0",
    noise_mean: Annotated[str, typer.Option(metavar="LIST", help="Its mean [Nm].")] = "0",
    z: Annotated[float, typer.Option(help="Move the thresholds out by this many standard deviations.")] = 0.0,
    stiffness: Annotated[float, typer.Option(help="Of what is hit [N/m], for the torque's growth.")] = 0.0,
    speed_mm_s: Annotated[float, typer.Option("--speed-mm-s", help="At which it is hit.")] = 0.0,
    period: Annotated[float, typer.Option(help="Between two samples [s].")] = _PERIOD,
    model: Annotated[
        str | None,
        typer.Option(help="Joint model or fitted dynamics, for what friction holds of a standing arm."),
    ] = None,
    stiction: Annotated[
        str | None,
        typer.Option(metavar="LIST", help="The same stated [Nm], one or all; or a share of the model's: 50%."),
    ] = None,
    base: Annotated[str | None, typer.Option(help="Link of the URDF where the chain begins.")] = None,
    tip: Annotated[str | None, typer.Option(help="Link of the URDF where the chain ends.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Compute the undetectable forces at a pose: the largest, along a direction, and directions that load no joint."""
    import numpy as np

    from bumpstop.detection import DetectorSettings
    from bumpstop.detection.loop.unknown_gains import force_thresholds
    from bumpstop.model.pose_limits import check_pose
    from bumpstop.model.serial_chain import checked_point
    from bumpstop.study import to_jsonable

    arm = load_robot(robot, base, tip)
    for name, value in (("--stiffness", stiffness), ("--speed-mm-s", speed_mm_s), ("--period", period), ("--z", z)):
        if not 0 <= value < math.inf:
            raise InputError(name, f"is {value}", "wanted zero or more")
    _refuse_half_of_what_is_needed(noise_sd, z, stiffness, speed_mm_s, period)
    pose = numbers(pose_deg, "--pose-deg", arm.dof)
    q = [math.radians(x) if joint.kind == "revolute" else x for x, joint in zip(pose, arm.joints, strict=True)]
    check_pose(arm, np.array(q), "--pose-deg", in_degrees=True)
    law, along = thresholds_of(thresholds, arm), unit(direction, "--direction")
    known = _known(model, arm)
    rest, hidden = law.rest, _hidden(arm, known, stiction, DetectorSettings(**law.settings), q)
    limits, told = force_thresholds(arm, known, law.constant)
    assert rest is not None
    if hidden is None and rest.any():
        hidden = np.zeros(arm.dof)
    found = _found(
        arm,
        q,
        limits.tolist(),
        along,
        about := {
            "link": link,
            "point": checked_point(numbers(point_m, "--point-m", 3), "--point-m"),
            "noise_sd": _one_or_all(noise_sd, "--noise-sd", arm.dof),
            "noise_mean": _one_or_all(noise_mean, "--noise-mean", arm.dof),
            "z": z,
        },
        stiffness * speed_mm_s / 1e3,
        period,
    )
    found |= {
        "standing": None if hidden is None else _standing(arm, q, limits + rest, hidden, along, about),
        "notes": [*arm.doubts, *_doubts(arm, known, hidden), *told, *([law.motion_note] if law.motion_note else [])],
    }
    if as_json:
        typer.echo(json.dumps(to_jsonable(found), allow_nan=False, indent=2))
    else:
        _print(found, arm)


def stiction_of(text: str, dof: int) -> tuple[float, ...]:
    """What ``--stiction`` says in Nm, of every joint."""
    values = _one_or_all(text, "--stiction", dof)
    if min(values) < 0:
        raise InputError("--stiction", f"{text[:80]!r} cannot be used", "wanted zero or more")
    return tuple(values)


def _known(model: str | None, arm: Robot) -> JointTorqueModel | DynamicsModel | None:
    """What ``--model`` names, if anything."""
    from bumpstop.cli.identification.arm_recordings import is_dynamics
    from bumpstop.identification import DynamicsFit
    from bumpstop.identification.arm_of_fit import check_arm_of_fit
    from bumpstop.joint import JointTorqueModel

    if model is None:
        return None
    if not is_dynamics(model):
        return JointTorqueModel.load(model)
    known = DynamicsFit.load(model).model
    check_arm_of_fit(known, arm, "robot")
    return known


def _hidden(
    arm: Robot,
    known: JointTorqueModel | DynamicsModel | None,
    stiction: str | None,
    settings: DetectorSettings,
    q: list[float],
) -> FloatArray | None:
    """(dof,) torque that friction holds of joints that stand at a pose.

    NaN of a joint of which the model does not know it; None: nothing says how much of any.
    """
    import numpy as np

    from bumpstop.detection.standing import hidden_torques

    share = 1.0
    if stiction is not None and not stiction.endswith("%"):
        if known is not None:
            raise InputError("--stiction", "has no meaning with --model", "give one, or a share of the model's: 50%")
        return np.array(stiction_of(stiction, arm.dof))
    if stiction is not None:
        (percent,) = numbers(stiction.removesuffix("%"), "--stiction", 1)
        if not 0 <= percent <= 1000:
            raise InputError("--stiction", f"is {stiction}", "wanted 0 to 1000 %")
        if known is None:
            raise InputError("--stiction", f"{stiction} of what is not known", "give --model, or Nm")
        share = percent / 100
    return None if known is None else share * hidden_torques(arm, known, settings, q)


def _doubts(arm: Robot, known: JointTorqueModel | DynamicsModel | None, hidden: FloatArray | None) -> list[str]:
    """What speaks against the model, and joints of known gain of which it does not know what friction holds."""
    from bumpstop.detection.loop.unknown_gains import unknown_gains
    from bumpstop.identification.fit_verdict import as_sentences, fit_faults

    if known is None or hidden is None:
        return []
    told, gainless = as_sentences(fit_faults(known)), unknown_gains(arm, known)
    unknown = [joint.name for j, joint in enumerate(arm.joints) if math.isnan(hidden[j]) and j not in gainless]
    if unknown:
        told.append(f"{', '.join(unknown)}: what friction holds is not known: standing still it counts for nothing.")
    return told


def _standing(
    arm: Robot, q: list[float], limits: FloatArray, hidden: FloatArray, along: Vector, about: dict[str, Any]
) -> dict[str, Any]:
    """What stays undetected while all joints stand still: thresholds at rest and what friction holds.

    A joint of which that is not known (NaN) counts for nothing, as one that is not monitored.
    """
    import numpy as np

    from bumpstop.detection import undetectable_force_along, undetectable_forces

    wide = limits + np.nan_to_num(hidden, nan=math.inf)
    forces = undetectable_forces(arm, q, wide, **about)
    return {
        "dead_zone_Nm": hidden.tolist(),
        "largest_force_N": float(forces.largest),
        "largest_detectable_force_N": float(forces.largest_detectable),
        "force_along_N": float(undetectable_force_along(arm, q, along, wide, **about)),
    }


def _refuse_half_of_what_is_needed(noise_sd: str, z: float, stiffness: float, speed: float, period: float) -> None:
    """Options that count in pairs alone; the torque grows at a rate only where both stiffness and speed are known."""
    for option, given, other, wanted in (
        ("--noise-sd", noise_sd != "0", "--z", z > 0),
        ("--z", z > 0, "--noise-sd", noise_sd != "0"),
        ("--stiffness", stiffness > 0, "--speed-mm-s", speed > 0),
        ("--speed-mm-s", speed > 0, "--stiffness", stiffness > 0),
        ("--period", period != _PERIOD, "--stiffness and --speed-mm-s", stiffness > 0),
    ):
        if given and not wanted:
            raise InputError(option, f"has no effect without {other}", "give both, or neither")


def three(text: str, option: str) -> tuple[float, float, float]:
    """A vector of three."""
    x, y, z = numbers(text, option, 3)
    return x, y, z


def unit(text: str, option: str) -> tuple[float, float, float]:
    """A direction: a vector of three, made as long as one."""
    x, y, z = three(text, option)
    if not (length := math.hypot(x, y, z)) > 0:
        raise InputError(option, "has no length", "for example 0,0,-1")
    return x / length, y / length, z / length


def _one_or_all(text: str, option: str, dof: int) -> list[float]:
    return numbers(text, option, dof) if "," in text else numbers(text, option, 1) * dof


def _found(
    robot: Robot,
    q: list[float],
    thresholds: list[float],
    direction: tuple[float, float, float],
    about: dict[str, Any],
    force_rate: float,
    period: float,
) -> dict[str, Any]:
    import numpy as np

    from bumpstop.detection import (
        largest_undetected_force,
        largest_undetected_torque,
        undetectable_force_along,
        undetectable_forces,
    )
    from bumpstop.model import singular_values

    link, point = about["link"], about["point"]
    along = np.array(direction)
    undetectable = undetectable_forces(robot, q, thresholds, **about)
    columns = robot.jacobian(q, link, point)[:3]
    per_newton = columns.T @ along
    # What is left of a lever that is none is a rounding.
    per_newton[np.abs(per_newton) <= 1e-12 * np.linalg.norm(columns, axis=0).max()] = 0.0
    # From the far threshold to the near one, which is moved out.
    moved_out = about["z"] * np.array(about["noise_sd"])
    torques = largest_undetected_torque(thresholds, per_newton * force_rate, period) + moved_out
    forces = largest_undetected_force(torques, per_newton)
    linear = singular_values(robot, q, link, point)
    six = singular_values(robot, q, link, point, rows="all")
    joints = zip(robot.joints, thresholds, per_newton, torques, forces, strict=True)
    return {
        "largest_force_N": float(undetectable.largest),
        "largest_detectable_force_N": float(undetectable.largest_detectable),
        "largest_force_vector_N": undetectable.largest_vector.tolist(),
        "null_space": undetectable.null_space.tolist(),
        "direction": along.tolist(),
        "force_along_N": float(undetectable_force_along(robot, q, along, thresholds, **about)),
        "worst_case_force_along_N": float(forces.min()),
        "singular_values_monitored": undetectable.singular_values.tolist(),
        "singular_values_linear": linear.tolist(),
        "condition_number_linear": _ratio(linear.tolist()),
        "singular_values_six_rows": six.tolist(),
        "condition_number_six_rows": _ratio(six.tolist()),
        "joints": [
            {
                "name": joint.name,
                "threshold_Nm": threshold,
                "torque_per_newton_Nm_N": float(share),
                "largest_undetected_torque_Nm": float(torque),
                "largest_undetected_force_N": float(force),
            }
            for joint, threshold, share, torque, force in joints
        ],
    }


def _ratio(values: list[float]) -> float:
    return values[0] / values[-1] if values[-1] > 1e-12 * values[0] else math.inf


def _print(found: dict[str, Any], arm: Robot) -> None:
    import numpy as np
    from rich.table import Table

    from bumpstop.detection.standing import hidden_text
    from bumpstop.model import unit_of
    from bumpstop.terminal import terminal

    console = terminal()
    largest_vector = _row(found["largest_force_vector_N"])
    if math.isfinite(found["largest_force_N"]):
        console.print(f"largest undetectable force: {found['largest_force_N']:.4g} N, as ({largest_vector}) N")
    else:
        console.print("largest undetectable force: unbounded")
        for axis in found["null_space"]:
            console.print(f"  not detectable at all: along ({_row(axis)})")
        if found["largest_detectable_force_N"] > 0:
            console.print(f"  across that: {found['largest_detectable_force_N']:.4g} N, as ({largest_vector}) N")
    console.print(
        f"along ({_row(found['direction'])}): {_newtons(found['force_along_N'])}; from anywhere between thresholds "
        f"{_newtons(found['worst_case_force_along_N'])}"
    )
    if (standing := found["standing"]) is None:
        console.print(
            "These are for joints that move. Of a standing joint friction hides more: give --model or --stiction."
        )
    else:
        hidden = hidden_text(np.array(standing["dead_zone_Nm"]))
        console.print(
            f"standing still, where friction holds {hidden} {unit_of(*arm.joints)}: largest "
            f"{_newtons(standing['largest_force_N'])}; along the direction {_newtons(standing['force_along_N'])}"
        )
    for note in found["notes"]:
        console.print(f"note: {note}")
    table = Table(box=None, pad_edge=False)
    torque = unit_of(*arm.joints)
    for heading in ("joint", f"threshold, {torque}", f"{torque} per N", f"undetected, {torque}", "as force, N"):
        table.add_column(heading, justify="left" if heading == "joint" else "right")
    for joint in found["joints"]:
        table.add_row(joint["name"], *(_figure(value) for key, value in joint.items() if key != "name"))
    console.print(table)
    linear = unit_of(*arm.joints, turning="m/rad", sliding="1")
    for words, key in ((f"linear, {linear}", "linear"), ("all six, m and rad mixed", "six_rows")):
        values = " ".join(f"{value:.4g}" for value in found[f"singular_values_{key}"])
        number = _figure(found[f"condition_number_{key}"])
        console.print(f"singular values ({words}): {values}; condition number {number}")


def _row(values: list[float]) -> str:
    return ", ".join(f"{round(value, 4) + 0.0:.4g}" for value in values)


def _newtons(value: float) -> str:
    return f"{value:.4g} N" if math.isfinite(value) else "unbounded"


def _figure(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "unbounded"
