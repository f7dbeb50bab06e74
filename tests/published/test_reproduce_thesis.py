"""The program that prints the thesis's numbers beside ours: rows, misses, summary and figures."""

from __future__ import annotations

import dataclasses
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from cutenv.tissue import CutModel
from cutenv.tissue.tables import errata

SCRIPTS = Path(__file__).parents[2] / "scripts"
NOT_CLAIMED = {"four-nodes", "errata"}
KNOWN_MISSES = {
    "incompressible": 1,  # bricks at 2.90 cm, which the thesis integrated by the reduced rule
    "fits": 3,  # means that the thesis's straight line passes at more than the printed SD
}
# Drawn livers, the four of the quick protocol: rows near their border may fall otherwise on another machine.
MOST_MISSES = {
    "livers-by-cut": 5,  # of 18; Table 5.4, and the scatter within a cut in Tables 5.3 and 5.4
    "livers-5-5": 2,  # of 12; the means at 2.54 cm/s
    "livers-5-6": 2,  # of 24
    "livers-equations": 4,  # of 12; the lines at 45 degrees, of four cuts that differ much
    "livers-6-1": 1,  # of 6
}


@pytest.fixture(scope="module")
def program() -> Iterator[ModuleType]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(SCRIPTS))
        import reproduce_thesis

        yield reproduce_thesis


def names(package: str) -> list[str]:
    """The comparisons or the figures, read from the source: collecting the tests imports no script."""
    source = (SCRIPTS / package / "__init__.py").read_text()
    return re.findall(r'^    "([a-z0-9_-]+)":', source, re.MULTILINE)


def check_agrees(program: ModuleType, name: str) -> None:
    comparison = program.COMPARISONS[name](True)
    assert comparison.rows
    assert bool(comparison.claims) == (name not in NOT_CLAIMED)
    misses = [row.what for row in comparison.misses]
    if name in MOST_MISSES:
        assert len(misses) <= MOST_MISSES[name] < len(comparison.claims), misses
    else:
        assert len(misses) == KNOWN_MISSES.get(name, 0), misses


@pytest.mark.parametrize("name", names("reproduction"))
def test_comparison_agrees_but_for_the_known_misses(program: ModuleType, name: str) -> None:
    check_agrees(program, name)


def test_every_comparison_and_every_figure_is_tested(program: ModuleType) -> None:
    assert names("reproduction") == list(program.COMPARISONS)
    assert names("thesis_figures") == list(program.FIGURES)


def stiffer_in_plane_strain(monkeypatch: pytest.MonkeyPatch) -> None:
    right = CutModel.stiffness
    monkeypatch.setattr(
        CutModel, "stiffness", lambda self, a: right(self, a) * (1.2 if self.formulation == "plane_strain" else 1.0)
    )


@pytest.mark.parametrize(
    ("name", "module", "constant", "wrong"),
    [
        ("mesh-counts", "meshes", "MODELS", {"3-D, 20 nodes": ("quad8", "plane_stress")}),
        ("mesh-counts", "meshes", "DIVISIONS", [(8, 15), (10, 24), (16, 30), (32, 60), (40, 74)]),
        ("poisson", "models", "model", lambda poisson=0.3: CutModel(formulation="plane_strain", poisson=poisson)),
        ("incompressible", "models", "QUAD8_COLUMN", "lem_quad8_plane_strain_Pa"),
        ("element-size", "models", "DIVISIONS", [(8, 15), (10, 24), (16, 15), (32, 30), (20, 75)]),
        ("beads", "beads", "TIP_DISPLACEMENT", 0.008),
    ],
)
def test_another_mesh_model_column_or_displacement_is_noticed(
    program: ModuleType, monkeypatch: pytest.MonkeyPatch, name: str, module: str, constant: str, wrong: Any
) -> None:
    monkeypatch.setattr(f"reproduction.{module}.{constant}", wrong)
    with pytest.raises(AssertionError):
        check_agrees(program, name)


