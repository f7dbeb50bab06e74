"""The page that cuts along a wanted depth, in real browsers: its inputs, its card, and records equal to Python's."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path

import chromium
import firefox
import measure_page
import numpy as np
import pytest

pytest.importorskip("jinja2", reason="pages are an extra: pip install 'cutenv[view]'")

from cutenv.browser import write_page_alone
from cutenv.browser.stylus_steps import HandDepthCut
from cutenv.play.devices import LOWERED_BY_NOTCH, simple_hand
from cutenv.recording import load
from cutenv.task.depth import DESCENT_SCALE
from cutenv.tissue.grid import depth_below

Browser = chromium.Browser | firefox.Browser


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "depth.html"
    write_page_alone(path, count=1, specimen_classes=("liver",), tasks=("depth", "gentle"))
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
    return left + 60, top + 60


def led(cut: HandDepthCut) -> list[list[float]]:
    """Lead a cut by a simple hand at the wanted depth; its movements."""
    shown = cut.cutting.shown_depth
    assert shown is not None
    wanted, at_start = shown.wanted, shown.level
    hand = simple_hand(cut.target_length, lead=0.0235, level=lambda place: float(depth_below(wanted, place)) - at_start)
    stylus = []
    while not cut.end:
        read = hand.read()
        stylus.append([read.position, read.angle, read.level])
        cut.follow(stylus[-1:])
    return stylus


CUT = """(() => {
  const { page, laws, told } = cutenvPage, stylus = %s;
  const cut = page.cut = new HandCut(laws.depth, told.specimens[0]);
  for (let i = 0; i < stylus.length; i += 200) cut.advance(stylus.slice(i, i + 200));
  const csv = cut.csv("P07", false), { gained, success, end } = cut;
  return { csv, gained, success, end, errors: cut.deep.errors(cut.target) };
})()"""


def test_a_led_cut_is_pythons_and_ends_with_a_card_of_its_depth(page: Browser, tmp_path: Path) -> None:
    cut = HandDepthCut()
    stylus = led(cut)
    assert cut.end == "finished"
    start(page)
    told = page.value(CUT % json.dumps(stylus))
    assert (told["end"], told["success"]) == (cut.end, cut.success)
    assert told["gained"] == pytest.approx(sum(cut.cutting.reward_totals.values()), abs=1e-12)
    assert told["errors"] == cut.cutting.errors
    path = tmp_path / "cut.csv"
    path.write_text(told["csv"], encoding="utf-8")
    (trace,) = load(path)
    again = HandDepthCut()
    known = again.trace(again.follow(stylus), **again.cutting.noted_map)
    for name in ("time", "force", "position", "speed", "angle", "depth", "height", "vertical_force"):
        assert getattr(trace, name).tobytes() == getattr(known, name).tobytes(), name
    assert {name: trace.metadata[name] for name in known.metadata} == known.metadata
    assert trace.metadata["environment"] == "cutenv/DepthCut-v1"
    wait(page, "cutenvPage.page.phase === 'ended'")
    assert page.value("document.getElementById('verdict').textContent") == "Finished: success"
    card = page.value("document.getElementById('results').textContent")
    assert f"depth off the wanted one, in the mean{cut.cutting.errors['mean_error_mm']:.1f} mm" in card
    assert "layer below openedno" in card
    assert "cut too deep" in card


def test_a_layer_opened_too_deep_ends_the_cut_and_is_told(page: Browser) -> None:
    start(page)
    pressed = [[min(1.5e-5 * k, 0.06), 1.2, -0.02] for k in range(6000)]
    assert page.value(CUT % json.dumps(pressed))["end"] == "layer"
    wait(page, "cutenvPage.page.phase === 'ended'")
    assert page.value("document.getElementById('verdict').textContent").startswith("Stopped: the layer below")


@pytest.mark.parametrize("seed", range(6))
def test_the_points_of_the_page_are_pythons_by_the_true_tip_and_floor(page: Browser, seed: int) -> None:
    shown, known, _ = measure_page.scores(page, seed, "depth")
    assert shown == pytest.approx(known, abs=1e-6)


LEVEL, ANGLE = "cutenvPage.stylus.level", "cutenvPage.stylus.angle"


def test_the_wheel_and_the_arrows_raise_and_lower_and_with_shift_tilt(page: Browser) -> None:
    x, y = start(page)
    page.move_mouse(x, y)
    page.turn_wheel(x, y, 120)
    wait(page, f"{LEVEL} < 0")
    assert page.value(LEVEL) == -LOWERED_BY_NOTCH
    assert page.value(ANGLE) == pytest.approx(np.pi / 2)
    page.press("ArrowUp")
    page.release("ArrowUp")
    assert page.value(LEVEL) == 0.0
    shifted = "new KeyboardEvent('keydown', { key: 'ArrowDown', shiftKey: true })"
    page.value(f"void document.getElementById('picture').dispatchEvent({shifted})")
    assert page.value(ANGLE) < np.radians(86.0)
    page.value("(e => { e.value = 3; e.dispatchEvent(new Event('input')); })(document.getElementById('level'))")
    assert page.value(LEVEL) == pytest.approx(0.003)
    wait(page, "cutenvPage.page.cut.deep.level > cutenvPage.page.cut.law.start + 0.002")


def descent(page: Browser) -> float:
    """Speed at which the stylus's level falls, by the cut's own clock [m/s]."""
    now = f"[{LEVEL}, cutenvPage.page.cut.count]"
    before = page.value(now)
    wait(page, f"cutenvPage.page.cut.count > {before[1] + 150}")
    after = page.value(now)
    return float((before[0] - after[0]) / (after[1] - before[1]) * 1e3)


def test_a_pens_pressure_lets_the_blade_descend_and_rise(page: Browser) -> None:
    x, y = start(page)

    def pen(kind: str, pressure: float) -> None:
        told = f"pointerId: 5, pointerType: 'pen', pressure: {pressure}, buttons: {int(pressure > 0)}"
        event = f"new PointerEvent('{kind}', {{ {told}, clientX: {x}, clientY: {y} }})"
        page.value(f"void document.getElementById('picture').dispatchEvent({event})")

    page.value("void (document.getElementById('picture').setPointerCapture = () => {})")  # of a pen that is made up
    pen("pointerdown", 0.5)
    for pressure, share in ((1.0, 1.0), (0.5, 0.0), (0.0001, -1.0)):
        pen("pointermove", pressure)
        assert descent(page) == pytest.approx(share * DESCENT_SCALE, rel=0.25, abs=1e-9)
    pen("pointerup", 0.0)
    assert descent(page) == 0.0, "a pen that is lifted leaves the blade where it is"


def test_a_second_finger_lowers_the_blade_as_it_moves_down(page: Browser) -> None:
    x, y = start(page)
    page.value("void (document.getElementById('picture').setPointerCapture = () => {})")  # of fingers that are made up
    for kind, finger, down in (("down", 1, 0), ("down", 2, 0), ("move", 2, 36)):
        told = f"pointerId: {finger}, pointerType: 'touch', buttons: 1, clientX: {x}, clientY: {y + down}"
        event = f"new PointerEvent('pointer{kind}', {{ {told} }})"
        page.value(f"void document.getElementById('picture').dispatchEvent({event})")
    assert page.value(LEVEL) == pytest.approx(-3 * LOWERED_BY_NOTCH)
    assert page.value("cutenvPage.stylus.position") == 0.0


def test_the_second_stick_of_a_gamepad_lets_the_blade_descend(page: Browser) -> None:
    axes = "axes: [0, 0, 0, 1], buttons: []"
    start(page)
    page.value(f"void (navigator.getGamepads = () => [{{ {axes} }}])")
    assert descent(page) == pytest.approx(DESCENT_SCALE, rel=0.25)
    page.value("void (navigator.getGamepads = () => [])")


def test_the_task_is_chosen_with_the_specimen(page: Browser) -> None:
    options = "Array.from(document.getElementById('specimen').options, each => each.textContent)"
    assert page.value(options) == ["liver, number 1, along a depth", "liver, number 1"]
    shown = "document.getElementById('level').offsetWidth > 0"
    assert page.value(shown)
    assert "dashed depth" in page.value("document.getElementById('task').textContent")
    page.value("(e => { e.value = 1; e.dispatchEvent(new Event('change')); })(document.getElementById('specimen'))")
    wait(page, "cutenvPage.page.cut.deep === null")
    assert not page.value(shown)
    assert "dashed depth" not in page.value("document.getElementById('task').textContent")
    assert page.accessible("slider", "Height of the blade") == 0


@pytest.mark.parametrize("language", ["en", "de"])
def test_it_fits_a_telephone_and_can_be_read(browser: Browser, written: Path, language: str) -> None:
    browser.open(written, 400, dark=language == "de")
    wait(browser, "window.cutenvPage !== undefined")
    chosen = f"e.value = '{language}'; e.dispatchEvent(new Event('change'));"
    browser.value(f"(e => {{ {chosen} }})(document.getElementById('language'))")
    assert browser.accessible("slider", {"en": "Height of the blade", "de": "Höhe der Klinge"}[language]) == 1
    assert browser.value("document.documentElement.scrollWidth") <= 400
    assert browser.value(chromium.LEAST_CONTRAST) >= 4.5
