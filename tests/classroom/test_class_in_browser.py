"""An educator's way, walked in a real browser: class, codes, cuts of three people, marks, export, deletion, backup."""

from __future__ import annotations

import csv
import io
import json
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import chromium
import pytest

pytest.importorskip("starlette", reason="the server is an extra: pip install 'cutenv[serve]'")
pytest.importorskip("httpx2", reason="asks the server in its tests: pip install 'cutenv[dev]'")

from class_load import Served

from cutenv.cli import main
from cutenv.recording import load_one

pytestmark = pytest.mark.skipif(chromium.PROGRAM is None, reason="needs a browser: Debian's chromium")

CUT = """(async () => {
  const { page, stylus, start } = cutenvPage;
  await start();
  while (page.phase !== "cutting") await new Promise(done => setTimeout(done, 50));
  const { cut } = page, forward = () => [cut.hand + 0.0006, 0.5 * Math.PI];
  while (cut.blade < cut.target - %s && !cut.end) cut.advance([forward()]);
  stylus.position = cut.hand;
  document.getElementById("stop").click();
  while (page.busy) await new Promise(done => setTimeout(done, 50));
  return document.getElementById("kept").textContent;
})()"""


class Address:
    """An address, where the browser's driver wants a path."""

    def __init__(self, address: str) -> None:
        self._address = address

    def as_uri(self) -> str:
        return self._address


@pytest.fixture
def served(tmp_path: Path) -> Iterator[Served]:
    server = Served(tmp_path / "class")
    yield server
    server.end()


def wait(browser: chromium.Browser, condition: str) -> None:
    until = time.monotonic() + chromium.PATIENCE_S
    while not browser.value(f"document.readyState === 'complete' && Boolean({condition})"):
        assert time.monotonic() < until, condition
        time.sleep(0.05)


def test_an_educators_way(browser: chromium.Browser, served: Served, tmp_path: Path) -> None:
    def go(path: str, width: int = 1100, *, dark: bool = False) -> None:
        address: Any = Address(served.address + path)
        browser.open(address, width, dark=dark)
        wait(browser, f"location.href.startsWith({json.dumps(served.address)})")

    def submit(selector: str, arrived: str, **values: str) -> None:
        for name, value in values.items():
            browser.value(f"document.querySelector('{selector} [name={name}]').value = {json.dumps(value)}")
        browser.value(f"document.querySelector('{selector} button').click()")
        wait(browser, arrived)

    def sign_in() -> None:
        go("teacher")
        submit("form", "document.querySelector('form[action=\"teacher/codes\"]')", token=served.token)

    sign_in()
    submit('form[action="teacher/codes"]', "document.querySelectorAll('th[scope=row]').length === 3", count="3")
    codes = browser.value("[...document.querySelectorAll('th[scope=row]')].map(each => each.textContent)")
    go("teacher/sheet")
    assert all(code in browser.value("document.body.textContent") for code in codes)

    for person, code in enumerate(codes):
        go("")
        if browser.value("location.pathname") == "/cut":
            submit("form[action=leave]", "document.querySelector('[name=consent]')")
        browser.value("document.querySelector('[name=consent]').checked = true")
        submit("form", "window.cutenvPage", code=code)
        assert browser.value("document.querySelector('section b').textContent") == code
        for _ in range(2):
            assert browser.value(CUT % (0.005 * person + 0.02)).startswith("Saved. Score ")
        wait(browser, "document.querySelectorAll('#history tr').length === 3")
        assert browser.errors() == []
        assert browser.complaints() == []
        assert [each for each in browser.requests() if not each.startswith((served.address, "data:", "blob:"))] == []

    go("cut")
    submit("form[action=leave]", "document.querySelector('[name=consent]')")
    sign_in()
    browser.value("document.querySelector('td a').click()")
    wait(browser, "document.querySelector('svg, img')")
    assert codes[0] in browser.value("document.body.textContent")
    go("teacher")
    teacher = served.client()
    assert teacher.post("teacher", data={"token": served.token}).status_code == 303
    with zipfile.ZipFile(io.BytesIO(teacher.get("teacher/records.zip").content)) as archive:
        archive.extractall(tmp_path / "export")
    rows = list(csv.DictReader((tmp_path / "export" / "cuts.csv").open()))
    assert sorted(row["state"] for row in rows if row["state"] != "prepared") == ["saved"] * 6
    records = sorted((tmp_path / "export").rglob("*-0_*.csv"))
    assert {load_one(path).metadata["operator"] for path in records} == set(codes)

    backup = tmp_path / "class.zip"
    assert main(["serve", str(served.folder), "--backup", str(backup)]) == 0
    submit('form[action="teacher/delete"]', "document.querySelectorAll('th[scope=row]').length === 2",
           code=codes[0], again=codes[0])  # fmt: skip
    assert not (served.folder / "records" / codes[0]).exists()
    assert main(["serve", str(tmp_path / "restored"), "--restore", str(backup)]) == 0
    restored = {path.name: path.read_bytes() for path in (tmp_path / "restored" / "records").rglob("*.csv")}
    assert restored == {path.name: path.read_bytes() for path in records}
    assert main(["serve", str(tmp_path / "restored"), "--restore", str(backup)]) == 2, "it is not empty any more"


@pytest.mark.parametrize("dark", [False, True])
def test_pages_fit_a_telephone_and_can_be_read(browser: chromium.Browser, served: Served, dark: bool) -> None:
    for path in ("", "teacher"):
        address: Any = Address(served.address + path)
        browser.open(address, 400, dark=dark)
        wait(browser, "document.querySelector('form')")
        assert browser.value("document.documentElement.scrollWidth") <= 400
        assert browser.value(chromium.LEAST_CONTRAST) >= 4.5
