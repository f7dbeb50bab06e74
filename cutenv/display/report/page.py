"""Pages of results, self-contained files, in any language.

This module holds what they, their figures and their glossary share.

In another language every text of a finished page and of its figures is looked up among known phrases.  Figures are
drawn for a desktop screen and for a phone, loading matplotlib when drawn.

A phrase is English with places, such as ``{a_n} of {b_n} cuts succeeded.``: of a number if the name ends in n, of a
number with its unit if in q, of a name if in g, of codes, which stay, if in f, or else of any text within a sentence.
What stands in a place is looked up, too. Numbers get the language's decimal mark, and dates its order. A text that no
phrase fits, such as a person's code, stays as it is.
"""

from __future__ import annotations

import csv
import functools
import html
import io
import math
import re
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

from cutenv._base.document import as_base64, render
from cutenv._base.language_files import ENGLISH, languages, local_date, local_number, phrases_from_english
from cutenv._base.output import atomic_write
from cutenv._base.result_table import Reason
from cutenv.sim.quantities import ANGLE_TOLERANCE, FORCE_ALLOWED, LAG_ALLOWED, TIP_TOLERANCE
from cutenv.task.registry import TASKS
from cutenv.task.reward import REWARD, RewardWeights

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_TEMPLATES = Path(__file__).parent / "templates"
_ESTIMATE = re.compile(r"([-−+<\d., %]+) (\[[-−+<\d., %]+\])")


class EmbeddedFigure(NamedTuple):
    """Figure as a data address, with its size on the page [px].

    There are 96 px to an inch. A drawing has no ground of its own, and a dark page shows it with light and dark
    exchanged; photos stay as they are.
    """

    address: str
    width: int
    height: int
    kind: Literal["drawing", "photo"]


def write_page(
    path: Path, template: str | Path, *functions: Callable[..., Any], language: str = "en", **values: Any
) -> None:
    """Write a page atomically, from a template.

    The template extends ``page.html``: the name of one here, or the path of another. It has ``functions`` by their
    names, and the values.
    """
    values = {each.__name__: each for each in functions} | values
    translation = Translation(language)

    def embedded(figure: Figure) -> EmbeddedFigure:
        translation.figure(figure)
        return embedded_figure(figure)

    document = render(_TEMPLATES / template, values, folders=[_TEMPLATES], filters=_FILTERS | {"embedded": embedded})
    write_text(path, translation.page(document))


def write_text(path: Path, text: str) -> None:
    """Write a file of text atomically."""
    with atomic_write(path) as part:
        part.write_text(text, encoding="utf-8", newline="\n")


def write_table(path: Path, rows: Iterable[Sequence[object]]) -> None:
    """Write rows as CSV atomically, column names first; None is empty."""
    with atomic_write(path) as part, part.open("w", newline="", encoding="utf-8") as file:
        csv.writer(file, lineterminator="\n").writerows(rows)


def number(value: float, digits: int) -> str:
    """Return a number as printed, with a true minus sign unless zero."""
    shown = f"{value:.{digits}f}"
    if float(shown) == 0.0:
        shown = shown.removeprefix("-")
    return shown.replace("-", "\u2212")


def significant(value: float, digits: int) -> str:
    """Return so many significant digits as printed, and all before the point."""
    return "0" if value == 0.0 else number(value, max(0, digits - 1 - math.floor(math.log10(abs(value)))))


def spoken(name: str) -> str:
    """Return a program's name as words."""
    return name.replace("_", " ")


def estimate_text(mean: float, low: float, high: float, digits: int) -> str:
    """Return a mean with its interval, small in tables of pages."""
    return f"{number(mean, digits)} [{number(low, digits)}, {number(high, digits)}]"


def embedded_figure(figure: Figure) -> EmbeddedFigure:
    """Return a figure as a data address for a page."""
    drawing = io.BytesIO()
    kind: Literal["drawing", "photo"] = "photo" if any(axes.images for axes in figure.axes) else "drawing"
    figure.savefig(drawing, format="svg", metadata={"Date": None}, transparent=kind == "drawing")
    address = "data:image/svg+xml;base64," + as_base64(drawing.getvalue())
    width, height = 96.0 * figure.get_size_inches()
    return EmbeddedFigure(address, round(width), round(height), kind)


