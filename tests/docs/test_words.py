"""Words that people read: those of the field, in what is printed, in help, on pages and in documents."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# Private words, and what the field says.
WORDS = {
    r"felt": "detected",
    r"notic(?:e|es|ed|ing)": "detected",
    r"unnoticed": "undetected, undetectable",
    r"work(?:s|ed|ing)? out": "compute",
    r"foret(?:ell|ells|old|elling)": "predict",
    r"taken up again": "resumed",
    r"(?:cannot|can not) be seen": "not identifiable",
    r"held-out fifths": "5-fold cross-validation error",
    r"harsh(?:er|est)?": "less, least conservative",
    r"mild(?:er|est)": "more, most conservative",
    r"no bound": "unbounded",
    r"exact laws?|sampled laws?|force laws?": "integrated, sampled, force distribution",
    r"[Tt]he source's": "Schroeder (2013)",
    r"(?:un)?watched": "monitored",
    r"harmless": "below the limits; of zero force",
    r"horizons?": "end of the motion",
    r"leap(?:s|t|ed|ing)?": "jump",
    r"predicted less|measured less|estimated less": "minus",
    r"pass(?:es|ing)? (?:a|the|its|their) (?:force |pressure )?limits?": "exceed",
}
PRIVATE = re.compile(rf"(?<![\w.`/-])(?:{'|'.join(WORDS)})(?![\w`/])", re.IGNORECASE)
# Names that the field has better ones for: once gone from the code they stay gone. The changelog says what they became.
NAMES = Path(__file__).with_name("private_names.txt").read_text(encoding="utf-8").split()
PRIVATE_NAME = re.compile(rf"\b(?:{'|'.join(NAMES)})\b")
CODE = ("src/bumpstop", "include", "bindings", "tests", "validation", "benchmarks", "examples")
# Pages that are written elsewhere: the fits and the numerics have words of their own.
LEFT_OUT = {"identification.md", "math.md"}


def read_by_people(path: Path) -> list[str]:
    """Texts of a module that are more than a name, docstrings of commands among them."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    hidden = {
        id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    commands = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef)
        and "Annotated" in ast.dump(node.args)
        and isinstance(node.body[0], ast.Expr)
    }
    return [
        node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Constant)
        and isinstance(node.value, str)
        and " " in node.value.strip()
        and (id(node) not in hidden or id(node) in commands)
    ]


def private_words(text: str) -> list[str]:
    return [found.group(0) for found in PRIVATE.finditer(text)]


def test_the_search_finds_a_private_word() -> None:
    assert private_words("99 of 100 are noticed; the exact law is worked out.") == [
        "noticed",
        "exact law",
        "worked out",
    ]
    assert not private_words("`worst_unnoticed_N` and law.parquet keep their names")


@pytest.mark.parametrize("room", ["cli", "report", "reproduction", "collision", "study", "detection", "measure"])
def test_messages_help_and_pages_use_the_field_s_words(room: str) -> None:
    found = {
        f"{path.relative_to(ROOT)}: {text}": words
        for path in sorted((ROOT / "src/bumpstop" / room).rglob("*.py"))
        for text in read_by_people(path)
        if (words := private_words(text))
    }
    assert not found


@pytest.mark.parametrize(
    "page",
    [path for path in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))] if path.name not in LEFT_OUT],
    ids=lambda path: path.name,
)
def test_documents_use_the_field_s_words(page: Path) -> None:
    lines = page.read_text(encoding="utf-8").splitlines()
    found = {f"{k}: {line}": words for k, line in enumerate(lines, start=1) if (words := private_words(line))}
    assert not found


def test_the_search_finds_a_private_name() -> None:
    assert PRIVATE_NAME.findall("QuietTicks of a stretch; blind_stretches, not_blind_at_all") == [
        "QuietTicks",
        "blind_stretches",
    ]


@pytest.mark.parametrize("tree", CODE)
def test_names_that_are_gone_stay_gone(tree: str) -> None:
    found = {
        f"{path.relative_to(ROOT)}:{number}": names
        for path in sorted((ROOT / tree).rglob("*"))
        if path.suffix in (".py", ".hpp", ".cpp", ".toml") and path != Path(__file__).resolve()
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1)
        if (names := PRIVATE_NAME.findall(line))
    }
    assert not found
