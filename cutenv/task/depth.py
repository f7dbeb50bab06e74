"""The task of ``cutenv/DepthCut-v1``.

Cut along a wanted depth, without opening the layer below.

A rig sees neither tip nor floor.  The tip is estimated from the force, with the stiffness of the mean tissue at the
depth to which the blade is engaged; the floor is that which the mean tissue would have under this blade
(:func:`cutenv.sim.tissue.floor.follow_floor`).  No layer below is known, and none is charged.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, Array32, Struct, StructArray
from cutenv._base.validation import check_parameters, one_of, parameter, taken_from
from cutenv._engine.elementary import exp, log
from cutenv._engine.intrinsics import prefetch
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv._engine.randomness import TASK, VERTICAL_NOISE, WANTED_DRAW, Integer, normal_at, uniform_at
from cutenv.sim.cutting.descent import (
    DESCENDING,
    DESCENT,
    DescentParameters,
    descent_records,
    held_depth,
    renew,
    shared_record,
)
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.cutting.law import grid_index, lerp
from cutenv.sim.quantities import (
    DEPTH_COSTS,
    DEPTH_TOLERANCE,
    LAYER_LIMIT,
    LAYER_TOLERANCE,
    OF_MAP,
    into_layer,
    left_uncut,
    too_deep,
)
from cutenv.sim.tissue.crack_tip import ESTIMATED_EVERY
from cutenv.sim.tissue.description import TissueDescription
from cutenv.sim.tissue.floor import FLOOR_EVERY, follow_floor
from cutenv.sim.tissue.grid import N_POINTS, POINTS_PER_METRE, SPACING
from cutenv.sim.tissue.layers import Layers
from cutenv.sim.tissue.slab import cut_through
from cutenv.sim.tissue.specimen import Specimen, SurfaceSpread, nominal_stiffness
from cutenv.task.declare import (
    WAYS,
    ActionAxis,
    CutNumber,
    Cuts,
    Stepping,
    Task,
    delayed,
    in_steps,
    observer,
    settings_record,
    whole_fields,
)
from cutenv.task.episode import Episode, Goal, ShownDepth, TaskOptions
from cutenv.task.observation import COMPONENTS, SPEED_SCALE, Component, speed_action, to_action
from cutenv.task.reward import with_weights

# Kinds of wanted depth: the specimen's own profile (a blade that stays at level 0), or a depth below the surface.
AT_LEVEL, UNCHANGING, RAMPED, STEPPED, MIXED_WANTED = range(5)
WANTED_KINDS = {"profile": AT_LEVEL, "constant": UNCHANGING, "ramp": RAMPED, "step": STEPPED, "mixed": MIXED_WANTED}
"""Kinds by name; "mixed" draws one of constant, ramp and step."""
SHALLOW, DEEP = 0.006, 0.014  # range from which wanted depths are drawn [m]
LEAST_CHANGE = 0.003  # least difference between the two depths of a ramp or a step [m]
STEP_LENGTH = 0.002  # length along the cut within which a step changes [m]: a blade takes time to descend
LEAST_BELOW, MOST_BELOW = 0.001, 0.004  # range of the distance from the deepest wanted place to the layer below [m]
TOUGHNESS_RANGE = (0.3, 4.0)  # range of that layer's toughness over the tissue's, drawn by its logarithm; assumed
MODULUS_RANGE = (0.3, 3.0)  # range of that layer's modulus over the tissue's, drawn by its logarithm; assumed

DESCENT_SCALE = 0.010  # speed downwards of descent action 1 [m/s]
LOOK_AHEAD = (0.005, 0.010, 0.020)  # distances ahead of the blade at which the wanted depth is observed [m]

# Components of the observation that follow the 12 of gentle cutting, in order.
DEPTH_COMPONENTS = (
    Component(name="vertical", meaning="vertical force now, upwards", unit="N", scale=5.0),
    Component(name="vertical_mean", meaning="its mean since the last decision", unit="N", scale=5.0),
    Component(name="vertical_max", meaning="its maximum since the last decision", unit="N", scale=5.0),
    Component(
        name="blade_depth", meaning="blade's lower end below the surface, as measured beforehand", unit="m", scale=0.02
    ),
    Component(name="descent_speed", meaning="of the blade, downwards", unit="m/s", scale=DESCENT_SCALE),
    Component(name="wanted", meaning="wanted depth at the blade", unit="m", scale=0.02),
    Component(name="wanted_near", meaning="5 mm further", unit="m", scale=0.02),
    Component(name="wanted_further", meaning="10 mm further", unit="m", scale=0.02),
    Component(name="wanted_far", meaning="20 mm further", unit="m", scale=0.02),
    Component(name="last_descent", meaning="last action: descent", unit="1", scale=1.0),
)


@with_weights(DEPTH_COSTS)
@dataclass(frozen=True, kw_only=True)
class DepthConstants:
    """Weights of the depth's costs, limit of the layer, sensor of the vertical force."""

    layer_limit: float = parameter(
        LAYER_LIMIT, unit="m", low=0.0001, high=0.03, provenance="choice",
        source="depth into the layer below at which a cut ends for safety", sensitivity=(0.001, 0.005),
    )  # fmt: skip
    vertical_noise: float = parameter(
        0.02, unit="N", low=0.0, high=10.0, provenance="assumed", source="as along the cut", sensitivity=(0.0, 0.1),
    )  # fmt: skip
    vertical_resolution: float = parameter(
        0.05, unit="N", low=0.0, high=10.0, provenance="assumed", source="as along the cut", sensitivity=(0.0, 0.1),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)


