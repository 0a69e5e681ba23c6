"""Durations in words."""

from __future__ import annotations


def hours_in_words(hours: float) -> str:
    """A time [h] in the unit that a person would choose: hours, minutes or seconds."""
    for unit, seconds in (("h", 3600.0), ("min", 60.0)):
        if hours * 3600.0 >= seconds:
            return f"{_figure(hours * 3600.0 / seconds)} {unit}"
    return f"{_figure(hours * 3600.0)} s"


def _figure(value: float) -> str:
    text = f"{value:.4g}"
    return f"{value:.0f}" if "e+" in text and value < 1e7 else text
