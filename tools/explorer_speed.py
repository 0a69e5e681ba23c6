"""Measure the explorer in a browser: first paint, from slider to distribution, random clicks, memory, many points.

    PYTHONPATH=src python tools/explorer_speed.py [--seconds 120] [--only rigid] [--rows 61000]

It needs viser, playwright and chromium, and draws with the processor (SwiftShader).
"""

from __future__ import annotations

import argparse
import random
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

import bumpstop as bs
from bumpstop.study import WorkspaceStudy
from bumpstop.view.document import scenario_text, with_keys

EXAMPLE = Path(__file__).resolve().parent.parent / "examples" / "02_lower_arm_downward.toml"
FLAGS = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
COMMAND = [sys.executable, "-c", "from bumpstop.cli.main import main; main()", "view", "--port", "0", "--no-browser"]
KINDS: dict[str, dict[str, Any]] = {
    "rigid": {},
    "elastic": {"arm.model": "elastic"},
    "free": {"contact.kind": "free", "contact.body_mass_kg": 2.0},
}
# From the key that a person presses to the frame after the new distribution stands on the page.
WATCH = """() => {
  const serial = () => Number(document.querySelector('[data-serial]')?.getAttribute('data-serial') ?? 0);
  window.waits = []; window.placed = [];
  let pressed = null, last = serial();
  document.addEventListener('keydown', () => { pressed = performance.now(); last = serial(); }, true);
  new MutationObserver(() => {
    if (pressed === null || serial() === last) return;
    const since = pressed; pressed = null;
    window.placed.push(performance.now() - since);
    requestAnimationFrame(() => window.waits.push(performance.now() - since));
  }).observe(document.body, {subtree: true, childList: true, characterData: true, attributes: true});
}"""


# Frames of the picture while its camera turns: three clears the picture once a frame.
COUNT = """window.frames = [];
const clear = WebGL2RenderingContext.prototype.clear;
WebGL2RenderingContext.prototype.clear = function (mask) {
  window.frames.push(performance.now());
  clear.call(this, mask);
};
"""
BUTTONS = ("Undo", "Redo", "Keep this", "Forget", "Compute", "Cancel", "Hide")


