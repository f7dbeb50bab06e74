"""Building blocks of a self-contained page: one file that loads nothing else and opens anywhere."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, NewType

from cutenv._base.atomic_file import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Html = NewType("Html", str)
"""Markup. Data becomes markup through :func:`escaped` only; the type keeps the two apart."""

WIDE, NARROW = 9.0, 3.8
"""Widths for which figures are drawn [in]: for a desktop screen and a phone, at 96 px an inch."""

_NARROW_SCREEN = "(max-width: 700px)"


@dataclass(frozen=True)
class PageSection:
    """Section of a page: the name for links to it, its heading and its content."""

    key: str
    heading: str
    body: Html


@dataclass(frozen=True)
class Row:
    """Row of a table: its cells, the first of which is its heading, and a class of the style sheet to mark it."""

    cells: Sequence[Html]
    mark: str = ""


def escaped(text: object) -> Html:
    """Return text as markup that shows exactly that text, also within an attribute's quotes."""
    return Html(html.escape(str(text), quote=True))


def joined(*parts: Html) -> Html:
    """Join pieces of markup."""
    return Html("\n".join(parts))


def element(name: str, content: Html, kind: str = "") -> Html:
    """Return an element around markup, with a class if ``kind`` is given."""
    attribute = f' class="{kind}"' if kind else ""
    return Html(f"<{name}{attribute}>{content}</{name}>")


def paragraph(text: str, kind: str = "") -> Html:
    """Return a paragraph of plain text."""
    return element("p", escaped(text), kind)


def number(value: float, digits: int) -> str:
    """Return a number in print typography: a true minus sign, and none before a zero."""
    shown = f"{value:.{digits}f}"
    if float(shown) == 0.0:
        shown = shown.removeprefix("-")
    return shown.replace("-", "\u2212")


def estimate_text(mean: float, low: float, high: float, digits: int) -> Html:
    """Return a mean with its interval in small type."""
    interval = f"[{number(low, digits)}, {number(high, digits)}]"
    return Html(f'{number(mean, digits)} <span class="interval">{interval}</span>')


def html_table(caption: str, headings: Sequence[Html], rows: Sequence[Row], kind: str = "") -> Html:
    """Return a table that scrolls sideways if the screen is too narrow for it.

    Parameters
    ----------
    caption : str
        Content of the table; shown above it and read by screen readers.
    headings : sequence of Html
        Headings of the columns.
    rows : sequence of Row
        Rows with as many cells as there are headings.
    kind : str
        Class of the style sheet.

    Raises
    ------
    ValueError
        If a row has more or fewer cells than there are headings.
    """
    for place, row in enumerate(rows):
        if len(row.cells) != len(headings):
            raise ValueError(
                f"row {place} of table {caption!r} has {len(row.cells)} cells for {len(headings)} columns."
            )
    head = "".join(f'<th scope="col">{heading}</th>' for heading in headings)
    body = "\n".join(_table_row(row) for row in rows)
    return Html(
        f'<div class="scroll" role="region" tabindex="0" aria-label="{escaped(caption)}">\n'
        f'<table class="{kind}"><caption><span>{escaped(caption)}</span></caption>\n'
        f"<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody></table></div>"
    )


def _table_row(row: Row) -> str:
    mark = f' class="{row.mark}"' if row.mark else ""
    first, *others = row.cells
    return f'<tr{mark}><th scope="row">{first}</th>' + "".join(f"<td>{cell}</td>" for cell in others) + "</tr>"


def definitions(entries: Sequence[tuple[str, str]], kind: str = "") -> Html:
    """Return a list of terms with their meanings, both plain text."""
    items = "\n".join(f"<div><dt>{escaped(term)}</dt><dd>{escaped(meaning)}</dd></div>" for term, meaning in entries)
    return Html(f'<dl class="{kind}">\n{items}\n</dl>')


def folded(summary: str, content: Html) -> Html:
    """Return content that a reader can unfold."""
    return Html(f"<details><summary>{escaped(summary)}</summary>\n{content}\n</details>")