# Record of a cut's wanted depth, and of its floor so far, by which its depth is assessed.
DEPTH: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            *((name, "f8") for name in DepthConstants.__dataclass_fields__),
            ("level_wanted", "i8"),  # 1: the wanted depth is the specimen's own profile, level 0 of the blade
            ("wanted", "f8", (N_POINTS,)),  # depth below the surface [m]
            ("counted", "f8", (N_POINTS,)),  # depth of the floor as it is in the sums below [m]; -1: not yet
            ("deep", "f8"),  # sums over the floor, see OF_MAP
            ("uncut", "f8"),
            ("layer", "f8"),
            ("deepest", "f8"),
            ("counts", "i8"),  # number of points in the sums
            ("begun", "f8"),  # length that was cut at the start [m]
            *whole_fields(DEPTH_COSTS),
        ],
    )
)

RESPONSE = round(FLOOR_EVERY / TICK)  # milliseconds between two responses of the expected floor
# Record of the vertical motion that a rig expects, with the levels of the last readings [m].
EXPECTED: np.dtype[Any] = np.dtype(
    (np.record, [("levels", "f8", (RESPONSE + 1,)), *((name, DESCENT[name]) for name in DESCENT.names or ())])
)
_EVERY = round(ESTIMATED_EVERY / TICK)
_AHEAD = 3  # cells ahead of the blade that it may reach until the tip is estimated again
_NORMALS = 4  # random numbers of a decision
_DEPTH = [one.name for one in COMPONENTS].index("depth")
_DEPTH_SCALE = COMPONENTS[_DEPTH].scale
_HEIGHT, _VERTICAL = 0, 4  # places of the measurements of a rig

_fill = observer(DEPTH_COMPONENTS, [__name__])


@njit_internal
def survey_floor(depth: Struct, descent: Struct, low: float) -> None:
    """Update sums over the floor from ``low`` [m] to the tip."""
    for i in range(min(max(int(low * POINTS_PER_METRE) - 1, 0), depth.counts), descent.cell + 1):
        now, before, wanted = descent.surface[i] - descent.floor[i], depth.counted[i], depth.wanted[i]
        if now == before:
            continue
        depth.deep += SPACING * too_deep(now, wanted)
        depth.uncut += SPACING * left_uncut(now, wanted)
        depth.layer += SPACING * into_layer(now, descent.boundary)
        if before >= 0.0:
            depth.deep -= SPACING * too_deep(before, wanted)
            depth.uncut -= SPACING * left_uncut(before, wanted)
            depth.layer -= SPACING * into_layer(before, descent.boundary)
        depth.deepest = max(depth.deepest, now - descent.boundary)
        depth.counted[i] = now
    depth.counts = max(depth.counts, descent.cell + 1)


@njit_inline
def survey(depth: Struct, descent: Struct, step: Struct, k: Integer, tip: float) -> None:
    """Update the floor's sums from where the edge was this step."""
    survey_floor(depth, descent, step.reached[k] - descent.edge_length)


@njit_inline
def begin_step(step: Struct, k: Integer, place: float) -> None:
    """Prepare lane ``k``'s step, with the edge's leading end at ``place``."""
    step.reached[k], step.updates[k] = place, 0.0
    step.vertical_sum[k], step.vertical_max[k] = 0.0, -math.inf


@njit_inline
def count(step: Struct, k: Integer, place: float, tip: float, vertical: float) -> None:
    """Count a millisecond of lane ``k``: blade, tip [m], force [N]."""
    step.reached[k] = min(step.reached[k], min(place, tip))
    step.updates[k] += 1.0
    step.vertical_sum[k] += vertical
    step.vertical_max[k] = max(step.vertical_max[k], vertical)


@njit_inline
def breached(depth: Struct) -> bool:
    """Return True if the lower layer is opened beyond its limit."""
    return depth.deepest > depth.layer_limit  # type: ignore[no-any-return]


@njit_inline
def achieved(depth: Struct, target: float) -> bool:
    """Return True if mean error and depth into the layer are a success's.

    The mean is that of the length that is left to cut at the start.
    """
    mean: float = (depth.deep + depth.uncut) / max(target - depth.begun, SPACING)
    return mean <= DEPTH_TOLERANCE and depth.deepest <= LAYER_TOLERANCE


@njit_internal
def left_loaded(cuts: Cuts, c: Integer) -> tuple[float, float]:
    """Return stored energy [J], floor included, and tip R B [N]."""
    state, profile, pressed = cuts.states[c], cuts.profiles[c], cuts.motions[c].pressed
    if pressed <= 0.0:
        return -1.0, 1.0
    i, share = grid_index(state.tip)
    reduced = max(state.blade - state.creep - state.tip, 0.0)
    stored = 0.5 * lerp(profile.stiffness, i, share) * reduced * reduced + pressed
    return stored, lerp(profile.toughness, i, share)


@njit_inline
def depth_along(depths: StructArray, position: float) -> float:
    """Interpolate ``depths``, (301,) [m], at ``position`` [m]."""
    i, share = grid_index(position)
    return lerp(depths, i, share)


@njit_internal
def wanted_at(depth: Struct, measured: StructArray, position: float) -> float:
    """Return the wanted depth [m] shown at ``position`` [m]."""
    if depth.level_wanted == 1:
        return depth_along(measured, position)
    at = min(max(position, 0.0) * POINTS_PER_METRE, N_POINTS - 1.0)
    i = min(int(at), N_POINTS - 2)
    return depth.wanted[i] + (at - i) * (depth.wanted[i + 1] - depth.wanted[i])  # type: ignore[no-any-return]


@njit_internal
def fill_depth(
    depth: Struct, descent: Struct, measured: StructArray, position: float, forces: tuple[float, float, float],
    last_descent: float, observation: StructArray,
) -> None:  # fmt: skip
    """Fill depth's components with vertical forces: now, mean and largest."""
    _fill(
        forces[0], forces[1], forces[2], depth_along(measured, position) - descent.level, -descent.level_speed,
        wanted_at(depth, measured, position), wanted_at(depth, measured, position + LOOK_AHEAD[0]),
        wanted_at(depth, measured, position + LOOK_AHEAD[1]), wanted_at(depth, measured, position + LOOK_AHEAD[2]),
        last_descent, observation,
    )  # fmt: skip


@njit_internal
def observe(stepping: Stepping, k: Integer, action: StructArray, observation: StructArray) -> None:
    """Fill depth's components, drawing sensor noise once per decision."""
    cuts, step, c = stepping.cuts, stepping.step, stepping.row.cut[k]
    depth, descent, sensor, tick = cuts.wholes[c], cuts.motions[c], cuts.sensors[c], cuts.states[c].tick
    counter, updates = _NORMALS * tick, cuts.progresses[c].updates
    first = normal_at(sensor.seed, sensor.episode, VERTICAL_NOISE, counter)
    second = normal_at(sensor.seed, sensor.episode, VERTICAL_NOISE, counter + 1)
    third = normal_at(sensor.seed, sensor.episode, VERTICAL_NOISE, counter + 2)
    now = in_steps(descent.vertical + depth.vertical_noise * first, depth.vertical_resolution)
    mean = step.vertical_sum[k] / updates + depth.vertical_noise * second / math.sqrt(updates)
    largest = in_steps(step.vertical_max[k] + depth.vertical_noise * third, depth.vertical_resolution)
    fill_depth(
        depth, descent, cuts.nominals[c].depth, cuts.progresses[c].position, (now, mean, largest), action[2],
        observation,
    )  # fmt: skip


@njit_internal
def observe_start(cuts: Cuts, c: Integer, descent: Struct, observation: StructArray) -> None:
    """Fill depth's components at the start, force tared to zero."""
    position = cuts.progresses[c].position
    fill_depth(cuts.wholes[c], descent, cuts.nominals[c].depth, position, (0.0, 0.0, 0.0), 0.0, observation)


