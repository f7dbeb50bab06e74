"""The benchmark of curved cuts: its files, and what is wrong with an entry."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from cutenv.sim.tissue import SteeredModel
from scripts.drawings import excision
from scripts.validation.physics import curved_cuts
from scripts.validation.physics.curves.calculix import deck
from scripts.validation.physics.curves.entry import measured
from scripts.validation.physics.curves.made import PATHS, reach

OURS = curved_cuts.FOLDER / "entries" / "steered"


def test_our_entries_keep_what_the_page_says() -> None:
    standings = {
        entry.name: measured(entry, curved_cuts.FOLDER) for entry in (curved_cuts.FOLDER / "entries").iterdir()
    }
    assert max(standings["steered"].errors) < 0.04
    assert max(standings["steered"].errors) < max(standings["table"].errors) < 0.08
    for standing in standings.values():
        assert standing.residual is not None
        assert standing.residual <= 1e-12


def test_the_reference_is_that_of_the_model() -> None:
    text = (curved_cuts.FOLDER / "reference.csv").read_text(encoding="utf-8")
    own = [line.split(",") for line in text.splitlines() if line.startswith("straight,")]
    model = SteeredModel((32, 60))
    model.begin()
    for _, way, along, coupled, across in own[:6]:
        model.cut_to((float(way) + 1e-5, 0.0))
        found = model.converted_stiffness(0.01)
        assert found[[0, 0, 1], [0, 1, 1]] == pytest.approx([float(along), float(coupled), float(across)], abs=1e-6)


def test_a_mesh_file_has_every_node_and_pair() -> None:
    model = SteeredModel((8, 15))
    model.begin()
    model.cut_to((0.04, 0.02))
    mesh = model.doubled_mesh()
    text = deck(mesh, "cut")
    assert len(re.findall(r"^\d+, [-\d.e]+, [-\d.e]+, 0\.$", text, re.MULTILINE)) == len(mesh.nodes)
    assert text.count("*EQUATION") == len(mesh.pairs)
    assert len(mesh.quadrilaterals) * 1.0 + len(mesh.triangles) / 2 == 8 * 15
    for name in PATHS:
        assert "TYPE=CPS8" in (curved_cuts.FOLDER / "meshes" / f"{name}.inp").read_text(encoding="ascii")


def without_a_column(entry: Path) -> None:
    text = (entry / "stiffness.csv").read_text(encoding="utf-8")
    (entry / "stiffness.csv").write_text(text.replace("along", "ahead", 1), encoding="utf-8")


def with_a_word(entry: Path) -> None:
    lines = (entry / "stiffness.csv").read_text(encoding="utf-8").splitlines()
    lines[3] = lines[3].rsplit(",", 1)[0] + ",soft"
    (entry / "stiffness.csv").write_text("\n".join(lines), encoding="utf-8")


def without_a_path(entry: Path) -> None:
    lines = (entry / "stiffness.csv").read_text(encoding="utf-8").splitlines()
    (entry / "stiffness.csv").write_text("\n".join(x for x in lines if not x.startswith("arc,")), encoding="utf-8")


def with_gaps(entry: Path) -> None:
    lines = (entry / "stiffness.csv").read_text(encoding="utf-8").splitlines()
    kept = [x for k, x in enumerate(lines) if k == 0 or k % 4 == 1]
    (entry / "stiffness.csv").write_text("\n".join(kept), encoding="utf-8")


def with_no_time(entry: Path) -> None:
    about = json.loads((entry / "about.json").read_text(encoding="utf-8"))
    (entry / "about.json").write_text(json.dumps(about | {"seconds_per_tip": -1}), encoding="utf-8")


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (without_a_column, "stiffness.csv lacks the column along"),
        (with_a_word, "stiffness.csv, line 4: give a number"),
        (without_a_path, "path 'arc' is missing"),
        (with_gaps, "has gaps; give a tip every 6 mm"),
        (with_no_time, "seconds_per_tip = -1"),
        (lambda entry: (entry / "stiffness.csv").unlink(), "stiffness.csv is missing"),
        (lambda entry: (entry / "about.json").write_text("{", encoding="utf-8"), "is no JSON"),
    ],
)
def test_a_wrong_entry_is_refused_with_file_and_cure(
    tmp_path: Path, spoil: Callable[[Path], object], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    entry = tmp_path / "entry"
    shutil.copytree(OURS, entry)
    assert curved_cuts.main(["check", str(entry)]) == 0
    spoil(entry)
    assert curved_cuts.main(["check", str(entry)]) == 1
    assert says in capsys.readouterr().err


def test_an_entry_that_gains_energy_and_is_softer_shows_it(tmp_path: Path) -> None:
    entry = tmp_path / "entry"
    shutil.copytree(OURS, entry)
    for name, column in (("energy.csv", 3), ("stiffness.csv", 2)):
        lines = [line.split(",") for line in (entry / name).read_text(encoding="utf-8").splitlines()]
        for line in lines[1:]:
            line[column] = str(0.9 * float(line[column]))
        (entry / name).write_text("\n".join(map(",".join, lines)), encoding="utf-8")
    standing = measured(entry, curved_cuts.FOLDER)
    assert standing.residual is not None
    assert standing.residual > 0.01
    assert 0.08 < standing.errors[0] < 0.13


def test_every_path_is_long_enough_to_compare() -> None:
    assert all(0.04 <= reach(line) <= 0.08 for line in PATHS.values())


def test_areas_of_an_excision_are_those_of_its_cuts() -> None:
    rng = np.random.default_rng(0)
    side = excision.cut_side(excision.Specimen.drawn(0), excision.half_ellipse(0.05, 0.008), rng)
    assert 0.0 < excision.area_between(side) < 0.05 * 4e-3
    mirrored = side._replace(cut=side.cut * [1.0, -1.0])
    own = float(np.trapezoid(side.cut[:, 1], side.cut[:, 0]))
    assert excision.area_within(side, mirrored) == pytest.approx(2.0 * own, rel=0.02)
