"""Derivatives of uneven samples: exact where they should be, their delay, their noise, and no spikes."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from bumpstop import _native
from bumpstop.errors import InputError
from bumpstop.signal import causal_derivatives, derivatives, differences, filter_even, filter_reach, zero_phase_lowpass
from bumpstop.signal.lowpass import padding_rows

Acceleration = Callable[[np.ndarray, np.ndarray], np.ndarray]
METHODS: dict[str, Acceleration] = {
    "differences": lambda t, q: differences(t, q)[1],
    "local_polynomial": lambda t, q: derivatives(t, q)[2],
    "butterworth": lambda t, q: derivatives(t, q, method="butterworth")[2],
    "causal": lambda t, q: causal_derivatives(t, q)[1],
    "causal, window 16": lambda t, q: causal_derivatives(t, q, window=16)[1],
}


def uneven_times(count: int, period: float, seed: int = 1) -> np.ndarray:
    return 5.0 + period * np.cumsum(np.random.default_rng(seed).uniform(0.3, 2, count))


def polynomials(t: np.ndarray, degree: int) -> list[np.ndarray]:
    """Values and two derivatives of three polynomials, by columns."""
    rng = np.random.default_rng(degree)
    each = [np.polynomial.Polynomial(rng.normal(size=degree + 1), domain=[4, 7]) for _ in range(3)]
    return [np.stack([p.deriv(r)(t) if r else p(t) for p in each], axis=1) for r in range(3)]


# --- Records ---------------------------------------------------------------------------------------------------

DURATION = 8.0


def motion(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and accelerations of two joints."""
    q, qdd = np.zeros((len(t), 2)), np.zeros((len(t), 2))
    for j, (amplitude, hertz) in enumerate([(0.5, 0.4), (0.2, 1.5)]):
        w = 2 * np.pi * hertz
        q[:, j] = amplitude * np.sin(w * t + j)
        qdd[:, j] = -amplitude * w**2 * np.sin(w * t + j)
    return q, qdd