@njit_inline
def fetch(cuts: Cuts, i: int, first: Integer, last: Integer) -> None:
    """Prefetch two cuts' vertical motion and depth for the next row."""
    for c in range(first + 2 * i, min(first + 2 * (i + 1), last)):
        descent, depth = cuts.motions[c], cuts.wholes[c]
        place = grid_index(cuts.states[c].tip)[0]
        for k in (max(place - 8, 0), place):  # the edge lies behind the tip
            prefetch(descent.belongs, k)
            prefetch(descent.surface, k)
            prefetch(descent.floor, k)
            prefetch(descent.toughness, k)
            prefetch(depth.counted, k)
            prefetch(depth.wanted, k)
        prefetch(descent.far, place)
        prefetch(descent.near, place)


@njit_internal
def _drawn(seed: Integer, episode: Integer, number: int) -> float:
    """Return uniform number ``number`` of a key's wanted depth."""
    return uniform_at(seed, episode, TASK, WANTED_DRAW + np.int64(number))


@njit_internal
def draw_wanted(seed: Integer, episode: Integer, kind: int, target: float, wanted: Array) -> None:
    """Fill ``wanted``, (301,), with depths [m] below the surface, by ``kind``."""
    if kind == MIXED_WANTED:
        kind = UNCHANGING + min(int(3.0 * _drawn(seed, episode, 0)), 2)
    first = SHALLOW + (DEEP - SHALLOW) * _drawn(seed, episode, 1)
    least = LEAST_CHANGE if kind != UNCHANGING else 0.0
    shallower, deeper = max(first - least - SHALLOW, 0.0), max(DEEP - first - least, 0.0)
    place = _drawn(seed, episode, 2) * (shallower + deeper)  # the range of depths that differ enough
    second = first - least - place if place < shallower else first + least + (place - shallower)
    if kind == UNCHANGING:
        second = first
    changes = (0.3 + 0.4 * _drawn(seed, episode, 3)) * target
    for i in range(N_POINTS):
        x = i * SPACING
        share = x / target if kind == RAMPED else (x - changes) / STEP_LENGTH + 0.5
        wanted[i] = first + min(max(share, 0.0), 1.0) * (second - first)


@njit_internal
def draw_layer(seed: Integer, episode: Integer, wanted: Array, layers: Struct) -> None:
    """Place the lower layer, ``layers.boundary`` [m], below the deepest wanted depth.

    Toughness and modulus are drawn where they are 1, that is not known of the tissue.
    """
    deepest = 0.0
    for i in range(N_POINTS):
        deepest = max(deepest, wanted[i])
    layers.boundary = deepest + LEAST_BELOW + (MOST_BELOW - LEAST_BELOW) * _drawn(seed, episode, 4)
    if layers.deep_toughness == 1.0:
        layers.deep_toughness = _between(TOUGHNESS_RANGE[0], TOUGHNESS_RANGE[1], _drawn(seed, episode, 5))
    if layers.deep_modulus == 1.0:
        layers.deep_modulus = _between(MODULUS_RANGE[0], MODULUS_RANGE[1], _drawn(seed, episode, 6))


@njit_internal
def _between(low: float, high: float, share: float) -> float:
    """Return the number at ``share`` of a logarithmic interval."""
    return low * exp(share * log(high / low))


@njit_internal
def begin(cuts: Cuts, c: Integer, given: tuple[float, float, int, int], key: tuple[Integer, Integer]) -> None:
    """Begin a cut's wanted depth, layer and blade place.

    ``given`` are the fracture part of the resistance, the bed's stiffness over the modulus, the kind of wanted depth,
    and 1 if the layer below is drawn.
    """
    profile, measured, along, state = cuts.profiles[c], cuts.nominals[c], cuts.specimens[c], cuts.states[c]
    task, descent, depth, slab = cuts.tasks[c], cuts.motions[c], cuts.wholes[c], cuts.shared[0].slab[0]
    for i in range(N_POINTS):
        descent.surface[i] = descent.floor[i] = profile.depth[i]
        descent.toughness[i] = given[0] * along.fracture_resistance[i]
    descent.modulus = cut_through(slab, along.modulus, descent.far, descent.near)
    descent.bed = given[1] * descent.modulus
    depth.level_wanted = 1 if given[2] == AT_LEVEL else 0
    if given[2] == AT_LEVEL:
        for i in range(N_POINTS):
            depth.wanted[i] = profile.depth[i]
    else:
        draw_wanted(key[0], key[1], given[2], task.target, depth.wanted)
    if given[3] == 1:
        draw_layer(key[0], key[1], depth.wanted, descent)
    depth.begun = state.tip
    cell = int(state.tip * POINTS_PER_METRE + 0.5)
    for i in range(cell + 1):  # what is already cut is as deep as wanted, by the measured surface
        descent.floor[i] = 0.0 if given[2] == AT_LEVEL else measured.depth[i] - depth.wanted[i]
        depth.counted[i] = -1.0
    for i in range(N_POINTS):
        depth.counted[i] = -1.0
    descent.cell = descent.under = cell
    descent.tip, descent.blade = state.tip, state.blade
    descent.level = descent.settled = descent.engaged = descent.floor[cell]
    descent.version = 0
    for i in range(N_POINTS):
        descent.belongs[i] = -1
        renew(profile, descent, slab, i)
    survey_floor(depth, descent, 0.0)


