"""Score of cuts along a drawn line: of records with the places of the blade."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest
from map_cuts import LINE, map_cut, without

from cutenv.agents.difficulty import scripts_on_specimen_of
from cutenv.commands import score as command
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.records import load, save
from cutenv.records.line_file import read_line
from cutenv.records.scoring import MAP_METRICS, score
from cutenv.records.scoring.cut_map import LINE_KEY, PathMap
from cutenv.records.scoring.score_card import EXPECTED_CUT
from cutenv.records.scoring.truth import ASIDE_AT_END, TIP_AT_END
from cutenv.sim.quantities import LINE_LIMIT
from cutenv.sim.tissue import measured_liver
from cutenv.sim.tissue.drawn_lines import along_line, expected_cut
from cutenv.sim.tissue.grid import N_POINTS, SPACING, depth_below
from cutenv.sim.tissue.lines import arc, bent, mirrored, places_within, straight, through

GRID = np.arange(N_POINTS) * SPACING


@pytest.fixture
def path_cut():
    return map_cut("path")


def test_without_the_notes_the_cut_is_expected_from_the_blades_motion(path_cut):
    _, trace, _ = path_cut
    known, alone = score(trace), score(without(trace, ASIDE_AT_END, TIP_AT_END))
    assert EXPECTED_CUT in alone.notes
    assert EXPECTED_CUT not in known.notes
    assert abs(alone["mean_line_distance"] - known["mean_line_distance"]) < 0.15e-3
    assert abs(alone["largest_line_distance"] - known["largest_line_distance"]) < 0.4e-3
    blade = along_line(LINE, trace.blade_x, trace.blade_y)[1]
    assert abs(blade).max() < 0.1 * alone["largest_line_distance"], "the blade itself was on the line"


def test_a_given_line_replaces_the_records_own_and_positions_are_along_it(path_cut):
    _, trace, _ = path_cut
    beside = score(trace, line=straight())
    assert beside["largest_line_distance"] > LINE_LIMIT
    assert beside.outcome == f"the cut is {1e3 * beside['largest_line_distance']:.1f} mm off the line"
    assert beside.points[0].points == 0.0  # not within the limits
    assert beside.overall_score < 0.17 * sum(each.most for each in score(trace).points)
    hidden = without(trace, ASIDE_AT_END, TIP_AT_END)
    same = score(without(hidden, LINE_KEY), line=LINE)
    assert same["mean_line_distance"] == pytest.approx(score(hidden)["mean_line_distance"], rel=0.05)


@pytest.mark.parametrize("side", [1, -1])
def test_places_near_a_line_are_found_along_it_and_to_its_side(side):
    line = arc(0.03) if side > 0 else mirrored(arc(0.03))
    within = slice(1, 200)
    for off in (-0.004, 0.0, 0.003):
        x, y = line.x - off * np.sin(line.angle), line.y + off * np.cos(line.angle)
        place, aside = along_line(line, x[within], y[within])
        assert place == pytest.approx(GRID[within], abs=1e-6)
        assert aside == pytest.approx(off, abs=1e-6)
    between = [np.interp([7.3 * SPACING], GRID, each) for each in (line.x, line.y)]
    assert along_line(line, *between)[0] == pytest.approx(7.3 * SPACING, abs=1e-6)


def test_a_mirrored_cut_is_expected_on_the_other_side():
    line, place = arc(0.04), np.linspace(0.0, 0.08, 400)
    x, y = (np.interp(place, GRID, each) for each in (line.x, line.y))
    tip = np.maximum(place - 0.008, 0.0)
    cut = expected_cut(line, x, y, tip, measured_liver())
    other = expected_cut(mirrored(line), x, -y, tip, measured_liver())
    assert other == pytest.approx(-cut, abs=1e-7)
    assert abs(cut).max() > 0.5e-3  # it can be seen
    on_axis = expected_cut(straight(), place, np.zeros(400), tip, measured_liver())
    assert abs(on_axis).max() == 0.0


def test_a_strip_along_an_arc_has_the_area_of_the_ring():
    radius, off, cells = 0.05, 0.002, 101
    line = bent(np.where(np.arange(N_POINTS) < cells + 3, 1.0 / radius, 0.0))
    ring = PathMap(line=line, aside=np.full(cells, off))
    assert ring.area == pytest.approx(cells * SPACING / radius * 0.5 * (radius**2 - (radius - off) ** 2), rel=1e-12)
    assert np.hypot(ring.place[:, 0], ring.place[:, 1] - radius) == pytest.approx(radius - off, abs=1e-6)
    on_line = PathMap(line=line, aside=np.zeros(cells))
    assert (on_line.area, on_line.farthest, on_line.cost(0.05)) == (0.0, 0.0, 0.0)


def test_scripts_that_cut_straight_on_are_not_set_beside_a_cut_along_a_line(path_cut):
    _, trace, _ = path_cut
    named = {"specimen_class": "liver", "specimen_seed": 4, "specimen_episode": 0, "target_length_m": 0.07}
    depth = GentleCutEnv(specimen_class="liver", target_length=0.07)
    depth.reset(seed=4, options={"episode": 0})
    same = dataclasses.replace(trace.with_metadata(named), depth=depth_below(depth.plant.depth, trace.position))
    assert scripts_on_specimen_of(same) == ()
    assert scripts_on_specimen_of(dataclasses.replace(same, blade_x=None, blade_y=None)) != ()


def test_a_record_without_places_is_refused_beside_a_line(path_cut, tmp_path, capsys):
    bare = dataclasses.replace(without(path_cut[1], LINE_KEY), blade_x=None, blade_y=None)
    with pytest.raises(ValueError, match="Record blade_x and blade_y"):
        score(bare, line=straight())
    save(bare, tmp_path / "cut.csv")
    assert command.main([str(tmp_path / "cut.csv"), "--line", "straight", "--out", str(tmp_path)]) == 2
    assert "Record blade_x and blade_y" in capsys.readouterr().err


def test_the_command_scores_beside_a_file_of_places_and_shows_it_on_its_page(path_cut, tmp_path, capsys):
    _, trace, cutting = path_cut
    line = tmp_path / "line.csv"
    rows = [f"{1e3 * x:.4f},{1e3 * y:.4f}" for x, y in places_within(cutting.line)]
    line.write_text("\n".join(["x_mm,y_mm", *rows]), encoding="utf-8")
    save(without(trace, LINE_KEY), tmp_path / "cut.csv")
    assert command.main([str(tmp_path / "cut.csv"), "--line", str(line), "--out", str(tmp_path)]) == 0
    assert "mean_line_distance" in capsys.readouterr().out
    (page,) = tmp_path.glob("*_score.html")
    assert "istance between cut and line" in page.read_text()
    kept = json.loads(page.with_suffix(".json").read_text())
    assert set(MAP_METRICS["path"]) <= set(kept["metrics"])
    (again,) = load(tmp_path / "cut.csv")
    assert again.blade_x.tobytes() == trace.blade_x.tobytes()


def test_a_tracked_blade_without_positions_is_scored_along_the_line(path_cut, tmp_path, capsys):
    _, trace, cutting = path_cut
    rows = [
        f"{t},{f},{1e3 * x},{1e3 * y},{1e3 * d}"
        for t, f, x, y, d in zip(trace.time, trace.force, trace.blade_x, trace.blade_y, trace.depth, strict=True)
    ]
    for name, columns in (("deep", 5), ("flat", 4)):
        header = ["time_s", "force_N", "blade_x_mm", "blade_y_mm", "depth_mm"][:columns]
        lines = [",".join(header), *(",".join(row.split(",")[:columns]) for row in rows)]
        (tmp_path / f"{name}.csv").write_text("\n".join(lines), encoding="utf-8")
    given = ["--line", "excision:110mm:15mm", "--target-length", "70mm", "--out", str(tmp_path)]
    assert command.main([str(tmp_path / "deep.csv"), str(tmp_path / "flat.csv"), *given]) == 0
    kept = {name: json.loads((tmp_path / f"{name}_score.json").read_text()) for name in ("deep", "flat")}
    mean = kept["deep"]["metrics"]["mean_line_distance"]["value"]
    assert mean == pytest.approx(1e-3 * cutting.errors["mean_distance_mm"], abs=0.15e-3)
    assert EXPECTED_CUT in kept["deep"]["notes"]
    assert kept["flat"]["metrics"]["mean_line_distance"]["unavailable"] == "depth was not recorded"
    assert EXPECTED_CUT not in kept["flat"]["notes"], "without depth nobody knows the tip, and so not the cut"


def test_one_record_without_places_stops_the_command_before_the_first_page(path_cut, tmp_path, capsys):
    _, trace, _ = path_cut
    save(trace, tmp_path / "a.csv")
    save(dataclasses.replace(without(trace, LINE_KEY), blade_x=None, blade_y=None), tmp_path / "b.csv")
    before = sorted(tmp_path.iterdir())
    assert command.main([str(tmp_path), "--line", "straight", "--out", str(tmp_path)]) == 2
    assert "no places of the blade in b." in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == before


@pytest.mark.parametrize("places", [[[0, 0], [0.03, 0.002], [0.02, 0.003]], "arc", [[0.0, 0.0]]])
def test_a_record_whose_own_line_is_none_is_refused_by_name(path_cut, places):
    with pytest.raises(ValueError, match=r"^metadata line_m: "):
        score(path_cut[1].with_metadata({**path_cut[1].metadata, LINE_KEY: places}))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x_mm,y_mm\n0,0\n30,2\n20,3\n", "line.csv: The line turns back at (0.02, 0.003) m"),
        ("x_mm,y_mm\n0,0\n30,a\n60,0\n", "line.csv, row 3: '30,a' is no place. Write two numbers."),
        ("x,y\n0,0\n", "line.csv has no column of x with its unit, but x, y. Write x_mm,y_mm on top."),
        ("", "line.csv has no column of x with its unit, but nothing."),
        ("x_cm,y_cm\n0,0\n5,1\n10,4\n", "leaves the slab"),
    ],
)
def test_a_file_that_is_no_line_is_refused_with_the_place(tmp_path, text, says):
    path = tmp_path / "line.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=re.escape(says)):
        read_line(path)


@pytest.mark.parametrize(
    ("given", "says"),
    [
        ("arc", "write straight, arc:40mm, s:40mm, excision:80mm:15mm, or a file"),
        ("arc:5mm", "radius = 0.005"),
        ("excision:80mm", "write straight"),
        ("nowhere.csv", "no such file; write straight"),
        ("bow:80mm", "bow:80mm"),
    ],
)
def test_a_line_that_cannot_be_drawn_is_refused_before_any_work(given, says, tmp_path, capsys):
    assert command.main(["cut.csv", "--line", given, "--out", str(tmp_path)]) == 2
    assert says in capsys.readouterr().err


def test_a_line_in_a_file_is_drawn_through_its_places(tmp_path):
    path = tmp_path / "line.csv"
    path.write_text("x_mm,y_mm\n0,0\n30,4\n60,0\n90,0\n", encoding="utf-8")
    wanted = through([[0.0, 0.0], [0.03, 0.004], [0.06, 0.0], [0.09, 0.0]])
    assert np.array(read_line(path)) == pytest.approx(np.array(wanted))
