"""The page in a learning platform: a valid SCORM 1.2 package that reports score and status, and goes on later."""

from __future__ import annotations

import functools
import http.server
import json
import re
import shutil
import threading
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from scripts import test_programs
from scripts.browsers import chromium, firefox

pytest.importorskip("jinja2", reason="pages are an extra: pip install 'cutenv[view]'")

from cutenv.commands import single_page
from cutenv.people.browser import write_scorm_package

Browser = chromium.Browser | firefox.Browser
CP = "{http://www.imsproject.org/xsd/imscp_rootv1p1p2}"
ADL = "{http://www.adlnet.org/xsd/adlcp_rootv1p2}"

# A learning platform that allows what SCORM 1.2's data model allows and nothing else; what it keeps outlives the page.
STRICT = r"""
const decimal = text => /^-?\d+(\.\d+)?$/.test(text);
const hundred = text => decimal(text) && Number(text) >= 0 && Number(text) <= 100;
const MODEL = {
  "cmi.core.score.raw": hundred, "cmi.core.score.min": hundred, "cmi.core.score.max": hundred,
  "cmi.core.lesson_status": text => ["passed", "completed", "failed", "incomplete", "browsed"].includes(text),
  "cmi.core.exit": text => ["time-out", "suspend", "logout", ""].includes(text),
  "cmi.core.session_time": text => /^\d{2,4}:[0-5]\d:[0-5]\d(\.\d{1,2})?$/.test(text),
  "cmi.suspend_data": text => text.length <= 4096 && /^[\x20-\x7e]*$/.test(text),
};
const WRITE_ONLY = ["cmi.core.exit", "cmi.core.session_time"];
const kept = window.kept = { values: { "cmi.core.lesson_status": "not attempted" }, calls: [], refused: [] };
let state = "before", error = "0";
const answer = (call, code, said) => {
  error = code;
  kept.calls.push(call);
  if (code !== "0") { kept.refused.push([call, code]); return "false"; }
  return said;
};
const allowed = (call, args, during, then) => {
  if (args.some(each => typeof each !== "string")) return answer(call, "201");
  if (state !== during) return answer(call, during === "before" ? "101" : "301");
  return then();
};
window.API = {
  LMSInitialize: (...a) => allowed("initialize", a, "before", () => {
    if (a.join() !== "" || a.length !== 1) return answer("initialize", "201");
    const { values } = kept;
    if (values["cmi.core.exit"] !== "suspend") values["cmi.suspend_data"] = "";
    state = "open";
    return answer("initialize", "0", "true");
  }),
  LMSGetValue: (...a) => allowed("get", a, "open", () => {
    if (WRITE_ONLY.includes(a[0])) return answer("get", "404");
    return a[0] in MODEL ? answer("get", "0", kept.values[a[0]] ?? "") : answer("get", "201");
  }),
  LMSSetValue: (...a) => allowed("set", a, "open", () => {
    if (!(a[0] in MODEL) || a.length !== 2) return answer(`set ${a}`, "201");
    if (!MODEL[a[0]](a[1])) return answer(`set ${a}`, "405");
    kept.values[a[0]] = a[1];
    return answer("set", "0", "true");
  }),
  LMSCommit: (...a) => allowed("commit", a, "open", () => answer("commit", a.join() === "" ? "0" : "201", "true")),
  LMSFinish: (...a) => allowed("finish", a, "open", () => { state = "before"; return answer("finish", "0", "true"); }),
  LMSGetLastError: () => error,
  LMSGetErrorString: code => ({ "0": "", 301: "Not initialized", 405: "Incorrect data type" })[code] ?? "Other",
  LMSGetDiagnostic: code => code,
};
"""