@njit_internal
def expect(cuts: Cuts, c: Integer, given: tuple[float, float, int, int], key: tuple[Integer, Integer]) -> None:
    """Begin a rig's expected floor; ``given`` as in :func:`begin`."""
    measured, depth, descent = cuts.nominals[c].depth, cuts.wholes[c], cuts.known[c].motion[0]
    kind, target = given[2], cuts.tasks[c].target
    for i in range(N_POINTS):
        descent.surface[i] = descent.floor[i] = measured[i]
        depth.counted[i] = -1.0
        depth.wanted[i] = measured[i]
    depth.level_wanted = 1 if kind == AT_LEVEL else 0
    if kind != AT_LEVEL:
        draw_wanted(key[0], key[1], kind, target, depth.wanted)
    level: float = 0.0 if kind == AT_LEVEL else measured[0] - depth.wanted[0]
    descent.level = descent.engaged = descent.floor[0] = level
    depth.deep = depth.uncut = depth.layer = depth.deepest = 0.0
    depth.counts = 0
    survey_floor(depth, descent, 0.0)


@njit
def drawn_layer(descents: StructArray, wanted: Array, key: tuple[Integer, Integer]) -> None:
    """Put a key's layer below the wanted depth [m], (301,)."""
    draw_layer(key[0], key[1], wanted, descents[0])


@njit_internal
def measure(stepping: Stepping, k: Integer) -> None:
    """Measure height and vertical force with this millisecond's noise."""
    c = stepping.row.cut[k]
    cuts, levels = stepping.cuts, stepping.moving.lanes
    known, depth, sensor, tick = cuts.known[c], cuts.wholes[c], cuts.sensors[c], stepping.row.tick[k]
    noise = depth.vertical_noise * normal_at(sensor.seed, sensor.episode, VERTICAL_NOISE, _NORMALS * tick + 3)
    known.ways[_HEIGHT] = levels.level[k]
    known.ways[_VERTICAL] = in_steps(
        delayed(known, sensor, tick, levels.vertical[k]) + noise, depth.vertical_resolution
    )


@njit_internal
def expect_at(cuts: Cuts, c: Integer, first: bool, tick: int, position: float) -> None:
    """Update the expected profile to the blade's engaged depth."""
    known = cuts.known[c]
    descent = known.motion[0]
    if first:
        for i in range(RESPONSE + 1):
            descent.levels[i] = descent.level
    for i in range(RESPONSE):
        descent.levels[i] = descent.levels[i + 1]
    descent.level = descent.levels[RESPONSE] = known.ways[_HEIGHT]
    if first or tick % _EVERY == 0:
        _engage(cuts.nominals[c], cuts.shared[0].mean[0], descent, position)


@njit_internal
def _engage(profile: Struct, mean: Struct, descent: Struct, position: float) -> None:
    """Update the profile around tip and blade from mean tissue."""
    last = min(int(max(position, 0.0) * POINTS_PER_METRE) + _AHEAD, N_POINTS - 1)
    for k in range(max(min(descent.cell, last) - 1, 0), last + 1):
        engaged = descent.level if k > descent.cell else max(descent.level, descent.floor[k])
        depth = held_depth(descent, descent.surface[k] - engaged)
        profile.depth[k] = depth
        profile.stiffness[k] = nominal_stiffness(mean, k, depth)
        profile.toughness[k] = mean.toughness_per_depth * depth


@njit_internal
def learn(known: Struct, tick: int, position: float, tip: float) -> None:
    """Let the expected floor follow the blade and the estimated tip."""
    if tick % RESPONSE == 0:
        follow_floor(known.motion[0], position, tip)


@njit_internal
def observe_seen(stepping: Stepping, k: Integer, action: StructArray, observation: StructArray) -> None:
    """Fill depth's components, and surface depth, from a rig's measurements."""
    cuts, step, c = stepping.cuts, stepping.step, stepping.row.cut[k]
    depth, known, position = cuts.wholes[c], cuts.known[c], cuts.progresses[c].position
    descent, updates = known.motion[0], max(step.updates[k], 1.0)
    span = min(updates, float(RESPONSE))
    descent.level_speed = (descent.level - descent.levels[RESPONSE - int(span)]) / (span * TICK)
    forces = known.ways[_VERTICAL], step.vertical_sum[k] / updates, step.vertical_max[k]
    fill_depth(depth, descent, descent.surface, position, forces, action[2], observation)
    observation[_DEPTH] = depth_along(descent.surface, position) / _DEPTH_SCALE


