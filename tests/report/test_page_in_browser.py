"""The page as a browser shows it, on a desk and a phone, light and dark; needs Debian's ``chromium``."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from chromium import LEAST_CONTRAST, Browser

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from made_up_result import result

from cutenv.report import write_training_page

pytestmark = pytest.mark.needs("chromium")

DESK, PHONE = 1400, 390
SCREENS = pytest.mark.parametrize(
    ("width", "dark"), [(DESK, False), (DESK, True), (PHONE, False), (PHONE, True)], ids=lambda value: str(value)
)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the made-up result."""
    path = tmp_path_factory.mktemp("run") / "report.html"
    write_training_page(path, result())
    return path


def check_fits(browser: Browser, width: int) -> None:
    """The window is as wide as asked for, nothing but a table scrolls sideways, and no table's row has a gap."""
    assert browser.value("innerWidth") == width
    assert browser.value("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    widths = "[...document.querySelectorAll('table')].map(t => new Set([...t.rows].map(r => r.cells.length)).size)"
    assert set(browser.value(widths)) == {1}


def check_pictures_show(browser: Browser) -> None:
    """All five pictures are there, drawn for this kind of screen, as large as the page has room for."""
    shown = browser.value("[...document.images].map(i => [i.complete, i.naturalWidth, i.clientWidth / i.naturalWidth])")
    assert len(shown) == 5
    for complete, natural, scale in shown:
        assert complete
        assert natural > 0
        assert 0.85 <= scale <= 1.25, "letters too small to read, or too large"


def check_fetches_nothing(browser: Browser, page: Path) -> None:
    """The browser asked for the file alone, and had nothing to refuse."""
    assert [address for address in browser.requests() if not address.startswith("data:")] == [page.as_uri()]
    assert browser.complaints() == []


def check_can_be_read(browser: Browser) -> None:
    """All text stands out from what is below it."""
    assert browser.value(LEAST_CONTRAST) >= 4.5


@SCREENS
def test_the_page_fits_shows_its_pictures_and_can_be_read(browser: Browser, page: Path, width: int, dark: bool) -> None:
    browser.open(page, width, dark=dark)
    assert browser.value("document.title") == "Gentle cutting with PPO"
    check_fits(browser, width)
    check_pictures_show(browser)
    check_fetches_nothing(browser, page)
    check_can_be_read(browser)


def test_pictures_are_dark_where_dark_is_wanted_and_white_in_print(browser: Browser, page: Path) -> None:
    ground = "getComputedStyle(document.querySelector('picture')).backgroundColor"
    turned = "getComputedStyle(document.images[0]).filter"
    browser.open(page, DESK, dark=True)
    assert browser.value(ground) == "rgb(27, 33, 40)"
    assert browser.value(turned).startswith("invert(1)")
    browser.tell("Emulation.setEmulatedMedia", media="print")
    try:
        assert browser.value(ground) == "rgb(255, 255, 255)"
        assert browser.value(turned) == "none"
    finally:
        browser.tell("Emulation.setEmulatedMedia", media="")


def test_what_is_folded_fits_a_phone_too(browser: Browser, page: Path) -> None:
    browser.open(page, PHONE)
    assert browser.value("document.querySelectorAll('details').forEach(part => part.open = true)") is None
    check_fits(browser, PHONE)


def test_a_long_name_fits_a_phone_too(browser: Browser, tmp_path: Path, page: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text(page.read_text(encoding="utf-8").replace("PPO", "PPO" * 40), encoding="utf-8")
    browser.open(path, PHONE)
    check_fits(browser, PHONE)


def test_a_screenshot_is_dark_where_dark_is_wanted(browser: Browser, page: Path, tmp_path: Path) -> None:
    from matplotlib.image import imread

    brightness = {}
    for dark in (False, True):
        browser.open(page, DESK, dark=dark)
        browser.screenshot(tmp_path / "page.png")
        brightness[dark] = float(imread(tmp_path / "page.png")[:400, :, :3].mean())
    assert brightness[True] < 0.25
    assert brightness[False] > 0.85


@pytest.mark.parametrize(
    ("found", "instead", "check"),
    [
        ("</main>", '<div style="width:500px">wide</div></main>', lambda browser, _: check_fits(browser, PHONE)),
        ("</td></tr>", "</td><td></td></tr>", lambda browser, _: check_fits(browser, PHONE)),
        ("base64,PHN2|base64,PD94", "base64,AAAA", lambda browser, _: check_pictures_show(browser)),
        (r"<source[^>]*>", "", lambda browser, _: check_pictures_show(browser)),
        ("</main>", '<img src="http://127.0.0.1:9/a.png" alt=""></main>', check_fetches_nothing),
        ("--quiet: #57606a", "--quiet: #aab0b6", lambda browser, _: check_can_be_read(browser)),
    ],
    ids=["too wide", "ragged table", "damaged pictures", "desk's pictures on a phone", "a fetch", "pale text"],
)
def test_a_broken_page_is_noticed(
    browser: Browser, page: Path, tmp_path: Path, found: str, instead: str, check: Callable[[Browser, Path], None]
) -> None:
    document = page.read_text(encoding="utf-8")
    broken = re.sub(found, instead, document)
    assert broken != document
    path = tmp_path / "broken.html"
    path.write_text(broken, encoding="utf-8")
    browser.open(path, PHONE)
    with pytest.raises(AssertionError):
        check(browser, path)