def record(rate: float, seed: int, *, uneven: bool, noise: float = 2e-5) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, measured positions and true accelerations; uneven: 1 % lost, every time off by up to 10 % of a period."""
    rng = np.random.default_rng(seed)
    count = int(DURATION * rate)
    error = noise * rng.normal(size=(count, 2))
    t = np.arange(count) / rate
    kept = np.ones(count, bool)
    if uneven:
        t = t + rng.uniform(-0.1, 0.1, count) / rate
        kept = rng.random(count) > 0.01
    q, qdd = motion(t)
    return t[kept], (q + error)[kept], qdd[kept]


# --- Exact on polynomials --------------------------------------------------------------------------------------


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
@pytest.mark.parametrize("window_s", [0.001, 0.04, 10.0])
def test_local_polynomials_are_exact_on_polynomials_up_to_the_ends(degree: int, window_s: float) -> None:
    t = uneven_times(80, 0.01)
    q, qd, qdd = polynomials(t, degree)
    found = derivatives(t, q, window_s=window_s, degree=degree)
    # A rounding of q by 1e-16 over a window of 0.04 s, squared, with the gain of an end.
    for wanted, got, tolerance in zip((q, qd, qdd), found, (1e-13, 1e-10, 1e-7), strict=True):
        np.testing.assert_allclose(got, wanted, atol=tolerance * np.abs(q).max() * 10)


def test_local_polynomials_are_not_exact_beyond_their_degree() -> None:
    t = uneven_times(80, 0.01)
    q, _, qdd = polynomials(t, 5)
    assert np.abs(derivatives(t, q, window_s=0.1, degree=3)[2] - qdd).max() > 1e-4


@pytest.mark.parametrize("degree", [2, 3, 4, 5])
def test_causal_derivatives_are_exact_on_polynomials(degree: int) -> None:
    t = uneven_times(60, 0.01)
    q, qd, qdd = polynomials(t, degree)
    rate, acceleration = causal_derivatives(t, q, window=12, degree=degree)
    assert (rate[:11] == 0).all()
    assert (acceleration[:11] == 0).all()
    np.testing.assert_allclose(rate[11:], qd[11:], atol=1e-9)
    np.testing.assert_allclose(acceleration[11:], qdd[11:], atol=1e-6)


def test_differences_are_exact_on_parabolas() -> None:
    t = uneven_times(40, 0.01)
    q, qd, qdd = polynomials(t, 2)
    rate, acceleration = differences(t, q)
    np.testing.assert_allclose(rate, qd, atol=1e-11)
    np.testing.assert_allclose(acceleration, qdd, atol=1e-8)


def test_smoothed_positions_keep_their_digits_far_from_zero() -> None:
    t = uneven_times(80, 0.001)
    q = np.full((80, 1), 1e6 / 3)
    position, rate, acceleration = derivatives(t, q)
    assert (position == q).all()
    assert (rate == 0).all()
    assert (acceleration == 0).all()


# --- Against another way to the same number --------------------------------------------------------------------


def test_causal_derivatives_are_those_of_a_least_squares_fit() -> None:
    t, q = uneven_times(50, 0.002), np.random.default_rng(3).normal(size=(50, 9))
    rate, acceleration = causal_derivatives(t, q, window=10, degree=3)
    for i in range(9, 50):
        x = t[i - 9 : i + 1] - t[i]
        fit = np.linalg.lstsq(np.vander(x / 0.02, 4, increasing=True), q[i - 9 : i + 1], rcond=None)[0]
        np.testing.assert_allclose(rate[i], fit[1] / 0.02, rtol=1e-9, atol=1e-7)
        np.testing.assert_allclose(acceleration[i], 2 * fit[2] / 0.02**2, rtol=1e-9, atol=1e-5)


def test_causal_derivatives_know_nothing_of_the_future() -> None:
    t, q = uneven_times(50, 0.002), np.random.default_rng(3).normal(size=(50, 2))
    whole, part = causal_derivatives(t, q), causal_derivatives(t[:30], q[:30])
    for ours, theirs in zip(whole, part, strict=True):
        assert (ours[:30] == theirs).all()


def test_local_polynomials_are_those_of_a_weighted_least_squares_fit() -> None:
    t, q = uneven_times(60, 0.002), np.random.default_rng(3).normal(size=(60, 3))
    found = derivatives(t, q, window_s=0.04, degree=3)
    for i in range(20, 40):
        x = (t - t[i]) / 0.02
        near = np.abs(x) < 1
        root = np.sqrt(1 - x[near] ** 2)[:, None]
        fit = np.linalg.lstsq(root * np.vander(x[near], 4, increasing=True), root * q[near], rcond=None)[0]
        for r, factor in enumerate((1, 1 / 0.02, 2 / 0.02**2)):
            np.testing.assert_allclose(found[r][i], factor * fit[r], rtol=1e-9, atol=1e-9 * factor)


# --- Delay ----------------------------------------------------------------------------------------------------


def phase_delay(t: np.ndarray, x: np.ndarray, hertz: float, derivative: int) -> tuple[float, float]:
    """Delay [s] and gain of a derivative of sin(w t), by projection on whole periods."""
    w = 2 * np.pi * hertz
    inner = (t > 1) & (t <= 3)
    response = 2 * np.mean(x[inner, 0] * np.exp(-1j * w * t[inner])) / (-1j * (1j * w) ** derivative)
    return -np.angle(response) / w, np.abs(response)


@pytest.mark.parametrize("method", ["local_polynomial", "butterworth", "differences"])
@pytest.mark.parametrize("hertz", [1.0, 5.0, 9.0])
def test_no_delay(method: Any, hertz: float) -> None:
    t = np.arange(4000) / 1000
    found = derivatives(t, np.sin(2 * np.pi * hertz * t)[:, None], method=method)
    for derivative, x in enumerate(found):
        delay, gain = phase_delay(t, x, hertz, derivative)
        assert abs(delay) < 1e-9
        assert gain == pytest.approx(1, abs=0.1)


@pytest.mark.parametrize("window", [6, 8, 16])
def test_delay_of_the_causal_derivative(window: int) -> None:
    t, hertz = np.arange(4000) / 1000, 1.0
    rate, acceleration = causal_derivatives(t, np.sin(2 * np.pi * hertz * t)[:, None], window=window)
    # Next terms: (w (m - 1) dt)^2 of the figure.
    assert phase_delay(t, acceleration, hertz, 2)[0] == pytest.approx((window - 1) / 2 * 1e-3, rel=0.02)
    assert abs(phase_delay(t, rate, hertz, 1)[0]) < 0.01 * (window - 1) / 2 * 1e-3


def test_gain_of_the_lowpass() -> None:
    t = np.arange(4000) / 1000
    for hertz, order in [(5.0, 4), (20.0, 4), (20.0, 2), (30.0, 3)]:
        smooth = zero_phase_lowpass(t, np.sin(2 * np.pi * hertz * t)[:, None], 20.0, order)
        delay, gain = phase_delay(t, smooth, hertz, 0)
        warped = np.tan(np.pi * hertz / 1000) / np.tan(np.pi * 20 / 1000)
        assert gain == pytest.approx(1 / (1 + warped ** (2 * order)), rel=1e-6)
        assert abs(delay) < 1e-9


@pytest.mark.parametrize(
    ("rate", "cutoff", "order"), [(1000, 2, 4), (1000, 60, 4), (125, 8, 3), (94, 40, 10), (250, 1, 1)]
)
@pytest.mark.parametrize("columns", [1, 3, 9])
def test_the_lowpass_is_scipys(rate: float, cutoff: float, order: int, columns: int) -> None:
    from scipy.signal import butter, sosfiltfilt

    x = np.random.default_rng(3).normal(size=(300, columns)).cumsum(axis=0)
    sections = butter(order, cutoff, fs=rate, output="sos")
    reference = sosfiltfilt(sections, x, axis=0, padlen=min(299, padding_rows(rate, cutoff, order)))
    # A section's gain at rest is a quotient of two figures, rounded by eps, of the size of (pi cutoff / rate)^2.
    bound = 300 * np.finfo(float).eps / min(1.0, (np.pi * cutoff / rate) ** 2) * np.abs(x).max()
    assert filter_even(x, rate, cutoff, order) == pytest.approx(reference, abs=bound)


@pytest.mark.parametrize(
    ("rate", "cutoff", "order"), [(5000, 60, 4), (1000, 2, 4), (125, 7, 4), (30, 2, 4), (94, 40, 10), (250, 10, 1)]
)
def test_a_record_that_begins_and_ends_at_speed_keeps_it(rate: float, cutoff: float, order: int) -> None:
    """Whatever the rate: else the motor torque of an arm that is cut out of its motion is that of an impact."""
    t = np.arange(round(100 * rate / cutoff)) / rate
    ramp = np.stack([1.0 + 2.0 * t, -3.0 * t], axis=1)
    found = filter_even(ramp, rate, cutoff, order)
    assert found == pytest.approx(ramp, abs=1e-5 / cutoff)
    assert np.abs(np.diff(found, 2, axis=0)).max() * rate**2 < 2e-3 * cutoff  # a speed that changes in one period: 3


@pytest.mark.parametrize(
    ("rate", "cutoff", "order"), [(1000, 2, 4), (1000, 400, 4), (10, 4.98, 4), (94, 40, 10), (250, 10, 1)]
)
def test_a_part_with_its_reach_is_that_of_the_whole(rate: float, cutoff: float, order: int) -> None:
    """Filtered with margins that are then cut off; half of them are not enough."""
    x = np.random.default_rng(3).normal(size=(20_000, 2)).cumsum(axis=0)
    whole = filter_even(x, rate, cutoff, order)
    share = 1e-8
    reach = filter_reach(rate, cutoff, share, order)

    def error(margin: int) -> float:
        part = filter_even(x[9000 - margin : 9100 + margin], rate, cutoff, order)[margin : margin + 100]
        return float(np.abs(part - whole[9000:9100]).max() / np.ptp(x, axis=0).max())

    assert error(reach) < share
    assert error(reach // 2) > share
    impulse = np.zeros((40_001, 1))
    impulse[20_000] = 1.0
    response = np.abs(filter_even(impulse, rate, cutoff, order)[20_000:, 0])
    assert response[reach + 1 :].sum() < share <= response[reach:].sum()


# --- Noise ----------------------------------------------------------------------------------------------------

COLUMNS = 200
DT = 1e-3


def noise_gain(function: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, ...]]) -> list[float]:
    """Standard deviations for noise of 1, of the middle rows of 200 series."""
    t = np.arange(400) * DT
    noise = np.random.default_rng(0).normal(size=(400, COLUMNS))
    return [float(x[150:250].std()) for x in function(t, noise)]


# 100 correlated rows of 200 series count as at least 200 * 100 / 40 independent figures: 1.4 % standard error.
MONTE_CARLO = 0.05


@pytest.mark.parametrize("m", [5, 8, 20])
def test_noise_gain_of_the_causal_derivative(m: int) -> None:
    rate, acceleration = noise_gain(lambda t, q: causal_derivatives(t, q, window=m))
    spread = m * (m**2 - 1) * (m**2 - 4)
    assert acceleration == pytest.approx(np.sqrt(720 / spread) / DT**2, rel=MONTE_CARLO)
    wanted = np.sqrt(12 / (m * (m**2 - 1)) + 180 * (m - 1) ** 2 / spread) / DT
    assert rate == pytest.approx(wanted, rel=MONTE_CARLO)


def test_noise_gain_of_differences() -> None:
    rate, acceleration = noise_gain(differences)
    assert rate == pytest.approx(1 / (np.sqrt(2) * DT), rel=MONTE_CARLO)
    assert acceleration == pytest.approx(np.sqrt(6) / DT**2, rel=MONTE_CARLO)


@pytest.mark.parametrize("window_s", [0.04, 0.06])
def test_noise_gain_of_local_polynomials(window_s: float) -> None:
    position, rate, acceleration = noise_gain(lambda t, q: derivatives(t, q, window_s=window_s))
    h = window_s / 2
    samples = h / DT
    # Of docs/reference/robot/signal.md: integrals of the squared weights of a cubic, for many samples.
    assert position == pytest.approx(np.sqrt(5) / 2 / np.sqrt(samples), rel=MONTE_CARLO)
    assert rate == pytest.approx(3.454 / (h * np.sqrt(samples)), rel=MONTE_CARLO)
    assert acceleration == pytest.approx(np.sqrt(35) / (h**2 * np.sqrt(samples)), rel=MONTE_CARLO)


def test_noise_gain_of_butterworth() -> None:
    found = noise_gain(lambda t, q: derivatives(t, q, method="butterworth"))
    cutoff = 25.0
    for r, (constant, got) in enumerate(zip((0.898, 0.266, 0.159), found, strict=True)):
        wanted = np.sqrt(2 * DT * cutoff * constant) * (2 * np.pi * cutoff) ** r
        assert got == pytest.approx(wanted, rel=MONTE_CARLO)


# --- Lost samples and jitter: no spikes ------------------------------------------------------------------------


def largest_errors(method: Acceleration, rate: float) -> tuple[float, float]:
    """Largest acceleration error [rad/s2] over ten records, even and uneven; the ends are left out."""
    worst = [0.0, 0.0]
    for seed in range(10):
        for kind in (0, 1):
            t, q, qdd = record(rate, seed, uneven=bool(kind))
            inner = (t > 0.3) & (t < 7.7)
            worst[kind] = max(worst[kind], float(np.abs(method(t, q) - qdd)[inner].max()))
    return worst[0], worst[1]


@pytest.mark.parametrize("rate", [250.0, 1000.0])
@pytest.mark.parametrize("method", METHODS)
def test_lost_samples_and_jitter_make_no_spike(method: str, rate: float) -> None:
    even, uneven = largest_errors(METHODS[method], rate)
    assert uneven < 1.5 * even


@pytest.mark.parametrize("rate", [250.0, 1000.0])
def test_second_differences_that_assume_their_period_do_spike(rate: float) -> None:
    def naive(t: np.ndarray, q: np.ndarray) -> np.ndarray:
        return np.pad(np.diff(q, 2, axis=0) * rate**2, ((1, 1), (0, 0)))

    even, uneven = largest_errors(naive, rate)
    assert uneven > 10 * even


@pytest.mark.parametrize("method", METHODS)
def test_one_missing_sample(method: str) -> None:
    """Table 4.4 of Schroeder (2013): one lost sample, and the second difference alarmed."""
    t, q, _ = record(250, 0, uneven=False, noise=0)
    lost = np.arange(len(t)) != 1000
    whole, gapped = METHODS[method](t, q)[lost], METHODS[method](t[lost], q[lost])
    # 0.1 of 18 rad/s2; the causal ones grow older by a part of a period, at a jerk of 170 rad/s3.
    assert np.abs(whole - gapped)[990:1010].max() < (0.6 if "causal" in method else 0.25)


# --- Other ----------------------------------------------------------------------------------------------------


def test_uneven_times_are_filtered_as_even_ones() -> None:
    t = np.arange(2000) / 500
    shaken = t + np.random.default_rng(0).uniform(-0.2, 0.2, 2000) / 500
    found = zero_phase_lowpass(shaken, np.sin(2 * np.pi * 3 * shaken)[:, None], 20.0)
    np.testing.assert_allclose(found[200:-200, 0], np.sin(2 * np.pi * 3 * shaken)[200:-200], atol=1e-4)


def test_a_million_rows_take_three_seconds() -> None:
    t = np.sort(np.arange(10**5) * 1e-3 + np.random.default_rng(0).uniform(-1e-4, 1e-4, 10**5))
    q = np.random.default_rng(0).normal(size=(10**5, 7))
    start = time.process_time()
    derivatives(t, q)
    assert time.process_time() - start < 0.3


def test_methods_agree_on_a_slow_motion() -> None:
    t, q, qdd = record(1000, 0, uneven=True, noise=0)
    for method in METHODS.values():
        assert np.abs(method(t, q) - qdd)[300:-300].max() < 0.1 * np.abs(qdd).max()


T = [0.0, 0.1, 0.2, 0.3, 0.4]
Q = [[0.0]] * 5


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: derivatives(T, Q, method="spline"), "method: 'spline' is no method"),  # type: ignore[arg-type]
        (lambda: derivatives(T, Q, window_s=0), "window_s: is 0; wanted a width above 0"),
        (lambda: derivatives(T, Q, degree=1), "degree: is 1; wanted a whole number from 2 to 5"),
        (lambda: derivatives(T[:3], Q[:3]), "t: has 3 samples; a polynomial of degree 3 needs at least 4"),
        (lambda: derivatives([0, 1, 1, 2, 3], Q), r"t\[2\]: 1.0 is not later than 1.0 before it; times increase"),
        (lambda: derivatives(T, Q[:4]), r"q: has shape \(4, 1\); wanted \(5, N\)"),
        (lambda: derivatives(T, [[np.nan]] * 5), r"q\[0, 0\]: is nan"),
        (lambda: derivatives(T, np.zeros((5, 0))), "q: has shape .* at least one column"),
        (lambda: causal_derivatives(T, Q, window=2), "window: is 2; wanted a whole number from 3 to 512"),
        (lambda: causal_derivatives(T, Q, window=513), "window: is 513"),
        (lambda: causal_derivatives(T, Q, degree=2.5), "degree: is 2.5"),  # type: ignore[arg-type]
        (lambda: differences(T[:2], Q[:2]), "t: has 2 samples; a second difference needs at least 3"),
        (lambda: zero_phase_lowpass(np.arange(50.0), np.zeros((50, 1)), 0.5), "cutoff_hz: is 0.5; .* rate, 0.5"),
        (lambda: zero_phase_lowpass(np.arange(50.0), np.zeros((50, 1)), 0.1, 0), "order: is 0"),
        (lambda: zero_phase_lowpass(T, Q, 1.0), "t: has 5 samples; a filter of order 4"),
        (lambda: zero_phase_lowpass([*range(49), 1e6], np.zeros((50, 1)), 0.1), "t: needs 1e.06 even intervals"),
    ],
)
def test_refusals(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()


def test_limits_are_those_of_the_kernels() -> None:
    assert (_native.max_fit_degree, _native.max_causal_window) == (5, 512)
