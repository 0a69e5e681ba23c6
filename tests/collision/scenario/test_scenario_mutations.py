"""Arbitrary mutations of scenarios and their files: the reader accepts or raises InputError, nothing else."""

from __future__ import annotations

import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hypothesis.strategies as st
from hypothesis import given, settings

from bumpstop.collision import CollisionProblem, Scenario, load_scenario
from bumpstop.errors import InputError
from collision.scenario_cases import EXAMPLE, example

ODD_NUMBERS = [0, -1, 1, 7, 8, 2**31, 2**63, 2**64, -(2**63), 10**400, 0.0, -0.0, 5e-324, 1e-300, 1e-9, 1e300]
SCALARS = st.one_of(
    st.sampled_from([*ODD_NUMBERS, math.inf, -math.inf, math.nan, True, False, None, "", "sia5d", "inf", "fixed"]),
    st.integers(),
    st.floats(),
    st.text(max_size=8),
    st.dates(),
)
VALUES = st.recursive(
    SCALARS,
    lambda inner: st.one_of(
        st.lists(inner, max_size=8), st.dictionaries(st.one_of(st.text(max_size=5), st.integers()), inner, max_size=3)
    ),
    max_leaves=8,
)
KEYS = sorted({f"{table}.{key}" for table, value in example().items() if isinstance(value, dict) for key in value})
OTHER_KEYS = [
    *["robot", "pose_deg", "pose_rad", "motion", "contact", "detector", "reaction", "simulation", "verdict", "base"],
    *["motion.start", "motion.duration_s", "motion.task", "motion.damping", "motion.kind"],
    *["contact.stiffness_N_m", "contact.peak_factor", "contact.link", "contact.point_m", "contact.normal"],
    *["contact.offset_mm", "contact.kind", "contact.arm", "contact.pressure_area", "contact.body_mass_kg"],
    *["detector.noise_mean_Nm", "detector.arming_delay_s", "detector.residual", "detector.noise_correlation"],
    *[
        "reaction.latency_s",
        "simulation.step_s",
        "simulation.substeps",
        "verdict.accepted_probability",
        "verdict.max_false_alarm",
    ],
]
KEY_CHOICES = st.one_of(st.sampled_from(KEYS + OTHER_KEYS), st.text(max_size=6), st.just("made_by"), st.just("folder"))


def mutate(data: dict[str, Any], key: str, action: Callable[[dict[str, Any], str], None]) -> None:
    *tables, last = key.split(".", 1)
    here: Any = data
    for table in tables:
        here = here.get(table)
    if isinstance(here, dict):
        action(here, last)


MUTATIONS = st.lists(st.tuples(KEY_CHOICES, st.one_of(st.just(...), VALUES)), min_size=1, max_size=3)


@given(mutations=MUTATIONS)
@settings(max_examples=300, deadline=None, derandomize=True, database=None)
def test_any_mutation_is_read_or_refused(mutations: list[tuple[str, Any]]) -> None:
    data = example()
    for key, value in mutations:
        if value is ...:
            mutate(data, key, lambda table, last: table.pop(last, None))
        else:
            mutate(data, key, lambda table, last, value=value: table.__setitem__(last, value))  # type: ignore[misc]
    try:
        scenario = Scenario.from_dict(data)
        CollisionProblem.from_scenario(scenario)
    except InputError as error:
        assert error.field  # noqa: PT017
        assert error.problem  # noqa: PT017
        assert len(str(error)) < 1500  # noqa: PT017
    else:
        assert Scenario.from_dict(scenario.to_dict()) == scenario.with_values({})


def test_any_corruption_of_a_file_is_read_or_refused(tmp_path: Path) -> None:
    source = EXAMPLE.read_bytes()
    generator = random.Random(3)
    path = tmp_path / "corrupt.toml"
    refused = 0
    for _ in range(400):
        content = bytearray(source)
        for _ in range(generator.randint(1, 3)):
            begin = generator.randrange(len(content))
            end = begin + generator.choice([0, 1, 1, 2, 40])
            content[begin:end] = generator.choice(
                [b"", b"\n", b"=", b"[", b"]", b'"', b".", b"#", b"-", b"9" * 30, b"nan", generator.randbytes(2)]
            )
        path.write_bytes(bytes(content))
        try:
            CollisionProblem.from_scenario(load_scenario(path))
        except InputError:
            refused += 1
    # Neither is everything refused nor does everything pass.
    assert 100 < refused < 390
