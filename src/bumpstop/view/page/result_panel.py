"""The panel of the result: the verdict, always in sight, the figures and the plots."""

from __future__ import annotations

import math
import threading
import time
import zlib
from typing import TYPE_CHECKING

from bumpstop.collision.probability_text import percent
from bumpstop.report.colours import EVENT, FAINT, INK, LIMIT
from bumpstop.report.markup import Html, element
from bumpstop.terminal import number
from bumpstop.view.document import scenario_text
from bumpstop.view.page.late_notice import LateNotice
from bumpstop.view.plots.distribution import distribution_plot, exceedance_plot
from bumpstop.view.plots.force_over_time import force_over_time_plot
from bumpstop.view.plots.risk import body_parts_plot, risk_plot, tornado_plot

if TYPE_CHECKING:
    from collections.abc import Callable

    import viser

    from bumpstop.view.answer import Answer, Tone

# Colour, sign and word say the same: one of them is enough to read the verdict.
_LOOKS = {"good": (EVENT, "✔"), "bad": (LIMIT, "✖"), "open": (FAINT, "?")}
_FONT = f"font:12px/1.35 system-ui, sans-serif;color:{INK}"
# The page puts every piece of HTML into a box of its own: it is that box which must stay where it is.
_STICKY = Html("<style>div:has(> div > [data-verdict]){position:sticky;top:0;z-index:5}</style>")
# A verdict that is not of what the controls show is pale.
_LATE = "The last change is being computed: what stands here is of the scenario before."
_PALE = Html("<style>#root [data-serial]{opacity:0.45}</style>")
# So are plots of another scenario than the verdict, if their own do not follow soon.
_PALE_PLOTS = "<style>[data-plots]:not([data-plots='{mark}']){{opacity:0.45}}</style>"
PANEL_WIDTH = 420  # of a browser's pixels
# A browser shows the first result before it is sent the controls and the picture, which keep it busy for seconds.
_FIRST_S = 0.3
# A layer of its own: without a graphics card a browser draws all of a layer anew for a line of it.
_LAYER = "will-change:transform"
_SHOWN = (("mean", "mean"), ("sd", "sd"), ("p50", "p50"), ("p95", "p95"), ("p99", "p99"), ("p999", "p99.9"))


def verdict_box(answer: Answer, *, serial: int, before: Answer | None = None) -> Html:
    """The verdict as a word with its sign and colour, and as a sentence with its probability.

    Args:
        answer: of the scenario on screen.
        serial: number of the answer, by which tests see that it is drawn.
        before: an answer kept for comparison.
    """
    rows = [element("div", answer.sentence, style="padding:4px 8px", data_sentence="")]
    if before is not None:
        was, now = (each.result.peak_force.quantile(0.99) for each in (before, answer))
        text = f"Kept for comparison: {before.word}, p99 {number(was)} N; now {number(now)} N."
        rows.append(element("div", text, style=f"padding:2px 8px;color:{FAINT}", data_before=""))
    # A verdict is never better by what is not known yet: until the warnings are computed, it says so.
    warnings = answer.result.warnings if answer.checked else ["Warnings are being computed."]
    look = f"padding:2px 8px;color:{LIMIT if answer.checked and warnings else FAINT}"
    # A line in any case: nothing below moves when it is known that there are none.
    rows += [element("div", f"⚠ {text}", style=look) for text in warnings] or [
        element("div", "No warnings.", style=look)
    ]
    return _box(answer.tone, answer.word, answer.conclusion, rows, serial)


def _mark(answer: Answer) -> str:
    """By which what belongs to the same scenario is told."""
    return f"{zlib.crc32(scenario_text(answer.scenario).encode()):08x}"


def no_verdict_box(reason: str, *, serial: int) -> Html:
    """The same of a scenario that has no result, and why.

    Args:
        reason: as the command gives it.
        serial: as of :func:`verdict_box`.
    """
    rows = [element("div", reason, style="padding:4px 8px;overflow-wrap:anywhere", data_sentence="")]
    return _box("open", "NO VERDICT", "refused", rows, serial)


def _box(tone: Tone, word: str, conclusion: str, rows: list[Html], serial: int) -> Html:
    colour, sign = _LOOKS[tone]
    head = element(
        "div",
        f"{sign} {word}",
        style=f"background:{colour};color:white;font-weight:700;padding:3px 8px;font-size:15px",
        data_verdict=conclusion,
    )
    look = f"{_FONT};background:white;border:2px solid {colour};margin:0 6px"
    return element("div", _STICKY, head, *rows, style=look, data_serial=str(serial))


def figures_table(answer: Answer) -> Html:
    """The figures, each marked with its key of ``bumpstop evaluate --json``."""
    columns = [name for name, _ in _SHOWN]
    head = element("tr", element("th", ""), *(element("th", label) for _, label in _SHOWN), element("th", "P(over)"))
    rows = []
    for label, key, over in (
        ("force, N", "peak_force_N", "p_over_force"),
        ("pressure, N/cm²", "pressure_N_cm2", "p_over_pressure"),
    ):
        cells = [_figure(answer, f"{key}.{column}") for column in columns]
        rows.append(element("tr", element("th", label), *cells, _figure(answer, f"verdict.{over}", share=True)))
    line = element(
        "div",
        "never detected ",
        _figure(answer, "undetected_probability", share=True, tag="span"),
        ", false alarm before contact ",
        _figure(answer, "false_alarm_probability", share=True, tag="span"),
        ", no contact ",
        _figure(answer, "no_contact_probability", share=True, tag="span"),
        style="padding:2px 2px",
    )
    table = element("table", head, *rows, style="width:100%;font-size:11px;text-align:right;border-spacing:2px 0")
    return element("div", table, line, style=f"font-size:11px;color:{INK}")


