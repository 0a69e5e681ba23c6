"""What the page says about joint positions that feel better."""

from __future__ import annotations

import polars as pl
import pytest

from bumpstop.report.studies.speed_limits import SuggestionPart

ROWS = pl.DataFrame({"t_s": [0.0, 0.5, 1.0]})


@pytest.mark.parametrize(
    ("gain", "said", "unsaid"),
    [
        ([1.0, 2.5, 1.02], ["At 2 of 3 waypoints", "at waypoint 2: 12 N instead of 30 N"], []),
        ([1.0, 1.004, 1.0], ["At 0 of 3 waypoints"], ["largest gain"]),
    ],
)
def test_the_gain_of_suggestions_is_told(gain: list[float], said: list[str], unsaid: list[str]) -> None:
    part = SuggestionPart(ROWS, pl.DataFrame({"undetectable_N": [10.0, 12.0, 20.0], "gain": gain}))
    text = " ".join(part.content())
    assert all(each in text for each in said)
    assert not any(each in text for each in unsaid)
    drawn = part.pictures()[0].render()
    before, after = drawn.figure.axes[0].lines
    assert before.get_ydata() == pytest.approx([10.0, 12.0 * gain[1], 20.0 * gain[2]])
    assert after.get_ydata() == pytest.approx([10.0, 12.0, 20.0])
