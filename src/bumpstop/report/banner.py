"""The sign of a verdict: word, colour and shape say the same, so that none is needed to read the others."""

from __future__ import annotations

from typing import Literal

from bumpstop.report.markup import Html, element

Sign = Literal["acceptable", "not-acceptable", "unjudged"]
_SHAPES: dict[Sign, str] = {
    "acceptable": '<circle cx="12" cy="12" r="11"/><path d="M6 12.5l4 4 8-9"/>',
    "not-acceptable": '<path d="M7.5 1h9L23 7.5v9L16.5 23h-9L1 16.5v-9z"/><path d="M7.5 7.5l9 9m0-9l-9 9"/>',
    "unjudged": '<rect x="1" y="1" width="22" height="22"/><path d="M6 12h12"/>',
}


def banner(sign: Sign, word: str, reason: str) -> Html:
    """A verdict in a frame, its reason below it."""
    shape = element("svg", Html(_SHAPES[sign]), viewBox="0 0 24 24", aria_hidden="true")
    return element(
        "div",
        element("p", shape, element("strong", word), class_="word"),
        element("p", reason, class_="reason"),
        class_=f"banner {sign}",
    )
