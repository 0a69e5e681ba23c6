"""A gauge that nothing damps swings on after the arm has stopped: its greatest force may come then."""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_ivp

import bumpstop as bs
from bumpstop.arrays import FloatArray

PAD, SPRING, MASS, STEP = 2e4, 1e4, 2.0, 1e-3


def greatest_force(path: FloatArray, offset: float) -> float:
    """Of a mass on a spring that a pad pushes, whose free end is at ``path`` after every step [m]."""
    time = np.arange(len(path)) * STEP

    def rates(t: float, state: FloatArray) -> list[float]:
        pushed = max(0.0, float(np.interp(t, time, path)) - offset - state[0])
        return [state[1], (PAD * pushed - SPRING * state[0]) / MASS]

    begins = max(0, int(np.argmax(path > offset)) - 1)
    found = solve_ivp(rates, (time[begins], time[-1]), [0.0, 0.0], max_step=STEP, rtol=1e-9, atol=1e-12)
    return float(np.max(PAD * (np.interp(found.t, time, path) - offset - found.y[0])))


def test_the_greatest_force_after_a_stop() -> None:
    scenario = bs.Scenario.from_dict(
        {
            "robot": "ur3e",
            "pose_rad": [2.6608, -0.3547, -2.3311, 0.6303, -1.6693, 2.0085],
            "motion": {"velocity_mm_s": [8.96, -16.2, 7.57]},
            "contact": {"stiffness_N_m": PAD, "gauge_spring_N_m": SPRING, "gauge_mass_kg": MASS},
            "detector": {"thresholds_Nm": [36, 36, 24, 12, 12, 9.6], "noise_sd_Nm": [6.5, 6.5, 4.3, 2.2, 2.2, 1.7]},
            "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 8.0, "latency_s": 0.007},
        }
    )
    result = bs.evaluate(scenario, samples=12, seed=4)
    assert result.runs is not None
    curve = result.curve
    later = 0
    for tick, offset, peak in zip(*(result.runs[name] for name in ("tick", "offset", "peak_force")), strict=True):
        begins = round((curve.tick_time[tick] + 0.007) / STEP)
        reaction = curve.line.reaction_paths([int(tick)], [0.0])[0]
        path = np.concatenate([curve.distance[:begins], reaction, np.full(400, reaction[-1])])
        assert abs(reaction[0] - curve.distance[begins]) < 1e-9
        expected = greatest_force(path, float(offset))
        later += greatest_force(path[: begins + len(reaction) + 30], float(offset)) < 0.999 * expected
        assert abs(peak - expected) < 2e-4 * expected
    assert later > 0, "some have their greatest force a whole oscillation after the stop"
