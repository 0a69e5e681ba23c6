"""Pages of ``bumpstop identify --out`` and ``bumpstop validate --out``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.cli.identification.fit_verdict import reading_lines
from bumpstop.cli.option_names import as_options
from bumpstop.errors import InputError
from bumpstop.terminal import counted

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification import (
        ConsistentFit,
        CurrentComparison,
        DynamicsFit,
        FitVerdict,
        JointModelFit,
        Payload,
    )
    from bumpstop.identification.comparison import Comparison
    from bumpstop.model import Robot
    from bumpstop.recording import Recording
    from bumpstop.report.section import Part


def dynamics_report(
    fit: DynamicsFit,
    comparison: Comparison,
    logs: Sequence[Recording],
    folder: Path,
    *,
    where: str,
    contact_joint: int | None,
    bodies: ConsistentFit | None = None,
    payloads: Sequence[Payload | None] = (),
    verdict: FitVerdict | None = None,
) -> str:
    """Write the page on a fit and recordings; what was found of contact, in a sentence, or nothing.

    Args:
        fit: the model.
        comparison: what the terminal shows the scores of.
        logs: the recordings; of a single one that has a wrench, contact is compared, too.
        folder: of the page.
        where: on which rows, in words.
        contact_joint: whose torque the contact comparison uses, from 1; default: the joint that it loads most.
        bodies: inertias that bodies can have, or None.
        payloads: what each recording carried beyond what the arm of the fit did; default: nothing.
        verdict: on the fit or on the model, or None.
    """
    from bumpstop.identification.validation import contact_of
    from bumpstop.model import unit_of
    from bumpstop.report.identification.fit_verdict import VerdictPart
    from bumpstop.report.identification.inertias import InertiasPart
    from bumpstop.report.identification.parameters import ParametersPart, RecordingsPart
    from bumpstop.report.identification.validation import SelectionPart, write_validation_report

    contact = None
    if len(logs) == 1 and not any(payloads):
        with as_options({"joint": "--contact-joint"}):
            contact = contact_of(fit.model, logs[0], joint=None if contact_joint is None else contact_joint - 1)
        if contact is None and contact_joint is not None:
            absent = f"{logs[0].source} has no wrench" if logs[0].wrench is None else "no joint's torque is known"
            raise InputError("--contact-joint", f"has no effect: {absent}", "leave it out")
    elif contact_joint is not None:
        raise InputError("--contact-joint", "is for one recording without a declared payload", "leave it out")
    selection = SelectionPart(
        {f"{cutoff:g} Hz": 100 * share for cutoff, share in fit.held_out.items()},
        f"{fit.model.cutoff_hz:g} Hz",
        "The cut-off of the motion's filter is chosen by the error on fifths of the recording, each predicted from the "
        "other four: the largest that does as well as the best.",
        "5-fold cross-validation error [%]",
    )
    name = (Path(logs[0].source).name or "a recording") if len(logs) == 1 else f"{len(logs)} recordings"
    title = f"{fit.model.robot.title or fit.model.robot.name}: predicted torque, {name}"
    parts: list[Part] = [] if verdict is None else [VerdictPart(verdict)]
    parts += [] if bodies is None else [InertiasPart(bodies)]
    # With what a base parameter is joined to; gains follow them.
    names = [*fit.names, *list(fit.parameters)[len(fit.names) :]]
    closing = [
        ParametersPart(
            dict(zip(names, fit.parameters.values(), strict=True)),
            dict(zip(names, fit.standard_errors.values(), strict=True)),
            fit.unobservable,
        ),
        RecordingsPart(reading_lines(logs)),
    ]
    write_validation_report(
        comparison,
        folder,
        title=title,
        where=where,
        contact=contact,
        selection=selection,
        parts=parts,
        closing=closing,
    )
    if contact is None:
        return ""
    error, joint = contact.error[contact.judged], fit.model.robot.joints[contact.joint]
    most = f"{abs(error).mean():.3g} N on average, {abs(error).max():.3g} N at most" if error.size else "none judged"
    return (
        f"contact force by {joint.name}: error {most}; {counted(contact.not_judged, 'row')} not judged, torque there "
        f"below {contact.min_torque:.3g} {unit_of(joint)}"
    )


def joint_model_report(
    found: CurrentComparison,
    robot: Robot,
    logs: Sequence[Recording],
    folder: Path,
    *,
    where: str,
    verdict: FitVerdict,
    fit: JointModelFit | None = None,
) -> None:
    """Write the page on torques that a joint model makes of currents.

    Args:
        found: the model beside recordings.
        robot: whose joints it is of.
        logs: the recordings.
        folder: of the page.
        where: on which recordings, in words.
        verdict: on the fit or on the model.
        fit: how the model was chosen, or None.
    """
    from bumpstop.identification.drive.drive_quantities import drive_errors, drive_quantities
    from bumpstop.report.identification.fit_verdict import VerdictPart
    from bumpstop.report.identification.parameters import ParametersPart, RecordingsPart
    from bumpstop.report.identification.validation import SelectionPart, write_validation_report

    selection = None
    if fit is not None and fit.held_out:
        selection = SelectionPart(
            {f"{cutoff:g} Hz": 100 * share for cutoff, share in fit.held_out.items()},
            f"{fit.cutoff_hz:g} Hz",
            "The cut-off of the motion's filter is chosen by the 5-fold cross-validation error of currents.",
            "5-fold cross-validation error [%]",
        )
    title = f"{robot.title or robot.name}: torque estimated from current"
    write_validation_report(
        found.torques(),
        folder,
        title=title,
        where=where,
        selection=selection,
        parts=[VerdictPart(verdict)],
        closing=[
            ParametersPart(drive_quantities(found.model, robot), drive_errors(found.model)),
            RecordingsPart([*(f"note: {note}" for note in found.notes), *reading_lines(logs)]),
        ],
    )
