"""Languages of pages, one file each: texts, phrases, numbers and dates."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping
from datetime import datetime
from functools import lru_cache
from pathlib import Path
from typing import Any

ENGLISH = "en"  # language in which phrases are written in the code; what another one lacks stays in it
FOLDER_VARIABLE = "CUTENV_LANGUAGES"  # environment variable: a folder of further language files
_SHIPPED = Path(__file__).parent / "languages"
_CODE = re.compile(r"[a-z]{2,3}(-[A-Za-z]{2,4})?")
_PLACE = re.compile(r"{\w+}")
_FORMS, _COURSE, _NAMES, _PHRASES = "numbers_and_dates", "words_about_courses", "names", "phrases"
_SECTIONS = (_FORMS, _COURSE, _NAMES, _PHRASES)


def languages() -> tuple[str, ...]:
    """Return the codes of all languages, English first."""
    return tuple(sorted(_paths(), key=lambda code: (code != ENGLISH, code)))


def texts_by_key(language: str) -> dict[str, str]:
    """Return texts of cutting and class pages by key."""
    return _texts(ENGLISH) | _texts(language)


def course_texts(language: str) -> Mapping[str, str]:
    """Return course sentences, feedback rules and metric names, by key."""
    return {**_section(ENGLISH, _COURSE), **_section(language, _COURSE)}


def shipped_names(language: str) -> Mapping[str, str]:
    """Return names of shipped courses and tasks by English name."""
    return _section(language, _NAMES)


def phrases_from_english(language: str) -> Mapping[str, str]:
    """Return page phrases by English phrase; {} for English."""
    return _section(language, _PHRASES)


def local_number(text: str, language: str) -> str:
    """Return numbers written with a language's decimal and range marks."""
    forms = _forms(language)
    return re.sub(r"(?<=\d)\.(?=\d)", lambda _: forms["decimal"], text.replace(", ", f"{forms['list']} "))


def local_date(year: str, month: str, day: str, language: str) -> str:
    """Return a date in the order of a language."""
    return _forms(language)["date"].format(year=year, month=month, day=day)


def local_moment(moment: datetime, language: str) -> str:
    """Return a local time as shown in a language."""
    here = moment.astimezone()
    return f"{local_date(f'{here:%Y}', f'{here:%m}', f'{here:%d}', language)}, {here:%H:%M}"


def missing_texts(language: str) -> list[str]:
    """Return keys, phrases and names missing from a language's file."""
    others = [code for code in languages() if code not in (ENGLISH, language)]
    lacking = [key for key in _texts(ENGLISH) if key not in _texts(language)]
    if language == ENGLISH:
        return []
    for section in _SECTIONS:
        known = dict.fromkeys(key for code in (ENGLISH, *others) for key in _section(code, section))
        there = _section(language, section)
        lacking += [f"{section}: {key}" for key in known if key not in there]
    return lacking


def _forms(language: str) -> Mapping[str, str]:
    return {**_section(ENGLISH, _FORMS), **_section(language, _FORMS)}


def _texts(language: str) -> dict[str, str]:
    return {key: text for key, text in _content(language).items() if key not in _SECTIONS}


def _section(language: str, name: str) -> Mapping[str, str]:
    section: Mapping[str, str] = _content(language).get(name, {})
    return section


def _paths() -> dict[str, Path]:
    return _found(os.environ.get(FOLDER_VARIABLE, ""))


@lru_cache
def _found(further: str) -> dict[str, Path]:
    """Return language files, further folders replacing shipped ones."""
    folders = [_SHIPPED, *([Path(further)] if further else [])]
    return {path.stem: path for folder in folders for path in folder.glob("*.json") if _CODE.fullmatch(path.stem)}


def _content(language: str) -> dict[str, Any]:
    paths = _paths()
    if language not in paths:
        raise ValueError(f"there is no language {language!r}. Choose one of {', '.join(languages())}.")
    return _checked(paths[language])


@lru_cache
def _checked(path: Path) -> dict[str, Any]:
    """Return a checked file's content; ValueError names file and key."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: it is no JSON in UTF-8: {error}.") from None
    if not isinstance(content, dict):
        raise ValueError(f"{path}: it must hold texts by key, {{...}}.")
    english = content if path == _SHIPPED / f"{ENGLISH}.json" else _checked(_SHIPPED / f"{ENGLISH}.json")
    for key, text, source in _entries(content, english):
        if not isinstance(text, str):
            raise ValueError(f"{path}: {key} = {text!r} is no text.")
        unknown = set(_PLACE.findall(text)) - set(_PLACE.findall(source if isinstance(source, str) else text))
        if unknown:
            places = ", ".join(sorted(unknown))
            raise ValueError(f"{path}: {key}: {places} does not stand in the English text {source!r}.")
    return content


def _entries(content: Mapping[str, Any], english: Mapping[str, Any]) -> Iterator[tuple[str, Any, Any]]:
    """Yield each entry's name, text and English text."""
    for key, text in content.items():
        if key not in _SECTIONS:
            yield key, text, english.get(key)
            continue
        entries = text if isinstance(text, dict) else {"": text}
        sources = english.get(key, {}) if key in (_FORMS, _COURSE) else {each: each for each in entries}
        yield from ((f"{key}: {each}", said, sources.get(each)) for each, said in entries.items())
