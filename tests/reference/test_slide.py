"""One slide, computed on paper: motion, detection, noise, thresholds and arming."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from reference import half_normal_offsets, simulate, simulate_seeded, tick_count, trace
from reference.cases import ACCELERATION, SPEED, SUBSTEP, assert_same_runs, sia5d, slide, travel_after_reaction

# The surface is met at 10.35 mm and the threshold is 1 N, so s must pass 11.35 mm. At tick k the slide has
# made 4k + 1 steps of 0.1 mm: tick 28 sees s = 11.3 mm, too little; tick 29 sees s = 11.7 mm and 1.35 N.
OFFSET = 0.01035
TICK = 29
TRAVEL_AT_TICK = 0.0117


def test_slide_is_detected_at_the_tick_and_force_worked_out_by_hand():
    runs = simulate(slide(), [OFFSET])
    assert runs.detected[0]
    assert not runs.false_alarm[0]
    assert runs.detection_tick[0] == TICK
    assert runs.detection_time_s[0] == pytest.approx(0.117, abs=1e-12)
    assert runs.force_at_detection_N[0] == pytest.approx(1.35, abs=1e-9)
    assert runs.residual_at_detection_Nm[0, 0] == pytest.approx(1.35, abs=1e-9)
    assert runs.trigger_mask[0] == 1
    assert runs.contact_start_s[0] == pytest.approx(OFFSET / SPEED, abs=1e-12)


def test_slide_stops_after_the_sum_of_its_falling_speeds():
    # 250 sub-steps to a standstill, just 50 steps. v^2 / 2a would be 2.5 mm; each sub-step moves at the speed
    # that it ends with, so the sum is h (250 v - a h 250 251 / 2) = 2.49 mm.
    stopping = travel_after_reaction(250)
    assert stopping == pytest.approx(2.49e-3, abs=1e-12)
    peak = 1000 * (TRAVEL_AT_TICK + stopping - OFFSET)
    for reaction in ("reverse", "stop"):
        runs = simulate(slide(reaction=reaction), [OFFSET])
        assert runs.max_force_N[0] == pytest.approx(peak, abs=1e-9)
        assert runs.max_force_axis_N[0] == pytest.approx([peak, 0, 0], abs=1e-9)
        assert runs.max_compression_m[0] == pytest.approx(peak / 1000, abs=1e-12)
        assert runs.max_travel_m[0] == pytest.approx(TRAVEL_AT_TICK + stopping, abs=1e-12)
    assert runs.force_at_end_N[0] == pytest.approx(peak, abs=1e-9)  # it stands there


def test_slide_moves_as_worked_out_at_every_step():
    run = trace(slide(), OFFSET)
    reaction_step = 4 * TICK  # the tick's own step is the last undisturbed one
    for i, s in enumerate(run.travel_m):
        if i <= reaction_step:
            expected = SPEED * (i + 1) * 0.001
        else:
            expected = TRAVEL_AT_TICK + travel_after_reaction(5 * (i - reaction_step))
        assert s == pytest.approx(expected, abs=1e-12)
        assert run.force_N[i] == pytest.approx(1000 * max(0, expected - OFFSET), abs=1e-9)
    # 50 ms and one and a half times v / a later no further step begins.
    assert len(run.time_s) == reaction_step + 1 + 126
    assert run.time_s[-1] == run.run.end_time_s[0] == pytest.approx(0.243)


def test_contact_ends_where_the_returning_slide_crosses_the_surface():
    settings = slide(thresholds_Nm=10.0)
    # Tick 51 at 20.5 mm is the first past 20.35 mm. The slide needs longer to come back than the run lasts.
    steps = np.arange(0, 400)
    travel = np.array([0.0205 + travel_after_reaction(5 * n) for n in steps])
    after = int(np.argmax((travel < OFFSET) & (steps > 0)))
    share = (travel[after - 1] - OFFSET) / (travel[after - 1] - travel[after])
    expected = 0.205 + 0.001 * (after - 1 + share)

    plain = simulate(settings, [OFFSET])
    patient = simulate(replace(settings, run_until_free=True), [OFFSET])
    assert plain.detection_tick[0] == 51
    assert plain.end_time_s[0] < expected
    assert np.isnan(plain.contact_end_s[0])
    assert patient.contact_end_s[0] == pytest.approx(expected, abs=1e-11)
    assert patient.contact_duration_s[0] == pytest.approx(expected - OFFSET / SPEED, abs=1e-11)
    # Waiting changes nothing else.
    assert_same_runs(replace(patient, contact_end_s=plain.contact_end_s), plain)


def test_an_arm_that_starts_inside_the_surface_is_in_contact_from_the_start():
    runs = simulate(slide(), [-0.0003])
    assert runs.contact_start_s[0] == 0
    assert runs.detection_tick[0] == 2  # s = 0.9 mm
    assert runs.force_at_detection_N[0] == pytest.approx(1.2, abs=1e-9)


def test_latency_lets_the_slide_go_on_at_full_speed():
    prompt = simulate(slide(), [OFFSET])
    late = simulate(slide(latency_steps=7), [OFFSET])
    assert late.detection_tick == prompt.detection_tick
    assert late.max_force_N - prompt.max_force_N == pytest.approx(1000 * SPEED * 0.007, abs=1e-9)
    assert late.end_time_s - prompt.end_time_s == pytest.approx(0.007, abs=1e-12)


def test_slide_from_rest_gathers_speed():
    run = trace(slide(start="rest", thresholds_Nm=np.inf), np.inf)
    substeps = 5 * np.arange(1, 51)  # 250 until full speed
    np.testing.assert_allclose(run.travel_m[:50], ACCELERATION * SUBSTEP**2 * substeps * (substeps + 1) / 2, atol=1e-13)
    np.testing.assert_allclose(run.velocity[49:, 0], SPEED, rtol=1e-12)


def test_without_detection_the_run_lasts_for_its_duration():
    settings = slide(thresholds_Nm=np.inf)
    runs = simulate(settings, [OFFSET])
    assert not runs.detected[0]
    assert runs.detection_tick[0] == -1
    assert runs.end_time_s[0] == pytest.approx(0.5)
    assert runs.max_force_N[0] == 0  # maxima are only taken from a detection on
    assert runs.force_at_end_N[0] == pytest.approx(1000 * (0.05 - OFFSET), abs=1e-9)
    assert tick_count(settings) == 125  # ticks at 1, 5, ..., 497 ms
    assert tick_count(replace(settings, duration_s=0.497)) == 125
    assert tick_count(replace(settings, duration_s=0.496)) == 124


def test_noise_decides_tick_and_joint():
    settings = sia5d((0, 0, -0.05), duration_s=0.1)
    ticks = tick_count(settings)
    noise = np.zeros((4, ticks, 7))
    noise[0, 3] = [0, -10.5, 20.5, 0, 0, 19.9, 0]
    noise[1, 24, 6] = 20.1  # the held joint feels too
    noise[2, 5, 0] = 19.9
    noise[3, 0, 1] = -99
    runs = simulate(settings, np.full(4, 1.0), noise)
    assert runs.detection_tick.tolist() == [3, 24, -1, 0]
    assert runs.trigger_mask.tolist() == [0b110, 0b1000000, 0, 0b10]
    assert runs.triggered(2).tolist() == [True, False, False, False]
    assert runs.false_alarm.tolist() == [True, True, False, True]
    np.testing.assert_array_equal(runs.noise_at_detection_Nm[0], noise[0, 3])
    np.testing.assert_array_equal(runs.residual_at_detection_Nm[0], noise[0, 3])
    assert np.all(np.isnan(runs.residual_at_detection_Nm[2]))
    assert runs.max_force_N.tolist() == [0, 0, 0, 0]


def test_noise_adds_to_the_contact_torque():
    # 0.95 N come from the spring at tick 28 (s = 11.3 mm); noise of 0.06 Nm makes the difference.
    noise = np.zeros((2, tick_count(slide()), 1))
    noise[0, 28] = 0.06
    noise[1, 28] = -0.06
    runs = simulate(slide(), [OFFSET, OFFSET], noise)
    assert runs.detection_tick.tolist() == [28, 29]
    assert runs.force_at_detection_N[0] == pytest.approx(0.95, abs=1e-9)
    assert runs.residual_at_detection_Nm[0, 0] == pytest.approx(1.01, abs=1e-9)


def test_ticks_before_the_arming_delay_are_not_checked():
    noise = np.full((1, tick_count(slide()), 1), 2.0)
    for delay_s, tick in ((0.0, 0), (0.001, 0), (0.0011, 1), (0.005, 1), (0.1, 25), (0.6, -1)):
        runs = simulate(slide(arming_delay_s=delay_s), [np.inf], noise)
        assert runs.detection_tick[0] == tick


def test_false_alarm_just_before_contact_still_reaches_the_surface():
    noise = np.zeros((1, tick_count(slide()), 1))
    noise[0, 20] = -2.0  # s = 8.1 mm, of the 2.49 mm to stop 2.25 mm are left
    runs = simulate(slide(), [OFFSET], noise)
    assert runs.false_alarm[0]
    assert runs.force_at_detection_N[0] == 0
    assert runs.max_force_N[0] == pytest.approx(1000 * (0.0081 + 0.00249 - OFFSET), abs=1e-9)


def test_a_seeded_run_depends_on_nothing_but_its_seed_number_and_offset():
    settings = sia5d((0, 0, -0.1))
    offsets = half_normal_offsets(settings, 6, np.random.default_rng(1))
    runs = simulate_seeded(settings, offsets, seed=5)
    assert_same_runs(simulate_seeded(settings, offsets, seed=5), runs)
    fewer = simulate_seeded(settings, offsets[:3], seed=5)
    np.testing.assert_array_equal(fewer.max_force_N, runs.max_force_N[:3])
    other = simulate_seeded(settings, offsets, seed=6)
    assert not np.any(other.noise_at_detection_Nm == runs.noise_at_detection_Nm)


def test_seeded_noise_has_the_mean_and_spread_asked_for():
    # Every first tick is a detection, so 1000 runs show 1000 draws of each joint.
    settings = sia5d((0, 0, -0.05), thresholds_Nm=1e-12, noise_sd_Nm=np.arange(1.0, 8), noise_mean_Nm=np.arange(7.0))
    drawn = simulate_seeded(settings, np.full(1000, np.inf), seed=1).noise_at_detection_Nm
    sd = np.arange(1.0, 8)
    assert np.all(np.abs(drawn.mean(axis=0) - np.arange(7)) < 4.5 * sd / math.sqrt(1000))
    assert np.all(np.abs(drawn.std(axis=0) / sd - 1) < 4.5 / math.sqrt(2 * 1000))
