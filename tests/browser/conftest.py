"""The page that cuts is tested in both browsers."""

from __future__ import annotations

from collections.abc import Iterator

import chromium
import firefox
import pytest

Browser = chromium.Browser | firefox.Browser


BROWSERS = [pytest.param(name, marks=pytest.mark.needs(name.lower())) for name in ("Chromium", "Firefox")]


@pytest.fixture(scope="session", params=BROWSERS)
def browser(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One browser of each kind for every test of the page."""
    if request.param == "Firefox":
        pytest.importorskip("websockets", reason="talks to Firefox in the tests: pip install 'cutenv[dev]'")
    driver = {"Chromium": chromium, "Firefox": firefox}[request.param]
    with driver.browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened
