"""The packages: what the container copies and runs exists, versions agree, cmake installs below DESTDIR."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import yaml

from docs.pages import ROOT, read

PROJECT = tomllib.loads(read("pyproject.toml"))["project"]


def test_the_container_copies_builds_and_runs_what_exists() -> None:
    lines = read("Dockerfile").replace("\\\n", " ").splitlines()
    copied = [line.split()[1] for line in lines if line.startswith("COPY ") and "--from" not in line]
    assert copied == [".", "examples"]
    assert all((ROOT / path).exists() for path in copied)
    ignored = read(".dockerignore").split()
    assert not {"src", "include", "bindings", "cmake", "examples", "README.md", "LICENSE"} & set(ignored)
    (option,) = re.findall(r"cmake\.define\.(\w+)=all", "\n".join(lines))
    assert f"set({option} " in read("CMakeLists.txt")
    (entry,), (command,) = (
        re.findall(rf"^{word} \[(.*)\]$", "\n".join(lines), re.MULTILINE) for word in ("ENTRYPOINT", "CMD")
    )
    assert entry.strip('"') in PROJECT["scripts"]
    assert (ROOT / command.split(", ")[1].strip('"').removeprefix("/")).exists()
    oldest = PROJECT["requires-python"].removeprefix(">=")
    assert re.findall(r"^FROM python:([\d.]+)-", "\n".join(lines), re.MULTILINE) == [oldest, oldest]


def test_the_citation_is_of_this_version() -> None:
    citation = yaml.safe_load(read("CITATION.cff"))
    assert (str(citation["version"]), citation["license"]) == (PROJECT["version"], PROJECT["license"])


def test_the_docs_extra_holds_what_the_gallery_runs() -> None:
    extras = PROJECT["optional-dependencies"]
    commands = re.findall(r'"([a-z]+) ', read("docs/extensions/made_pictures.py"))
    assert "program" in commands
    for extra in extras.keys() & set(commands):
        assert set(extras[extra]) <= set(extras["docs"]), extra


def test_cmake_installs_below_destdir(tmp_path: Path) -> None:
    beside = Path(sys.executable).with_name("cmake")
    cmake = str(beside) if beside.exists() else shutil.which("cmake")
    if cmake is None:
        pytest.skip("no cmake: the test packages bring one")
    settings = ["-DCMAKE_INSTALL_PREFIX=/usr", "-DCMAKE_INSTALL_LIBDIR=lib/x86_64-linux-gnu"]
    subprocess.run([cmake, "-S", ROOT, "-B", tmp_path / "build", *settings], check=True, capture_output=True)
    away = os.environ | {"DESTDIR": str(tmp_path / "package")}
    subprocess.run([cmake, "--install", tmp_path / "build"], check=True, capture_output=True, env=away)
    usr = tmp_path / "package" / "usr"
    assert (usr / "include/bumpstop/bumpstop.hpp").exists()
    config = usr / "lib/x86_64-linux-gnu/cmake/bumpstop"
    assert {"bumpstop-config.cmake", "bumpstop-config-version.cmake", "bumpstop-targets.cmake"} <= {
        path.name for path in config.iterdir()
    }
    assert not [path for path in config.iterdir() if str(tmp_path) in path.read_text() or str(ROOT) in path.read_text()]
