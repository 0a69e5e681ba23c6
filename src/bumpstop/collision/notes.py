"""Notes of a distribution: what was assumed, and what was cut short."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.curve import states_at_reactions
from bumpstop.collision.scenario.unused_keys import unused_notes
from bumpstop.collision.verdict.alarm_rate import alarm_rate
from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S

if TYPE_CHECKING:
    from bumpstop.collision.outcome import CollisionOutcome

# Of the extension of a pose that was made for a level [%].
_ROUNDING = 1e-4


def notes_of(result: CollisionOutcome, warnings: tuple[str, ...]) -> list[str]:
    """All of them, in the order in which they are read, behind the warnings of its verdict."""
    problem = result.problem
    scenario, limits = problem.scenario, problem.limits
    # What a robot's file is doubted for may stand beside the verdict, too.
    unused = unused_notes(scenario, problem.deceleration)
    notes = [*dict.fromkeys((*warnings, *problem.notes)), *unused]
    contact, detector = scenario.contact, scenario.detector
    notes.extend(_extension_notes(result))
    notes.extend(_contact_notes(result))
    notes.extend(_noise_notes(result))
    notes.append(f"{(words := alarm_rate(problem).words)[0].upper()}{words[1:]}, the detector armed all the time.")
    notes.extend(result.motion_notes())
    if contact.peak_factor == 1 and limits is not None:
        notes.append("Pressure is taken as even over the contact area (peak factor 1).")
    if limits is not None:
        notes.append(
            f"Limits: {limits.table}, {limits.label}; force: {limits.force_source} (status: {limits.force_status})."
        )
    transient = problem.transient_limits
    if transient is not None and limits is not None:
        notes.append(
            f"Contact is judged in two phases: by {transient.force_N:g} N in its first {FIRST_PHASE_S:g} s, by "
            f"{limits.force_N:g} N after them."
        )
    notes.extend(result.end_notes())
    notes.extend(line_end_notes(result))
    unmonitored = [str(j + 1) for j in np.flatnonzero(~np.isfinite(problem.thresholds))]
    if unmonitored:
        notes.append(f"Not monitored: joint {', '.join(unmonitored)}.")
    if detector.arming_delay_s > 0:
        notes.append(f"The detector is not armed for the first {detector.arming_delay_s:g} s.")
    notes.append("This is an engineering estimate, not a certified safety function.")
    return notes


def line_end_notes(result: CollisionOutcome) -> list[str]:
    """What an arm does that cannot follow its line any farther."""
    problem, curve = result.problem, result.curve
    if problem.trajectory is not None:
        return []
    notes, cut = [], curve.line.cut_step
    if cut >= 0:
        step = problem.scenario.simulation.step_s
        joint = curve.line.end_joint
        where = f"joint {joint + 1} reaches its limit" if joint >= 0 else "a singularity is met"
        notes.append(
            f"Where {where}, after {cut * step:.3g} s, the arm brakes at its acceleration limits; no reaction begins "
            "after that."
        )
    return notes


def _extension_notes(result: CollisionOutcome) -> list[str]:
    """Where reactions begin at an extension that the stopping table does not know."""
    problem, times = result.problem, result.problem.deceleration.times
    if times is None or times.levels is None:
        return []
    trajectory = problem.trajectory
    q = states_at_reactions(problem, result.curve)[0] if trajectory is None else trajectory.position
    extended, (low, high) = 100 * times.extended(problem.robot, q), times.levels
    told = "Where reactions begin the arm is extended to {:.3g} % of its reach, {} the stopping table's {:.3g} %: its "
    notes = []
    if extended.max() > 100 * high + _ROUNDING:
        notes.append(
            told.format(extended.max(), "beyond", 100 * high)
            + "times there count. Farther out an arm mostly takes longer to stop, and the force may be higher."
        )
    if extended.min() < 100 * low - _ROUNDING:
        notes.append(
            told.format(extended.min(), "below", 100 * low)
            + "times there count. Farther in an arm mostly stops sooner, so that is mostly the safe side."
        )
    return notes


def _elastic_notes(result: CollisionOutcome) -> list[str]:
    """Which arm was judged, and what of it is assumed."""
    drive_train = result.problem.drive_train
    known = [
        f"{name.replace('_', ' ')} ({status})"
        for name, status in drive_train.status.items()
        if status != "assumed" and name != "torque_limit"
    ]
    notes = [
        "The arm gives way: gears are springs between links and rotors, position servos hold the rotors on the "
        "reference, all linear about the pose of contact. The detector's residual comes from the same motion."
    ]
    if known:
        notes.append(f"Known of it: {', '.join(known)}.")
    notes.append(
        "Such an arm may pass the rigid one's forces: it overshoots its reference when it stops, and is detected later."
    )
    if np.any(drive_train.acceleration_feedforward < 1):
        notes.append(
            "Its controller feeds less than all of the acceleration forward, so it lags while the motion speeds up; "
            "what the detector makes of that before contact is left out of the false alarms."
        )
    return notes


def _contact_notes(result: CollisionOutcome) -> list[str]:
    problem = result.problem
    if problem.body_mass is None:
        body = f"the body is clamped behind {_spring(result)}{_gauge(result)}"
        if problem.elastic:
            return [*_elastic_notes(result), f"{body[0].upper()}{body[1:]}."]
        return [f"The arm is position-driven: contact does not slow it, and {body}."]
    notes = [
        f"The body can get away: a mass of {problem.body_mass:g} kg behind {_spring(result)}, judged by transient "
        "limits. Contact ends where body and arm part."
    ]
    bounds = result.impact_bounds
    assert bounds is not None
    if problem.elastic:
        notes.extend(_elastic_notes(result))
    elif problem.scenario.contact.arm == "two_mass":
        notes.append(
            f"Arm and body are two masses: {problem.moving_mass:.4g} kg reduced, the arm's share from its "
            f"{bounds.status} inertia."
        )
    else:
        notes.append("The arm is position-driven: contact does not slow it.")
    anywhere = problem.trajectory is not None and problem.scenario.motion.contact_onset_s == "uniform"
    which = "the impact that is hardest on average" if anywhere else "the impact"
    undetected = f"Undetected, {which} comes to {bounds.position_driven:.4g} N"
    if bounds.reduced_mass is None:
        what = "looks like placeholders" if problem.robot.inertia_doubts else "is not known"
        notes.append(f"{undetected}; the arm's inertia {what}, so the reduced mass gives no upper limit.")
    else:
        notes.append(
            f"{undetected}, or {bounds.reduced_mass:.4g} N if the arm gives way as a free mass of "
            f"{bounds.arm_mass:.4g} kg (its inertia is {bounds.status})."
        )
    return notes


def _spring(result: CollisionOutcome) -> str:
    """What the arm meets, with its damper where it has one."""
    damping = result.scenario.contact.damping_Ns_m
    damper = f" with a damper of {damping:g} Ns/m" if damping > 0 else ""
    return f"a linear spring of {result.problem.stiffness:g} N/m{damper}"


def _gauge(result: CollisionOutcome) -> str:
    """The gauge behind that spring; one without a mass is in series with it, and has a note of its own."""
    contact = result.scenario.contact
    if contact.gauge_mass_kg is None:
        return ""
    return f", before a gauge of {contact.gauge_mass_kg:g} kg on a spring of {contact.gauge_spring_N_m:g} N/m"


def _noise_notes(result: CollisionOutcome) -> list[str]:
    problem, detector = result.problem, result.scenario.detector
    notes = []
    if problem.residuals is not None:
        notes.append("Noise is measured: its correlation between joints and in time is kept within blocks.")
    elif detector.noise_correlation != 0:
        notes.append(
            f"Noise is Gaussian, correlated by {detector.noise_correlation:g} from one control cycle to the next, "
            "independent between joints."
        )
    else:
        notes.append("Noise is Gaussian and white: independent from one control cycle to the next and between joints.")
    if detector.residual == "observer":
        notes.append(
            f"The residual is a momentum observer's with gain {detector.observer_gain_1_s:g} 1/s: it follows a contact "
            f"torque with a time constant of {1e3 / detector.observer_gain_1_s:.3g} ms. The noise given is that of the "
            "observer's residual."
        )
    return notes
