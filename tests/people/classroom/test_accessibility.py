"""Pages of a class and the page that cuts: no serious finding of axe, and nothing lost when text is twice as large."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from class_room import TOKEN, Room, cut_once, to_the_end

from cutenv.people.browser import write_page_alone
from cutenv.people.classroom.class_server import class_app
from cutenv.people.classroom.class_site import ClassSite
from cutenv.people.play.course import course_of
from scripts import test_programs
from scripts.validation.classroom.class_load import Served

pytestmark = pytest.mark.needs("chromium")
CUTTING = ("cut", "card of a cut")
PAGES = ("enter", "sign in", "teacher", "live", "course", "studies", "upload", "sheet", "person", *CUTTING)
FOUND = """(async () => {
  const found = await axe.run(document, { resultTypes: ["violations"] });
  return found.violations.filter(each => ["serious", "critical"].includes(each.impact)).map(({ id, nodes }) =>
    `${id}: ${nodes.slice(0, 3).map(each => each.html.slice(0, 120)).join(" | ")}`);
})()"""
CUT_OFF = """(width => {
  const lost = [], wide = document.documentElement.scrollWidth - width;
  if (wide > 0) lost.push(`the page is ${wide} px too wide`);
  const scrolls = each => each && (/auto|scroll/.test(getComputedStyle(each).overflowX) || scrolls(each.parentElement));
  for (const each of document.querySelectorAll("body *")) {
    const text = [...each.childNodes].some(node => node.nodeType === 3 && node.data.trim());
    if (!text || !each.checkVisibility() || each.closest("svg, option, script, style")) continue;
    const style = getComputedStyle(each), box = each.getBoundingClientRect();
    const larger = each.scrollWidth > each.clientWidth + 1 || each.scrollHeight > each.clientHeight + 1;
    const hides = /hidden|clip/.test(style.overflow) && larger;
    if (hides || (box.right > width + 1 && !scrolls(each.parentElement))) lost.push(each.outerHTML.slice(0, 100));
  }
  return lost;
})"""
READY = """(async () => {
  while (!window.cutenvPage?.page?.cut) await new Promise(done => setTimeout(done, 50));
})()"""
BEGUN = """(async () => {
  await cutenvPage.start();
  while (cutenvPage.page.phase !== "cutting") await new Promise(done => setTimeout(done, 50));
})()"""
SAVED = """(async () => {
  const { page } = cutenvPage, there = each => document.querySelector(each);
  const wait = () => new Promise(done => setTimeout(done, 50));
  while (page.busy || !there("#comments li") || !there("#history button")) await wait();
  return Boolean(page.kept);
})()"""
CARD = """(async () => {
  const { page, start } = cutenvPage;
  await start();
  while (page.phase !== "cutting") await new Promise(done => setTimeout(done, 50));
  page.cut.advance(Array.from({ length: 200 }, (_, k) => [1e-5 * k, 0.5 * Math.PI]));
  document.getElementById("stop").click();
  return document.getElementById("card").hidden;
})()"""


@pytest.fixture(scope="module", params=["en", "de"])
def pages(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Path]]:
    """Every page in a language, as a file that a browser opens without a server."""
    folder, language = tmp_path_factory.mktemp("pages"), request.param
    room = Room(folder)
    room.lesson.courses.set(course_of({"name": "surgeons", "task": [{"name": "one", "specimen_class": "uniform"}]}))
    room.app = class_app(ClassSite(lesson=room.lesson, secret=TOKEN, language=language))
    further = {"name": "nurses", "task": [{"name": "one", "specimen_class": "uniform"}], "warm_up": 1}
    room.lesson.courses.set(course_of(further), "nurses")
    for code in ("P01", "P02", "P03"):
        cut_once(room.person(code), to_the_end())
    room.lesson.put(["P03"], class_name="2b", group="novice", course="nurses")
    room.store.set_pass_mark("surgeons", 60.0, "x")
    room.store.comment("P01", "Slower before the target.")
    teacher, made = room.teacher(), {}
    paths = {name: f"/teacher/{name}" for name in ("live", "course", "studies", "upload", "sheet")}
    paths |= {"teacher": "/teacher", "person": "/teacher/people/P01"}
    contents = {name: teacher.get(path).text for name, path in paths.items()}
    contents |= {"enter": room.client().get("/").text, "sign in": room.client().get("/teacher").text}
    for name, content in contents.items():
        made[name] = folder / f"{name}.html"
        made[name].write_text(content, encoding="utf-8")
    made["cut"] = made["card of a cut"] = folder / "cut.html"
    write_page_alone(made["cut"], count=1, tasks=["gentle", "depth"], specimen_classes=["liver"], language=language)
    yield made
    room.lesson.close()


def opened(browser: Any, pages: dict[str, Path], name: str, width: int, *, dark: bool = False) -> None:
    browser.open(pages[name], width, dark=dark)
    if name in CUTTING:
        browser.value(READY)
    if name == "card of a cut":
        assert browser.value(CARD) is False


@pytest.mark.needs("axe-core")
@pytest.mark.parametrize("name", PAGES)
def test_axe_finds_nothing_serious(
    browser: Any, pages: dict[str, Path], name: str, request: pytest.FixtureRequest
) -> None:
    """In both languages, one of them in the light and the other in the dark, by turns from page to page."""
    axe = test_programs.axe_core()
    assert axe is not None
    german = request.node.callspec.params["pages"] == "de"
    opened(browser, pages, name, 1100, dark=german == (PAGES.index(name) % 2 == 0))
    browser.value(axe.read_text(encoding="utf-8") + ";0")
    assert browser.value(FOUND) == []


@pytest.mark.needs("axe-core")
@pytest.mark.parametrize(("language", "dark"), [("en", True), ("de", False)])
def test_axe_finds_nothing_serious_on_the_served_page_that_cuts(
    browser: Any, tmp_path: Path, language: str, dark: bool
) -> None:
    """Before the cut and after it, with card, history and comment; with a handle on a serial port."""
    axe = test_programs.axe_core()
    assert axe is not None
    with Served(tmp_path / "class", "--language", language) as served:
        teacher = served.client()
        teacher.post("teacher", data={"token": served.token})
        teacher.post("teacher/codes", data={"count": "1"})
        (code,) = set(re.findall(r"people/(\w+)", teacher.get("teacher").text))
        teacher.post(f"teacher/people/{code}/comment", data={"said": "Slower before the target."})
        for name, value in served.person(code).cookies.items():
            browser.tell("Network.setCookie", name=name, value=value, url=served.address)
        browser.open(f"{served.address}cut", 1100, dark=dark)
        browser.value(READY)
        assert browser.value("document.documentElement.lang") == language
        browser.value(axe.read_text(encoding="utf-8") + ";0")
        browser.value("void (document.getElementById('serial').hidden = false)")
        assert browser.value(FOUND) == []
        assert browser.value(CARD) is False
        assert browser.value(SAVED) is True
        assert browser.value(FOUND) == []


@pytest.mark.parametrize("name", PAGES)
def test_text_twice_as_large_loses_nothing(browser: Any, pages: dict[str, Path], name: str) -> None:
    """On a telephone and on a desk, between which the window changes."""
    browser.tell("Page.setFontSizes", fontSizes={"standard": 32, "fixed": 26})
    try:
        opened(browser, pages, name, 390)
        assert browser.value("getComputedStyle(document.body).fontSize") == "32px"
        for width in (390, 1280):
            size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": width < 700}
            browser.tell("Emulation.setDeviceMetricsOverride", **size)
            assert browser.value("innerWidth") == width
            assert browser.value(f"{CUT_OFF}({width})") == []
    finally:
        browser.tell("Page.setFontSizes", fontSizes={"standard": 16, "fixed": 13})


AIDED = """(async () => {
  const { page, start, aids } = cutenvPage;
  for (const name of ["sound", "vibration"]) document.getElementById(name).click();
  const pulses = [];
  navigator.vibrate = pulse => pulses.push(pulse);
  await start();
  while (page.phase !== "cutting") await new Promise(done => setTimeout(done, 50));
  for (let from = 0; from < 1600; from += 200) {
    page.cut.advance(Array.from({ length: 200 }, (_, k) => [1.2e-5 * (from + k), 0.5 * Math.PI]));
  }
  while (!pulses.length) await new Promise(done => setTimeout(done, 20));
  const { part } = aids, heard = aids.tone.frequency.value;
  page.handedOut = { ...page.handedOut, feedback: "never" };
  await new Promise(done => setTimeout(done, 200));
  const hidden = aids.part;
  page.handedOut = undefined;
  document.getElementById("stop").click();
  await new Promise(done => setTimeout(done, 200));
  return { part, heard, hidden, after: aids.part, pulse: pulses[0], text: page.cut.csv("", false) };
})()"""


@pytest.fixture
def cutting(browser: Any, pages: dict[str, Path]) -> Any:
    """The page that cuts, in the browser."""
    opened(browser, pages, "cut", 1280)
    return browser


def test_the_force_is_heard_and_felt_if_asked_for_and_the_record_says_so(cutting: Any) -> None:
    assert cutting.value("[...document.querySelectorAll('#aids input')].some(each => each.checked)") is False
    found = cutting.value(AIDED)
    assert 0.0 < found["part"] <= 1.0
    assert found["heard"] >= 180.0
    assert 0 <= found["pulse"] <= 100
    assert (found["hidden"], found["after"]) == (None, None), "what a course hides is not heard either"
    assert '"device_aids":["sound","vibration"]' in found["text"]


def test_without_aids_the_record_names_none(cutting: Any) -> None:
    assert cutting.value(CARD) is False
    assert cutting.value("cutenvPage.page.cut.csv('', false).includes('device_aids')") is False


def test_the_left_hand_has_controls_and_keys_on_its_side(cutting: Any) -> None:
    left_of = (
        "document.querySelector('aside').getBoundingClientRect().left < "
        "document.getElementById('stage').getBoundingClientRect().left"
    )
    assert cutting.value(left_of) is False
    cutting.value("document.getElementById('left-hand').click()")
    assert cutting.value(left_of) is True
    cutting.value(BEGUN)
    press = "document.getElementById('picture').dispatchEvent(new KeyboardEvent('%s', { code: '%s', key: 'x' }))"
    cutting.value(press % ("keydown", "KeyD"))
    assert cutting.value("[...cutenvPage.stylus.keys].join()") == "ArrowRight"
    cutting.value(press % ("keyup", "KeyD"))
    assert cutting.value("cutenvPage.stylus.keys.size") == 0
    cutting.value(press % ("keydown", "KeyQ"))
    assert cutting.value("cutenvPage.stylus.angle") < 1.55
