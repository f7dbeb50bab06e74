"""``cutenv look`` shows what was understood: pictures, questions, rows left out; and folders are read as they are."""

from __future__ import annotations

import json
import math
import os
import shlex
from pathlib import Path
from typing import Any

import pytest

from cutenv.commands import cli, look
from cutenv.records import save
from cutenv.records.foreign.column_map import MAP_FILE
from cutenv.sim.trace import Trace

ROWS = "".join(
    f"{k / 100:.2f},{force:.4f},{max(0, min(k, 250) - 100) / 5:.2f}\n"
    for k in range(400)
    for force in [3.0 * math.sin((k - 100) / 40) if 100 < k < 225 else 0.0]
)


def looked(capsys: pytest.CaptureFixture[str], *arguments: object, status: int = 0) -> dict[str, Any]:
    assert cli.main(["look", *map(str, arguments), "--json"]) == status
    return json.loads(capsys.readouterr().out)


def test_records_questions_and_rows_left_out_are_printed_as_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "trial.csv"
    path.write_text("t [s],Load,x [mm]\n" + ROWS + "Maximum,3.0,\n")
    found = looked(capsys, path, "--yes")
    (record,) = found["records"]
    assert record["duration_s"] == pytest.approx(3.99)
    assert record["peak_N"] == pytest.approx(3.0, abs=0.01)
    assert record["travel_mm"] == pytest.approx(30.0)
    (question,) = found["questions"]
    assert (question["about"], question["taken"]) == ("force", "N")
    assert "mN" in question["choices"]
    (left_out,) = found["left_out"]
    assert left_out["count"] == 1
    assert "Maximum" in left_out["reason"]
    assert not list(tmp_path.glob("*.json"))  # nothing is kept by looking


def test_the_last_line_is_the_command_that_scores_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "trial 12.csv"
    path.write_text("t [s],Load,x [mm]\n" + ROWS)
    assert cli.main(["look", str(path), "--yes"]) == 0
    shown = capsys.readouterr().out
    assert "force [N]" in shown
    assert "position [mm]" in shown
    assert "cut 1" in shown
    command = shown.rpartition("score it: cutenv ")[2]
    assert cli.main([*shlex.split(command), "--out", str(tmp_path / "scored")]) == 0
    assert (tmp_path / "scored" / "trial_12_score.html").is_file()


def test_a_terminal_without_braille_is_drawn_in_ascii(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from cutenv.display.report import RecordPicture
    from cutenv.display.report.look_page import record_lines

    record = Trace(time=[k / 100 for k in range(200)], force=[math.sin(k / 30) for k in range(200)])
    lines = record_lines(RecordPicture(record=record), 60, braille=False)
    assert "\n".join(lines).isascii()
    assert max(map(len, lines)) <= 60
    columns = [k for k in range(9, 59) if any(len(line) > k and line[k] == "*" for line in lines[1:10])]
    assert columns == list(range(9, 59))


def test_what_nobody_can_guess_is_asked_and_not_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "trial.csv"
    path.write_text("Force (N),x (mm)\n" + "".join(row.partition(",")[2] + "\n" for row in ROWS.splitlines()))
    found = looked(capsys, path, "--yes", status=1)
    assert found["records"] == []
    assert [each["about"] for each in found["questions"]] == ["rate"]
    found = looked(capsys, path, "--map", "rate=100Hz", "force=Force", "position=x")
    assert found["records"][0]["duration_s"] == pytest.approx(3.99)


def test_a_question_is_asked_at_a_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "trial.csv"
    path.write_text("Load,x [mm]\n" + "".join(row.partition(",")[2] + "\n" for row in ROWS.splitlines()))
    answers = iter(["100", "mN"])
    monkeypatch.setattr("sys.stdin.isatty", lambda: True)
    monkeypatch.setattr("builtins.input", lambda prompt: next(answers))
    assert cli.main(["look", str(path)]) == 0
    shown = capsys.readouterr().out
    assert "How many readings a second?" in shown
    assert "--map rate=100Hz force=Load position=x --unit mN" in shown
    assert "3.99 s, 100 Hz, peak 0.003 N" in shown


def test_a_page_shows_pictures_and_reasons(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    good, bad = tmp_path / "good.csv", tmp_path / "bad.txt"
    good.write_text("t [s],F [N],x [mm]\n" + ROWS)
    bad.write_text("a letter without numbers\n")
    page = tmp_path / "new" / "look.html"
    assert cli.main(["look", str(good), str(bad), "--out", str(page)]) == 1
    text = page.read_text()
    assert text.count("<figure>") == 1
    assert "--map time=t force=F position=x" in text
    assert "no rows of numbers" in text


def test_a_record_of_ours_and_a_folder_of_any_text_are_looked_at(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    save(Trace(time=[0.0, 0.01, 0.02], force=[0.0, 1.0, 2.0]), tmp_path / "ours.csv")
    (tmp_path / "theirs.tra").write_text("t [s],F [N],x [mm]\n" + ROWS)
    found = looked(capsys, tmp_path)
    assert [each["file"] for each in found["records"]] == ["ours.csv", "theirs.tra"]
    assert [each["file"] for each in found["maps"]] == ["theirs.tra"]


def test_every_kind_that_we_write_is_scored_from_a_folder_and_every_text_with_a_map(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mcap")
    own, lab = tmp_path / "own", tmp_path / "lab"
    own.mkdir()
    lab.mkdir()
    time = [k / 100 for k in range(400)]
    force = [float(row.split(",")[1]) for row in ROWS.splitlines()]
    for suffix in (".csv", ".mcap"):
        save(Trace(time=time, force=force), own / f"cut{suffix}")
    assert cli.main(["score", str(own), "--out", str(tmp_path / "a")]) == 0
    (lab / "one.txt").write_text("t [s],F [N],x [mm]\n" + ROWS)
    (lab / "two.lvm").write_text("t [s],F [N],x [mm]\n" + ROWS)
    assert cli.main(["score", str(lab), "--out", str(tmp_path / "b")]) == 2
    assert "need --map" in capsys.readouterr().err
    map_ = ["--map", "time=t", "force=F", "position=x"]
    assert cli.main(["score", str(lab), "--out", str(tmp_path / "b"), *map_]) == 0
    assert {path.name for path in (tmp_path / "b").glob("*_score.html")} == {"one_score.html", "two_score.html"}
    assert cli.main(["score", str(lab), "--out", str(tmp_path / "b"), *map_]) == 0  # the kept map is no record


def test_a_folder_that_cannot_be_written_costs_the_kept_map_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "trial.csv"
    path.write_text("t [s],F [N],x [mm]\n" + ROWS + "OL,OL,OL\n")

    def refused(source: object, target: object) -> None:
        if Path(str(target)).name == MAP_FILE:
            raise PermissionError(13, "Permission denied", str(target))
        original(source, target)

    original = os.replace
    monkeypatch.setattr("os.replace", refused)
    out = tmp_path / "out"
    assert cli.main(["score", str(path), "--out", str(out), "--map", "time=t", "force=F", "position=x"]) == 0
    said = capsys.readouterr().err
    assert f"columns not kept in {tmp_path} (Permission denied)" in said
    assert "1 row left out" in said
    assert (out / "trial_score.html").is_file()


def test_the_answer_of_a_rate_may_leave_its_unit_out(monkeypatch: pytest.MonkeyPatch) -> None:
    from cutenv.records.foreign.proposal import Question

    question = Question(about="rate", text="How many readings a second?", choices=())
    monkeypatch.setattr("builtins.input", lambda prompt: " 250 ")
    assert look._answer(Path("trial.csv"), question) == {"rate": "250Hz"}
