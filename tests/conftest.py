"""The order of the tests: files that take longest begin first, so that no process waits long for the last of them."""

from __future__ import annotations

from pathlib import Path

import pytest

TESTS = Path(__file__).parent
# Those of more than some ten seconds, longest first (`pytest --durations=50`).
LONGEST = [
    "collision/test_sanitized.py",
    "math/test_cpp_programs.py",
    "validation/test_validation.py",
    "cpp/test_package.py",
    "study/speed/test_path_speed.py",
    "report/test_report.py",
    "docs/test_site_pages.py",
    "docs/test_commands.py",
    "cli/test_study.py",
    "collision/distribution/test_exact_law.py",
]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    rank = {TESTS / name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path, len(rank)))
