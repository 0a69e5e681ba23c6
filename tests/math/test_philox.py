"""Random numbers: the published vectors of Philox4x32-10, the normal and offset laws, and what a number depends on."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from scipy import stats

from bumpstop import _native

TARGETS = _native.available_targets()

# kat_vectors of Random123: counter, key, result; a seed is the key with its first word low.
KNOWN_ANSWERS = [
    (
        (0, 0, 0, 0),
        (0, 0),
        (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8),
    ),
    (
        (0xFFFFFFFF, 0xFFFFFFFF, 0xFFFFFFFF, 0xFFFFFFFF),
        (0xFFFFFFFF, 0xFFFFFFFF),
        (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD),
    ),
    (
        (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
        (0xA4093822, 0x299F31D0),
        (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
    ),
]


def philox(counter: tuple[int, ...], seed: int) -> tuple[int, ...]:
    """Philox4x32-10 in whole numbers without end."""
    key = [seed & 0xFFFFFFFF, seed >> 32]
    for _ in range(10):
        a, b, c, d = counter
        first, second = a * 0xD2511F53, c * 0xCD9E8D57
        counter = (
            (second >> 32) ^ b ^ key[0],
            second & 0xFFFFFFFF,
            (first >> 32) ^ d ^ key[1],
            first & 0xFFFFFFFF,
        )
        key = [(key[0] + 0x9E3779B9) & 0xFFFFFFFF, (key[1] + 0xBB67AE85) & 0xFFFFFFFF]
    return counter


def signed_probability(seed: int, run: int, tick: int, joint: int) -> tuple[float, int]:
    """The probability in (0, 1/2) and the sign behind one number, by docs/reference/math.md."""
    block = philox((run & 0xFFFFFFFF, run >> 32, tick, joint // 2), seed)
    low, high = block[2 * (joint % 2) : 2 * (joint % 2) + 2]
    bits = ((high & 0xFFFFF) << 32) | low
    return bits * 2.0**-53 + 2.0**-54, -1 if high >> 20 & 1 else 1


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize(("counter", "key", "result"), KNOWN_ANSWERS)
def test_known_answers(counter: tuple[int, ...], key: tuple[int, int], result: tuple[int, ...], target: str) -> None:
    seed = key[0] | key[1] << 32
    assert _native.load(target).philox(np.array([counter], dtype=np.int64), seed)[0].tolist() == list(result)
    assert philox(counter, seed) == result


@pytest.mark.parametrize("target", TARGETS)
def test_random_counters(target: str) -> None:
    rng = np.random.default_rng(11)
    counters = rng.integers(0, 2**32, (200, 4), dtype=np.int64)
    seed = 0xFEDCBA9876543210
    blocks = _native.load(target).philox(counters, seed)
    assert blocks.tolist() == [list(philox(tuple(row), seed)) for row in counters.tolist()]


SEED = 20_260_101


def sample(seed: int = SEED, runs: int = 300, ticks: int = 100, dof: int = 7) -> npt.NDArray[np.float64]:
    noise: npt.NDArray[np.float64] = _native.standard_noise(seed, 0, runs, ticks, dof)
    return noise


def test_noise_is_standard_normal() -> None:
    noise = sample().ravel()
    n = noise.size
    assert abs(noise.mean()) < 4 / np.sqrt(n)
    assert abs(noise.var() - 1) < 4 * np.sqrt(2 / n)
    assert stats.kstest(noise, "norm").pvalue > 1e-3
    for z in (2.0, 3.0, 4.0):
        expected = 2 * stats.norm.sf(z) * n
        assert abs((np.abs(noise) > z).sum() - expected) < 4 * np.sqrt(expected) + 1


def test_every_joint_alone_is_standard_normal() -> None:
    # The two halves of a block, and odd numbers of joints, must be as good as the rest.
    noise = sample()
    for joint in range(7):
        assert stats.kstest(noise[:, :, joint].ravel(), "norm").pvalue > 1e-3
        assert abs((noise[:, :, joint] > 0).mean() - 0.5) < 4 * 0.5 / np.sqrt(noise[:, :, joint].size)


def correlation(a: npt.NDArray[np.float64], b: npt.NDArray[np.float64]) -> float:
    """Correlation in units of its standard deviation for independent numbers."""
    return float((a * b).mean() * np.sqrt(a.size))


def test_numbers_are_uncorrelated() -> None:
    noise = sample()
    found = {
        f"joints {i}, {j}": correlation(noise[..., i], noise[..., j]) for i, j in itertools.combinations(range(7), 2)
    }
    for lag in range(1, 6):
        found[f"ticks {lag} apart"] = correlation(noise[:, lag:], noise[:, :-lag])
        found[f"runs {lag} apart"] = correlation(noise[lag:], noise[:-lag])
    found["seeds"] = correlation(noise, sample(SEED + 1))
    found["seeds, high word"] = correlation(noise, sample(SEED + 2**32))
    # So are their sizes: of z^2 the variance is 2.
    found["sizes of joints 0, 1"] = correlation(noise[..., 0] ** 2 - 1, noise[..., 1] ** 2 - 1) / 2
    found["sizes of ticks"] = correlation(noise[:, 1:] ** 2 - 1, noise[:, :-1] ** 2 - 1) / 2
    assert {what: z for what, z in found.items() if abs(z) > 4} == {}


@pytest.mark.parametrize("target", TARGETS)
def test_number_depends_on_seed_run_tick_and_joint_only(target: str) -> None:
    noise = _native.load(target).standard_noise
    whole = noise(5, 0, 40, 30, 9)
    assert whole.shape == (40, 30, 9)
    assert np.array_equal(noise(5, 0, 3, 4, 2), whole[:3, :4, :2])
    assert np.array_equal(noise(5, 17, 8, 30, 9), whole[17:25])
    assert np.array_equal(noise(5, 39, 1, 1, 7)[0, 0], whole[39, 0, :7])
    assert len(np.unique(whole)) == whole.size
    assert not np.isin(noise(6, 0, 40, 30, 9), whole).any()


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("seed", [0, 1, 2**32, 2**64 - 1])
@pytest.mark.parametrize("first_run", [0, 2**32 - 1, 2**40 + 3, 2**62 - 2])
def test_noise_is_what_the_page_says(first_run: int, seed: int, target: str) -> None:
    noise = _native.load(target).standard_noise(seed, first_run, 2, 3, 5)
    for run, tick, joint in np.ndindex(2, 3, 5):
        p, sign = signed_probability(seed, first_run + run, tick, joint)
        assert noise[run, tick, joint] == pytest.approx(sign * stats.norm.isf(p), rel=1e-13, abs=1e-300)


def test_targets_agree() -> None:
    noise = [_native.load(target).standard_noise(7, 2**33, 50, 20, 7) for target in TARGETS]
    offsets = [offsets_of(7, 2**33, 2000, "half_normal", 0.05, target) for target in TARGETS]
    for values in (noise, offsets):
        for other in values[1:]:
            np.testing.assert_allclose(other, values[0], rtol=1e-12, atol=0)


def offsets_of(seed: int, first: int, count: int, kind: str, size: float, target: str = _native.target) -> Any:
    module = _native.load(target)
    offset = module.Contact().offset
    offset.kind, offset.size = module.OffsetKind[kind], size
    return module.sample_offsets(offset, seed, first, count)


@pytest.mark.parametrize(
    ("kind", "law"),
    [("half_normal", stats.halfnorm(scale=0.05)), ("uniform", stats.uniform(0.0, 0.05))],
)
def test_offsets_follow_their_law(kind: str, law: Any) -> None:
    offsets = offsets_of(SEED, 0, 50_000, kind, 0.05)
    assert offsets.min() > 0
    assert offsets.max() <= (0.05 if kind == "uniform" else 7 * 0.05)
    assert stats.kstest(offsets, law.cdf).pvalue > 1e-3
    assert abs(offsets.mean() - law.mean()) < 4 * law.std() / np.sqrt(offsets.size)
    assert abs(np.corrcoef(offsets[1:], offsets[:-1])[0, 1]) < 4 / np.sqrt(offsets.size)


def test_fixed_offsets() -> None:
    assert offsets_of(SEED, 3, 5, "fixed", 0.125).tolist() == [0.125] * 5


@pytest.mark.parametrize("kind", ["half_normal", "uniform"])
def test_offset_depends_on_seed_and_run_only(kind: str) -> None:
    whole = offsets_of(SEED, 0, 200, kind, 0.05)
    assert np.array_equal(offsets_of(SEED, 150, 50, kind, 0.05), whole[150:])
    assert np.array_equal(offsets_of(SEED, 150, 1, kind, 0.05), whole[150:151])
    np.testing.assert_allclose(offsets_of(SEED, 0, 200, kind, 0.1), 2 * whole, rtol=1e-15)
    assert not np.isin(offsets_of(SEED + 1, 0, 200, kind, 0.05), whole).any()


def test_offsets_are_what_the_page_says() -> None:
    first = 2**32 - 3
    p = np.array([signed_probability(9, first + run, 0xFFFFFFFF, 0)[0] for run in range(6)])
    np.testing.assert_allclose(offsets_of(9, first, 6, "half_normal", 0.2), 0.2 * stats.norm.isf(p), rtol=1e-13)
    np.testing.assert_allclose(offsets_of(9, first, 6, "uniform", 0.2), 0.4 * p, rtol=1e-15)


def test_offsets_are_independent_of_the_noise() -> None:
    offsets = stats.norm.ppf(offsets_of(SEED, 0, 20_000, "uniform", 1.0))
    noise = _native.standard_noise(SEED, 0, 20_000, 2, 2)
    for tick, joint in np.ndindex(2, 2):
        assert abs(correlation(offsets, noise[:, tick, joint])) < 4
        assert abs(correlation(offsets**2 - 1, noise[:, tick, joint] ** 2 - 1) / 2) < 4
