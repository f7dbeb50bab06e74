"""Cards, studies, pass marks, sheets and class lists in German: nothing English is left."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path
from types import ModuleType

import pytest

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

from made_up_study import NOVICES, study
from recorded_cut import recorded_cut

import cutenv.display.report.page
import cutenv.records.measurement.signal_quality
import cutenv.records.scoring.study.learning
from cutenv._base.language_files import phrases_from_english
from cutenv.display.report.page import Translation
from cutenv.display.report.pass_mark_page import write_pass_mark_page
from cutenv.display.report.score_page import ScoredRecord, write_score_page, write_summary
from cutenv.display.report.study_page import write_study
from cutenv.display.report.trainee_sheet import write_class_list, write_trainee_sheet
from cutenv.records.scoring import (
    ReferenceSet,
    cut_map,
    cut_metrics,
    doubts,
    points,
    score,
    score_card,
    scored_cut,
    technique,
    validity,
)
from cutenv.records.scoring.study import StandardSetting, StudiedCut, Study

NAMES = {"novice", "expert", "novice, expert", "made up", "2b"}
SPEAK = (
    cut_map, cut_metrics, doubts, points, score_card, scored_cut, technique, validity,
    cutenv.records.measurement.signal_quality, cutenv.records.scoring.study.learning,
)  # fmt: skip
"""Modules whose texts stand on a card: results, reasons, notes, doubts, faults, advice, and what the metrics mean."""
PARTS = {
    "_where": ["at 3 cm, after 3 s"], "_rest_of": [""], "less": [""], "_unit": [" N"], "_shown": ["3 N"],
    "side": ["short of", "beyond"], "missed": ["the target was missed"], "_dearest": ["too fast to stop"],
    "number": ["one reading", "3 readings"], "signal_quality.place": ["it is negative", "the blade cuts"],
    "lost": ["3 s, 3 usual steps and 3 mm of travel"], "happened": ["given up"],
    "_falls": ["3 sudden falls", "1 sudden fall"],
}  # fmt: skip
"""Texts in the places of calls and names; in any other place stands a number."""
CHECKS, TERMINAL = ("in_range", "array_in_range", "one_of"), ("__str__", "_repr_html_", "to_json", "difficulty")
"""Functions whose texts are for programmers, and those that write no page."""
OF_REFERENCE = {"INVARIANCES"}
"""Tables whose texts stand in the reference alone, which is English."""
ENGLISH = re.compile(r"\b(the|of|is|are|with|mean|cuts?|people|score|no|not|group|each|every|first|last)\b")


@pytest.fixture
def left(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Texts of German pages that no phrase fitted, without names."""
    found: set[str] = set()

    class Watched(Translation):
        def text(self, english: str) -> str:
            said = super().text(english)
            found.update(set(self.left) - NAMES)
            return said

    monkeypatch.setattr(cutenv.display.report.page, "Translation", Watched)
    return found


def words(path: Path) -> str:
    document = path.read_text(encoding="utf-8")
    assert '<html lang="de">' in document
    return " ".join(re.sub(r"<style>.*?</style>|<[^>]*>", " ", document, flags=re.DOTALL).split())


def said_by(module: ModuleType) -> Iterator[str]:
    """Texts of a module that a card may hold, with numbers in their places; not docstrings nor errors of a caller."""
    tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))
    skipped: set[ast.AST] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            skipped.add(node.value)
        called = node.func.id if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) else ""
        if (
            called.endswith("Error")
            or called in CHECKS
            or (isinstance(node, ast.FunctionDef) and node.name in TERMINAL)
        ):
            skipped |= set(ast.walk(node))
        if isinstance(node, ast.AnnAssign) and ast.unparse(node.target) in OF_REFERENCE:
            skipped |= set(ast.walk(node))
        if isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Assign) and named(node) & set(PARTS)):
            skipped |= set(ast.walk(node)) - {node}
    for node in ast.walk(tree):
        if node not in skipped and isinstance(node, ast.Constant | ast.JoinedStr):
            said = alternatives(node, vars(module))
            yield from (
                each for each in said if each.strip().count(" ") > 2 and each[0].isalnum()
            )  # else a part of another


def named(node: ast.Assign) -> set[str]:
    return {each.id for target in node.targets for each in ast.walk(target) if isinstance(each, ast.Name)}


def alternatives(node: ast.expr, names: dict[str, object]) -> list[str]:
    if isinstance(node, ast.Constant):
        return [str(node.value)]
    if isinstance(node, ast.IfExp):
        return alternatives(node.body, names) + alternatives(node.orelse, names)
    if isinstance(node, ast.JoinedStr):
        return ["".join(parts) for parts in product(*(alternatives(each, names) for each in node.values))]
    if isinstance(node, ast.FormattedValue):
        percent = node.format_spec is not None and ast.unparse(node.format_spec).endswith("%'")
        return ["3%"] if percent else alternatives(node.value, names)
    if isinstance(node, ast.BinOp) and isinstance(node.right, ast.Compare):
        return ["", *alternatives(node.left, names)]  # a plural's letter
    called = node.func if isinstance(node, ast.Call) else node
    name = called.id if isinstance(called, ast.Name) else ""
    within = f"{str(names['__name__']).rpartition('.')[2]}.{name}"
    if found := PARTS.get(within) or PARTS.get(name):
        return found
    constant = "N" if "force_unit" in ast.unparse(node) else names.get(name)
    return [constant if isinstance(constant, str) else "3"]


@pytest.mark.parametrize("module", SPEAK, ids=lambda module: module.__name__.rpartition(".")[2])
def test_every_text_of_a_card_has_german(module: ModuleType) -> None:
    translation, english = Translation("de"), []
    for text in said_by(module):
        translation.left.clear()
        translation.text(text)
        english += [text] if translation.left else []
    assert not english


def test_nothing_english_is_left_of_cards(tmp_path: Path, left: set[str]) -> None:
    reference, written = ReferenceSet.shipped("baselines"), []
    hurried = recorded_cut("liver", angle_deg=60.0, turns=(0.08, 0.05)).trace
    traces = {
        "C1": hurried.with_metadata({"operator": "P07", "date": "2026-02-03T10:11:12", "specimen_class": "liver"}),
        "C2": replace(hurried, force=hurried.force + 0.85).with_metadata({"end": "deadline"}),
        "C3": replace(hurried, force=-hurried.force),
        "C4": hurried.with_metadata({"wanted_depth_m": [[0.0, 0.008]], "layer_depth_m": 0.012}),
        "C5": replace(hurried, blade_x=hurried.position, blade_y=0.002 + 0.0 * hurried.time).with_metadata(
            {"line_m": [[0.0, 0.0], [0.05, 0.0], [0.1, 0.0]]}
        ),
    }
    for name, trace in traces.items():
        card = score(trace, target_length=0.07, reference=reference, name=name)
        written.append((ScoredRecord(trace=trace, card=card, target_length=0.07), f"{name}.html"))
        write_score_page(tmp_path / f"{name}.html", written[-1][0], language="de")
    write_summary(tmp_path, written, language="de")
    assert left == set()
    pages = [words(path) for path in sorted(tmp_path.glob("*.html"))]
    assert len(pages) == 6
    for page in pages:
        assert not (found := ENGLISH.search(page)), page[found.start() - 60 : found.end() + 60]
    assert "P07, 03.02.2026, 10:11, Leber; " in pages[0]
    assert "angehalten, weil die Zeit um war" in pages[1]
    assert "Zweifelhaft: die Kraft ist am Anfang 0,9" in pages[1]
    assert "Es gibt keine Punkte: die Kraft ist im Mittel" in pages[2]


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
