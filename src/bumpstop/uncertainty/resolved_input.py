"""Uncertain inputs made ready to draw from: values they vary about, possible values, quantile functions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.scenario.arm_table import QUANTITY
from bumpstop.collision.scenario.spellings import other_spelling
from bumpstop.collision.scenario.uncertainty_table import UncertainInput, uncertain_inputs, valid_range
from bumpstop.errors import InputError
from bumpstop.text_files import read_text

if TYPE_CHECKING:
    from bumpstop.collision import CollisionProblem, Scenario

Given = Literal["scenario", "robot", "default"]
# A distribution that has more of itself among impossible values is refused.
MAX_OUTSIDE = 0.05
# A value given that a distribution goes beyond, or stays below, less often is left out by it.
_RARELY = 1e-3
_MIN_SAMPLES, _MAX_SAMPLES = 5, 1_000_000


@dataclass(frozen=True, eq=False)
class ResolvedInput:
    """An uncertain input of one scenario.

    Attributes:
        input: as the scenario has it.
        nominal: the value given, one number or one per joint, or NaN where there is none; 1 of a factor.
        given: by what: ``"scenario"``, ``"robot"`` for what robot, arm or body say, or ``"default"``, also where
            nobody does.
        low, high: least and greatest possible figure: a value, or a factor where the input is relative.
        samples: of a file, ascending (n,); empty otherwise.
    """

    input: UncertainInput
    nominal: float | tuple[float, ...]
    given: Given
    low: float
    high: float
    samples: FloatArray

    @property
    def key(self) -> str:
        """Of the scenario."""
        return self.input.key

    @property
    def assumed(self) -> bool:
        """Whether nobody measured it."""
        return self.input.assumed

    @property
    def is_interval(self) -> bool:
        """Whether it has no distribution."""
        return self.input.shape == "interval"

    @cached_property
    def _figures(self) -> tuple[float, ...]:
        figures = self.input.figures
        if self.input.shape == "normal" and math.isnan(figures[0]):
            assert isinstance(self.nominal, float)
            return (self.nominal, figures[1])
        return figures

    @cached_property
    def _ends(self) -> tuple[float, float]:
        """Cumulative probability at the ends of what is possible."""
        from scipy.special import ndtr

        if self.input.shape == "normal":
            mean, sd = self._figures
            return float(ndtr((self.low - mean) / sd)), float(ndtr((self.high - mean) / sd))
        if self.input.shape == "lognormal":
            median, sigma = self._figures
            low = math.log(max(self.low, 1e-300) / median) / sigma
            return float(ndtr(low)), float(ndtr(math.log(self.high / median) / sigma))
        return 0.0, 1.0

    @property
    def outside(self) -> float:
        """Probability of impossible values, which are cut off."""
        below, not_above = self._ends
        return below + 1 - not_above

    def quantile(self, u: FloatArray) -> FloatArray:
        """Figures at cumulative probabilities; of an interval at shares of its length.

        Args:
            u: 0 to 1, of any shape.
        """
        from scipy.special import ndtri

        below, not_above = self._ends
        figures, inside = self._figures, below + np.asarray(u) * (not_above - below)
        found: FloatArray
        match self.input.shape:
            case "normal":
                found = figures[0] + figures[1] * ndtri(inside)
            case "lognormal":
                found = figures[0] * np.exp(figures[1] * ndtri(inside))
            case "triangular":
                low, mode, high = figures
                at_mode = (mode - low) / (high - low)
                rising = low + np.sqrt(inside * (high - low) * (mode - low))
                falling = high - np.sqrt((1 - inside) * (high - low) * (high - mode))
                found = np.where(inside < at_mode, rising, falling)
            case "samples":
                places = (np.arange(self.samples.size) + 0.5) / self.samples.size
                found = np.interp(inside, places, self.samples)
            case _:
                low, high = figures
                found = low + inside * (high - low)
        return np.clip(found, self.low, self.high)

    @cached_property
    def central(self) -> float:
        """The median; of an interval the value given, or its middle where none is."""
        if self.is_interval and self.given != "default":
            return 1.0 if self.input.relative else float(np.asarray(self.nominal))
        return float(self.quantile(np.array(0.5)))

    def limits(self, confidence: float) -> tuple[float, float]:
        """Between which figures it is looked at: the ends of an interval, else the quantiles 1 - c and c."""
        low, high = (0.0, 1.0) if self.is_interval else (1 - confidence, confidence)
        ends = self.quantile(np.array([low, high]))
        return float(ends[0]), float(ends[1])

    def value(self, figure: float) -> float:
        """The value of the key, of a list its lowest, at a figure."""
        if not self.input.relative:
            return figure
        return figure * float(np.min(self.nominal))


def resolve(problem: CollisionProblem) -> tuple[ResolvedInput, ...]:
    """The uncertain inputs of a checked scenario.

    Args:
        problem: of the scenario, whose robot and body give the values that the scenario does not.

    Raises:
        InputError: nothing to be relative to, a list where one number is wanted, an interval without the value given,
            samples that cannot be used, or a distribution with more than 5 % of itself among impossible values.
    """
    return tuple(_resolved(each, problem) for each in uncertain_inputs(problem.scenario))


def _resolved(each: UncertainInput, problem: CollisionProblem) -> ResolvedInput:
    scenario = problem.scenario
    nominal, given = _nominal(each, problem)
    least, greatest = valid_range(type(scenario), each)
    if isinstance(nominal, list) and not each.relative:
        raise InputError(
            each.field, f"{each.key} has {len(nominal)} values", "give relative figures, or name its items"
        )
    if (each.relative or (each.figures and math.isnan(each.figures[0]))) and nominal is None:
        raise InputError(each.field, f"{each.key} has no value to be relative to", "give one, or figures in its unit")
    if each.relative:
        finite = [abs(value) for value in np.atleast_1d(np.asarray(nominal, dtype=np.float64)) if math.isfinite(value)]
        if not finite or not min(finite) > 0:
            raise InputError(each.field, f"{each.key} is 0, of which nothing is a share", "give figures in its unit")
        least, greatest = max(least, 0.0) / min(finite), greatest / max(finite)
    samples = _samples(each, scenario, least, greatest) if each.file is not None else np.zeros(0)
    number = math.nan if nominal is None else tuple(nominal) if isinstance(nominal, list) else nominal
    found = ResolvedInput(each, number, given, least, greatest, samples)
    if found.is_interval:
        low, high = each.figures
        for end in (low, high):
            if not least * (1 - 1e-12) <= end <= greatest * (1 + 1e-12):
                problem_words = f"reaches {end:g}, which leaves what {each.key} can be"
                raise InputError(each.field, problem_words, f"wanted {least:g} to {greatest:g}")
    _check_given(found)
    if found.outside > MAX_OUTSIDE:
        raise InputError(
            each.field,
            f"{100 * found.outside:.3g} % of this distribution are values that {each.key} cannot have",
            f"wanted at most {100 * MAX_OUTSIDE:g} % outside {least:g} to {greatest:g}: try lognormal or triangular",
        )
    return found


def _check_given(found: ResolvedInput) -> None:
    """Refuse figures that leave out the value given: another case than the scenario's would be judged.

    A distribution may be another than a table of body regions or the robot's data say: then it has been measured.
    """
    if found.input.relative:
        here, what, wanted = 1.0, "the factor 1", "figures around it"
    else:
        here = math.nan if isinstance(found.nominal, tuple) else found.nominal
        what, wanted = f"the value given, {here:g}", "figures around it, or relative ones"
    if math.isnan(here) or found.given not in (("scenario", "robot") if found.is_interval else ("scenario",)):
        return
    rarely = _RARELY if found.input.shape in ("normal", "lognormal") else 0.0
    low, high = found.quantile(np.array([rarely, 1 - rarely])).tolist()
    if not low * (1 - 1e-12) <= here <= high * (1 + 1e-12):
        raise InputError(found.input.field, f"{low:.6g} to {high:.6g} leaves out {what}", f"wanted {wanted}")


def _nominal(each: UncertainInput, problem: CollisionProblem) -> tuple[float | list[float] | None, Given]:
    """The value of a key, and what gives it."""
    scenario, key = problem.scenario, each.whole_key
    table, _, name = key.rpartition(".")
    found: Any
    given: Given = "scenario"
    if each.is_factor:
        found = 1.0 if each.item is None else [1.0] * problem.robot.dof
    elif key == "motion.speed_mm_s":
        if scenario.motion.velocity_mm_s is None:
            raise InputError(each.field, "has no meaning with a trajectory", 'wanted motion.kind = "line"')
        found = math.hypot(*scenario.motion.velocity_mm_s)
    else:
        owner = getattr(scenario, table) if table else scenario
        found = getattr(owner, name)
        said = {other.rpartition(".")[2] for other in (key, *other_spelling(key))} & owner.model_fields_set
        if not any(getattr(owner, spelling) is not None for spelling in said):
            given = "default" if found is not None else "robot"
        if found is None:
            found = _said_elsewhere(key, problem)
            given = "default" if found is None else given
    if found is not None and not isinstance(found, int | float | list):
        raise InputError(each.field, f"{key} is {found!r}", "give it a number first")
    if each.item is None:
        return (float(found) if isinstance(found, int | float) else found), given
    if isinstance(found, int | float):
        found = [float(found)] * problem.robot.dof
    if found is None:
        raise InputError(each.field, f"{key} has no value whose item this is", f"give {key} of all joints first")
    if not 0 <= each.item < len(found):
        raise InputError(each.field, f"item {each.item + 1} is not there", f"{key} has {len(found)} items, from 1")
    return float(found[each.item]), given


def _said_elsewhere(key: str, problem: CollisionProblem) -> float | list[float] | None:
    """What the scenario says in another spelling, or leaves to the robot or the body."""
    table, _, name = key.rpartition(".")
    reaction, rated = problem.scenario.reaction, problem.robot.payload_kg
    if key == "reaction.payload_kg" and reaction.payload_percent is not None and rated is not None:
        return rated * reaction.payload_percent / 100
    if key == "reaction.payload_percent" and reaction.payload_kg is not None and rated is not None:
        return 100 * reaction.payload_kg / rated
    if table == "arm" and problem.elastic:
        unit = 2 * math.pi if name == "servo_bandwidth_hz" else 1.0
        values = getattr(problem.drive_train, QUANTITY[name])
        # A torque limit that is not known is infinite.
        known = values is not None and np.isfinite(values).all()
        return [float(value) / unit for value in values] if known else None
    if key == "contact.stiffness_N_m":
        return problem.body_stiffness
    if key == "contact.stiffness_N_mm":
        return problem.body_stiffness / 1e3
    return problem.body_mass if key == "contact.body_mass_kg" else None


def _samples(each: UncertainInput, scenario: Scenario, least: float, greatest: float) -> FloatArray:
    """The numbers of a file, one in a row, ascending."""
    assert each.file is not None
    field = f"{each.field}.{'relative_file' if each.relative else 'file'}"
    path = Path(scenario.folder) / each.file
    values: list[float] = []
    for number, line in enumerate(read_text(path, "wanted a CSV file of one column", field=field).splitlines(), 1):
        written = line.partition("#")[0].strip().rstrip(",;")
        if not written:
            continue
        try:
            value = float(written)
        except ValueError:
            if values or number > 1:
                raise InputError(
                    f"{field} line {number}", f"{written[:60]!r} is no number", "wanted one a row"
                ) from None
            continue  # a heading
        if not least <= value <= greatest:
            problem = f"is {value:g}, which {each.key} cannot be"
            raise InputError(f"{field} line {number}", problem, f"wanted {least:g} to {greatest:g}")
        values.append(value)
    if not _MIN_SAMPLES <= len(values) <= _MAX_SAMPLES:
        raise InputError(
            field, f"{each.file!r} holds {len(values)} numbers", f"wanted {_MIN_SAMPLES} to {_MAX_SAMPLES}"
        )
    return np.sort(np.array(values))


def changes_of(inputs: Sequence[ResolvedInput], figures: FloatArray, problem: CollisionProblem) -> dict[str, Any]:
    """Keys of the scenario and their values at a point.

    Args:
        inputs: as :func:`resolve` gives them.
        figures: one of each (inputs,).
        problem: of the scenario they belong to.
    """
    scenario, dof = problem.scenario, problem.robot.dof
    found: dict[str, Any] = {}
    factors: list[tuple[ResolvedInput, float]] = []
    for each, figure in zip(inputs, figures.tolist(), strict=True):
        key, item = each.input.whole_key, each.input.item
        if each.input.is_factor:
            factors.append((each, figure))
        elif item is not None:
            table, _, name = key.rpartition(".")
            whole = found.get(key, getattr(getattr(scenario, table) if table else scenario, name))
            if whole is None:
                whole = _said_elsewhere(key, problem)
            values = list(whole) if isinstance(whole, list) else [float(whole)] * dof
            values[item] = figure * float(np.asarray(each.nominal)) if each.input.relative else figure
            found[key] = values
        elif isinstance(each.nominal, tuple):
            found[key] = [figure * value for value in each.nominal]
        else:
            found[key] = figure * each.nominal if each.input.relative else figure
    if factors:
        found |= _scaled_detector(factors, found, scenario, dof)
    return found


def _scaled_detector(
    factors: list[tuple[ResolvedInput, float]], found: dict[str, Any], scenario: Scenario, dof: int
) -> dict[str, Any]:
    """Thresholds and noise as factors leave them.

    A joint model whose torque is g times the true one shows the contact g times as large: the same as thresholds and
    noise, both in its torque, over g.
    """
    threshold, gain = np.ones(dof), np.ones(dof)
    for each, factor in factors:
        scaled = threshold if each.input.whole_key == "detector.threshold_scale" else gain
        at = slice(None) if each.input.item is None else each.input.item
        scaled[at] *= factor
    detector, changed = scenario.detector, {}
    for key, scale in (
        ("thresholds_Nm", threshold / gain),
        ("noise_sd_Nm", 1 / gain),
        ("noise_mean_Nm", 1 / gain),
    ):
        value = found.get(f"detector.{key}", getattr(detector, key))
        if (scale != 1).any() and value is not None:
            changed[f"detector.{key}"] = (np.asarray(value, dtype=np.float64) * scale).tolist()
    return changed
