"""Keys that a scenario calls assumed: they stand beside the verdict until somebody knows them."""

from __future__ import annotations

import pytest

import bumpstop as bs
from bumpstop.study import Variable
from bumpstop.view.document import with_keys
from collision.scenario_cases import example

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


@pytest.mark.parametrize("key", ["detector.noise_mean_Nm", "detector", "assumed", "nonsense"])
def test_what_is_assumed_is_given(key: str) -> None:
    with pytest.raises(bs.InputError, match=rf"^assumed: '{key}' is no key that is given here; "):
        assuming([key])
