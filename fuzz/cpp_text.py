"""The readers of text in C++: compiled with checks of undefined behaviour, and called like any other."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shlex
import subprocess
from functools import cache
from pathlib import Path

from bumpstop.errors import InputError
from bumpstop.output_files import replacing

_ROOT = Path(__file__).resolve().parents[1]
_SOURCE = Path(__file__).with_name("detector_text.cpp")
# What undefined behaviour does is left to no chance: it ends the process. So does an index outside of a vector.
_FLAGS = ["-std=c++20", "-O0", "-Wno-psabi", "-shared", "-fPIC", "-fsanitize=undefined,float-cast-overflow"]
_FLAGS += ["-fno-sanitize-recover=all", "-D_GLIBCXX_ASSERTIONS", f"-I{_ROOT / 'include'}"]
_MESSAGE = 4000


def read_text(path: Path) -> None:
    """Read a ``.robot`` or a ``.detector``, and run the detector.

    Raises:
        InputError: with what C++ says of a text that is none.
    """
    content = path.read_bytes()
    message = ctypes.create_string_buffer(_MESSAGE)
    if not _library().read_text(content, len(content), path.suffix == ".detector", message, _MESSAGE):
        raise InputError(str(path), message.value.decode(errors="replace"))


@cache
def _library() -> ctypes.CDLL:
    """Compiled once for each state of the headers, into ``build/``."""
    headers = sorted((_ROOT / "include").rglob("*.hpp"))
    state = hashlib.sha256(b"".join(file.read_bytes() for file in (_SOURCE, *headers))).hexdigest()[:16]
    library = _ROOT / "build" / "fuzz" / f"detector_text-{state}.so"
    if not library.exists():
        library.parent.mkdir(parents=True, exist_ok=True)
        with replacing(library) as waiting:
            compiler = shlex.split(os.environ.get("CXX", "c++"))
            subprocess.run([*compiler, *_FLAGS, str(_SOURCE), "-o", str(waiting)], check=True)
    loaded = ctypes.CDLL(str(library))
    loaded.read_text.argtypes = [ctypes.c_char_p, ctypes.c_size_t, ctypes.c_bool, ctypes.c_char_p, ctypes.c_size_t]
    loaded.read_text.restype = ctypes.c_bool
    return loaded
