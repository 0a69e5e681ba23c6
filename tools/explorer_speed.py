"""Measure the explorer in a browser: first paint, from slider to distribution, random clicks, memory.

    PYTHONPATH=src python tools/explorer_speed.py [--seconds 120] [--only rigid]

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
from pathlib import Path
from typing import Any

import bumpstop as bs
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
  window.waits = [];
  let pressed = null, last = serial();
  document.addEventListener('keydown', () => { pressed = performance.now(); last = serial(); }, true);
  new MutationObserver(() => {
    if (pressed === null || serial() === last) return;
    const since = pressed; pressed = null;
    requestAnimationFrame(() => window.waits.push(performance.now() - since));
  }).observe(document.body, {subtree: true, childList: true, characterData: true, attributes: true});
}"""


def main() -> None:
    """Measure, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=120.0, help="of random clicks")
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
        browser.close()


def measure(browser: Any, kind: str, file: Path, seconds: float) -> None:
    """Measure one scenario."""
    begin = time.perf_counter()
    program = subprocess.Popen([*COMMAND, str(file)], stdout=subprocess.PIPE, text=True)
    assert program.stdout is not None
    found = re.search(r"http://\S+", program.stdout.readline())
    assert found
    served = time.perf_counter() - begin
    page = browser.new_page(viewport={"width": 1280, "height": 800})
    faults: list[str] = []
    page.on("console", lambda message: faults.append(message.text) if message.type == "error" else None)
    page.goto(found[0])
    page.wait_for_selector("[data-serial]", timeout=120_000)
    print(f"{kind}: served after {served:.2f} s, first result on the page after {time.perf_counter() - begin:.2f} s")
    page.wait_for_timeout(4000)
    page.evaluate(WATCH)
    box = page.locator("xpath=//label[normalize-space()='speed, mm/s']/ancestor::*[.//input][1]//input").last
    box.click()
    for press in range(30):
        page.keyboard.press("ArrowUp" if press % 10 < 5 else "ArrowDown")
        page.wait_for_timeout(400)
    waits = page.evaluate("window.waits")
    if waits:
        print(f"{kind}: from key to drawn distribution: median {statistics.median(waits):.0f} ms, "
              f"worst {max(waits):.0f} ms of {len(waits)}")  # fmt: skip
    if seconds:
        click(page, program.pid, seconds)
    print(f"{kind}: {len(faults)} errors in the console {faults[:2]}")
    page.close()
    program.send_signal(2)
    program.wait(30)


def click(page: Any, pid: int, seconds: float) -> None:
    """Press arrows in random inputs for some time, and compare memory before and after."""
    choose = random.Random(0)
    before, end, count = memory(page, pid), time.perf_counter() + seconds, 0
    while time.perf_counter() < end:
        inputs = page.locator("input:visible").all()
        try:
            box = choose.choice(inputs)
            box.click(timeout=2000, force=True)
            page.keyboard.press(choose.choice(["ArrowUp", "ArrowDown", "Enter", "Tab", "1", "Backspace"]))
            count += 1
            if choose.random() < 0.1:
                page.get_by_role("button", name=choose.choice(["Undo", "Redo"])).first.click(timeout=2000)
        except Exception as error:  # an input may be gone when its turn comes
            print(f"   {type(error).__name__}", end="")
    after = memory(page, pid)
    print(f"{count} clicks in {seconds:.0f} s: server {before[0]:.0f} to {after[0]:.0f} MB, "
          f"page {before[1]:.0f} to {after[1]:.0f} MB")  # fmt: skip


def memory(page: Any, pid: int) -> tuple[float, float]:
    """Resident memory of the server, and the page's heap [MB]."""
    resident = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{pid}/status").read_text(encoding="utf-8"))
    assert resident
    return int(resident[1]) / 1e3, page.evaluate("performance.memory.usedJSHeapSize") / 1e6


if __name__ == "__main__":
    main()
