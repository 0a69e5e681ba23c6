"""Directives that write the reference from the code: scenario keys, commands, public names, headers."""

from __future__ import annotations

import re
import shutil
import subprocess
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from types import NoneType
from typing import Any, get_args, get_origin

from docutils import nodes
from pygments.lexers.special import TextLexer
from sphinx.util.docutils import SphinxDirective

import bumpstop as bs
from bumpstop.cli.completion import scenario_keys

ROOT = Path(__file__).resolve().parents[2]
# A field of a docstring that documents several names.
_SEVERAL = r":(ivar|param) (\w+(?:, \w+)+):(.*)"
CPP_NAMES = ("CollisionSetup", "GaussianThresholds", "Contact", "Detector", "DetectorOutput", "DetectorEvent")


class _Written(SphinxDirective, ABC):
    """A directive whose content is text that it writes."""

    @abstractmethod
    def lines(self) -> list[str]:
        """The text, in the markup of the page."""

    def run(self) -> list[nodes.Node]:
        """Parse the text where the directive stands."""
        return self.parse_text_to_nodes("\n".join(self.lines()), allow_section_headings=True)


class ScenarioKeys(_Written):
    """A table of the keys of each table of a scenario, from the classes that read it."""

    def lines(self) -> list[str]:
        """A heading and a table for each table of the file."""
        from bumpstop.collision.scenario.scenario import Scenario

        found: dict[str, list[str]] = {}
        schema = Scenario.model_json_schema()
        for key, field in scenario_keys().items():
            table = key.rpartition(".")[0]
            default = "required" if field.is_required() else f"`{_shown(field.default)}`"
            found.setdefault(table, []).append(f"| `{key}` | {_kind(field)} | {default} | {_range(schema, key)} |")
        text = []
        for table, rows in found.items():
            text += [f"## {f'`[{table}]`' if table else 'Top level'}", ""]
            text += ["| key | type | default | range |", "|---|---|---|---|", *rows, ""]
        return text


def _shown(value: Any) -> str:
    return str(value).lower() if value is None or isinstance(value, bool) else str(value)


def _kind(field: Any) -> str:
    choices = [one for one in (field.annotation, *get_args(field.annotation)) if get_args(one)]
    words = [f"`{word}`" for one in choices for word in get_args(one) if isinstance(word, str)]
    if words:
        return ", ".join(dict.fromkeys(words))
    kinds = [one for one in get_args(field.annotation) if one is not NoneType]
    kind = field.annotation if get_origin(field.annotation) in (list, tuple) or not kinds else kinds[0]
    text = re.sub(r"typing\.|<class '|'>", "", str(kind))
    if text.startswith(("list", "tuple", "Annotated[list", "Annotated[tuple")):
        return "list of numbers" if "float" in text else "list of whole numbers" if "int" in text else "list"
    names = {"float": "number", "int": "whole number", "str": "text", "bool": "true or false"}
    return names.get(re.split(r"[\[,]", text.removeprefix("Annotated["))[0], "value")


def _range(schema: dict[str, Any], key: str) -> str:
    here = schema
    for part in key.split("."):
        reference = here.get("$ref") or next((one["$ref"] for one in here.get("anyOf", []) if "$ref" in one), None)
        if reference:
            here = schema["$defs"][reference.rsplit("/", 1)[-1]]
        here = here["properties"][part]
    signs = {"minimum": ">=", "exclusiveMinimum": ">", "maximum": "<=", "exclusiveMaximum": "<"}
    found = [f"{sign} {limits[name]:g}" for limits in _schemas(here) for name, sign in signs.items() if name in limits]
    return ", ".join(dict.fromkeys(found))


def _schemas(schema: Any) -> Iterator[dict[str, Any]]:
    if isinstance(schema, dict):
        yield schema
        for value in schema.values():
            yield from _schemas(value)
    elif isinstance(schema, list):
        for value in schema:
            yield from _schemas(value)


class CommandLine(_Written):
    """Usage and options of every command, from the program itself."""

    def lines(self) -> list[str]:
        """A heading, the help and a table of options for each command."""
        import typer

        from bumpstop.cli.main import app

        text = []
        for words, command in _commands(typer.main.get_command(app)):
            context = typer.Context(command, info_name=f"bumpstop {words}", terminal_width=200, max_content_width=200)
            text += [f"## `bumpstop {words}`", "", _options_as_code(command.help or ""), ""]
            text += ["```text", command.get_usage(context).removeprefix("Usage: "), "```", ""]
            options = [p for p in command.params if p.param_type_name == "option" and p.name != "help"]
            if options:
                text += ["| option | default | what it does |", "|---|---|---|"]
            for option in options:
                names = ", ".join(f"`{name}`" for name in option.opts)
                plain = option.default in (None, False, []) or callable(option.default)
                help_text = _options_as_code(option.help or "").replace("|", "\\|")
                text.append(f"| {names} | {'' if plain else f'`{option.default}`'} | {help_text} |")
            text.append("")
        return text


def _options_as_code(text: str) -> str:
    """Text with its options marked: two hyphens of prose become a dash."""
    return re.sub(r"(?<![\w`-])(--[a-z][\w-]*)", r"`\1`", text)


