"""The page that cuts is tested in both browsers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from opened_page import Browser, wait

from scripts.browsers import firefox

BROWSERS = [pytest.param(name, marks=pytest.mark.needs(name.lower())) for name in ("Chromium", "Firefox")]


@pytest.fixture(scope="session", params=BROWSERS)
def opened(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """One browser of each kind for every test of the page."""
    if request.param == "Chromium":
        yield request.getfixturevalue("opened_chromium")
        return
    pytest.importorskip("websockets", reason="talks to Firefox in the tests: pip install 'cutenv[dev]'")
    with firefox.browser(tmp_path_factory.mktemp("profile")) as firefox_opened:
        yield firefox_opened


@pytest.fixture
def browser(opened: Browser) -> Iterator[Browser]:
    """The browser, which leaves the page after the test."""
    yield opened
    opened.leave()


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page of one specimen of each class."""
    pytest.importorskip("jinja2", reason="pages are an extra: pip install 'cutenv[view]'")
    from cutenv.people.browser import write_page_alone

    path = tmp_path_factory.mktemp("page") / "cut.html"
    write_page_alone(path, count=1)
    return path


@pytest.fixture
def page(browser: Browser, written: Path) -> Iterator[Browser]:
    """The page that the module has written, which loads nothing else and has no error."""
    browser.open(written, 1100)
    wait(browser, "Boolean(window.cutenvPage?.page?.cut)")
    yield browser
    assert browser.errors() == []
    assert browser.complaints() == []
    assert [asked for asked in browser.requests() if not asked.startswith(("file:", "blob:", "data:"))] == []
