"""Keys that a scenario calls assumed: they stand beside the verdict until somebody knows them."""

from __future__ import annotations

import pytest

import bumpstop as bs
from bumpstop.program.cell import Cell
from bumpstop.study import Variable
from bumpstop.view.document import with_keys
from collision.scenario_cases import example
from program.corpora import EXAMPLES

ASSUMED = ["detector.thresholds_Nm", "contact.stiffness_N_mm", "pose_deg"]


def assuming(keys: list[str]) -> bs.Scenario:
    data = example()
    data["contact"]["stiffness_N_m"] = 75000.0
    return bs.Scenario.from_dict(data | {"assumed": keys})


def test_what_is_assumed_stands_beside_the_verdict_until_it_is_set() -> None:
    scenario = assuming(ASSUMED)
    (said,) = [note for note in bs.evaluate(scenario).warnings if "ASSUMED" in note]
    assert said.startswith("detector.thresholds_Nm, contact.stiffness_N_mm, pose_deg are ASSUMED")
    assert scenario.to_dict()["assumed"] == ASSUMED
    # In either spelling; what is changed besides leaves it as it is.
    known = scenario.with_values({"contact.stiffness_N_m": 60000.0, "reaction.latency_s": 0.01, "pose_rad": [0.1] * 7})
    assert known.assumed == ["detector.thresholds_Nm"]
    assert with_keys(scenario, {"contact.stiffness_N_m": None}).assumed == ["detector.thresholds_Nm", "pose_deg"]
    assert Variable("detector.thresholds").apply(scenario, 15.0).assumed == ASSUMED[1:]
    table = {"thresholds_Nm": [15.0] * 7, "noise_sd_Nm": 3.0}
    assert scenario.with_values({"detector": table}).assumed == ASSUMED[1:]
    done = known.with_values({"detector.thresholds_Nm": [20.0] * 7})
    assert done.assumed == []
    assert "assumed" not in done.to_dict()
    assert not any("ASSUMED" in note for note in bs.evaluate(done).warnings)


def test_what_is_left_out_is_not_assumed_any_more() -> None:
    """Of copies that a command makes: they were refused for keys that the scenario gives."""
    keys = ["pose_deg", "motion.velocity_mm_s", "contact.offset_law", "verdict.confidence", "contact.stiffness_N_mm"]
    data = bs.load_scenario(EXAMPLES / "cell.toml").to_dict()
    data["verdict"]["confidence"] = 0.9
    data["contact"]["stiffness_N_m"] = 75000.0
    data["uncertainty"] = {"reaction.latency_s": {"distribution": "normal", "relative_sd": 0.1}}
    uncertain = bs.Scenario.from_dict(data | {"assumed": keys}, EXAMPLES)
    known = uncertain.without_uncertainty()
    assert known.assumed == [key for key in keys if key != "verdict.confidence"]
    assert Cell(known).scenario.assumed == ["contact.stiffness_N_mm"]


@pytest.mark.parametrize("key", ["detector.noise_mean_Nm", "detector", "assumed", "nonsense"])
def test_what_is_assumed_is_given(key: str) -> None:
    with pytest.raises(bs.InputError, match=rf"^assumed: '{key}' is no key that is given here; "):
        assuming([key])