def _parted(text: str) -> tuple[str, str]:
    """Return value and interval of "-0.5 [-0.6, -0.4]" in print, or text and ""."""
    found = _ESTIMATE.fullmatch(text)
    return (found[1].replace("-", "−"), found[2].replace("-", "−")) if found else (text, "")


_FILTERS: dict[str, Callable[..., Any]] = {
    "number": number, "parted": _parted, "spoken": spoken, "is_reason": lambda cell: isinstance(cell, Reason),
}  # fmt: skip


_TAGS = re.compile(r"(<style>.*?</style>|<!--.*?-->|<(?!/?b>)[^>]*>)", re.DOTALL)
_NAMED = re.compile(r' (alt|aria-label)="([^"]*)"')
_NUMBERS = re.compile(r"[-−+<>=\d.,%\[\]() ]*\d[-−+<>=\d.,%\[\]() ]*")
_QUANTITY = re.compile(r"([-−<]? ?\d[\d.]*) ([A-Za-z/²%°·]+)")
_ANY = r"(?:(?![.!?]\)? +[A-Z(\"“\ue000\d]).)+?"  # within a sentence
_PLACES = {"g": r"[^,;.]+?", "n": r"[-−< ]*\d[\d.]*", "q": r"[-−< ]*\d[\d.]*(?: [A-Za-z/²%°·]+)?"}
_DATE = re.compile(r"(\d{4})-(\d\d)-(\d\d)(?:T(\d\d:\d\d)[\d:.+Z-]*)?")
_CODE = re.compile(r"[\w.:+-]*\d[\w.:+-]*")
_BOLD = ("\ue000", "\ue001")
_UNIT = re.compile(r"\[[^\]\d]+\]")
_WITH_UNIT = re.compile(r"(.+?)(\s)\[([^\]]+)\]")
_SENTENCES = re.compile(r"(?:(?<=[.!?])|(?<=\.\)))\s+(?=[A-Z(\"“\d\ue000])")
_PARTS = (re.compile(r"(?<=;)\s+"), re.compile(r"(?<=,)\s+"))


