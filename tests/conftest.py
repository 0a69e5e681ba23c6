"""What all tests share: a browser, and their order, in which files that take longest begin first."""

from __future__ import annotations

from pathlib import Path

import pytest

from browsers import browser as browser

TESTS = Path(__file__).parent
# Those of more than some ten seconds, longest first (`pytest --durations=50`).
LONGEST = [
    "math/test_cpp_programs.py",
    "validation/test_validation.py",
    "collision/test_sanitized.py",
    "docs/test_commands.py",
    "web/test_numbers.py",
    "study/speed/test_path_speed.py",
    "cpp/test_package.py",
    "report/test_report.py",
    "cli/test_command.py",
    "docs/test_site_pages.py",
    "study/speed/test_speed_limits.py",
    "cli/test_identify.py",
    "cli/test_refusals.py",
    "cli/test_study.py",
    "cli/test_json.py",
    "cli/test_identify_dynamics.py",
    "cli/test_sliding_joints.py",
    "detection/tuning/test_tuning_commands.py",
]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    rank = {TESTS / name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path, len(rank)))
