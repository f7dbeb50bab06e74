"""The page that cuts, in a real browser: whole cuts by pointer, touch and keys, and records equal to Python's."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import chromium
import numpy as np
import pytest

pytest.importorskip("jinja2", reason="pages are an extra: pip install 'cutenv[view]'")

from cutenv.browser import HandCut, write_page_alone
from cutenv.commands import single_page
from cutenv.plant.protocol import recorded_trace
from cutenv.recording import load
from cutenv.scoring import score

pytestmark = pytest.mark.skipif(chromium.PROGRAM is None, reason="needs a browser: Debian's chromium")


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "cut.html"
    write_page_alone(path, count=1)
    return path


@pytest.fixture
def page(browser: chromium.Browser, written: Path) -> Iterator[chromium.Browser]:
    browser.open(written, 1100)
    yield browser
    assert browser.errors() == []
    assert browser.complaints() == []
    assert [asked for asked in browser.requests() if not asked.startswith(("file:", "blob:", "data:"))] == []


def hands(seed: int, count: int) -> list[list[float]]:
    """Forward with pauses and ways back, and a blade that tilts; beyond the target in the end."""
    random = np.random.default_rng(seed)
    steps = random.uniform(-0.2, 1.0, count // 250 + 1).repeat(250)[:count] * 2.5e-5
    angles = random.uniform(0.75, 1.6, count // 400 + 1).repeat(400)[:count]
    places: list[list[float]] = np.stack([np.clip(np.cumsum(steps), 0.0, 0.149), angles], axis=-1).tolist()
    return places


LED = """(() => {
  const { law, told } = cutenvPage, cut = new HandCut(law, told.specimens[%d]), stylus = %s;
  for (let i = 0; i < stylus.length; i += 16) cut.advance(stylus.slice(i, i + 16));
  return [cut.csv("P07", false), cut.end, cut.success, cut.numbers()];
})()"""


@pytest.mark.parametrize("number", range(3))
def test_a_record_of_the_page_is_pythons(page: chromium.Browser, tmp_path: Path, number: int) -> None:
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
    assert numbers["peak"] == readings["force"].max()
    assert numbers["off"] == readings["tip"][-1] - trace.metadata["target_length_m"]
    card = score(trace, target_length=trace.metadata["target_length_m"])
    assert card.overall_score is not None
    assert card.outcome


def start(page: chromium.Browser) -> tuple[float, float]:
    """Press Start and wait for the countdown; a place in the picture."""
    page.value("document.getElementById('start').click()")
    wait(page, "cutenvPage.page.phase === 'cutting'")
    left, top = page.value("(r => [r.left, r.top])(document.getElementById('picture').getBoundingClientRect())")
    return left + 60, top + 60


def wait(page: chromium.Browser, condition: str) -> None:
    until = time.monotonic() + chromium.PATIENCE_S
    while not page.value(condition):
        assert time.monotonic() < until, condition
        time.sleep(0.05)


BLADE = "cutenvPage.page.cut.blade"


def test_a_whole_cut_by_mouse_ends_with_a_card(page: chromium.Browser) -> None:
    x, y = start(page)
    page.tell("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    page.tell("Input.dispatchMouseEvent", type="mouseWheel", x=x, y=y, deltaX=0, deltaY=120)
    until = time.monotonic() + 60.0
    while page.value("cutenvPage.page.phase") == "cutting" and time.monotonic() < until:
        x = x + 8 if x < 1000 else 100.0  # lifts the mouse and goes on, as a person does
        kind = {"type": "mouseMoved", "x": x, "y": y}
        page.tell("Input.dispatchMouseEvent", **kind)
    assert page.value("cutenvPage.page.phase") == "ended"
    angles = page.value("cutenvPage.page.cut.columns.angle")
    assert min(angles) < np.radians(87.0), "the wheel did not tilt the blade"
    assert page.value("document.getElementById('verdict').textContent") != ""
    assert page.value("document.getElementById('results').children.length") == 10
    assert page.value("document.getElementById('card').hidden") is False


def test_a_finger_leads_the_hand_and_giving_up_keeps_the_record(page: chromium.Browser) -> None:
    x, y = start(page)
    page.tell("Input.dispatchTouchEvent", type="touchStart", touchPoints=[{"x": x, "y": y}])
    for step in range(40):
        point = {"x": x + 3 * step, "y": y}
        page.tell("Input.dispatchTouchEvent", type="touchMove", touchPoints=[point])
    page.tell("Input.dispatchTouchEvent", type="touchEnd", touchPoints=[])
    assert page.value("cutenvPage.page.cut.hand") > 0.0
    wait(page, "cutenvPage.page.cut.count > 100")
    page.value("document.getElementById('stop').click()")
    assert page.value("cutenvPage.page.cut.end") == "given up"
    assert page.value("document.getElementById('save').disabled") is False
    assert '"end":"given up"' in page.value("cutenvPage.page.cut.csv('', true)")


def test_keys_start_move_and_tilt(page: chromium.Browser) -> None:
    page.value("document.getElementById('picture').focus()")

    def press(key: str, code: int, kind: str = "rawKeyDown") -> None:
        page.tell("Input.dispatchKeyEvent", type=kind, key=key, windowsVirtualKeyCode=code)

    press(" ", 32)
    wait(page, "cutenvPage.page.phase === 'cutting'")
    press("ArrowDown", 40)
    press("ArrowRight", 39)
    wait(page, f"{BLADE} > 0.002")
    press("ArrowRight", 39, "keyUp")
    assert page.value("cutenvPage.stylus.angle") == pytest.approx(np.radians(85.0))
    assert page.value("cutenvPage.stylus.keys.size") == 0
    page.value("document.getElementById('stop').click()")


def test_a_fast_flick_does_not_run_the_cut_away(page: chromium.Browser) -> None:
    x, y = start(page)
    for place in (x, x + 700):
        page.tell("Input.dispatchMouseEvent", type="mouseMoved", x=place, y=y)
    wait(page, "cutenvPage.page.cut.count > 500")
    assert page.value("cutenvPage.page.cut.hand") < 0.02
    page.value("document.getElementById('stop').click()")


def test_near_the_target_it_says_what_is_still_missing(page: chromium.Browser) -> None:
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
    page.value("document.getElementById('stop').click()")
    assert page.value("document.getElementById('missing').textContent") == ""


@pytest.mark.parametrize("language", ["en", "de"])
@pytest.mark.parametrize("dark", [False, True])
def test_it_fits_a_telephone_and_can_be_read(
    browser: chromium.Browser, written: Path, language: str, dark: bool
) -> None:
    browser.open(written, 400, dark=dark)
    wait(browser, "window.cutenvPage !== undefined")
    chosen = f"e.value = '{language}'; e.dispatchEvent(new Event('change'));"
    browser.value(f"(e => {{ {chosen} }})(document.getElementById('language'))")
    assert browser.value("document.documentElement.lang") == language
    assert browser.value("document.documentElement.scrollWidth") <= 400
    assert browser.value(chromium.LEAST_CONTRAST) >= 4.5
    start(browser)
    wait(browser, "cutenvPage.page.cut.count > 100")
    browser.value("document.getElementById('stop').click()")
    assert browser.value("document.documentElement.scrollWidth") <= 400
    assert browser.value(chromium.LEAST_CONTRAST) >= 4.5


def test_both_languages_have_the_same_texts() -> None:
    folder = Path(single_page.__file__).parents[1] / "browser" / "page"
    texts: list[dict[str, Any]] = [
        json.loads((folder / f"texts.{language}.json").read_text(encoding="utf-8")) for language in ("en", "de")
    ]
    assert list(texts[0]) == list(texts[1])
    for name, text in texts[0].items():
        assert text.count("{") == texts[1][name].count("{"), name


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
