"""The page places every part of the scene where Python does, from the one description."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from opened_page import Browser

pytest.importorskip("jinja2", reason="pages are an extra: pip install 'cutenv[view]'")

from cutenv._base.language_files import texts_by_key
from cutenv.display.viewer import Slab, palette
from cutenv.display.viewer.scene import derived_quantities, quantities_of_depth, rest_places, scene_label
from cutenv.display.viewer.scene_parts import PARTS, WORDS
from cutenv.display.viewer.views import tint
from cutenv.people.browser import write_page_alone
from cutenv.sim.quantities import FORCE_ALLOWED
from cutenv.sim.tissue import measured_liver
from cutenv.sim.tissue.grid import depth_below
from cutenv.task.episode import ShownDepth

Array = NDArray[np.float64]

CUT = """(() => {
  const { page, laws, told } = cutenvPage, specimen = told.specimens[%d];
  const cut = page.cut = new HandCut(laws[specimen.task], specimen);
  for (let at = 0; cut.blade < %s && !cut.end; ) cut.advance([[at += 1.2e-5, %s, 0.02 * at]]);
})()"""

PLACES = """(() => {
  const { page: { cut }, drawing: { scene } } = cutenvPage, values = scene.values(cut, { low: -1, high: 8 });
  const moved = scene.displacement(values);
  return { ...values, depth: Array.from(cut.depth), moved: Array.from(moved),
    places: scene.parts.map(part => {
      const left = ["depth", "layer"].includes(part.shown) && !cut.deep;
      return left ? null : scene.places(part, values, moved);
    }),
    deep: cut.deep && [cut.deep.level, ...["surface", "floor", "wanted", "layer"].map(name => [...cut.deep[name]])],
    labels: [WORDS].map(key => scene.label(cutenvPage.told.texts.en[key], values)),
    tint: cutenvPage.drawing.tint(values) };
})()""".replace("[WORDS]", str(list(WORDS)))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("page") / "cut.html"
    write_page_alone(path, count=1, tasks=("gentle", "depth"))
    return path


def moment(told: dict[str, Any]) -> dict[str, Any]:
    """Quantities as Python derives them of what the page's law says of the cut."""
    depth = np.array(told["depth"])
    names = ("blade", "tip", "angle", "hand", "target", "force", "force_limit_per_depth", "half_width")
    given = {name: told[name] for name in names}
    given |= {"force_allowed_per_depth": FORCE_ALLOWED, "chart_low": -1.0, "chart_high": 8.0}
    given["depth_at"] = lambda along: depth_below(depth, along)
    if told["deep"]:
        level, *heights = told["deep"]
        given |= quantities_of_depth(ShownDepth(level, *(np.array(each) for each in heights)))
    return derived_quantities(given)


def differences(told: dict[str, Any]) -> dict[str, float]:
    """Greatest difference of a part's places from Python's [m], in the chart [m, N]."""
    quantities = moment(told)
    slab = Slab(measured_liver().cut_model(), (1, 1))
    moved = np.array(told["moved"]).reshape(slab.rest.shape)
    found = {}
    for part, places in zip(PARTS, told["places"], strict=True):
        if places is None:  # of a depth that this task does not want
            continue
        known, own = rest_places(part, quantities)
        if part.carried:
            known = slab.carried(moved, quantities["tip"], own[:, 0], known)
        assert known.shape == np.shape(places), part.name
        found[part.name] = float(np.abs(known - np.array(places)).max())
    return found


@pytest.mark.parametrize(
    ("specimen", "blade", "angle"),
    [(0, 0.0, 1.5707963), (0, 0.045, 0.8), (1, 0.07, 1.2), (2, 0.02, 1.5707963), (3, 0.03, 1.2)],
)
def test_every_place_of_the_page_is_pythons(page: Browser, specimen: int, blade: float, angle: float) -> None:
    page.value(CUT % (specimen, blade, angle))
    told = page.value(PLACES)
    assert blade == 0.0 or told["lag"] > 1e-4, "nothing is displaced: the test compares too little"
    found = differences(told)
    assert max(found.values()) < 1e-12, max(found, key=lambda name: found[name])
    assert ("wanted floor" in found) == (specimen == 3)
    quantities = moment(told)
    assert told["labels"] == [scene_label(key, quantities) for key in WORDS]
    assert told["tint"] == "rgb({}, {}, {})".format(*tint(told["force"], quantities))


def test_the_field_of_the_page_is_the_finite_element_models(page: Browser) -> None:
    tips = np.linspace(0.002, 0.148, 120).tolist()
    fields = page.value(f"{tips}.map(tip => Array.from(cutenvPage.drawing.scene.displacement({{ tip, lag: 1 }})))")
    slab = Slab(measured_liver().cut_model(), (1, 1))
    exact = np.stack([slab.displacement(tip, 1.0) for tip in tips])
    off = np.abs(np.array(fields).reshape(exact.shape) - exact).max(axis=(1, 2, 3, 4))
    assert off.max() < 0.04
    assert np.median(off) < 0.01


def test_the_page_has_the_colours_and_words_of_the_window(page: Browser) -> None:
    told = page.value("({ texts: cutenvPage.told.texts, scene: cutenvPage.told.scene })")
    assert {name: tuple(colour) for name, colour in told["scene"]["colours"]["light"].items()} == palette.LIGHT
    assert {key: told["texts"]["en"][key] for key in WORDS} == WORDS
    assert set(told["texts"]["de"]) >= set(WORDS)
    assert json.dumps(told["texts"]["en"]) == json.dumps(texts_by_key("en"))
    for part in PARTS:
        assert {part.fill, part.line} <= {"", "tint", *palette.LIGHT}
        assert not part.words or part.words in WORDS
