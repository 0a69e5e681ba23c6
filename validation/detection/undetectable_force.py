"""The largest undetectable force against a search over directions."""

from __future__ import annotations

import numpy as np

from bumpstop import _native
from detection.direction_search import directions, enumerated, farthest
from detection.sensitivity_cases import random_cases, singular_cases
from validation.findings import Cell, Findings

TITLE = "Largest undetectable force against a search over directions"
ALLOWED = 1e-9
CHUNK = 1000
FEW, MANY = 12, 600  # directions a case is searched from, and where that fell short


def compare(findings: Findings, *, quick: bool) -> None:
    """Random and singular polytopes of three to twelve joints."""
    cases = 2000 if quick else 1_000_000
    findings.say(
        "The farthest vertex of the polytope of undetectable forces, as the library finds it, against a search that "
        f"walks outward on its surface from {FEW} directions, and from {MANY} where that ends nearer. Where that "
        "still ends elsewhere, all points where three faces meet decide, in long double. Revolute and prismatic "
        "joints, thresholds over two decades, shifted by means, every fourth case squeezed to nearly singular. In the "
        "full size one case in ten is singular: rank 1 or 2."
    )
    rows: list[list[Cell]] = []
    worst, total, wrong_rank = 0.0, 0, 0
    for dof in range(3, 13):
        rng = np.random.default_rng(dof)
        far, again, all_corners, count = 0.0, 0, 0, 0
        while count < cases // 10:
            rank = 3 if count % (10 * CHUNK) or quick else 1 + (count // (10 * CHUNK)) % 2
            size = min(CHUNK, cases // 10 - count)
            error, repeated, listed, wrong = _chunk(rng, dof, size, rank)
            far, again, all_corners = max(far, error), again + repeated, all_corners + listed
            wrong_rank, count = wrong_rank + wrong, count + size
        rows.append([f"{dof} joints", count, far, again, all_corners])
        worst, total = max(worst, far), total + count
        findings.progress(f"{dof} joints: {far:.1e}")
    findings.table(
        "Largest relative difference",
        ["", "cases", "difference", "searched again", "all corners"],
        ["", "d", ".1e", "d", "d"],
        rows,
    )
    findings.check(f"All {total} cases within {ALLOWED:g}", worst < ALLOWED, f"worst {worst:.1e}")
    findings.check("The rank of every case is as made", wrong_rank == 0, f"{wrong_rank} differ")


def _chunk(rng: np.random.Generator, dof: int, size: int, rank: int) -> tuple[float, int, int, int]:
    """Largest relative difference, cases searched twice, cases settled by all corners, and ranks that are wrong."""
    if rank == 3:
        columns, low, high = random_cases(rng, dof, size)
        normals, lower, upper = columns.transpose(0, 2, 1), low, high
    else:
        columns, low, high, walls, lost = singular_cases(rng, dof, size, rank)
        normals = np.concatenate([columns.transpose(0, 2, 1), lost], axis=1)
        lower, upper = np.concatenate([low, -walls], axis=1), np.concatenate([high, walls], axis=1)
    found = [_native.undetectable_forces(columns[i : i + 1], low[i], high[i]) for i in range(size)]
    found_force = np.array([float(one[1][0]) for one in found])
    wrong = sum(int(one[4][0]) != rank for one in found)
    searched = farthest(normals, lower, upper, directions(FEW))
    short = np.flatnonzero(searched < found_force * (1 - ALLOWED / 2))
    if short.size:
        searched[short] = farthest(normals[short], lower[short], upper[short], directions(MANY))
    doubtful = np.flatnonzero(np.abs(found_force / searched - 1) >= ALLOWED)
    for i in doubtful:
        searched[i] = enumerated(normals[i], lower[i], upper[i])
    return float(np.abs(found_force / searched - 1).max()), int(short.size), int(doubtful.size), wrong
