"""The page of pass marks as a browser shows it, on a desk and a phone, light and dark; needs Debian's ``chromium``."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from chromium import Browser

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from made_up_study import sawing
from reading import Page
from test_page_in_browser import DESK, PHONE, SCREENS, check_can_be_read, check_fetches_nothing, check_fits

from cutenv.report.pass_mark_page import pass_mark_headline, write_pass_mark_page
from cutenv.scoring import score
from cutenv.scoring.score_card import DISCLAIMER
from cutenv.scoring.study import StandardSetting, StudiedCut

pytestmark = pytest.mark.needs("chromium")


@pytest.fixture(scope="module")
def setting() -> StandardSetting:
    """Two cuts each of six novices and five experts, marked by two raters, and two metrics of them."""
    rng = np.random.default_rng(5)
    cuts = []
    for group, people, low, high in (("novice", 6, 0.45, 0.6), ("expert", 5, 0.15, 0.3)):
        for i in range(people):
            own = rng.uniform(low, high)
            for _ in range(2):
                card = score(sawing(own, rng))
                marks = {"a": 5.0 - card["force_rate"], "b": rng.normal()}
                cuts.append(StudiedCut(card=card, operator=f"{group[0].upper()}{i}", group=group, marks=marks))
    return StandardSetting(name="made up", cuts=cuts, passing="expert", metrics=("force_rate", "force_variation"))


@pytest.fixture(scope="module")
def page(setting: StandardSetting, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its page."""
    path = tmp_path_factory.mktemp("marks") / "marks.html"
    write_pass_mark_page(path, setting)
    return path


@SCREENS
def test_the_page_fits_shows_its_pictures_and_can_be_read(browser: Browser, page: Path, width: int, dark: bool) -> None:
    browser.open(page, width, dark=dark)
    assert browser.value("document.title") == "Pass marks: made up"
    check_fits(browser, width)
    check_fetches_nothing(browser, page)
    check_can_be_read(browser)
    shown = browser.value("[...document.images].map(i => [i.complete, i.clientWidth / i.naturalWidth])")
    assert len(shown) == 2 * 2 + 1  # curves and passes of two metrics, and the raters
    assert all(complete for complete, _ in shown)
    assert all(0.85 <= scale <= 1.25 for _, scale in shown if scale)  # what is folded has no width


@pytest.mark.parametrize("width", [DESK, PHONE])
def test_what_is_folded_fits_too(browser: Browser, page: Path, width: int) -> None:
    browser.open(page, width)
    browser.value("document.querySelectorAll('details').forEach(part => part.open = true)")
    check_fits(browser, width)


def test_the_page_says_what_it_found_and_what_it_is_not(page: Path, setting: StandardSetting) -> None:
    read = Page(page.read_text(encoding="utf-8"))
    assert read.text.count(DISCLAIMER) >= 3
    assert pass_mark_headline(setting) in " ".join(read.text.split())
    assert "nan" not in read.text.lower().split()
    assert [text for level, text in read.headings if level == 2] == [
        "Pass marks, method by method",
        "Proficiency",
        "Against the raters",
        "Sources of validity",
        "What the numbers mean",
    ]
