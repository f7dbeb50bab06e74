"""A browser for the pages."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from scripts.browsers import chromium
from scripts.browsers.chromium import Browser


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One browser for all tests of pages."""
    with chromium.browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened
