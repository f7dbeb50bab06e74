"""An educator's way, walked in a real browser: class, cuts of three people, marks, study, sheets, export, backup."""

from __future__ import annotations

import csv
import io
import json
import re
import zipfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from scripts.browsers import chromium

pytest.importorskip("starlette", reason="the server is an extra: pip install 'cutenv[serve]'")
pytest.importorskip("httpx2", reason="asks the server in its tests: pip install 'cutenv[dev]'")

from cutenv.commands.cli import main
from cutenv.people.classroom import ClassStore
from cutenv.records import load_one
from scripts.validation.classroom.class_load import Served

pytestmark = pytest.mark.needs("chromium")

CUT = """(async () => {
  const { page, stylus, start } = cutenvPage;
  await start();
  while (page.phase !== "cutting") await new Promise(done => setTimeout(done, 50));
  const { cut } = page, forward = () => [cut.hand + 0.0006, 0.5 * Math.PI];
  while (cut.blade < cut.target - %s && !cut.end) cut.advance([forward()]);
  stylus.position = cut.hand;
  page.phase = "resting";  // until the cut has taken its time
  while (performance.now() < page.from + cut.count) await new Promise(done => setTimeout(done, 50));
  document.getElementById("stop").click();
  while (page.busy) await new Promise(done => setTimeout(done, 50));
  return document.getElementById("kept").textContent;
})()"""


TO_THE_END = re.sub(
    r"while \(cut.blade.*\n",
    """let back = false;
  while (!cut.end) {
    back ||= cut.tip > cut.target - 0.001;
    cut.advance([[cut.hand + (back ? cut.last("force") > 0.2 ? -1e-5 : 0 : 1e-5), 0.5 * Math.PI]]);
  }
""",
    CUT,
)
"""The same, back from the target until little pulls, and at rest until the cut has ended."""


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    server = Served(tmp_path / "class")
    yield server
    server.end()


