"""Assessment of a cut along a line from what a rig measures: forces in the plane, and the place of the blade.

The cut is hidden.  How far it has come along the line is estimated from the force along the blade, with the stiffness
of the mean tissue; beside the line it runs where a crack of that length would run in mean tissue behind this blade,
as a record is scored (:mod:`cutenv.tissue.expected_cut`).  A crack that only turned toward the measured force would
drift away from the blade by the errors of that force.
"""

from __future__ import annotations

import math

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.intrinsics import as_float64_view
from cutenv._engine.jit import njit, njit_internal
from cutenv._engine.lanes import first_row
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.law import depth_at, grid_index, lerp
from cutenv.cutting.steered_row import turned
from cutenv.cutting.steering import CrackFrame, advance_tip, frame_at
from cutenv.cutting.steering_start import lay_line, stand_on_line
from cutenv.task.assessment import add_terms, begin_count, conclude, count_lane, succeeded
from cutenv.task.path_assessment import UNFELT_ASIDE, charge_path, near_enough, observe_path, survey_path
from cutenv.task.path_cuts import terms_of_path
from cutenv.task.path_terms import OFF_LINE
from cutenv.task.reward import ENDS, SAFETY_ENDS, WORST_STORED
from cutenv.task.tip_estimation import estimated_tip
from cutenv.tissue.crack_tip import ESTIMATED_EVERY

_EVERY = round(ESTIMATED_EVERY / TICK)
_SAFETY = ENDS.index("force_limit")  # whose charges an end off the line shares, as in the simulator
_SAFETY_CODES = max(ENDS.index(name) for name in SAFETY_ENDS)  # the ends for safety are the first ones
_STORED_LENGTH = 0.003  # [m], as in the term "stored"
_STEP = 0.0002  # [m] of line after which the expected crack turns, as in cutenv.tissue.expected_cut


@njit
def expect_path(
    profiles: StructArray, steerings: StructArray, paths: StructArray, lines: StructArray, number: int
) -> None:
    """Lay the line with this ``number`` into the mean tissue's profile; begin the expected crack at the clamp.

    Parameters
    ----------
    profiles, steerings, paths : Records, shape (1,)
        :data:`~cutenv.cutting.dtypes.PROFILE`, :data:`~cutenv.cutting.steering.STEERING` and
        :data:`~cutenv.task.path_terms.PATH_MAP`, changed.
    lines : Records
        :data:`~cutenv.tissue.drawn_lines.LINE`.
    """
    lay_line(profiles[0], steerings[0], lines[number])
    stand_on_line(profiles[0], steerings[0], 0.0)
    paths[0].line = number
    survey_path(paths[0], steerings[0], 0.0)


@njit
def observe_path_at_rest(
    steerings: StructArray, paths: StructArray, sensors: StructArray, observation: StructArray
) -> None:
    """Fill what the path adds to the observation at the clamp: the blade at rest, forces tared to zero."""
    observe_path(paths[0], steerings[0], sensors[0], 0, 0, 0.0, UNFELT_ASIDE, 0.0, observation)


