"""Documents of one file, filled from Jinja2 templates; and texts of pages: one file for each language."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

_TEMPLATES = Path(__file__).parent / "templates"


def render(
    template: Path,
    values: Mapping[str, Any],
    *,
    folders: Sequence[Path] = (),
    filters: Mapping[str, Callable[..., Any]] | None = None,
) -> str:
    """Return a template filled with values: text is escaped, and a name that is missing is an error.

    Parameters
    ----------
    template : Path
        Template, which may extend ``document.html``: a document that loads nothing else.
    values : mapping of str to object
        Values by the names that the template has for them.
    folders : sequence of Path
        Folders of further templates; they and the template's own are searched first.
    filters : mapping of str to callable, optional
        Filters for the template's expressions.

    Raises
    ------
    ImportError
        If Jinja2 is not installed; the message gives the command that installs it.
    """
    try:
        import jinja2  # an extra
    except ImportError as error:
        cure = "Pages need Jinja2. Install it with: pip install 'cutenv[view]'"
        raise ModuleNotFoundError(cure, name="jinja2") from error
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([template.parent, *folders, _TEMPLATES]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(filters or {})
    return environment.get_template(template.name).render(values)


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
