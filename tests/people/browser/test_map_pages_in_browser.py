"""The page that cuts along a wanted depth or a line, in real browsers: inputs, picture, card, and Python's records."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from opened_page import Browser, open_on_telephone, start, wait

from scripts.validation.classroom import page_in_browsers

pytest.importorskip("jinja2", reason="pages are an extra: pip install 'cutenv[view]'")

from cutenv.commands import score, single_page
from cutenv.people.browser import write_page_alone
from cutenv.people.browser.page_alone import page_alone
from cutenv.people.browser.stylus_steps import HandDepthCut, HandPathCut
from cutenv.people.play.devices import LEAD, LOWERED_BY_NOTCH, simple_hand
from cutenv.records import load
from cutenv.sim.tissue.grid import depth_below
from cutenv.task.depth import DESCENT_SCALE

PAGES: dict[str, dict[str, Any]] = {
    "depth": {"count": 1, "tasks": ("depth", "gentle")},
    "path": {"count": 2, "tasks": ("path",), "lines": ("excision", "s")},
}
every, depth, path = (
    pytest.mark.parametrize("written", tasks, indirect=True) for tasks in (("depth", "path"), ("depth",), ("path",))
)
ALONG, LEVEL, ACROSS, ANGLE = (f"cutenvPage.stylus.{name}" for name in ("position", "level", "across", "angle"))
VERDICT, CARD = (f"document.getElementById('{name}').textContent" for name in ("verdict", "results"))


@pytest.fixture(scope="module")
def written(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The page of a task; it has the task's name."""
    file = tmp_path_factory.mktemp("page") / f"{request.param}.html"
    write_page_alone(file, specimen_classes=("liver",), **PAGES[request.param])
    return file


def led(cut: HandDepthCut | HandPathCut) -> list[list[float]]:
    """Lead a cut by a simple hand, at the wanted depth or along its line; its movements."""
    shown, length = cut.cutting.shown_depth, cut.target_length
    if shown is None:
        hand = simple_hand(length, lead=0.0185, line=cut.cutting.line)
    else:
        wanted, begun = shown.wanted, shown.level
        hand = simple_hand(length, lead=0.0235, level=lambda place: float(depth_below(wanted, place)) - begun)
    stylus = []
    while not cut.end:
        read = hand.read()
        stylus.append([read.position, read.angle, read.across if shown is None else read.level])
        cut.follow(stylus[-1:])
    return stylus


CUT = """(() => {
  const { page, laws, told } = cutenvPage, stylus = %s, specimen = told.specimens[%d];
  const cut = page.cut = new HandCut(laws[specimen.task], specimen);
  for (let i = 0; i < stylus.length; i += 200) cut.advance(stylus.slice(i, i + 200));
  const { gained, success, end, path, deep } = cut, whole = { csv: cut.csv("P07", false), gained, success, end };
  if (deep) return { ...whole, errors: deep.errors(cut.target) };
  const { errors, blade, tip, hand, cutPlaces, places, aside } = path;
  return { ...whole, errors, blade, tip, hand, cutPlaces, places, aside };
})()"""
FIELDS = {"depth": ("height", "vertical_force"), "path": ("blade_x", "blade_y", "lateral_force")}


def made(task: str) -> HandDepthCut | HandPathCut:
    return HandDepthCut() if task == "depth" else HandPathCut(line="s", episode=1)