class Translation:
    """Translation of English pages."""

    def __init__(self, language: str) -> None:
        self.language = language
        self.left: list[str] = []
        self._phrases = {_bold(each): _bold(said) for each, said in phrases_from_english(language).items()}
        with_places = sorted((each for each in self._phrases if "{" in each), key=lambda each: -len(each))
        self._patterns = [(_pattern(each), self._phrases[each]) for each in with_places]

    def text(self, english: str) -> str:
        """Return a text in the language."""
        if self.language == ENGLISH or not english.strip():
            return english
        words = " ".join(english.split())
        found = self._known(words)
        if found is None:
            self.left.append(words)
        return words if found is None else found

    def page(self, document: str) -> str:
        """Return a page with texts, alternative texts and labels translated."""
        if self.language == ENGLISH:
            return document
        parts = _TAGS.split(document)
        parts[::2] = [self._between(part) for part in parts[::2]]
        parts[1::2] = [_NAMED.sub(self._named, part) for part in parts[1::2]]
        return "".join(parts).replace('<html lang="en">', f'<html lang="{self.language}">')

    def figure(self, figure: Figure) -> None:
        """Put the texts of a figure into the language."""
        if self.language == ENGLISH:
            return
        from matplotlib.text import Text

        for text in figure.findobj(Text):
            text.set_text("\n".join(self.text(line) for line in text.get_text().split("\n")))
        for axis in (axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)):
            axis.set_major_formatter(_translated(axis.get_major_formatter(), self))

    def _between(self, text: str) -> str:
        if not text.strip():
            return text
        before, after = text[: len(text) - len(text.lstrip())], text[len(text.rstrip()) :]
        said = html.escape(self.text(html.unescape(_bold(text.strip()))), quote=False)
        return before + said.replace(_BOLD[0], "<b>").replace(_BOLD[1], "</b>") + after

    def _named(self, found: re.Match[str]) -> str:
        return f' {found[1]}="{html.escape(self.text(html.unescape(found[2])))}"'

    def _known(self, words: str) -> str | None:
        """Return translated words, or None if they are not known."""
        if date := _DATE.fullmatch(words):
            year, month, day, clock = date.groups()
            return local_date(year, month, day, self.language) + (f", {clock}" if clock else "")
        if _NUMBERS.fullmatch(words):
            return local_number(words, self.language)
        if quantity := _QUANTITY.fullmatch(words):
            return f"{local_number(quantity[1], self.language)} {quantity[2]}"
        if _CODE.fullmatch(words) or _UNIT.fullmatch(words):
            return words
        before = len(self.left)
        said = self._phrase(words)
        if words[:1].isupper() and (said is None or len(self.left) > before):
            left = self.left[before:]
            del self.left[before:]
            within = self._phrase(words[:1].lower() + words[1:])
            if within is not None and (said is None or len(self.left) == before):
                said = within[:1].upper() + within[1:]
            else:
                self.left[before:] = left
        if said is None and (unit := _WITH_UNIT.fullmatch(words)) and (name := self._known(unit[1])) is not None:
            said = f"{name}{unit[2]}[{unit[3]}]"
        if said is None:
            said = self._sentences(_SENTENCES.split(words))
        for split in _PARTS:
            parts = split.split(words)
            if said is None and len(parts) > 1:
                known = [self._part(part) for part in parts]
                if None not in known:
                    said = " ".join(part for part in known if part is not None)
        return said

    def _sentences(self, sentences: list[str]) -> str | None:
        """Return translated sentences, as many as possible as one phrase."""
        if len(sentences) < 2:
            return None
        said = []
        while sentences:
            for count in range(len(sentences), 0, -1):
                found = self._part(sentences[0]) if count == 1 else self._phrase(" ".join(sentences[:count]))
                if found is not None:
                    break
            else:
                return None
            said.append(found)
            sentences = sentences[count:]
        return " ".join(said)

    def _part(self, words: str) -> str | None:
        """Return a part with the mark at its end."""
        found = self._known(words)
        if found is None and words[-1:] in ";,:.":
            found = self._known(words[:-1])
            return None if found is None else found + words[-1]
        return found

    def _phrase(self, words: str) -> str | None:
        """Return words translated by a phrase, best with known places."""
        if words in self._phrases:
            return self._phrases[words]
        fits: list[tuple[str, list[str]]] = []
        known = len(self.left)
        for pattern, said in self._patterns:
            if found := pattern.fullmatch(words):
                places = found.groupdict().items()
                text = said.format(**{k: each if k.endswith("_f") else self._place(each) for k, each in places})
                if len(self.left) == known:
                    return text
                fits.append((text, self.left[known:]))
                del self.left[known:]
        if words.endswith(".") and (text := self._phrase(words[:-1]) or "") and len(self.left) == known:
            return f"{text}."
        del self.left[known:]
        if not fits:
            return None
        self.left += fits[0][1]
        return fits[0][0]

    def _place(self, words: str) -> str:
        """Translate the words in a place of a phrase; keep chosen names."""
        found = self._part(words)
        if found is None and " " in words:
            self.left.append(words)
        return words if found is None else found


def in_languages(english: str) -> dict[str, str]:
    """Return a text in every language; unknown text stays English."""
    return {language: translated(english, language) for language in languages()}


def translated(english: str, language: str) -> str:
    """Return a text in a language; unknown text stays English."""
    translation = _translation(language)
    said = translation.text(english)
    translation.left.clear()  # it lives as long as the server that asks
    return said


@functools.lru_cache
def _translation(language: str) -> Translation:
    return Translation(language)


def _bold(text: str) -> str:
    return text.replace("<b>", _BOLD[0]).replace("</b>", _BOLD[1])


def _pattern(phrase: str) -> re.Pattern[str]:
    parts = re.split(r"{(\w+)}", phrase)
    places = (f"(?P<{part}>{_PLACES.get(part.partition('_')[2], _ANY)})" for part in parts[1::2])
    return re.compile("".join(re.escape(part) + next(places, "") for part in parts[::2]))


def _translated(form: Any, translation: Translation) -> Any:
    """Return a formatter of ticks that translates another's output."""
    from matplotlib.ticker import Formatter

    class Translated(Formatter):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return translation.text(form(x, pos))

        def set_locs(self, locs: Any) -> None:
            form.set_locs(locs)

    return Translated()


