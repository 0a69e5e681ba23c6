"""A page in a real browser, as tests and tools use it."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np

from bumpstop.view.controls import Control, Shown
from bumpstop.view.field_text import field_text
from bumpstop.view.page.server import ViewServer

WAIT_MS = 60_000
OPENED_MS = 5_000


class Screen:
    """A page in the browser."""

    def __init__(self, browser: Any, server: ViewServer, size: tuple[int, int] = (960, 560), before: str = "") -> None:
        self.page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        self.faults: list[str] = []
        self.elsewhere: list[str] = []
        self.page.on("console", lambda m: self.faults.append(m.text) if m.type == "error" else None)
        self.page.on("pageerror", lambda error: self.faults.append(str(error)))
        own = (server.url, server.url.replace("http", "ws"), "data:", "blob:")
        self.page.on("request", lambda r: None if r.url.startswith(own) else self.elsewhere.append(r.url))
        self.page.add_init_script(before)
        self.page.goto(server.url)
        # Not the one that the page is sent with: what a person can use is up when the page shows its own.
        self.page.wait_for_selector("#root [data-serial]", timeout=WAIT_MS)
        # A folder that is closed has no text.
        self.open_folder("Scenario file")
        self.page.wait_for_selector("[data-scenario]", timeout=WAIT_MS)

    def open_folder(self, name: str) -> None:
        """Open a folder of the panel, and wait until those below it have moved."""
        from playwright.sync_api import TimeoutError as TooLong

        header = self.page.locator(f"xpath=(//div[normalize-space(text())='{name}'])[1]")
        inside = header.locator("xpath=./following-sibling::*[1]")
        header.wait_for(timeout=WAIT_MS)
        # A click is lost where new figures move the header between its press and its release.
        while inside.get_attribute("aria-hidden") == "true":
            header.click(timeout=WAIT_MS)
            with contextlib.suppress(TooLong):
                inside.wait_for(timeout=OPENED_MS)
        self.page.wait_for_function("inside => !inside.style.height", arg=inside.element_handle(), timeout=WAIT_MS)

    def number(self, key: str) -> float:
        return float(self.page.get_attribute(f"[data-figure='{key}']", "data-value"))

    def scenario(self) -> str:
        return str(self.page.text_content("[data-scenario]"))

    def until(self, words: str) -> None:
        """Wait until the exported scenario has these words; its verdict stands beside it."""
        self.page.wait_for_function(
            "words => document.querySelector('[data-scenario]').textContent.includes(words)", arg=words,
            timeout=WAIT_MS,
        )  # fmt: skip

    def wait_for_the_picture(self) -> None:
        """Wait until the picture is drawn, and close the browser's note that it is drawn without a graphics card."""
        self.page.wait_for_selector("[data-details]", timeout=WAIT_MS)
        note = self.page.get_by_text("Software WebGL rendering detected")
        if note.count():
            note.locator("xpath=ancestor::*[.//button][1]//button").first.click(timeout=WAIT_MS)
            note.wait_for(state="detached", timeout=WAIT_MS)

    def press_at(self, server: ViewServer, place: np.ndarray) -> None:
        """Click on a place in the picture (3,) [m], as the camera of the page sees it."""
        camera = next(iter(server.pages.values())).client.camera
        eye, target, up = (np.asarray(v, dtype=float) for v in (camera.position, camera.look_at, camera.up_direction))
        ahead = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(ahead, up) / np.linalg.norm(np.cross(ahead, up))
        seen = np.array([right, np.cross(right, ahead), ahead]) @ (place - eye)
        box = max(
            (canvas.bounding_box() for canvas in self.page.locator("canvas").all()),
            key=lambda box: box["width"] * box["height"] if box else 0,
        )
        scale = box["height"] / 2 / np.tan(camera.fov / 2) / seen[2]
        x, y = box["x"] + box["width"] / 2 + scale * seen[0], box["y"] + box["height"] / 2 - scale * seen[1]
        self.page.mouse.move(x - 2, y)
        self.page.mouse.move(x, y)
        self.page.mouse.click(x, y)

    def until_other_than(self, scenario: str) -> None:
        """Wait until the exported scenario is another one."""
        self.page.wait_for_function(
            "text => document.querySelector('[data-scenario]').textContent !== text", arg=scenario, timeout=WAIT_MS
        )

    def until_same_as(self, scenario: str) -> None:
        """Wait until the exported scenario is this one."""
        self.page.wait_for_function(
            "text => document.querySelector('[data-scenario]').textContent.trim() === text.trim()", arg=scenario,
            timeout=WAIT_MS,
        )  # fmt: skip

    def until_so_many(self, selector: str, count: int) -> None:
        """Wait until so many elements stand on the page."""
        from playwright.sync_api import expect

        expect(self.page.locator(selector)).to_have_count(count, timeout=WAIT_MS)

    def until_chosen(self, control: Control, name: str) -> None:
        """Wait until a choice shows a name."""
        from playwright.sync_api import expect

        expect(self.fields(control.label).first).to_have_value(name, timeout=WAIT_MS)

    def set(self, control: Control, value: Shown) -> None:
        """Do with a control what a person would, so that it shows a value."""
        fields = self.fields(control.label)
        if control.kind == "choice":
            fields.first.click()
            self.page.get_by_role("option", name=str(value), exact=True).locator("visible=true").click()
            return
        # One of the panel of uncertainties has the label of a choice above it.
        fields.last.fill(field_text(value))

    def fields(self, label: str) -> Any:
        """The inputs beside a label."""
        row = f"xpath=//label[normalize-space()='{label}']/ancestor::*[.//input][1]"
        return self.page.locator(f"{row}//input[not(@type='hidden')]")

    def thumb(self, label: str) -> Any:
        """What is dragged of the slider below a label."""
        below = "following::*[contains(@class, 'mantine-Slider-thumb')][1]"
        return self.page.locator(f"xpath=//label[normalize-space()='{label}']/{below}")

    def field(self, label: str) -> Any:
        """The input beside a label: a panel's row is label and input."""
        return self.fields(label).last
