"""Pages of results, each a self-contained file that opens anywhere, and what the pages and their figures share."""

from __future__ import annotations

import base64
import csv
import io
import math
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from cutenv._base.atomic_file import atomic_write
from cutenv._base.document import render
from cutenv.report.translation import Translation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TEMPLATES = Path(__file__).parent / "templates"
_ESTIMATE = re.compile(r"([-−+<\d., %]+) (\[[-−+<\d., %]+\])")


class EmbeddedFigure(NamedTuple):
    """Figure as an address that holds its drawing, and its size on the page [px], 96 to an inch.

    A drawing has no ground of its own, and a dark page shows it with light and dark exchanged; photos stay as they are.
    """

    address: str
    width: int
    height: int
    kind: Literal["drawing", "photo"]


def write_page(path: Path, template: str | Path, *, language: str = "en", **values: Any) -> None:
    """Write a page as a whole or not at all.

    Parameters
    ----------
    path : Path
        Path of the page (.html), in a folder that exists.
    template : str or Path
        Template that extends ``page.html``: the name of one beside it, or the path of another.
    language : {"en", "de"}
        Language of the page.
    values : object
        Values by the names that the template has for them.

    Raises
    ------
    ImportError
        If Jinja2 or, for a page with figures, matplotlib is not installed; the message gives the command that
        installs it.
    """
    translation = Translation(language)

    def embedded(figure: Figure) -> EmbeddedFigure:
        translation.figure(figure)
        return _embedded(figure)

    document = render(_TEMPLATES / template, values, folders=[_TEMPLATES], filters=_FILTERS | {"embedded": embedded})
    write_text(path, translation.page(document))


def write_text(path: Path, text: str) -> None:
    """Write a file of text as a whole or not at all."""
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def write_table(path: Path, rows: Iterable[Sequence[object]]) -> None:
    """Write rows as CSV, as a whole or not at all: the first names the columns, None is an empty cell."""
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def number(value: float, digits: int) -> str:
    """Return a number in print typography: a true minus sign, and none before a zero."""
    shown = f"{value:.{digits}f}"
    if float(shown) == 0.0:
        shown = shown.removeprefix("-")
    return shown.replace("-", "\u2212")


def significant(value: float, digits: int) -> str:
    """Return so many significant digits in print typography, and those before the point; a zero is "0"."""
    return "0" if value == 0.0 else number(value, max(0, digits - 1 - math.floor(math.log10(abs(value)))))


def spoken(name: str) -> str:
    """Return a program's name as words."""
    return name.replace("_", " ")


def estimate_text(mean: float, low: float, high: float, digits: int) -> str:
    """Return a mean with its interval; tables of pages show the interval in small type."""
    return f"{number(mean, digits)} [{number(low, digits)}, {number(high, digits)}]"


def _embedded(figure: Figure) -> EmbeddedFigure:
    drawing = io.BytesIO()
    kind: Literal["drawing", "photo"] = "photo" if any(axes.images for axes in figure.axes) else "drawing"
    figure.savefig(drawing, format="svg", metadata={"Date": None}, transparent=kind == "drawing")
    address = "data:image/svg+xml;base64," + base64.b64encode(drawing.getvalue()).decode("ascii")
    width, height = 96.0 * figure.get_size_inches()
    return EmbeddedFigure(address, round(width), round(height), kind)


def _parted(text: str) -> tuple[str, str]:
    """Return value and interval of a text such as "-0.5 [-0.6, -0.4]", with minus signs as in print; or text and ""."""
    found = _ESTIMATE.fullmatch(text)
    return (found[1].replace("-", "−"), found[2].replace("-", "−")) if found else (text, "")


_FILTERS: dict[str, Callable[..., Any]] = {"number": number, "parted": _parted, "spoken": spoken}
