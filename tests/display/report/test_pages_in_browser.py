"""Pages as a browser shows them, on a desk and a phone, light and dark; needs Debian's ``chromium``."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from scripts.browsers.chromium import LEAST_CONTRAST, Browser

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from compared_cuts import made_up_agreement
from made_up_result import result
from made_up_study import EXPERTS, NOVICES, sawing, study
from reading import Page
from recorded_cut import recorded_cut

from cutenv.agents.sim_to_real import ClockKept
from cutenv.agents.sim_to_real.comparison_report import UNPAIRED, Evaluation, evaluation_headline, write_evaluation
from cutenv.display.report import write_training_page
from cutenv.display.report.pass_mark_page import pass_mark_headline, write_pass_mark_page
from cutenv.display.report.score_page import ScoredRecord, write_score_page, write_summary
from cutenv.display.report.study_page import study_headline, write_study
from cutenv.display.report.trainee_sheet import write_class_list, write_trainee_sheet
from cutenv.records.scoring import ReferenceSet, score
from cutenv.records.scoring.score_card import DISCLAIMER
from cutenv.records.scoring.study import StandardSetting, StudiedCut, Study

pytestmark = pytest.mark.needs("chromium")

DESK, PHONE = 1400, 390
SCREENS = pytest.mark.parametrize("width", [DESK, PHONE])
HOSTILE = "<script>document.title='taken'</script>"


def evaluation(**of_rig: object) -> Evaluation:
    """A made-up one, its clock late now and then."""
    rng = np.random.default_rng(1)
    periods = 0.020 + 0.0002 * rng.standard_normal(4000)
    clock = ClockKept.of(0.020, [(periods, np.abs(0.002 * rng.standard_normal(4000)), 7, 0.05, 1)])
    return Evaluation(
        policy="a <script>", rig="bench 2", specimen_class="liver", seed=3, clock=clock,
        agreement=made_up_agreement(specimens=14, **of_rig),  # type: ignore[arg-type]
    )  # fmt: skip


@functools.cache
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


def scored(name: str, length: float) -> ScoredRecord:
    trace = recorded_cut("liver", speed=0.0127, turns=(length, 0.0)).trace
    trace = dataclasses.replace(trace, metadata={"name": name})
    card = score(trace, target_length=0.06, reference=ReferenceSet.shipped())
    return ScoredRecord(trace=trace, card=card, target_length=0.06)


class Shown(NamedTuple):
    """A page that is looked at: who writes it, its title, and the number of its pictures."""

    write: Callable[[Path], object]
    title: str
    pictures: int


SHOWN = {
    "training": Shown(lambda path: write_training_page(path, result()), "Gentle cutting with PPO", 5),
    "evaluation": Shown(  # of a rig that differs: differences, force, clock
        lambda path: write_evaluation(path, evaluation(offset=0.3)), "a <script> on bench 2 and in the simulator", 3
    ),
    "pass marks": Shown(  # curves and passes of two metrics, and the raters
        lambda path: write_pass_mark_page(path, setting()), "Pass marks: made up", 2 * 2 + 1
    ),
    "score": Shown(  # of a cut that went too far
        lambda path: write_score_page(path, scored(HOSTILE, 0.08)), f"Score: {HOSTILE}", 1
    ),
    "study": Shown(  # groups, reliability, and five metrics cut by cut
        lambda path: write_study(path, study(target_group="expert")), "Study: made up", 2 + 5
    ),
}


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Each kind of page, written once when it is first asked for."""
    folder = tmp_path_factory.mktemp("pages")

    def written(kind: str) -> Path:
        path = folder / f"{kind.replace(' ', '_')}.html"
        if not path.is_file():
            SHOWN[kind].write(path)
        return path

    return written


def words_of(path: Path) -> str:
    return " ".join(Page(path.read_text(encoding="utf-8")).text.split())


def check_fits(browser: Browser, width: int) -> None:
    """The window is as wide as asked for, nothing but a table scrolls sideways, and no table's row has a gap."""
    assert browser.value("innerWidth") == width
    assert browser.value("document.documentElement.scrollWidth <= document.documentElement.clientWidth")
    widths = "[...document.querySelectorAll('table')].map(t => new Set([...t.rows].map(r => r.cells.length)).size)"
    assert set(browser.value(widths)) == {1}


def check_pictures_show(browser: Browser, count: int = SHOWN["training"].pictures) -> None:
    """All pictures are there, drawn for this kind of screen, as large as the page has room for."""
    shown = browser.value("[...document.images].map(i => [i.complete, i.naturalWidth, i.clientWidth / i.naturalWidth])")
    assert len(shown) == count
    for complete, natural, scale in shown:
        assert complete
        assert natural > 0
        if scale:  # what is folded has no width
            assert 0.85 <= scale <= 1.25, "letters too small to read, or too large"


def check_fetches_nothing(browser: Browser, page: Path) -> None:
    """The browser asked for the file alone, and had nothing to refuse."""
    assert [address for address in browser.requests() if not address.startswith("data:")] == [page.as_uri()]
    assert browser.complaints() == []


def check_can_be_read(browser: Browser) -> None:
    """All text stands out from what is below it, in the light and in the dark."""
    for dark in (False, True):
        browser.darken(dark)
        assert browser.value("matchMedia('(prefers-color-scheme: dark)').matches") is dark
        assert browser.value(LEAST_CONTRAST) >= 4.5


