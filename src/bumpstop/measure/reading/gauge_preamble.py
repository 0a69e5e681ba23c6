"""What the lines above the table of a gauge say: sampling rate and range."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator

from bumpstop.measure.reading.written_numbers import as_number

_SAMPLING = r"sampl|abtast|messrate|messfrequenz|scan|acqui|erfassung|[ée]chantillon|muestreo|campion"
_RATE = r"rate|frequen|frecuen|fr[ée]quen"
_OTHER_RATE = r"filter|filtro|filtre|cut|grenz|pass|mains|netz|line freq|resonan|eigen|natural|trigger"
_RANGE = r"range|full.?scale|messbereich"
_OTHER_RANGE = r"trigger|temperat|pressure|druck"
# Before the number, or behind it: "Sampling rate [Hz]: 1000", "Sampling rate: 1 kHz".
_FIGURE = (
    r"(?:[\[(]\s*(?P<before>k?{unit})\s*[\])][\s:=;,]*(?P<first>{number})"
    r"|(?P<second>{number})\s*(?P<after>k?{unit})\b(?!/))"
)
_NUMBER = r"[0-9]+(?:[.,][0-9]+)*"


def stated_rates(lines: Iterable[str]) -> set[float]:
    """Sampling rates that lines state [Hz]; those of filters and of the mains are none.

    A rate or frequency that is not said to be of sampling counts only where there is no other.
    """
    sampling, plain = set(), set()
    for label, value in _figures(lines, "hz"):
        found = _last(label, _SAMPLING)
        if found > _last(label, _OTHER_RATE):
            sampling.add(value)
        elif _last(label, _RATE) >= 0 and _last(label, _OTHER_RATE) < 0:
            plain.add(value)
    return sampling or plain


def stated_range(lines: Iterable[str]) -> float | None:
    """End of the range of force that lines state [N]; None: they state none."""
    for label, value in _figures(lines, "n"):
        if _last(label, _RANGE) >= 0 and _last(label, _OTHER_RANGE) < 0:
            return value
    return None


def _figures(lines: Iterable[str], unit: str) -> Iterator[tuple[str, float]]:
    """What stands before each number with a unit, since the one before, and the number in whole units."""
    pattern = re.compile(_FIGURE.format(unit=unit, number=_NUMBER), re.IGNORECASE)
    for line in lines:
        begin = 0
        for found in pattern.finditer(line):
            text = found["first"] or found["second"]
            kilo = (found["before"] or found["after"]).lower().startswith("k")
            label, begin = line[begin : found.start()].lower(), found.end()
            yield label, _number(text, kilo=kilo)


def _number(text: str, *, kilo: bool) -> float:
    """1,000 Hz are a thousand, 1.000 kHz are one: nobody writes thousands of kilos."""
    mark = next((each for each in ".," if text.rfind(each) == max(text.rfind("."), text.rfind(","))), ".")
    if not kilo and re.fullmatch(rf"[1-9][0-9]{{0,2}}(?:\{mark}[0-9]{{3}})+", text):
        mark = "," if mark == "." else "."
    return as_number(text, mark) * (1e3 if kilo else 1.0)


def _last(text: str, words: str) -> int:
    """Where the last of some words begins; -1: there is none."""
    return max((found.start() for found in re.finditer(words, text)), default=-1)
