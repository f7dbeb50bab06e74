"""The page of a scored cut as a browser shows it, on a desk and a phone; needs Debian's ``chromium``."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest
from chromium import Browser

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from recorded_cut import recorded_cut
from test_page_in_browser import SCREENS, check_can_be_read, check_fetches_nothing, check_fits

from cutenv.report.score_page import ScoredRecord, write_score_page, write_summary
from cutenv.scoring import ReferenceSet, score
from cutenv.scoring.score_card import DISCLAIMER

pytestmark = pytest.mark.needs("chromium")

HOSTILE = "<script>document.title='taken'</script>"


def scored(name: str, length: float) -> ScoredRecord:
    trace = recorded_cut("liver", speed=0.0127, turns=(length, 0.0)).trace
    trace = dataclasses.replace(trace, metadata={"name": name})
    card = score(trace, target_length=0.06, reference=ReferenceSet.shipped())
    return ScoredRecord(trace=trace, card=card, target_length=0.06)


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a cut that went too far."""
    path = tmp_path_factory.mktemp("score") / "score.html"
    write_score_page(path, scored(HOSTILE, 0.08))
    return path


@SCREENS
def test_the_page_fits_shows_its_picture_and_can_be_read(browser: Browser, page: Path, width: int, dark: bool) -> None:
    browser.open(page, width, dark=dark)
    assert browser.value("document.title") == f"Score: {HOSTILE}"
    check_fits(browser, width)
    check_fetches_nothing(browser, page)
    check_can_be_read(browser)
    shown = browser.value("[...document.images].map(i => [i.complete, i.clientWidth / i.naturalWidth])")
    assert len(shown) == 1
    assert all(complete and 0.85 <= scale <= 1.25 for complete, scale in shown)
    text = browser.value("document.body.innerText")
    assert "mm too far" in text
    assert "slow down earlier" in text
    assert DISCLAIMER in text


def test_the_summary_leads_to_every_page(browser: Browser, tmp_path: Path) -> None:
    records = [(scored(f"cut {n}", length), f"cut_{n}.html") for n, length in enumerate((0.05, 0.08))]
    _, summary = write_summary(tmp_path, records)
    browser.open(summary, 1400, dark=False)
    links = browser.value("[...document.querySelectorAll('td a, th a')].map(a => a.getAttribute('href'))")
    assert links == ["cut_0.html", "cut_1.html"]
    assert DISCLAIMER in browser.value("document.body.innerText")