def main() -> None:
    """Measure, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=120.0, help="of random clicks")
    parser.add_argument("--rows", type=int, default=61_000, help="of a study whose points are turned; 0: none")
    parser.add_argument("--only", choices=list(KINDS), action="append", help="kinds of contact to measure")
    options = parser.parse_args()
    from playwright.sync_api import sync_playwright

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        for kind in options.only or KINDS:
            scenario = with_keys(bs.load_scenario(EXAMPLE), KINDS[kind])
            file = Path(folder) / f"{kind}.toml"
            file.write_text(scenario_text(scenario), encoding="utf-8")
            measure(browser, kind, file, options.seconds if kind == "rigid" else 0.0)
        if options.rows:
            turn_points(browser, Path(folder), options.rows)
        browser.close()


def serve(source: Path) -> tuple[subprocess.Popen[str], str]:
    """Start the command on a source, and wait until it says where the page is."""
    program = subprocess.Popen([*COMMAND, str(source)], stdout=subprocess.PIPE, text=True)
    assert program.stdout is not None
    found = re.search(r"http://\S+", program.stdout.readline())
    assert found
    return program, found[0]


def turn_points(browser: Any, folder: Path, count: int) -> None:
    """Open a study of so many rows, and turn the picture with the mouse."""
    scenario = bs.load_scenario(EXAMPLE)
    # Rows of one shard over and over, each a little elsewhere: what is drawn costs the same as a study of that size.
    rows = WorkspaceStudy(scenario=scenario, poses=1000).shard(0)
    many = pl.concat([rows] * -(-count // rows.height)).head(count)
    shift = np.random.default_rng(0).normal(0, 0.05, (count, 3))
    many = many.with_columns(**{f"tip_{axis}_m": many[f"tip_{axis}_m"] + shift[:, k] for k, axis in enumerate("xyz")})
    study = folder / "study"
    study.mkdir()
    many.write_parquet(study / "rows.parquet")
    (study / "settings.toml").write_text(scenario_text(scenario), encoding="utf-8")
    program, url = serve(study)
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    page.add_init_script(COUNT)
    page.goto(url)
    page.wait_for_selector("#root [data-details]", timeout=120_000)
    page.wait_for_timeout(3000)
    page.evaluate("window.frames.length = 0")
    page.mouse.move(600, 700)
    page.mouse.down()
    for step in range(60):
        page.mouse.move(600 + 3 * step, 700)
        page.wait_for_timeout(30)
    page.mouse.up()
    times = page.evaluate("window.frames")
    gaps = [after - before for before, after in pairwise(times) if after - before > 1.0]
    print(f"{count} rows: {len(gaps)} frames while the picture turns, median {statistics.median(gaps):.0f} ms, "
          f"worst {max(gaps):.0f} ms")  # fmt: skip
    page.close()
    program.send_signal(2)
    program.wait(30)


def measure(browser: Any, kind: str, file: Path, seconds: float) -> None:
    """Measure one scenario."""
    begin = time.perf_counter()
    program, url = serve(file)
    served = time.perf_counter() - begin
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    faults: list[str] = []
    page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.goto(url, wait_until="commit")
    # First the one that the page is sent with, then that of the page, from which on its controls can be moved.
    page.wait_for_selector("[data-serial]", timeout=120_000)
    first = time.perf_counter() - begin
    page.wait_for_selector("#root [data-serial]", timeout=120_000)
    paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? NaN") / 1e3
    print(f"{kind}: served after {served:.2f} s, first paint {paint:.2f} s after that, first result on the page after "
          f"{first:.2f} s, its own after {time.perf_counter() - begin:.2f} s")  # fmt: skip
    page.wait_for_selector("#root [data-details]", timeout=120_000)
    page.wait_for_timeout(4000)
    page.evaluate(WATCH)
    below = "following::*[contains(@class, 'mantine-Slider-thumb')][1]"
    box = page.locator(f"xpath=//label[normalize-space()='speed, mm/s']/{below}")
    box.focus()
    for press in range(30):
        page.keyboard.press("ArrowRight" if press % 10 < 5 else "ArrowLeft")
        page.wait_for_timeout(400)
    for name, what in (("placed", "new distribution in the page"), ("waits", "frame after it")):
        waits = page.evaluate(f"window.{name}")
        if waits:
            print(f"{kind}: from key to {what}: median {statistics.median(waits):.0f} ms, "
                  f"worst {max(waits):.0f} ms of {len(waits)}")  # fmt: skip
    if seconds:
        click(page, program.pid, seconds)
        # A page with the scenario of the beginning: what then is left was not given back.
        page.close()
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(url)
        page.wait_for_selector("#root [data-details]", timeout=120_000)
        page.wait_for_timeout(4000)
        print(f"a new page after that: server {resident(program.pid, 'VmRSS'):.0f} MB")
    print(f"{kind}: {len(faults)} errors in the console {faults[:2]}")
    page.close()
    program.send_signal(2)
    program.wait(30)


def click(page: Any, pid: int, seconds: float) -> None:
    """Press arrows in random inputs, buttons and places of the picture, and compare memory before and after."""
    choose = random.Random(0)
    begin, count, found = time.perf_counter(), 0, [memory(page, pid)]
    while (passed := time.perf_counter() - begin) < seconds:
        # Four times: what only grows at first is no leak.
        if passed > len(found) * seconds / 4:
            found.append(memory(page, pid))
        inputs = page.locator("input:visible").all()
        try:
            box = choose.choice(inputs)
            box.click(timeout=2000, force=True)
            page.keyboard.press(choose.choice(["ArrowUp", "ArrowDown", "Enter", "Tab", "1", "Backspace"]))
            count += 1
            if choose.random() < 0.2:
                page.get_by_role("button", name=choose.choice(BUTTONS), exact=True).first.click(timeout=2000)
            if choose.random() < 0.3:
                page.mouse.click(choose.uniform(350, 850), choose.uniform(190, 780))
        except Exception as error:  # an input may be gone when its turn comes
            print(f"   {type(error).__name__}", end="")
    found.append(memory(page, pid))
    server, heap = (", ".join(f"{each[k]:.0f}" for each in found) for k in (0, 1))
    print(f"{count} clicks in {seconds:.0f} s: server {server} MB, at most {resident(pid, 'VmHWM'):.0f} MB, "
          f"page {heap} MB")  # fmt: skip


def memory(page: Any, pid: int) -> tuple[float, float]:
    """Resident memory of the server, and the page's heap [MB]."""
    return resident(pid, "VmRSS"), page.evaluate("performance.memory.usedJSHeapSize") / 1e6


def resident(pid: int, which: str) -> float:
    """Resident memory of a process [MB]: ``VmRSS`` now, ``VmHWM`` the most it ever had."""
    found = re.search(rf"{which}:\s+(\d+)", Path(f"/proc/{pid}/status").read_text(encoding="utf-8"))
    assert found
    return int(found[1]) / 1e3


if __name__ == "__main__":
    main()
