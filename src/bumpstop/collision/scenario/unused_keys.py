"""Keys of a scenario that change nothing beside its other keys."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario_tables import ScenarioTables
    from bumpstop.collision.stopping.deceleration import Deceleration


# Whether drives or brakes stop the arm also says which rows of a stopping table count.
_DRIVES = "on numbers: with 1 and 2 drives stop the arm, and joints keep their ratios"


def keys_without_effect(scenario: ScenarioTables) -> dict[str, str]:
    """Dotted keys whose value changes nothing in this scenario, given or not, and why, to follow "has no effect"."""
    contact, detector = scenario.contact, scenario.detector
    found: dict[str, str] = {}
    if contact.body is None:
        nothing = "without contact.body: there is no limit to judge by"
        found |= dict.fromkeys(("contact.limits", "contact.pressure_area", "verdict.clamped_limit"), nothing)
    elif contact.kind == "free":
        found["verdict.clamped_limit"] = 'with contact.kind = "free", which transient limits judge'
    if contact.offset_law != "half_normal":
        found["contact.offset_sd_s"] = f'with contact.offset_law = "{contact.offset_law}"'
    if detector.residual == "direct":
        found["detector.observer_gain_1_s"] = 'with detector.residual = "direct"'
    if detector.residuals is not None:
        found["detector.noise_sd_Nm"] = "with detector.residuals, whose noise counts"
    if contact.kind == "free":
        found["arm.torque_limit_Nm"] = "on a body that gets away"
    if contact.kind == "free" or scenario.arm.model == "rigid":
        found["gravity_m_s2"] = "but where the drives of an elastic arm press a clamped body"
    if not scenario.uncertainty:
        found["verdict.confidence"] = "without [uncertainty]"
    if scenario.reaction.stop_category in (1, 2) and scenario.reaction.deceleration != "table":
        found["reaction.stop_category"] = _DRIVES
    return found


def given_without_effect(scenario: ScenarioTables) -> dict[str, str]:
    """Those of them that the scenario gives."""
    return {key: why for key, why in keys_without_effect(scenario).items() if _is_given(scenario, key)}


def unused_notes(scenario: ScenarioTables, deceleration: Deceleration) -> list[str]:
    """A sentence about each key that was given and changes nothing, also beside what files say."""
    found = given_without_effect(scenario)
    times = deceleration.times
    if times is not None and times.category is None and scenario.reaction.stop_category in (1, 2):
        found["reaction.stop_category"] = _DRIVES
    return [f"{key} has no effect {why}." for key, why in found.items()]


def _is_given(scenario: ScenarioTables, key: str) -> bool:
    table, _, name = key.rpartition(".")
    keys = getattr(scenario, table) if table else scenario
    return name in keys.model_fields_set and getattr(keys, name) is not None
