"""Durations in words."""

from __future__ import annotations

_MIN_RATE, _MANY = 1e-3, 1e3  # an hour: nobody waits for rarer ones, and rates are told without powers of ten


def hours_in_words(hours: float) -> str:
    """A time [h] in the unit that a person would choose: hours, minutes or seconds."""
    for unit, seconds in (("h", 3600.0), ("min", 60.0)):
        if hours * 3600.0 >= seconds:
            return f"{_figure(hours * 3600.0 / seconds)} {unit}"
    return f"{_figure(hours * 3600.0)} s"


def _figure(value: float) -> str:
    text = f"{value:.4g}"
    return f"{value:.0f}" if "e+" in text and value < 1e7 else text


def rates_in_words(low: float, high: float) -> str:
    """An interval of false alarms an hour, without powers of ten."""
    least = "less than 0.001" if low < _MIN_RATE <= high else f"{low:.3g}"
    return f"{least} to {f'{high:.3g}' if high < _MANY else f'{high:.0f}'}"