class Course:
    """A learning platform's site: the unpacked package in a frame, and a runtime around it."""

    def __init__(self, folder: Path, browser: Browser) -> None:
        self.folder, self.browser = folder, browser
        quiet = type("Quiet", (http.server.SimpleHTTPRequestHandler,), {"log_message": lambda *_: None})
        self.server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(quiet, directory=str(folder)))
        threading.Thread(target=self.server.serve_forever, daemon=True).start()

    def enter(self, runtime: str, **options: Any) -> None:
        """Open a platform that has this runtime, and a new package in it."""
        write_scorm_package(self.folder / "cut.zip", specimen_classes=["liver"], seed=3, **options)
        with zipfile.ZipFile(self.folder / "cut.zip") as package:
            package.extractall(self.folder)
        page = (
            f"<!DOCTYPE html><title>platform</title><iframe width=1000 height=800></iframe><script>{runtime}</script>"
        )
        (self.folder / "platform.html").write_text(page, encoding="utf-8")
        self.browser.open(f"http://127.0.0.1:{self.server.server_port}/platform.html", 1100)
        self.launch()

    def launch(self) -> None:
        self.browser.value("void (document.querySelector('iframe').src = 'cut.html')")
        self.wait("frames[0].cutenvPage")

    def leave(self) -> None:
        self.browser.value("void (document.querySelector('iframe').src = 'about:blank')")
        self.wait("frames[0].location.href === 'about:blank'")

    def wait(self, condition: str) -> None:
        until = time.monotonic() + chromium.PATIENCE_S
        while not self.browser.value(f"Boolean({condition})"):
            assert time.monotonic() < until, condition
            time.sleep(0.05)

    def cut(self, beyond: float) -> None:
        """Cut the specimen that is shown, so far beyond its target [m], draw back, hold still until it ends."""
        self.browser.value("void frames[0].cutenvPage.start()")
        self.wait("frames[0].cutenvPage.page.phase === 'cutting'")
        self.browser.value(f"""void (({{ page, stylus }}) => {{
          const {{ cut }} = page;
          let at = 0;
          const third = cut.map ? [0] : []; // level, or place across
          const feed = (pace, most) => {{
            for (let i = 0; i < most && !cut.end; i++) cut.advance([[at += pace, 0.5 * Math.PI, ...third]]);
          }};
          while (cut.tip < cut.target + {beyond} && !cut.end) feed(1e-5, 20);
          while (cut.last("force") > 0.2 && !cut.end) feed(-4e-6, 20);
          feed(0, 30000);
          stylus.position = cut.hand;
        }})(frames[0].cutenvPage)""")
        self.wait("frames[0].cutenvPage.page.phase === 'ended'")

    def says(self) -> str:
        said: str = self.browser.value("frames[0].document.getElementById('platform').textContent")
        return said

    def score(self) -> float:
        total = "frames[0].cutenvPage.page.points.reduce((sum, each) => sum + each.points, 0)"
        return round(float(self.browser.value(total)), 1)


@pytest.fixture
def course(tmp_path: Path, browser: Browser) -> Iterator[Course]:
    made = Course(tmp_path, browser)
    yield made
    made.server.shutdown()
    made.server.server_close()


def test_a_strict_platform_takes_everything_and_the_next_session_goes_on(course: Course) -> None:
    course.enter(STRICT, count=2, pass_mark=55.0)
    kept = "cmi.core."

    def values() -> dict[str, str]:
        found: dict[str, str] = course.browser.value("kept.values")
        return found

    assert values()[kept + "lesson_status"] == "incomplete"
    assert "55 are needed to pass" in course.says()
    course.cut(beyond=-0.03)
    missed = course.score()
    assert missed < 55.0
    assert values()[kept + "score.raw"] == f"{missed:g}"
    assert (values()[kept + "score.min"], values()[kept + "score.max"]) == ("0", "100")
    assert values()[kept + "lesson_status"] == "incomplete"
    assert json.loads(values()["cmi.suspend_data"]) == {"cuts": 1, "best": missed, "done": "10"}
    course.leave()
    assert course.browser.value("kept.calls.at(-1)") == "finish"

    course.launch()
    assert course.browser.value("frames[0].cutenvPage.page.chosen") == 1, "the first specimen has been cut"
    course.cut(beyond=-0.002)
    best = course.score()
    assert best >= 55.0
    assert values()[kept + "score.raw"] == f"{best:g}"
    assert values()[kept + "lesson_status"] == "passed"
    assert json.loads(values()["cmi.suspend_data"]) == {"cuts": 2, "best": best, "done": "11"}
    assert "Passed." in course.says()
    assert "Specimens cut: 2 of 2" in course.says()

    course.browser.value("void (frames[0].document.getElementById('practice').checked = true)")
    course.cut(beyond=-0.002)
    assert json.loads(values()["cmi.suspend_data"])["cuts"] == 2, "practice is not reported"
    assert "practice" in course.says()
    course.leave()
    assert course.browser.value("kept.refused") == []
    assert course.browser.value("kept.calls.filter(each => each === 'commit').length") >= 4


@pytest.mark.parametrize(("mark", "status"), [(None, "completed"), (100.0, "failed")])
def test_status_after_every_specimen(course: Course, mark: float | None, status: str) -> None:
    course.enter(STRICT, count=1, pass_mark=mark)
    course.cut(beyond=-0.04)
    assert course.browser.value("kept.values['cmi.core.lesson_status']") == status
    assert course.browser.value("kept.refused") == []


