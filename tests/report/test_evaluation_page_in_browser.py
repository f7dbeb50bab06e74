"""The page of an evaluation as a browser shows it, on a desk and a phone; needs Debian's ``chromium``."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from chromium import Browser

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from compared_cuts import made_up_agreement
from reading import Page
from test_page_in_browser import DESK, PHONE, SCREENS, check_can_be_read, check_fetches_nothing, check_fits

from cutenv.sim_to_real import ClockKept
from cutenv.sim_to_real.evaluation_page import evaluation_headline, write_evaluation
from cutenv.sim_to_real.evaluation_result import UNPAIRED, Evaluation

pytestmark = pytest.mark.needs("chromium")


def evaluation(**of_rig: object) -> Evaluation:
    """A made-up one, its clock late now and then."""
    rng = np.random.default_rng(1)
    periods = 0.020 + 0.0002 * rng.standard_normal(4000)
    clock = ClockKept.of(0.020, [(periods, np.abs(0.002 * rng.standard_normal(4000)), 7, 0.05, 1)])
    return Evaluation(
        policy="a <script>", rig="bench 2", specimen_class="liver", seed=3, clock=clock,
        agreement=made_up_agreement(specimens=14, **of_rig),  # type: ignore[arg-type]
    )  # fmt: skip


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a rig that differs."""
    path = tmp_path_factory.mktemp("evaluation") / "evaluation.html"
    write_evaluation(path, evaluation(offset=0.3))
    return path


@SCREENS
def test_the_page_fits_shows_its_pictures_and_can_be_read(browser: Browser, page: Path, width: int, dark: bool) -> None:
    browser.open(page, width, dark=dark)
    assert browser.value("document.title") == "a <script> on bench 2 and in the simulator"
    check_fits(browser, width)
    check_fetches_nothing(browser, page)
    check_can_be_read(browser)
    shown = browser.value("[...document.images].map(i => [i.complete, i.clientWidth / i.naturalWidth])")
    assert len(shown) == 3  # differences, force, clock
    assert all(complete and 0.85 <= scale <= 1.25 for complete, scale in shown)


@pytest.mark.parametrize("width", [DESK, PHONE])
def test_what_is_folded_fits_too(browser: Browser, page: Path, width: int) -> None:
    browser.open(page, width)
    browser.value("document.querySelectorAll('details').forEach(part => part.open = true)")
    check_fits(browser, width)


def test_the_page_says_verdict_margins_and_lateness(page: Path) -> None:
    read = " ".join(Page(page.read_text(encoding="utf-8")).text.split())
    assert evaluation_headline(evaluation(offset=0.3)) in read
    assert "7 of 4000 commands were more than 2 ms late" in read
    assert "Holm" in read
    assert "nan" not in read.lower().split()


def test_sides_without_a_specimen_in_common_are_said_to_be(tmp_path: Path) -> None:
    write_evaluation(tmp_path / "unpaired.html", evaluation(paired=False))
    read = Page((tmp_path / "unpaired.html").read_text(encoding="utf-8"))
    assert UNPAIRED in " ".join(read.text.split())
    assert "Force along the way" not in [text for _, text in read.headings]


def test_the_headline_says_what_is_so() -> None:
    assert "measures differ: " in evaluation_headline(evaluation(offset=0.3))
    assert "specimens would do" in evaluation_headline(evaluation(offset=0.05))
    assert "are within their margins" in evaluation_headline(evaluation())


def test_so_few_specimens_that_nothing_could_differ_are_said_to_be() -> None:
    few = dataclasses.replace(evaluation(), agreement=made_up_agreement(specimens=8, offset=2.0))
    assert few.agreement.verdict.answer == "undecided"
    assert any("8 specimens are too few" in remark for remark in few.remarks)
    assert not any("too few" in remark for remark in evaluation().remarks)
