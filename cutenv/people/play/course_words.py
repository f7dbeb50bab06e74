"""Words about a course, in each language of the class's pages."""

from __future__ import annotations

from cutenv._base.language_files import course_texts, shipped_names


def course_words(language: str, key: str, **values: object) -> str:
    """Return a translated sentence, feedback rule or metric name with values."""
    return course_texts(language).get(key, key.replace("_", " ")).format(**values)


def course_name(language: str, name: str) -> str:
    """Return a packaged course's or task's name translated, others unchanged."""
    return shipped_names(language).get(name, name)
