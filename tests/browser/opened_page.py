"""The page that cuts, opened in a browser: waits, begins a cut, and is looked at as on a telephone."""

from __future__ import annotations

import time
from pathlib import Path

from scripts.browsers import chromium, firefox

Browser = chromium.Browser | firefox.Browser


def wait(page: Browser, condition: str) -> None:
    until = time.monotonic() + chromium.PATIENCE_S
    while not page.value(condition):
        assert time.monotonic() < until, condition
        time.sleep(0.05)


def start(page: Browser, below: float = 60.0) -> tuple[float, float]:
    """Press Start and wait for the countdown; a place in the picture, ``below`` its upper edge [px]."""
    page.value("document.getElementById('start').click()")
    wait(page, "cutenvPage.page.phase === 'cutting'")
    left, top = page.value("(r => [r.left, r.top])(document.getElementById('picture').getBoundingClientRect())")
    return left + 60, top + below


def open_on_telephone(browser: Browser, written: Path, language: str, dark: bool) -> None:
    """Open the page on a narrow screen, in a language; it fits, and can be read."""
    browser.open(written, 400, dark=dark)
    wait(browser, "window.cutenvPage !== undefined")
    chosen = f"e.value = '{language}'; e.dispatchEvent(new Event('change'));"
    browser.value(f"(e => {{ {chosen} }})(document.getElementById('language'))")
    fits_and_can_be_read(browser)


def fits_and_can_be_read(browser: Browser) -> None:
    assert browser.value("document.documentElement.scrollWidth") <= 400
    assert browser.value(chromium.LEAST_CONTRAST) >= 4.5
