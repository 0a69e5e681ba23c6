"""What the rows of a workspace study say together."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop.collision.probability_text import decimal, percent
from bumpstop.collision.verdict.verdict_notes import MAX_UNTOUCHED
from bumpstop.study.workspace.predictors import predictors, rank_correlation
from bumpstop.terminal import correlation

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import polars as pl

    from bumpstop.arrays import FloatArray

ENDS = ("motion_end", "joint_limit", "singularity", "all_detected", "singular_start")
# Motions that press anything no more often than this never touch anything.
_NEVER = 1e-6
# Of the frequency maps: cells of condition number or singular value, by cells of force.
MAP_CELLS = 12


def summarise(
    rows: pl.DataFrame,
    edges: FloatArray,
    force_limits: Sequence[float],
    accepted_probability: float,
    *,
    predicted: bool,
) -> dict[str, Any]:
    """Shares over the limits, the force distribution, how motions end, and what no distribution covers.

    Poses that start at a singularity have no distribution and are counted apart; every share is of the others.

    Args:
        rows: of the study.
        edges: of the bins of the force, from 0 (bins + 1,) [N].
        force_limits: force, and pressure as a force [N]; empty: no limits.
        accepted_probability: of exceeding a limit.
        predicted: the rows have predicted peak forces.
    """
    known = rows.filter(rows["end"] != "singular_start")
    limits = dict(zip(("force_N", "pressure_as_force_N"), force_limits, strict=False))
    result: dict[str, Any] = {
        "laws": known.height,
        "singular_starts": rows.height - known.height,
        "limits": limits,
        "ends": {end: int((rows["end"] == end).sum()) for end in ENDS},
    }
    if not known.height:
        return result
    over = {name: _share(known[f"p_over_{name}"].to_numpy()) for name in ("force", "pressure")}
    median = known["p50_N"].to_numpy()
    tails = known["p_over_edges"].explode().to_numpy().reshape(known.height, edges.size)
    # The last bin takes what lies beyond, undetected cases among it.
    mixture = -np.diff(np.column_stack([np.ones(known.height), tails[:, 1:], np.zeros(known.height)]), axis=1)
    # Neither no contact nor weak: no_contact counts bodies that the arm reaches while it brakes, with their force.
    touch = tails[:, 0]
    mixture[:, 0] = np.maximum(0.0, touch - tails[:, 1])
    hits = mostly_hit(known)
    touching = known.filter(touch > _NEVER)
    unsafe = worst_risk(known) > accepted_probability
    if predicted and limits:
        result["predictors"] = predictors(known, unsafe, min(force_limits))
        result["trusted"] = int(known["trusted"].sum())
    return result | {
        "p_over_force": over["force"],
        "p_over_pressure": over["pressure"],
        "p_over_force_or_no_contact": _share(known["p_over_force"].to_numpy() + 1 - touch),
        "never_touch": known.height - touching.height,
        "p_over_force_of_touching": _share(touching["p_over_force"].to_numpy()) if touching.height else None,
        "p_over_pressure_of_touching": _share(touching["p_over_pressure"].to_numpy()) if touching.height else None,
        "accepted_risk": accepted_probability,
        "poses_over_risk": int(unsafe.sum()) if limits else None,
        "undetected": _share(known["undetected"].to_numpy()),
        "poses_more_often_undetected": int((known["undetected"] > 0.5).sum()),
        "nothing_hit": _share(1 - touch),
        "no_contact": _share(known["no_contact"].to_numpy()),
        "false_alarm": _share(known["false_alarm"].to_numpy()),
        "median_force_N": {
            "median": float(np.median(median)),
            "unbounded": int((~np.isfinite(median)).sum()),
        },
        "distribution": {
            "edges_N": edges,
            "poses_by_median": np.histogram(np.minimum(median[hits], 1e300), bins=[*edges, np.inf])[0],
            "collisions": mixture.sum(axis=0),
            "mode_of_medians_N": _mode(np.histogram(np.minimum(median[hits], 1e300), bins=edges)[0], edges),
            "mode_of_collisions_N": _mode(mixture.sum(axis=0)[:-1], edges),
        },
        "rank_correlation_with_median_force": {
            name: rank_correlation(known[name].to_numpy(), median)
            for name in (
                "condition_number",
                "smallest_singular_value",
                "condition_number_six_rows",
                "smallest_singular_value_six_rows",
            )
        },
    }


def summary_lines(summary: Mapping[str, Any]) -> list[str]:
    """What ``bumpstop study workspace`` prints."""
    lines = [
        f"{summary['laws']} distributions; {summary['singular_starts']} poses start at a singularity and have none"
    ]
    if not summary["laws"]:
        return lines
    if summary["never_touch"]:
        of = summary["laws"]
        lines.append(f"{summary['never_touch']} of {of} motions never touch anything: they say nothing about safety")
    for name, limit in zip(("force", "pressure"), summary["limits"].values(), strict=False):
        share = summary[f"p_over_{name}"]
        lines.append(
            f"P(over the {name} limit, {limit:g} N): {decimal(share['mean'])}, "
            f"standard error {decimal(share['standard_error'])}"
        )
        touching = summary[f"p_over_{name}_of_touching"]
        if summary["never_touch"] and touching:
            lines.append(f"  of the motions that touch: {decimal(touching['mean'])}")
    for name, found in summary.get("predictors", {}).items():
        missed, refused = percent(found["unsafe_missed"]), percent(found["safe_refused"])
        rank = f"rank correlation {correlation(found['rank_correlation'])}"
        lines.append(f"{name.replace('_', ' ')}: {rank}, misses {missed} of unsafe poses, rejects {refused} of safe")
    found = summary["distribution"]
    lines.append(f"most common peak force: {mode_text(found['mode_of_collisions_N'], found['edges_N'])}")
    ends = ", ".join(f"{end.replace('_', ' ')} {count}" for end, count in summary["ends"].items() if count)
    lines.append(f"undetected: {decimal(summary['undetected']['mean'])}; motions end by: {ends}")
    if summary["self_collisions"]["looked_for"]:
        lines.append(f"poses discarded for self-collision: {summary['self_collisions']['poses_discarded']}")
    return lines


def worst_risk(rows: pl.DataFrame) -> FloatArray:
    """The larger of the probabilities of passing the force and the pressure limit (N,); NaN without limits."""
    return np.asarray(np.fmax(rows["p_over_force"].to_numpy(), rows["p_over_pressure"].to_numpy()))


def mostly_hit(rows: pl.DataFrame) -> npt.NDArray[np.bool_]:
    """Whether most cases hit something (N,): else a low risk says nothing about safety."""
    return np.asarray(rows["p_over_edges"].list.first().to_numpy() >= 1 - MAX_UNTOUCHED)


def _share(p: FloatArray) -> dict[str, float] | None:
    """Mean of probabilities over poses, and its standard error from their spread; None where there are none."""
    if np.isnan(p).any():
        return None
    return {"mean": float(p.mean()), "standard_error": float(p.std() / np.sqrt(p.size))}


def _mode(counts: FloatArray, edges: FloatArray) -> list[float] | None:
    """Ends of the fullest bin; None where all are empty."""
    if not counts.sum() > _NEVER:
        return None
    at = int(np.argmax(counts))
    return [float(edges[at]), float(edges[at + 1])]


def mode_text(mode: Sequence[float] | None, edges: Sequence[float]) -> str:
    """The most common force as it is printed."""
    return f"none up to {edges[-1]:g} N" if mode is None else f"{mode[0]:g} to {mode[1]:g} N"
