"""``cutenv calibrate`` on files: what it writes, and what it refuses before any work."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from virtual_session import traces

from cutenv.commands import cli
from cutenv.records import save
from cutenv.records.foreign.column_map import MAP_FILE, ColumnMap
from cutenv.records.measurement import calibrate, calibration
from cutenv.sim.tissue import CutModel, load_description
from cutenv.sim.trace import Trace


def records() -> list[Trace]:
    """Two livers, upright and inclined, the faster cuts."""
    return [trace for trace in traces()[:12] if trace.duration < 25.0]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """A CSV for each record."""
    folder = tmp_path_factory.mktemp("records")
    paths = [folder / f"{trace.metadata['name'].replace(' ', '_')}.csv" for trace in records()]
    for trace, path in zip(records(), paths, strict=True):
        save(trace, path)
    return [str(path) for path in paths]


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    """Exit status, standard output and standard error."""
    capsys.readouterr()
    try:
        status = cli.main(["calibrate", *map(str, arguments)])
    except SystemExit as ended:  # argparse's own refusals
        status = int(ended.code or 0)
    said = capsys.readouterr()
    return status, said.out, said.err


def check_refused(capsys: pytest.CaptureFixture[str], folder: Path, *arguments: object) -> str:
    """Exit code 2, an explanation, and nothing written: not even a part of a file."""
    before = sorted(folder.rglob("*"))
    status, out, err = run(capsys, *arguments)
    assert status == 2
    assert out == ""
    assert "Traceback" not in err
    assert sorted(folder.rglob("*")) == before
    return err


@pytest.fixture
def no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing may be measured."""

    def measured(*arguments: object, **options: object) -> None:
        raise AssertionError("work was done before the refusal")

    monkeypatch.setattr(calibration, "measure_cut", measured)


