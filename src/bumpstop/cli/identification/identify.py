"""``bumpstop identify`` and ``bumpstop validate``: what recordings say of an arm, and how well it is predicted."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from bumpstop.cli.completion import complete_robot
from bumpstop.cli.folders import check_file, check_folder, check_inputs
from bumpstop.cli.identification.arm_recordings import (
    arm_of,
    built_in_or_path,
    carried_of,
    fit_notes,
    gravity_of,
    load_parts,
    model_files,
    payloads_of,
    recording_files,
)
from bumpstop.cli.identification.fit_options import FIT_FILES, check_options
from bumpstop.cli.identification.fit_verdict import with_faults
from bumpstop.errors import InputError
from bumpstop.text_files import list_items

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.model import Robot
    from bumpstop.recording import Recording

Files = Annotated[list[Path], typer.Argument(help="Recordings with motor currents or joint torques.")]
Columns = Annotated[Path | None, typer.Option(help="Column file of the recordings (TOML).")]
Begin = Annotated[float | None, typer.Option("--from", help="Begin at this time of each recording [s].")]
Until = Annotated[float | None, typer.Option(help="End at this time of each recording [s].")]
Payload = Annotated[
    list[str] | None, typer.Option(help="What the arm carries: MASS[,X,Y,Z] [kg, m], or NUMBER:... for one recording.")
]
Base = Annotated[str | None, typer.Option(help="Link of the URDF where the chain begins.")]
Tip = Annotated[str | None, typer.Option(help="Link of the URDF where the chain ends.")]
Topic = Annotated[str | None, typer.Option(help="Topic of a bag that has several with joint states.")]
MaxBad = Annotated[float, typer.Option(metavar="SHARE", help="Share of bad rows up to which they are dropped.")]
Gravity = Annotated[
    str | None,
    typer.Option(
        metavar="LIST",
        help="Free fall in the base frame [m/s2]: 0,0,9.80665 of an arm on the ceiling; default: the given model's, "
        "else 0,0,-9.80665.",
    ),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]


def identify(
    *,
    recordings: Annotated[
        list[Path] | None,
        typer.Argument(help="Recordings with motor currents or joint torques; with --pushes there may be none."),
    ] = None,
    robot: Annotated[
        str,
        typer.Option(
            help="A built-in name, or the path of a URDF file.", show_default=False, autocompletion=complete_robot
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write the model there: a .toml, or a folder for it and a report."),
    ] = None,
    columns: Columns = None,
    begin: Begin = None,
    until: Until = None,
    model: Annotated[
        Literal["joint", "dynamics", "payload", "drive-train"] | None,
        typer.Option(
            help="What to fit: joint (from currents), dynamics (from torques, or from currents with gains), payload or "
            "drive-train (rotors, servo, gears); default: by what is recorded."
        ),
    ] = None,
    payload: Payload = None,
    known: Annotated[
        list[str] | None,
        typer.Option(metavar="JOINT.NAME=VALUE", help="A parameter of a drive that is not to be fitted."),
    ] = None,
    cutoff: Annotated[float | None, typer.Option(help="Cut-off of the filter [Hz]; default: the best.")] = None,
    gravity: Gravity = None,
    shared_motor: Annotated[
        list[str] | None, typer.Option(help="Joints that share a motor, e.g. 5,6 or 5:1,6:-1.")
    ] = None,
    consistent: Annotated[
        bool, typer.Option("--consistent", help="Of dynamics: also fit inertias that bodies can have, as a URDF.")
    ] = False,
    inertia_uncertainty: Annotated[
        float | None,
        typer.Option(
            metavar="SHARE",
            help="Of joint models and payloads: relative standard uncertainty of the robot's inertia, in the errors.",
            show_default="0.05",
        ),
    ] = None,
    joint_model: Annotated[
        str | None, typer.Option(help="Of a payload: joint model that turns currents into torques, a name or a path.")
    ] = None,
    dynamics: Annotated[
        Path | None,
        typer.Option(
            help="Of a payload: dynamics that identify wrote, of the arm without it; --robot's inertia is not used."
        ),
    ] = None,
    mass: Annotated[
        float | None, typer.Option(help="Of a payload: its mass where it is known [kg]; its centre is looked for.")
    ] = None,
    second_moments: Annotated[
        bool, typer.Option("--second-moments", help="Of a payload: fit its inertia too, not that of a point.")
    ] = False,
    pushes: Annotated[
        Path | None, typer.Option(help="Of a drive train: table of static pushes against the tip (CSV), for the gears.")
    ] = None,
    protocol: Annotated[
        Path | None, typer.Option(help="Plan that was followed: fit step by step as Schroeder (2013).")
    ] = None,
    base: Base = None,
    tip: Tip = None,
    topic: Topic = None,
    max_bad: MaxBad = 0.01,
    as_json: AsJson = False,
) -> int:
    """Find a joint torque model from motor currents, inertia, friction and rotors from joint torques, or a payload.

    Exit status: 0 usable, 3 not usable, 2 bad input.
    """
    recordings = recordings or []
    if not recordings and (pushes is None or protocol is not None):
        raise InputError("recordings", "there are none", "wanted one or more, or --pushes for the gears alone")
    read = [*recording_files(recordings, columns), robot, *model_files(joint_model), *model_files(dynamics), pushes]
    _check_out(out, [*read, *model_files(protocol)], "protocol" if protocol is not None else model, consistent)
    options: dict[str, object] = {
        "--model": model,
        "--consistent": consistent,
        "--joint-model": joint_model,
        "--second-moments": second_moments,
        "--dynamics": dynamics,
        "--mass": mass,
        "--known": known,
        "--cutoff": cutoff,
        "--inertia-uncertainty": inertia_uncertainty,
        "--shared-motor": shared_motor,
        "--payload": payload,
        "--base": base,
        "--tip": tip,
        "--gravity": gravity,
        "--pushes": pushes,
    }
    if protocol is not None:
        from bumpstop.cli.schroeder2013.protocol import identify_by_protocol

        check_options("protocol", options)

        def load(arm: Robot) -> list[Recording]:
            return load_parts(recordings, columns, arm, begin, until, topic, max_bad)

        return identify_by_protocol(protocol, load, robot, out, as_json)
    _frequency("--cutoff", cutoff)
    falls = gravity_of(gravity)
    arm = arm_of(robot, base, tip)
    logs = load_parts(recordings, columns, arm, begin, until, topic, max_bad, payload)
    for log in logs:
        if log.current is None and log.tau is None and model != "drive-train":
            problem = f"{log.source} has neither motor currents nor joint torques"
            raise InputError("recording", problem, "wanted current_1 .. or tau_1 .., or a column file that names them")
    if model is None and not logs:
        model = "drive-train"
    elif model is None:
        model = "joint" if all(log.current is not None and log.tau is None for log in logs) else "dynamics"
    check_options(model, options)
    if not logs:
        for option in ("--payload", "--gravity", "--cutoff"):
            if options[option]:
                raise InputError(option, "has no meaning with pushes alone", "leave it out, or give recordings")
    with with_faults(logs):
        if model == "drive-train":
            from bumpstop.cli.identification.identify_drive_train import identify_drive_train_of

            return identify_drive_train_of(
                logs,
                arm,
                pushes=pushes,
                payloads=carried_of(payload, len(logs)),
                cutoff_hz=cutoff,
                gravity=falls,
                out=out,
                as_json=as_json,
            )
        if model == "joint":
            from bumpstop.cli.identification.identify_joint import identify_joint

            arms = payloads_of(payload, arm, len(logs))
            return identify_joint(
                logs,
                arms,
                robot=built_in_or_path(robot),
                known=known,
                cutoff_hz=cutoff,
                gravity=falls,
                inertia_uncertainty=inertia_uncertainty,
                out=out,
                as_json=as_json,
            )
        if model == "payload":
            from bumpstop.cli.identification.identify_payload import identify_what_is_carried

            return identify_what_is_carried(
                logs,
                arm,
                joint_model=joint_model,
                dynamics=dynamics,
                mass=mass,
                inertia=second_moments,
                cutoff_hz=cutoff,
                gravity=falls,
                inertia_uncertainty=inertia_uncertainty,
                out=out,
                as_json=as_json,
            )
        from bumpstop.cli.identification.identify_dynamics import identify_dynamics_of

        named = {"robot": built_in_or_path(robot)}
        named |= {key: value for key, value in (("base", base), ("tip", tip)) if value is not None}
        return identify_dynamics_of(
            logs,
            arm,
            named=named,
            groups=[_group(text, arm.dof) for text in shared_motor or []],
            carried=carried_of(payload, len(logs)),
            known=known,
            cutoff_hz=cutoff,
            gravity=falls,
            consistent=consistent,
            out=out,
            as_json=as_json,
        )


def validate(
    model: Annotated[Path, typer.Argument(help="Model that identify wrote.", show_default=False)],
    recordings: Files,
    robot: Annotated[
        str | None,
        typer.Option(
            help="A built-in name, or the path of a URDF file; default: the model's.", autocompletion=complete_robot
        ),
    ] = None,
    columns: Columns = None,
    begin: Begin = None,
    until: Until = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write a report into this folder.")] = None,
    contact_joint: Annotated[
        int | None,
        typer.Option(help="Joint whose torque gives the contact force; default: the joint that it loads most."),
    ] = None,
    filter_hz: Annotated[
        float | None, typer.Option("--filter", help="Cut-off at which they are compared [Hz]; default: the model's.")
    ] = None,
    payload: Payload = None,
    gravity: Gravity = None,
    base: Base = None,
    tip: Tip = None,
    topic: Topic = None,
    max_bad: MaxBad = 0.01,
    as_json: AsJson = False,
) -> int:
    """Compare what a model predicts with recordings: currents of a joint model, torques of dynamics.

    Exit status: 0 usable, 3 not usable there, 2 bad input.
    """
    from bumpstop.cli.identification.arm_recordings import is_dynamics

    check_folder(out)
    read = [*recording_files(recordings, columns), robot, *model_files(model)]
    check_inputs(out, read, "report.html")
    _frequency("--filter", filter_hz)
    falls = gravity_of(gravity)
    if not is_dynamics(model):
        from bumpstop.cli.identification.identify_joint import validate_joint
        from bumpstop.joint import JointTorqueModel

        if contact_joint is not None:
            raise InputError("--contact-joint", "is for dynamics", "currents are compared without contact")
        drives = JointTorqueModel.load(model)
        arm = arm_of(robot or drives.robot, base, tip)
        logs = load_parts(recordings, columns, arm, begin, until, topic, max_bad, payload)
        arms = payloads_of(payload, arm, len(logs))
        notes = fit_notes(model, logs)
        with with_faults(logs):
            return validate_joint(
                drives, logs, arms, filter_hz=filter_hz, gravity=falls, notes=notes, out=out, as_json=as_json
            )
    from bumpstop.cli.identification.identify_dynamics import validate_dynamics

    if contact_joint is not None and out is None:
        raise InputError("--contact-joint", "has no effect without --out: forces are compared in the report",
                         "give --out as well")  # fmt: skip
    for option, given in (("--robot", robot), ("--base", base), ("--tip", tip), ("--gravity", gravity)):
        if given:
            raise InputError(option, "is for joint models", "dynamics know their robot and how it was mounted")

    loaded: list[Recording] = []

    def load(arm: Robot) -> list[Recording]:
        loaded.extend(load_parts(recordings, columns, arm, begin, until, topic, max_bad, payload))
        return loaded

    with with_faults(loaded):
        return validate_dynamics(
            model, load, payload=payload, contact_joint=contact_joint, filter_hz=filter_hz, out=out, as_json=as_json
        )


def _check_out(out: Path | None, read: Sequence[str | Path | None], fit: str | None, consistent: bool) -> None:
    """Refuse a file or folder that cannot be written, or where a file that is read would be written over.

    ``fit``: a key of ``FIT_FILES``; None: what is recorded decides whether it is joint models or dynamics.
    """
    if out is not None and out.suffix == ".toml":
        check_file(out)
        for file in [out, *([out.with_suffix(".urdf")] if consistent else [])]:
            check_inputs(file, read)
        return
    check_folder(out)
    names = [FIT_FILES[each] for each in (("joint", "dynamics") if fit is None else (fit,))]
    check_inputs(out, read, "report.html", *names, *(["model.urdf"] if consistent else []))


def _frequency(option: str, value: float | None) -> None:
    if value is not None and not 0 < value < math.inf:
        raise InputError(option, f"is {value}", "wanted a frequency above 0 [Hz]")


def _group(text: str, dof: int) -> list[tuple[int, float]]:
    group = []
    for part in list_items(text):
        number, _, share = part.partition(":")
        try:
            joint, factor = int(number), float(share or 1)
        except ValueError:
            valid = f"for example 5,6 or 5:1,6:-1; joints are 1 to {dof}"
            raise InputError("--shared-motor", f"{text!r} cannot be used", valid) from None
        group.append((joint - 1, factor))
    return group
