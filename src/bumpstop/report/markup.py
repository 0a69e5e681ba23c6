"""HTML that cannot be broken by the text inside it."""

from __future__ import annotations

import html
import re
from collections.abc import Iterable, Sequence

_SHORT = 20  # letters


class Html(str):
    """Text that is HTML already. Everything else is escaped when it enters an element."""

    __slots__ = ()


def escape(content: str) -> Html:
    """HTML that shows ``content`` as it stands; HTML passes through."""
    return content if isinstance(content, Html) else Html(html.escape(content))


def element(tag: str, *children: str, **attributes: str | None) -> Html:
    """An element with escaped children and attributes.

    Attributes whose names Python has taken or cannot spell are written ``class_`` and ``aria_label``; None leaves
    one out.
    """
    words = [
        f' {name.rstrip("_").replace("_", "-")}="{html.escape(value)}"'
        for name, value in attributes.items()
        if value is not None
    ]
    return Html(f"<{tag}{''.join(words)}>{''.join(escape(child) for child in children)}</{tag}>")


def paragraph(*children: str) -> Html:
    """A paragraph."""
    return element("p", *children)


def breakable(text: str) -> Html:
    """Text that may go on in the next line behind each slash, dot and underscore: paths, dotted keys; no number."""
    return Html(re.sub(r"([/_\\]|(?<!\d)\.|\.(?!\d))", r"\1<wbr>", escape(text)))


def whole(text: str) -> Html:
    """A short word that is not torn apart; a long text is left as it is."""
    return element("span", text, class_="whole") if len(text) <= _SHORT else escape(text)


def whole_figures(text: str) -> Html:
    """Text of which no figure is torn apart."""
    words = text.split(" ")
    figures = [len(word) <= _SHORT and any(letter.isdigit() for letter in word) for word in words]
    return Html(
        " ".join(whole(word) if figure else breakable(word) for word, figure in zip(words, figures, strict=True))
    )


def bullets(items: Iterable[str]) -> Html:
    """A list whose order carries no meaning."""
    return element("ul", *(element("li", item) for item in items))


def table(headings: Sequence[str], rows: Iterable[Sequence[str]], *, caption: str, numbers: bool = False) -> Html:
    """A table whose first column names the rows.

    Args:
        headings: one per column; where all are empty the table has no head.
        rows: cells, one per column.
        caption: what the table holds.
        numbers: align all but the first column to the right.
    """
    head = element("tr", *(element("th", text, scope="col") for text in headings))
    body = [
        element("tr", element("th", row[0], scope="row"), *(element("td", cell) for cell in row[1:])) for row in rows
    ]
    inner = element(
        "table",
        element("caption", caption),
        element("thead", head) if any(headings) else "",
        element("tbody", *body),
        class_="numbers" if numbers else None,
    )
    # On a phone a wide table scrolls in its box, reachable by keyboard too, and the page stays put.
    return element("div", inner, class_="wide", tabindex="0", role="region", aria_label=caption)
