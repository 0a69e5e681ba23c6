"""The settings file of a job: its document, what made the folder in ``[made_by]``, and a checksum of all that."""

from __future__ import annotations

import hashlib
import json
import tomllib
from typing import TYPE_CHECKING, Any

from bumpstop.collision.scenario.keys import MADE_BY
from bumpstop.shards.sharded_job import versions
from bumpstop.text_files import encoded, to_toml

if TYPE_CHECKING:
    from bumpstop.shards.sharded_job import ShardedJob

SETTINGS = "settings.toml"
# Last key of [made_by]: of all text before it.
_CHECKSUM = b"checksum = "


def settings_content(job: ShardedJob, fingerprint: str, command: str) -> bytes:
    """The settings file of a job; ``command`` made its folder.

    Raises:
        InputError: the scenario names a file whose name is no text.
    """
    made_by = {"study": job.name, **job.settings(), **versions(), "fingerprint": fingerprint}
    if command:
        made_by["command"] = command
    made_by = {key: _toml_value(value) for key, value in made_by.items() if value is not None}
    # A comment ends with its line, and holds no control characters.
    shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in command)
    what, tables = job.document()
    head = f"# {what}. Made by: {shown}\n" if command else f"# {what}.\n"
    content = encoded(head + to_toml(tables | {MADE_BY: made_by}), "scenario")
    return content + _CHECKSUM + f'"{hashlib.sha256(content).hexdigest()}"\n'.encode()


def read_made_by(settings: bytes) -> dict[str, Any]:
    """What made a folder, as its settings say; empty where they do not say it. Of a job it has a ``fingerprint``."""
    try:
        made_by = tomllib.loads(settings.decode("utf-8")).get(MADE_BY, {})
    except (ValueError, RecursionError):
        return {}
    return made_by if isinstance(made_by, dict) else {}


def differing(made_by: dict[str, Any], job: ShardedJob) -> list[str]:
    """Names of the settings of a job that are others than those that made a folder."""
    fresh = {"study": job.name} | job.settings() | versions()
    return [key for key, value in fresh.items() if made_by.get(key) != _toml_value(value)]


def damage(settings: bytes) -> str:
    """How a settings file is another than was written; empty: it is not."""
    text, last, checksum = settings.rpartition(_CHECKSUM)
    if last and checksum == f'"{hashlib.sha256(text).hexdigest()}"\n'.encode():
        return ""
    return "is not as it was written" if last else "holds no checksum: edited, or of an earlier version"


def _toml_value(value: Any) -> Any:
    """Settings are numbers, texts and lists of them; what has more structure is kept as JSON text."""
    if isinstance(value, dict) or (isinstance(value, list) and any(isinstance(item, dict | list) for item in value)):
        return json.dumps(value)
    return value