_HIDDEN = (
    "depth of cut at the tip less the wanted depth [2 mm]",
    "that less the wanted depth 5 mm further [2 mm]",
    "floor of the cut to the layer below [2 mm]",
    "blade to the layer below, at the tip [2 mm]",
    "logarithm of the layer's toughness over the tissue's [1]",
    "logarithm of the layer's modulus over the tissue's [1]",
    "error of the measured surface at the tip [mm]",
    "mean error of the depth so far over that of a success [1]",
    "largest depth into the layer below [mm]",
)
"""Names of the privileged features that depth adds."""
_SHORT, _FINE = 0.002, 0.001  # scales of lengths [m]
_FURTHER = 0.005  # [m]


@njit
def hide(cuts: Cuts, which: StructArray, hidden: Array) -> None:
    """Fill depth's privileged features for the cuts ``which``."""
    for m in range(len(which)):
        n = which[m]
        state, measured, task = cuts.states[n], cuts.nominals[n], cuts.tasks[n]
        descent, depth = cuts.motions[n], cuts.wholes[n]
        i = min(int(state.tip * POINTS_PER_METRE + 0.5), N_POINTS - 1)
        further = min(int((state.tip + _FURTHER) * POINTS_PER_METRE + 0.5), N_POINTS - 1)
        floor, blade = descent.surface[i] - descent.engaged, descent.surface[i] - descent.level
        hidden[m, 0] = (floor - depth.wanted[i]) / _SHORT
        hidden[m, 1] = (floor - depth.wanted[further]) / _SHORT
        hidden[m, 2] = (descent.boundary - floor) / _SHORT
        hidden[m, 3] = (descent.boundary - blade) / _SHORT
        hidden[m, 4] = log(descent.deep_toughness)
        hidden[m, 5] = log(descent.deep_modulus)
        hidden[m, 6] = (measured.depth[i] - descent.surface[i]) / _FINE
        hidden[m, 7] = (depth.deep + depth.uncut) / (task.target * DEPTH_TOLERANCE)
        hidden[m, 8] = depth.deepest / _FINE


DEPTH_ERRORS = (  # rounding may leave an area of -1e-20
    CutNumber(name="too_deep_mm2", meaning="area cut too deep", value=lambda whole: 1e6 * max(whole.deep, 0.0)),
    CutNumber(name="uncut_mm2", meaning="area left uncut", value=lambda whole: 1e6 * max(whole.uncut, 0.0)),
    CutNumber(
        name="layer_mm2",
        meaning="area opened in the layer below",
        value=lambda whole: 1e6 * max(whole.layer, 0.0),
        on_rig=False,
    ),
    CutNumber(
        name="layer_mm",
        meaning="greatest depth to which the layer below is opened",
        value=lambda whole: 1e3 * max(whole.deepest, 0.0),
        on_rig=False,
        glossary=(
            "Into the layer below",
            "How deep the layer below the tissue was opened at the worst place. Nobody sees where it lies. A success "
            f"opens it by at most {1e3 * LAYER_TOLERANCE:g} mm.",
        ),
    ),
    CutNumber(
        name="mean_error_mm",
        meaning="mean error of the depth along the target length",
        value=lambda whole, target: 1e3 * (max(whole.deep, 0.0) + max(whole.uncut, 0.0)) / target,
        glossary=(
            "Error of the depth",
            "By how much the floor of the cut lies above or below the wanted one, on average along the cut. A success "
            f"errs by at most {1e3 * DEPTH_TOLERANCE:g} mm, besides all that is said above.",
        ),
    ),
)
DEPTH_TRUTH = (
    CutNumber(name="level_m", meaning="level of the blade", value=lambda motion: motion.level),
    CutNumber(
        name="floor_depth_m",
        meaning="depth of the cut at the tip",
        value=lambda motion: motion.surface[motion.cell] - motion.floor[motion.cell],
    ),
    CutNumber(name="layer_m", meaning="depth of the layer below", value=lambda motion: motion.boundary),
)
DEPTH_CUT = Task(
    place=f"{__name__}:DEPTH_CUT",
    environment="cutenv/DepthCut-v1",
    motion=DESCENDING,
    axis=ActionAxis(
        name="descent",
        meaning="descent speed",
        command="descent_speed",
        scale=DESCENT_SCALE,
        shown="-10 to 10 (down)",
        unit="mm/s",
    ),
    components=DEPTH_COMPONENTS,
    costs=DEPTH_COSTS,
    quantities=OF_MAP,
    whole=DEPTH,
    counted=("reached", "updates", "vertical_sum", "vertical_max"),
    expected=EXPECTED,
    measured=("height", "vertical_force"),
    end="layer",
    end_text="the layer below is opened deeper than ``layer_limit``; an end for safety",
    shown_as="depth",
    errors=DEPTH_ERRORS,
    truth=DEPTH_TRUTH,
    hidden=_HIDDEN,
    begin=begin,
    expect=expect,
    observe_start=observe_start,
    fetch=fetch,
    begin_step=begin_step,
    count=count,
    survey=survey,
    breached=breached,
    achieved=achieved,
    left_loaded=left_loaded,
    observe=observe,
    measure=measure,
    expect_at=expect_at,
    learn=learn,
    observe_seen=observe_seen,
    hide=hide,
)
"""Gentle cutting along a wanted depth."""


