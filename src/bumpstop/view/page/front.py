"""The page as it is sent: with the first result in it, which stands there until the page of viser is up."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.report.markup import Html, element, escape
from bumpstop.view.page.result_panel import PANEL_WIDTH, figures_and_distribution, verdict_box

if TYPE_CHECKING:
    from bumpstop.view.answer import Answer

# Before the page of viser: it unpacks and compiles three megabytes of script, which keep a browser busy for seconds.
_BEFORE = b"<script data-p="
# Points of a picture that is followed by another within this time, where the processor draws.
MAX_MOVING_POINTS, _REST_MS = 6000, 400
# Without a graphics card smooth edges cost half the time of a picture. viser has no setting for that.
_EDGES = """
const open = HTMLCanvasElement.prototype.getContext;
let slow;
const isSlow = () => {
  const gl = open.call(document.createElement("canvas"), "webgl2");
  const names = gl?.getExtension("WEBGL_debug_renderer_info");
  const name = names ? gl.getParameter(names.UNMASKED_RENDERER_WEBGL) : "";
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software|basic render/i.test(name);
};
HTMLCanvasElement.prototype.getContext = function (kind, options) {
  if (!String(kind).startsWith("webgl")) return open.call(this, kind, options);
  slow ??= isSlow();
  return open.call(this, kind, slow ? { ...options, antialias: false } : options);
};
"""
# Nor has it one for this: without a graphics card points cost most of a picture. As long as one picture follows another
# it has the first of them, which are drawn at random; viser draws one a second later, and that has all of them again.
_POINTS = f"""
let moving = false, last = -Infinity;
const draw = WebGL2RenderingContext.prototype.drawArrays;
WebGL2RenderingContext.prototype.drawArrays = function (mode, first, count) {{
  const now = document.timeline.currentTime;
  if (now !== last) [moving, last] = [now - last < {_REST_MS}, now];
  const few = moving && slow && mode === this.POINTS;
  return draw.call(this, mode, first, few ? Math.min(count, {MAX_MOVING_POINTS}) : count);
}};
"""
# In a window so narrow that viser has one panel below the other, the result is folded up at the end of them: its
# verdict stands at the top of the window all the same.
_NARROW = (
    "@media(max-width:36em){[inert]:has([data-verdict]){display:block!important;opacity:1!important}"
    "div:has(>div>[data-verdict]){position:fixed!important;top:0;left:0;right:0}}"
)
# A slider that moves and its number are drawn by themselves, and not with all of their panel. One without a label has
# its number in the field above it, and stands close below that.
_UNLABELLED = "div:has(>*>*>label:empty)"
_LOOKS = Html(
    "<style>.mantine-Slider-root,.mantine-Input-wrapper{will-change:transform}"
    f"{_UNLABELLED} .mantine-Slider-root+*{{display:none}}"
    f"{_UNLABELLED}{{margin-top:-0.4em;padding-bottom:0.75em}}{_NARROW}</style>"
)
# The result of the page itself takes the place of the one that was sent with it.
_PLACE = """
const placed = new MutationObserver(() => {
  if (document.querySelector("#root [data-serial]") === null) return;
  placed.disconnect();
  document.getElementById("first").remove();
});
placed.observe(document.documentElement, { subtree: true, childList: true });
"""


def with_first_result(page: bytes, title: str, answer: Answer | None) -> bytes:
    """The page of viser with a title, and with a result to read while its script is still unpacked.

    Args:
        page: as viser sends it.
        title: of what was opened.
        answer: the first result; None: there is none yet.
    """
    head, found, rest = page.partition(_BEFORE)
    if not found:
        return page
    head = head.replace(b"<title>Viser</title>", f"<title>{escape(title)} - bumpstop</title>".encode())
    scripts = Html(_LOOKS + _script(_EDGES + _POINTS))
    if answer is not None:
        look = f"position:fixed;top:0;right:0;width:{PANEL_WIDTH}px;height:100%;overflow:hidden;background:white"
        first = element(
            "div",
            verdict_box(answer, serial=0),
            figures_and_distribution(answer),
            id="first",
            style=f"{look};padding-top:66px;box-sizing:border-box;z-index:1",
        )
        scripts = Html(f"{first}{scripts}{_script(_PLACE)}")
    return b"".join([head, scripts.encode(), found, rest])


def _script(text: str) -> Html:
    # A scope of its own: the page of viser has names of its own.
    return Html(f"<script>{{{text}}}</script>")
