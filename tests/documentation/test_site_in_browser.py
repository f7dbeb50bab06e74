"""The site in a browser, opened from disk: nothing is fetched, the search finds, and no page is wider than a phone."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from scripts.browsers import chromium

pytest.importorskip("mkdocs", reason="the site needs an extra: pip install 'cutenv[docs]'")
pytestmark = pytest.mark.needs("chromium")

PAGES = (
    "index.html",
    "concepts/cutting-law.html",
    "environments/gentle-cut.html",
    "reference/api/agents.policy.html",
    "results/leaderboard.html",
)
SEARCH = """(() => {
  const field = document.querySelector(".md-search__input");
  field.focus();
  field.value = "%s";
  field.dispatchEvent(new KeyboardEvent("keyup", {bubbles: true}));
})()"""
FOUND = """[...document.querySelectorAll(".md-search-result__link")].map(link => link.getAttribute("href")).join(" ")"""
PATIENCE_S = 20.0


@pytest.mark.parametrize("page", PAGES)
def test_a_page_fetches_nothing_and_fits_a_phone(browser: chromium.Browser, site: Path, page: str) -> None:
    assert (site / page).is_file()
    browser.open(site / page, 400, dark=True)
    assert browser.value("document.documentElement.scrollWidth") <= 400
    assert not [address for address in browser.requests() if not address.startswith(("file:", "data:", "blob:"))]
    assert browser.complaints() == []
    assert browser.errors() == []


@pytest.mark.parametrize(
    ("word", "page"),
    [
        ("backlash", "reference/constants.html"),
        ("licence", "reference/licences.html"),
        ("hyperparameters", "how-to/own-reward.html"),
    ],
)
def test_the_search_finds_without_a_server(browser: chromium.Browser, site: Path, word: str, page: str) -> None:
    browser.open(site / "index.html", 1280)
    browser.value(SEARCH % word)
    until = time.monotonic() + PATIENCE_S
    while not (found := browser.value(FOUND)) and time.monotonic() < until:
        time.sleep(0.1)
    assert page in found
