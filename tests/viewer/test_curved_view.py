"""3-D view of a slab with cuts along any curve: its surfaces, and the page."""

from __future__ import annotations

import json
import math
import re
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from cutenv.plant import FreehandPlant
from cutenv.tissue import Specimen
from cutenv.viewer.solid import write_curved_view
from cutenv.viewer.solid.curved_solid import OPENING, CurvedSolid
from cutenv.viewer.solid.curved_view import curved_page


@cache
def plant() -> FreehandPlant:
    found = FreehandPlant(Specimen.drawn(0))
    for _ in range(150):
        found.advance(0.012, math.radians(80.0), 20, 0.25)
    return found


def test_the_solid_is_closed_but_for_its_cuts() -> None:
    solid = CurvedSolid(plant())
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
    solid = CurvedSolid(plant())
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
    assert write_curved_view(page, plant(), title="A cut & more") == page.stat().st_size
    text = page.read_text(encoding="utf-8")
    assert "A cut &amp; more" in text
    found = re.search(r'<script type="text/plain" id="told">(.*?)</script>', text, re.DOTALL)
    assert found is not None
    told = json.loads(found[1])
    assert told["scalpel_rad"][1] == pytest.approx(plant().heading)
    assert len(told["commands"]) > 8
    assert not re.search(r'(src|href)="(http|//)', text)
    assert curved_page(plant(), title="A cut & more") == text


def test_nothing_cut_is_nothing_to_show(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not left the clamp"):
        write_curved_view(tmp_path / "cut.html", FreehandPlant(Specimen.drawn(0)))