PHONE_WIDTH = 6.0
"""Width below which a figure is drawn for a phone [in]."""


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size [in]."""
    try:
        from matplotlib.figure import Figure  # an extra, and slow to import
    except ImportError as error:
        cure = "Pictures need matplotlib. Install it with: pip install 'cutenv[view]'"
        raise ModuleNotFoundError(cure, name="matplotlib") from error
    return Figure(figsize=(width, height), layout="constrained")


def write_figure(path: Path, figure: Figure, title: str = "") -> None:
    """Write a titled figure atomically, in the format of the suffix."""
    if title:
        figure.suptitle(label(title), fontsize=11)
    with atomic_write(path) as part:
        figure.savefig(part, dpi=130)


def label(text: str) -> str:
    """Return text with escaped dollar signs, which matplotlib shows unchanged."""
    return text.replace("$", r"\$")


def plain_axes(axes: Axes, grid: Literal["x", "y"] = "y") -> None:
    """Remove the box around the drawing; add grid lines across an axis."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis=grid, color="0.5", alpha=0.25, linewidth=0.8)  # seen on white and on dark ground
    axes.set_axisbelow(True)


_IDLE_COST = RewardWeights().time
"""Cost of doing nothing: the whole time."""


def term_meanings() -> dict[str, str]:
    """Return the title of each reward term, of every task."""
    return {one.name: one.title for one in (*REWARD, *(cost for task in TASKS.values() for cost in task.task.costs))}


def further_meanings(scores: Iterable[str]) -> list[tuple[str, str]]:
    """Return titles and meanings of scores beyond gentle cutting."""
    declared = {one.name: one.glossary for task in TASKS.values() for one in task.task.errors if one.glossary}
    return [declared[name] for name in scores if name in declared]


MEANINGS = (
    (
        "Return",
        "The rewards of one cut added up: what is gained by progress, accuracy and success, which comes to 1 for a "
        f"perfect cut, less what was not gentle. Doing nothing gets \u2212{_IDLE_COST:.2f}.",
    ),
    (
        "Success",
        "The share of cuts that ended unloaded, at rest or drawn back, with the crack tip within "
        f"{1e3 * TIP_TOLERANCE:g} mm of the target and the blade within {math.degrees(ANGLE_TOLERANCE):g} degrees of "
        "upright.",
    ),
    ("Tip error", "How far the crack tip is from the target at the end. The tip counts, not the blade, and is hidden."),
    (
        "Jump, uncontrolled share",
        "Tissue does not part evenly: when the force is high enough, the crack runs ahead by itself. A jump is the "
        "length of one such run; the uncontrolled share is the part of the whole cut made by them.",
    ),
    (
        "Force per depth",
        "The force on the blade divided by how deep the tissue is there. Thick tissue needs more force, so the force "
        f"alone would blame the tissue. Above {FORCE_ALLOWED:g} N/m it costs; at the force limit the cut is ended for "
        "safety.",
    ),
    ("Lag", f"How far the blade leads the crack tip, dragging tissue along; it costs above {1e3 * LAG_ALLOWED:g} mm."),
    ("Wedge", "What stays uncut below a blade that ends inclined: its edge leans ahead of its foot."),
    (
        "Held-out specimen",
        "A piece of tissue that was used neither to train nor to choose the agent. All policies cut the same ones.",
    ),
    (
        "95 % interval",
        "In brackets or as a line: from repeated evaluations on other specimens, about 95 of 100 such intervals would "
        "hold the true mean. It covers chance in the specimens, not in the training: this is one training run.",
    ),
    (
        "Paired difference",
        "Agent minus baseline on the same specimen, then averaged. Easy and hard specimens cancel, so it decides what "
        "two intervals side by side may leave open: a difference counts where its interval does not hold 0.",
    ),
    (
        "Upper bound",
        "A planner that knows the hidden tip and the tissue. No agent can know as much, so it is not a competitor: it "
        "shows how much there is to gain.",
    ),
)
"""Terms with their meanings, for a reader who did not write the task."""

LIMITS = (
    "The tissue is simulated. Its stiffness and its resistance to cutting are drawn from measured values of pig liver; "
    "friction, drive and sensor are partly assumed. Nothing here has been validated for assessing or credentialing "
    "people, for other tissue or for an operation, and one training run does not predict another."
)
"""Limits of the page's numbers."""
