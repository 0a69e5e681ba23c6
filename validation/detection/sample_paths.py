"""A million sequences of samples in any order, with gaps, repeats and infinities, under the sanitizers."""

from __future__ import annotations

import os
import subprocess
import tempfile
from pathlib import Path

from validation.findings import Findings

TITLE = "No sequence of samples breaks the detector"
ROOT = Path(__file__).resolve().parents[2]
SANITIZERS = ["-fsanitize=address,undefined", "-fno-sanitize-recover=all"]


def compare(findings: Findings, *, quick: bool) -> None:
    """Compile the test program of sample paths with the sanitizers and let it draw the sequences."""
    count = 500 if quick else 1_000_000
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "sample_paths"
        # A few sequences take less time than to optimise the program.
        optimised = "-O0" if quick else "-O1"
        command = [os.environ.get("CXX", "c++"), "-std=c++20", optimised, "-Wno-psabi", *SANITIZERS]
        command += [
            f"-I{ROOT / 'include'}",
            f"-I{ROOT / 'tests'}",
            str(ROOT / "tests/detection/detector/sample_paths.cpp"),
        ]
        subprocess.run([*command, "-o", str(program)], check=True)
        done = subprocess.run([program, str(count)], capture_output=True, text=True, check=False)
    findings.check(
        f"{count} sequences: a finite residual or no data, no crash", done.returncode == 0, done.stderr[-500:]
    )
