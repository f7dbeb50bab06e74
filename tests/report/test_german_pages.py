"""Studies, pass marks, sheets and class lists in German: nothing English is left."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from made_up_study import NOVICES, study
from recorded_cut import recorded_cut

import cutenv.report.page
from cutenv._base.document import phrases_from_english
from cutenv.report.page import Translation
from cutenv.report.pass_mark_page import write_pass_mark_page
from cutenv.report.study_page import write_study
from cutenv.report.trainee_sheet import write_class_list, write_trainee_sheet
from cutenv.scoring import METRICS, score
from cutenv.scoring.study import StandardSetting, StudiedCut, Study

NAMES = {"novice", "expert", "novice, expert", "made up", "2b"}
ENGLISH = re.compile(r"\b(the|of|is|are|with|mean|cuts?|people|score|no|not|group|each|every|first|last)\b")


@pytest.fixture
def left(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Texts of German pages that no phrase fitted, without names and formulas."""
    formulas = {each.formula for each in METRICS.values()} | {f"({each.formula}" for each in METRICS.values()}
    known = NAMES | formulas
    found: set[str] = set()

    class Watched(Translation):
        def text(self, english: str) -> str:
            said = super().text(english)
            found.update(set(self.left) - known)
            return said

    monkeypatch.setattr(cutenv.report.page, "Translation", Watched)
    return found


def words(path: Path) -> str:
    document = path.read_text(encoding="utf-8")
    assert '<html lang="de">' in document
    return " ".join(re.sub(r"<style>.*?</style>|<[^>]*>", " ", document, flags=re.DOTALL).split())


def scored_cuts() -> Study:
    """A study of cuts with a tip and a target, so that there are points, faults and advice."""
    cuts = []
    for number, (person, angle) in enumerate([("P01", 60.0), ("P01", 90.0), ("P02", 90.0), ("P02", 90.0)]):
        trace = recorded_cut("liver", angle_deg=angle, turns=(0.05 + 0.012 * number, 0.0)).trace
        card = score(trace, target_length=0.07, name=f"{person}_{number}")
        cuts.append(StudiedCut(card=card, operator=person, date=f"2026-02-0{number + 1}T10:00:00"))
    return Study(name="2b", cuts=cuts)


def test_nothing_english_is_left_of_a_study(tmp_path: Path, left: set[str]) -> None:
    of = study(target_group="expert", left={NOVICES[0]: (0, 2)})
    write_study(tmp_path / "study.html", of, language="de")
    write_study(tmp_path / "one.html", replace(of, cuts=of.cuts[:3], target_group=None, groups=None), language="de")
    assert left == set()
    said = words(tmp_path / "study.html")
    assert "Schnitt für Schnitt, Person für Person" in said
    assert re.search(r"0,\d\d \[0,\d\d; \d,\d\d\]", said), "numbers have a decimal comma"


def test_nothing_english_is_left_of_pass_marks(tmp_path: Path, left: set[str]) -> None:
    setting = StandardSetting(name="made up", cuts=study().cuts, left={NOVICES[0]: (1,)}, passing="expert")
    write_pass_mark_page(tmp_path / "pass.html", setting, language="de")
    given = StandardSetting(name="2b", cuts=scored_cuts().cuts, given={"overall_score": 50.0})
    write_pass_mark_page(tmp_path / "given.html", given, language="de")
    assert left == set()
    assert "von der Lehrkraft gesetzt" in words(tmp_path / "given.html")


def test_nothing_english_is_left_of_sheets_and_class_list(tmp_path: Path, left: set[str]) -> None:
    of = scored_cuts()
    assert any(cut.card.faults for cut in of.cuts), "without a fault there is no advice to translate"
    for each in (of, study(left={NOVICES[0]: (1,)})):
        for operator in (*of.operators, NOVICES[0]):
            if operator in each.operators:
                write_trainee_sheet(tmp_path, each, operator, mark=50.0, language="de")
        write_class_list(tmp_path, each, mark=50.0, language="de")
    assert left == set()
    sheet = words(tmp_path / "P01.html")
    assert "Was Sie als Nächstes versuchen können" in sheet
    assert not ENGLISH.search(sheet), ENGLISH.search(sheet)


def test_an_unknown_text_is_left_and_noticed(left: set[str]) -> None:
    translation = Translation("de")
    assert translation.page("<p>A text that nobody knows.</p>") == "<p>A text that nobody knows.</p>"
    assert translation.left == ["A text that nobody knows."]


def test_texts_are_escaped_and_styles_stay() -> None:
    page = '<style>p { color: of }</style><p>Everybody</p><i>R&amp;D &lt;b&gt;</i><img alt="cuts"><b>by x&lt;b&gt;</b>'
    german = '<style>p { color: of }</style><p>Alle</p><i>R&amp;D &lt;b&gt;</i><img alt="Schnitte"><b>by x&lt;b&gt;</b>'
    assert Translation("de").page(page) == german
    assert Translation("en").page(page) == page


def test_every_phrase_keeps_its_places() -> None:
    for english, german in phrases_from_english("de").items():
        assert set(re.findall(r"{\w+}", english)) == set(re.findall(r"{\w+}", german)), english
