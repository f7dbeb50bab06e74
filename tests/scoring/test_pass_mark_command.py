"""``cutenv pass-mark``: from records and a table with groups and raters' marks to numbers, a page and two files."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from made_up_study import sawing

from cutenv.commands import pass_mark as command
from cutenv.recording import load_operators, save
from cutenv.scoring import METRICS, score
from cutenv.scoring.score_card import DISCLAIMER
from cutenv.scoring.study import PassMark, StandardSetting, StudiedCut, validity_evidence
from cutenv.scoring.study.study import NotEstimable

CUTS = 2
NEITHER = next(name for name, metric in METRICS.items() if metric.direction == "none")


def rough(group: str, rng: np.random.Generator) -> float:
    return rng.uniform(0.45, 0.6) if group == "novice" else rng.uniform(0.15, 0.3)


@pytest.fixture(scope="module")
def cuts() -> list[StudiedCut]:
    """Two cuts each of six novices and five experts, marked by two raters who see what the metrics see."""
    rng = np.random.default_rng(5)
    made = []
    for group, people in (("novice", 6), ("expert", 5)):
        for i in range(people):
            own = rough(group, rng)
            for number in range(CUTS):
                card = score(sawing(own + rng.normal(0.0, 0.03), rng), name=f"{group[0].upper()}{i}_{number}")
                marks = {"a": 5.0 - card["force_rate"] + rng.normal(0.0, 0.3)}
                if number:
                    marks["b"] = round(90.0 - 10.0 * card["force_rate"])
                made.append(StudiedCut(card=card, operator=f"{group[0].upper()}{i}", group=group, marks=marks))
    return made


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The records of a class of 3 and 3, and their table."""
    path = tmp_path_factory.mktemp("class")
    rng = np.random.default_rng(6)
    lines = ["record,operator,group,order,anna"]
    for group in ("novice", "expert"):
        for i in range(3):
            own = rough(group, rng)
            for number in range(CUTS):
                name = f"{group[0].upper()}{i}_{number}"
                save(sawing(own, rng), path / f"{name}.csv")
                mark = "" if (i, number) == (0, 0) else f"{10.0 - 10.0 * own:.1f}"
                lines.append(f"{name}.csv,{group[0].upper()}{i},{group},{number},{mark}")
    (path / "class.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def run(folder: Path, *options: str) -> int:
    return command.main([str(folder), "--operators", str(folder / "class.csv"), *options])


def test_numbers_page_and_files_are_one(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")
    page = tmp_path / "new" / "marks.html"
    options = ["--passing", "expert", "--raters", "Anna", "--metric", "force_rate", "--mark", "55", "--out", str(page)]
    assert run(folder, *options) == 0
    said = capsys.readouterr().out
    assert "6 people; group expert is to pass, group novice is not" in said
    assert "nan" not in said.lower()
    content = json.loads(page.with_suffix(".json").read_text(encoding="utf-8"))
    assert content["disclaimer"] == DISCLAIMER
    assert set(content["metrics"]) == {"force_rate", "overall_score"}
    assert content["metrics"]["overall_score"]["marks"]["set by the teacher"]["mark"]["value"] == 55.0
    assert content["metrics"]["overall_score"]["chosen"] == "set by the teacher"
    mark = content["metrics"]["force_rate"]["marks"]["contrasting groups"]
    assert mark["mark"]["low"] is None  # three people in a group
    assert (mark["false_passes"]["people"], mark["false_fails"]["people"]) == (3, 3)
    assert content["metrics"]["force_rate"]["raters"]["anna"]["cuts"] == 2 * 3 * CUTS - 2
    with page.with_suffix(".csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 6
    own = [row for row in rows if row["metric"] == "overall_score"]
    for row in own:
        counted = content["metrics"]["overall_score"]["proficiency"][row["operator"]]
        assert (int(row["passes"]), int(row["cuts"])) == (counted["passes"], counted["cuts"])
    document = page.read_text(encoding="utf-8")
    assert document.count(DISCLAIMER) >= 2
    assert "nan" not in document.split("</style>")[1].replace("nanna", "").split()
    assert "no evidence: experts judge this" in document


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ([], "which group is to pass, of novice, expert?"),
        (["--passing", "master"], "passing must be one of"),
        (["--passing", "expert", "--failing", "master"], "failing must be one of"),
        (["--passing", "expert", "--metric", "peak_froce"], "Did you mean 'peak_force'?"),
        (["--passing", "expert", "--metric", NEITHER], "neither way is better"),
        (["--passing", "expert", "--sd", "9"], "--sd = 9 is outside"),
        (["--passing", "expert", "--in-a-row", "0"], "--in-a-row = 0 is outside"),
        (["--passing", "expert", "--raters", "berta"], "lacks berta"),
        (["--passing", "expert", "--out", "marks.pdf"], "must end in .html"),
        (["--mark", "much"], "--mark 'much' is no mark; write NUMBER"),
        (["--mark", "tip_error=3"], "write tip_error=NUMBERmm"),
        (["--mark", "tip_eror=3mm"], "Did you mean 'tip_error'?"),
        (["--mark", "50", "--mark", "60"], "gives overall_score twice"),
    ],
)
def test_what_does_not_fit_is_exit_code_2_and_named(
    folder: Path, options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(folder, *options, *(["--raters", "anna"] if "--raters" not in options else [])) == 2
    said = capsys.readouterr().err
    assert message in said
    assert "reading" not in said  # before any work


def test_a_mark_of_a_metric_that_no_cut_has_is_exit_code_2(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(folder, "--raters", "anna", "--mark", "tip_error=3mm") == 2
    assert "tip_error is missing in 12 of 12 cuts" in capsys.readouterr().err


def test_a_length_is_given_in_millimetres() -> None:
    assert command._given(["60", "tip_error=3mm", "force_rate=2.5"]) == {
        "overall_score": 60.0,
        "tip_error": 0.003,
        "force_rate": 2.5,
    }


def test_a_mark_that_is_none_is_named_with_its_line(tmp_path: Path) -> None:
    table = tmp_path / "who.csv"
    table.write_text("record;operator;anna\na;P1;3,5\nb;P1;good\n", encoding="utf-8")
    with pytest.raises(ValueError, match=r"line 3: anna 'good' is no number\. Give a mark, or nothing"):
        load_operators(table, raters=["anna"])
    table.write_text("record;operator;anna\na;P1;3,5\nb;P1;\n", encoding="utf-8")
    assert [row.marks for row in load_operators(table, raters=["anna"])] == [{"anna": 3.5}, {}]


def test_methods_stand_side_by_side_for_each_metric(cuts: list[StudiedCut]) -> None:
    setting = StandardSetting(name="class", cuts=cuts, passing="expert", metrics=["force_rate", "force_jerk"])
    for standard in setting.standards:
        assert standard.better == "lower"
        marks = [found.mark for found in standard.marks.values() if isinstance(found, PassMark)]
        assert len(marks) == 3
        assert all(mark.low is not None for mark in marks)
        contrast, mean, spread = (mark.value for mark in marks)
        assert mean < spread < contrast  # lower is better: the mark of the mean is the hardest
        assert set(standard.proficiency) == set(setting.operators)
        assert standard.raters["all raters"] is not None
    rank = setting.standards[0].raters["a"]
    assert not isinstance(rank, NotEstimable)
    assert rank.rank.value > 0.5  # good marks go with a low force rate
    assert {found.source: found.is_there for found in validity_evidence(setting)} == {
        "Content": False,
        "Response process": True,
        "Internal structure": True,
        "Relations to other variables": True,
        "Consequences": True,
    }


def test_experts_who_are_worse_are_no_evidence(cuts: list[StudiedCut]) -> None:
    setting = StandardSetting(name="class", cuts=cuts, passing="novice", metrics=["force_rate"])
    (standard,) = setting.standards
    assert isinstance(standard.chosen, NotEstimable)
    assert "wrong order" in standard.chosen.reason
    assert standard.proficiency == {}
    assert validity_evidence(setting)[-1].found[0].startswith("no evidence: the groups stand in the wrong order")


def test_a_class_without_groups_is_held_against_the_teachers_mark(cuts: list[StudiedCut]) -> None:
    alone = [StudiedCut(card=cut.card, operator=cut.operator) for cut in cuts]
    setting = StandardSetting(name="class", cuts=alone, given={"force_rate": 3.0}, metrics=["force_rate"])
    (standard,) = setting.standards
    assert isinstance(standard.chosen, PassMark)
    assert standard.chosen.false_passes.people == 0
    assert sum(own.passes for own in standard.proficiency.values()) == sum(
        cut.card["force_rate"] <= 3.0 for cut in alone
    )
    assert isinstance(standard.marks["expert mean"], NotEstimable)
    assert isinstance(setting.agreement, NotEstimable)
