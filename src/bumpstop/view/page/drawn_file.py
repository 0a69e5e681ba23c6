"""Pictures and reports for a person to save, each drawn in a process of its own.

What draws them has as much memory as all of the server. It is never given back, and most pages need it once.
"""

from __future__ import annotations

import tempfile
from concurrent.futures.process import BrokenProcessPool, ProcessPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.errors import InputError
from bumpstop.shards.workers import ctrl_c_blocked
from bumpstop.view.answer import Answer

if TYPE_CHECKING:
    from bumpstop.collision import Scenario


def drawn_file(what: str, scenario: Scenario, answer: Answer) -> bytes:
    """The content of a file of what is on screen.

    Args:
        what: ``"Picture"``, a PNG, or ``"Report"``, an HTML page.
        scenario: on screen.
        answer: of the scenario. It has memory of the kernels and stays here: the process computes the same anew.

    Raises:
        InputError: it cannot be drawn.
    """
    import multiprocessing

    try:
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            with ctrl_c_blocked():
                drawn = pool.submit(_drawn, what, scenario, answer.pending, answer.refusal)
            return drawn.result()
    except BrokenProcessPool:
        raise InputError(what, "its process has died", "is there memory for it?") from None


def _drawn(what: str, scenario: Scenario, pending: bool, refusal: str) -> bytes:
    """What the process does; ``pending`` and ``refusal`` as of :class:`Answer`."""
    if scenario.uncertainty and not (pending or refusal):
        answer = Answer.of_uncertain(scenario, lambda: False)
    else:
        answer = Answer.of(scenario)
        answer = answer.without_verdict(refusal) if refusal else answer
    if what == "Picture":
        from bumpstop.view.recorder import picture

        return picture(answer)
    from bumpstop.report import write_report

    with tempfile.TemporaryDirectory() as folder:
        return write_report(answer.result, Path(folder), uncertain=answer.uncertain).read_bytes()
