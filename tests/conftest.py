"""What all tests share: a browser, and their order, in which files that take longest begin first."""

from __future__ import annotations

import gc
import signal
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
    "docs/test_site_pages.py",
    "identification/verdict/test_fit_verdict.py",
    "cpp/test_package.py",
    "study/speed/test_speed_limits.py",
    "web/test_numbers.py",
    "report/test_report.py",
    "cli/test_identify_dynamics.py",
    "cli/test_refusals.py",
    "study/speed/test_path_speed.py",
    "collision/test_interruption.py",
    "cli/test_study.py",
    "cli/test_identify.py",
    "measure/test_gauge_reading.py",
    "uncertainty/test_uncertain_verdict.py",
    "identification/drive_train/test_drive_train_fit.py",
    "cli/test_json.py",
    "identification/test_gains_fit.py",
    "identification/test_friction_laws.py",
    "collision/trajectory/test_trajectory.py",
    "collision/distribution/test_noise_with_memory.py",
    "cli/test_command.py",
    "plant/test_rehearsal.py",
    "identification/test_dynamics_fit.py",
    "uncertainty/test_dependence.py",
]


def pytest_configure() -> None:
    """Let commands be interrupted: behind a shell's ``&`` they ignore it, as what started them does."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    rank = {TESTS / name: number for number, name in enumerate(LONGEST)}
    items.sort(key=lambda item: rank.get(item.path, len(rank)))


def pytest_collection_finish() -> None:
    """Modules and collected tests stay to the end: collections that went through them took a twentieth of the run."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000)


@pytest.fixture
def unsaved_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures are drawn, but not made SVG and PNG, most of a page's time: for what it says, where others save them."""
    monkeypatch.setattr("bumpstop.report.picture.Rendered._saved", lambda *_: b'<svg viewBox="0 0 1 1"></svg>')
