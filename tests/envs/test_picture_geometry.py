"""Geometry and words of the picture of a cut; nothing here draws, so that nothing here needs pygame."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from cutenv.display.viewer import ForceTrace, Layout, Moment, Slab, palette
from cutenv.display.viewer.drawn_slab import HALF_GAP
from cutenv.display.viewer.scene import derived_quantities, rest_places
from cutenv.display.viewer.scene_parts import PARTS, SceneFormula, blade_edge
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.sim.cutting.dtypes import READING
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.grid import depth_below
from cutenv.task.reward import ENDS

LAYOUT = Layout()


@pytest.fixture
def env() -> GentleCutEnv:
    env = GentleCutEnv(specimen_class="uniform", target_length=0.08)
    env.reset(seed=3)
    return env


def advance(env: GentleCutEnv, steps: int, speed: float = 0.55, angle: float = 1.0) -> None:
    for _ in range(steps):
        env.step(np.array([speed, angle], np.float32))


PART = {part.name: part for part in PARTS}


def quantities(depth: float = 0.018, **values: float) -> dict[str, Any]:
    """Those of a moment, in tissue of even depth."""
    moment = {"blade": 0.06, "tip": 0.06, "angle": math.pi / 2, "target": 0.08, "hand": 0.06, "half_width": 0.04}
    return derived_quantities(moment | values | {"depth_at": lambda along: depth + 0.0 * along})


def places(name: str, **values: float) -> NDArray[np.float64]:
    return rest_places(PART[name], quantities(**values))[0]


def carried(slab: Slab, displacement: NDArray[np.float64], name: str, **values: float) -> NDArray[np.float64]:
    at_rest, own = rest_places(PART[name], quantities(**values))
    return slab.carried(displacement, values.get("tip", 0.06), own[:, 0], at_rest)


# The slab


@pytest.fixture(scope="module")
def slab() -> Slab:
    return Slab(CutModel())


def line(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Of values on the lattice, those on the cut line along it, left face."""
    return values[0, -1, :, 1]


def check_carries_the_tip(slab: Slab, displacement: NDArray[np.float64], tip: float, lag: float) -> None:
    """The clamp holds, the tip moves with the blade, and no place moves much further."""
    along = line(slab.rest)
    assert np.abs(displacement[:, :, 0]).max() == 0.0
    assert np.interp(tip, along, line(displacement)) == pytest.approx(lag, rel=1e-9)
    # Between corners the tip's neighbours move a little more than the straight line between them.
    assert np.abs(displacement).max() <= 1.2 * lag


@pytest.mark.parametrize("tip", [0.02, 0.05, 0.0537, 0.1])
def test_the_slab_is_carried_by_its_tip(slab: Slab, tip: float) -> None:
    check_carries_the_tip(slab, slab.displacement(tip, 0.006), tip, 0.006)


def test_the_lattice_moves_as_the_nodes_of_the_finite_element_model(slab: Slab) -> None:
    model, tip, lag = slab.model, 0.05, 0.004
    modulus, thickness = 48e3, 0.018
    nodal = model.displacement(tip, model.stiffness(tip) * modulus * thickness * lag, modulus, thickness)
    lattice = slab.displacement(tip, lag).reshape(-1, 2)
    places = slab.rest.reshape(-1, 2)
    for corner in np.unique(model.elements):
        nearest = np.hypot(*(places - model.nodes[corner]).T) < 1e-9
        assert nearest.any()
        assert np.allclose(lattice[nearest], nodal[corner], atol=1e-12)


def test_a_loaded_slab_differs_from_one_at_rest_and_an_unloaded_does_not(env: GentleCutEnv) -> None:
    slab = Slab(env.specimen.cut_model())
    advance(env, 150)
    loaded = Moment.of(env.plant, env.cutting)
    assert loaded.lag > 1e-3
    assert np.abs(slab.displacement(loaded.tip, loaded.lag)).max() >= loaded.lag * 0.99
    advance(env, 60, speed=-0.5)
    unloaded = Moment.of(env.plant, env.cutting)
    assert unloaded.lag == 0.0
    assert np.abs(slab.displacement(unloaded.tip, unloaded.lag)).max() == 0.0


def test_the_target_line_moves_with_the_tissue_on_which_it_is_marked(slab: Slab) -> None:
    at_rest = slab.line_across(np.zeros_like(slab.rest), 0.0725)
    assert np.allclose(at_rest[:, 1], 0.0725, atol=1e-15)
    assert at_rest[:, 0].min() == pytest.approx(-0.04)
    displacement = slab.displacement(0.0725, 0.005)
    carried = slab.line_across(displacement, 0.0725)
    middle = np.abs(at_rest[:, 0]) < 1e-12
    assert np.allclose(carried[middle, 1], 0.0775, atol=1e-9)
    assert carried[:, 1].min() > 0.0725