@njit
def assess_path_readings(
    episodes: StructArray, steerings: StructArray, paths: StructArray, measured: StructArray, sensors: StructArray,
    readings: StructArray, places: Array, lateral: Array, heading: tuple[float, float], action: StructArray,
    observation: StructArray,
) -> tuple[float, int]:  # fmt: skip
    """Assess and observe a rig's readings since the last decision; tip, runs and path of the cut are estimates.

    Parameters
    ----------
    episodes, steerings, paths : Records, shape (1,)
        :data:`cutenv.task.cuts.EPISODE`, and what :func:`expect_path` has begun; changed.
    measured : Records, shape (1,)
        The profile with the depth measured beforehand.
    sensors : Records, shape (1,)
        :data:`~cutenv.cutting.sensor.SENSOR`, whose noise is not used.
    readings : Records, shape (n,)
        :data:`~cutenv.cutting.dtypes.READING` with arc lengths of the line and forces along the blade; those after an
        end do not count.
    places, lateral : array, shape (n, 2), (n,)
        Place of the blade along and across the slab [m] and force to its right [N] at each reading.
    heading : tuple of float
        Direction of the blade after the last reading: cosine and sine of its angle to the axis of the slab.
    action, observation : array, shape (3,), (28,) float32
        The step's action; the observation, filled.

    Returns
    -------
    reward, end : float, int
        The latter an index in :data:`~cutenv.task.path_terms.PATH_ENDS`.
    """
    e, steering, path = episodes[0], steerings[0], paths[0]
    count, task, progress, profile, known = first_row(e.counts), e.tasks[0], e.progresses[0], e.nominals[0], e.tips[0]
    begin_count(count, 0, task, progress)
    felt = angle = tip = total = largest = 0.0
    for i in range(len(readings)):
        reading = readings[i]
        felt, angle, position = reading.force, reading.angle, reading.position
        tick = round(count.time[0] / TICK) + 1
        steering.east, steering.north, steering.lateral = places[i, 0] - position, places[i, 1], lateral[i]
        tip, jump = estimated_tip(known, task, profile, tick, position, reading.speed, felt)
        if tick % _EVERY == 0:
            _follow_crack(steering, position, tip)
        force = math.sqrt(felt * felt + lateral[i] * lateral[i])
        count_lane(count, 0, position, reading.speed, force, felt, tip, jump, depth_at(profile, position))
        total, largest = total + lateral[i], max(largest, abs(lateral[i]))
        if count.end[0] != 0:
            break
    steering.ahead, steering.across = heading
    survey_path(path, steering, tip)
    charge_path(path, task.target)
    lost = path.farthest > path.line_limit and (count.end[0] == 0 or count.end[0] > _SAFETY_CODES)
    if lost:
        count.end[0] = _SAFETY
    info = e.infos[0]
    conclude(count, 0, task, progress, profile, measured[0], felt, angle, action, info, observation)
    if progress.end != 0:
        _charge_held(steering, profile, task, info, progress.position, tip)
    path.success = 1 if succeeded(task, progress) and near_enough(path, task.target) else 0
    if path.success == 0:
        info.reward_terms_success = 0.0
    progress.end = OFF_LINE if lost else progress.end
    observe_path(
        path, steering, sensors[0], 0, progress.updates, progress.position, (total, largest), action[2], observation
    )
    return add_terms(as_float64_view(e.infos), e.totals) + terms_of_path(path), progress.end


@njit_internal
def _follow_crack(steering: Struct, position: float, tip: float) -> None:
    """Let the expected crack grow to ``tip`` [m] of the line, turning toward the force of a blade at ``position``."""
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
    """Return the offset of the blade from the settled tip, along the crack and to its left [m]; stiffness there."""
    east = (position - steering.settled) + (steering.east - steering.tip_east)
    north, e_x, e_y = steering.north - steering.tip_north, steering.tip_ahead, steering.tip_across
    i, share = grid_index(steering.settled)
    return east * e_x + north * e_y, north * e_x - east * e_y, frame_at(steering, i, share)


@njit_internal
def _charge_held(steering: Struct, profile: Struct, task: Struct, info: Struct, position: float, tip: float) -> None:
    """Charge tissue that is left loaded at an end, to the side too."""
    _, left, frame = _offset(steering, position)
    lag, (i, share) = max(position - tip, 0.0), grid_index(tip)
    if lag > 0.0:
        stored = 0.5 * lerp(profile.stiffness, i, share) * lag * lag + 0.5 * frame.side_stiffness * left * left
        toughness = lerp(profile.toughness, i, share)
        info.reward_terms_stored = 0.0 - task.stored * min(stored / (toughness * _STORED_LENGTH), WORST_STORED)
