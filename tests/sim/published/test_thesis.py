"""The registry of checks: every number of the thesis beside ours; drawn livers beside the tables; the program."""

from __future__ import annotations

import dataclasses
import functools
import re
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

from cutenv.sim.tissue import CutModel, measured_fracture_resistance, measured_liver, tables
from cutenv.sim.tissue.effective_modulus import falls, linear_fit, power_fit
from scripts.validation.thesis import CHECKS, drawn_livers, scatter
from scripts.validation.thesis import reproduce_thesis as program
from scripts.validation.thesis.rows import SHOWN, Check
from scripts.validation.thesis.virtual_cuts import virtual_cut

STATEMENTS = [name for name, each in CHECKS.items() if not each.listed]
OF_TABLES = ["mesh-counts", "plane-strain", "poisson", "bricks", "incompressible", "element-size", "beads", "averages"]
OF_TABLES += ["equations", "fits", "law-of-speed", "constants"]


def check_agrees(check: Check) -> None:
    """All rows agree but those that are known to miss, which do miss; of drawn livers, so many at most."""
    comparison = check(True)
    assert comparison.rows
    assert bool(comparison.claims) == (check.tolerance != SHOWN)
    missed = [row.what for row in comparison.misses]
    if check.most_misses:
        assert len(missed) <= check.most_misses < len(comparison.claims), missed
    else:
        assert len(missed) == len(check.misses), missed
        assert all(what.startswith(check.misses) for what in missed), missed


def check_all_agree(names: Sequence[str]) -> None:
    for name in names:
        check_agrees(CHECKS[name])


@pytest.mark.parametrize("name", CHECKS)
def test_check_agrees_but_for_the_known_misses(name: str) -> None:
    check_agrees(CHECKS[name])


# ------------------------------------------------------------------------------------------- errors on purpose

# Labels; speeds, by which rows are looked up; spreads, which stand nowhere else.
NOT_MISREAD = ("level", "row", "test", "bead", "nodes_per_element", "speed_cm_s")
COLUMNS = [
    (number, column)
    for number in tables.table_numbers()
    if number != "6.2"  # other tissues, by others: for orientation
    for column in tables.table(number).columns
    if column not in NOT_MISREAD and not column.startswith("sd_")
]


@pytest.fixture
def misread(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str, str], None]]:
    """Return what lets a column be read as more than is printed: a quarter in its last row, ever less above."""
    right = tables.read_table
    fits = (falls, linear_fit, power_fit)

    def plant(of: str, column: str) -> None:
        def wrong(file: Path, *, number: str) -> tables.ThesisTable:
            read = right(file, number=number)
            if number != of:
                return read
            factor = np.linspace(1.0, 1.25, len(read[column]))
            return dataclasses.replace(read, columns={**read.columns, column: factor * read[column]})

        monkeypatch.setattr(tables, "read_table", wrong)
        for fit in fits:
            fit.cache_clear()

    yield plant
    for fit in fits:
        fit.cache_clear()


@pytest.mark.parametrize(("number", "column"), COLUMNS)
def test_a_misread_column_is_noticed(misread: Callable[[str, str], None], number: str, column: str) -> None:
    misread(number, column)
    with pytest.raises(AssertionError):
        check_all_agree([*STATEMENTS, *OF_TABLES])


def stiffer_in_plane_strain(monkeypatch: pytest.MonkeyPatch) -> None:
    right = CutModel.stiffness
    monkeypatch.setattr(
        CutModel, "stiffness", lambda self, a: right(self, a) * (1.2 if self.formulation == "plane_strain" else 1.0)
    )


# --------------------------------------------------------------------------------------------------- errata


@functools.cache
def errata_shown() -> list[str]:
    """Return the words by which the rows of the statements name errata."""
    rows = [row.what for name in STATEMENTS for row in CHECKS[name](True).rows]
    return [what.removeprefix("erratum: ") for what in rows if what.startswith("erratum: ")]


def check_shown(erratum: str) -> None:
    """Some statement names it, beside the rows that show it."""
    assert any(words in erratum for words in errata_shown())


@pytest.mark.parametrize("erratum", [text for _, text in tables.errata()])
def test_every_erratum_is_named_by_a_statement_that_shows_it(erratum: str) -> None:
    check_shown(erratum)


# ----------------------------------------------------------------------------------------------- the program


