"""``cutenv study``: from a folder of records and a table of operators to numbers, a page and a file of cards."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path

import numpy as np
import pytest
from made_up_study import CUTS, EXPERTS, NOVICES, study, write_records

from cutenv.commands import study as command
from cutenv.records import RecordError, load_operators, save
from cutenv.records.scoring import METRICS, score
from cutenv.records.scoring.score_card import DISCLAIMER
from cutenv.sim.trace import Trace


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the made-up study, with its table of operators."""
    folder = tmp_path_factory.mktemp("records")
    write_records(folder)
    return folder


def run(folder: Path, table: Path, *options: str) -> int:
    return command.main([str(folder), "--operators", str(table), *options])


def few(folder: Path, header: str, *rows: str) -> Path:
    """Three records a.csv, b.csv, c.csv in ``folder``, and a table of these rows."""
    for k, name in enumerate("abc"):
        time = np.arange(100) / 100.0
        save(Trace(time=time, force=1.0 + k + np.sin(9.0 * time)), folder / f"{name}.csv")
    table = folder / "who.csv"
    table.write_text("\n".join((header, *rows)) + "\n", encoding="utf-8")
    return table


def test_page_and_cards_hold_what_the_study_holds(
    records: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")
    page = tmp_path / "study.html"
    cuts = Path(shutil.copytree(records, tmp_path / "cuts"))
    table = cuts / "operators.csv"
    left = f",{NOVICES[0]},novice,1,0"  # begun and left before the first cut
    table.write_text((records / "operators.csv").read_text(encoding="utf-8") + f"{left}\n", encoding="utf-8")
    sheets = ["--sheets", str(tmp_path / "sheets"), "--mark", "50"]
    assert run(cuts, table, "--out", str(page), "--metric", "force_rate", *sheets) == 0
    said = capsys.readouterr().out
    assert DISCLAIMER in said
    assert "nan" not in said
    assert f"cards: {tmp_path / 'study.csv'}" in said
    document = page.read_text(encoding="utf-8")
    assert document.count(DISCLAIMER) >= 2
    assert all(operator in document for operator in (*NOVICES, *EXPERTS))
    with (tmp_path / "study.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    (lost,) = (row for row in rows if row["state"] == "left")
    assert (lost["operator"], lost["number"], lost["force_rate_N_per_s"]) == (NOVICES[0], "1", "")
    assert f"begun and left: {NOVICES[0]} 1; these cuts have no score" in " ".join(document.split())
    assert "begun and left" in (tmp_path / "sheets" / f"{NOVICES[0]}.html").read_text(encoding="utf-8")
    assert "begun and left" in (tmp_path / "sheets" / "class.csv").read_text(encoding="utf-8")
    rows.remove(lost)
    expected = study().cuts
    assert len(rows) == len(expected) == 2 * CUTS * len((*NOVICES, *EXPERTS))
    for operator in (*NOVICES, *EXPERTS):
        own = [row for row in rows if row["operator"] == operator]
        cards = [each.card for each in expected if each.operator == operator]
        assert [row["record"] for row in own] == [card.name for card in cards]
        first = 1 + (operator == NOVICES[0])
        assert [int(row["number"]) for row in own] == list(range(first, first + 2 * CUTS))
        for row, card in zip(own, cards, strict=True):
            assert float(row["force_rate_N_per_s"]) == pytest.approx(card["force_rate"], rel=1e-5)
            assert row["tip_error_m"] == ""
    assert len(rows[0]) == 8 + len(METRICS)


def test_the_page_is_no_record_of_the_next_run(records: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")
    page = str(records / "study.html")
    for _ in range(2):
        assert run(records, records / "operators.csv", "--out", page, "--metric", "force_rate") == 0, (
            capsys.readouterr().err
        )
    (records / "study.html").unlink()
    (records / "study.csv").unlink()


def numbers_made(folder: Path, *options: str) -> list[tuple[str, str, str, str]]:
    """Record, operator, session and number of every card that the command writes."""
    assert command.main([str(folder), "--metric", "peak_force", "--out", str(folder / "study.html"), *options]) == 0
    with (folder / "study.csv").open(newline="", encoding="utf-8") as file:
        return [(r["record"], r["operator"], r["session"], r["number"]) for r in csv.DictReader(file)]


def test_order_is_the_tables_and_not_the_files(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")
    table = few(tmp_path, "operator,record,order", "P1,b.csv,2", "P1,c.csv,3", "P1,a,1")
    found = numbers_made(tmp_path, "--operators", str(table))
    assert [(record, number) for record, _, _, number in found] == [("a", "1"), ("b", "2"), ("c", "3")]


def test_a_table_names_whose_hand_a_record_shows_and_what_no_hand_does_is_doubted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = few(tmp_path, "operator,record", "P1,a", "P1,b", "P2,c")
    time = np.arange(8000) / 1000.0
    held = Trace(time=time, force=0.5 * time + 1.5 * (1.0 - time % 1.0 < 0.5), position=0.01 * time)
    for suffix in "ab":  # a blade that stays as fast where the force falls by 1.5 N, as in no hand
        save(held, tmp_path / f"{suffix}.csv")
    assert run(tmp_path, table) == 0
    said = capsys.readouterr().err
    assert "note: a: doubtful: the blade hardly lurches at" in said
    assert "note: b: doubtful" in said
    assert "note: c: doubtful" not in said
    assert not any(note.startswith("doubtful: the blade hardly") for note in score(held).notes)


def test_without_a_table_operators_and_days_are_those_of_the_records(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")
    made = {"a": ("P2", "2026-03-09T10:00:00"), "b": ("P1", "2026-03-01T09:00:00"), "c": ("P2", "2026-03-02T09:00:00")}
    for name, (operator, date) in made.items():
        time = np.arange(100) / 100.0
        trace = Trace(time=time, force=2.0 + np.sin(9.0 * time), metadata={"operator": operator, "date": date})
        save(trace, tmp_path / f"{name}.csv")
    assert numbers_made(tmp_path, "--sheets", str(tmp_path / "sheets"), "--mark", "50") == [
        ("b", "P1", "1", "1"), ("c", "P2", "1", "1"), ("a", "P2", "2", "2"),
    ]  # fmt: skip
    with (tmp_path / "sheets" / "class.csv").open(newline="", encoding="utf-8") as file:
        assert [(row["operator"], row["cuts"]) for row in csv.DictReader(file)] == [("P1", "1"), ("P2", "2")]
    assert DISCLAIMER in (tmp_path / "sheets" / "P2.html").read_text(encoding="utf-8")
    capsys.readouterr()
    (tmp_path / "study.csv").unlink()
    save(Trace(time=time, force=2.0 + np.sin(9.0 * time)), tmp_path / "d.csv")
    assert command.main([str(tmp_path)]) == 2
    assert "no operator is named in d; give a table of operators" in capsys.readouterr().err


def test_a_file_of_several_cuts_is_one_row_or_a_row_for_each(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    time = np.arange(100) / 100.0
    cuts = [Trace(time=time, force=1.0 + k + np.sin(9.0 * time)) for k in range(3)]
    save(cuts, tmp_path / "session.csv")
    table = tmp_path / "who.csv"
    table.write_text("record,operator\nsession.csv,P1\n", encoding="utf-8")
    assert run(tmp_path, table, "--metric", "peak_force") == 0
    assert "3 cuts of 1 operator" in capsys.readouterr().out
    table.write_text("record,operator\nsession 1,P1\nsession 2,P2\nsession 3,P1\n", encoding="utf-8")
    assert run(tmp_path, table, "--metric", "peak_force") == 0
    assert "3 cuts of 2 operators" in capsys.readouterr().out
    table.write_text("record,operator\nsession,P1\nsession 2,P2\n", encoding="utf-8")
    assert run(tmp_path, table) == 2
    assert "'session' and 'session 2' are one cut; keep one row" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("rows", "options", "message"),
    [
        (["a,P1", "b,P1"], [], "do not fit: no row for c.csv"),
        (["a,P1", "b,P1", "c,P1", "d,P1"], [], "do not fit: no record for d"),
        (["a,P1", "d,P1"], [], "no row for b.csv, c.csv; no record for d"),
        (["a,P1", "b,P1", "c,P1"], ["--out", "page.pdf"], "must end in .html"),
        (["a,P1", "b,P1", "c,P1"], ["--out", "a_file/page.html"], "is a file; give a folder"),
        (["a,P1", "b,P1", "c,P1"], ["--mark", "101"], "--mark = 101 is outside"),
        (["a,P1", "b,P1", "c,P1"], ["--metric", "tip_eror"], "Did you mean 'tip_error'?"),
        (["a,P1", "b,P1", "c,P1"], ["--criterion", "1"], "needs exactly one metric"),
        (["a,P1", "b,P1", "c,P1"], ["--groups", "x", "y"], "group must be one of"),
        (["a,P1", "b,P1", "c,P1"], ["--metric", "tip_error"], "tip_error is missing in 3 of 3 cuts"),
        (["a,P1", "b,P1", "c,P1"], ["--target-length", "8m"], "--target-length = 8 m is outside"),
    ],
)
def test_what_does_not_fit_is_exit_code_2_and_named(
    tmp_path: Path, rows: list[str], options: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a_file").touch()
    options = [str(tmp_path / text) if text.startswith("a_file") else text for text in options]
    assert run(tmp_path, few(tmp_path, "record,operator", *rows), *options) == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(("metric", "target"), [("tip_error", 0.003), ("overall_score", 3.0), ("duration", 3.0)])
def test_the_criterion_is_in_the_unit_that_is_shown(metric: str, target: float) -> None:
    arguments = command._parser().parse_args(["cuts/", "--metric", metric, "--criterion", "3"])
    assert command._criterion(arguments) == pytest.approx(target)


def test_a_missing_table_is_named_in_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert command.main([str(tmp_path), "--operators", str(tmp_path / "nofile.csv")]) == 2
    assert f"no such table of operators: {tmp_path / 'nofile.csv'}. Give a CSV file" in capsys.readouterr().err


def test_a_folder_without_records_is_exit_code_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = few(tmp_path, "record,operator", "a,P1")
    (tmp_path / "empty").mkdir()
    assert run(tmp_path / "empty", table) == 2
    assert "no records in" in capsys.readouterr().err


def test_a_bad_record_is_left_out_only_when_asked_to(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = few(tmp_path, "record,operator", "a,P1", "b,P1", "c,P1")
    (tmp_path / "b.csv").write_text("time_s,force_N\n0,1\n1,nan\n", encoding="utf-8")
    assert run(tmp_path, table, "--metric", "peak_force") == 2
    assert "--skip-bad" in capsys.readouterr().err
    assert run(tmp_path, table, "--metric", "peak_force", "--skip-bad") == 0
    said = capsys.readouterr().out
    assert "2 cuts of 1 operator" in said
    assert "left out: b.csv" in said


def test_a_table_of_semicolons_is_read_alike_and_raters_are_left_alone(tmp_path: Path) -> None:
    table = tmp_path / "who.csv"
    table.write_bytes("\ufeffRecord;Operator;Group;Session;Order;Rater_a\r\na.csv;P07;novice;2;3;\r\n".encode())
    (row,) = load_operators(table)
    assert (row.record, row.operator, row.group, row.session, row.order) == ("a.csv", "P07", "novice", "2", 3.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "lacks record, operator"),
        ("record,operator\n", "has no rows below its headers"),
        ("record,who\na,P1\n", "lacks operator and has unknown columns 'who'"),
        ("record,operator,operator\na,P1,P1\n", "has a column twice"),
        ("record,operator\na\n", "line 2 has 1 cells for 2 columns"),
        ("record,operator,group\na,P1,\n", "line 2 has no group. Fill it in, or leave the column out"),
        ("record,operator\na,Jane Doe\n", "line 2: operator 'Jane Doe' may identify a person"),
        ("record,operator\na,P1\na,P2\n", "record 'a' stands in line 2 and in line 3"),
        ("record,operator,order\na,P1,first\n", "line 2: order 'first' is no number"),
        ("record,operator,order\na,P1,nan\n", "line 2: order 'nan' is no number"),
        ("record,operator,order\na,P1,1\nb,P1,1\n", "operator P1 has order 1 in line 2 and in line 3"),
    ],
)
def test_a_table_that_is_none_is_refused_with_line_and_cure(tmp_path: Path, text: str, message: str) -> None:
    table = tmp_path / "who.csv"
    table.write_text(text, encoding="utf-8")
    with pytest.raises(RecordError, match=message):
        load_operators(table)


def test_a_table_in_another_encoding_is_refused(tmp_path: Path) -> None:
    table = tmp_path / "who.csv"
    table.write_bytes("record,operator\nschräg,P1\n".encode("latin-1"))
    with pytest.raises(RecordError, match="UTF-8"):
        load_operators(table)


def test_people_and_groups_are_compared_until_it_is_decided(records, capsys):
    given = [records, records / "operators.csv", "--until", "decided", "--metric", "force_rate"]
    assert run(*given, "--mark", "1") == 0
    said = capsys.readouterr().out
    assert said.count("against the mark 1") + said.count("than the mark 1") == len((*NOVICES, *EXPERTS))
    assert said.count("A decision is wrong with a probability of") == 1
    assert run(*given, "--groups", "expert", "novice") == 0
    said = capsys.readouterr().out
    assert "expert against novice is undecided in overall score" in said
    assert f"after {min(len(NOVICES), len(EXPERTS))} pairs of people" in said