@SCREENS
@pytest.mark.parametrize("kind", SHOWN)
def test_a_page_fits_shows_its_pictures_and_can_be_read(
    browser: Browser, pages: Callable[[str], Path], kind: str, width: int
) -> None:
    browser.open(pages(kind), width)
    assert browser.value("document.title") == SHOWN[kind].title
    check_fits(browser, width)
    check_pictures_show(browser, SHOWN[kind].pictures)
    check_can_be_read(browser)
    check_fits(browser, width)
    check_pictures_show(browser, SHOWN[kind].pictures)
    check_fetches_nothing(browser, pages(kind))
    browser.value("document.querySelectorAll('details').forEach(part => part.open = true)")
    check_fits(browser, width)


@pytest.fixture
def page(pages: Callable[[str], Path]) -> Path:
    """The page of a training."""
    return pages("training")


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


def test_a_long_name_fits_a_phone_too(browser: Browser, tmp_path: Path, page: Path) -> None:
    path = tmp_path / "report.html"
    path.write_text(page.read_text(encoding="utf-8").replace("PPO", "PPO" * 40), encoding="utf-8")
    browser.open(path, PHONE)
    check_fits(browser, PHONE)


def test_a_score_says_what_to_do_and_what_it_is_not(browser: Browser, pages: Callable[[str], Path]) -> None:
    browser.open(pages("score"), DESK)
    text = browser.value("document.body.innerText")
    for words in ("mm too far", "go slowly over the last centimetre", DISCLAIMER):
        assert words in text


def test_the_summary_leads_to_every_page(browser: Browser, tmp_path: Path) -> None:
    records = [(scored(f"cut {n}", length), f"cut_{n}.html") for n, length in enumerate((0.05, 0.08))]
    _, summary = write_summary(tmp_path, records)
    browser.open(summary, 1400, dark=False)
    links = browser.value("[...document.querySelectorAll('td a, th a')].map(a => a.getAttribute('href'))")
    assert links == ["cut_0.html", "cut_1.html"]
    assert DISCLAIMER in browser.value("document.body.innerText")


@pytest.fixture(scope="module")
def sheets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one sheet and the class list."""
    folder = tmp_path_factory.mktemp("sheets")
    of = study()
    write_trainee_sheet(folder, of, "N02", mark=50.0)
    write_class_list(folder, of, mark=50.0)
    return folder


@SCREENS
def test_sheets_and_class_list_fit_and_can_be_read(browser: Browser, sheets: Path, width: int) -> None:
    for name in ("N02.html", "class.html"):
        browser.open(sheets / name, width)
        check_fits(browser, width)
        check_can_be_read(browser)
        check_fits(browser, width)
        check_fetches_nothing(browser, sheets / name)
    assert browser.value("[...document.querySelectorAll('tbody a')].map(link => link.getAttribute('href'))") == [
        f"{code}.html" for code in (*NOVICES, *EXPERTS)
    ]


def test_a_sheet_shows_nobody_else(sheets: Path) -> None:
    document = (sheets / "N02.html").read_text(encoding="utf-8")
    assert "N02_16" in document
    assert not any(code in document for code in (*NOVICES, *EXPERTS) if code != "N02")


def test_a_sheet_in_print_keeps_names_of_records_in_their_column(browser: Browser, tmp_path: Path) -> None:
    card = scored("20261128T101112_liver_1234567890-0_abcdef", 0.08).card
    path = write_trainee_sheet(tmp_path, Study(name="2b", cuts=[StudiedCut(card=card, operator="P01")] * 2), "P01")
    browser.open(path, 500)  # of A5
    browser.tell("Emulation.setEmulatedMedia", media="print")
    try:
        over = "[...document.querySelectorAll('tbody th')].filter(each => each.scrollWidth > each.clientWidth).length"
        assert browser.value(over) == 0
    finally:
        browser.tell("Emulation.setEmulatedMedia", media="")


@pytest.mark.parametrize("kind", ["evaluation", "pass marks", "study"])
def test_a_page_says_what_it_found_and_what_it_is_not(pages: Callable[[str], Path], kind: str) -> None:
    read, words = Page(pages(kind).read_text(encoding="utf-8")), words_of(pages(kind))
    headlines = {
        "evaluation": lambda: evaluation_headline(evaluation(offset=0.3)),
        "pass marks": lambda: pass_mark_headline(setting()),
        "study": lambda: study_headline(study()),
    }
    assert headlines[kind]() in words
    assert "nan" not in words.lower().split()
    if kind == "evaluation":
        assert "7 of 4000 commands were more than 2 ms late" in words
        assert "Holm" in words
    else:
        assert read.text.count(DISCLAIMER) >= 3
    if kind == "pass marks":
        assert [text for level, text in read.headings if level == 2] == [
            "Pass marks, method by method",
            "Proficiency",
            "Against the raters",
            "Sources of validity",
            "What the numbers mean",
        ]


def test_sides_without_a_specimen_in_common_are_said_to_be(tmp_path: Path) -> None:
    write_evaluation(tmp_path / "unpaired.html", evaluation(paired=False))
    read = Page((tmp_path / "unpaired.html").read_text(encoding="utf-8"))
    assert UNPAIRED in " ".join(read.text.split())
    assert "Force along the way" not in [text for _, text in read.headings]


def test_the_headline_of_an_evaluation_says_what_is_so() -> None:
    assert "measures differ: " in evaluation_headline(evaluation(offset=0.3))
    assert "specimens would do" in evaluation_headline(evaluation(offset=0.05))
    assert "are within their margins" in evaluation_headline(evaluation())


def test_so_few_specimens_that_nothing_could_differ_are_said_to_be() -> None:
    few = dataclasses.replace(evaluation(), agreement=made_up_agreement(specimens=8, offset=2.0))
    assert few.agreement.verdict.answer == "undecided"
    assert any("8 specimens are too few" in remark for remark in few.remarks)
    assert not any("too few" in remark for remark in evaluation().remarks)


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
    read = words_of(tmp_path / "few.html")
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
