"""Notes beside a verdict: what makes it mean less than it says, one function for each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.arm.pressing_limit import doubted_limits
from bumpstop.collision.curve import states_at_reactions
from bumpstop.collision.distribution.distribution import NEGLIGIBLE
from bumpstop.collision.probability_text import accepted_percent, apart, percent
from bumpstop.collision.stopping.stopping_times import STANDING
from bumpstop.collision.verdict.as_given import as_given, assumed_values
from bumpstop.collision.verdict.finer_steps import JudgedForce, finer_steps
from bumpstop.collision.verdict.pose_of_contact import pose_of_contact
from bumpstop.collision.verdict.unit_slips import unit_slips

if TYPE_CHECKING:
    from collections.abc import Callable

    from bumpstop.collision.outcome import CollisionOutcome
    from bumpstop.collision.scenario.scenario import Scenario
    from bumpstop.collision.verdict.verdict import Verdict

# Where more than this share of cases presses nothing, there is no verdict.
MAX_UNTOUCHED = 0.5
# A smaller share is worth no word, unless it hides a risk.
_MUCH_UNTOUCHED = 0.1
# Of so many runs the standard error is a third.
_MIN_EXPECTED_RUNS = 10
# A normal farther from the motion than this is approached at less than half the speed.
_MIN_COSINE = 0.5
# An arm that starts from rest is as good as at full speed from this share on.
_FULL_SPEED = 0.9
# Reactions looked at for whether a sooner one takes the arm farther, and by what share of the way since the tick.
_REACTIONS, _FARTHER = 64, 0.02


def verdict_notes(
    result: CollisionOutcome, verdict: Verdict, evaluate: Callable[[Scenario], JudgedForce] | None
) -> list[str]:
    """All of them, in the order in which they are read.

    Args:
        result: of the collision.
        verdict: of it.
        evaluate: gives the result of another scenario; None: finer steps and other places of contact are not looked at.
    """
    return [
        *as_given(result.scenario),
        *assumed_values(result.scenario),
        *sample_notes(result),
        *_nothing_hit_note(result, verdict),
        *_over_at_once_note(result),
        *_head_note(result),
        *_pressure_note(result),
        *_normal_note(result),
        *_rest_note(result),
        *_assumed_arm_note(result),
        *_torque_limit_note(result),
        *_own_brakes_note(result),
        *_unlisted_joints_note(result),
        *_sooner_note(result),
        *_swing_note(result),
        *(finer_steps(result, verdict, evaluate) if evaluate is not None else ()),
        *(pose_of_contact(result, verdict, evaluate) if evaluate is not None else ()),
        *unit_slips(result),
    ]


def sample_notes(result: CollisionOutcome) -> list[str]:
    """Whether a sampled distribution is too small to be judged by the accepted probabilities."""
    settings = result.scenario.verdict
    risk = (
        settings.max_false_alarm
        if result.problem.limits is None
        else min(settings.accepted_probability, settings.max_false_alarm)
    )
    if result.samples is None or result.samples * risk >= _MIN_EXPECTED_RUNS:
        return []
    return [
        f"{result.samples} sampled collisions are too few to judge by: a probability of the accepted "
        f"{accepted_percent(risk)} is some {result.samples * risk:.2g} of them."
    ]


def _over_at_once_note(result: CollisionOutcome) -> list[str]:
    """A motion that ends before the first tick of the detector is none, and what is judged is an arm that brakes."""
    problem, curve = result.problem, result.curve
    if problem.trajectory is not None or not 0 <= curve.line.cut_step < problem.period_steps:
        return []
    joint = curve.end_joint
    where = f"joint {joint} is at its limit" if curve.end == "joint_limit" else "the arm is near a singularity"
    return [f"The motion is over as it begins: {where}. What is judged is an arm that only brakes."]


def _assumed_arm_note(result: CollisionOutcome) -> list[str]:
    """Assumed gears and servos decide the force."""
    if not result.problem.elastic:
        return []
    assumed = [name.replace("_", " ") for name in result.problem.drive_train.assumed if name != "torque_limit"]
    if not assumed:
        return []
    return [
        f"The forces rest on an ASSUMED drive train ({', '.join(assumed)}): measured ones may be higher. Vary [arm] or "
        "identify it."
    ]


def _torque_limit_note(result: CollisionOutcome) -> list[str]:
    """Torque limits that cannot hold the arm bound no force."""
    doubt = doubted_limits(result.problem)
    return [doubt] if doubt else []


def _own_brakes_note(result: CollisionOutcome) -> list[str]:
    """Gears of an elastic arm carry the torque of a reaction in which joints keep their ratios."""
    if not result.problem.elastic or result.scenario.reaction.stop_category != 0:
        return []
    return [
        "With reaction.stop_category = 0 every joint brakes by itself. The path of the contact point knows that, the "
        "torque of the gears does not: the force may be 13 % higher."
    ]


def _unlisted_joints_note(result: CollisionOutcome) -> list[str]:
    """Joints of which a table says nothing take its longest time: the safe side only where joints keep their ratios."""
    times = result.problem.deceleration.times
    if times is None or not result.problem.deceleration.independent:
        return []
    rates = np.abs(states_at_reactions(result.problem, result.curve)[1])
    moving = (rates > STANDING * rates.max(axis=1, keepdims=True)).any(axis=0)
    unlisted = [str(joint) for joint in times.unlisted if moving[joint - 1]]
    if not unlisted:
        return []
    return [
        f"Joint {', '.join(unlisted)} is not in the stopping table and takes the longest time that it has. With "
        "reaction.stop_category = 0 every joint brakes by itself, and that is not the safe side: where such a joint "
        "stops sooner the force may be higher, in trials by up to 84 %."
    ]


def _sooner_note(result: CollisionOutcome) -> list[str]:
    """Near a singularity to react sooner may take the arm farther: only the peak force of clamped contact knows."""
    problem, curve = result.problem, result.curve
    judged = problem.gives_way or problem.transient_limits is not None
    if problem.trajectory is not None or problem.latency_steps == 0 or not judged or curve.ticks == 0:
        return []
    # An arm that cannot follow its line as far brakes where it ends.
    begins = np.minimum(
        1 + problem.period_steps * np.arange(curve.ticks) + problem.latency_steps, len(curve.distance) - 1
    )
    ticks = np.unique(np.linspace(0, curve.ticks - 1, _REACTIONS).astype(int))
    paths = curve.kernel.reaction_paths([int(k) for k in ticks], [-1e9] * ticks.size)
    here = curve.tick_distance[ticks]
    latest = [max(path.max(), curve.distance[1 : 1 + k].max()) for path, k in zip(paths, begins[ticks], strict=True)]
    farther = curve.max_distance[ticks] - np.maximum(latest, here)
    if not (farther > _FARTHER * (curve.max_distance[ticks] - here)).any():
        return []
    what = "contact that gives way follows" if problem.gives_way else "the second phase of contact follows"
    return [
        f"An arm that reacts sooner than after reaction.latency_s gets up to {1e3 * farther.max():.3g} mm farther "
        f"here, as beside a singularity: {what} the latest reaction alone. Look at shorter latencies, too."
    ]


def _swing_note(result: CollisionOutcome) -> list[str]:
    """Whether an arm that reverses may press harder than it does as long as it is followed."""
    if result.problem.trajectory is not None:
        return []
    share = result.left_in_contact_probability
    if not share > NEGLIGIBLE:
        return []
    return [
        f"In {percent(share, integrated=result.kind == 'exact')} of cases the reversing arm has not left the body "
        "where its motion is followed no farther: beside a singularity it swings forward again, or does not get back. "
        "Its peak force is that until then; later it may press harder."
    ]


def nothing_hit(result: CollisionOutcome) -> str:
    """Why most cases press nothing; empty where most do."""
    untouched = untouched_share(result)
    if not untouched > MAX_UNTOUCHED:
        return ""
    share = percent(untouched)
    if result.no_contact_probability < untouched / 2:
        return f"In {share} of cases a false alarm keeps the arm from the body: too few collisions to judge."
    return f"In {share} of cases nothing is hit, as the motion ends before contact{result.why_no_contact()}."


def untouched_share(result: CollisionOutcome) -> float:
    """Probability that no force at all is exerted."""
    touched = result.peak_force.exceedance(0.0)
    return 0.0 if math.isnan(touched) else 1 - touched


def _nothing_hit_note(result: CollisionOutcome, verdict: Verdict) -> list[str]:
    """Cases without any force dilute the probability of exceeding a limit."""
    untouched, limits = untouched_share(result), result.problem.limits
    if limits is None or not limits.permitted or untouched > MAX_UNTOUCHED:
        return []
    over = max(verdict.p_over_force or 0.0, verdict.p_over_pressure or 0.0)
    alone = over / (1 - untouched)
    hides = over <= verdict.accepted_probability < alone
    if not (hides or untouched > _MUCH_UNTOUCHED):
        return []
    accepted = verdict.accepted_probability
    more = f", more than the accepted {accepted_percent(accepted)}" if hides else ""
    return [
        f"In {percent(untouched)} of cases nothing is hit; they count as below every limit. Of the others alone "
        f"{apart(alone, accepted, percent)} exceed one{more}."
    ]


def _head_note(result: CollisionOutcome) -> list[str]:
    """Limits of the head are none to work up to."""
    limits = result.problem.limits
    return [limits.head_note] if limits is not None and limits.head_note else []


def _pressure_note(result: CollisionOutcome) -> list[str]:
    limits = result.problem.limits
    if limits is None or not limits.permitted or limits.pressure_N_cm2 is not None:
        return []
    return [
        f"{limits.table} has no pressure limit for {limits.label}: the force alone is judged, however small the "
        "contact area."
    ]


def _normal_note(result: CollisionOutcome) -> list[str]:
    """A force along a normal that lies across the motion is that of a fraction of the speed."""
    if result.scenario.contact.normal is None:
        return []
    cosine = result.approach_cosine()
    if not cosine < _MIN_COSINE:
        return []
    angle = math.degrees(math.acos(max(-1.0, min(1.0, cosine))))
    return [
        f"contact.normal lies {angle:.3g} degrees off the motion: the body is approached at {percent(cosine)} of the "
        "speed, and the force is that of this share. Leave contact.normal out for a body across the motion."
    ]


def _rest_note(result: CollisionOutcome) -> list[str]:
    """From rest the gap decides how fast the arm is when it touches."""
    if result.problem.trajectory is not None or result.scenario.motion.start != "rest":
        return []
    problem, distance = result.problem, result.curve.distance
    # The farthest bodies but one in a thousand.
    scale = 3.29 if problem.offset_kind == "half_normal" else 1.0
    farthest = min(scale * problem.offset_size, float(distance.max()))
    ahead = int(np.argmax(distance >= farthest * (1 - 1e-12)))
    speed = float(np.diff(distance[: ahead + 1]).max(initial=0.0)) / problem.scenario.simulation.step_s
    share = speed / problem.approach_speed
    if share >= _FULL_SPEED:
        return []
    if result.scenario.contact.offset_law == "fixed":
        gap, remedy = "at the distance given", "Give the largest contact.offset_mm there can be"
    else:
        gap = f"within the gap of {1e3 * farthest:.3g} mm"
        remedy = 'Give contact.offset_law = "fixed" and contact.offset_mm'
    return [
        f"From rest the arm has reached no more than {percent(share)} of its speed when it touches, {gap}: a body "
        f'farther away is hit harder. {remedy}, or motion.start = "moving".'
    ]