def _commands(group: Any, above: str = "") -> Iterator[tuple[str, Any]]:
    for name, command in group.commands.items():
        words = f"{above} {name}".strip()
        if hasattr(command, "commands"):
            if command.invoke_without_command:
                yield words, command
            yield from _commands(command, words)
        else:
            yield words, command


class PublicNames(_Written):
    """The public names of :mod:`bumpstop`, room by room, with their documentation."""

    def lines(self) -> list[str]:
        """A table and an entry for each name; the text is reStructuredText, for autodoc."""
        text = []
        for module, names in bs._HOME.items():
            listed = [name for name in names if name in bs.__all__]
            text += [f"## `{module}`", "", "```{eval-rst}", ".. currentmodule:: bumpstop", "", ".. autosummary::", ""]
            text += [f"   {name}" for name in listed] + [""]
            for name in listed:
                kind = "class" if isinstance(getattr(bs, name), type) else "function"
                if kind == "class" and issubclass(getattr(bs, name), BaseException):
                    kind = "exception"
                text += [f".. auto{kind}:: bumpstop.{name}", *(["   :members:"] if kind == "class" else []), ""]
            text += ["```", ""]
        return text


class Headers(_Written):
    """The structs of the C++ library, from their comments; one sentence where Doxygen is not installed."""

    def lines(self) -> list[str]:
        """An entry for each struct."""
        if not shutil.which("doxygen"):
            return [
                "Doxygen was not installed where this site was built: the comments of the headers are not shown here."
            ]
        text = ["```{eval-rst}"]
        for name in CPP_NAMES:
            kind = "class" if name == "Detector" else "struct"
            text += [f".. doxygen{kind}:: bumpstop::{name}", "   :members:", "   :undoc-members:", ""]
        return [*text, "```"]


def run_doxygen(app: Any) -> None:
    """Read the headers, before breathe asks for them."""
    if not shutil.which("doxygen"):
        return
    out = ROOT / "build" / "doxygen"
    out.mkdir(parents=True, exist_ok=True)
    settings = {
        "PROJECT_NAME": "bumpstop",
        "INPUT": ROOT / "include",
        # The namespace inside is named after the instruction set that is compiled for: users do not write it.
        "INPUT_FILTER": '"sed s/::inline.BUMPSTOP_TARGET//"',
        "STRIP_FROM_PATH": ROOT / "include",
        "FILE_PATTERNS": "*.hpp",
        "RECURSIVE": "YES",
        "OUTPUT_DIRECTORY": out,
        "GENERATE_XML": "YES",
        "GENERATE_HTML": "NO",
        "GENERATE_LATEX": "NO",
        "QUIET": "YES",
        "WARNINGS": "NO",
        "EXTRACT_ALL": "YES",
        "JAVADOC_AUTOBRIEF": "YES",
        "AUTOLINK_SUPPORT": "NO",
        "MACRO_EXPANSION": "YES",
        "EXPAND_ONLY_PREDEF": "YES",
    }
    text = "\n".join(f"{name} = {value}" for name, value in settings.items())
    subprocess.run(["doxygen", "-"], input=text, text=True, check=True, capture_output=True)


def unlink_what_is_outside(app: Any, page: str, source: list[str]) -> None:
    """Keep the words of links to files of the repository that are no pages of the site."""
    folder = (Path(app.srcdir) / page).parent

    def words(link: re.Match[str]) -> str:
        path = link[2].partition("#")[0]
        if not path or ":" in path or (folder / path).resolve().is_relative_to(Path(app.srcdir).resolve()):
            return link[0]
        return link[1]

    source[0] = re.sub(r"\[([^\]]+)\]\(([^)\s]+)\)", words, source[0])


def keep_bars(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Escape the bars of absolute values in docstrings: Sphinx would take what is between them for a substitution."""
    for number, line in enumerate(lines):
        parts = line.split("``")
        lines[number] = "``".join(part if k % 2 else part.replace("|", r"\|") for k, part in enumerate(parts))


def name_one_by_one(app: Any, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Give names that share an entry a field each: Sphinx takes all but the last of them for a type."""
    found: list[str] = []
    entry: list[str] = []
    for line in [*lines, ""]:
        if entry and line.startswith("   "):
            entry.append(line)
            continue
        if entry:
            kind, names, text = re.fullmatch(_SEVERAL, entry[0]).groups()  # type: ignore[union-attr]
            found += [one for each in names.split(", ") for one in (f":{kind} {each}:{text}", *entry[1:])]
        entry = [line] if re.fullmatch(_SEVERAL, line) else []
        found += [] if entry else [line]
    lines[:] = found[:-1]


def setup(app: Any) -> dict[str, bool]:
    """Register the directives."""
    app.add_directive("scenario-keys", ScenarioKeys)
    app.add_directive("command-line", CommandLine)
    app.add_directive("public-names", PublicNames)
    app.add_directive("headers", Headers)
    app.connect("builder-inited", run_doxygen, priority=100)
    app.connect("autodoc-process-docstring", keep_bars)
    app.connect("autodoc-process-docstring", name_one_by_one)
    app.connect("source-read", unlink_what_is_outside)
    app.add_lexer("csv", TextLexer)
    return {"parallel_read_safe": False}
