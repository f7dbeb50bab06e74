"""The page that cuts, opened in a browser: waits, begins a cut, and is looked at as on a telephone."""

from __future__ import annotations

import time
from collections.abc import Callable
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


def steps() -> Callable[[], float]:
    """Steps of a hand that is as fast on a slow machine [px]."""
    last = [time.monotonic()]

    def step() -> float:
        now = time.monotonic()
        taken, last[0] = now - last[0], now
        return min(max(60.0 * taken, 1.0), 15.0)

    return step


def by_mouse(page: Browser, x: float, y: float) -> Callable[[int], None]:
    at, step = [x], steps()
    page.move_mouse(x, y)

    def lead(way: int) -> None:
        at[0] += step() * way
        page.move_mouse(at[0], y)

    return lead


def by_finger(page: Browser, x: float, y: float) -> Callable[[int], None]:
    step = steps()

    def lead(way: int) -> None:
        length = step()
        if way:
            page.stroke([(x, y), (x + length * way, y)])

    return lead


def by_keys(page: Browser, _x: float, _y: float) -> Callable[[int], None]:
    held: list[str] = []

    def lead(way: int) -> None:
        wanted = [{1: "ArrowRight", -1: "ArrowLeft"}[way]] if way else []
        if held != wanted:
            for key in held:
                page.release(key)
            for key in wanted:
                page.press(key)
            held[:] = wanted

    return lead


def lead_to_the_end(page: Browser, lead: Callable[[int], None]) -> None:
    """Lead a cut to its target, back until little pulls, and rest until it ends."""
    way = 1
    while True:
        now = "(({ phase, cut }) => [phase, cut.target - cut.tip, cut.last('force')])(cutenvPage.page)"
        phase, left, force = page.value(now)
        if phase != "cutting":
            break
        way = 1 if way == 1 and left > 0.001 else -1 if force > 0.2 else 0
        lead(way)


def open_on_telephone(browser: Browser, written: Path, language: str, dark: bool) -> None:
    """Open the page on a narrow screen, in a language; it fits, and can be read."""
    browser.open(written, 400, dark=dark)
    wait(browser, "window.cutenvPage !== undefined")
    chosen = f"e.value = '{language}'; e.dispatchEvent(new Event('change'));"
    browser.value(f"(e => {{ {chosen} }})(document.getElementById('language'))")
    fits_and_can_be_read(browser)


def fits_and_can_be_read(browser: Browser, width: int = 400) -> None:
    assert browser.value("document.documentElement.scrollWidth") <= width
    assert browser.value(chromium.LEAST_CONTRAST) >= 4.5