def figures_and_distribution(answer: Answer, before: Answer | None = None) -> Html:
    """What changes with every answer besides the verdict.

    Args:
        answer: of the scenario on screen.
        before: an answer kept for comparison.
    """
    look = f"{_FONT};background:white;padding:2px 6px 0"
    parts = (figures_table(answer), distribution_plot(answer, before))
    return element("div", *(element("div", part, style=_LAYER) for part in parts), style=look)


def _figure(answer: Answer, key: str, *, share: bool = False, tag: str = "td") -> Html:
    value = answer.figures[key]
    if value is None:
        text = "none"
    else:
        text = percent(value, integrated=answer.result.kind == "exact") if share else number(value)
    exact = "" if value is None or not math.isfinite(value) else repr(float(value))
    return element(tag, text.replace("less than ", "< "), data_figure=key, data_value=exact)


def details_html(answer: Answer, superseded: Callable[[], bool]) -> Html:
    """Plots that need more than one evaluation.

    Args:
        answer: of the scenario on screen.
        superseded: asked between two evaluations.

    Raises:
        SupersededError: another scenario is on screen.
    """
    plots = [
        tornado_plot(answer),
        force_over_time_plot(answer),
        risk_plot(answer, superseded),
        body_parts_plot(answer, superseded),
    ]
    return element("div", *plots, data_details=answer.scenario.contact.body or "")


class ResultPanel:
    """The result on a page, in pieces: what a slider moves is sent by itself, and first.

    Args:
        client: whose page it is.
    """

    def __init__(self, client: viser.ClientHandle) -> None:
        self._client = client
        self._lock = threading.Lock()
        # The verdict and what is said beside it, which are sent together.
        self._box, self._said, self._late = Html("computing ..."), Html(""), Html("")
        # Of the verdict; and whether plots that are not of it are pale: a style for each key would cost a frame.
        self._mark, self._pale = "", False
        self._late_plots = LateNotice(self._pale_plots)
        panel = client.gui.add_panel()
        with panel.add_tab("Result"):
            self._verdict = client.gui.add_html(str(self._box))
            self._figures = client.gui.add_html("")
            self._tail = client.gui.add_html("")
            self._further = client.gui.add_html("")
        panel.dock_right()
        panel.set_width(PANEL_WIDTH)

    def show(self, answer: Answer, *, serial: int, before: Answer | None = None) -> None:
        """Show the verdict, the figures and the distribution, and send them at once.

        Args:
            answer: of the scenario on screen.
            serial: number of the answer, by which tests see that it is drawn.
            before: an answer kept for comparison.
        """
        figures = figures_and_distribution(answer, before)
        self._mark = _mark(answer)
        if not answer.checked:
            self._late_plots.begin()
        with self._client.atomic():
            self._beside(box=verdict_box(answer, serial=serial, before=before))
            _fill(self._figures, figures)
        self._client.flush()

    def show_first(self, answer: Answer) -> None:
        """Show the result that a page begins with, before anything else is built."""
        self.show(answer, serial=0)
        time.sleep(_FIRST_S)

    def show_none(self, reason: str, *, serial: int) -> None:
        """Say that there is no result, and why: arguments as of :func:`no_verdict_box`."""
        self._beside(box=no_verdict_box(reason, serial=serial))

    def say(self, text: str, *, refused: bool = False) -> None:
        """Say something below the verdict, in sight with it; an empty text takes that back.

        Args:
            text: of the last change.
            refused: it says why the change is not used.
        """
        sign, colour = ("✖ ", LIMIT) if refused else ("", INK)
        look = f"{_FONT};color:{colour};background:white;margin:0 6px;padding:2px 10px;overflow-wrap:anywhere"
        self._beside(said=element("div", f"{sign}{text}", style=look, data_notice="") if text else Html(""))

    def wait(self, late: bool) -> None:
        """Say below the verdict that it is of the scenario before, in sight with it, or take that back."""
        look = f"{_FONT};font-weight:700;background:white;margin:0 6px;padding:2px 10px"
        self._beside(late=Html(element("div", _LATE, style=look, data_late="") + _PALE) if late else Html(""))

    def _beside(self, *, box: Html | None = None, said: Html | None = None, late: Html | None = None) -> None:
        with self._lock:
            self._box = self._box if box is None else box
            self._said = self._said if said is None else said
            self._late = self._late if late is None else late
            pale = _PALE_PLOTS.format(mark=self._mark) if self._pale else ""
            _fill(self._verdict, Html(f"{self._box}{self._late}{self._said}{pale}"))

    def _pale_plots(self, late: bool) -> None:
        self._pale = late
        self._beside()

    @property
    def alive(self) -> bool:
        """Its thread has not ended yet."""
        return self._late_plots.alive

    def close(self) -> None:
        """Say nothing more of late plots."""
        self._late_plots.close()

    def show_tail(self, answer: Answer) -> None:
        """Show the risk of higher peaks."""
        look = f"padding:0 6px;{_LAYER}"
        _fill(self._tail, element("div", exceedance_plot(answer), style=look, data_plots=_mark(answer)))

    def show_details(self, details: Html, answer: Answer) -> None:
        """Show the plots that need more than one evaluation.

        Args:
            details: as of :func:`details_html`.
            answer: that they are of. The central case of an uncertain one has other risks than its figures as given.
        """
        self.show_tail(answer)
        look = f"{_FONT};padding:0 6px 12px;{_LAYER}"
        _fill(self._further, element("div", details, style=look, data_plots=_mark(answer)))
        self._late_plots.end(more=False)


def _fill(place: viser.GuiHtmlHandle, html: Html) -> None:
    if place.content != html:
        place.content = str(html)
