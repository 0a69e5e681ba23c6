"""Free contact: against closed forms, another integrator, MuJoCo and the sampled distribution."""

from __future__ import annotations

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import bumpstop as bs
from bumpstop import Scenario
from bumpstop.collision.tables import result_table
from collision.cases import FREE, OUTLASTING, control_group, free, reference_trace, swinging_forward
from collision.distribution.test_two_laws import compare

NEVER = {"detector__thresholds_Nm": [math.inf] * 7}


@pytest.mark.parametrize("name", list(FREE))
def test_exact_within_four_standard_errors_of_sampled(name: str) -> None:
    compare(FREE[name], 60_000, seed=21)


@pytest.mark.parametrize(("mass", "stiffness"), [(0.6, 75000.0), (4.4, 25000.0), (40.0, 9000.0), (0.05, 400000.0)])
@pytest.mark.parametrize("kind", ["uniform", "half_normal"])
def test_undetected_impact_is_v_root_mk(mass: float, stiffness: float, kind: str) -> None:
    scenario = free(
        mass, contact__stiffness_N_m=stiffness, contact__offset_law=kind, contact__offset_sd_s=0.01, **NEVER
    )
    result = bs.evaluate(scenario)
    expected = result.problem.approach_speed * math.sqrt(mass * stiffness)
    assert result.peak_force.mean == pytest.approx(expected, rel=1e-6)
    assert result.peak_force.quantile(0.999) == pytest.approx(expected, rel=2e-6)
    assert result.undetected_probability == pytest.approx(1)
    assert result.impact_bounds is not None
    assert result.impact_bounds.position_driven == pytest.approx(expected, rel=1e-12)
    assert result.contact_duration is not None
    assert result.contact_duration.mean == pytest.approx(math.pi * math.sqrt(mass / stiffness), rel=1e-4)
    # A rebound that nobody detects is no failure by itself.
    assert "never detected" not in result.verdict.reason


