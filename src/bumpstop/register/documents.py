"""Standards and other documents that a dossier refers to, with how well each reference is known."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib import resources


@dataclass(frozen=True, kw_only=True)
class ReferredDocument:
    """A document.

    Attributes:
        name: with its year.
        about: what it is referred to for.
        clause: empty where none is named.
        status: ``published`` or ``unverified``.
        source: where the reference comes from.
    """

    name: str
    about: str
    clause: str
    status: str
    source: str


def referred_documents() -> tuple[ReferredDocument, ...]:
    """All of them, in the order of the file."""
    text = (resources.files("bumpstop.register") / "data" / "documents.toml").read_text(encoding="utf-8")
    return tuple(ReferredDocument(**row) for row in tomllib.loads(text)["document"])
