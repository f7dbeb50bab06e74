"""The page that cuts along a drawn line, in real browsers: free hand, picture, card, and records equal to Python's."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import chromium
import firefox
import measure_page
import numpy as np
import pytest

pytest.importorskip("jinja2", reason="pages are an extra: pip install 'cutenv[view]'")

from cutenv.browser import write_page_alone
from cutenv.browser.page_alone import page_alone
from cutenv.browser.stylus_steps import HandPathCut
from cutenv.commands import score, single_page
from cutenv.play.devices import LEAD, simple_hand
from cutenv.recording import load

Browser = chromium.Browser | firefox.Browser


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "path.html"
    write_page_alone(path, count=2, specimen_classes=("liver",), tasks=("path",), lines=("excision", "s"))
    return path


@pytest.fixture
def page(browser: Browser, written: Path) -> Iterator[Browser]:
    browser.open(written, 1100)
    wait(browser, "Boolean(window.cutenvPage?.page?.cut)")
    yield browser
    assert browser.errors() == []
    assert browser.complaints() == []


def wait(page: Browser, condition: str) -> None:
    until = time.monotonic() + chromium.PATIENCE_S
    while not page.value(condition):
        assert time.monotonic() < until, condition
        time.sleep(0.05)


def start(page: Browser) -> tuple[float, float]:
    """Press Start and wait for the countdown; a place in the picture."""
    page.value("document.getElementById('start').click()")
    wait(page, "cutenvPage.page.phase === 'cutting'")
    left, top = page.value("(r => [r.left, r.top])(document.getElementById('picture').getBoundingClientRect())")
    return left + 60, top + 160


def led(cut: HandPathCut, lead: float = 0.0185) -> list[list[float]]:
    """Lead a cut along its line by a simple hand; its movements."""
    hand = simple_hand(cut.target_length, lead=lead, line=cut.cutting.line)
    stylus = []
    while not cut.end:
        read = hand.read()
        stylus.append([read.position, read.angle, read.across])
        cut.follow(stylus[-1:])
    return stylus


CUT = """(() => {
  const { page, laws, told } = cutenvPage, stylus = %s;
  const cut = page.cut = new HandCut(laws.path, told.specimens[%d]);
  for (let i = 0; i < stylus.length; i += 200) cut.advance(stylus.slice(i, i + 200));
  const { gained, success, end, path } = cut, { errors, blade, tip, hand, cutPlaces, places, aside } = path;
  return { csv: cut.csv("P07", false), gained, success, end, errors, blade, tip, hand, cutPlaces, places, aside };
})()"""
FIELDS = ("time", "force", "position", "speed", "angle", "depth", "blade_x", "blade_y", "lateral_force")


def test_a_led_cut_is_pythons_and_ends_with_a_card_of_its_path(
    page: Browser, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = HandPathCut(line="s", episode=1)
    stylus = led(cut)
    start(page)
    told = page.value(CUT % (json.dumps(stylus), 1))
    assert (told["end"], told["success"]) == (cut.end, cut.success)
    assert told["gained"] == pytest.approx(sum(cut.cutting.reward_totals.values()), abs=1e-12)
    errors = cut.cutting.errors
    assert told["errors"] == pytest.approx(errors, abs=1e-12)
    path = tmp_path / "cut.csv"
    path.write_text(told["csv"], encoding="utf-8")
    (trace,) = load(path)
    again = HandPathCut(line="s", episode=1)
    known = again.trace(again.follow(stylus), **again.noted)
    for name in FIELDS:
        assert getattr(trace, name).tobytes() == getattr(known, name).tobytes(), name
    assert {name: trace.metadata[name] for name in again.noted} == again.noted
    assert trace.metadata["line"] == "s"
    wait(page, "cutenvPage.page.phase === 'ended'")
    card = page.value("document.getElementById('results').textContent")
    lateral = float(np.abs(known.lateral_force).max())
    for words in (
        f"area between cut and line{errors['area_mm2']:.0f} mm²",
        f"largest distance to the line{errors['largest_distance_mm']:.1f} mm",
        f"greatest force to the side{lateral:.1f} N",
    ):
        assert words in card
    for given in ([], ["--line", "straight"]):
        assert score.main([str(path), *given, "--out", str(tmp_path)]) == 0
        said = capsys.readouterr().out
        assert (f"{errors['largest_distance_mm']:.1f} mm at most" in said) == (not given), said


def test_places_of_the_page_are_pythons(page: Browser) -> None:
    cut = HandPathCut(line="excision")
    stylus = led(cut)[:5000]
    cut = HandPathCut(line="excision")
    cut.follow(stylus)
    told: dict[str, Any] = page.value(CUT % (json.dumps(stylus), 0))
    shown = cut.cutting.shown_path
    for name, known in {
        "blade": shown.blade, "tip": shown.tip, "cutPlaces": shown.cut, "places": shown.line, "aside": shown.aside,
    }.items():  # fmt: skip
        assert np.array(told[name]) == pytest.approx(known, abs=1e-12), name
    assert len(shown.cut) > 50
    assert np.ptp(shown.cut[:, 1]) > 0.005


def test_a_cut_off_the_line_is_stopped_and_told(page: Browser) -> None:
    start(page)
    straight = [[min(1.2e-5 * k, 0.12), 1.2, 0.0] for k in range(12_000)]
    assert page.value(CUT % (json.dumps(straight), 0))["end"] == "off_line"
    wait(page, "cutenvPage.page.phase === 'ended'")
    said = "document.getElementById('verdict').textContent"
    assert page.value(said) == "Stopped: the cut came too far from the line"


@pytest.mark.parametrize("seed", range(3))
def test_the_points_of_the_page_are_pythons_by_the_true_tip_and_cut(page: Browser, seed: int) -> None:
    shown, known, _ = measure_page.scores(page, seed, "path")
    assert shown == pytest.approx(known, abs=1e-9)


ACROSS, ALONG, ANGLE = (f"cutenvPage.stylus.{name}" for name in ("across", "position", "angle"))


def test_a_mouse_leads_freely_by_three_millimetres_at_most_and_its_wheel_tilts(page: Browser) -> None:
    x, y = start(page)
    page.move_mouse(x, y)
    page.move_mouse(x + 150, y - 100)
    wait(page, "cutenvPage.page.cut.count > 100")
    led_by = "Math.hypot(cutenvPage.stylus.position - hand[0], cutenvPage.stylus.across - hand[1])"
    assert page.value(f"(hand => {led_by})(cutenvPage.page.cut.path.hand)") <= LEAD + 1e-4
    assert page.value(ACROSS) > 0.0, "up in the picture is to the left of the cut"
    wait(page, "cutenvPage.page.cut.path.heading[1] > 0.3")
    page.turn_wheel(x, y, 120)
    wait(page, f"{ANGLE} < {np.radians(86.0)}")


def test_a_finger_and_arrow_keys_lead_the_hand_to_either_side(page: Browser) -> None:
    x, y = start(page)
    page.stroke([(x + 2 * step, y + step) for step in range(20)])
    assert page.value(ALONG) > 0.0
    assert page.value(ACROSS) < 0.0
    before = page.value(ACROSS)
    page.value("document.getElementById('picture').focus()")
    page.press("ArrowUp")
    wait(page, f"{ACROSS} > {before} + 0.001")
    page.release("ArrowUp")
    for key, angle in (("PageDown", 85.0), ("PageUp", 90.0)):
        event = f"new KeyboardEvent('keydown', {{ key: '{key}' }})"
        page.value(f"void document.getElementById('picture').dispatchEvent({event})")
        assert page.value(ANGLE) == pytest.approx(np.radians(angle))


def test_a_stick_pushed_away_leads_the_hand_to_the_left(page: Browser) -> None:
    start(page)
    page.value("void (navigator.getGamepads = () => [{ axes: [0.6, -0.8], buttons: [] }])")
    wait(page, "cutenvPage.page.cut.path.hand[1] > 0.002")
    assert page.value(ALONG) > 0.0
    page.value("void (navigator.getGamepads = () => [])")


def test_lines_are_chosen_with_the_specimen(page: Browser) -> None:
    options = "Array.from(document.getElementById('specimen').options, each => each.textContent)"
    assert page.value(options) == ["liver, number 1: excision", "liver, number 2: S"]
    assert "dashed line" in page.value("document.getElementById('task').textContent")
    assert page.accessible("slider", "Height of the blade") == 0
    assert page.accessible("slider", "Tilt of the blade") == 1


@pytest.mark.parametrize("language", ["en", "de"])
def test_it_fits_a_telephone_and_can_be_read(browser: Browser, written: Path, language: str) -> None:
    browser.open(written, 400, dark=language == "de")
    wait(browser, "window.cutenvPage !== undefined")
    chosen = f"e.value = '{language}'; e.dispatchEvent(new Event('change'));"
    browser.value(f"(e => {{ {chosen} }})(document.getElementById('language'))")
    assert "mm" in browser.value("document.getElementById('aside').textContent")
    assert browser.value("document.documentElement.scrollWidth") <= 400
    assert browser.value(chromium.LEAST_CONTRAST) >= 4.5


def test_bad_lines_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert single_page.main([str(tmp_path / "new" / "cut.html"), "--line", "arc"]) == 2
    assert "--line arc is for cuts along a drawn line: Give --task path too" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
    with pytest.raises(ValueError, match="line must be one of"):
        page_alone(tasks=("path",), lines=("spiral",))
    with pytest.raises(ValueError, match="lines is empty"):
        page_alone(tasks=("path",), lines=())
