"""Ranges of variables: the values that a study lets one take."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bumpstop.errors import InputError
from bumpstop.study.variable import Variable
from bumpstop.text_files import list_items

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario

_MAX_VALUES = 1000


@dataclass(frozen=True)
class Range:
    """Values of one variable.

    Attributes:
        variable: what takes them.
        values: ascending, at least two, already rounded to what the variable can take.
    """

    variable: Variable
    values: tuple[float, ...]

    @property
    def low(self) -> float:
        """The least value."""
        return self.values[0]

    @property
    def high(self) -> float:
        """The greatest value."""
        return self.values[-1]

    @classmethod
    def parse(cls, text: str, scenario: Scenario, *, count: int = 15) -> Range:
        """Read ``KEY=LOW:HIGH``, ``KEY=LOW:HIGH:COUNT``, with ``:log`` for even ratios, or ``KEY=[A, B, ...]``.

        Args:
            text: as written.
            scenario: whose key it is.
            count: of the values where none is given.

        Raises:
            InputError: the key is unknown, the range is empty or not finite, or the scenario refuses its ends.
        """
        name, equals, written = (part.strip() for part in text.partition("="))
        if not equals or not name or not written:
            problem = f"{text[:200]!r} is not KEY=LOW:HIGH"
            raise InputError("--vary", problem, "for example --vary motion.speed=10:200")
        variable = Variable(name)
        variable.check(scenario)
        return cls.of(variable, _values(text, written, count), scenario)

    @classmethod
    def of(cls, variable: Variable, values: list[float], scenario: Scenario) -> Range:
        """Round values to what the variable can take, drop repetitions, and let the scenario judge the ends.

        Raises:
            InputError: fewer than two values are left, or the scenario refuses one.
        """
        taken = tuple(sorted({variable.quantised(scenario, value) for value in values}))
        if len(taken) < 2:
            step = variable.quantum(scenario)
            steps = f" in steps of {step:g}" if step else ""
            only = "only one value" if taken else "no value"
            raise InputError("--vary", f"{variable.name!r} has {only}{steps}", "wanted at least 2")
        from bumpstop.collision.scenario.unused_keys import keys_without_effect

        for value in (taken[0], taken[-1]):
            unused = keys_without_effect(variable.apply(scenario, value))
            if variable.key in unused:
                raise InputError(
                    "--vary", f"{variable.name!r} has no effect {unused[variable.key]}", "vary another key"
                )
        return cls(variable, taken)

    def to_json(self) -> str:
        """As :meth:`parse` reads it."""
        return f"{self.variable.name}=[{', '.join(f'{value:.12g}' for value in self.values)}]"


def _values(text: str, written: str, count: int) -> list[float]:
    if written.startswith("[") or "," in written:
        if written.startswith("[") != written.endswith("]"):
            raise InputError("--vary", f"{text[:200]!r} is not KEY=A,B,...", "close the bracket")
        values = [_number(text, part) for part in list_items(written)]
        if len(values) > _MAX_VALUES:
            raise InputError("--vary", f"{len(values)} values are too many", f"wanted at most {_MAX_VALUES}")
        return values
    parts = [part.strip() for part in written.split(":")]
    even_ratios = parts[-1] == "log"
    if even_ratios:
        parts.pop()
    if len(parts) not in (2, 3):
        raise InputError("--vary", f"{text[:200]!r} is not KEY=LOW:HIGH", "for example --vary motion.speed=10:200:20")
    low, high = _number(text, parts[0]), _number(text, parts[1])
    if len(parts) == 3:
        number = _number(text, parts[2])
        if number != int(number) or not 2 <= number <= _MAX_VALUES:
            raise InputError("--vary", f"{parts[2]!r} is no count of values", f"wanted 2 to {_MAX_VALUES}")
        count = int(number)
    if not low < high:
        raise InputError("--vary", f"{low:g} to {high:g} is an empty range", "wanted the lower end first")
    if even_ratios and low <= 0:
        raise InputError("--vary", f"{low:g} to {high:g} has no even ratios", "wanted a lower end above 0")
    span = high - low
    if even_ratios:
        return [low * (high / low) ** (i / (count - 1)) for i in range(count - 1)] + [high]
    return [low + span * i / (count - 1) for i in range(count - 1)] + [high]


def _number(text: str, part: str) -> float:
    try:
        number = float(part)
    except ValueError:
        raise InputError("--vary", f"{part[:60]!r} in {text[:200]!r} is no number", "wanted KEY=LOW:HIGH") from None
    if not math.isfinite(number):
        raise InputError("--vary", f"{part[:60]!r} in {text[:200]!r} is not finite", "wanted finite ends")
    return number
