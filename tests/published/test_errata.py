"""The errata of the thesis are kept with its tables, and every one is shown by a test."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from cutenv.tissue.tables import errata

TESTS = Path(__file__).parents[1]
NAMED = {
    words
    for file in TESTS.rglob("test_*.py")
    for words in re.findall(r'any\("([^"]+)" in erratum for erratum in', file.read_text(encoding="utf-8"))
}


def check_shown(erratum: str) -> None:
    """Some test quotes it."""
    assert any(words in erratum for words in NAMED)


@pytest.mark.parametrize("erratum", [text for _, text in errata()])
def test_every_erratum_is_quoted_by_a_test_that_shows_it(erratum):
    check_shown(erratum)


def test_an_erratum_without_a_test_is_noticed():
    with pytest.raises(AssertionError):
        check_shown("Section 9.9 has a misprint.")
