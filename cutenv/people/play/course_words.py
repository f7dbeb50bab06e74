"""Words about a course, in each language of the class's pages."""

from __future__ import annotations

from cutenv._base.language_files import course_texts, shipped_names


def course_words(language: str, key: str, **values: object) -> str:
    """Return a sentence, a rule of feedback or the name of a metric, filled with values."""
    return course_texts(language).get(key, key.replace("_", " ")).format(**values)


def course_name(language: str, name: str) -> str:
    """Return the name of a course or a task in a language if it comes with cutenv; a teacher's own stays as it is."""
    return shipped_names(language).get(name, name)
