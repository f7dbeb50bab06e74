"""Pages in another language: every text of a finished page and of its figures is looked up among known phrases.

A phrase is English with places, such as ``{a_n} of {b_n} cuts succeeded.``: of a number if the name ends in n, of a
number with its unit if in q, of a name if in g, of a formula, which stays, if in f, or else of any text within a
sentence. What stands in a place is looked up, too. Numbers get the language's decimal mark. A text that no phrase fits,
such as a person's code, stays as it is.
"""

from __future__ import annotations

import html
import re
from typing import TYPE_CHECKING, Any

from cutenv._base.languages import phrases_from_english

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TAGS = re.compile(r"(<style>.*?</style>|<!--.*?-->|<(?!/?b>)[^>]*>)", re.DOTALL)
_NAMED = re.compile(r' (alt|aria-label)="([^"]*)"')
_NUMBERS = re.compile(r"[-−+<>=\d.,%\[\]() ]*\d[-−+<>=\d.,%\[\]() ]*")
_QUANTITY = re.compile(r"([-−<]? ?\d[\d.]*) ([A-Za-z/²%°·]+)")
_ANY = r"(?:(?![.!?]\)? +[A-Z(\"“\ue000\d]).)+?"  # within a sentence
_PLACES = {"g": r"[^,;.]+?", "n": r"[-−< ]*\d[\d.]*", "q": r"[-−< ]*\d[\d.]*(?: [A-Za-z/²%°·]+)?"}
_CODE = re.compile(r"[\w.:+-]*\d[\w.:+-]*")
_BOLD = ("\ue000", "\ue001")
_UNIT = re.compile(r"\[[^\]\d]+\]")
_WITH_UNIT = re.compile(r"(.+?)(\s)\[([^\]]+)\]")
_SENTENCES = re.compile(r"(?:(?<=[.!?])|(?<=\.\)))\s+(?=[A-Z(\"“\d\ue000])")
_PARTS = (re.compile(r"(?<=;)\s+"), re.compile(r"(?<=,)\s+"))


class Translation:
    """Translation of English pages.

    Parameters
    ----------
    language : {"en", "de"}
        Language of the result.

    Attributes
    ----------
    left : list of str
        Texts that no phrase fitted.
    """

    def __init__(self, language: str) -> None:
        self.language = language
        self.left: list[str] = []
        self._phrases = {_bold(each): _bold(said) for each, said in phrases_from_english(language).items()}
        with_places = sorted((each for each in self._phrases if "{" in each), key=lambda each: -len(each))
        self._patterns = [(_pattern(each), self._phrases[each]) for each in with_places]

    def text(self, english: str) -> str:
        """Return a text in the language."""
        if self.language == "en" or not english.strip():
            return english
        words = " ".join(english.split())
        found = self._known(words)
        if found is None:
            self.left.append(words)
        return words if found is None else found

    def page(self, document: str) -> str:
        """Return a page with its texts, alternative texts and labels in the language."""
        if self.language == "en":
            return document
        parts = _TAGS.split(document)
        parts[::2] = [self._between(part) for part in parts[::2]]
        parts[1::2] = [_NAMED.sub(self._named, part) for part in parts[1::2]]
        return "".join(parts).replace('<html lang="en">', f'<html lang="{self.language}">')

    def figure(self, figure: Figure) -> None:
        """Put the texts of a figure into the language."""
        if self.language == "en":
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
        """Return words in the language, or None if they are not known."""
        if _NUMBERS.fullmatch(words):
            return _german_number(words)
        if quantity := _QUANTITY.fullmatch(words):
            return f"{_german_number(quantity[1])} {quantity[2]}"
        if _CODE.fullmatch(words) or _UNIT.fullmatch(words):
            return words
        said = self._phrase(words)
        if said is None and words[:1].isupper() and (said := self._phrase(words[:1].lower() + words[1:])) is not None:
            said = said[:1].upper() + said[1:]
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
        """Return sentences in the language: as many as possible are taken for one phrase."""
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
        if words in self._phrases:
            return self._phrases[words]
        for pattern, said in self._patterns:
            if found := pattern.fullmatch(words):
                places = found.groupdict().items()
                return said.format(**{k: each if k.endswith("_f") else self._place(each) for k, each in places})
        return None

    def _place(self, words: str) -> str:
        """Return what stands in a phrase's place: names of people's own choice stay as they are."""
        found = self._known(words)
        if found is None and " " in words:
            self.left.append(words)
        return words if found is None else found


def _bold(text: str) -> str:
    """Return a text with single characters for its tags, which no text of a person holds."""
    return text.replace("<b>", _BOLD[0]).replace("</b>", _BOLD[1])


def _pattern(phrase: str) -> re.Pattern[str]:
    parts = re.split(r"{(\w+)}", phrase)
    places = (f"(?P<{part}>{_PLACES.get(part.partition('_')[2], _ANY)})" for part in parts[1::2])
    return re.compile("".join(re.escape(part) + next(places, "") for part in parts[::2]))


def _german_number(text: str) -> str:
    return re.sub(r"(?<=\d)\.(?=\d)", ",", text.replace(", ", "; "))


def _translated(form: Any, translation: Translation) -> Any:
    """Return a formatter of ticks that writes what another writes, in the language."""
    from matplotlib.ticker import Formatter

    class Translated(Formatter):
        def __call__(self, x: float, pos: int | None = None) -> str:
            return translation.text(form(x, pos))

        def set_locs(self, locs: Any) -> None:
            form.set_locs(locs)

    return Translated()