def test_files_give_what_the_records_give(files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, report = tmp_path / "my_tissue.json", tmp_path / "card.html"
    status, said, err = run(capsys, *files, "--out", out, "--report", report, "--resamples", 3)
    assert (status, "note:" in err) == (0, False)
    found, expected = load_description(out), calibrate(records(), name="my_tissue", resamples=3)
    assert found == expected
    assert found.calibration == expected.calibration
    assert found.name == "my_tissue"
    assert report.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    card = json.loads(report.with_suffix(".json").read_text(encoding="utf-8"))
    assert len(card["cuts"]) == len(files)
    assert f'gymnasium.make("cutenv/GentleCut-v1", tissue="{out}")' in said
    assert f"{found.eta90:.4g}" in said
    assert "8 cuts of 2 specimens" in said


def test_options_choose_name_and_model(files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "tissue.json"
    options = ["--name", "my liver", "--formulation", "plane_strain", "--poisson", 0.4, "--resamples", 0]
    status, _, _ = run(capsys, *files[:4], "--out", out, *options)
    assert status == 0
    found = load_description(out)
    assert (found.name, found.formulation, found.poisson) == ("my liver", "plane_strain", 0.4)
    model = CutModel(formulation="plane_strain", poisson=0.4)
    assert found == calibrate(records()[:4], name="my liver", model=model, resamples=0)


def test_progress_is_shown_while_files_are_read_and_cuts_measured(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, _, err = run(capsys, *files[:2], "--out", tmp_path / "tissue.json", "--resamples", 0)
    assert "reading" in err
    assert "measuring" in err


BAD_OPTIONS = [
    (["--out", "tissue.txt"], "must end in .json"),
    (["--out", "tissue.json", "--report", "card.pdf"], "must end in .html"),
    (["--out", "card.json", "--report", "card.html"], "would write its data over --out"),
    (["--out", "a_file/tissue.json"], "a_file is a file; give a folder"),
    (["--out", "tissue.json", "--report", "a_file/card.html"], "a_file is a file; give a folder"),
    (["--out", "tissue.json", "--resamples", "-1"], "resamples = -1 is outside 0 to 100000"),
    (["--out", "tissue.json", "--resamples", "1000000"], "resamples = 1e+06 is outside 0 to 100000"),
    (["--out", "tissue.json", "--resamples", "many"], "invalid int value: 'many'"),
    (["--out", "tissue.json", "--poisson", "0.6"], "poisson = 0.6 is outside"),
    (["--out", "tissue.json", "--element", "quad9"], "invalid choice: 'quad9'"),
    (["--out", "tissue.json", "--element", "hex20"], "invalid choice: 'hex20'"),
    (["--out", "tissue.json", "--specimen", "("], "is no regular expression"),
    (["--out", "tissue.json", "--specimen", "(sheep|cow)"], "does not match"),
    (["--out", "tissue.json", "--unit", "N"], "--unit goes with --map"),
    (["--out", "tissue.json", "--map", "force"], "force"),
    (["--out", "tissue.json", "--map", "time=t", "force=F", "weight=w"], "weight"),
    ([], "the following arguments are required: --out"),
]


@pytest.mark.usefixtures("no_work")
@pytest.mark.parametrize(
    ("options", "message"), BAD_OPTIONS, ids=[" ".join(each[0]) or "no --out" for each in BAD_OPTIONS]
)
def test_a_bad_option_is_refused_before_any_work(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], message: str
) -> None:
    paths = {"--out", "--report"}
    placed = [
        str(tmp_path / text) if before in paths else text for before, text in zip(["", *options], options, strict=False)
    ]
    (tmp_path / "a_file").touch()
    bare = [dataclasses.replace(trace, metadata={}) for trace in records()[:1]] if "--specimen" in options else []
    for number, trace in enumerate(bare):
        save(trace, tmp_path / f"pig {number}.csv")
    given = [str(path) for path in tmp_path.glob("*.csv")] or files[:1]
    assert message.format(folder=tmp_path) in check_refused(capsys, tmp_path, *given, *placed)


@pytest.mark.usefixtures("no_work")
def test_a_missing_file_is_named(files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = [files[0], tmp_path / "gone.csv", "--out", tmp_path / "tissue.json"]
    assert f"no such file: {tmp_path / 'gone.csv'}" in check_refused(capsys, tmp_path, *arguments)


def bad_records(folder: Path) -> dict[str, str]:
    """Files that must not be believed, and a word of the reason."""
    good = records()[0]
    (folder / "damaged.csv").write_text("# cutenv-record/1\ntime_s,force_N\n0,zero\n")
    save(dataclasses.replace(good, force=-good.force, metadata={}), folder / "reversed.csv")
    save(dataclasses.replace(good, force=np.full(len(good), 1.0), metadata={}), folder / "constant.csv")
    return {"damaged.csv": "is not a number", "reversed": "Reverse its sign", "constant": "at every instant"}


@pytest.mark.usefixtures("no_work")
def test_bad_records_are_all_listed_before_any_work(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reasons = bad_records(tmp_path)
    said = check_refused(capsys, tmp_path, *files[:1], *tmp_path.glob("*.csv"), "--out", tmp_path / "tissue.json")
    assert "3 bad records; --skip-bad goes on without them:" in said
    for name, reason in reasons.items():
        (line,) = [line for line in said.splitlines() if line.startswith(f"  {name}:")]
        assert reason in line


def test_bad_records_can_be_left_out_and_are_remembered(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reasons = bad_records(tmp_path)
    no_depth = dataclasses.replace(records()[0], depth=None, metadata={"name": "no depth"})
    save(no_depth, tmp_path / "no_depth.csv")
    out = tmp_path / "tissue.json"
    given = [*files[:4], *tmp_path.glob("*.csv"), "--out", out, "--resamples", 0]
    refused = run(capsys, *given[:4], tmp_path / "no_depth.csv", *given[-4:])
    assert refused[0] == 2
    assert "1 records cannot be measured" in refused[2]
    assert not out.exists()
    status, said, _ = run(capsys, *given, "--skip-bad")
    assert status == 0
    found = load_description(out)
    assert found == calibrate(records()[:4], name="tissue", resamples=0)
    assert found.calibration is not None
    notes = [note for note in found.calibration.notes if note.startswith("left out: ")]
    for name in (*reasons, "no depth"):
        assert any(note.startswith(f"left out: {name}: ") for note in notes)
        assert f"note: left out: {name}: " in said


def test_if_all_records_are_bad_there_is_no_tissue(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad_records(tmp_path)
    arguments = [*tmp_path.glob("*.csv"), "--out", tmp_path / "tissue.json", "--skip-bad"]
    assert "no record can be measured" in check_refused(capsys, tmp_path, *arguments)


def test_a_card_that_cannot_be_written_leaves_no_tissue(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from cutenv.display.report import calibration_card

    def full(*arguments: object, **keywords: object) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(calibration_card, "write_page", full)
    arguments = [*files[:4], "--out", tmp_path / "tissue.json", "--report", tmp_path / "card.html", "--resamples", 0]
    assert "no space left on device" in check_refused(capsys, tmp_path, *arguments)


# Specimens, and files of other programs.


def test_a_pattern_tells_the_specimen_where_the_record_does_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number, trace in enumerate(records()[:4]):
        (tmp_path / f"pig{number // 2}").mkdir(exist_ok=True)
        keep = {"specimen": "as recorded"} if number == 3 else {}
        save(dataclasses.replace(trace, metadata=keep), tmp_path / f"pig{number // 2}" / f"cut{number}.csv")
    out, report = tmp_path / "tissue.json", tmp_path / "card.html"
    given = [*sorted(tmp_path.rglob("*.csv")), "--out", out, "--resamples", 0]
    status, _, _ = run(capsys, *given, "--specimen", r"(pig\d)/cut", "--report", report)
    assert status == 0
    card = json.loads(report.with_suffix(".json").read_text())
    assert [row["specimen"] for row in card["cuts"]] == ["pig0", "pig0", "pig1", "as recorded"]
    assert [row["name"] for row in card["cuts"]] == ["cut0", "cut1", "cut2", "cut3"]


def as_foreign(trace: Trace, path: Path) -> None:
    """As a laboratory's program writes: semicolons, decimal commas, names of its own, a quiet start with an offset."""
    quiet = 300
    rng = np.random.default_rng(1)
    time = np.concatenate([np.arange(quiet) * 1e-3, trace.time - trace.time[0] + quiet * 1e-3])
    force = np.concatenate([rng.normal(0.0, 0.02, quiet), trace.force]) + 0.15
    assert trace.position is not None
    assert trace.depth is not None
    place, depth = (np.concatenate([np.full(quiet, each[0]), each]) for each in (trace.position, trace.depth))
    rows = ["Zeit (ms);Kraft (mN);Weg (mm);Tiefe (mm)"]
    for row in zip(1e3 * time, 1e3 * force, 1e3 * place, 1e3 * depth, strict=True):
        rows.append(";".join(f"{value:.6f}".replace(".", ",") for value in row))
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")


def test_files_of_another_program_are_mapped_tared_and_the_mapping_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    upright = [trace for trace in records() if trace.angle is not None and trace.angle[0] > 1.5][:3]
    for number, trace in enumerate(upright):
        as_foreign(trace, tmp_path / f"versuch{number}.csv")
    out, given = tmp_path / "tissue.json", sorted(tmp_path.glob("*.csv"))
    mapping = ["time=Zeit[ms]", "force=Kraft[mN]", "position=Weg[mm]", "depth=Tiefe[mm]", "angle=90deg"]
    status, _, err = run(capsys, *given, "--out", out, "--resamples", 0, "--verbose", "--map", *mapping)
    assert status == 0, err
    assert "taken off the force" in err
    found, expected = load_description(out), calibrate(upright, resamples=0)
    for name in ("fracture_resistance", "friction_share"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), rel=0.01), name
    at_speed = [tissue.intercept_90 + 0.0127 * tissue.slope_90 for tissue in (found, expected)]
    assert at_speed[0] == pytest.approx(at_speed[1], rel=0.03)
    assert ColumnMap.load(tmp_path) == ColumnMap.parse(mapping)
    first = out.read_text()
    status, _, _ = run(capsys, *given, "--out", out, "--resamples", 0)
    assert status == 0
    assert out.read_text() == first


def test_a_mapping_that_does_not_fit_is_not_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    as_foreign(records()[0], tmp_path / "versuch.csv")
    wrong: list[Any] = ["--map", "time=Zeit[ms]", "force=Last[mN]"]
    said = check_refused(capsys, tmp_path, tmp_path / "versuch.csv", "--out", tmp_path / "tissue.json", *wrong)
    assert "Last" in said
    assert not (tmp_path / MAP_FILE).exists()
