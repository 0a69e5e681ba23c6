"""URDF files with things broken in them: read right or refused, never a crash, a hang or a broken tree."""

from __future__ import annotations

import random
import tempfile
import time
import traceback
from pathlib import Path

import numpy as np

from model.urdf_cases import ARM, random_urdf, spoilt, survives
from validation.findings import Findings

TITLE = "Spoilt URDF files"
SEED = 1
# Of one processor, so that a busy machine is no fault. No file of this size has any business taking longer.
MAX_SECONDS = 1.0
# Files other than the small one, one in so many.
RANDOM_EVERY = 10


def compare(findings: Findings, *, quick: bool) -> None:
    """Spoil files, read them, and look at what was read a second time by other means."""
    count = 1_000 if quick else 100_000
    findings.say(
        f"{count} files: a small arm and, one in {RANDOM_EVERY}, a random chain, each with one to four changes. Parts "
        "are lost, doubled and moved, names point elsewhere, numbers and tags become odd ones, and in one file of four "
        "text is cut or junk stuck in. A file that is read is read a second time by lines that share no code with "
        "the reader. It must be a tree, and poses by products of matrices and masses by groups must be the robot's."
    )
    choose, rng = random.Random(SEED), np.random.default_rng(SEED)
    sound, slowest, failures = 0, 0.0, []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for number in range(count):
            source = random_urdf(rng, side_joints=True) if number % RANDOM_EVERY == 0 else ARM
            text = spoilt(source, choose.randrange)
            begin = time.process_time()
            try:
                sound += survives(text, folder)
            except Exception as error:
                traceback.print_exc()
                failures.append(f"file {number}: {type(error).__name__}: {error}")
            slowest = max(slowest, time.process_time() - begin)
            if (number + 1) % 20_000 == 0:
                findings.progress(f"{number + 1} files, {sound} sound, {len(failures)} failures")
    findings.check(
        f"{count} spoilt files are refused, or are sound and read right", not failures, "; ".join(failures[:3])
    )
    findings.check(
        f"No file takes longer than {MAX_SECONDS:g} s", slowest < MAX_SECONDS, f"the slowest {1e3 * slowest:.0f} ms"
    )
    findings.check("Some are still sound, most are not", 0.02 < sound / count < 0.5, f"{sound} of {count} are read")
    findings.figures |= {"files": count, "sound": sound, "slowest_s": slowest}
