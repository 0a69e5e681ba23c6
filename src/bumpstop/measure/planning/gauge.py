"""Gauges: devices that measure a collision, a pad before a spring, by body region."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from importlib import resources
from typing import TYPE_CHECKING, Any

from bumpstop.contact import LimitTable
from bumpstop.errors import InputError, near_matches
from bumpstop.plant.objects import PlantObject, gauge_pad_hardness, gauge_regions
from bumpstop.text_files import parse_toml

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario

_OWN = "scenario"
_STIFFNESS = ("contact.stiffness_N_m", "contact.stiffness_N_mm")
# A spring that differs from the region's stiffness by more than this is named.
_ALIKE = 1.25


@dataclass(frozen=True)
class Gauge:
    """A measuring device: pad K1 before spring K2.

    Attributes:
        device: region whose device it is, or ``"scenario"`` where the scenario's contact is the gauge.
        spring_N_m: K2 [N/m]; infinite: none but the pad.
        pad_N_m: K1 [N/m].
        pad_shore_a: hardness of the pad; NaN where it is not known.
        status: how far spring and choice are attested.
        source: where they come from.
        note: what a reader should know of the choice; empty: nothing.
    """

    device: str
    spring_N_m: float
    pad_N_m: float
    pad_shore_a: float
    status: str
    source: str
    note: str = ""

    @property
    def series_N_m(self) -> float:
        """Stiffness of pad and spring together [N/m]."""
        return 1 / (1 / self.pad_N_m + 1 / self.spring_N_m)

    @property
    def is_own(self) -> bool:
        """Whether the scenario's own contact is the gauge."""
        return self.device == _OWN

    @property
    def words(self) -> str:
        """Device, spring and pad on one line."""
        if self.is_own:
            return f"as the scenario has it, {self.series_N_m / 1e3:.4g} N/mm"
        return (
            f"{self.device.replace('_', ' ')}: K2 {self.spring_N_m / 1e3:.4g} N/mm, pad {self.pad_shore_a:.3g} Shore A "
            f"(K1 {self.pad_N_m / 1e3:.4g} N/mm)"
        )

    def to_json(self) -> dict[str, Any]:
        """Figures with status and source."""
        return {
            "device": self.device,
            "spring_N_mm": None if math.isinf(self.spring_N_m) else self.spring_N_m / 1e3,
            "pad_N_mm": self.pad_N_m / 1e3,
            "pad_shore_a": None if math.isnan(self.pad_shore_a) else self.pad_shore_a,
            "status": self.status,
            "source": self.source,
        }

    def measured(self, scenario: Scenario) -> Scenario:
        """The scenario with the gauge as what is hit: clamped to the ground, or with the body's mass on a slide."""
        if self.is_own:
            return scenario
        # How well a body's stiffness is known says nothing of a pad.
        known = {key: entry for key, entry in scenario.uncertainty.items() if key not in _STIFFNESS}
        changes: dict[str, Any] = {
            "uncertainty": known,
            "contact.gauge_mass_kg": None,
            "contact.damping_Ns_m": 0.0,
        }
        if scenario.contact.kind == "free":
            return scenario.with_values(changes | {"contact.stiffness_N_m": self.series_N_m})
        return scenario.with_values(
            changes | {"contact.stiffness_N_m": self.pad_N_m, "contact.gauge_spring_N_m": self.spring_N_m}
        )


@lru_cache(maxsize=1)
def _table() -> dict[str, Any]:
    text = resources.files("bumpstop.measure").joinpath("data", "gauge_regions.toml").read_text(encoding="utf-8")
    return parse_toml(text, "gauge_regions.toml")


def check_device(device: str) -> None:
    """Refuse a device that there is not.

    Raises:
        InputError: it is none of :func:`bumpstop.plant.gauge_regions`.
    """
    if device not in gauge_regions():
        raise InputError("gauge", f"{device!r} is no device", near_matches(device, gauge_regions()))


def gauge_of(scenario: Scenario, device: str | None = None) -> Gauge:
    """The device that stands for what a scenario hits.

    Args:
        scenario: names a body region, or has a contact that is a gauge already.
        device: one of :func:`bumpstop.plant.gauge_regions`; None: that of the body region.

    Raises:
        InputError: there is no such device.
    """
    contact = scenario.contact
    if device is not None:
        check_device(device)
        return _device(device, "chosen by the user")
    if contact.body is None or contact.gauge_spring_N_m is not None:
        stiffness = contact.stiffness_N_m
        assert stiffness is not None, "a contact without a body region, or with a gauge, gives it"
        spring = contact.gauge_spring_N_m
        note = (
            "No body region is named: the scenario's own contact counts as the gauge." if contact.body is None else ""
        )
        return Gauge(_OWN, math.inf if spring is None else spring, stiffness, math.nan, "given", "the scenario", note)
    table = _table()
    named = table["device_of_region"].get(contact.body)
    if named is not None:
        return _device(named, table["status"])
    wanted = _region_stiffness(scenario)
    devices = [_device(region, "engineering choice") for region in gauge_regions()]
    nearest = min(devices, key=lambda gauge: abs(math.log(gauge.spring_N_m / wanted)))
    ratio = nearest.spring_N_m / wanted
    note = f"No device is known for {contact.body}: that of the nearest spring stands for it."
    if not 1 / _ALIKE <= ratio <= _ALIKE:
        note = note[:-1] + f", which has {ratio:.2g} times the region's stiffness."
    return Gauge(**{**nearest.__dict__, "note": note})


def _device(region: str, status: str) -> Gauge:
    found = PlantObject.gauge(region, position=(0, 0, 0), normal=(0, 0, 1))
    assert found.spring is not None
    source = f"{found.source}; {_table()['source']}"
    return Gauge(
        region, found.spring, found.stiffness, gauge_pad_hardness(region), f"{status}; pad stiffness assumed", source
    )


def _region_stiffness(scenario: Scenario) -> float:
    contact = scenario.contact
    assert contact.body is not None
    table = LimitTable.load(contact.limits, relative_to=scenario.folder)
    return table.contact_limits(contact.body, contact.kind, contact.pressure_area).stiffness_N_m