@every
def test_a_led_cut_is_pythons_and_ends_with_a_card_of_its_errors(
    page: Browser, written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    task, on_line = written.stem, written.stem == "path"
    cut, again = made(task), made(task)
    stylus = led(cut)
    start(page)
    told = page.value(CUT % (json.dumps(stylus), int(on_line)))
    assert (told["end"], told["success"]) == (cut.end, cut.success)
    assert told["gained"] == pytest.approx(sum(cut.cutting.reward_totals.values()), abs=1e-12)
    errors = cut.cutting.errors
    assert told["errors"] == pytest.approx(errors, rel=0.0, abs=1e-12 if on_line else 0.0)
    record = tmp_path / "cut.csv"
    record.write_text(told["csv"], encoding="utf-8")
    (trace,) = load(record)
    known = again.trace(again.follow(stylus), **again.noted)
    for name in ("time", "force", "position", "speed", "angle", "depth", *FIELDS[task]):
        assert getattr(trace, name).tobytes() == getattr(known, name).tobytes(), name
    assert {name: trace.metadata[name] for name in known.metadata} == known.metadata
    wait(page, "cutenvPage.page.phase === 'ended'")
    card = page.value(CARD)
    if not on_line:
        assert trace.metadata["environment"] == "cutenv/DepthCut-v1"
        assert (cut.end, page.value(VERDICT)) == ("finished", "Finished: success")
        for words in (
            f"depth off the wanted one, in the mean{errors['mean_error_mm']:.1f} mm",
            "layer below openedno",
            "cut too deep",
        ):
            assert words in card
        return
    assert trace.metadata["line"] == "s"
    for words in (
        f"area between cut and line{errors['area_mm2']:.0f} mm²",
        f"largest distance to the line{errors['largest_distance_mm']:.1f} mm",
        f"greatest force to the side{float(np.abs(known.lateral_force).max()):.1f} N",
    ):
        assert words in card
    for given in ([], ["--line", "straight"]):
        assert score.main([str(record), *given, "--out", str(tmp_path)]) == 0
        said = capsys.readouterr().out
        assert (f"{errors['largest_distance_mm']:.1f} mm at most" in said) == (not given), said


@path
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


@every
def test_a_cut_that_does_damage_ends_and_is_told(page: Browser, written: Path) -> None:
    start(page)
    damaging = {
        "depth": ([[min(1.5e-5 * k, 0.06), 1.2, -0.02] for k in range(6000)], "layer", "Stopped: the layer below"),
        "path": (
            [[min(1.2e-5 * k, 0.12), 1.2, 0.0] for k in range(12_000)],
            "off_line",
            "Stopped: the cut came too far from the line",
        ),
    }
    stylus, end, verdict = damaging[written.stem]
    assert page.value(CUT % (json.dumps(stylus), 0))["end"] == end
    wait(page, "cutenvPage.page.phase === 'ended'")
    assert page.value(VERDICT).startswith(verdict)


@pytest.mark.parametrize(
    ("written", "seed"),
    [*(("depth", seed) for seed in range(6)), *(("path", seed) for seed in range(3))],
    indirect=["written"],
)
def test_the_points_of_the_page_are_pythons_by_the_true_tip_and_cut(page: Browser, written: Path, seed: int) -> None:
    shown, known, _ = page_in_browsers.scores(page, seed, written.stem)
    assert shown == pytest.approx(known, abs=1e-6 if written.stem == "depth" else 1e-9)


@depth
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


@depth
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


@depth
def test_a_second_finger_lowers_the_blade_as_it_moves_down(page: Browser) -> None:
    x, y = start(page)
    page.value("void (document.getElementById('picture').setPointerCapture = () => {})")  # of fingers that are made up
    for kind, finger, down in (("down", 1, 0), ("down", 2, 0), ("move", 2, 36)):
        told = f"pointerId: {finger}, pointerType: 'touch', buttons: 1, clientX: {x}, clientY: {y + down}"
        event = f"new PointerEvent('pointer{kind}', {{ {told} }})"
        page.value(f"void document.getElementById('picture').dispatchEvent({event})")
    assert page.value(LEVEL) == pytest.approx(-3 * LOWERED_BY_NOTCH)
    assert page.value("cutenvPage.stylus.position") == 0.0


@depth
def test_the_second_stick_of_a_gamepad_lets_the_blade_descend(page: Browser) -> None:
    axes = "axes: [0, 0, 0, 1], buttons: []"
    start(page)
    page.value(f"void (navigator.getGamepads = () => [{{ {axes} }}])")
    assert descent(page) == pytest.approx(DESCENT_SCALE, rel=0.25)
    page.value("void (navigator.getGamepads = () => [])")


@depth
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


@path
def test_a_mouse_leads_freely_by_three_millimetres_at_most_and_its_wheel_tilts(page: Browser) -> None:
    x, y = start(page, below=160.0)
    page.move_mouse(x, y)
    page.move_mouse(x + 150, y - 100)
    wait(page, f"cutenvPage.page.cut.count > {page.value('cutenvPage.page.cut.count') + 100}")
    led_by = "Math.hypot(cutenvPage.stylus.position - hand[0], cutenvPage.stylus.across - hand[1])"
    assert page.value(f"(hand => {led_by})(cutenvPage.page.cut.path.hand)") <= LEAD + 1e-4
    assert page.value(ACROSS) > 0.0, "up in the picture is to the left of the cut"
    wait(page, "cutenvPage.page.cut.path.heading[1] > 0.3")
    page.turn_wheel(x, y, 120)
    wait(page, f"{ANGLE} < {np.radians(86.0)}")


@path
def test_a_finger_and_arrow_keys_lead_the_hand_to_either_side(page: Browser) -> None:
    x, y = start(page, below=160.0)
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


@path
def test_a_stick_pushed_away_leads_the_hand_to_the_left(page: Browser) -> None:
    start(page)
    page.value("void (navigator.getGamepads = () => [{ axes: [0.6, -0.8], buttons: [] }])")
    wait(page, "cutenvPage.page.cut.path.hand[1] > 0.002")
    assert page.value(ALONG) > 0.0
    page.value("void (navigator.getGamepads = () => [])")


@path
def test_lines_are_chosen_with_the_specimen(page: Browser) -> None:
    options = "Array.from(document.getElementById('specimen').options, each => each.textContent)"
    assert page.value(options) == ["liver, number 1: excision", "liver, number 2: S"]
    assert "dashed line" in page.value("document.getElementById('task').textContent")
    assert page.accessible("slider", "Height of the blade") == 0
    assert page.accessible("slider", "Tilt of the blade") == 1


EXPERT = """(() => {
  const { page, drawing } = cutenvPage, dashes = window.dashes = [];
  const way = n => Array.from({ length: 101 }, (_, k) => k * n);
  page.cut.specimen.expert = { time: way(0.02), position: way(2e-4), angle: way(0).map(() => 1.5), force: way(0.01),
    tip: way(1.9e-4), height: way(0), blade_x: way(2e-4), blade_y: way(0) };
  const strokes = drawing.strokes;
  drawing.strokes = function (lines, colour, width, dash) {
    if (["#8f3072", "#e79cca"].includes(colour)) dashes.push(dash?.length ?? 0);
    return strokes.call(this, lines, colour, width, dash);
  };
})()"""


@every
def test_all_of_an_experts_way_is_dashed_as_the_words_say(page: Browser) -> None:
    start(page, below=160.0)
    wait(page, "cutenvPage.page.cut.count > 200")
    page.value(EXPERT)
    page.value("document.getElementById('stop').click()")
    page.value("document.getElementById('watch').click()")
    wait(page, "cutenvPage.page.replay !== null && dashes.length > 4")
    assert page.value("document.getElementById('expert-words').textContent").startswith("Dashed: ")
    assert page.value("dashes.every(each => each > 0)")


@every
@pytest.mark.parametrize("language", ["en", "de"])
def test_it_fits_a_telephone_and_can_be_read(browser: Browser, written: Path, language: str) -> None:
    open_on_telephone(browser, written, language, dark=language == "de")
    if written.stem == "depth":
        assert browser.accessible("slider", {"en": "Height of the blade", "de": "Höhe der Klinge"}[language]) == 1
    else:
        assert "mm" in browser.value("document.getElementById('aside').textContent")


def test_bad_lines_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert single_page.main([str(tmp_path / "new" / "cut.html"), "--line", "arc"]) == 2
    assert "--line arc is for cuts along a drawn line. Give --task path too" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()
    with pytest.raises(ValueError, match="line must be one of"):
        page_alone(tasks=("path",), lines=("spiral",))
    with pytest.raises(ValueError, match="lines is empty"):
        page_alone(tasks=("path",), lines=())
