"""A page read as a program reads it: its text, its tables, and every address that it names."""

from __future__ import annotations

from html.parser import HTMLParser

FETCHING = ("src", "srcset", "href", "data", "poster", "action", "background", "xlink:href")


class Page(HTMLParser):
    """What a document holds.

    Attributes
    ----------
    elements : list of (name, attributes)
    headings : list of (level, text)
    rows : list of list of str
        Cells of every table's rows, the first of which heads it.
    text : str
        All text outside of the style sheet.
    """

    def __init__(self, document: str) -> None:
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str]]] = []
        self.headings: list[tuple[int, str]] = []
        self.rows: list[list[str]] = []
        self.text = ""
        self._open = ""
        self._in_cell = False
        self.feed(document)
        self.close()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, {name: value or "" for name, value in attributes}))
        self._open = tag
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
            self._in_cell = True
        elif tag in ("h1", "h2", "h3"):
            self.headings.append((int(tag[1]), ""))

    def handle_endtag(self, tag: str) -> None:
        if tag == self._open:
            self._open = ""
        if tag in ("td", "th"):
            self._in_cell = False
            self.rows[-1][-1] = " ".join(self.rows[-1][-1].split())

    def handle_data(self, data: str) -> None:
        if self._open == "style":
            return
        self.text += data
        if self._open in ("h1", "h2", "h3"):
            level, text = self.headings[-1]
            self.headings[-1] = (level, text + data)
        if self._in_cell:
            self.rows[-1][-1] += f" {data}"

    def addresses(self) -> list[str]:
        """Every address that an attribute names."""
        return [attributes[name] for _, attributes in self.elements for name in FETCHING if name in attributes]
