"""Texts of pages: one file for each language."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

LANGUAGES = ("en", "de")
"""Languages of pages."""
_TEXTS = Path(__file__).parent / "texts"
_PHRASES = "phrases"


@lru_cache
def _file(language: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((_TEXTS / f"texts.{language}.json").read_text(encoding="utf-8"))
    return content


def texts_by_key(language: str) -> dict[str, str]:
    """Return the texts of the pages that cut and of the class, by key."""
    return {key: text for key, text in _file(language).items() if key != _PHRASES}


def phrases_from_english(language: str) -> Mapping[str, str]:
    """Return phrases of pages that are written in English, by the English one; {} for English itself."""
    phrases: Mapping[str, str] = _file(language).get(_PHRASES, {})
    return phrases
