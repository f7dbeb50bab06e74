"""``cutenv score`` on files: card, page, JSON, a table of many, and what it refuses."""

from __future__ import annotations

import csv
import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from scored_cuts import TARGET, cut

from cutenv.commands import cli
from cutenv.commands.inputs import targets
from cutenv.display.report.score_page import ScoredRecord, write_score_page
from cutenv.records import save
from cutenv.records.scoring import METRICS, ReferenceSet, score
from cutenv.records.scoring.reference import FEWEST_REFERENCE_CUTS
from cutenv.sim.trace import Trace

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")

UPRIGHT, SLICING, ALONE = "upright, and back", "slicing, and back", "force alone, 30 Hz"


def named(kind: str, name: str, **metadata: object) -> Trace:
    return dataclasses.replace(cut(kind), metadata={"name": name, **metadata})


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    capsys.readouterr()
    status = cli.main(["score", *map(str, arguments)])
    said = capsys.readouterr()
    return status, said.out, said.err


def test_one_cut_gives_a_card_a_page_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trace = named(UPRIGHT, "my cut")
    save(trace, tmp_path / "cut.csv")
    status, out, err = run(capsys, tmp_path / "cut.csv", "--target-length", "75mm", "--out", tmp_path)
    assert status == 0, err
    card = score(trace, target_length=TARGET, reference=ReferenceSet.shipped())
    assert card.headline() in out
    content = json.loads((tmp_path / "my_cut_score.json").read_text())
    assert content == json.loads(card.to_json())
    page = (tmp_path / "my_cut_score.html").read_text()
    assert "Score: my cut" in page
    assert "not validated for assessment" in page
    for name, scored in card.metrics.items():
        assert name.replace("_", " ") in page
        if scored.value is None:
            assert scored.unavailable in page
    for fault in card.faults:
        assert fault.says in page
        assert fault.try_next in page


