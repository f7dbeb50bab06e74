"""Score of cuts whose depth is told: by the height of the blade, or by a measured depth beside a wanted one."""

from __future__ import annotations

import csv
import dataclasses
import json
import math

import numpy as np
import pytest
from map_cuts import map_cut, without
from recorded_cut import recorded_cut
from scored_cuts import check_card

from cutenv.commands import score as command
from cutenv.display.report.score_page import ScoredRecord, write_score_page, write_summary
from cutenv.records import load, save
from cutenv.records.measurement import DepthProfile
from cutenv.records.measurement.depth import LAYER_DEPTH_KEY, WANTED_DEPTH_KEY, corners, wanted_depth, with_blade_depth
from cutenv.records.scoring import MAP_METRICS, METRICS, DepthMap, ScoredCut, score
from cutenv.records.scoring.score_card import EXPECTED_FLOOR
from cutenv.records.scoring.truth import FLOOR_AT_END, TIP_AT_END
from cutenv.sim.quantities import LAYER_LIMIT
from cutenv.sim.tissue import measured_liver
from cutenv.sim.tissue.floor import FLOOR_EVERY, BladePath, expected_floor
from cutenv.sim.tissue.grid import N_POINTS, SPACING


@pytest.fixture
def depth_cut():
    return map_cut("depth")


def test_without_what_a_simulator_notes_the_depth_is_near(depth_cut):
    _, trace, _ = depth_cut
    known, told = score(trace), score(without(trace, TIP_AT_END, FLOOR_AT_END))
    assert EXPECTED_FLOOR in told.notes
    assert EXPECTED_FLOOR not in known.notes
    for name in ("mean_depth_error", "rms_depth_error", "largest_depth_error"):
        assert told[name] == pytest.approx(known[name], abs=1e-3)  # the surface is measured to 0.5 mm
    n = min(len(known.depth_map.depth), len(told.depth_map.depth))
    assert np.abs(known.depth_map.depth[:n] - told.depth_map.depth[:n]).mean() < 0.7e-3


def test_a_record_without_height_has_the_card_that_it_had():
    trace = recorded_cut("liver", turns=(0.06,)).trace
    card = score(trace, target_length=0.06)
    assert list(card.metrics) == list(METRICS)
    assert [each.part for each in card.points][-1] == "time"
    assert sum(each.most for each in card.points) == 100.0
    assert with_blade_depth(trace) is trace
    assert "depth" not in json.loads(card.to_json())["metrics"]


def test_depth_measured_along_a_cut_is_compared_with_a_wanted_one():
    trace = recorded_cut("2 cm", turns=(0.06,)).trace  # 2 cm deep everywhere, as a camera may have seen it
    card = score(trace, target_length=0.06, wanted=wanted_depth([[0.0, 0.018]]), layer_depth=0.019)
    assert card["rms_depth_error"] == pytest.approx(0.002, abs=1e-6)
    assert card["largest_depth_error"] == pytest.approx(0.002, abs=1e-6)
    assert card["layer_depth"] == pytest.approx(0.001, abs=1e-6)
    assert card["uncut_area"] == 0.0
    cells = len(card.depth_map.depth)
    assert card["too_deep_area"] == pytest.approx(0.002 * 0.0005 * cells, rel=1e-6)
    assert card["mean_depth_error"] == pytest.approx(card["too_deep_area"] / 0.06)
    assert "vertical force was not recorded" in card.metrics["peak_vertical_force"].unavailable
    check_card(card)


def test_the_better_the_depth_the_more_points_and_only_a_good_one_is_a_success():
    trace = recorded_cut("liver", turns=(0.06, 0.05)).trace
    tip = ScoredCut(trace=trace, target_length=0.06).tip
    target, floor = float(tip[-1]), np.full(int(tip[-1] / 0.0005 + 0.5) + 1, 0.010)
    scores, outcomes = [], []
    for off in (0.0, 0.0005, 0.0014, 0.0016, 0.004):
        noted = without(
            trace, **{FLOOR_AT_END: (floor + off).tolist(), WANTED_DEPTH_KEY: [[0.0, 0.010]], "end": "finished"}
        )
        card = score(noted, target_length=target)
        scores.append(card.overall_score)
        outcomes.append(card.outcome.startswith("success"))
    assert outcomes == [True, True, True, False, False]
    assert scores == sorted(scores, reverse=True)
    assert scores[2] > scores[3] + 5.0


def test_a_layer_opened_beyond_the_limit_is_charged_as_an_end_for_safety(depth_cut):
    trace = depth_cut[1]
    floor = np.array(trace.metadata[FLOOR_AT_END])
    card = score(without(trace, LAYER_DEPTH_KEY), layer_depth=float(floor.max()) - LAYER_LIMIT - 1e-4)
    assert "the layer below is opened by 3.1 mm" in card.outcome
    shares = {each.part: each.points / each.most for each in card.points}
    assert shares["limits"] == shares["success"] == shares["tissue"] == 0.0 < shares["way"] < math.exp(-1.8)
    as_wanted = corners(np.arange(len(floor)) * SPACING, floor)
    nearer = score(
        without(trace, LAYER_DEPTH_KEY, **{WANTED_DEPTH_KEY: as_wanted}), layer_depth=float(floor.max()) - 0.001
    )
    assert "opened by 1.0 mm, more than 0.5 mm" in nearer.outcome or "short of the target" in nearer.outcome
    assert nearer.points[0].points > 0.0


