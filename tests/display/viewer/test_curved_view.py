"""3-D view of a slab with cuts along any curve: its surfaces, and the page."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cutenv.display.viewer.solid import CurvedCut, write_curved_view
from cutenv.display.viewer.solid.curved_cut import OPENING, CurvedSolid
from cutenv.display.viewer.solid.view_page import curved_page
from cutenv.people.play.played_cut import PlayedPathCut
from cutenv.records.scoring.cut_map import LINE_KEY, PathMap
from cutenv.records.scoring.truth import ASIDE_AT_END
from cutenv.sim.plant import FreehandPlant
from cutenv.sim.tissue import Specimen
from cutenv.sim.tissue.lines import through
from cutenv.sim.trace import Trace


@cache
def plant() -> FreehandPlant:
    found = FreehandPlant(Specimen.drawn(0))
    for _ in range(150):
        found.advance(0.012, math.radians(80.0), 20, 0.25)
    return found


def test_the_solid_is_closed_but_for_its_cuts() -> None:
    solid = CurvedSolid(CurvedCut.of_plant(plant()))
    edges: dict[tuple[tuple[float, ...], ...], int] = {}
    for surface in solid.skins.values():
        for face in surface.faces:
            points = [tuple(np.round(surface.vertices[k], 8) + 0.0) for k in face]
            for k in range(3):
                one, other = points[k], points[(k + 1) % 3]
                edges[one, other] = edges.get((one, other), 0) + 1
    balance: dict[tuple[tuple[float, ...], ...], int] = {}
    for (one, other), count in edges.items():
        key = (one, other) if one < other else (other, one)
        balance[key] = balance.get(key, 0) + count
    assert min(balance.values()) == 2  # nowhere does a surface end


def test_faces_of_the_cut_are_where_the_crack_went() -> None:
    solid = CurvedSolid(CurvedCut.of_plant(plant()))
    faces = solid.skins["faces"]
    assert len(faces.faces) == 4 * (len(plant().cut) - 1)  # two triangles on either side of each piece
    upper = faces.vertices[faces.vertices[:, 2] > 0.0]
    assert upper[:, 1].max() < 0.05
    assert np.ptp(upper[:, 0]) > OPENING


def test_the_tip_is_drawn_at_the_blade() -> None:
    lag = np.subtract(plant().blade, plant().tip)
    at_rest, moved = plant().model.outlines(), plant().displaced()
    tip = plant().model.tip
    shifts = [
        each - place
        for rest, now in zip(at_rest, moved, strict=True)
        for place, each in zip(rest, now, strict=True)
        if math.dist(place, tip) < 1e-9
    ]
    assert shifts
    for shift in shifts:
        assert shift == pytest.approx(lag, abs=1e-9)


def test_the_page_is_one_file_that_holds_its_scene(tmp_path: Path) -> None:
    page = tmp_path / "cut.html"
    assert write_curved_view(page, CurvedCut.of_plant(plant(), "A cut & more")) == page.stat().st_size
    text = page.read_text(encoding="utf-8")
    assert "A cut &amp; more" in text
    found = re.search(r'<script type="text/plain" id="told">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    told = json.loads(found[1])
    assert told["scalpel_rad"][1] == pytest.approx(plant().heading)
    assert len(told["commands"]) > 8
    assert not re.search(r'(src|href)="(http|//)', text)
    assert curved_page(CurvedCut.of_plant(plant(), "A cut & more")) == text


def test_nothing_cut_is_nothing_to_show() -> None:
    with pytest.raises(ValueError, match="not left the clamp"):
        CurvedCut.of_plant(FreehandPlant(Specimen.drawn(0)))


@cache
def played() -> Trace:
    cut = PlayedPathCut(line="excision", seed=3)
    hand = cut.simple_hand()
    while not cut.end:
        cut.tick(hand.read())
    return cut.trace(name="An excision", end=cut.end)


def test_a_record_in_the_plane_is_drawn_with_its_cut_and_its_line(tmp_path: Path) -> None:
    cut = CurvedCut.of_record(played())
    line = through(played().metadata[LINE_KEY])
    aside = np.array(played().metadata[ASIDE_AT_END])
    true = PathMap(line=line, aside=aside).place
    hardly_moved = [rest + 0.001 * (moved - rest) for rest, moved in zip(cut.rest, cut.moved, strict=True)]
    faces = CurvedSolid(dataclasses.replace(cut, moved=hardly_moved)).skins["faces"].vertices
    drawn = np.column_stack((faces[:, 1], -faces[:, 0]))
    distances = np.min(np.hypot(*(drawn[:, None] - true).transpose(2, 0, 1)), axis=1)
    assert distances.max() < 0.0005
    assert drawn[:, 0].max() == pytest.approx(true[-1, 0], abs=0.006)  # an element
    assert cut.line is not None
    assert cut.line == pytest.approx(np.column_stack((line.x, line.y)))
    write_curved_view(tmp_path / "cut.html", cut)
    assert "An excision" in (tmp_path / "cut.html").read_text(encoding="utf-8")


def test_without_its_notes_the_cut_is_expected_behind_the_blade() -> None:
    notes = {key: value for key, value in played().metadata.items() if key not in (LINE_KEY, ASIDE_AT_END)}
    bare = dataclasses.replace(played(), metadata=notes)
    expected, true = CurvedCut.of_record(bare), CurvedCut.of_record(played())
    assert expected.line is None
    ends = [np.vstack(each.moved)[:, 1] for each in (expected, true)]
    assert np.abs(ends[0]).max() == pytest.approx(np.abs(ends[1]).max(), rel=0.05)
    along = CurvedCut.of_record(bare, line=through(played().metadata[LINE_KEY]))
    assert along.heading == pytest.approx(true.heading, abs=0.2)


def test_a_record_without_depth_is_refused() -> None:
    with pytest.raises(ValueError, match="blade_x, blade_y"):
        CurvedCut.of_record(dataclasses.replace(played(), depth=None))