def test_a_body_touched_where_a_piece_of_a_step_ends_is_struck_all_the_same() -> None:
    """Two pieces of a step: a body in the middle between two steps is touched where the first piece ends."""
    for speed in (12, 14, 17, 20):
        scenario = free(
            0.1, contact__stiffness_N_m=75000.0, motion__velocity_mm_s=[0, 0, -speed], motion__start="rest",
            detector__thresholds_Nm=[1e4] * 7,
        )  # fmt: skip
        distance = bs.stopping_curve(bs.CollisionProblem.from_scenario(scenario)).distance
        places = 0.5 * (distance[1:-1] + distance[2:])[:: len(distance) // 8][:6]
        struck = []
        for place in places:
            fixed = scenario.with_values({"contact.offset_law": "fixed", "contact.offset_mm": 1e3 * float(place)})
            struck.append(bs.evaluate(fixed).peak_force.quantile(0.5))
        # All are struck at full speed but the nearest, which the arm meets while it still accelerates.
        assert min(struck[1:]) > 0.05 * max(struck) > 0


def test_one_detected_collision_against_a_general_integrator() -> None:
    """A fixed offset without noise is one path; the same equation by an adaptive Runge-Kutta method."""
    offset = 0.7e-3
    scenario = free(
        15.0, motion__velocity_mm_s=[0, 0, -120], contact__offset_law="fixed", contact__offset_mm=0.7,
        detector__noise_sd_Nm=0.0,
    )  # fmt: skip
    result = bs.evaluate(scenario)
    problem, curve = result.problem, result.curve
    drawn = bs.evaluate(scenario, samples=1)
    assert drawn.runs is not None
    tick = int(drawn.runs["tick"][0])
    begin = tick * problem.period_steps + 1
    reaction = curve.kernel.reaction_paths([tick], [-1.0])[0]
    path = np.concatenate([curve.distance[:begin], reaction])
    # Every simulation step by itself: the path is straight inside it.
    body, peak, at_tick = np.zeros(2), 0.0, 0.0
    for i in range(path.size - 1):

        def motion(t: float, state: np.ndarray, i: int = i) -> list[float]:
            y = path[i] + (path[i + 1] - path[i]) * t / 1e-3 - offset - state[0]
            return [state[1], problem.stiffness * max(0.0, y) / 15.0]

        solution = solve_ivp(motion, (0, 1e-3), body, rtol=1e-9, atol=1e-13, max_step=1e-4, dense_output=True)
        body = solution.y[:, -1]
        t = np.linspace(0, 1e-3, 201)
        forces = problem.stiffness * (path[i] + (path[i + 1] - path[i]) * t / 1e-3 - offset - solution.sol(t)[0])
        peak = max(peak, float(forces.max()))
        if i + 1 == begin:
            at_tick = float(forces[-1])
        if peak > 0 and forces[-1] < 0:
            break
    assert result.peak_force.mean == pytest.approx(peak, rel=1e-5)
    assert result.force_at_detection.mean == pytest.approx(at_tick, rel=1e-6)


def integrated(path: np.ndarray, offset: float, stiffness: float, mass: float, retreat: float) -> tuple[float, float]:
    """Peak force and contact time along a path straight between steps, then at ``retreat`` a step (zero: at rest)."""
    far = 2_000  # steps: more than any body needs
    path = np.concatenate([path, path[-1] + retreat * np.arange(1, far)])
    time = np.arange(path.size) * 1e-3
    first = int(np.argmax(path > offset))
    if not path[first] > offset:
        return 0.0, 0.0
    begin = float(time[first - 1] + 1e-3 * (offset - path[first - 1]) / (path[first] - path[first - 1]))

    def pushed(t: float, state: np.ndarray) -> list[float]:
        return [state[1], stiffness / mass * (np.interp(t, time, path) - offset - state[0])]

    def together(t: float, state: np.ndarray) -> float:
        return float(np.interp(t, time, path) - offset - state[0]) if t > begin + 1e-7 else 1.0

    together.terminal = True  # type: ignore[attr-defined]
    solution = solve_ivp(
        pushed, (begin, time[-1]), [0.0, 0.0], method="DOP853", max_step=5e-4, rtol=1e-9, atol=1e-14,
        events=together, dense_output=True,
    )  # fmt: skip
    end = float(solution.t_events[0][0])
    at = np.linspace(begin, end, 20_001)
    depth = np.interp(at, time, path) - offset - solution.sol(at)[0]
    return stiffness * float(depth.max()), end - begin


@pytest.mark.parametrize("name", list(OUTLASTING))
def test_contact_lasts_until_the_body_has_got_away(name: str) -> None:
    scenario = OUTLASTING[name]
    result = bs.evaluate(scenario, samples=400, seed=3)
    problem, curve, runs = result.problem, result.curve, result.runs
    assert runs is not None
    assert problem.body_mass is not None
    K, stops = problem.stiffness, scenario.reaction.kind == "stop"
    duration, peak = runs["duration"], runs["peak_force"]
    # The longest and the shortest contact, the hardest, an undetected one, and false alarms.
    picked = {int(np.argmax(duration)), int(np.argmin(np.where(duration > 0, duration, np.inf))), int(np.argmax(peak))}
    picked |= {int(i) for i in np.flatnonzero((runs["tick"] < 0) & (duration > 0))[:1]}
    picked |= {int(i) for i in np.flatnonzero((runs["force_at_detection"] == 0) & (runs["tick"] >= 0) & (peak > 0))[:2]}
    for run in sorted(picked):
        tick, offset = int(runs["tick"][run]), float(runs["offset"][run])
        steps = round(scenario.motion.duration_s / 1e-3)
        # An arm that cannot follow its line brakes, and does so without a reaction, too.
        path, retreat = np.append(curve.distance[: steps + 1], curve.line.braking), 0.0
        if tick >= 0:
            begin = min(tick * problem.period_steps + 1 + problem.latency_steps, curve.distance.size - 1)
            reaction = curve.kernel.reaction_paths([tick], [offset - 1e-3])[0]
            path = np.concatenate([curve.distance[:begin], reaction])
            retreat = 0.0 if stops or reaction.size < 2 else min(0.0, float(reaction[-1] - reaction[-2]))
        known_peak, known_duration = integrated(path, offset, K, problem.body_mass, retreat)
        assert peak[run] == pytest.approx(known_peak, rel=2e-5, abs=1e-4), run
        # The chord that finds the parting, mended once, leaves a microsecond.
        assert duration[run] == pytest.approx(known_duration, rel=2e-5, abs=2e-6), run


@pytest.mark.parametrize("name", list(OUTLASTING))
def test_exact_and_sampled_agree_where_contact_outlasts_the_reaction(name: str) -> None:
    compare(OUTLASTING[name], 60_000, seed=5)


@pytest.mark.parametrize("tick", [5, 14])
def test_an_arm_that_swings_forward_after_a_false_alarm_strikes_the_body(tick: int) -> None:
    """Beside a singularity the arm goes back before contact, and then farther than ever."""
    scenario = swinging_forward(2.0, tick, contact__kind="free", contact__body_mass_kg=5.0)
    result, reference = bs.evaluate(scenario), reference_trace(scenario)
    assert result.false_alarm_probability == 1.0
    path = np.append(0.0, reference.travel_m)
    touch = int(np.argmax(path > 2e-3))
    assert path[4 * tick + 1 : touch].min() < 0 < path[4 * tick + 1]
    peak, duration = integrated(path, 2e-3, result.problem.stiffness, 5.0, float(path[-1] - path[-2]))
    assert peak > 20
    assert result.peak_force.mean == pytest.approx(peak, rel=2e-5)
    assert result.contact_duration is not None
    assert result.contact_duration.mean == pytest.approx(duration, rel=1e-4)


@pytest.mark.parametrize("offset_mm", [0.01, 0.05])
def test_an_arm_that_speeds_up_keeps_pushing_a_heavy_body(offset_mm: float) -> None:
    """From rest, ever faster: bodies near the start are never let go before the arm has its speed."""
    scenario = free(
        75.0, contact__stiffness_N_m=5000.0, pose_deg=[6.1, 27.3, 49.7, -54.7, 52.0, -44.2, 65.6],
        motion__velocity_mm_s=[-111.4, 91.1, 204.4], motion__start="rest", motion__duration_s=2.3,
        contact__offset_law="fixed", contact__offset_mm=offset_mm, detector__thresholds_Nm=[1e6] * 7,
        reaction__joint_acceleration_rad_s2=0.5,
    )  # fmt: skip
    result, drawn, reference = (
        bs.evaluate(scenario),
        bs.evaluate(scenario, samples=10, seed=1),
        reference_trace(scenario),
    )
    peak, duration = integrated(np.append(0.0, reference.travel_m), offset_mm / 1e3, 5000.0, 75.0, 0.0)
    assert duration > 5 * math.pi * math.sqrt(75.0 / 5000.0), "half oscillations"
    assert result.undetected_probability == pytest.approx(1)
    for each in (result, drawn):
        assert each.peak_force.mean == pytest.approx(peak, rel=1e-4)
        assert each.contact_duration is not None
        assert each.contact_duration.mean == pytest.approx(duration, rel=1e-4)


def test_bodies_let_go_and_bodies_pushed_on_are_told_apart() -> None:
    """A point that hardly moves at first, and ever faster: the nearer bodies are pushed on, the others bounce off."""
    scenario = Scenario.from_dict(
        {
            "robot": "sia5d",
            "pose_rad": [
                1.5721191452,
                1.1843571682,
                2.829642280,
                1.0469884309,
                -1.7929561235,
                -1.6204416523,
                -2.9004130948,
            ],
            "motion": {
                "velocity_mm_s": [4.8279427876, 16.4245974042, 4.0134146749],
                "held_joints": [7],
                "duration_s": 0.2,
            },
            "contact": {
                "stiffness_N_m": 4369.66,
                "kind": "free",
                "body_mass_kg": 0.003498,
                "point_m": [-0.0851013701, 0.1333087883, 0.0701689312],
                "normal": [0.4608556887, 1.3007056137, 0.7490103241],
            },
            "detector": {"thresholds_Nm": [math.inf] * 7, "noise_sd_Nm": 1.0},
            "reaction": {"kind": "stop", "joint_acceleration_rad_s2": [26, 21, 16, 23, 0.986276358, 22, 28]},
        }
    )
    result, drawn = bs.evaluate(scenario), bs.evaluate(scenario, samples=20_000, seed=2)
    ours, theirs = result.contact_duration, drawn.contact_duration
    assert ours is not None
    assert theirs is not None
    assert theirs.quantile(0.7) > 2 * theirs.quantile(0.3), "some are pushed on, some are not"
    assert ours.mean == pytest.approx(theirs.mean, abs=4 * theirs.sd / math.sqrt(20_000))
    for p in (0.01, 0.2, 0.8, 0.99):
        assert ours.quantile(p) == pytest.approx(theirs.quantile(p), rel=1e-3)


@pytest.mark.parametrize("body", [{}, {"contact__kind": "free", "contact__body_mass_kg": 0.14}])
def test_an_arm_that_a_singularity_drives_back_meets_nobody(body: dict[str, Any]) -> None:
    scenario = control_group(
        pose_deg=[67.0815, 10.6915, 118.7534, 13.078, -89.8323, -93.7495, 0],
        motion__velocity_mm_s=[29.073, -16.216, 49.546], motion__duration_s=1.0, **body,
    )  # fmt: skip
    result, drawn = bs.evaluate(scenario), bs.evaluate(scenario, samples=2000, seed=1)
    assert result.curve.distance[1:].max() < 0
    assert result.peak_force.mean == drawn.peak_force.mean == 0
    assert result.contact_duration is not None
    assert math.isnan(result.contact_duration.mean)
    assert result.no_contact_probability + result.false_alarm_probability == pytest.approx(1, abs=1e-12)
    assert result.verdict.p_over_force == 0


def test_against_mujoco() -> None:
    """A mass behind a spring and a light pad, struck by a driven pusher: the spring's greatest force."""
    mass, stiffness, speed = 4.4, 25000.0, 0.25
    model = mujoco.MjModel.from_xml_string(
        f"""
        <mujoco><option timestep="2e-5" gravity="0 0 0" integrator="implicitfast"/>
        <worldbody>
          <body name="pusher" mocap="true" pos="-0.11 0 0"><geom name="tool" type="sphere" size="0.05"
            solref="0.0002 1" solimp="0.99 0.999 0.0001"/></body>
          <body name="body"><joint name="away" type="slide" axis="1 0 0"/>
            <geom type="sphere" size="0.01" pos="0.3 0 0" mass="{mass}" contype="0" conaffinity="0"/>
            <body name="pad"><joint name="spring" type="slide" axis="1 0 0" stiffness="{stiffness}"/>
              <geom name="skin" type="sphere" size="0.05" mass="{mass / 1000}" solref="0.0002 1"
                solimp="0.99 0.999 0.0001"/></body></body>
        </worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    spring = model.joint("spring").qposadr[0]
    greatest = 0.0
    for step in range(int(0.12 / 2e-5)):
        data.mocap_pos[0, 0] = -0.11 + speed * step * 2e-5
        mujoco.mj_step(model, data)
        greatest = max(greatest, stiffness * data.qpos[spring])
    result = bs.evaluate(
        free(mass, contact__stiffness_N_m=stiffness, motion__velocity_mm_s=[0, 0, -250],
             contact__offset_law="uniform", **NEVER)
    )  # fmt: skip
    assert greatest == pytest.approx(result.peak_force.mean, rel=0.02)


def test_two_masses_and_the_reduced_mass_bound() -> None:
    driven, shared = bs.evaluate(free(4.0, **NEVER)), bs.evaluate(free(4.0, contact__arm="two_mass", **NEVER))
    bounds = driven.impact_bounds
    assert bounds is not None
    assert bounds.arm_mass is not None
    assert bounds.reduced_mass is not None
    reduced = 4.0 * bounds.arm_mass / (4.0 + bounds.arm_mass)
    speed = driven.problem.approach_speed
    assert bounds.reduced_mass == pytest.approx(speed * math.sqrt(reduced * driven.problem.stiffness))
    assert shared.peak_force.mean == pytest.approx(bounds.reduced_mass, rel=1e-6)
    assert any("assumed" in note for note in driven.notes)


def test_a_very_heavy_body_is_clamped() -> None:
    changes: dict[str, Any] = {"contact__offset_law": "uniform", "motion__velocity_mm_s": [0, 0, -60]}
    heavy, clamped = bs.evaluate(free(9000.0, **changes)), bs.evaluate(control_group(**changes))
    # Some 60 N for 50 ms move nine tonnes by 8 um, 0.6 N.
    assert heavy.peak_force.mean == pytest.approx(clamped.peak_force.mean, rel=1e-2)
    assert heavy.detection_delay.mean == pytest.approx(clamped.detection_delay.mean, rel=1e-2)


def test_limits_of_free_contact_are_transient() -> None:
    result = bs.evaluate(free(0.6, contact__limits="ts15066"))
    assert result.problem.limits is not None
    assert (result.problem.limits.kind, result.problem.limits.force_N) == ("free", 280)
    head = bs.evaluate(free(4.4, contact__limits="ts15066", contact__body="face"))
    assert head.verdict.acceptable is False
    assert "does not permit" in head.verdict.reason


@pytest.mark.parametrize("samples", [None, 200])
def test_tables_have_the_compression_of_the_body_without_its_padding(samples: int | None) -> None:
    result = bs.evaluate(control_group(contact__padding_N_m=20000.0), samples=samples)
    table = result_table(result)
    assert table["compression_mm"].to_numpy() == pytest.approx(table["peak_force_N"].to_numpy() / 75000 * 1e3)
    assert result.compression.mean == pytest.approx(result.peak_force.mean / 75000 * 1e3)


def test_padding_is_a_spring_in_series() -> None:
    padded = bs.evaluate(control_group(contact__padding_N_m=25000.0))
    together = 1 / (1 / 75000 + 1 / 25000)
    same = bs.evaluate(control_group(contact__stiffness_N_m=together))
    assert padded.problem.stiffness == pytest.approx(together)
    assert padded.peak_force.mean == pytest.approx(same.peak_force.mean, rel=1e-12)
    # The body takes its share of the compression only.
    assert padded.compression.mean == pytest.approx(padded.peak_force.mean / 75000 * 1e3, rel=1e-12)
    assert padded.peak_force.mean < bs.evaluate(control_group()).peak_force.mean


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"contact__kind": "free"}, "contact.body_mass_kg: is missing"),
        ({"contact__body_mass_kg": 2.0}, "contact.body_mass_kg: has no meaning"),
        ({"contact__arm": "two_mass"}, "contact.arm: has no meaning"),
        ({"contact__kind": "free", "contact__body_mass_kg": 0.0}, "contact.body_mass_kg"),
        ({"contact__padding_N_m": -1.0}, "contact.padding_N_m"),
    ],
)
def test_refused_by_name(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(bs.InputError, match=message):
        bs.evaluate(control_group(**changes))
