"""Assessment of a cut's depth from what a rig measures: forces along and upwards, position and level of the blade.

Tip and floor of the cut are hidden.  The tip is estimated from the force, with the stiffness of the mean tissue at the
depth to which the blade is engaged; the floor is that which the mean tissue would have under this blade
(:func:`cutenv.tissue.floor.follow_floor`).  No layer below is known, and none is charged.
"""

from __future__ import annotations

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.intrinsics import as_float64_view
from cutenv._engine.jit import njit, njit_internal
from cutenv._engine.lanes import first_row
from cutenv._engine.randomness import Integer
from cutenv.cutting.descent import held_depth
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.law import depth_at
from cutenv.task.assessment import add_terms, begin_count, conclude, count_lane, succeeded
from cutenv.task.depth_assessment import as_deep_as_wanted, charge_depth, fill_depth, survey
from cutenv.task.depth_cuts import terms_of
from cutenv.task.tip_estimation import estimated_tip
from cutenv.task.wanted_depth import AT_LEVEL, draw_layer, draw_wanted
from cutenv.tissue.crack_tip import ESTIMATED_EVERY
from cutenv.tissue.floor import FLOOR_EVERY, follow_floor
from cutenv.tissue.grid import N_POINTS, POINTS_PER_METRE
from cutenv.tissue.nominal import nominal_stiffness

_RESPONSE = round(FLOOR_EVERY / TICK)
_EVERY = round(ESTIMATED_EVERY / TICK)
_AHEAD = 3  # cells ahead of the blade that it may reach until the tip is estimated again


@njit
def expect_depth(
    descents: StructArray, depths: StructArray, measured: Array, target: float, kind: int, key: tuple[Integer, Integer],
) -> float:  # fmt: skip
    """Begin the wanted depth and the expected floor of one cut at the clamp; return the level of the blade there [m].

    Parameters
    ----------
    descents, depths : Records, shape (1,)
        :data:`~cutenv.cutting.descent.DESCENT` of the mean tissue and :data:`~cutenv.task.depth_terms.DEPTH`, changed.
    measured : array, shape (301,)
        Depth of cut at level 0, as measured beforehand [m].
    target : float
        Length to cut [m].
    kind, key : int, tuple of int
        Kind of wanted depth; seed and episode.
    """
    descent, depth = descents[0], depths[0]
    for i in range(N_POINTS):
        descent.surface[i] = descent.floor[i] = measured[i]
        depth.counted[i] = -1.0
        depth.wanted[i] = measured[i]
    depth.level_wanted = 1 if kind == AT_LEVEL else 0
    if kind != AT_LEVEL:
        draw_wanted(key[0], key[1], kind, target, depth.wanted)
    level: float = 0.0 if kind == AT_LEVEL else measured[0] - depth.wanted[0]
    descent.level = descent.engaged = descent.floor[0] = level
    survey(depth, descent, 0.0)
    return level


@njit
def drawn_layer(descents: StructArray, wanted: Array, key: tuple[Integer, Integer]) -> None:
    """Put the layer of this key below the ``wanted`` depth [m], shape (301,), into ``descents``, shape (1,)."""
    draw_layer(key[0], key[1], wanted, descents[0])


@njit
def observe_depth_at_rest(
    descents: StructArray, depths: StructArray, measured: StructArray, observation: StructArray
) -> None:
    """Fill what depth adds to the observation at the clamp: the blade at rest, force tared to zero."""
    fill_depth(depths[0], descents[0], measured[0], 0.0, (0.0, 0.0, 0.0), 0.0, observation)


@njit
def assess_depth_readings(
    episodes: StructArray, descents: StructArray, depths: StructArray, measured: StructArray, nominals: StructArray,
    readings: StructArray, heights: Array, vertical: Array, action: StructArray, observation: StructArray,
) -> tuple[float, int]:  # fmt: skip
    """Assess and observe a rig's readings since the last decision; tip, runs and floor are estimates.

    Parameters
    ----------
    episodes : Records, shape (1,)
        :data:`cutenv.task.cuts.EPISODE`, changed; its profile becomes that at the depth to which the blade is engaged.
    descents, depths : Records, shape (1,)
        As :func:`expect_depth` has begun them; changed.
    measured, nominals : Records, shape (1,)
        The profile at level 0, :data:`~cutenv.cutting.dtypes.PROFILE`; the mean tissue,
        :data:`~cutenv.tissue.nominal.NOMINAL`.
    readings : Records, shape (n,)
        :data:`~cutenv.cutting.dtypes.READING`; those after an end do not count.
    heights, vertical : array, shape (n,)
        Level of the blade [m] and vertical force [N] at each reading.
    action, observation : array, shape (3,), (22,) float32
        The step's action; the observation, filled.

    Returns
    -------
    reward, end : float, int
        The latter an index in :data:`~cutenv.task.reward.ENDS`.
    """
    e, descent, depth = episodes[0], descents[0], depths[0]
    count, task, progress, profile, known = first_row(e.counts), e.tasks[0], e.progresses[0], e.nominals[0], e.tips[0]
    begin_count(count, 0, task, progress)
    lowest, level_before = min(progress.position, known.tip), descent.level
    felt = angle = now = total = 0.0
    largest, used = -1e9, 0
    for i in range(len(readings)):
        reading = readings[i]
        felt, angle, position = reading.force, reading.angle, reading.position
        tick = round(count.time[0] / TICK) + 1
        descent.level, now = heights[i], vertical[i]
        if i == 0 or tick % _EVERY == 0:
            _engage(profile, nominals[0], descent, position)
        tip, jump = estimated_tip(known, task, profile, tick, position, reading.speed, felt)
        if tick % _RESPONSE == 0:
            follow_floor(descent, position, tip)
        count_lane(count, 0, position, reading.speed, felt, felt, tip, jump, depth_at(profile, position))
        total, largest, used = total + now, max(largest, now), used + 1
        lowest = min(lowest, position, tip)
        if count.end[0] != 0:
            break
    survey(depth, descent, lowest - descent.edge_length)
    charge_depth(depth, task.target)
    info = e.infos[0]
    conclude(count, 0, task, progress, profile, measured[0], felt, angle, action, info, observation)
    depth.success = 1 if succeeded(task, progress) and as_deep_as_wanted(depth, task.target) else 0
    if depth.success == 0:
        info.reward_terms_success = 0.0
    descent.level_speed = (descent.level - level_before) / (max(used, 1) * TICK)
    if used > _RESPONSE:
        descent.level_speed = (descent.level - heights[used - 1 - _RESPONSE]) / (_RESPONSE * TICK)
    forces = now, total / max(used, 1), largest
    fill_depth(depth, descent, measured[0], progress.position, forces, action[2], observation)
    return add_terms(as_float64_view(e.infos), e.totals) + terms_of(depth), progress.end


@njit_internal
def _engage(profile: Struct, nominal: Struct, descent: Struct, position: float) -> None:
    """Let the profile around tip and blade be that of the mean tissue at the depth to which the blade is engaged."""
    last = min(int(max(position, 0.0) * POINTS_PER_METRE) + _AHEAD, N_POINTS - 1)
    for k in range(max(min(descent.cell, last) - 1, 0), last + 1):
        engaged = descent.level if k > descent.cell else max(descent.level, descent.floor[k])
        depth = held_depth(descent, descent.surface[k] - engaged)
        profile.depth[k] = depth
        profile.stiffness[k] = nominal_stiffness(nominal, k, depth)
        profile.toughness[k] = nominal.toughness_per_depth * depth
