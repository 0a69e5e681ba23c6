"""What a file needs to be read, asked before it is."""

from __future__ import annotations

import re
from pathlib import Path

from bumpstop.errors import InputError

# Bytes needed while reading, by byte of the file; Parquet and Excel are compressed.
_NEEDED = {"csv": 3.5, "parquet": 12.0, "ros2bag": 4.0, "mcap": 8.0, "xlsx": 30.0, "mat": 8.0}
_WORTH_SAYING = 1e9


def check_memory(path: Path, kind: str) -> tuple[str, ...]:
    """Refuse a file that needs more memory than is free; a note for one that needs more than 1 GB.

    Raises:
        InputError: it needs more than there is.
    """
    files = [inner for inner in path.iterdir() if inner.is_file()] if path.is_dir() else [path]
    needed = _NEEDED[kind] * sum(file.stat().st_size for file in files)
    free = _free()
    if free is not None and needed > free:
        problem = f"reading needs about {needed / 1e9:.3g} GB of memory, {free / 1e9:.3g} GB are free"
        raise InputError(str(path), problem, "cut it into parts")
    return (f"Reading it takes about {needed / 1e9:.2g} GB of memory.",) if needed > _WORTH_SAYING else ()


def _free() -> float | None:
    """Bytes this machine can still give, or None where it does not say."""
    try:
        text = Path("/proc/meminfo").read_text(encoding="ascii")
    except OSError:
        return None
    found = re.search(r"^MemAvailable: +(\d+) kB", text, re.MULTILINE)
    return None if found is None else 1024.0 * int(found[1])
