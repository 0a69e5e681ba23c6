"""What the rows of a campaign say together, gathered volume by volume."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision.probability_text import percent
from bumpstop.terminal import NONE

if TYPE_CHECKING:
    import polars as pl

NAMES = ("robot", "tool", "body", "detector", "arm")
_MEANS = ("p_over_force", "p_over_pressure", "undetected", "false_alarm", "no_contact")
_MAX_LINES = 40


def summarise(
    volumes: Iterable[pl.DataFrame], setups: Sequence[Sequence[str]], speeds_mm_s: Sequence[float]
) -> dict[str, Any]:
    """Counts and mean probabilities of each setup at each speed.

    Poses that start at a singularity have no distribution and are counted apart; every mean is of the others. Sums run
    over the rows in order, so that they are the same however the rows were computed.

    Args:
        volumes: the rows, in order, some shards at a time.
        setups: names of the choices of each setup, by :data:`NAMES`.
        speeds_mm_s: of the campaign.
    """
    groups = len(setups) * len(speeds_mm_s)
    count, singular, acceptable, judged = (np.zeros(groups, dtype=np.int64) for _ in range(4))
    sums = {name: np.zeros(groups) for name in _MEANS}
    worst, unbounded = np.full(groups, -np.inf), np.zeros(groups, dtype=np.int64)
    for rows in volumes:
        speed = np.searchsorted(speeds_mm_s, rows["speed_mm_s"].to_numpy())
        group = rows["setup"].to_numpy().astype(np.int64) * len(speeds_mm_s) + speed
        known = rows["end"].to_numpy() != "singular_start"
        count += np.bincount(group[known], minlength=groups)
        singular += np.bincount(group[~known], minlength=groups)
        # Where nothing is hit in most cases there are limits but no verdict: not acceptable, either.
        limited = known & rows["p_over_force"].is_finite().fill_null(value=False).to_numpy()
        judged += np.bincount(group[limited], minlength=groups)
        good = limited & rows["acceptable"].fill_null(value=False).to_numpy()
        acceptable += np.bincount(group[good], minlength=groups)
        for name, total in sums.items():
            # One row after the other, on top of what was there: volumes leave no trace in the sums.
            np.add.at(total, group[known], rows[name].to_numpy()[known])
        p99 = rows["p99_N"].to_numpy()
        np.maximum.at(worst, group[known], p99[known])
        unbounded += np.bincount(group[known & np.isposinf(p99)], minlength=groups)
    found = []
    for number, names in enumerate(setups):
        for i, speed_mm_s in enumerate(speeds_mm_s):
            g = number * len(speeds_mm_s) + i
            n = int(count[g])
            means = {name: float(total[g] / n) if n else None for name, total in sums.items()}
            share = float(acceptable[g] / judged[g]) if judged[g] else None
            found.append(
                dict[str, Any](zip(NAMES, names, strict=True))
                | {"speed_mm_s": speed_mm_s, "distributions": n, "singular_starts": int(singular[g])}
                | {"acceptable_share": share, **means, "largest_p99_N": float(worst[g]) if n else None}
                | {"unbounded_p99": int(unbounded[g])}
            )
    return {
        "distributions": int(count.sum()),
        "singular_starts": int(singular.sum()),
        "acceptable_share": float(acceptable.sum() / judged.sum()) if judged.any() else None,
        "groups": found,
    }


def summary_lines(summary: Mapping[str, Any]) -> list[str]:
    """What ``bumpstop campaign`` prints of a result."""
    lines = [
        f"{summary['distributions']} distributions; {summary['singular_starts']} poses start at a singularity and "
        "have none"
    ]
    groups = summary["groups"]
    different = [name for name in NAMES if len({group[name] for group in groups}) > 1]
    for group in groups[:_MAX_LINES]:
        what = " ".join(str(group[name]) for name in different)
        share, force = group["acceptable_share"], group["p_over_force"]
        said = NONE if share is None else f"{percent(share)} acceptable"
        over = NONE if force is None or force != force else f"{force:.3g}"
        lines.append(f"  {what} {group['speed_mm_s']:g} mm/s: {said}, mean P(over force) {over}".replace("   ", "  "))
    if len(groups) > _MAX_LINES:
        lines.append(f"  and {len(groups) - _MAX_LINES} more in summary.json")
    return lines