@pytest.mark.parametrize("task", ["depth", "path"])
def test_points_along_a_wanted_depth_or_a_line_are_reported(course: Course, task: str) -> None:
    course.enter(STRICT, count=1, tasks=[task], lines=["straight"])
    course.cut(beyond=-0.04)
    assert course.score() > 0.0
    assert course.browser.value("kept.values['cmi.core.score.raw']") == f"{course.score():g}"
    assert course.browser.value("kept.refused") == []


def test_progress_that_is_no_progress_begins_anew_and_a_refusal_is_told(course: Course) -> None:
    spoiled = 'kept.values["cmi.suspend_data"] = \'{"cuts":-1,"done":"2"}\'; kept.values["cmi.core.exit"] = "suspend";'
    course.enter(STRICT + spoiled, count=1)
    assert course.browser.value("frames[0].cutenvPage.page.chosen") == 0
    course.browser.value("void API.LMSFinish('')")
    course.cut(beyond=-0.04)
    assert "Not initialized" in course.says()


def test_without_a_platform_it_says_so_and_cuts(course: Course) -> None:
    course.enter("window.API = { unrelated: true }", count=1)
    assert course.says().startswith("No learning platform has opened this page")
    course.cut(beyond=-0.04)
    assert course.score() > 0.0


@pytest.mark.needs("scorm-again")
def test_a_kept_runtime_takes_it(course: Course) -> None:
    path = test_programs.scorm_again()
    assert path is not None
    shutil.copy(path, course.folder / "runtime.js")
    course.enter("</script><script src='runtime.js'></script><script>window.API = new Scorm12API({});", count=2)
    course.cut(beyond=-0.002)
    core = course.browser.value("JSON.parse(JSON.stringify(API.cmi.core))")
    assert core["score"]["raw"] == f"{course.score():g}"
    assert core["lesson_status"] == "incomplete"
    assert json.loads(course.browser.value("API.cmi.suspend_data"))["done"] == "10"
    course.leave()
    assert course.browser.value("API.isTerminated()") is True
    assert course.browser.value("String(API.lastErrorCode)") == "0"
    assert re.fullmatch(r"\d{2,4}:\d\d:\d\d(\.\d+)?", course.browser.value("API.cmi.getCurrentTotalTime()"))


def test_the_manifest_names_every_file_and_launches_the_page(tmp_path: Path) -> None:
    path = tmp_path / "cut.zip"
    write_scorm_package(path, specimen_classes=["liver"], count=1, language="de")
    with zipfile.ZipFile(path) as package:
        assert package.testzip() is None
        names = package.namelist()
        manifest = ElementTree.fromstring(package.read("imsmanifest.xml"))
        page = package.read("cut.html").decode()
    assert [child.tag for child in manifest] == [f"{CP}metadata", f"{CP}organizations", f"{CP}resources"]
    assert [each.text for each in manifest[0]] == ["ADL SCORM", "1.2"]
    identifiers = [each.get("identifier") for each in manifest.iter() if each.get("identifier")]
    assert len(set(identifiers)) == len(identifiers)
    assert all(re.fullmatch(r"[A-Za-z_][\w.-]*", str(each)) for each in identifiers)
    (organization,) = manifest[1]
    assert manifest[1].get("default") == organization.get("identifier")
    (item,) = organization.findall(f"{CP}item")
    (resource,) = manifest[2]
    assert item.get("identifierref") == resource.get("identifier")
    assert resource.get(f"{ADL}scormtype") == "sco"
    assert resource.get("href") == "cut.html"
    assert sorted(["imsmanifest.xml", *(str(file.get("href")) for file in resource)]) == sorted(names)
    assert [each.text for each in manifest.iter(f"{CP}title")] == ["Schonend schneiden"] * 2
    assert '"platform":{"mark":null}' in page
    again = tmp_path / "again.zip"
    write_scorm_package(again, specimen_classes=["liver"], count=1, language="de")
    assert again.read_bytes() == path.read_bytes()


def test_the_command_writes_the_package_beside_the_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page, package = tmp_path / "cut.html", tmp_path / "new" / "cut.zip"
    assert single_page.main([str(page), "--count", "1", "--scorm", str(package), "--pass-mark", "60"]) == 0
    assert "SCORM 1.2" in capsys.readouterr().out
    assert '"platform":null' in page.read_text(encoding="utf-8")
    with zipfile.ZipFile(package) as opened:
        assert b'"platform":{"mark":60.0}' in opened.read("cut.html")


@pytest.mark.parametrize(
    ("arguments", "named"),
    [(["--pass-mark", "60"], "--scorm"), (["--scorm", "x.zip", "--pass-mark", "101"], "pass_mark")],
)
def test_bad_options_of_a_package_are_named(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    named: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    assert single_page.main(["cut.html", *arguments]) == 2
    assert named in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