def test_the_cut_is_drawn_open_between_clamp_and_tip_only(slab: Slab) -> None:
    tip, lag = 0.0537, 0.004
    outline = carried(slab, slab.displacement(tip, lag), "open cut", tip=tip)
    assert outline[:, 1].min() == pytest.approx(0.0, abs=1e-12)
    assert outline[:, 1].max() == pytest.approx(tip + lag, rel=1e-9)
    assert np.abs(outline[:, 0]).max() < 0.003
    assert HALF_GAP({"along": np.array([0.0, tip, tip + 0.01]), "tip": tip}).tolist() == [0.0, 0.0, 0.0]
    ahead = slab.rest[0, :, :, 1] >= tip
    opened = slab.opened(slab.rest, tip)
    assert np.array_equal(opened[:, ahead], slab.rest[:, ahead])


def test_an_element_of_any_kind_can_be_drawn() -> None:
    for model in (
        CutModel(element="quad4", divisions=(4, 10)),
        CutModel(element="hex20", formulation="solid", divisions=(2, 4, 1)),
    ):
        slab = Slab(model)
        tip = float(model.tips[1])
        assert np.ptp(slab.rest[..., 0]) == pytest.approx(model.width)
        assert np.ptp(slab.rest[..., 1]) == pytest.approx(model.length)
        check_carries_the_tip(slab, slab.displacement(tip, 0.003), tip, 0.003)


# The blade


@pytest.mark.parametrize("degrees", [45.0, 60.0, 90.0])
@pytest.mark.parametrize("depth", [0.004, 0.018])
def test_the_edge_leans_at_its_angle_through_its_place_at_the_surface(degrees: float, depth: float) -> None:
    """The edge is straight and as inclined as the blade above its belly, and cuts the surface at the blade's place."""
    angle = math.radians(degrees)
    outline, blade = places("blade", angle=angle, depth=depth), 0.06
    edge = outline[: len(blade_edge())].copy()
    edge[-1] += edge[-1] - edge[-2]  # prolonged beyond where the blade narrows
    assert edge[:, 1].min() == pytest.approx(0.0, abs=1e-5)  # between two points of the belly
    (along, height), (above, top) = edge[-2:]
    assert math.atan2(top - height, above - along) == pytest.approx(angle, abs=1e-9)
    lowest = int(edge[:, 1].argmin())
    assert np.interp(depth, edge[lowest:, 1], edge[lowest:, 0]) == pytest.approx(blade, abs=1e-5)


def test_the_cut_front_stands_at_the_tip_and_leaves_the_wedge() -> None:
    front = places("cut part", angle=math.radians(45))
    assert front[150].tolist() == pytest.approx([0.06, 0.018])
    assert front[151].tolist() == pytest.approx([0.06 - 0.018, 0.0])
    assert places("cut part", angle=math.radians(45), tip=0.0)[:, 0].max() == 0.0


def test_from_above_only_an_inclined_blade_stands_out_over_uncut_tissue() -> None:
    for degrees, ahead in ((90.0, False), (45.0, True)):
        values = {"angle": math.radians(degrees), "depth": 0.01}
        assert places("blade from above", **values)[:, 1].max() == pytest.approx(0.06)
        assert bool(places("blade above the tissue", **values)[:, 1].max() > 0.061) is ahead


@pytest.mark.parametrize("text", ["blade ** 2", "[blade]", "blade if tip else 0", "'blade'", "__import__('os').name"])
def test_a_formula_of_anything_else_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="formula = "):
        SceneFormula(text)


# Force, numbers and words


def felt(time: float, force: NDArray[np.float64]) -> NDArray[np.void]:
    readings = np.zeros(len(force), READING)
    readings["time"] = time + 1e-3 * np.arange(len(force))
    readings["position"] = 0.01 * readings["time"]
    readings["force"] = force
    return readings


def check_shows_peak(points: NDArray[np.float64], peak: float) -> None:
    assert points[:, 1].max() == peak


def test_the_trace_keeps_a_peak_of_one_millisecond() -> None:
    trace = ForceTrace()
    force = np.full(1000, 2.0)
    force[487] = 5.0
    trace.add(felt(0.001, force))
    check_shows_peak(trace.whole(), 5.0)
    assert len(trace.whole()) < 200
    force = np.full(1000, 2.0)
    force[487] = 5.0
    means = force.reshape(-1, 20).mean(axis=1)
    with pytest.raises(AssertionError):
        check_shows_peak(np.stack([means, means], axis=-1), 5.0)


def test_the_trace_adds_a_step_once_and_joins_it_to_the_last() -> None:
    trace = ForceTrace()
    first, second = felt(0.001, np.linspace(0.0, 1.0, 20)), felt(0.021, np.linspace(1.0, 2.0, 20))
    assert trace.add(first)
    count = len(trace.whole())
    assert not trace.add(first)
    assert len(trace.whole()) == count
    assert trace.add(second)
    assert trace.latest()[0].tolist() == trace.whole()[count - 1].tolist()
    assert trace.whole()[-1, 1] == 2.0


def test_the_chart_grows_with_the_force_and_never_cuts_it_off() -> None:
    trace = ForceTrace()
    trace.add(felt(0.001, np.array([0.0, 3.0])))
    at_first = trace.low, trace.high
    trace.add(felt(0.1, np.array([3.0, 17.3, -2.2])))
    assert trace.low < at_first[0]
    assert trace.high > at_first[1]
    assert trace.low < -2.2
    assert trace.high > 17.3
    pixels = LAYOUT.place("chart", trace.whole(), trace.range)
    assert pixels[:, 1].min() > LAYOUT.chart_top
    assert pixels[:, 1].max() < LAYOUT.chart_bottom


