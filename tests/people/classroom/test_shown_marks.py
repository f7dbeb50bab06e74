"""A score and its mark as shown never disagree with the decision."""

from __future__ import annotations

import re
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")
pytest.importorskip("sqlalchemy", reason="the server is an extra: pip install 'cutenv[serve]'")

from recorded_cut import recorded_cut

from cutenv.display.report.trainee_sheet import write_class_list, write_trainee_sheet
from cutenv.people.browser.page_alone import write_scorm_package
from cutenv.people.classroom.class_store import MarkInForce
from cutenv.people.classroom.lesson import shown_card
from cutenv.people.play.course import CourseTask, marked_numbers
from cutenv.records.scoring import ScoreCard, score
from cutenv.records.scoring.cut_metrics import tip_error
from cutenv.records.scoring.points import outcome_of
from cutenv.records.scoring.score_card import whole_score
from cutenv.records.scoring.scored_cut import ScoredCut
from cutenv.records.scoring.study import StandardSetting, StudiedCut, Study
from cutenv.sim.quantities import TIP_TOLERANCE

EDGES = [(79.4, 80.0), (79.5, 80.0), (79.6, 80.0), (80.4, 80.2), (80.5, 80.5), (59.96, 60.0), (0.0, 0.0)]


@pytest.fixture(scope="module")
def card() -> ScoreCard:
    return score(recorded_cut("liver", turns=(0.07, 0.0)).trace, target_length=0.07)


def with_score(card: ScoreCard, value: float) -> ScoreCard:
    return replace(card, overall_score=value)


@pytest.mark.parametrize(("value", "mark"), EDGES)
def test_the_card_of_the_class(card: ScoreCard, value: float, mark: float) -> None:
    said = shown_card(with_score(card, value), None, mark=MarkInForce(mark, "", ""))
    assert said["passed"] is (said["score"] >= said["pass_mark"])


@pytest.mark.parametrize(("value", "mark"), EDGES)
def test_sheet_and_class_list(card: ScoreCard, tmp_path: Path, value: float, mark: float) -> None:
    study = Study(name="2b", cuts=[StudiedCut(card=with_score(card, value), operator="P01")] * 2)
    sheet = write_trainee_sheet(tmp_path, study, "P01", mark=mark).read_text(encoding="utf-8")
    found = re.search(r"Last score (\d+) of 100.*?(\d) of 2 pass at ([\d.]+)", sheet, re.DOTALL)
    assert found is not None
    assert (int(found[2]) == 2) is (float(found[1]) >= float(found[3]))
    _, table = write_class_list(tmp_path, study, mark=mark)
    heads, row = (line.split(",") for line in table.read_text(encoding="utf-8").splitlines())
    told = dict(zip(heads, row, strict=True))
    assert (int(told["passes"]) == 2) is (float(told["last score"]) >= mark)


@pytest.mark.parametrize(("value", "mark"), [*EDGES, (60.0, 60.04), (59.0, 58.96)])
def test_who_reaches_a_mark(card: ScoreCard, value: float, mark: float) -> None:
    cuts = [StudiedCut(card=with_score(card, value), operator="P01")] * 2
    (standard,) = (
        each
        for each in StandardSetting(name="2b", cuts=cuts, given={"overall_score": mark}).standards
        if each.metric == "overall_score"
    )
    assert (standard.proficiency["P01"].passes == 2) is (whole_score(value) >= round(mark, 1))


@pytest.mark.parametrize(("value", "mark"), EDGES)
def test_a_task_of_a_course(card: ScoreCard, value: float, mark: float) -> None:
    task = CourseTask(name="one", specimen_class="liver", mark={"overall_score": mark})
    missed = task.misses(marked_numbers(with_score(card, value)))
    assert bool(missed) is (whole_score(value) < mark)
    assert not missed or float(re.findall(r"here ([\d.]+)", missed[0])[0]) < mark


def test_the_mark_of_a_package_is_shown_as_it_is_compared(tmp_path: Path) -> None:
    pytest.importorskip("jinja2", reason="pages are an extra: pip install 'cutenv[view]'")
    write_scorm_package(tmp_path / "cut.zip", count=1, specimen_classes=["liver"], pass_mark=59.54)
    with zipfile.ZipFile(tmp_path / "cut.zip") as package:
        assert b'"platform":{"mark":59.5}' in package.read("cut.html")


@pytest.mark.parametrize("off", [2.96e-3, 3.0e-3, 3.04e-3, 3.2e-3])
def test_a_missed_target_does_not_look_reached(card: ScoreCard, off: float) -> None:
    cut = ScoredCut(trace=recorded_cut("liver", turns=(0.07, 0.0)).trace, target_length=0.07)
    tip = float(cut.tip[cut.end])
    moved = ScoredCut(trace=cut.trace, target_length=tip + off)
    value = {name: scored.value for name, scored in card.metrics.items() if scored.value is not None}
    found = re.search(r"([\d.]+) mm short", outcome_of(moved, value))
    assert found is not None
    assert (float(found[1]) <= 1e3 * TIP_TOLERANCE) is (tip_error(moved) <= TIP_TOLERANCE)
