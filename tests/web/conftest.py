"""The page's script, compiled once."""

from __future__ import annotations

from pathlib import Path

import pytest
from web.build import compiler, script


@pytest.fixture(scope="session")
def page_script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    if compiler() is None:
        pytest.skip("needs emcc: apt-get install emscripten")
    path = tmp_path_factory.mktemp("web") / "bumpstop.js"
    path.write_text(script(), encoding="utf-8")
    return path
