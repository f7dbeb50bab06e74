"""The page that cuts, in real browsers: whole cuts by pointer, touch, keys and gamepad; records equal to Python's."""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np
import pytest
from opened_page import (
    Browser,
    by_mouse,
    fits_and_can_be_read,
    lead_to_the_end,
    open_on_telephone,
    start,
    wait,
)  # fmt: skip

from scripts.validation.classroom import page_in_browsers

pytest.importorskip("jinja2", reason="pages are an extra: pip install 'cutenv[view]'")

from cutenv.commands import single_page
from cutenv.people.browser import HandCut
from cutenv.people.browser.page_alone import scoring_data
from cutenv.people.browser.page_data import specimen_data
from cutenv.people.browser.watched_cut import from_runs
from cutenv.records import load
from cutenv.records.scoring import score
from cutenv.sim.plant.protocol import recorded_trace


def hands(seed: int, count: int) -> list[list[float]]:
    """Forward with pauses and ways back, and a blade that tilts; beyond the target in the end."""
    random = np.random.default_rng(seed)
    steps = random.uniform(-0.2, 1.0, count // 250 + 1).repeat(250)[:count] * 2.5e-5
    angles = random.uniform(0.75, 1.6, count // 400 + 1).repeat(400)[:count]
    places: list[list[float]] = np.stack([np.clip(np.cumsum(steps), 0.0, 0.149), angles], axis=-1).tolist()
    return places


LED = """(() => {
  const { laws: { gentle: law }, told } = cutenvPage, cut = new HandCut(law, told.specimens[%d]), stylus = %s;
  for (let i = 0; i < stylus.length; i += 16) cut.advance(stylus.slice(i, i + 16));
  return [cut.csv("P07", false), cut.end, cut.success, cut.numbers()];
})()"""


@pytest.mark.parametrize("number", range(3))
def test_a_record_of_the_page_is_pythons(page: Browser, tmp_path: Path, number: int) -> None:
    specimen_class = ("liver", "uniform", "vascular")[number]
    stylus = hands(number, 9000)
    text, end, success, numbers = page.value(LED % (number, json.dumps(stylus)))
    path = tmp_path / "cut.csv"
    path.write_text(text, encoding="utf-8")
    (trace,) = load(path)
    cut = HandCut(specimen_class=specimen_class)
    readings = cut.follow(stylus)
    again = recorded_trace(readings, cut.measured_depth)
    for name in ("time", "force", "position", "speed", "angle", "depth"):
        assert getattr(trace, name).tobytes() == getattr(again, name).tobytes(), name
    assert (end, success) == (cut.end, cut.success)
    assert trace.metadata["operator"] == "P07"
    assert from_runs(trace.metadata["movements"]).tolist() == stylus[: len(readings)]
    assert numbers["peak"] == readings["force"].max()
    assert numbers["off"] == readings["tip"][-1] - trace.metadata["target_length_m"]
    card = score(trace, target_length=trace.metadata["target_length_m"])
    assert card.overall_score is not None
    assert card.outcome


@pytest.mark.parametrize("seed", [*range(5), 173])  # the last lets the blade lurch at more than 1 m/s
def test_the_score_of_the_page_is_pythons_by_the_true_tip(page: Browser, seed: int) -> None:
    shown, known, _ = page_in_browsers.scores(page, seed)
    assert shown == pytest.approx(known, abs=1e-9)


def give_up(page: Browser) -> None:
    page.value("document.getElementById('stop').click()")


BLADE = "cutenvPage.page.cut.blade"
SHORT = specimen_data("liver", 0, 0, target_length=0.02)
"""A cut that a hand makes in some seconds."""


def test_a_whole_cut_is_finished_and_ends_with_a_card(page: Browser) -> None:
    """By a mouse; a trainee cuts by fingers and keys (test_trainees_way.py)."""
    page.value(f"void (cutenvPage.told.specimens[0] = {json.dumps(SHORT)})")
    page.value("void document.getElementById('specimen').dispatchEvent(new Event('change'))")
    lead_to_the_end(page, by_mouse(page, *start(page)))
    assert page.value("cutenvPage.page.cut.end") == "finished"
    assert page.value("document.getElementById('verdict').textContent").startswith("Finished: ")
    assert page.value("document.getElementById('results').children.length") == 10
    assert page.value("document.getElementById('points').rows.length") == len(scoring_data()["points"])
    assert page.value("document.getElementById('card').hidden") is False


EXPERT = """(() => {
  const way = n => Array.from({ length: 251 }, (_, k) => k * n);
  cutenvPage.page.cut.specimen.expert = {
    time: way(0.02), position: way(2e-4), angle: way(0).map(() => 1.2), force: way(0.01), tip: way(1.9e-4),
  };
})()"""


def test_a_replay_is_the_cut_again_beside_an_experts(page: Browser) -> None:
    """The law makes the same readings of the same movements, at any pace; the card covers nothing."""
    start(page)
    led = (
        "(rows => { for (let i = 0; i < rows.length; i += 200) cutenvPage.page.cut.advance(rows.slice(i, i + 200)); })"
    )
    page.value(f"{led}({json.dumps(hands(3, 4000))})")
    page.value(EXPERT)
    give_up(page)
    box = "(r => [r.left, r.right])(document.getElementById('{}').getBoundingClientRect())"
    assert page.value(box.format("card"))[0] >= page.value(box.format("picture"))[1]
    page.value("document.getElementById('watch').click()")
    wait(page, "cutenvPage.page.replay !== null && !document.getElementById('replay').hidden")
    page.value("document.getElementById('play').click()")
    page.value("void cutenvPage.page.replay.seek(1000)")
    half = (
        "(r => { r.playing = true; r.pace = 0.5; r.advance(400); r.playing = false; return [r.passed, r.cut.count]; })"
    )
    assert page.value(f"{half}(cutenvPage.page.replay)") == [1200, 1200]
    page.value("void cutenvPage.page.replay.seek(cutenvPage.page.replay.lasts)")
    assert page.value("cutenvPage.page.replay.cut.count") == page.value("cutenvPage.page.cut.count")
    page.value("void (window.own = cutenvPage.page.cut.bytes())")
    assert page.value("cutenvPage.page.replay.cut.bytes().every((value, k) => Object.is(value, own[k]))")
    at = page.value("cutenvPage.page.replay.expert.at(0.01)")
    assert (at["force"], at["time"], at["speed"]) == (pytest.approx(0.5), pytest.approx(1.0), pytest.approx(0.01))
    wait(page, "document.getElementById('compared').rows.length === 5")
    assert page.value("document.getElementById('compared').rows[0].cells[2].textContent") == "the best known way"
    differs = "cutenvPage.drawing.canvas.toDataURL()"
    beside = page.value(differs)
    page.value("void (cutenvPage.page.replay.expert = null, cutenvPage.page.looks = '')")
    wait(page, "cutenvPage.page.looks !== ''")
    assert page.value(differs) != beside, "the expert's way is drawn"
    page.value("document.getElementById('end-replay').click()")
    assert page.value("[document.getElementById('card').hidden, document.activeElement.id]") == [False, "watch"]


@pytest.mark.parametrize(("width", "height"), [(390, 844), (844, 390)])
def test_on_a_telephone_force_and_trace_are_in_view(browser: Browser, written: Path, width: int, height: int) -> None:
    page = browser
    page.open(written, width, height)
    wait(page, "Boolean(window.cutenvPage?.page?.cut)")
    start(page)
    wait(page, "cutenvPage.page.cut.count > 100")
    bounds = "(r => [r.top, r.bottom])(document.getElementById('%s').getBoundingClientRect())"
    for name in ("force", "picture"):
        top, bottom = page.value(bounds % name)
        assert top >= -45, name  # of the picture, its caption may be above
        assert bottom <= height, name
    give_up(page)


def test_where_a_limit_stopped_the_cut_is_marked(page: Browser) -> None:
    start(page)
    page.value("void (window.said = [], cutenvPage.drawing.words = text => said.push(text))")
    page.value("(cut => { while (!cut.end) cut.advance([[0.149, 1.57]]); })(cutenvPage.page.cut)")
    wait(page, "cutenvPage.page.phase === 'ended' && said.includes('stopped here')")
    assert page.value("cutenvPage.page.cut.end") in ("force_limit", "overshoot")


def test_keys_alone_start_move_tilt_and_give_up_which_keeps_the_record(page: Browser) -> None:
    page.value("document.getElementById('picture').focus()")
    page.press(" ")
    page.release(" ")
    wait(page, "cutenvPage.page.phase === 'cutting'")
    page.press("ArrowDown")
    page.release("ArrowDown")
    page.press("ArrowRight")
    wait(page, f"{BLADE} > 0.002")
    page.release("ArrowRight")
    assert page.value("cutenvPage.stylus.angle") == pytest.approx(np.radians(85.0))
    assert page.value("cutenvPage.stylus.keys.size") == 0
    page.press("Tab")
    page.release("Tab")
    assert page.value("document.activeElement.id") == "stop"
    give_up(page)
    assert page.value("document.activeElement.id") == "card", "the card is read out, and Tab goes on from there"
    assert page.value("document.getElementById('save').disabled") is False
    assert '"end":"given up"' in page.value("cutenvPage.page.cut.csv('', true)")


def test_a_gamepad_moves_and_tilts(page: Browser) -> None:
    buttons = "Array.from({ length: 8 }, (_, k) => ({ value: k === 7 ? 0.5 : 0 }))"
    page.value(f"void (navigator.getGamepads = () => [null, {{ axes: [0.8], buttons: {buttons} }}])")
    start(page)
    wait(page, f"{BLADE} > 0.002")
    assert page.value("cutenvPage.stylus.angle") == pytest.approx(np.radians(67.5))
    page.value("void (navigator.getGamepads = () => [])")
    at = page.value("cutenvPage.stylus.position")
    page.value("new Promise(done => setTimeout(done, 100))")
    assert page.value("cutenvPage.stylus.position") == at, "without a gamepad the hand rests"
    give_up(page)


def test_a_screen_reader_finds_everything_by_name(page: Browser) -> None:
    for role, name in (
        ("heading", "Cut gently"),
        ("button", "Start"),
        ("combobox", "Specimen"),
        ("combobox", "Language"),
        ("slider", "Tilt of the blade"),
        ("checkbox", "practice: show the tip"),
    ):
        assert page.accessible(role, name) == 1, (role, name)
    start(page)
    wait(page, "cutenvPage.page.cut.count > 100")
    assert page.accessible("button", "Give up") == 1
    told = page.value("document.getElementById('picture').getAttribute('aria-label')")
    assert "newtons" in told
    assert "millimetres to the target" in told
    give_up(page)
    assert page.accessible("heading", "Given up") == 1
    assert page.accessible("textbox", "Code, no name (optional)") == 1
    assert page.accessible("button", "Save the record (CSV)") == 1
    assert page.accessible("button", "Next specimen") == 1


def test_a_fast_flick_does_not_run_the_cut_away(page: Browser) -> None:
    x, y = start(page)
    for place in (x, x + 700):
        page.move_mouse(place, y)
    wait(page, "cutenvPage.page.cut.count > 500")
    assert page.value("cutenvPage.page.cut.hand") < 0.02
    give_up(page)


def test_near_the_target_it_says_what_is_still_missing(page: Browser) -> None:
    start(page)
    assert page.value("document.getElementById('missing').textContent") == ""
    to_the_target = """(() => {
      const { page, stylus } = cutenvPage, { cut } = page;
      while (cut.blade < cut.target - 0.004 && !cut.end) cut.advance([[cut.hand + 0.002, 0.5 * Math.PI]]);
      stylus.position = cut.hand;
    })()"""
    page.value(to_the_target)
    wait(page, "document.getElementById('missing').textContent.includes('still pull')")
    page.value("cutenvPage.page.cut.advance(Array.from({ length: 200 }, () => [cutenvPage.page.cut.hand, 1.2]))")
    wait(page, "/upright|pull/.test(document.getElementById('missing').textContent)")
    give_up(page)
    assert page.value("document.getElementById('missing').textContent") == ""


@pytest.mark.parametrize(("language", "dark"), [("en", True), ("de", False)])
def test_it_fits_a_telephone_and_can_be_read(browser: Browser, written: Path, language: str, dark: bool) -> None:
    open_on_telephone(browser, written, language, dark)
    assert browser.value("document.documentElement.lang") == language
    start(browser)
    wait(browser, "cutenvPage.page.cut.count > 100")
    give_up(browser)
    fits_and_can_be_read(browser)
    paper = "getComputedStyle(document.documentElement).getPropertyValue('--paper').trim()"
    assert (browser.value(paper) != "#fff") == dark
    browser.value("dispatchEvent(new Event('beforeprint'))")
    assert browser.value(paper) == "#fff", "it prints dark on white"
    browser.value("dispatchEvent(new Event('afterprint'))")
    assert (browser.value(paper) != "#fff") == dark


THE_PICTURE_ALONE = """(() => {
  for (let each = document.getElementById("picture"); each !== document.body; each = each.parentElement) {
    for (const other of each.parentElement.children) if (other !== each) other.style.display = "none";
  }
})()"""
A_LITTLE_TALLER_THAN_THE_WINDOW = """(() => {
  const { style } = document.body, below = innerHeight + 1 - document.body.getBoundingClientRect().bottom;
  style.paddingBottom = `${parseFloat(getComputedStyle(document.body).paddingBottom) + below}px`;
  return below;
})()"""
DRAWN_IN_HALF_A_SECOND = """new Promise(done => {
  const { drawing } = cutenvPage, draw = drawing.draw.bind(drawing);
  let drawn = 0;
  drawing.draw = (...all) => { drawn += 1; return draw(...all); };
  setTimeout(() => { drawing.draw = draw; done(drawn); }, 500);
})"""


def test_a_page_at_rest_is_not_drawn_again(browser: Browser, written: Path) -> None:
    """Nor where a scroll bar makes the picture narrower, and so too low for a scroll bar."""
    browser.open(written, 700)
    wait(browser, "Boolean(window.cutenvPage?.page?.cut)")
    browser.value(THE_PICTURE_ALONE)
    time.sleep(0.2)
    assert browser.value(A_LITTLE_TALLER_THAN_THE_WINDOW) > 0.0, "it was taller before: the test compares nothing"
    time.sleep(0.2)
    assert browser.value(DRAWN_IN_HALF_A_SECOND) == 0


def test_the_command_writes_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "new" / "cut.html"
    assert single_page.main([str(path), "--specimen-class", "vascular", "--count", "1", "--language", "de"]) == 0
    assert "page: " in capsys.readouterr().out
    assert '<html lang="en">' in path.read_text(encoding="utf-8") or "Schonend" in path.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("arguments", "named"), [(["--count", "0"], "count"), (["--seed", "-1"], "seed"), (["--count", "1000"], "count")]
)
def test_bad_options_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], named: str
) -> None:
    assert single_page.main([str(tmp_path / "cut.html"), *arguments]) == 2
    assert named in capsys.readouterr().err
    assert not (tmp_path / "cut.html").exists()


def test_a_page_that_a_browser_would_show_as_text_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert single_page.main([str(tmp_path / "cut.txt"), "--count", "1"]) == 2
    assert "must end in .html" in capsys.readouterr().err
    assert not (tmp_path / "cut.txt").exists()