def test_rows_are_printed_beside_the_reference(capsys: pytest.CaptureFixture[str]) -> None:
    assert program.main(["--only", "mesh-counts", "--only", "plane-strain"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"^ok +2-D, 8 nodes: equations +876 +876 +exact$", printed, re.MULTILINE)
    assert re.search(r"^ok +at 5\.14 cm +0\.92\d+ +0\.92\d+ +1\.84 %$", printed, re.MULTILINE)
    assert "28 of 28 rows agree, 0 miss" in printed
    assert "MISS" not in printed


def test_a_broken_value_shows_as_a_miss(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    stiffer_in_plane_strain(monkeypatch)
    with pytest.raises(AssertionError):
        check_agrees(CHECKS["plane-strain"])
    assert program.main(["--only", "plane-strain", "--only", "mesh-counts"]) == 9
    printed = capsys.readouterr().out
    assert len(re.findall(r"^MISS +at \d\.\d\d cm", printed, re.MULTILINE)) == 9
    assert "MISS  plane-strain: at 5.14 cm" in printed
    assert "19 of 28 rows agree, 9 miss" in printed


def test_a_value_that_is_no_number_is_a_miss(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(CutModel, "stiffness", lambda self, a: float("nan"))
    assert len(CHECKS["unit-stiffness"](True).misses) == 3


def test_known_misses_are_listed_and_summed_up(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert program.main(["--only", "fits", "--only", "bricks", "--markdown", str(tmp_path / "agreement.md")]) == 3
    printed = capsys.readouterr().out
    assert "MISS  fits: Table 5.6, 90 deg plane stress, 2.54 cm/s, kPa: 18.8 for 24.0" in printed
    assert "note: A straight line through these means" in printed
    lines = (tmp_path / "agreement.md").read_text().splitlines()
    assert len(lines) == 4
    assert all(line.count("|") == lines[0].count("|") for line in lines)
    assert "**MISS (51/54)**" in lines[2]
    assert "agrees (7/7)" in lines[3]


def test_errata_are_printed_and_claim_nothing(capsys: pytest.CaptureFixture[str]) -> None:
    assert program.main(["--only", "errata"]) == 0
    printed = capsys.readouterr().out
    assert tables.errata()
    assert all(f"note: Table {number}. {text}" in printed for number, text in tables.errata())
    assert "0 of 0 rows agree, 0 miss" in printed


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
def test_figure_is_drawn_into_the_folder_asked_for(name: str, tmp_path: Path) -> None:
    program.main(["--quick", "--only", name, "--out", str(tmp_path / "new")])
    assert [file.name for file in (tmp_path / "new").iterdir()] == [f"{name}.png"]
    check_picture(tmp_path / "new" / f"{name}.png")


def test_the_program_runs_from_anywhere(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "scripts.validation.thesis.reproduce_thesis", "--only", "unit-stiffness"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "3 of 3 rows agree, 0 miss" in done.stdout


def test_an_unknown_name_is_refused_with_those_known(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        program.main(["--only", "plain-strain"])
    assert "plane-strain" in capsys.readouterr().err


PAIRS = 1000


def share_that_agrees(row: str, *, shift: float = 0.0, factor: float = 1.0) -> float:
    """Return the share of pairs of samples (6 and 24 normal numbers) that agree; the second is shifted and scaled."""
    rng = np.random.default_rng(1)
    compare, sample = getattr(scatter, row), scatter.Sample.of
    rows = [
        compare("", sample(50.0 + rng.normal(size=6)), sample(50.0 + shift + factor * rng.normal(size=24)))
        for _ in range(PAIRS)
    ]
    return float(np.mean([row.agrees for row in rows]))


@pytest.mark.parametrize("row", ["mean_row", "sd_row"])
def test_samples_of_one_population_agree_nineteen_times_in_twenty(row: str) -> None:
    assert share_that_agrees(row) == pytest.approx(0.95, abs=0.015)


def joint_rows(shift: float) -> list[tuple[float, bool]]:
    """Return, for tables of seven means, the share of means that agree alone, and whether all agree together."""
    rng, found = np.random.default_rng(3), []
    sample = scatter.Sample.of
    for _ in range(PAIRS):
        table, ours = ([sample(50.0 + by + rng.normal(size=n)) for _ in range(7)] for by, n in ((0.0, 6), (shift, 24)))
        alone = [scatter.mean_row("", *pair).agrees for pair in zip(table, ours, strict=True)]
        found.append((float(np.mean(alone)), bool(scatter.joint_row("", table, ours).agrees)))
    return found


def test_means_that_all_err_to_one_side_are_noticed_together_though_most_agree_alone() -> None:
    assert np.mean(joint_rows(0.0), axis=0)[1] == pytest.approx(0.95, abs=0.03)
    alone, together = np.mean(joint_rows(-0.6), axis=0)
    assert alone > 0.7
    assert together < 0.2


def share_of_lines_that_agree(*, change: float) -> list[float]:
    """Return the share of pairs of lines, through seven points with scatter, whose coefficients agree.

    The second is another line by ``change``.
    """
    rng, x = np.random.default_rng(2), np.linspace(0.1, 2.5, 7)
    line = scatter.Line.through
    found = []
    for _ in range(PAIRS):
        reference = line(x, 60.0 - 9.0 * x + rng.normal(size=7))
        ours = line(x, 60.0 + 6.0 * change - (9.0 - 4.0 * change) * x + rng.normal(size=7))
        rows = scatter.coefficient_rows("", reference, ours, slope="slope", intercept="intercept")
        found.append([row.agrees for row in rows])
    return list(np.mean(found, axis=0))


def test_lines_through_points_of_one_law_agree_nineteen_times_in_twenty() -> None:
    assert share_of_lines_that_agree(change=0.0) == pytest.approx([0.95, 0.95], abs=0.015)


def test_a_power_law_comes_back() -> None:
    x = np.array([0.1, 0.38, 0.89, 1.27, 2.54])
    line = scatter.Line.through_logarithms(x, 24.2 * x**-0.42)
    assert (line.slope, line.intercept) == pytest.approx((-0.42, 24.2))
    assert max(line.slope_error, line.intercept_error) < 1e-6


def test_what_is_measured_of_an_even_cut_is_its_modulus() -> None:
    """Two centimetres deep: twice the modulus without depth; the blade for the tip reads several per cent high."""
    trace = virtual_cut("2 cm", turns=(0.12,)).trace
    found = drawn_livers.measure(trace, 0.0508, upright=True)
    name = ("plane_stress", 0.3)
    true = measured_liver().local_effective_modulus(0.0127, np.pi / 2)
    assert 1.02 < np.median(found.per_depth[name]) / true < 1.08
    assert found.as_measured[name] == pytest.approx(2.0 * found.per_depth[name])
    assert found.of_force_per_depth == pytest.approx(found.per_depth[name], rel=1e-6)
    assert 0.9 < found.apparent / measured_fracture_resistance().mean < 1.0


def test_the_same_segments_in_another_model_differ_by_its_stiffness() -> None:
    trace = virtual_cut("bulge", turns=(0.12,)).trace
    found = drawn_livers.measure(trace, 0.0508, upright=False)
    ratio = found.as_measured["plane_strain", 0.499] / found.as_measured["plane_stress", 0.3]
    model = CutModel(formulation="plane_strain", poisson=0.499)
    whole = CutModel().stiffness(np.linspace(0.01, 0.12, 200)) / model.stiffness(np.linspace(0.01, 0.12, 200))
    assert whole.min() <= ratio.min() <= ratio.max() <= whole.max()
    assert (np.diff(ratio) > 0.0).all()  # as the models' stiffnesses come together away from the clamp
    assert found.apparent is None


@pytest.fixture
def other_livers(monkeypatch: pytest.MonkeyPatch) -> None:
    """Livers three times as stiff and as tough as those that were measured: four cuts tell no less."""
    liver = drawn_livers.measured_liver()
    threefold = {name: 3.0 * getattr(liver, name) for name in ("modulus", "fracture_resistance")}
    monkeypatch.setattr(drawn_livers, "measured_liver", lambda: dataclasses.replace(liver, **threefold))
    monkeypatch.setattr(drawn_livers, "cuts", functools.cache(drawn_livers.cuts.__wrapped__))


@pytest.mark.usefixtures("other_livers")
def test_livers_three_times_as_stiff_and_tough_are_noticed() -> None:
    for name in ("livers-by-cut", "livers-5-5", "livers-5-6", "livers-6-1"):
        with pytest.raises(AssertionError):
            check_agrees(CHECKS[name])


def test_an_erratum_without_a_statement_is_noticed() -> None:
    with pytest.raises(AssertionError):
        check_shown("Section 9.9 has a misprint.")


def test_other_means_and_other_spreads_are_noticed() -> None:
    assert share_that_agrees("mean_row", shift=2.0) < 0.15
    assert share_that_agrees("sd_row", factor=5.0) < 0.15


def test_another_law_is_noticed() -> None:
    assert max(share_of_lines_that_agree(change=1.0)) < 0.15