class DepthOptions(TaskOptions):
    """Options of cutting along a wanted depth.

    From the keywords of the environment ``wanted``, ``layer``, and the fields of :class:`DepthConstants`,
    :class:`~cutenv.sim.cutting.descent.DescentParameters` and :class:`~cutenv.sim.tissue.specimen.SurfaceSpread` are
    removed.  ``wanted`` becomes a value of :data:`WANTED_KINDS`, ``layer`` whether there is another layer below.
    """

    names = (
        "wanted", "layer", *DepthConstants.__dataclass_fields__, *DescentParameters.__dataclass_fields__,
        *SurfaceSpread.__dataclass_fields__,
    )  # fmt: skip

    def __init__(self, keywords: dict[str, Any]) -> None:
        super().__init__(keywords)
        wanted, layer = keywords.pop("wanted", "mixed"), keywords.pop("layer", None)
        self.wanted = WANTED_KINDS[one_of("wanted", wanted, tuple(WANTED_KINDS))]
        one_of("layer", layer, (None, True, False))
        self.layer = wanted != "profile" if layer is None else layer
        if wanted == "profile":  # of the mean liver, as in cutenv/GentleCut-v1
            keywords.setdefault("surface_spread", 0.0)
        self.constants, self.descent = taken_from(keywords, DepthConstants), taken_from(keywords, DescentParameters)
        self.surface = taken_from(keywords, SurfaceSpread)

    task = DEPTH_CUT

    def whole(self) -> StructArray:
        """Return a cut's initial depth record, :data:`DEPTH`, (1,)."""
        return settings_record(DEPTH, self.constants)

    def motion(self, specimen: Specimen) -> StructArray:
        """Return the initial vertical motion, :data:`~cutenv.sim.cutting.descent.DESCENT`, (1,)."""
        return descent_records([specimen], specimen.tissue.layers if self.layer else None, self.descent)

    def shared(self, tissue: TissueDescription) -> StructArray:
        """Return slab and mean tissue, :data:`~cutenv.sim.cutting.descent.SHARED` of shape (1,)."""
        return shared_record(tissue)

    def expected(self, tissue: TissueDescription) -> StructArray:
        """Return a blade's motion in mean tissue, :data:`EXPECTED`, (1,)."""
        record = np.zeros(1, EXPECTED)
        record["toughness"] = (1.0 - tissue.friction_share) * tissue.fracture_resistance
        record["modulus"], record["bed"] = tissue.modulus, self.descent.bedding * tissue.modulus
        record["thickness"], record["edge_length"] = tissue.thickness, self.descent.edge_length
        for name in Layers.__dataclass_fields__:
            record[name] = getattr(Layers(), name)
        return record

    def beginning(self, tissue: TissueDescription) -> tuple[float, float, int, int]:
        """Return what :func:`begin` takes."""
        return 1.0 - tissue.friction_share, self.descent.bedding, self.wanted, int(self.layer)

    def shown_depth(self, cuts: Cuts, number: int) -> ShownDepth:
        """Return a copy of one cut's depth for a picture."""
        return depth_shown(cuts.motions[number].copy(), cuts.wholes[number].copy())

    def episode(self, plant: Any, goal: Goal, *, from_truth: bool | None = None) -> DepthEpisode:
        """Return a new episode along a wanted depth."""
        return DepthEpisode(plant, goal, self, from_truth=from_truth)


def depth_shown(descent: Struct, depth: Struct) -> ShownDepth:
    """Return a cut's depth for a picture from motion and assessment."""
    surface = descent["surface"]
    return ShownDepth(
        float(descent["level"]), surface, descent["floor"], surface - depth["wanted"],
        surface - float(descent["boundary"]),
    )  # fmt: skip