def test_an_example_is_made_and_scored_where_there_is_no_record(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, out, err = run(capsys, "--example", "--out", tmp_path)
    assert status == 0, err
    assert "of 100" in out
    assert (tmp_path / "example_score.html").is_file()
    status, again, err = run(capsys, tmp_path / "example.csv", "--out", tmp_path)
    assert status == 0, err
    assert again in out  # the record by itself has the same card
    for arguments in ([], ["--example", tmp_path / "example.csv"]):
        status, _, err = run(capsys, *arguments)
        assert status == 2
        assert "--example" in err


def test_a_missed_target_is_never_green(tmp_path: Path) -> None:
    trace, seen = named(UPRIGHT, "cut"), {}
    for target in (TARGET, TARGET - 0.012):
        card = score(trace, target_length=target, reference=ReferenceSet.shipped())
        card = dataclasses.replace(card, overall_score=80.0)
        write_score_page(tmp_path / "cut.html", ScoredRecord(trace=trace, card=card, target_length=target))
        missed = "overshoot" in {fault.kind for fault in card.faults}
        seen[missed] = 'class="verdict good"' in (tmp_path / "cut.html").read_text()
    assert seen == {False: True, True: False}


def test_the_target_of_the_record_is_taken_where_none_is_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save(named(UPRIGHT, "a", target_length_m=TARGET), tmp_path / "a.csv")
    assert run(capsys, tmp_path / "a.csv", "--out", tmp_path)[0] == 0
    tip_error = json.loads((tmp_path / "a_score.json").read_text())["metrics"]["tip_error"]
    assert tip_error["value"] == pytest.approx(score(cut(UPRIGHT), target_length=TARGET)["tip_error"])


def test_many_cuts_give_a_table_and_a_summary(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save([named(UPRIGHT, "first"), named(SLICING, "second")], tmp_path / "cuts.csv")
    status, out, _ = run(capsys, tmp_path / "cuts.csv", "--target-length", "7.5cm", "--out", tmp_path)
    assert status == 0
    assert "summary:" in out
    rows = list(csv.DictReader((tmp_path / "scores.csv").open()))
    assert [row["name"] for row in rows] == ["first", "second"]
    for row, kind in zip(rows, (UPRIGHT, SLICING), strict=True):
        card = score(cut(kind), target_length=TARGET, reference=ReferenceSet.shipped())
        assert float(row["overall_score"]) == pytest.approx(card.overall_score, abs=0.051)
        assert float(row["peak_force_N"]) == pytest.approx(card["peak_force"], rel=1e-5)
        assert float(row["tip_error_m"]) == pytest.approx(card["tip_error"], rel=1e-5)
    summary = (tmp_path / "summary.html").read_text()
    assert "first_score.html" in summary
    assert "second_score.html" in summary


def test_a_record_of_force_alone_keeps_the_frozen_reference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    trace = dataclasses.replace(named(UPRIGHT, "force"), position=None, speed=None, angle=None, depth=None)
    save(trace, tmp_path / "force.csv")
    assert run(capsys, tmp_path / "force.csv", "--out", tmp_path)[0] == 0
    content = json.loads((tmp_path / "force_score.json").read_text())
    assert content == json.loads(score(trace, reference=ReferenceSet.shipped("force-alone")).to_json())
    assert content["reference"].startswith("force-alone")


def test_a_normalised_force_has_a_card_and_no_score_within_newtons(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save(named(ALONE, "alone"), tmp_path / "alone.csv")
    status, out, _ = run(capsys, tmp_path / "alone.csv", "--out", tmp_path)
    assert status == 0
    assert "no overall score" in out
    assert "force_rate" in out


def test_a_folder_of_ones_own_people_is_a_reference(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    people = tmp_path / "people"
    people.mkdir()
    rng = np.random.default_rng(0)
    for number in range(FEWEST_REFERENCE_CUTS):
        trace = cut(UPRIGHT)
        noisy = dataclasses.replace(
            trace, force=(0.5 + number / FEWEST_REFERENCE_CUTS) * trace.force + rng.normal(0, 0.01, len(trace))
        )
        save(noisy, people / f"{number}.csv")
    save(named(UPRIGHT, "mine"), tmp_path / "mine.csv")
    status, out, err = run(
        capsys, tmp_path / "mine.csv", "--target-length", "75mm", "--reference", people, "--out", tmp_path
    )
    assert status == 0, err
    assert f"compares with people ({FEWEST_REFERENCE_CUTS} cuts" in out
    percentile = json.loads((tmp_path / "mine_score.json").read_text())["metrics"]["peak_force"]["percentile"]
    assert 30.0 < percentile < 70.0  # the middle one of those forces


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["cut.csv", "--target-length", "75"], "is no length with a unit; write 80mm or 8cm"),
        (["cut.csv", "--target-length", "2m"], "Write 80mm or 8cm"),
        (["cut.csv", "--out", "cut.csv"], "is a file; give a folder"),
        (["cut.csv", "--reference", "experts"], "'experts' is neither baselines, force-alone nor none"),
        (["cut.csv", "--reference", "."], "a percentile takes 20 or more"),
        (["missing.csv"], "no such file: missing.csv"),
        (["bad.csv"], "--map time=a force=b --unit N"),
        (["cut.csv", "--unit", "N"], "--unit goes with --map"),
    ],
)
def test_bad_input_is_refused_with_the_cure_and_nothing_is_written(
    arguments: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    save(named(UPRIGHT, "cut"), tmp_path / "cut.csv")
    (tmp_path / "bad.csv").write_text("a,b\n1,2\n")
    before = sorted(tmp_path.rglob("*"))
    if says.startswith("a percentile"):
        (tmp_path / "bad.csv").unlink()
        before.remove(tmp_path / "bad.csv")
    status, _, err = run(capsys, *arguments)
    assert status == 2
    assert says in err
    assert "Traceback" not in err
    assert sorted(tmp_path.rglob("*")) == before


def test_the_shipped_reference_set_is_of_many_cuts_and_reads_back(tmp_path: Path) -> None:
    shipped = ReferenceSet.shipped()
    assert len(shipped) >= 500
    assert len(set(shipped.groups)) >= 10
    assert "tip estimated" in shipped.about
    shipped.save(tmp_path / "again.csv")
    again = ReferenceSet.load(tmp_path / "again.csv")
    assert again.groups == shipped.groups
    for name in METRICS:
        if name in shipped.values:
            assert np.array_equal(again.values[name], shipped.values[name], equal_nan=True)


def foreign(path: Path, trace: Trace) -> None:
    rows = zip(trace.time, trace.force, 1e3 * trace.require("position", by="this test")[0], strict=True)
    path.write_text("Zeit [s];Kraft [N];Weg [mm]\n" + "".join(f"{t:.3f};{f:.4f};{x:.4f}\n" for t, f, x in rows))


def test_an_option_never_replaces_the_target_that_a_cut_was_aimed_at(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save(named(UPRIGHT, "a", target_length_m=TARGET), tmp_path / "a.csv")
    status, _, err = run(capsys, tmp_path / "a.csv", "--target-length", "95mm", "--out", tmp_path)
    assert status == 0
    assert "a: --target-length has no effect, because the record holds its own target, 75.0 mm" in err
    card = score(cut(UPRIGHT), target_length=TARGET, reference=ReferenceSet.shipped())
    assert json.loads((tmp_path / "a_score.json").read_text())["overall_score"] == pytest.approx(card.overall_score)


def test_an_option_without_effect_on_many_records_is_said_in_one_line() -> None:
    lengths, (said,) = targets([named(UPRIGHT, f"{k}", target_length_m=TARGET) for k in range(9)], 0.095)
    assert lengths == [TARGET] * 9
    assert said == "--target-length has no effect on 9 of 9 records, which hold their own targets"


def test_a_folder_and_a_pattern_stand_for_the_records_in_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a", "b"):
        save(named(UPRIGHT, name, target_length_m=TARGET), tmp_path / f"{name}.csv")
    for given in (tmp_path, tmp_path / "*.csv", tmp_path):  # the folder holds the command's own table by then
        status, out, err = run(capsys, given, "--out", tmp_path)
        assert status == 0, err
        assert [line[:3] for line in out.splitlines()[:2]] == ["a: ", "b: "]


def test_a_target_without_effect_is_said_with_the_columns_left_unused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    foreign(tmp_path / "trial.csv", cut(UPRIGHT))
    options = [tmp_path / "trial.csv", "--target-length", "75mm", "--out", tmp_path, "--map"]
    status, _, err = run(capsys, *options, "time=Zeit", "force=Kraft")
    assert status == 0, err
    assert "trial: --target-length has no effect, because the record has no position" in err
    assert "trial.csv: read without position; columns left unused: Weg [mm]" in err
    status, _, err = run(capsys, *options, "time=Zeit", "force=Kraft", "position=Weg")
    assert status == 0, err
    assert "no effect" not in err
    assert "unused" not in err
