"""Look at a built documentation site in a browser, on a phone's width and a desk's.

    python tools/look_at_site.py build/site [--pictures FOLDER]

Every page is opened at 390 and at 1440 pixels. Named are pages that are wider than the screen, pictures that are not
drawn, formulas that are not understood, errors of the page and requests to another host. Needed: playwright and
chromium.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path
from typing import Any

WIDTHS = {390: 844, 1440: 900}
# What a page says of itself; the theme's own pages have no article.
_LOOK = """() => ({
  beyond: document.documentElement.scrollWidth - document.documentElement.clientWidth,
  pictures: [...document.images].filter(one => !one.complete || !one.naturalWidth).map(one => one.getAttribute('src')),
  formulas: document.querySelectorAll('merror').length
    + (document.querySelector('article')?.innerText.match(/\\\\(frac|mathrm|dot|sum|alpha)\\b/g) ?? []).length,
})"""


def faults(page: Any, address: str) -> list[str]:
    """What is wrong with a page, in words.

    Args:
        page: of playwright, at the width to be judged.
        address: of the page.
    """
    heard: list[str] = []
    own = (address.rsplit("/", 1)[0].split("://")[0] + ":", "data:", "blob:")

    def listen(request: Any) -> None:
        if not request.url.startswith(own):
            heard.append(f"asks for {request.url}")

    def complain(message: Any) -> None:
        if message.type == "error":
            heard.append(message.text)

    page.on("request", listen)
    page.on("console", complain)
    page.goto(address)
    found = page.evaluate(_LOOK)
    page.remove_listener("request", listen)
    page.remove_listener("console", complain)
    if found["beyond"] > 0:
        heard.append(f"is {found['beyond']} pixels wider than the screen")
    heard += [f"does not draw {picture}" for picture in found["pictures"]]
    if found["formulas"]:
        heard.append(f"has {found['formulas']} formulas that are not understood")
    return heard


def main(arguments: list[str] | None = None) -> int:
    """Look at every page and print what is wrong; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("site", type=Path)
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each page")
    options = parser.parse_args(arguments)
    from playwright.sync_api import sync_playwright

    site = options.site.resolve()
    pages = sorted(path for path in site.rglob("*.html") if "_static" not in path.parts)
    count = 0
    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        for width, height in WIDTHS.items():
            page = browser.new_page(viewport={"width": width, "height": height})
            for path in pages:
                name = path.relative_to(site)
                for fault in faults(page, path.as_uri()):
                    print(f"{name} at {width} pixels: {fault}")
                    count += 1
                if options.pictures:
                    options.pictures.mkdir(parents=True, exist_ok=True)
                    picture = f"{'_'.join(name.with_suffix('').parts)}_{width}.png"
                    page.screenshot(path=options.pictures / picture, full_page=True)
        browser.close()
    print(f"{len(pages)} pages at {' and '.join(map(str, WIDTHS))} pixels: {count} faults")
    return int(count > 0 or not pages)


if __name__ == "__main__":
    sys.exit(main())