class DepthEpisode(Episode):
    """An episode along a wanted depth, with the true floor or the expected one."""

    options: DepthOptions
    _level_before = 0.0

    def step(self, action: Array) -> tuple[Array32, float]:
        """Command 3 numbers in [-1, 1] for one decision; return observation, (22,), and reward."""
        self._level_before = float(self.motion["level"][0])
        return super().step(action)

    def _measured(self, count: int) -> tuple[dict[str, Array], Array]:
        channels = {name: self.plant.channels[name].copy() for name in self.task.measured}
        return channels, _ways_of(channels)

    @property
    def channels(self) -> dict[str, Array]:
        """Height, and vertical force at the readings since the last decision.

        Of a simulated cut the height is linear between two decisions, and the force true unless a rig sees the cut.
        """
        if not self.simulated:
            return super().channels
        heights = np.linspace(self._level_before, float(self.plant.cuts["motions"]["level"][0, 0]), self.updates + 1)
        return {"height": heights[1:], "vertical_force": self.across[: self.updates].copy()}

    @property
    def shown_depth(self) -> ShownDepth:
        """Depth as a picture shows it."""
        return depth_shown(self.motion[0], self.whole[0])

    @property
    def start_level(self) -> float:
        """Blade level at the start of a rig's cut [m]."""
        return float(self.motion["floor"][0, 0])

    def layers_below(self) -> Layers:
        """Return layers that ``cutenv/DepthCut-v1`` draws for this key."""
        assert self.goal.key is not None  # a cut has one
        key = np.uint64(self.goal.key[0]), np.uint64(self.goal.key[1])
        drawn, known = self.motion.copy(), self.goal.tissue.layers or Layers()
        for name in ("deep_toughness", "deep_modulus"):
            drawn[name] = getattr(known, name)
        drawn_layer(drawn, self.whole["wanted"][0], key)
        names = ("boundary", "deep_toughness", "deep_modulus")
        return dataclasses.replace(known, **{name: float(drawn[name][0]) for name in names})

    @property
    def floor(self) -> Array:
        """Depth of cut at each point [m], (301,), 0 if uncut."""
        cut: Array = self.motion["surface"][0] - self.motion["floor"][0]
        return cut

    @property
    def floor_to_tip(self) -> Array:
        """Depth of cut from clamp to tip [m], shape (n,)."""
        return np.maximum(self.floor[: int(self.motion["cell"][0]) + 1], 0.0)

    @property
    def noted(self) -> dict[str, Any]:
        """Target length and wanted depth by key of record metadata."""
        from cutenv.records.measurement.depth import WANTED_DEPTH_KEY, corners  # slow to import, for a record alone

        wanted = self.whole["wanted"][0]
        return super().noted | {WANTED_DEPTH_KEY: corners(np.arange(len(wanted), dtype=np.float64) * SPACING, wanted)}

    @property
    def given_depth(self) -> dict[str, Any]:
        """Given depths by metadata key: wanted, and any layer below."""
        from cutenv.records.measurement.depth import LAYER_DEPTH_KEY, WANTED_DEPTH_KEY

        given, boundary = {WANTED_DEPTH_KEY: self.noted[WANTED_DEPTH_KEY]}, float(self.motion["boundary"][0])
        return given | ({LAYER_DEPTH_KEY: boundary} if boundary < float(self.motion["thickness"][0]) else {})

    @property
    def noted_map(self) -> dict[str, Any]:
        """Simulated depth's notes by metadata key: errors, given depths, floor."""
        from cutenv.records.scoring.truth import FLOOR_AT_END

        errors = {name: round(value, 3) for name, value in self.errors.items()}
        return errors | self.given_depth | {FLOOR_AT_END: np.round(self.floor_to_tip, 6).tolist()}


def _ways_of(channels: dict[str, Array]) -> Array:
    """Return heights and vertical forces for the task, (n, WAYS)."""
    ways = np.zeros((len(channels["height"]), WAYS))
    ways[:, _HEIGHT], ways[:, _VERTICAL] = channels["height"], channels["vertical_force"]
    return ways


def to_depth_action(speed: float, angle: float, descent_speed: float) -> Array32:
    """Return a clipped action, (3,), for speeds [m/s] and angle [rad]."""
    descent = speed_action(descent_speed * (SPEED_SCALE / DESCENT_SCALE))
    return np.append(to_action(speed, angle), np.float32(np.clip(descent, -1.0, 1.0))).astype(np.float32)
