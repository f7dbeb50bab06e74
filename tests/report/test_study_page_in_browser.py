"""The page of a study as a browser shows it, on a desk and a phone; needs Debian's ``chromium``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from chromium import Browser

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from made_up_study import EXPERTS, NOVICES, study
from reading import Page
from test_page_in_browser import (
    DESK,
    PHONE,
    SCREENS,
    check_can_be_read,
    check_fetches_nothing,
    check_fits,
)

from cutenv.report.study_page import study_headline, write_study
from cutenv.report.trainee_sheet import write_class_list, write_trainee_sheet
from cutenv.scoring.score_card import DISCLAIMER
from cutenv.scoring.study import Study

pytestmark = pytest.mark.needs("chromium")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of the made-up study."""
    path = tmp_path_factory.mktemp("study") / "study.html"
    write_study(path, study(target_group="expert"))
    return path


@pytest.fixture(scope="module")
def sheets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one sheet and the class list."""
    folder = tmp_path_factory.mktemp("sheets")
    of = study()
    write_trainee_sheet(folder, of, "N02", mark=50.0)
    write_class_list(folder, of, mark=50.0)
    return folder


@SCREENS
def test_the_page_fits_shows_its_pictures_and_can_be_read(browser: Browser, page: Path, width: int, dark: bool) -> None:
    browser.open(page, width, dark=dark)
    assert browser.value("document.title") == "Study: made up"
    check_fits(browser, width)
    check_fetches_nothing(browser, page)
    check_can_be_read(browser)
    shown = browser.value("[...document.images].map(i => [i.complete, i.clientWidth / i.naturalWidth])")
    assert len(shown) == 2 + 5  # groups, reliability, and five metrics cut by cut
    assert all(complete for complete, _ in shown)
    assert all(0.85 <= scale <= 1.25 for _, scale in shown if scale)  # what is folded has no width


@SCREENS
def test_sheets_and_class_list_fit_and_can_be_read(browser: Browser, sheets: Path, width: int, dark: bool) -> None:
    for name in ("N02.html", "class.html"):
        browser.open(sheets / name, width, dark=dark)
        check_fits(browser, width)
        check_fetches_nothing(browser, sheets / name)
        check_can_be_read(browser)
    assert browser.value("[...document.querySelectorAll('tbody a')].map(link => link.getAttribute('href'))") == [
        f"{code}.html" for code in (*NOVICES, *EXPERTS)
    ]


def test_a_sheet_shows_nobody_else(sheets: Path) -> None:
    document = (sheets / "N02.html").read_text(encoding="utf-8")
    assert "N02_16" in document
    assert not any(code in document for code in (*NOVICES, *EXPERTS) if code != "N02")


@pytest.mark.parametrize("width", [DESK, PHONE])
def test_what_is_folded_fits_too(browser: Browser, page: Path, width: int) -> None:
    browser.open(page, width)
    browser.value("document.querySelectorAll('details').forEach(part => part.open = true)")
    check_fits(browser, width)


def test_the_page_says_what_it_is_not(page: Path) -> None:
    read = Page(page.read_text(encoding="utf-8"))
    assert read.text.count(DISCLAIMER) >= 3
    assert study_headline(study()) in " ".join(read.text.split())
    assert "nan" not in read.text.lower().split()


def test_the_headline_counts_what_separates() -> None:
    of = study(metrics=("force_rate",))
    assert study_headline(of).startswith(
        "1 of 1 metrics distinguish novice from expert (95 % interval without 0.5). Larger in novice: force rate."
    )
    mixed = [replace(cut, group="odd" if int(cut.operator[-1]) % 2 else "even") for cut in of.cuts]
    assert "None of 1 metrics" in study_headline(Study(name="mixed", cuts=mixed, metrics=("force_rate",)))


def test_a_group_that_is_too_small_is_said_to_be(tmp_path: Path) -> None:
    of = study()
    few = Study(name="few", cuts=[cut for cut in of.cuts if cut.operator != "E04"])
    write_study(tmp_path / "few.html", few)
    read = " ".join(Page((tmp_path / "few.html").read_text(encoding="utf-8")).text.split())
    assert "Too few operators to say whether novice and expert differ beyond these people" in read
    assert "difference (5 and 3, of at least 4 in each)" in read


def test_without_groups_nothing_is_said_of_groups(tmp_path: Path) -> None:
    alone = Study(name="alone", cuts=[replace(cut, group="", session="") for cut in study().cuts])
    write_study(tmp_path / "alone.html", alone)
    read = Page((tmp_path / "alone.html").read_text(encoding="utf-8"))
    assert [text for level, text in read.headings if level == 2] == [
        "Metrics of these operators",
        "Reliability",
        "Cut by cut, operator by operator",
        "What the numbers mean",
    ]
