"""The task of ``cutenv/PathCut-v1``.

Cut along a drawn line, by a blade that is steered.

A rig does not see the cut.  How far it has come along the line is estimated from the force along the blade, with the
stiffness of the mean tissue; to the side it runs where a crack of that length would run in mean tissue behind this
blade, as a record is scored (:mod:`cutenv.sim.tissue.path_model`).  A crack that only turned toward the measured force
would drift away from the blade by the errors of that force.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from cutenv._base.arrays import Array, Array32, Struct, StructArray
from cutenv._base.validation import check_parameters, one_of, parameter, taken_from
from cutenv._engine.intrinsics import as_float64_view, prefetch
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv._engine.randomness import LATERAL_NOISE, LINE_DRAW, TASK, Integer, normal_at, three_normals_at, uniform_at
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.cutting.law import grid_index, lerp
from cutenv.sim.cutting.steering import (
    LINE_REACH,
    STEERED,
    STEERING,
    CrackFrame,
    SteeringParameters,
    advance_tip,
    frame_at,
    lay_line,
    place_of_blade,
    place_of_tip,
    stand_on_line,
    turned,
)
from cutenv.sim.quantities import FARTHEST_TOLERANCE, LINE_LIMIT, LINE_TOLERANCE, OF_PATH, PATH_COSTS
from cutenv.sim.tissue.crack_tip import ESTIMATED_EVERY
from cutenv.sim.tissue.description import TissueDescription
from cutenv.sim.tissue.drawn_lines import (
    KINDS,
    LEAST_LENGTH,
    MIXED_KINDS,
    MIXED_LINES,
    OF_A_KIND,
    DrawnLines,
    drawn_lines,
    given_line,
)
from cutenv.sim.tissue.grid import LENGTH, N_POINTS, POINTS_PER_METRE, SPACING
from cutenv.sim.tissue.lines import WIDTH, CutLine, length_within, places_within, through
from cutenv.sim.tissue.specimen import Specimen
from cutenv.sim.trace import PLACE
from cutenv.task.beginning import LONGEST, drawn_length
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
from cutenv.task.episode import Episode, Goal, ShownPath, TaskOptions
from cutenv.task.observation import SPEED_SCALE, Component, speed_action, to_action
from cutenv.task.reward import with_weights

TURN_SCALE = 1.5  # rate of turn of action 1 [rad/s]: more than the sharpest bend of a line at full speed asks for
LINE_AHEAD = (0.005, 0.010, 0.020)  # distances ahead of the blade at which the line is observed [m]
_ASIDE, _DIRECTION, _BEND = 0.005, 0.5, 25.0  # scales

# Components of the observation that follow the 12 of gentle cutting, in order.
PATH_COMPONENTS = (
    Component(name="lateral", meaning="force on the blade to its right, now", unit="N", scale=5.0),
    Component(name="lateral_mean", meaning="its mean since the last decision", unit="N", scale=5.0),
    Component(name="lateral_peak", meaning="largest size of it since the last decision", unit="N", scale=5.0),
    Component(name="aside", meaning="line to the left of the blade, at the blade", unit="m", scale=_ASIDE),
    Component(
        name="direction", meaning="sine of the turn from blade to line there, to the left", unit="1", scale=_DIRECTION
    ),
    Component(name="bend", meaning="curvature of the line there, to the left", unit="1/m", scale=_BEND),
    Component(
        name="aside_near", meaning="line to the left of the blade's course, 5 mm further", unit="m", scale=_ASIDE
    ),
    Component(name="direction_near", meaning="direction there", unit="1", scale=_DIRECTION),
    Component(name="bend_near", meaning="curvature there", unit="1/m", scale=_BEND),
    Component(
        name="aside_further", meaning="line to the left of the blade's course, 10 mm further", unit="m", scale=_ASIDE
    ),
    Component(name="direction_further", meaning="direction there", unit="1", scale=_DIRECTION),
    Component(name="bend_further", meaning="curvature there", unit="1/m", scale=_BEND),
    Component(
        name="aside_far", meaning="line to the left of the blade's course, 20 mm further", unit="m", scale=_ASIDE
    ),
    Component(name="direction_far", meaning="direction there", unit="1", scale=_DIRECTION),
    Component(name="bend_far", meaning="curvature there", unit="1/m", scale=_BEND),
    Component(name="last_turn", meaning="last action: turn", unit="1", scale=1.0),
)


@with_weights(PATH_COSTS)
@dataclass(frozen=True, kw_only=True)
class PathConstants:
    """Weights of the path's costs, limit of the distance, sensor of the lateral force."""

    line_limit: float = parameter(
        LINE_LIMIT, unit="m", low=0.0005, high=0.03, provenance="choice",
        source="distance between cut and line at which a cut ends for safety", sensitivity=(0.005, 0.015),
    )  # fmt: skip
    lateral_noise: float = parameter(
        0.02, unit="N", low=0.0, high=10.0, provenance="assumed", source="as along the cut", sensitivity=(0.0, 0.1),
    )  # fmt: skip
    lateral_resolution: float = parameter(
        0.05, unit="N", low=0.0, high=10.0, provenance="assumed", source="as along the cut", sensitivity=(0.0, 0.1),
    )  # fmt: skip

    def __post_init__(self) -> None:
        check_parameters(self)


