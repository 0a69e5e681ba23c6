"""The two files a validation leaves: a page for people and a file for programs."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from bumpstop.report.markup import Html, element, paragraph, table
from validation.findings import Check, Findings, Table

_STYLE = """
.pass { color: var(--good); font-weight: 600; }
.fail { color: var(--bad); font-weight: 600; }
.checks { list-style: none; padding: 0; max-width: none; }
summary { cursor: pointer; }
"""
# Longer tables are folded.
_LONG = 24


def write(out: Path, sections: Sequence[Findings], made_by: Mapping[str, str], *, not_run: Sequence[str] = ()) -> None:
    """Write ``index.html`` and ``results.json``.

    Args:
        out: folder, made where it is missing.
        sections: what was found.
        made_by: versions, machine and sizes.
        not_run: names of the comparisons still to come; a validation without them has not passed.
    """
    out.mkdir(parents=True, exist_ok=True)
    results = {
        "made_by": dict(made_by),
        "passed": not not_run and all(findings.passed for findings in sections),
        "not_run": list(not_run),
        "comparisons": {findings.name: _record(findings) for findings in sections},
    }
    text = json.dumps(finite(results), indent=1, allow_nan=False)
    (out / "results.json").write_text(text + "\n", encoding="utf-8", newline="\n")
    (out / "index.html").write_text(_page(sections, made_by, not_run), encoding="utf-8", newline="\n")


def finite(value: Any) -> Any:
    """The same with plain numbers, and None for those that are not finite."""
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return finite(value.tolist())
    if isinstance(value, list | tuple):
        return [finite(item) for item in value]
    if isinstance(value, np.generic):
        return finite(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def _record(findings: Findings) -> dict[str, Any]:
    return {
        "title": findings.title,
        "passed": findings.passed,
        "seconds": round(findings.seconds, 1),
        "checks": [{"what": check.what, "passed": check.passed, "detail": check.detail} for check in findings.checks],
        "tables": [
            {"caption": item.caption, "headings": item.headings, "rows": item.rows}
            for item in findings.items
            if isinstance(item, Table)
        ],
        "figures": findings.figures,
    }


def _page(sections: Sequence[Findings], made_by: Mapping[str, str], not_run: Sequence[str]) -> str:
    style = (resources.files("bumpstop.report") / "page.css").read_text(encoding="utf-8")
    checks = [check for findings in sections for check in findings.checks]
    failed = sum(not check.passed for check in checks)
    word = f"{failed} of {len(checks)} checks fail" if failed else f"All {len(checks)} checks pass"
    left = [paragraph(f"Not run yet: {', '.join(not_run)}.")] if not_run else []
    overview = [
        [
            element("a", findings.title, href=f"#{findings.name}"),
            _word(findings.passed),
            f"{sum(check.passed for check in findings.checks)} of {len(findings.checks)}",
            f"{findings.seconds:.0f} s",
        ]
        for findings in sections
    ]
    head = element(
        "head",
        Html('<meta charset="utf-8">'),
        Html('<meta name="viewport" content="width=device-width, initial-scale=1">'),
        element("title", "bumpstop: validation"),
        element("style", Html(style + _STYLE)),
    )
    body = element(
        "body",
        element("header", element("p", "bumpstop validation", class_="kind"), element("h1", word)),
        element(
            "main",
            *left,
            table(["Comparison", "Result", "Checks passed", "Time"], overview, caption="Comparisons"),
            *(_section(findings) for findings in sections),
            element(
                "section",
                element("h2", "Made by"),
                table(["", ""], [list(item) for item in made_by.items()], caption="Versions, machine and sizes"),
            ),
        ),
        element("footer", element("p", "Engineering estimates, not certified safety functions.")),
    )
    return f'<!DOCTYPE html>\n<html lang="en">{head}{body}</html>\n'


def _section(findings: Findings) -> Html:
    parts: list[Html] = [element("h2", findings.title)]
    waiting: list[Html] = []  # checks in a row share one list

    def put(part: Html | None) -> None:
        if waiting:
            parts.append(element("ul", *waiting, class_="checks"))
            waiting.clear()
        if part is not None:
            parts.append(part)

    for item in findings.items:
        if isinstance(item, Check):
            detail = f": {item.detail}" if item.detail else ""
            waiting.append(element("li", _word(item.passed), f" {item.what}{detail}"))
        elif isinstance(item, Table):
            put(_table(item))
        elif isinstance(item, Html):
            put(element("div", item, class_="figures"))
        else:
            put(paragraph(item))
    put(None)
    return element("section", *parts, id=findings.name)


def _table(item: Table) -> Html:
    shown = table(item.headings, item.shown(), caption=item.caption, numbers=True)
    if len(item.rows) <= _LONG:
        return shown
    return element("details", element("summary", f"{item.caption} ({len(item.rows)} rows)"), shown)


def _word(passed: bool) -> Html:
    return element("span", "PASS" if passed else "FAIL", class_="pass" if passed else "fail")
