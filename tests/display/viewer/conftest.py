"""A browser with 3-D graphics in software, for every page of the viewer."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from scripts.browsers import chromium


@pytest.fixture(scope="session")
def opened_with_graphics(tmp_path_factory: pytest.TempPathFactory) -> Iterator[chromium.Browser]:
    """One for all of these tests; to start it takes seconds."""
    with chromium.browser(tmp_path_factory.mktemp("profile"), graphics=True) as opened:
        yield opened


@pytest.fixture(scope="module")
def browser(opened_with_graphics: chromium.Browser) -> Iterator[chromium.Browser]:
    """The browser, which keeps its page for the next test of a file and leaves it then."""
    yield opened_with_graphics
    opened_with_graphics.leave()
