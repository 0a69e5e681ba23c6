"""Sampling rate and range as the lines above a table state them."""

from __future__ import annotations

from pathlib import Path

import pytest

from bumpstop.errors import InputError
from bumpstop.measure.reading.gauge_preamble import stated_range, stated_rates
from bumpstop.measure.reading.gauge_reading import read_gauge
from measure.gauge_cases import pressed


@pytest.mark.parametrize(
    ("lines", "rates"),
    [
        (["Sampling rate: 4 kHz; range: 500 N"], {4000}),
        (["Low-pass filter frequency 100 Hz", "Sampling rate 1000 Hz"], {1000}),
        (["Mains frequency 50 Hz", "Sampling rate 1000 Hz"], {1000}),
        (["Sampling rate 1000 Hz, filter 100 Hz"], {1000}),
        (["Filter: 4th order, 100 Hz; sampling frequency: 1000 Hz"], {1000}),
        (["Cutoff frequency: 100 Hz"], set()),
        (["Netzfrequenz 50 Hz", "Abtastrate;2,5 kHz"], {2500}),
        (["Frequenz: 2000 Hz", "Grenzfrequenz 300 Hz"], {2000}),
        (["Messrate [Hz];1000", "Grenzfrequenz [Hz];250"], {1000}),
        (["Sampling rate: 1,000 Hz"], {1000}),
        (["Sampling rate: 1.000 Hz"], {1000}),
        (["Sampling rate: 1.000 kHz"], {1000}),
        (["Sampling rate: 12.5 Hz"], {12.5}),
        (["Sampling rate: 1,000.0 Hz"], {1000}),
        (["Sampling rate 1000 Hz", "Sampling rate 500 Hz"], {500, 1000}),
        (["Rate 1000 Hz", "Sample rate 1000 Hz"], {1000}),
    ],
)
def test_sampling_rates(lines: list[str], rates: set[float]) -> None:
    assert stated_rates(lines) == rates


@pytest.mark.parametrize(
    ("lines", "end"),
    [
        (["Range: 1,000 N"], 1000),
        (["Messbereich 1.000 N"], 1000),
        (["Range: 0.5 kN"], 500),
        (["Range 0 - 500 N"], 500),
        (["Range: +-500 N"], 500),
        (["Range [N];500"], 500),
        (["Trigger range: 5 N", "Full scale 250 N"], 250),
        (["Pressure range: 300 N/cm2"], None),
        (["Sampling rate: 4 kHz; range: 500 N"], 500),
    ],
)
def test_ranges(lines: list[str], end: float | None) -> None:
    assert stated_range(lines) == end


def test_several_rates_are_refused(tmp_path: Path) -> None:
    _, force = pressed(rate=1000.0)
    table = "Force [N]\n" + "\n".join(map(repr, force.tolist())) + "\n"
    path = tmp_path / "rates.csv"
    path.write_text("Sampling rate 500 Hz\nSampling rate 1000 Hz\n" + table)
    with pytest.raises(InputError, match="rate_hz: may be any of 500, 1000 above the table; give the sampling rate"):
        read_gauge(path)
    path.write_text("Low-pass filter frequency 100 Hz\nSampling rate 1,000 Hz\n" + table)
    assert read_gauge(path).rate_hz == pytest.approx(1000)