def test_the_clock_may_start_anywhere(depth_cut):
    trace = without(depth_cut[1], FLOOR_AT_END, TIP_AT_END)
    later = dataclasses.replace(trace, time=trace.time + 77.7)
    before, after = score(trace), score(later)
    for name, each in MAP_METRICS["depth"].items():
        assert "time_shift" in each.invariances
        assert before.metrics[name].value == pytest.approx(after.metrics[name].value, rel=1e-6, abs=1e-9)


def test_what_is_missing_is_told(depth_cut):
    trace = without(depth_cut[1], WANTED_DEPTH_KEY, LAYER_DEPTH_KEY)
    card = score(trace)
    assert "no wanted depth" in card.metrics["uncut_area"].unavailable
    assert "no depth of a layer below" in card.metrics["layer_depth"].unavailable
    assert "depth" not in [each.part for each in card.points]
    check_card(card)
    bare = dataclasses.replace(trace, depth=None)
    assert score(bare).overall_score is None
    check_card(score(bare))


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ("8mm", "no list of pairs"),
        ([], "no list of pairs"),
        ([[0.0, 0.01, 3.0]], "no list of pairs"),
        ([[0.0, 8.0]], "8 mm is 0.008"),
        ([[0.05, 0.01], [0.0, 0.01]], "must increase"),
        ([[0.0, float("nan")]], "depth"),
    ],
)
def test_a_bad_wanted_depth_is_refused(points, message):
    with pytest.raises(ValueError, match=message):
        wanted_depth(points)


def test_corners_give_a_wanted_depth_back():
    grid = np.arange(301) * 0.0005
    for depth in (np.full(301, 0.01), np.linspace(0.006, 0.014, 301), np.interp(grid, [0.04, 0.042], [0.006, 0.012])):
        pairs = corners(grid, depth)
        assert len(pairs) <= 4
        np.testing.assert_allclose(wanted_depth(pairs).at(grid), depth, atol=1e-12)


def test_a_blade_at_one_height_leaves_a_floor_at_that_height():
    x = np.linspace(0.0, 0.05, 501)
    surface = np.linspace(0.008, 0.012, N_POINTS)
    depth, engaged = expected_floor(
        measured_liver(), surface, BladePath(x, np.full(501, 0.002), np.maximum(x - 0.004, 0.0))
    )
    np.testing.assert_allclose(depth[1:], surface[1 : len(depth)] - 0.002, atol=1e-12)
    assert (engaged == 0.002).all()


def test_a_blade_that_dips_opens_no_more_than_it_reached_and_none_where_it_was_not():
    time = np.arange(0.0, 8.0, FLOOR_EVERY)
    x = 0.005 * time
    height = -0.002 * np.exp(-(((x - 0.02) / 0.003) ** 2))
    depth, _ = expected_floor(
        measured_liver(), np.full(N_POINTS, 0.010), BladePath(x, height, np.maximum(x - 0.004, 0.0))
    )
    assert 0.0115 < depth.max() < 0.0120 + 1e-9
    np.testing.assert_allclose(depth[:10], 0.010, atol=1e-4)


def test_page_csv_and_command_tell_the_depth(depth_cut, tmp_path, capsys):
    trace = without(depth_cut[1], TIP_AT_END, FLOOR_AT_END, LAYER_DEPTH_KEY, name="stepped")
    card = score(trace)
    scored = ScoredRecord(trace=trace, card=card, target_length=0.06)
    data = write_score_page(tmp_path / "one.html", scored)
    page = (tmp_path / "one.html").read_text()
    assert "uncut area" in page
    assert "wanted depth" in page
    told = json.loads(data.read_text())["metrics"]["uncut_area"]
    assert told["unit"] == "m2"
    assert told["value"] == card["uncut_area"]
    plain = recorded_cut("liver", turns=(0.06,)).trace
    other = ScoredRecord(trace=plain, card=score(plain, target_length=0.06), target_length=0.06)
    table, _ = write_summary(tmp_path, [(scored, "one.html"), (other, "two.html")])
    first, second = csv.DictReader(table.open())
    assert float(first["uncut_area_m2"]) == pytest.approx(card["uncut_area"], rel=1e-4)
    assert second["uncut_area_m2"] == ""

    save(trace, tmp_path / "cut.csv")
    (read,) = load(tmp_path / "cut.csv")
    assert read.metadata[WANTED_DEPTH_KEY] == trace.metadata[WANTED_DEPTH_KEY]
    options = [str(tmp_path / "cut.csv"), "--out", str(tmp_path), "--wanted-depth", "0mm:6mm,60mm:14mm"]
    assert command.main([*options, "--layer-depth", "12mm"]) == 0
    said = capsys.readouterr().out
    assert "mean_depth_error" in said
    assert " mm2" in said
    ramp = score(trace, wanted=DepthProfile(position=np.array([0.0, 0.06]), depth=np.array([0.006, 0.014])))
    assert f"{1e3 * ramp['mean_depth_error']:.4g} mm" in said


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("--wanted-depth", "8", "no length with a unit"),
        ("--wanted-depth", "0mm:6mm,14mm", "is no POSITION:DEPTH"),
        ("--wanted-depth", "80mm:6mm,0mm:7mm", "must increase"),
        ("--layer-depth", "12m", "12 m"),
    ],
)
def test_a_bad_option_is_refused_before_anything_is_read(option, value, message, capsys):
    assert command.main(["nowhere.csv", option, value]) == 2
    assert message in capsys.readouterr().err


def test_a_map_without_a_wanted_depth_has_no_error():
    found = DepthMap(depth=np.array([0.01, 0.012]), layer=0.011)
    np.testing.assert_allclose(found.opened, [0.0, 0.001])
    with pytest.raises(ValueError, match="no wanted depth"):
        _ = found.deep