@pytest.fixture
def other_livers(program: ModuleType, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Livers three times as stiff and as tough as those that were measured: four cuts tell no less."""
    from reproduction import drawn_livers

    liver = drawn_livers.measured_liver()
    threefold = {name: 3.0 * getattr(liver, name) for name in ("modulus", "fracture_resistance")}
    monkeypatch.setattr(drawn_livers, "measured_liver", lambda: dataclasses.replace(liver, **threefold))
    drawn_livers.cuts.cache_clear()
    yield
    drawn_livers.cuts.cache_clear()


@pytest.mark.usefixtures("other_livers")
def test_livers_three_times_as_stiff_and_tough_are_noticed(program: ModuleType) -> None:
    for name in ("livers-by-cut", "livers-5-5", "livers-5-6", "livers-6-1"):
        with pytest.raises(AssertionError):
            check_agrees(program, name)


def test_friction_that_is_assumed_instead_of_measured_is_noticed(
    program: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    from reproduction import friction

    right = friction.estimate_fracture_resistance
    monkeypatch.setattr(
        friction,
        "estimate_fracture_resistance",
        lambda trace: right(trace.select(slice(int(np.argmax(trace.position)) + 1))),
    )
    with pytest.raises(AssertionError):
        check_agrees(program, "friction")


def test_rows_are_printed_beside_the_reference(program: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert program.main(["--only", "mesh-counts", "--only", "plane-strain"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"^ok +2-D, 8 nodes: equations +876 +876 +exact$", printed, re.MULTILINE)
    assert re.search(r"^ok +at 5\.14 cm +0\.92\d+ +0\.92\d+ +1\.84 %$", printed, re.MULTILINE)
    assert "28 of 28 rows agree, 0 miss" in printed
    assert "MISS" not in printed


def test_a_broken_value_shows_as_a_miss(
    program: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    stiffer_in_plane_strain(monkeypatch)
    with pytest.raises(AssertionError):
        check_agrees(program, "plane-strain")
    assert program.main(["--only", "plane-strain", "--only", "mesh-counts"]) == 9
    printed = capsys.readouterr().out
    assert len(re.findall(r"^MISS +at \d\.\d\d cm", printed, re.MULTILINE)) == 9
    assert "MISS  plane-strain: at 5.14 cm" in printed
    assert "19 of 28 rows agree, 9 miss" in printed


def test_a_value_that_is_no_number_is_a_miss(program: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CutModel, "stiffness", lambda self, a: float("nan"))
    assert len(program.COMPARISONS["unit-stiffness"](True).misses) == 3


def test_known_misses_are_listed_and_counted(program: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert program.main(["--only", "fits"]) == 3
    printed = capsys.readouterr().out
    assert "MISS  fits: Table 5.6, 90 deg plane stress, 2.54 cm/s, kPa: 18.8 for 24.0" in printed
    assert "note: A straight line through these means" in printed


def test_errata_are_printed_and_claim_nothing(program: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    assert program.main(["--only", "errata"]) == 0
    printed = capsys.readouterr().out
    assert errata()
    assert all(f"note: Table {number}. {text}" in printed for number, text in errata())
    assert "0 of 0 rows agree, 0 miss" in printed


def test_summary_is_one_markdown_row_a_comparison(program: ModuleType, tmp_path: Path) -> None:
    program.main(["--only", "fits", "--only", "bricks", "--markdown", str(tmp_path / "agreement.md")])
    lines = (tmp_path / "agreement.md").read_text().splitlines()
    assert len(lines) == 4
    assert all(line.count("|") == lines[0].count("|") for line in lines)
    assert "**MISS (51/54)**" in lines[2]
    assert "agrees (7/7)" in lines[3]


def check_picture(file: Path) -> None:
    from matplotlib.image import imread

    picture = imread(file)[..., :3]
    assert min(picture.shape[:2]) > 400
    inked = np.mean(np.any(picture < 0.9, axis=-1))
    assert 0.005 < inked < 0.7


@pytest.mark.parametrize(
    "name",
    [
        "figure_3_6",
        "figure_4_2",
        "figure_5_2_to_5_4",
        "figure_5_5_to_5_9",
        "figure_6_3_to_6_4",
        "figure_6_5_to_6_7",
        "figure_energy",
    ],
)
def test_figure_is_drawn_into_the_folder_asked_for(program: ModuleType, name: str, tmp_path: Path) -> None:
    program.main(["--quick", "--only", name, "--out", str(tmp_path / "new")])
    assert [file.name for file in (tmp_path / "new").iterdir()] == [f"{name}.png"]
    check_picture(tmp_path / "new" / f"{name}.png")


def test_an_empty_picture_is_noticed(tmp_path: Path) -> None:
    from matplotlib.figure import Figure

    Figure(figsize=(8, 6)).savefig(tmp_path / "empty.png")
    with pytest.raises(AssertionError):
        check_picture(tmp_path / "empty.png")


def test_the_program_runs_from_anywhere(tmp_path: Path) -> None:
    command = [sys.executable, str(SCRIPTS / "reproduce_thesis.py"), "--only", "unit-stiffness"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "3 of 3 rows agree, 0 miss" in done.stdout


def test_an_unknown_name_is_refused_with_those_known(program: ModuleType, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        program.main(["--only", "plain-strain"])
    assert "plane-strain" in capsys.readouterr().err