def picture(draw: Callable[[float], Figure], alt: str, caption: Html) -> Html:
    """Return an embedded figure, drawn twice: on a narrow screen the wide one's letters would be too small.

    Parameters
    ----------
    draw : callable
        Maps a width [in] to a matplotlib figure; see :func:`new_figure`.
    alt : str
        Description of the figure, for those who do not see it.
    caption : Html
        Text below the figure.
    """
    wide, narrow = draw(WIDE), draw(NARROW)
    return Html(
        "<figure><picture>\n"
        f'<source media="{_NARROW_SCREEN}" srcset="{_data_uri(narrow)}" {_size(narrow)}>\n'
        f'<img src="{_data_uri(wide)}" {_size(wide)} alt="{escaped(alt)}">\n'
        f"</picture><figcaption>{caption}</figcaption></figure>"
    )


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size [in].

    Raises
    ------
    ImportError
        If matplotlib is not installed; the message gives the command that installs it.
    """
    try:
        from matplotlib.figure import Figure  # an extra, and slow to import
    except ImportError as error:
        cure = "Pictures need matplotlib. Install it with: pip install 'cutenv[view]'"
        raise ModuleNotFoundError(cure, name="matplotlib") from error
    return Figure(figsize=(width, height), layout="constrained")


def label(text: str) -> str:
    """Return text that matplotlib shows unchanged: a dollar sign starts no formula."""
    return text.replace("$", r"\$")


def _data_uri(figure: Figure) -> str:
    drawing = io.BytesIO()
    figure.savefig(drawing, format="svg", metadata={"Date": None})
    return "data:image/svg+xml;base64," + base64.b64encode(drawing.getvalue()).decode("ascii")


def _size(figure: Figure) -> str:
    width, height = 96.0 * figure.get_size_inches()
    return f'width="{width:.0f}" height="{height:.0f}"'


def page(title: str, subtitle: str, lead: Html, sections: Sequence[PageSection]) -> Html:
    """Return a whole document, which forbids the browser to load anything else.

    Parameters
    ----------
    title, subtitle : str
        Title, also of the window, and subtitle.
    lead : Html
        Summary for a reader who reads nothing else.
    sections : sequence of Section
        Sections in the order of reading.
    """
    links = "".join(f'<li><a href="#{escaped(part.key)}">{escaped(part.heading)}</a></li>' for part in sections)
    body = "\n".join(
        f'<section id="{escaped(part.key)}" aria-labelledby="{escaped(part.key)}-heading">\n'
        f'<h2 id="{escaped(part.key)}-heading">{escaped(part.heading)}</h2>\n{part.body}\n</section>'
        for part in sections
    )
    return Html(
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:; '
        "style-src 'unsafe-inline'\">\n"
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<meta name="color-scheme" content="light dark">\n<title>{escaped(title)}</title>\n'
        f"<style>{_STYLE}</style>\n</head>\n<body>\n"
        f'<header>\n<h1>{escaped(title)}</h1>\n<p class="subtitle">{escaped(subtitle)}</p>\n</header>\n'
        f'<main>\n{lead}\n<nav aria-label="Contents"><ul>{links}</ul></nav>\n{body}\n</main>\n</body>\n</html>\n'
    )


def write_page(path: Path, document: Html) -> None:
    """Write a document as a whole or not at all."""
    with atomic_write(path) as part:
        part.write_text(document, encoding="utf-8", newline="\n")


_STYLE = """
:root {
  color-scheme: light dark;
  --paper: #f6f7f9; --card: #fff; --ink: #1b1f24; --quiet: #57606a; --line: #d8dee4; --accent: #0063a0;
  --own: #e3f0fa; --good: #00704f; --bad: #b34700; --open: #57606a;
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #12161b; --card: #1b2128; --ink: #e6e9ed; --quiet: #a3adb8; --line: #343c46; --accent: #6cb8ee;
    --own: #17324a; --good: #3cc79a; --bad: #f0914a; --open: #a3adb8;
  }
}
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; text-size-adjust: 100%; }
body {
  margin: 0 auto; max-width: 64rem; padding: 2rem 1.25rem 4rem; background: var(--paper); color: var(--ink);
  font: 1rem/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "Liberation Sans", Arial, sans-serif;
  overflow-wrap: break-word;
}
h1 { font-size: 1.75rem; line-height: 1.2; margin: 0; letter-spacing: -0.01em; }
h2 { font-size: 1.25rem; line-height: 1.3; margin: 0 0 0.35rem; }
h3 { font-size: 1rem; margin: 1.25rem 0 0.25rem; }
p { margin: 0 0 0.75rem; max-width: 46rem; }
.subtitle { color: var(--quiet); margin: 0.35rem 0 0; }
a { color: var(--accent); }
a:focus-visible, summary:focus-visible, .scroll:focus-visible { outline: 2px solid var(--accent); outline-offset: 2px; }
section { margin-top: 2.75rem; scroll-margin-top: 1rem; }
nav ul { display: flex; flex-wrap: wrap; gap: 0.2rem 1.1rem; list-style: none; margin: 1.25rem 0 0; padding: 0; }
nav { font-size: 0.9rem; }
.verdict {
  margin-top: 1.5rem; padding: 1.1rem 1.35rem 1.2rem; background: var(--card); border: 1px solid var(--line);
  border-left: 0.4rem solid var(--open); border-radius: 0.5rem;
}
.verdict p { margin: 0.3rem 0 0; max-width: 50rem; }
.verdict .headline { font-size: 1.2rem; line-height: 1.45; }
.verdict .word { color: var(--open); font-weight: 700; font-size: 0.85rem; letter-spacing: 0.03em; margin: 0; }
.verdict.good { border-left-color: var(--good); } .verdict.good .word { color: var(--good); }
.verdict.bad { border-left-color: var(--bad); } .verdict.bad .word { color: var(--bad); }
.scroll {
  overflow-x: auto; background: var(--card); border: 1px solid var(--line); border-radius: 0.5rem; margin: 0.75rem 0;
}
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: 0.925rem; }
caption { text-align: left; padding: 0.6rem 0 0.2rem; color: var(--quiet); font-size: 0.85rem; }
caption span { position: sticky; left: 0; display: inline-block; max-width: calc(100vw - 2.5rem); padding: 0 0.9rem; }
th, td { padding: 0.5rem 0.8rem; text-align: right; vertical-align: top; white-space: nowrap; }
thead th {
  font-size: 0.8rem; font-weight: 600; color: var(--quiet); vertical-align: bottom; line-height: 1.25;
  white-space: normal;
}
tbody tr { border-top: 1px solid var(--line); }
th:first-child { text-align: left; }
tbody th {
  position: sticky; left: 0; background: var(--card); font-weight: 500; white-space: normal; min-width: 12.5rem;
  max-width: 20rem; overflow-wrap: anywhere;
}
tr.own, tr.own > th { background: var(--own); } tr.own > th { font-weight: 700; }
tr.total > * { font-weight: 700; }
.interval { display: block; color: var(--quiet); font-size: 0.78rem; font-weight: 400; }
.unit { font-weight: 400; }
.chip {
  display: inline-block; border: 1px solid currentColor; border-radius: 0.6rem; padding: 0 0.5rem; font-size: 0.72rem;
  font-weight: 500; line-height: 1.45; color: var(--quiet); overflow-wrap: normal;
}
.heat { table-layout: fixed; border-collapse: separate; border-spacing: 3px; padding: 0 0.3rem 0.3rem; }
.heat th, .heat td { padding: 0; text-align: center; }
.heat thead th { padding: 0.4rem 0.2rem; overflow-wrap: normal; }
.heat th:first-child { width: 4.5rem; min-width: 0; padding-right: 0.5rem; text-align: right; }
.heat tbody th { vertical-align: middle; }
.shade { display: block; min-width: 3.6rem; padding: 0.3rem 0.3rem 0.4rem; border-radius: 0.25rem; line-height: 1.25; }
.shade b { display: block; font-size: 1rem; font-weight: 600; }
.shade i { font-style: normal; font-weight: 700; }
.shade small { display: block; font-size: 0.75rem; }
.shade.best { box-shadow: 0 0 0 2px var(--card), 0 0 0 5px #e69f00; position: relative; }
figure { margin: 0.75rem 0 1.25rem; }
picture {
  display: block; background: #fff; border: 1px solid var(--line); border-radius: 0.5rem; padding: 0.75rem;
}
img { display: block; width: 100%; height: auto; }
figcaption { color: var(--quiet); font-size: 0.875rem; margin-top: 0.4rem; max-width: 46rem; }
details { margin: 0.75rem 0; }
summary { cursor: pointer; color: var(--accent); }
dl { margin: 0.75rem 0 0; }
dl > div { display: grid; grid-template-columns: 11rem 1fr; gap: 0.25rem 1.25rem; padding: 0.5rem 0;
  border-top: 1px solid var(--line); }
dt { font-weight: 600; overflow-wrap: anywhere; }
dd { margin: 0; max-width: 42rem; min-width: 0; overflow-wrap: anywhere; }
@media (max-width: 700px) {
  body { padding: 1.25rem 1rem 3rem; }
  h1 { font-size: 1.45rem; }
  .verdict { padding: 0.9rem 1rem; }
  .verdict .headline { font-size: 1.08rem; }
  th, td { padding: 0.45rem 0.6rem; }
  tbody th { min-width: 7.5rem; max-width: 9.5rem; }
  picture { padding: 0.35rem; }
  .heat { border-spacing: 2px; }
  .heat thead th, .heat tbody th { padding: 0.3rem 0.15rem; }
  .heat th:first-child { width: 3.6rem; }
  .shade { min-width: 3rem; padding: 0.25rem 0.1rem; }
  dl > div { grid-template-columns: 1fr; gap: 0; }
}
@media print {
  body { max-width: none; padding: 0; } nav { display: none; }
  figure, tr, .verdict { break-inside: avoid; }
  .scroll { overflow: visible; }
}
"""
