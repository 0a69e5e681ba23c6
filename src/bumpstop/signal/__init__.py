"""Rates and accelerations from positions sampled at uneven times."""

from bumpstop.signal.correlation import correlation_time
from bumpstop.signal.derivatives import causal_derivatives, derivatives, differences
from bumpstop.signal.lowpass import filter_even, filter_reach, zero_phase_lowpass

__all__ = [
    "causal_derivatives",
    "correlation_time",
    "derivatives",
    "differences",
    "filter_even",
    "filter_reach",
    "zero_phase_lowpass",
]
