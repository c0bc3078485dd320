"""Check a built site: no page loads anything from elsewhere, and every table is one.

Usage: python docs/check_site.py build/docs
"""

import sys
from html.parser import HTMLParser
from pathlib import Path

LOADS = {
    "script": "src",
    "img": "src",
    "link": "href",
    "iframe": "src",
    "source": "src",
    "video": "src",
    "audio": "src",
}
"""What a browser fetches without being asked; a link to click is not among it."""


class Loads(HTMLParser):
    """Collects what a page makes a browser fetch."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note the address that a tag loads; a ``link`` that only names a neighbour loads nothing."""
        given = dict(attrs)
        address = given.get(LOADS.get(tag, ""))
        kinds = set((given.get("rel") or "").split())
        if address and not (tag == "link" and not kinds & {"stylesheet", "icon", "preload", "preconnect", "manifest"}):
            self.found.append(address)


def loads(page: str) -> list[str]:
    """Return the addresses that a page loads."""
    parser = Loads()
    parser.feed(page)
    return parser.found


class Broken(HTMLParser):
    """Collects paragraphs that begin as a row of a table does: tables that were not read as such."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []
        self._begun = False

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Begin a paragraph."""
        del attrs
        self._begun = self._begun or tag == "p"

    def handle_data(self, data: str) -> None:
        """Note the first words of a paragraph."""
        if self._begun and data.lstrip().startswith("|"):
            self.found.append(data.strip().partition("\n")[0][:40])
        self._begun = self._begun and not data.strip()


def problems(site: Path) -> list[str]:
    """Return what is wrong with a site, in words: addresses elsewhere, and files that are not there."""
    wrong = []
    for file in sorted(site.rglob("*.html")):
        name, text = file.relative_to(site), file.read_text(encoding="utf-8")
        broken = Broken()
        broken.feed(text)
        wrong += [f"{name} shows a table as text: {row}" for row in broken.found]
        for address in loads(text):
            if address.startswith(("http:", "https:", "//")):
                wrong.append(f"{name} loads {address}")
            elif not address.startswith("data:") and not (file.parent / address.partition("?")[0]).exists():
                wrong.append(f"{name} loads {address}, which is not there")
    for style in sorted(site.rglob("*.css")):
        text = style.read_text(encoding="utf-8")
        wrong += [f"{style.relative_to(site)} loads from elsewhere"] * ("url(http" in text or "@import" in text)
    return wrong


if __name__ == "__main__":
    found = problems(Path(sys.argv[1]))
    pages = len(list(Path(sys.argv[1]).rglob("*.html")))
    if found or not pages:
        sys.exit("\n".join(found) or f"{sys.argv[1]} holds no page")
    sys.stdout.write(f"{pages} pages, and nothing in them comes from elsewhere\n")
