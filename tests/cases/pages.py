"""HTML pages as tests read them, and words that a page must show and not obey."""

from __future__ import annotations

from collections import Counter
from html.parser import HTMLParser

#: elements without an end
VOID = {"meta", "br", "input", "link", "img"}
HOSTILE = "</script><script>alert(1)</script>\"'&{{ 7*7 }}<img src=x onerror=alert(1)>"


class Page(HTMLParser):
    """Elements, identifiers, references and the text of a page; refuses ends that fit no beginning."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.tags: Counter[str] = Counter()
        self.ids: list[str] = []
        self.attributes: list[tuple[str, str]] = []
        self.text: list[str] = []
        #: addresses that a browser asks for by itself, and links that leave the folder; names of elements are neither
        self.asked: list[str] = []
        self.feed(text)
        self.close()

    @property
    def figures_scripts(self) -> int:
        """Scripts that figures need: the data of each, the library, and what shows them."""
        drawn = sum(name == "data-live" for name, _ in self.attributes)
        return drawn + 2 if drawn else 0

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags[tag] += 1
        self.attributes += [(name, value or "") for name, value in attrs]
        addresses = [value or "" for name, value in attrs if name in ("src", "href", "xlink:href")]
        self.asked += [each for each in addresses if not each.startswith("#") and (tag != "a" or ":" in each)]
        self.ids += [value or "" for name, value in attrs if name == "id"]
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)