def test_a_moment_tells_what_the_rig_and_the_truth_know(env: GentleCutEnv) -> None:
    advance(env, 120, angle=0.0)
    moment = Moment.of(env.plant, env.cutting)
    assert env.cutting.readings is not None
    last = env.cutting.readings[-1]
    assert (moment.blade, moment.tip) == (last["position"], last["tip"])
    assert moment.force == last["force"]
    assert moment.lag == pytest.approx(last["position"] - last["tip"])
    assert math.degrees(moment.angle) == pytest.approx(67.5)
    assert moment.target == 0.08
    assert moment.force_limit_per_depth == 1000.0
    assert depth_below(moment.depth, moment.blade) == pytest.approx(env.specimen.tissue.mean_depth)


@pytest.mark.parametrize("end", ENDS)
@pytest.mark.parametrize("success", [False, True])
def test_every_end_is_put_in_words(env: GentleCutEnv, end: str, success: bool) -> None:
    moment = dataclasses.replace(Moment.of(env.plant, env.cutting), end=end, success=success)
    assert ("success" in moment.verdict) is (success and end == "finished")
    assert bool(moment.verdict) is bool(end)
    assert "_" not in moment.verdict


def test_a_finished_failure_says_what_was_missed(env: GentleCutEnv) -> None:
    moment = dataclasses.replace(Moment.of(env.plant, env.cutting), end="finished")
    assert dataclasses.replace(moment, tip=0.0755).verdict == "finished: tip 4.5 mm off target"
    upright = dataclasses.replace(moment, tip=0.0801, angle=math.radians(60))
    assert upright.verdict == "finished: blade at 60°, not upright"


# Colours

# Viénot, Brettel & Mollon (1999), linear RGB.
DICHROMATS = {
    "protanopia": np.array([[0.11238, 0.88762, 0.0], [0.11238, 0.88762, 0.0], [0.00401, -0.00401, 1.0]]),
    "deuteranopia": np.array([[0.29275, 0.70725, 0.0], [0.29275, 0.70725, 0.0], [-0.02234, 0.02234, 1.0]]),
}


@pytest.mark.parametrize("sight", DICHROMATS)
@pytest.mark.parametrize(
    "pair", [("GAIN", "LOSS"), ("SUCCESS", "FAILURE"), ("TARGET", "LIMIT"), ("TARGET", "FORCE"), ("LIMIT", "FORCE")]
)
def test_colours_that_mean_something_are_told_apart_without_red_or_green(pair: tuple[str, str], sight: str) -> None:
    """Two colours differ for a dichromat: by 30 in CIE L*a*b*, where 2 is just noticed."""
    first, second = getattr(palette, pair[0]), getattr(palette, pair[1])
    rgb = (np.array([first, second]) / 255) ** 2.2 @ DICHROMATS[sight].T
    to_xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
    x, y, z = np.cbrt((np.clip(rgb, 0, 1) @ to_xyz.T) / [0.9505, 1.0, 1.089]).T
    lab = np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)
    assert np.linalg.norm(lab[0] - lab[1]) > 30


def test_a_blade_that_descends_is_drawn_as_deep_as_it_is() -> None:
    level, lower = (places("blade", level=height)[:, 1] for height in (0.0, -0.004))
    assert lower.min() == pytest.approx(level.min() - 0.004)
    deeper = quantities(level=-0.004)
    assert deeper["engaged"] == pytest.approx(0.022)


def test_the_cut_part_ends_at_the_floor_of_the_cut() -> None:
    values = quantities() | {"floor_at": lambda along: 0.003 + 0.0 * along}
    lower = rest_places(PART["cut part"], derived_quantities(values))[0][151:]
    assert lower[:, 1] == pytest.approx(np.full(151, 0.003))


def test_wanted_floor_and_layer_of_a_cut_are_where_the_task_has_them() -> None:
    env = DepthCutEnv(wanted="step", target_length=0.08)
    env.reset(seed=3)
    moment = Moment.of(env.plant, env.cutting)
    assert moment.conditions == ("depth",)
    scene, at = moment.quantities(), 0.03
    surface = float(np.interp(at, np.arange(301) * 5e-4, env.cutting.motion["surface"][0]))
    wanted = float(np.interp(at, np.arange(301) * 5e-4, env.cutting.whole["wanted"][0]))
    assert scene["wanted_at"](at) == pytest.approx(surface - wanted)
    assert scene["layer_at"](at) == pytest.approx(surface - env.cutting.motion["boundary"][0])
    assert scene["limited_at"](at) == pytest.approx(wanted)


def test_a_slab_displaced_for_another_tip_is_noticed(slab: Slab) -> None:
    with pytest.raises(AssertionError):
        check_carries_the_tip(slab, slab.displacement(0.07, 0.006), 0.05, 0.006)
