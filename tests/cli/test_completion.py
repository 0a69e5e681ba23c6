"""What the shell completes, as bash asks for it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import typer

import bumpstop as bs
from bumpstop.cli.completion import scenario_keys
from bumpstop.cli.main import main
from bumpstop.collision.scenario.scenario import Scenario

Complete = Callable[[str], list[str]]


@pytest.fixture
def complete(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Complete:
    """Answers of the command to a line that ends where the cursor is."""

    def ask(line: str) -> list[str]:
        monkeypatch.setenv("_BUMPSTOP_COMPLETE", "complete_bash")
        monkeypatch.setenv("COMP_WORDS", line)
        monkeypatch.setenv("COMP_CWORD", str(len(line.split(" ")) - 1))
        command = typer.main.get_command(main.__globals__["app"])
        with pytest.raises(SystemExit):
            command.main([], prog_name="bumpstop", complete_var="_BUMPSTOP_COMPLETE")
        return capsys.readouterr().out.split()

    return ask


@pytest.mark.parametrize(
    "line",
    [
        "new ",
        "robots show ",
        "identify --robot ",
        "sensitivity ",
        "detect x.csv --robot ",
        "plan identification --robot ",
    ],
)
def test_robots(complete: Complete, line: str) -> None:
    assert complete(f"bumpstop {line}") == list(bs.robots())
    assert complete(f"bumpstop {line}sia") == ["sia5d"]
    assert complete(f"bumpstop {line}./arm") == []  # files, then


def test_limit_tables_and_body_regions(complete: Complete) -> None:
    assert complete("bumpstop bodies --limits ts") == ["ts15066"]
    hands = complete("bumpstop study effectiveness x.toml --body hand")
    regions = {region.name for name in ("bgia2011", "ts15066") for region in bs.LimitTable.load(name).regions}
    assert set(hands) == {name for name in regions if name.startswith("hand")} != set()


def test_keys_of_scenarios_and_their_values(complete: Complete) -> None:
    assert complete("bumpstop evaluate x.toml --set simulation.st") == ["simulation.step_s="]
    assert complete("bumpstop evaluate x.toml --set contact.kind") == ["contact.kind=clamped", "contact.kind=free"]
    assert "contact.limits=ts15066" in complete("bumpstop evaluate x.toml --set contact.limits")
    assert complete("bumpstop evaluate x.toml --set contact.bodyy") == []
    assert "motion.speed_mm_s" in complete("bumpstop study parameters x.toml --vary motion.s")
    assert complete("bumpstop require x.toml --vary motion") == ["motion.speed"]


def test_every_key_is_one_that_a_scenario_takes() -> None:
    scenario = bs.load_scenario("examples/01_hand_downward.toml").to_dict()
    assert {f"{table}.{key}" for table in ("motion", "contact") for key in scenario[table]} <= set(scenario_keys())
    assert {key.split(".")[0] for key in scenario_keys()} == set(Scenario.model_fields) - {"folder", "uncertainty"}
