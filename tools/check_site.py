"""Check a built documentation site: links, requests to other hosts, figures, and what its search finds.

``make docs`` runs it. The last line says how much was checked; the exit status is 1 where something is wrong.
"""

from __future__ import annotations

import json
import re
import sys
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

# Elements and attributes whose address a browser loads by itself. Links are only followed when somebody clicks.
LOADED = {
    "script": ("src",),
    "link": ("href",),
    "img": ("src", "srcset"),
    "iframe": ("src",),
    "source": ("src", "srcset"),
    "video": ("src", "poster"),
    "audio": ("src",),
    "object": ("data",),
    "embed": ("src",),
    "use": ("href", "xlink:href"),
    "image": ("href", "xlink:href"),
}
IN_CSS = re.compile(r"url\(\s*['\"]?([^'\")]+)|@import\s+['\"]([^'\"]+)")
IN_JS = re.compile(r"(?:fetch|import|importScripts)\s*\(\s*[`'\"](https?:)?//|\.src\s*=\s*[`'\"](https?:)?//")

# Sphinx takes all but the last of several names in one field for a type.
_AS_TYPE = re.compile(r"\(<em>(\w+)</em><em>,</em>\)")


@dataclass
class Page(HTMLParser):
    """What a page links to, what it loads, and the places in it that a link may name.

    Attributes:
        links: addresses of its links.
        loads: addresses that a browser loads to show it.
        places: values of ``id`` and of ``name`` of links.
    """

    links: list[str] = field(default_factory=list)
    loads: list[str] = field(default_factory=list)
    places: set[str] = field(default_factory=set)
    _style: bool = False

    def __post_init__(self) -> None:
        """Begin with an empty document."""
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take the addresses of an element."""
        values = {name: value or "" for name, value in attrs}
        self._style = tag == "style"
        self.places |= {values[name] for name in ("id", "name") if name in values}
        self.loads += [values[name].split()[0] for name in LOADED.get(tag, ()) if values.get(name)]
        self.loads += [one for found in IN_CSS.findall(values.get("style", "")) for one in found if one]
        if tag in ("a", "area") and "href" in values:
            self.links.append(values["href"])

    def handle_data(self, data: str) -> None:
        """Take the addresses of a style sheet inside the page."""
        if self._style:
            self.loads += [one for found in IN_CSS.findall(data) for one in found if one]


def read(path: Path) -> Page:
    """The addresses of a page."""
    page = Page()
    page.feed(path.read_text(encoding="utf-8"))
    return page


def leaves_the_host(address: str) -> bool:
    """Whether a browser asks another host for an address."""
    return bool(urlsplit(address).netloc) or urlsplit(address).scheme in ("http", "https", "ftp")


def faults_of_links(site: Path) -> list[str]:
    """Links to pages or places that do not exist, and whatever is loaded that is not there or on another host."""
    pages = {path: read(path) for path in sorted(site.rglob("*.html"))}
    found = []
    for path, page in pages.items():
        here = path.relative_to(site)
        found += [f"{here}: loads {one} from another host" for one in page.loads if leaves_the_host(one)]
        for address in [*page.links, *page.loads]:
            parts = urlsplit(address)
            if parts.scheme or parts.netloc:
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            target = target / "index.html" if target.is_dir() else target
            if not target.is_relative_to(site.resolve()) and target != path:
                found.append(f"{here}: {address} is outside the site")
            elif not target.exists():
                found.append(f"{here}: {address} does not exist")
            elif parts.fragment and target.suffix == ".html":
                other = pages.get(site / target.relative_to(site.resolve())) if target != path else page
                if other is not None and unquote(parts.fragment) not in other.places:
                    found.append(f"{here}: {address}: no such place there")
    return found


def faults_of_files(site: Path) -> list[str]:
    """Style sheets and scripts that load something from another host, and style sheets that name a missing file."""
    found = []
    for path in sorted(site.rglob("*.css")):
        for address in (one for pair in IN_CSS.findall(path.read_text(encoding="utf-8")) for one in pair if one):
            if address.startswith(("data:", "#")):
                continue
            if leaves_the_host(address):
                found.append(f"{path.relative_to(site)}: loads {address} from another host")
            elif not (path.parent / urlsplit(address).path).exists():
                found.append(f"{path.relative_to(site)}: {address} does not exist")
    for path in sorted(site.rglob("*.js")):
        if IN_JS.search(path.read_text(encoding="utf-8")):
            found.append(f"{path.relative_to(site)}: loads something from another host")
    return found


def faults_of_figures(site: Path, names: list[str]) -> list[str]:
    """Figures that no page shows, by name."""
    shown = {Path(urlsplit(one).path).name for path in site.rglob("*.html") for one in read(path).loads}
    return [f"figure {name} is on no page" for name in names if f"{name}.svg" not in shown]


def faults_of_search(site: Path, keys: list[str]) -> list[str]:
    """Keys that the site's search does not find: some word of theirs is in no page of its index."""
    import snowballstemmer

    text = (site / "searchindex.js").read_text(encoding="utf-8")
    index = json.loads(text[text.index("(") + 1 : text.rindex(")")])
    known, stem = {*index["terms"], *index["titleterms"]}, snowballstemmer.stemmer("english").stemWord
    words = {key: [word.lower() for word in re.findall(r"\w+", key)] for key in keys}
    return [
        f"search does not find {key}"
        for key, parts in words.items()
        if not all(part in known or stem(part) in known for part in parts)
    ]


def faults_of_words(site: Path) -> list[str]:
    """Options whose two hyphens became a dash, and names of a docstring that were taken for a type."""
    found = []
    for path in sorted(site.rglob("*.html")):
        text = path.read_text(encoding="utf-8")
        found += [f"{path.relative_to(site)}: {word}" for word in re.findall(r"(?<!\w)[\u2013\u2014][a-z]\w+", text)]
        found += [f"{path.relative_to(site)}: the name {name} stands as a type" for name in re.findall(_AS_TYPE, text)]
    return found


def main() -> None:
    """Check the site in the folder that is given."""
    root = Path(__file__).resolve().parents[1]
    sys.path.insert(0, str(root / "docs" / "extensions"))
    from figures import PICTURES

    from bumpstop.cli.completion import scenario_keys

    site, keys = Path(sys.argv[1]), list(scenario_keys())
    figures = [picture.name for picture in PICTURES]
    faults = [*faults_of_links(site), *faults_of_files(site), *faults_of_figures(site, figures)]
    faults += [*faults_of_search(site, keys), *faults_of_words(site)]
    for fault in faults:
        print(fault)
    pages = len(list(site.rglob("*.html")))
    print(f"{pages} pages, {len(figures)} figures, {len(keys)} scenario keys: {len(faults)} faults")
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