# Record of a cut's line, and of its distance to it so far, by which its path is assessed.
PATH: np.dtype[Any] = np.dtype(
    (
        np.record,
        [
            *((name, "f8") for name in PathConstants.__dataclass_fields__),
            ("counts", "i8"),  # number of points of the line in the sums below
            ("passed_area", "f8"),  # area between cut and line up to these points [m2],
            ("passed_farthest", "f8"),  # largest distance [m],
            ("passed_distance", "f8"),  # and the integral of the distance along the line [m2]
            ("area", "f8"),  # the same with what the tip has passed since its crack last turned
            ("farthest", "f8"),
            ("distance", "f8"),
            ("begun", "f8"),  # length of line that was cut at the start [m]
            ("line", "i8"),  # index of the line
            *whole_fields(PATH_COSTS),
        ],
    )
)

_FUSIFORM = KINDS.index("fusiform")
GIVEN_LINE = MIXED_LINES + 1  # number, after those of the kinds, of a line that is given
_KINDS = len(MIXED_KINDS)
_EVERY = round(ESTIMATED_EVERY / TICK)
_STEP = 0.0002  # [m] of line after which the expected crack turns, as in cutenv.sim.tissue.path_model
_AHEAD = 10  # points of the grid in the first distance at which the line is observed
_STEERING, _LINES = np.int64(STEERING.itemsize // 8), 5  # numbers in a record; cache lines of its first ones
_X, _Y, _EAST, _NORTH, _LATERAL = range(5)  # places of the measurements of a rig
_NORMALS = 4  # random numbers of a decision

_fill = observer(PATH_COMPONENTS, [__name__])


@njit
def line_index(seed: Integer, episode: Integer, kind: int) -> int:
    """Return a key's line index among drawn lines, 0 if given."""
    if kind == MIXED_LINES:
        kind = min(int(_KINDS * uniform_at(seed, episode, TASK, LINE_DRAW)), _KINDS - 1)
    if kind in (0, GIVEN_LINE):
        return 0
    place = min(int(OF_A_KIND * uniform_at(seed, episode, TASK, LINE_DRAW + 1)), OF_A_KIND - 1)
    return 1 + OF_A_KIND * (kind - 1) + place


@njit_internal
def survey_path(path: Struct, steering: Struct, tip: float) -> None:
    """Update the line distance for a crack straight on to ``tip`` [m]."""
    for i in range(path.counts, steering.cell + 1):
        _count(path, steering, i, steering.cut[i])
    path.counts = max(path.counts, steering.cell + 1)
    passed = path.passed_area, path.passed_farthest, path.passed_distance
    last = grid_index(tip)[0]
    if last > steering.cell:
        grown, start = tip - steering.settled, steering.tip_aside
        way = grown * steering.stretch
        east = steering.tip_east + way * steering.tip_ahead - grown
        north = steering.tip_north + way * steering.tip_across
        j, share = grid_index(tip)
        end = (north - lerp(steering.y, j, share)) * lerp(steering.cosine, j, share) - (
            east - lerp(steering.x_excess, j, share)
        ) * lerp(steering.sine, j, share)
        for i in range(steering.cell + 1, last + 1):
            _count(path, steering, i, start + (end - start) * ((i * SPACING - steering.settled) / grown))
    path.area, path.farthest, path.distance = path.passed_area, path.passed_farthest, path.passed_distance
    path.passed_area, path.passed_farthest, path.passed_distance = passed


@njit_inline
def _count(path: Struct, steering: Struct, i: int, aside: float) -> None:
    """Count point ``i``, passed at ``aside`` [m] to the left."""
    size = abs(aside)
    path.passed_area += SPACING * size * (1.0 - 0.5 * steering.curvature[i] * aside)
    path.passed_distance += SPACING * size
    path.passed_farthest = max(path.passed_farthest, size)


@njit_inline
def survey(path: Struct, steering: Struct, step: Struct, k: Integer, tip: float) -> None:
    """Update the distance to the line up to ``tip`` [m]."""
    survey_path(path, steering, tip)


@njit_inline
def begin_step(step: Struct, k: Integer, place: float) -> None:
    """Prepare a step of lane ``k``."""
    step.lateral_sum[k], step.lateral_peak[k] = 0.0, 0.0


@njit_inline
def count(step: Struct, k: Integer, place: float, tip: float, lateral: float) -> None:
    """Count a millisecond of lane ``k``, force rightwards [N]."""
    step.lateral_sum[k] += lateral
    step.lateral_peak[k] = max(step.lateral_peak[k], abs(lateral))


@njit_inline
def size(force: float, lateral: float) -> float:
    """Return the force's size in the plane [N]."""
    return math.sqrt(force * force + lateral * lateral)


@njit_inline
def breached(path: Struct) -> bool:
    """Return True if the cut is beyond its distance limit."""
    return path.farthest > path.line_limit  # type: ignore[no-any-return]


@njit_inline
def achieved(path: Struct, target: float) -> bool:
    """Return True if mean and largest distance to the line are a success's.

    The mean is that of the length that is left to cut at the start.
    """
    mean: float = path.distance / max(target - path.begun, SPACING)
    return mean <= LINE_TOLERANCE and path.farthest <= FARTHEST_TOLERANCE


@njit_internal
def left_loaded(cuts: Cuts, c: Integer) -> tuple[float, float]:
    """Return stored energy [J], sideways too, and tip R B [N]."""
    state, profile = cuts.states[c], cuts.profiles[c]
    i, share = grid_index(state.tip)
    reduced = max(state.blade - state.creep - state.tip, 0.0)
    held = cuts.motions[c].held
    if held <= 0.0:
        return -1.0, 1.0
    stored = 0.5 * lerp(profile.stiffness, i, share) * reduced * reduced + held
    return stored, lerp(profile.toughness, i, share)


@njit_internal
def fill_path(
    steering: Struct, position: float, forces: tuple[float, float, float], last_turn: float, observation: StructArray
) -> None:
    """Fill path's components at ``position`` [m] with lateral forces: now, mean and largest."""
    here = line_ahead(steering, position, 0.0)
    near, further = line_ahead(steering, position, LINE_AHEAD[0]), line_ahead(steering, position, LINE_AHEAD[1])
    far = line_ahead(steering, position, LINE_AHEAD[2])
    _fill(
        forces[0], forces[1], forces[2], here[0], here[1], here[2], near[0], near[1], near[2], further[0], further[1],
        further[2], far[0], far[1], far[2], last_turn, observation,
    )  # fmt: skip


@njit_internal
def observe(stepping: Stepping, k: Integer, action: StructArray, observation: StructArray) -> None:
    """Fill path's components, drawing sensor noise once per decision."""
    cuts, step, c = stepping.cuts, stepping.step, stepping.row.cut[k]
    path, steering, sensor, state = cuts.wholes[c], cuts.motions[c], cuts.sensors[c], cuts.states[c]
    updates = cuts.progresses[c].updates
    first, second, third = three_normals_at(sensor.seed, sensor.episode, LATERAL_NOISE, state.tick)
    now = in_steps(steering.lateral + path.lateral_noise * first, path.lateral_resolution)
    mean = step.lateral_sum[k] / updates + path.lateral_noise * second / math.sqrt(updates)
    peak = in_steps(step.lateral_peak[k] + path.lateral_noise * third, path.lateral_resolution)
    fill_path(steering, state.blade, (now, mean, peak), action[2], observation)


@njit_internal
def observe_start(cuts: Cuts, c: Integer, steering: Struct, observation: StructArray) -> None:
    """Fill path's components at the start, force tared to zero."""
    fill_path(steering, cuts.progresses[c].position, (0.0, 0.0, 0.0), 0.0, observation)


@njit_internal
def line_ahead(steering: Struct, position: float, ahead: float) -> tuple[float, float, float]:
    """Return the line's offset left [m], sine and bend [1/m] ``ahead`` [m] on.

    Offset and sine are those to the course of the blade at ``position``.
    """
    place = min(max(position + ahead, 0.0), LENGTH)
    i, share = grid_index(place)
    t_x, t_y = lerp(steering.cosine, i, share), lerp(steering.sine, i, share)
    east = (place - position) + (lerp(steering.x_excess, i, share) - steering.east)
    north = lerp(steering.y, i, share) - steering.north
    aside = steering.ahead * north - steering.across * east
    return aside, steering.ahead * t_y - steering.across * t_x, lerp(steering.curvature, i, share)


@njit_inline
def fetch(cuts: Cuts, i: int, first: Integer, last: Integer) -> None:
    """Prefetch two cuts' place and path for the next row."""
    places = as_float64_view(cuts.motions)
    for c in range(first + 2 * i, min(first + 2 * (i + 1), last)):
        steering = cuts.motions[c]
        for k in range(_LINES):
            prefetch(places, _STEERING * c + 8 * k)
        tip, blade = grid_index(cuts.states[c].tip)[0], grid_index(cuts.states[c].blade)[0]
        for k in (tip, blade, blade + _AHEAD, blade + 2 * _AHEAD, blade + 4 * _AHEAD):
            at = min(k, N_POINTS - 1)
            prefetch(steering.x_excess, at)
            prefetch(steering.y, at)
            prefetch(steering.cosine, at)
            prefetch(steering.sine, at)
            prefetch(steering.curvature, at)
        prefetch(steering.belongs, tip)
        prefetch(steering.cut, tip)
        prefetch(steering.along, tip)
        prefetch(steering.coupled, tip)
        prefetch(steering.sideways, tip)
        prefetch(steering.off_line, 3 * tip)
        prefetch(steering.toughness, tip)


@njit_internal
def length(given: tuple[StructArray, int], key: tuple[Integer, Integer]) -> float:
    """Return a key's cut length [m], its line's or drawn."""
    own: float = given[0][line_index(key[0], key[1], given[1])].length
    return own if own > 0.0 else drawn_length(key[0], key[1])


@njit
def _length_of(lines: StructArray, kind: int, seed: Integer, episode: Integer) -> float:
    return length((lines, kind), (seed, episode))


@njit_internal
def begin(cuts: Cuts, c: Integer, given: tuple[StructArray, int], key: tuple[Integer, Integer]) -> None:
    """Begin a cut on its line, from ``given`` lines and kind."""
    profile, state, drive, steering, path = (
        cuts.profiles[c], cuts.states[c], cuts.drives[c], cuts.motions[c], cuts.wholes[c],
    )  # fmt: skip
    path.line = line_index(key[0], key[1], given[1])
    line = given[0][path.line]
    lay_line(profile, steering, line)
    stand_on_line(profile, steering, state.tip)
    drive.travel = min(drive.travel, line.within - SPACING)
    path.begun = state.tip
    survey_path(path, steering, state.tip)


@njit_internal
def expect(cuts: Cuts, c: Integer, given: tuple[StructArray, int], key: tuple[Integer, Integer]) -> None:
    """Begin a rig's expected crack on its line; see :func:`begin`."""
    nominal, steering, path = cuts.nominals[c], cuts.known[c].motion[0], cuts.wholes[c]
    path.line = line_index(key[0], key[1], given[1])
    lay_line(nominal, steering, given[0][path.line])
    stand_on_line(nominal, steering, 0.0)
    path.counts = 0
    path.passed_area = path.passed_farthest = path.passed_distance = 0.0
    survey_path(path, steering, 0.0)


@njit_internal
def measure(stepping: Stepping, k: Integer) -> None:
    """Measure place, heading and lateral force with this millisecond's noise."""
    row, cuts, places = stepping.row, stepping.cuts, stepping.moving.lanes
    c, tick = row.cut[k], row.tick[k]
    known, path, sensor = cuts.known[c], cuts.wholes[c], cuts.sensors[c]
    noise = path.lateral_noise * normal_at(sensor.seed, sensor.episode, LATERAL_NOISE, _NORMALS * tick + 3)
    known.ways[_X], known.ways[_Y] = row.blade[k] + places.east[k], places.north[k]
    known.ways[_EAST], known.ways[_NORTH] = places.ahead[k], places.across[k]
    known.ways[_LATERAL] = in_steps(delayed(known, sensor, tick, places.lateral[k]) + noise, path.lateral_resolution)


@njit_internal
def expect_at(cuts: Cuts, c: Integer, first: bool, tick: int, position: float) -> None:
    """Set the blade's place and lateral force from measurements."""
    known = cuts.known[c]
    steering = known.motion[0]
    steering.east, steering.north = known.ways[_X] - position, known.ways[_Y]
    steering.lateral = known.ways[_LATERAL]


@njit_internal
def felt_along(known: Struct, position: float, felt: float) -> float:
    """Return the force along the line [N] at ``position`` [m]."""
    steering = known.motion[0]
    i, share = grid_index(min(max(position, 0.0), LENGTH))
    t_x, t_y = lerp(steering.cosine, i, share), lerp(steering.sine, i, share)
    east, north = known.ways[_EAST], known.ways[_NORTH]
    along: float = felt * (east * t_x + north * t_y) - known.ways[_LATERAL] * (north * t_x - east * t_y)
    return along


@njit_internal
def learn(known: Struct, tick: int, position: float, tip: float) -> None:
    """Let the expected crack grow to the estimated tip."""
    if tick % _EVERY == 0:
        _follow_crack(known.motion[0], position, tip)


@njit_internal
def _follow_crack(steering: Struct, position: float, tip: float) -> None:
    """Grow the expected crack to ``tip`` [m], turned by the blade."""
    start = steering.settled
    steps = math.ceil((tip - start) / _STEP)
    for k in range(1, steps + 1):
        advance = advance_tip(steering, start + (tip - start) * k / steps)
        ahead, left, frame = _offset(steering, position)
        pull = frame.stiffness * (ahead + frame.coupling * left)
        push = frame.coupling * pull + frame.side_stiffness * left
        if pull > 0.0:
            most = steering.crack_curvature * advance
            turn = min(max(push / math.sqrt(pull * pull + push * push), -most), most)
            steering.tip_ahead, steering.tip_across = turned(steering.tip_ahead, steering.tip_across, turn)
        i, share = grid_index(steering.settled)
        steering.stretch = frame_at(steering, i, share).stretch


@njit_internal
def _offset(steering: Struct, position: float) -> tuple[float, float, CrackFrame]:
    """Return the blade's offset along and left of the settled crack [m], and stiffness."""
    east = (position - steering.settled) + (steering.east - steering.tip_east)
    north, e_x, e_y = steering.north - steering.tip_north, steering.tip_ahead, steering.tip_across
    i, share = grid_index(steering.settled)
    return east * e_x + north * e_y, north * e_x - east * e_y, frame_at(steering, i, share)


@njit_internal
def left_loaded_seen(cuts: Cuts, c: Integer) -> tuple[float, float]:
    """Return expected stored energy [J], sideways too, and tip R B."""
    steering, profile, progress = cuts.known[c].motion[0], cuts.nominals[c], cuts.progresses[c]
    position, tip = progress.position, progress.tip
    _, left, frame = _offset(steering, position)
    lag, (i, share) = max(position - tip, 0.0), grid_index(tip)
    if lag <= 0.0:
        return -1.0, 1.0
    stored = 0.5 * lerp(profile.stiffness, i, share) * lag * lag + 0.5 * frame.side_stiffness * left * left
    return stored, lerp(profile.toughness, i, share)


@njit_internal
def observe_seen(stepping: Stepping, k: Integer, action: StructArray, observation: StructArray) -> None:
    """Fill path's components from a rig's measurements."""
    cuts, step, c = stepping.cuts, stepping.step, stepping.row.cut[k]
    known, progress = cuts.known[c], cuts.progresses[c]
    steering = known.motion[0]
    steering.ahead, steering.across = known.ways[_EAST], known.ways[_NORTH]
    forces = steering.lateral, step.lateral_sum[k] / max(progress.updates, 1), step.lateral_peak[k]
    fill_path(steering, progress.position, forces, action[2], observation)


_HIDDEN = (
    "tip to the left of the line [mm]",
    "sine of the angle from the line to the crack [0.2]",
    "curvature of the line at the tip, to the left [25/m]",
    "blade to the left of the crack's course [2 mm]",
    "shift of the blade to the left per way along the crack that its stiffness asks for [1]",
    "stiffness across the crack over that along it [1]",
    "mean distance of the cut to the line so far over that of a success [1]",
    "largest distance of the cut to the line so far over that of a success [1]",
)
"""Names of the privileged features that the path adds."""
_MILLIMETRE = 0.001  # [m]


@njit
def hide(cuts: Cuts, which: StructArray, hidden: Array) -> None:
    """Fill path's privileged features for the cuts ``which``."""
    for m in range(len(which)):
        n = which[m]
        state, profile, task = cuts.states[n], cuts.profiles[n], cuts.tasks[n]
        steering, path = cuts.motions[n], cuts.wholes[n]
        i, share = grid_index(state.tip)
        t_x, t_y = lerp(steering.cosine, i, share), lerp(steering.sine, i, share)
        along = lerp(profile.stiffness, i, share) * steering.per_stretch**2
        hidden[m, 0] = steering.tip_aside / _MILLIMETRE
        hidden[m, 1] = (t_x * steering.tip_across - t_y * steering.tip_ahead) / 0.2
        hidden[m, 2] = lerp(steering.curvature, i, share) / 25.0
        hidden[m, 3] = steering.offset / (2.0 * _MILLIMETRE)
        hidden[m, 4] = 0.0 - steering.coupling * along / max(steering.side_stiffness, 1e-3 * along)
        hidden[m, 5] = steering.side_stiffness / along
        hidden[m, 6] = path.distance / (task.target * LINE_TOLERANCE)
        hidden[m, 7] = path.farthest / FARTHEST_TOLERANCE


PATH_ERRORS = (
    CutNumber(name="area_mm2", meaning="area between cut and line", value=lambda whole: 1e6 * whole.area),
    CutNumber(
        name="mean_distance_mm",
        meaning="mean distance between cut and line",
        value=lambda whole, tip: 1e3 * whole.distance / max(tip - whole.begun, 1e-9),
        glossary=(
            "Distance to the line",
            "How far the cut lies from the drawn line, on average along the cut and at the farthest place. A success "
            f"is off by at most {1e3 * LINE_TOLERANCE:g} mm on average and {1e3 * FARTHEST_TOLERANCE:g} mm anywhere, "
            "besides all that is said above.",
        ),
    ),
    CutNumber(
        name="largest_distance_mm",
        meaning="largest distance between cut and line",
        value=lambda whole: 1e3 * whole.farthest,
    ),
)
PATH_TRUTH = (
    CutNumber(
        name="blade_x_m",
        meaning="place of the blade along the slab",
        value=lambda state, motion: state.blade + motion.east,
    ),
    CutNumber(name="blade_y_m", meaning="place of the blade across it", value=lambda motion: motion.north),
    CutNumber(
        name="tip_x_m",
        meaning="place of the tip along the slab",
        value=lambda state, motion: (
            motion.settled + motion.tip_east + motion.tip_ahead * ((state.tip - motion.settled) * motion.stretch)
        ),
    ),
    CutNumber(
        name="tip_y_m",
        meaning="place of the tip across it",
        value=lambda state, motion: (
            motion.tip_north + motion.tip_across * ((state.tip - motion.settled) * motion.stretch)
        ),
    ),
    CutNumber(
        name="aside_m", meaning="distance of the tip to the left of the line", value=lambda motion: motion.tip_aside
    ),
)
PATH_CUT = Task(
    place=f"{__name__}:PATH_CUT",
    environment="cutenv/PathCut-v1",
    motion=STEERED,
    axis=ActionAxis(
        name="turn",
        meaning="rate of turn",
        command="turn_rate",
        scale=TURN_SCALE,
        shown="-1.5 to 1.5 (left)",
        unit="rad/s",
    ),
    components=PATH_COMPONENTS,
    costs=PATH_COSTS,
    quantities=OF_PATH,
    whole=PATH,
    counted=("lateral_sum", "lateral_peak"),
    expected=STEERING,
    measured=("blade_x", "blade_y", "lateral_force"),
    end="off_line",
    end_text="the cut is farther than ``line_limit`` from the line; an end for safety",
    shown_as="path",
    errors=PATH_ERRORS,
    truth=PATH_TRUTH,
    hidden=_HIDDEN,
    length=length,
    begin=begin,
    expect=expect,
    observe_start=observe_start,
    fetch=fetch,
    begin_step=begin_step,
    count=count,
    size=size,
    survey=survey,
    breached=breached,
    achieved=achieved,
    left_loaded=left_loaded,
    left_loaded_seen=left_loaded_seen,
    observe=observe,
    measure=measure,
    expect_at=expect_at,
    felt_along=felt_along,
    learn=learn,
    observe_seen=observe_seen,
    hide=hide,
)
"""Gentle cutting along a drawn line."""


# Length of line that a cut needs within the slab beyond its target, for the blade that leads the tip [m].
ROOM = LEAST_LENGTH - LONGEST


class LineChoice:
    """Choice of the line of every cut: a kind of line, "mixed", or the line.

    ``kind`` is the number of the kind, MIXED_LINES, or GIVEN_LINE.  ValueError if there is no such kind, or the line
    turns back, bends too far or leaves the slab.
    """

    def __init__(self, line: str | CutLine | ArrayLike) -> None:
        self.kind = GIVEN_LINE
        if isinstance(line, str):
            self.kind = (*KINDS, "mixed").index(one_of("line", line, (*KINDS, "mixed")))
        self._given = None if isinstance(line, str) else line if isinstance(line, CutLine) else through(line)
        self._drawn: DrawnLines | None = None

    def lines_for(self, tissue: TissueDescription) -> DrawnLines:
        """Return the lines to choose from, for the tissue's model."""
        plane = tissue.element, tissue.formulation, tissue.poisson
        if self._given is None:
            return drawn_lines(*plane)
        if self._drawn is None:
            self._drawn = given_line(self._given, *plane)
        return self._drawn

    def check(self, length: float) -> None:
        """Raise ValueError if a length [m] does not fit the line."""
        if self._given is None:
            if self.kind == _FUSIFORM and length > LONGEST:
                raise ValueError(
                    f"target_length = {length:g} m: a half of a fusiform excision is cut from end to end, 60 to 100 "
                    f"mm. Leave target_length out, or give at most {LONGEST:g} m."
                )
            return
        within = length_within(self._given)
        if within < length + ROOM - 1e-9:
            k = round(within * POINTS_PER_METRE)
            x, y = self._given.x[k], self._given.y[k]
            raise ValueError(
                f"The line leaves the slab at ({x:.4f}, {y:.4f}) m, after {1e3 * within:.0f} mm: a cut of "
                f"{1e3 * length:.0f} mm needs {1e3 * ROOM:.0f} mm more, for the blade that leads its tip. Give a "
                f"target_length of at most {within - ROOM:.3f} m, or another line."
            )


class PathOptions(TaskOptions):
    """Options of cutting along a drawn line.

    From the keywords of the environment ``line``, and the fields of :class:`PathConstants` and
    :class:`~cutenv.sim.cutting.steering.SteeringParameters` are removed.
    """

    names = ("line", *PathConstants.__dataclass_fields__, *SteeringParameters.__dataclass_fields__)
    task = PATH_CUT
    usual: ClassVar[str] = "mixed"  # kind of line where none is given

    def __init__(self, keywords: dict[str, Any]) -> None:
        super().__init__(keywords)
        self.line = LineChoice(keywords.pop("line", self.usual))
        if keywords.get("relaxing_share", 0.0) != 0.0:
            raise ValueError(
                f"relaxing_share = {keywords['relaxing_share']!r}: tissue that is cut along a line has only "
                "relaxing_share=0.0. Leave it out."
            )
        self.constants, self.steering = taken_from(keywords, PathConstants), taken_from(keywords, SteeringParameters)

    def check_length(self, length: float) -> None:
        """Raise ValueError if a length [m] does not fit the line."""
        self.line.check(length)

    def drawn_length(self, tissue: TissueDescription, seed: int, episode: int) -> float:
        """Return a key's target length [m], its line's or drawn."""
        return _length_of(*self.beginning(tissue), np.uint64(seed), np.uint64(episode))

    def whole(self) -> StructArray:
        """Return a path's initial record, :data:`PATH`, (1,)."""
        return settings_record(PATH, self.constants)

    def motion(self, specimen: Specimen) -> StructArray:
        """Return the initial place in the plane, :data:`~cutenv.sim.cutting.steering.STEERING`, (1,)."""
        record = np.zeros(1, STEERING)
        record["crack_curvature"] = self.steering.crack_curvature
        record["reach"], record["side"] = LINE_REACH, WIDTH
        record["response"] = record["waiting"] = round(self.steering.response_time / TICK)
        return record

    def expected(self, tissue: TissueDescription) -> StructArray:
        """Return the same of the mean tissue."""
        return self.motion(Specimen.mean(tissue))

    def beginning(self, tissue: TissueDescription) -> tuple[StructArray, int]:
        """Return what :func:`begin` takes."""
        return self.line.lines_for(tissue).records, self.line.kind

    def episode(self, plant: Any, goal: Goal, *, from_truth: bool | None = None) -> PathEpisode:
        """Return a new episode along a line."""
        return PathEpisode(plant, goal, self, from_truth=from_truth)


class PathEpisode(Episode):
    """An episode along a drawn line, with the true cut or the expected one."""

    options: PathOptions
    _before = (0.0, 0.0)

    def _measured(self, count: int) -> tuple[dict[str, Array], Array]:
        channels = {name: self.plant.channels[name].copy() for name in self.task.measured}
        return channels, _ways_of(channels, self.plant.heading.now)

    def step(self, action: Array) -> tuple[Array32, float]:
        """Command 3 numbers in [-1, 1] for one decision; return observation, (28,), and reward."""
        if self.simulated:
            self._before = self.blade_place
        return super().step(action)

    @property
    def channels(self) -> dict[str, Array]:
        """Blade places and lateral force since the last decision.

        Of a simulated cut the way is straight between two decisions, and the force true unless a rig sees the cut.
        """
        if not self.simulated:
            return super().channels
        ends = zip(PLACE, self._before, self.blade_place, strict=True)
        found = {name: np.linspace(start, end, self.updates + 1)[1:] for name, start, end in ends}
        return found | {"lateral_force": self.across[: self.updates].copy()}

    @property
    def line(self) -> CutLine:
        """The line to cut along."""
        return self.options.line.lines_for(self.goal.tissue).lines[int(self.whole["line"][0])]

    @property
    def noted(self) -> dict[str, Any]:
        """Target length and line by key of record metadata."""
        return super().noted | self.noted_line

    @property
    def cut_distance(self) -> Array:
        """Cut's distance left of the line at passed points [m], (n,)."""
        steering = self.motion[0]
        passed: Array = steering["cut"][: steering["cell"] + 1].copy()
        return passed

    @property
    def noted_line(self) -> dict[str, Any]:
        """Line by metadata key: places within the slab [m]."""
        from cutenv.records.scoring.cut_map import LINE_KEY

        return {LINE_KEY: np.round(places_within(self.line), 6).tolist()}

    @property
    def noted_map(self) -> dict[str, Any]:
        """Simulated path's notes by metadata key: errors, line, cut [m]."""
        from cutenv.records.scoring.truth import ASIDE_AT_END

        errors = {name: round(value, 3) for name, value in self.errors.items()}
        return errors | self.noted_line | {ASIDE_AT_END: np.round(self.aside_to_tip, 6).tolist()}

    @property
    def blade_place(self) -> tuple[float, float]:
        """Place of the blade, along and across the slab [m]."""
        return place_of_blade(self._cuts.states, self._cuts.motions)

    @property
    def tip_place(self) -> tuple[float, float]:
        """Crack tip along and across the slab [m]; hidden."""
        return place_of_tip(self._cuts.states, self.motion)

    @property
    def shown_path(self) -> ShownPath:
        """Path as a picture shows it."""
        line, steering, aside = self.line, self.motion[0], self.cut_distance[:, np.newaxis]
        drawn, passed = np.column_stack((line.x, line.y)), slice(0, len(aside))
        left = np.column_stack((-np.sin(line.angle), np.cos(line.angle)))[passed]
        tip = np.array(self.tip_place)
        return ShownPath(
            drawn, round(self.target_length / SPACING), np.concatenate((drawn[passed] + aside * left, [tip])), tip,
            np.array(self.blade_place), np.array([steering["ahead"], steering["across"]]), float(steering["aside"]),
        )  # fmt: skip

    @property
    def aside_to_tip(self) -> Array:
        """Cut's distance left of the line, straight on since its turn, to the tip [m], (n,)."""
        steering, tip, passed = self.motion[0], self.tip, self.cut_distance
        more = np.arange(len(passed), int(tip / SPACING) + 1)
        if len(more) == 0:
            return passed
        line, grid = self.line, np.arange(len(self.line.x)) * SPACING
        x, y, angle = (float(np.interp(tip, grid, each)) for each in (line.x, line.y, line.angle))
        east, north = self.tip_place
        end = (north - y) * np.cos(angle) - (east - x) * np.sin(angle)
        share = (more * SPACING - steering["settled"]) / (tip - steering["settled"])
        return np.append(passed, steering["tip_aside"] + (end - steering["tip_aside"]) * share)


def _ways_of(channels: dict[str, Array], heading: float) -> Array:
    """Return places, heading [rad] and lateral forces for the task, (n, WAYS)."""
    ways = np.zeros((len(channels["lateral_force"]), WAYS))
    ways[:, _X], ways[:, _Y], ways[:, _LATERAL] = (channels[name] for name in (*PLACE, "lateral_force"))
    ways[:, _EAST], ways[:, _NORTH] = math.cos(heading), math.sin(heading)
    return ways


def to_path_action(speed: float, angle: float, turn_rate: float) -> Array32:
    """Return a clipped action, (3,), for speed [m/s], angle [rad], left turn [rad/s]."""
    turn = speed_action(turn_rate * (SPEED_SCALE / TURN_SCALE))
    return np.append(to_action(speed, angle), np.float32(np.clip(turn, -1.0, 1.0))).astype(np.float32)
