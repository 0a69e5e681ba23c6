"""Build the packages: an sdist, and from it a wheel for every CPython that is here; install and try each one.

``make wheel`` runs it. What is packed is the last commit, not the work tree. Wheels have the kernels of all instruction
sets of the processor's family and choose among them at run time. An interpreter that is not on this machine is named,
and its wheel is not built; with ``--require-all`` that is a failure.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VERSIONS = ("3.11", "3.12", "3.13")
TRY = ROOT / "tools" / "try_package.py"


def interpreters() -> dict[str, Path]:
    """The CPython of each version that runs and has its headers, by version."""
    found = {}
    for version in VERSIONS:
        beside = sorted(Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")).glob(f"versions/{version}.*"))
        names = [shutil.which(f"python{version}"), *(str(folder / "bin" / f"python{version}") for folder in beside)]
        for name in filter(None, names):
            code = (
                "import pathlib, platform, sys, sysconfig, venv\n"
                "header = pathlib.Path(sysconfig.get_path('include')) / 'Python.h'\n"
                f"wanted = platform.python_implementation() == 'CPython' and sys.version.startswith('{version}.')\n"
                "sys.exit(not (wanted and header.exists()))"
            )
            if subprocess.run([name, "-c", code], capture_output=True, check=False).returncode == 0:
                found[version] = Path(name)
                break
    return found


def run(*command: object, **options: object) -> None:
    """Run a command; where it fails print what it printed, and stop."""
    words = [str(word) for word in command]
    done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, **options)  # type: ignore[call-overload]
    if done.returncode != 0:
        sys.exit(f"{done.stdout[-4000:]}\n{' '.join(words)}: exit status {done.returncode}")


def environment(python: Path, folder: Path) -> Path:
    """A new environment of an interpreter; its python."""
    shutil.rmtree(folder, ignore_errors=True)
    run(python, "-m", "venv", folder)
    run(folder / "bin" / "python", "-m", "pip", "install", "--quiet", "--upgrade", "pip")
    return folder / "bin" / "python"


def build_sdist(python: Path, work: Path, out: Path) -> Path:
    """The sdist of the last commit."""
    source = work / "source"
    shutil.rmtree(source, ignore_errors=True)
    source.mkdir(parents=True)
    run("git", "archive", "--output", work / "source.tar", "HEAD", cwd=ROOT)
    with tarfile.open(work / "source.tar") as archive:
        archive.extractall(source, filter="data")
    tool = environment(python, work / "tool")
    run(tool, "-m", "pip", "install", "--quiet", "build")
    run(tool, "-m", "build", "--sdist", "--outdir", out, source)
    return next(out.glob("bumpstop-*.tar.gz"))


def build_wheel(python: Path, sdist: Path, work: Path, out: Path) -> Path:
    """The wheel of an interpreter, compiled from the sdist with all instruction sets."""
    before = set(out.glob("*.whl"))
    tool = environment(python, work / "tool")
    sets = "--config-settings=cmake.define.BUMPSTOP_INSTRUCTION_SETS=all"
    run(tool, "-m", "pip", "wheel", "--no-deps", "--wheel-dir", out, sets, sdist)
    return (set(out.glob("*.whl")) - before).pop()


def try_wheel(python: Path, wheel: Path, work: Path) -> str:
    """Install a wheel into an empty environment and try it there, away from the sources; what the trial printed."""
    empty = environment(python, work / "empty")
    run(empty, "-m", "pip", "install", "--quiet", wheel)
    elsewhere = work / "elsewhere"
    shutil.rmtree(elsewhere, ignore_errors=True)
    shutil.copytree(ROOT / "examples", elsewhere / "examples")
    done = subprocess.run([empty, "-I", TRY], cwd=elsewhere, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{wheel.name}: the trial failed\n{done.stdout}{done.stderr}")
    return done.stdout.strip()


def main() -> None:
    """Build and try everything that this machine can."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder of the packages")
    parser.add_argument("--require-all", action="store_true", help="fail where an interpreter is missing")
    chosen = parser.parse_args()
    out, work, here = chosen.out.resolve(), ROOT / "build" / "packages", interpreters()
    missing = [version for version in VERSIONS if version not in here]
    for version in missing:
        print(f"CPython {version} with headers is not on this machine: no wheel for it", flush=True)
    if not here or (missing and chosen.require_all):
        sys.exit(f"wanted CPython {', '.join(missing)}")
    out.mkdir(parents=True, exist_ok=True)
    for old in out.glob("bumpstop-*"):
        old.unlink()
    sdist = build_sdist(next(iter(here.values())), work, out)
    print(f"sdist: {sdist.name}, {sdist.stat().st_size / 1e6:.1f} MB", flush=True)
    for version, python in here.items():
        print(f"CPython {version}: compiling the kernels of all instruction sets, some minutes", flush=True)
        begin = time.monotonic()
        wheel = build_wheel(python, sdist, work / version, out)
        print(f"  {wheel.name}, {wheel.stat().st_size / 1e6:.1f} MB, {time.monotonic() - begin:.0f} s", flush=True)
        print("  " + try_wheel(python, wheel, work / version).replace("\n", "\n  "), flush=True)


if __name__ == "__main__":
    main()
