"""A language is one file: a third one, made from the English texts, is found on every page and card."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from class_room import TOKEN, Room, cut_once
from recorded_cut import recorded_cut

from cutenv._base.language_files import (
    FOLDER_VARIABLE,
    course_texts,
    languages,
    missing_texts,
    phrases_from_english,
    shipped_names,
    texts_by_key,
)
from cutenv.agents.policy.shipped import SHIPPED
from cutenv.commands import cli
from cutenv.display.report.score_page import ScoredRecord, write_score_page
from cutenv.people.browser.page_alone import page_alone
from cutenv.people.classroom.class_server import class_app
from cutenv.people.classroom.class_site import ClassSite
from cutenv.records.scoring import score

VOWELS = str.maketrans("aeiouyAEIOUY", "àèìòùýÀÈÌÒÙÝ")
OURS = {"cutenv", "trained", "novice"} | {word for name in SHIPPED for word in name.split("-")}
"""Words of pages that are not texts: names that a teacher gives, and those of agents."""


def pseudo(text: str) -> str:
    """Return a text that can still be read, of which no word is English: vowels have an accent, but not in places."""
    parts = re.split(r"({\w+}|</?b>|&\w+;|%[A-Z])", text)
    return "".join(part if k % 2 else part.translate(VOWELS) for k, part in enumerate(parts))


def pseudo_file(folder: Path) -> Path:
    """Write the file of a language "xx" into a folder, from the English texts and the phrases that German has."""
    texts: dict[str, Any] = {key: pseudo(text) for key, text in texts_by_key("en").items()}
    texts["numbers_and_dates"] = {"decimal": "·", "list": ";", "date": "{day}/{month}/{year}"}
    texts["words_about_courses"] = {key: pseudo(text) for key, text in course_texts("en").items()}
    texts["names"] = {key: pseudo(key) for key in shipped_names("de")}
    texts["phrases"] = {key: pseudo(key) for key in phrases_from_english("de")}
    folder.mkdir()
    path = folder / "xx.json"
    path.write_text(json.dumps(texts), encoding="utf-8")
    return path


@pytest.fixture
def third(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = pseudo_file(tmp_path / "languages")
    monkeypatch.setenv(FOLDER_VARIABLE, str(path.parent))
    return path


def english(document: str) -> set[str]:
    """Words of a page that a reader sees or hears and that are not of the third language."""
    heard = " ".join(re.findall(r'(?:alt|aria-label|title)="([^"]*)"', document))
    seen = re.sub(r"<(style|script)\b.*?</\1>|<[^>]*>", " ", document, flags=re.DOTALL)
    words = re.findall(r"[^\W\d_]+", re.sub(r"\S*\d\S*|https?:\S+", " ", f"{seen} {heard}"))
    return {word for word in words if len(word) > 2 and re.search("[aeiou]", word)} - OURS


def test_german_lacks_nothing_and_keeps_the_places() -> None:
    assert missing_texts("de") == []
    for key, text in texts_by_key("en").items():
        assert sorted(re.findall("{.*?}", text)) == sorted(re.findall("{.*?}", texts_by_key("de")[key])), key
    for key, text in course_texts("en").items():
        assert sorted(re.findall("{.*?}", text)) == sorted(re.findall("{.*?}", course_texts("de")[key])), key


def test_what_a_file_lacks_is_named_and_stays_english(
    third: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert languages() == ("en", "de", "xx")
    assert missing_texts("xx") == []
    short = json.loads(third.read_text(encoding="utf-8"))
    del short["start"], short["words_about_courses"]["reached"], short["phrases"]["cuts"]
    folder = tmp_path / "further"
    folder.mkdir()
    (folder / "xx.json").write_text(third.read_text(encoding="utf-8"), encoding="utf-8")
    (folder / "xy.json").write_text(json.dumps(short), encoding="utf-8")
    monkeypatch.setenv(FOLDER_VARIABLE, str(folder))
    assert missing_texts("xy") == ["start", "words_about_courses: reached", "phrases: cuts"]
    assert (texts_by_key("xy")["start"], course_texts("xy")["reached"]) == ("Start", "Mark reached.")
    assert cli.main(["single-page", str(tmp_path / "cut.html"), "--count", "1", "--language", "xy"]) == 0
    said = capsys.readouterr().err
    assert "lacks 3 texts, which stay English: start, words_about_courses: reached, phrases: cuts" in said


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "it is no JSON"),
        ("[]", "it must hold texts by key"),
        ('{"start": 3}', "start = 3 is no text"),
        ('{"number": "Nr. {nummer}"}', "number: {nummer} does not stand in the English text 'number {number}'"),
        ('{"words_about_courses": {"cuts": "{how_many}"}}', "words_about_courses: cuts: {how_many}"),
    ],
)
def test_a_wrong_file_is_refused_by_file_key_and_value(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], content: str, said: str
) -> None:
    (tmp_path / "zz.json").write_text(content, encoding="utf-8")
    monkeypatch.setenv(FOLDER_VARIABLE, str(tmp_path))
    assert cli.main(["single-page", str(tmp_path / "cut.html"), "--language", "zz"]) == 2
    shown = capsys.readouterr().err
    assert str(tmp_path / "zz.json") in shown
    assert said in shown


def test_every_page_of_a_class_speaks_it(third: Path, tmp_path: Path) -> None:
    room = Room(tmp_path, "first")
    try:
        site = ClassSite(lesson=room.lesson, secret=TOKEN, language="xx")
        room.app = class_app(site)
        pages = {"enter": room.client().get("/").text, "sign in": room.client().get("/teacher").text}
        refused = room.client().post("/", data={"code": "XYZ1"}).text
        pages["refused"] = refused
        anna = room.person("AB1")
        answer, handed_out = cut_once(anna)
        card = answer.json()
        teacher = room.teacher()
        room.store.put(["AB1"], class_name="trained", group="novice")
        room.store.set_pass_mark("first cuts", 60.0, "me")
        room.store.comment("AB1", "me")
        number = room.store.cuts("AB1")[-1].id
        pages["cut"] = anna.get("/cut").text
        for path in ("", "/live", "/course", "/studies", "/upload", "/sheet", "/people/AB1", f"/AB1/{number}"):
            pages[f"teacher{path}"] = teacher.get(f"/teacher{path}").text
        pages["bad course"] = teacher.post("/teacher/course", data={"name": "", "do": "keep"}).text
        pages["no card"] = teacher.get("/teacher/people/AB2", headers={"accept": "text/html"}).text
        left = {name: words for name, page in pages.items() if (words := english(page))}
        assert left == {}
        assert 'lang="xx"' in pages["teacher/live"]
        spoken = [card["verdict"]["xx"], card["ahead"]["xx"], card["outcome"]["xx"]]
        spoken += [said["xx"] for each in card["advice"] for said in each.values()]
        assert english(" ".join(spoken)) == set()
        assert handed_out["ahead"]["xx"].startswith("Tàsk 1 òf ")
    finally:
        room.lesson.close()


def test_the_page_alone_and_a_card_speak_it(third: Path, tmp_path: Path) -> None:
    page = page_alone(language="xx", count=1, specimen_classes=["liver"])
    assert english(page) == set()
    told = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])  # type: ignore[index]
    assert told["texts"]["xx"]["end_finished_success"] == pseudo(told["texts"]["en"]["end_finished_success"])
    trace = recorded_cut("liver", angle_deg=60.0, turns=(0.08, 0.05)).trace.with_metadata(
        {"operator": "P07", "date": "2026-02-03T10:11:12"}
    )
    card = score(trace, target_length=0.07)
    path = tmp_path / "card.html"
    write_score_page(path, ScoredRecord(trace=trace, card=card, target_length=0.07), language="xx")
    shown = path.read_text(encoding="utf-8")
    assert english(shown) == set()
    assert "03/02/2026" in shown
    assert re.search(r"\d·\d mm", shown), "numbers have its decimal mark"
