"""What the terminal says of a workspace."""

from __future__ import annotations

from bumpstop.study import run
from bumpstop.study.workspace.workspace import WorkspaceStudy
from bumpstop.study.workspace.workspace_summary import summary_lines
from collision.cases import control_group


def test_what_is_only_improbable_is_not_printed_as_never() -> None:
    summary = run(WorkspaceStudy(control_group(), poses=4)).summary
    summary |= {"p_over_force": {"mean": 4e-5, "standard_error": 2e-5}, "undetected": {"mean": 3e-6}}
    ranks = {"unsafe_missed": 4e-4, "safe_refused": 0.9996, "rank_correlation": 0.5}
    text = "\n".join(summary_lines(summary | {"predictors": {"bound": ranks}}))
    assert "): 4.0e-05, standard error 2.0e-05" in text
    assert "undetected: 3.0e-06;" in text
    assert "misses 0.04 % of unsafe poses, rejects 99.96 % of safe" in text
