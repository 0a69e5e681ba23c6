"""The C++ programs of the lower rooms, detection and the controller: compiled against the headers alone, and run.

Two builds find what can be wrong: one under the sanitizers, and of programs that use the registers of the kernels one
optimised for these. The first is clang's where it links its sanitizers: the kernels are compiled by another compiler.
"""

from __future__ import annotations

import os
import subprocess
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

import pytest

from bumpstop import _native
from cpp.builds import COMPILER, ROOT, SANITIZERS, WARNINGS, can, compiled

# As the kernels are compiled (CMakeLists.txt), for the widest instruction set that runs here.
FLAGS_OF_TARGET = {
    "avx512": ["-mavx512f", "-mavx512dq", "-mavx512vl", "-mavx2", "-mfma"],
    "avx2": ["-mavx2", "-mfma"],
}
OPTIMISED = ["-O1", "-ffp-contract=off", *FLAGS_OF_TARGET.get(_native.available_targets()[0], [])]

BUILDS = {
    "sanitized": [["clang++-14", "-O0", *SANITIZERS], [*COMPILER, "-O0", *SANITIZERS]],
    "optimised": [[*COMPILER, *OPTIMISED]],
}
IN_LANES = [
    "math/lanes",
    "math/quadrature",
    "model/chain",
    "model/dynamics/dynamics",
    "model/min_norm",
    "signal/causal_derivative",
    "signal/zero_phase",
    "joint/joint_torque_batch",
    "joint/joint_torque",
    "collision/motion/arm_integrator",
    "collision/motion/line_tracer",
    "collision/distribution/linear_quantity",
]
ONE_BY_ONE = [
    "math/threads",
    "detection/detector/detector",
    "detection/detector/sample_paths",
    "detection/detector/sample_validator",
]
CASES = [(ROOT / f"tests/{name}.cpp", build) for name in IN_LANES for build in BUILDS]
CASES += [(ROOT / f"tests/{name}.cpp", "sanitized") for name in ONE_BY_ONE]


Builds = dict[tuple[Path, str], "Future[tuple[Path, subprocess.CompletedProcess[str]]]"]


@pytest.fixture(scope="module")
def builds(tmp_path_factory: pytest.TempPathFactory) -> Builds:
    """Every program for which there is a compiler, compiled side by side."""
    folder = tmp_path_factory.mktemp("programs")
    commands = {
        build: next((command for command in choices if can(command, folder)), None) for build, choices in BUILDS.items()
    }

    def build_of(source: Path, build: str) -> tuple[Path, subprocess.CompletedProcess[str]]:
        program = folder / f"{source.stem}-{build}"
        command = commands[build]
        assert command is not None
        return program, compiled(command, source, program)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return {case: pool.submit(build_of, *case) for case in CASES if commands[case[1]]}


@pytest.mark.parametrize(("source", "build"), CASES, ids=lambda part: getattr(part, "stem", part))
def test_program(source: Path, build: str, builds: Builds) -> None:
    if (source, build) not in builds:
        pytest.skip(f"nothing here builds with {' '.join(BUILDS[build][-1])}")
    program, compilation = builds[source, build].result()
    assert compilation.returncode == 0, f"does not compile:\n{compilation.stderr}"
    run = subprocess.run([program], capture_output=True, text=True, check=False, timeout=120)
    assert run.returncode == 0, f"failed:\n{run.stdout}{run.stderr}"


def test_the_build_and_the_package_ask_alike_what_the_processor_runs(tmp_path: Path) -> None:
    program = tmp_path / "runnable"
    subprocess.run([*COMPILER, *WARNINGS, str(ROOT / "cmake/runnable.cpp"), "-o", str(program)], check=True)
    printed = subprocess.run([program], capture_output=True, text=True, check=True).stdout
    runnable = [name for name in printed.split(";") if name]
    available = _native.available_targets()
    # `make build` leaves out what lies between the widest and the baseline.
    assert (available[0], available[-1]) == (runnable[0], runnable[-1])
    assert available == [name for name in runnable if name in available]


@pytest.mark.parametrize("flag", ["-O2", "-ffast-math", "-ffinite-math-only"])
def test_arithmetic_that_is_not_as_written_is_refused(flag: str, tmp_path: Path) -> None:
    if not can(COMPILER, tmp_path):
        pytest.skip("no C++ compiler")
    source = tmp_path / "program.cpp"
    source.write_text('#include "bumpstop/math/functions.hpp"\nint main() {}\n', encoding="utf-8")
    done = compiled([*COMPILER, flag], source, tmp_path / "program")
    assert ("bumpstop needs arithmetic as written" in done.stderr) == (flag != "-O2")
    assert (done.returncode != 0) == (flag != "-O2")
