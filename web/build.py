"""Makes the script of the page: the compiled core, what it knows, and the page itself, in one file."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
import tempfile
from pathlib import Path

from web.exports import page_data

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
# In the order in which they stand in the script.
SCRIPTS = ("toml", "words", "scenario", "problem", "verdict", "evaluate", "finer_steps", "picture", "worker", "page")
# Arithmetic as written, as everywhere; the two lanes of a register are WebAssembly's.
_COMPILE = "-std=c++20 -O3 -ffp-contract=off -msimd128 -Wall -Wextra -Werror"
# One file: a page that was opened from the disk may load nothing else.
_LINK = (
    "-O1 --bind -sSINGLE_FILE=1 -sMODULARIZE=1 -sEXPORT_NAME=bumpstopCore -sALLOW_MEMORY_GROWTH=1 "
    "-sENVIRONMENT=web,worker,node -sFILESYSTEM=0 -sDYNAMIC_EXECUTION=0"
)


def compiler() -> str | None:
    """Emscripten's compiler; None where it is not installed."""
    return shutil.which("emcc")


def script() -> str:
    """The text of the page's script; needs :func:`compiler`.

    In a browser it fills the element with the id ``bumpstop``, and computes in a worker that it starts from its own
    text. In node it exports what the tests use.
    """
    data = json.dumps(page_data(), allow_nan=False, ensure_ascii=False, separators=(",", ":"))
    parts = ["(function bumpstop() {", '"use strict";', f"const DATA = {data};"]
    parts += [(HERE / f"{name}.js").read_text(encoding="utf-8") for name in SCRIPTS]
    parts += [compiled_core().read_text(encoding="utf-8"), "beginPage(bumpstopCore, bumpstop);", "})();"]
    return "\n".join(parts) + "\n"


def compiled_core() -> Path:
    """The compiled core with its loader: a file under ``build/``, made anew where a header or a setting has changed."""
    emcc = compiler()
    assert emcc is not None, "emcc is not installed"
    source = HERE / "collision.cpp"
    digest = hashlib.sha256((_COMPILE + _LINK).encode())
    for path in [source, *sorted((ROOT / "include").rglob("*.hpp"))]:
        digest.update(path.read_bytes())
    made = ROOT / "build" / "web" / f"core-{digest.hexdigest()[:16]}.js"
    if made.exists():
        return made
    made.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=made.parent) as folder:
        compiled, linked = Path(folder) / "core.o", Path(folder) / "core.js"
        _run([emcc, *_COMPILE.split(), f"-I{ROOT / 'include'}", "-c", str(source), "-o", str(compiled)])
        _run([emcc, *_LINK.split(), str(compiled), "-o", str(linked)])
        linked.replace(made)
    return made


def _run(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{' '.join(command)}\n{done.stderr}")
