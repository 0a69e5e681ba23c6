"""How well a model predicts, joint by joint, as ``identify`` and ``validate`` print it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification import JointScore


def print_scores(title: str, joints: Sequence[str], scores: Sequence[JointScore | None]) -> None:
    """Print a title, a row for each joint, and which joints rest.

    Errors of a joint that have another unit than most, as currents among torques, have it beside them.

    Args:
        title: what was compared where.
        joints: their names.
        scores: of each; None: its gain is unknown.
    """
    from bumpstop.identification.comparison import mean_told, rest_words
    from bumpstop.model.units import one_unit
    from bumpstop.terminal import number, share, table, terminal

    told = [score for score in scores if score is not None]
    usual = [score.unit for score in told if not score.free_gain] or [score.unit for score in told]
    rows = []
    for name, score in zip(joints, scores, strict=True):
        if score is None:
            rows.append((name, "unknown gain", *[""] * 4))
            continue
        unit = "" if score.unit in usual else f" {score.unit}"
        shares = (share(x, rests=score.rests) for x in (score.r2, score.r2_raw))
        rows.append((name, *shares, *(f"{number(error)}{unit}" for error in (mean_told(score), score.sd, score.rmse))))
    headings = [f"{what}, {one_unit(usual)}" if usual else what for what in ("mean error", "sd", "rmse")]
    console = terminal()
    console.print(title)
    console.print(table(("joint", "R2", "R2 unfiltered", *headings), rows, left=("joint",)))
    if words := rest_words(told):
        typer.echo(f"note: {words}")