def test_an_educators_way(browser: chromium.Browser, served: Served, tmp_path: Path) -> None:
    def go(path: str, width: int = 1100, *, dark: bool = False) -> None:
        browser.open(served.address + path, width, dark=dark)
        browser.wait(f"location.href.startsWith({json.dumps(served.address)})")

    def submit(selector: str, arrived: str, button: str = "button", **values: str) -> None:
        for name, value in values.items():
            browser.value(f"document.querySelector('{selector} [name={name}]').value = {json.dumps(value)}")
        browser.value(f"document.querySelector('{selector} {button}').click()")
        browser.wait(arrived)

    def said() -> str:
        return str(browser.value("document.querySelector('main').textContent"))

    def sign_in() -> None:
        go("teacher")
        submit("form", "document.querySelector('form[action=\"teacher/codes\"]')", token=served.token)

    def made(kind: str, **values: str) -> str:
        """Address of a study or of pass marks, once they are worked out; the page looks again by itself."""
        go("teacher/studies")
        submit("form[action=studies]", "location.pathname.startsWith('/teacher/studies/')", f"[value={kind}]", **values)
        browser.wait("document.querySelector('a[href$=\".zip\"], [role=alert]')")
        assert "Tables: " in said(), said()
        return str(browser.value("location.pathname"))[1:]

    # A class, its codes, and a pass mark of the teacher's own
    sign_in()
    rows = "document.querySelectorAll('th[scope=row]').length"
    submit('form[action="teacher/codes"]', f"{rows} === 3", count="3", class_name="2b")
    codes = browser.value("[...document.querySelectorAll('th[scope=row]')].map(each => each.textContent)")
    go("teacher/sheet")
    assert all(code in browser.value("document.body.textContent") for code in codes)
    go("teacher/studies")
    submit("form[action=pass-mark]", "document.querySelector('[name=withdraw]')", mark="90")

    # Three trainees of two cuts each, one after the other at the same machine
    go("")
    for person, code in enumerate(codes):
        browser.value("document.querySelector('[name=consent]').checked = true")
        submit("form", "window.cutenvPage", code=code)
        assert browser.value("document.querySelector('header b').textContent") == code
        for _ in range(2):
            kept = browser.value(CUT % (0.005 * person + 0.02))
            assert kept.startswith("Saved. Score ")
            assert "Not yet passed: it takes 90." in kept
            assert browser.value("document.querySelectorAll('#tries li').length") >= 1
        browser.wait("document.querySelectorAll('main #history tr').length === 3")
        longest = "texts => [...document.querySelectorAll('#results dt')].find(each => each.textContent === texts)"
        shown = browser.value(f"({longest})('longest sudden run').nextSibling.textContent")
        assert shown == browser.value("`${(1e3 * cutenvPage.page.kept.numbers.largest_jump).toFixed(1)} mm`")
        browser.wait("document.querySelectorAll('#curve circle').length === 2")
        browser.value("document.getElementById('watch').click()")
        browser.wait("cutenvPage.page.replay?.cut.count > 50 && document.getElementById('compared').rows.length === 5")
        submit("form[action=leave]", "document.querySelector('[name=consent]')")
        assert browser.errors() == []
        assert browser.complaints() == []
        assert [each for each in browser.requests() if not each.startswith((served.address, "data:", "blob:"))] == []

    sign_in()
    assert browser.value("document.querySelectorAll('td.small svg').length") == 3
    browser.value("(window.left = true, document.querySelector('td a[href]').click())")
    browser.wait("!window.left && document.querySelector('svg, img')")
    assert codes[0] in browser.value("document.body.textContent")

    # A record of another program, dropped on the page
    table = "t [s],F [N],x [mm]\n" + "\n".join(f"{k / 1000},{(k > 300) * k / 500},{k / 20}" for k in range(1500))
    (tmp_path / "other.csv").write_text(table)
    go("teacher/upload")
    box = browser.value("(({ x, y }) => [x + 30, y + 9])(document.querySelector('.drop').getBoundingClientRect())")
    held = {"items": [], "files": [str(tmp_path / "other.csv")], "dragOperationsMask": 1}
    for moment in ("dragEnter", "dragOver", "drop"):
        browser.tell("Input.dispatchDragEvent", type=moment, x=box[0], y=box[1], data=held)
    browser.wait("document.querySelector('.drop').files.length")
    submit("form", "document.querySelector('.preview')")
    assert browser.value("document.querySelector('[name=force]').selectedOptions[0].textContent") == "2 F [N]"
    submit("form", "document.querySelector('[value=keep]')", "[value=look]")
    browser.value("document.querySelector('[name=consent]').checked = true")
    submit("form", "location.pathname.startsWith('/teacher/people/')", "[value=keep]", code=codes[2])
    assert "from another program, not confirmed by the law" in said()

    # Pass marks: two groups of too few people, then a mark of the teacher's own
    for group, members in (("novice", codes[:2]), ("trained", codes[2:])):
        go("teacher")
        for code in members:
            browser.value(f"document.querySelector('[name=code][value={code}]').checked = true")
        submit('form[action="teacher/places"]', f"document.body.textContent.includes('{group}')", group=group)
    go("teacher/studies")
    groups = {"passing": "trained", "failing": "novice"}
    submit("form[action=studies]", "document.querySelector('[role=alert]')", "[value=pass-mark]", **groups)
    assert "Too few people: a pass mark between two groups takes 3 people" in said()
    page = made("pass-mark", mark="60", **groups)
    submit("table form", "document.querySelector('form[action=pass-mark]')")
    assert "60 (your own, 2b, " in said()
    go(f"{page}/pass-mark.html")
    headline = browser.value("document.querySelector('.headline').textContent")
    assert re.search(r"Overall score: 60\S* or more passes, set by the teacher", headline), headline

    # A study with sheets to print
    page = made("study", **groups)
    for name, words in (("study", "6 cuts of 3 operators"), (codes[1], "pass at 60"), ("class", "Pass mark: 60")):
        go(f"{page}/{name}.html", 400)
        assert words in browser.value("document.body.textContent")
        assert browser.value("document.documentElement.scrollWidth") <= 400

    # Export, and a backup
    teacher = served.client()
    assert teacher.post("teacher", data={"token": served.token}).status_code == 303
    with zipfile.ZipFile(io.BytesIO(teacher.get(f"{page}/all.zip").content)) as archive:
        assert {"study.html", "class.csv", *(f"{code}.html" for code in codes)} <= set(archive.namelist())
    with zipfile.ZipFile(io.BytesIO(teacher.get("teacher/records.zip").content)) as archive:
        archive.extractall(tmp_path / "export")
    exported = list(csv.DictReader((tmp_path / "export" / "cuts.csv").open()))
    kept = sorted(row["confirmed_by_law"] for row in exported if row["state"] != "prepared")
    assert kept == ["no, from another program", *["yes"] * 6]
    records = sorted((tmp_path / "export").glob("*/*.csv"))
    assert {load_one(path).metadata["operator"] for path in records} == set(codes)
    backup = tmp_path / "class.zip"
    assert main(["serve", str(served.folder), "--backup", str(backup)]) == 0

    # One person is deleted, from the study too, and comes back from the backup
    go("teacher")
    submit('form[action="teacher/delete"]', f"{rows} === 2", code=codes[0], again=codes[0])
    assert not (served.folder / "records" / codes[0]).exists()
    assert teacher.get(page).status_code == 404
    assert main(["serve", str(tmp_path / "restored"), "--restore", str(backup)]) == 0
    restored = {path.name: path.read_bytes() for path in (tmp_path / "restored" / "records").rglob("*.csv")}
    assert restored == {path.name: path.read_bytes() for path in records}
    store = ClassStore(f"sqlite:///{tmp_path / 'restored' / 'class.db'}")
    assert store.places()[codes[0]] == ("2b", "novice", "")
    assert store.pass_mark("") is not None
    store.close()
    assert main(["serve", str(tmp_path / "restored"), "--restore", str(backup)]) == 2, "it is not empty any more"


def test_the_last_card_of_a_course_stays_when_nothing_comes_next(browser: chromium.Browser, tmp_path: Path) -> None:
    course = 'name = "short"\n[[task]]\nname = "liver"\nspecimen_class = "liver"\ntarget_length_mm = 20\nseeds = [5]\n'
    (tmp_path / "short.toml").write_text(course, encoding="utf-8")
    served = Served(tmp_path / "class", "--course", str(tmp_path / "short.toml"))
    teacher = served.client()
    teacher.post("teacher", data={"token": served.token})
    teacher.post("teacher/codes", data={"count": "1"})
    (code,) = re.findall(r"people/(\w+)", teacher.get("teacher").text)
    browser.open(served.address, 1100)
    browser.value(f"document.querySelector('[name=code]').value = '{code}'")
    browser.value("document.querySelector('[name=consent]').checked = true")
    browser.value("document.querySelector('button.first').click()")
    browser.wait("window.cutenvPage?.page?.cut")
    assert "This cut counts." in browser.value(TO_THE_END)
    shown = "['results', 'tries', 'kept'].map(name => document.getElementById(name).textContent)"
    before = browser.value(shown)
    browser.value("document.getElementById('start').click()")
    browser.wait("cutenvPage.page.done && !cutenvPage.page.busy")
    assert "is done: 1 of 1 tasks" in browser.value("document.getElementById('course').textContent")
    assert all(before)
    assert browser.value(shown) == before
    assert browser.value("document.getElementById('start').disabled") is True
    served.end()
