"""What the command refuses, the page refuses, and what the page leaves to the command, it refuses by name."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from web.exports import ROOT

from bumpstop.cli.completion import scenario_keys
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.scenario.scenario import Scenario
from bumpstop.errors import InputError
from web.cases import random_tables
from web.node import MISSING, WHY_NOT, in_node

pytestmark = pytest.mark.skipif(MISSING, reason=WHY_NOT)

LATERAL = (ROOT / "examples" / "04_hand_lateral.toml").read_text(encoding="utf-8")
VALUES: list[Any] = tomllib.loads("""values = [
  0, 1, 7, 8, -1, 0.0, 1.0, 0.5, 5.0, -0.0, 1e-12, 1e-3, 0.3, 1e7, 1e300, inf, -inf, nan, true,
  "", "free", "clamped", "stop", "fixed", "uniform", "half_normal", "observer", "ramp", "constant_time", "rest",
  "position", "tool0", "sia5d", "ur10e", "bgia2011", "ts15066", "hand_finger", "skull_forehead", "__proto__",
  "constructor",
  [], [7], [7, 7], [0], [8], [7.0], [1, 2, 3, 4, 5, 6, 7], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1, 2], [nan, nan, nan],
  [1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0], [20.0, 20.0, 20.0, 20.0, 20.0, 20.0], [inf, inf, inf, inf, inf, inf, inf],
  ["a"], [[1.0]], {}, {a = 1},
]""")["values"]


def mutated(rng: np.random.Generator, seed: int) -> str:
    """A scenario with one to three keys changed, taken away or put elsewhere."""
    tables = random_tables(seed)
    keys = [*scenario_keys(), "motion.speed", "nothing", "contact", "detector", "constructor", "motion.__proto__"]
    for _ in range(rng.integers(1, 4)):
        *above, last = str(rng.choice(keys)).split(".")
        here = tables
        for table in above:
            here = here.setdefault(table, {})
        if not isinstance(here, dict):
            continue
        if rng.random() < 0.2:
            here.pop(last, None)
        else:
            here[last] = VALUES[rng.integers(len(VALUES))]
    return tomli_w.dumps(tables)


def refusal_of_command(text: str) -> InputError | None:
    try:
        CollisionProblem.from_scenario(Scenario.from_dict(tomllib.loads(text)))
    except InputError as error:
        return error
    return None


def test_nothing_is_accepted_that_the_command_refuses(page_script: Path) -> None:
    rng = np.random.default_rng(1)
    texts = [mutated(rng, seed) for seed in range(1500)]
    refused = computed = 0
    for text, told in zip(texts, in_node(page_script, "check", texts), strict=True):
        refusal = refusal_of_command(text)
        if refusal is None:
            # What the command takes, the page takes, too, but for what it says it does not compute.
            assert "this page" in told.get("refused", "this page"), f"{told}\n{text}"
            computed += "refused" not in told
        else:
            assert "refused" in told, f"{refusal}\n{text}"
            refused += 1
    assert refused > 500
    assert computed > 75


def changed(changes: dict[str, Any]) -> str:
    """The lateral motion with dotted keys set; None takes a key away."""
    tables: dict[str, Any] = tomllib.loads(LATERAL)
    for key, value in changes.items():
        *above, last = key.split(".")
        here = tables.setdefault(above[0], {}) if above else tables
        if value is None:
            del here[last]
        else:
            here[last] = value
    return tomli_w.dumps(tables)


# By the field that both name.
REFUSED: tuple[tuple[str, dict[str, Any]], ...] = (
    ("pose_deg", {"pose_deg": [0.0] * 7}),
    ("pose_deg", {"pose_deg": [0, 999, 0, -20, 0, -40, 0]}),
    ("pose_deg", {"pose_deg": [0, 30]}),
    ("pose_deg", {"pose_deg": None}),
    ("pose_deg", {"pose_rad": [0.0] * 7}),
    ("gravity_m_s2", {"gravity_m_s2": [0, 0, -1.6]}),
    ("assumed", {"assumed": ["detector.noise_mean_Nm"]}),
    ("assumed", {"assumed": ["detector"]}),
    ("assumed", {"assumed": ["assumed"]}),
    ("assumed", {"assumed": "detector.noise_sd_Nm"}),
    ("assumed[1]", {"assumed": [1]}),
    ("gravity_m_s2", {"gravity_m_s2": [0, -9.8]}),
    ("motion.velocity_mm_s", {"motion.velocity_mm_s": [0, 0, 0]}),
    ("motion.velocity_mm_s", {"motion.velocity_mm_s": [0, 0, 1e-4]}),
    ("motion.velocity_mm_s", {"motion.velocity_mm_s": None}),
    ("motion.velocity_mm_s", {"motion.speed_mm_s": 50, "motion.direction": [0, 0, 1]}),
    ("motion.direction", {"motion.velocity_mm_s": None, "motion.speed_mm_s": 50}),
    ("motion.direction", {"motion.velocity_mm_s": None, "motion.speed_mm_s": 50, "motion.direction": [0, 0, 0]}),
    ("motion.held_joints", {"motion.held_joints": [8]}),
    ("motion.held_joints", {"motion.held_joints": [7, 7]}),
    ("motion.held_joints[1]", {"motion.held_joints": [7.0]}),
    ("motion.task", {"motion.held_joints": [6, 7]}),
    ("motion.duration_s", {"motion.duration_s": 1e5}),
    ("motion.duration_s", {"motion.duration_s": 1e-4}),
    ("contact.body", {"contact.body": None}),
    ("contact.body", {"contact.body": "nose"}),
    ("contact.pressure_area", {"contact.pressure_area": "nowhere"}),
    ("contact.link", {"contact.link": "link_99"}),
    ("contact.normal", {"contact.normal": [0, -1, 0]}),
    ("contact.normal", {"contact.normal": [0, 0, 0]}),
    ("contact.offset_mm", {"contact.offset_mm": 3}),
    ("contact.offset_mm", {"contact.offset_law": "fixed"}),
    ("contact.stiffness_N_m", {"contact.stiffness_N_m": 1e5, "contact.stiffness_N_mm": 100}),
    ("detector.thresholds_Nm", {"detector.thresholds_Nm": [10]}),
    ("detector.thresholds_Nm[2]", {"detector.thresholds_Nm": [20, 0, 20, 20, 20, 20, 20]}),
    ("detector.noise_sd_Nm", {"detector.noise_sd_Nm": [1, 2]}),
    ("detector.noise_sd_Nm", {"detector.noise_sd_Nm": None}),
    ("detector.feedback_period_s", {"detector.feedback_period_s": 0.0035}),
    ("reaction.stopping_time_s", {"reaction.stopping_time_s": 0.1}),
    ("reaction.ramp_time_s", {"reaction.deceleration": "ramp"}),
    ("reaction.stop_category", {"reaction.stop_category": 1}),
    (
        "reaction.stop_category",
        {
            "reaction.kind": "stop",
            "reaction.stop_category": 0,
            "reaction.deceleration": "constant_time",
            "reaction.stopping_time_s": 0.1,
        },
    ),
    ("simulation.substeps", {"simulation": {"step_s": 1e-4, "substeps": 500}}),
    ("verdict.accepted_probability", {"verdict": {"accepted_probability": 1.0}}),
    ("verdict.accepted_probability", {"verdict": {"accepted_probability": 1e-17}}),
    ("contact.aera_cm2", {"contact.aera_cm2": 2}),
)


def test_both_refuse_the_same_key(page_script: Path) -> None:
    texts = [changed(changes) for _, changes in REFUSED]
    for (field, changes), text, told in zip(REFUSED, texts, in_node(page_script, "check", texts), strict=True):
        refusal = refusal_of_command(text)
        assert refusal is not None, changes
        assert (told.get("field"), refusal.field) == (field, field), f"{changes}: {told}\n{refusal}"


LEFT = {
    "arm.model": ("elastic", "arms that give way"),
    "arm.torque_limit_Nm": (50.0, "arms that give way"),
    "uncertainty": ({"contact.area_cm2": {"interval": [1.0, 3.0]}}, "uncertain numbers"),
    "motion.kind": ("trajectory", "trajectories"),
    "contact.kind": ("free", "free contact"),
    "contact.damping_Ns_m": (10.0, "bodies with damping"),
    "contact.gauge_spring_N_m": (75000, "gauges"),
    "detector.residuals": ("noise.parquet", "measured noise"),
    "reaction.deceleration": ("table", "stopping tables"),
    "verdict.clamped_limit": ("two_phase", "two phases of contact"),
    "robot": ("arm.urdf", 'has no "arm.urdf"'),
    "contact.limits": ("mine.toml", 'has no table "mine.toml"'),
}


@pytest.mark.parametrize("key", LEFT)
def test_what_the_page_leaves_to_the_command_is_refused_by_name(page_script: Path, key: str) -> None:
    value, words = LEFT[key]
    (told,) = in_node(page_script, "evaluate", [changed({key: value})])
    assert told["refused"].startswith(f"{key}: this page ")
    assert words in told["refused"]
