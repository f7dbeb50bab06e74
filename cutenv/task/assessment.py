"""Assessment of a cut: reward, ends, observation, info.

It is done every millisecond, so that nothing is missed between decisions.

The functions that do it are put together from the declarations of :mod:`cutenv.task.reward`,
:mod:`cutenv.task.observation` and :mod:`cutenv.task.info`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.declared import expression, fuse
from cutenv._engine.intrinsics import first_row
from cutenv._engine.jit import njit, njit_fused, njit_inline
from cutenv._engine.randomness import Integer
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.cutting.law import account, depth_at, stiffness_at, toughness_at
from cutenv.sim.cutting.row import LANES
from cutenv.sim.quantities import ANGLE_TOLERANCE, SHALLOWEST, TIP_TOLERANCE, lag, tip_error
from cutenv.sim.tissue.grid import N_POINTS, POINTS_PER_METRE
from cutenv.task import info, observation, reward
from cutenv.task.info import INFO_FIELDS, column
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE, CLIP, COMPONENTS
from cutenv.task.reward import CUT_ENDS, ENDS, OF_MILLISECOND, REWARD

NEAR_TARGET = 0.010  # distance from the target to which the blade must have come before the task can be finished [m]
SPEED_AT_REST = 0.5e-3  # speed below which the blade counts as at rest [m/s]
FORCE_UNLOADED = 0.1  # force above friction below which the blade counts as unloaded [N]

_FINISHED = ENDS.index("finished")
_DECLARED: dict[str, tuple[Any, ...]] = {"reward": REWARD, "seen": COMPONENTS, "info": INFO_FIELDS}
"""Tables whose entries add up something at every millisecond."""
_TOTALS: dict[str, Any] = {
    f"{table}_{entry.name}": entry
    for table, entries in _DECLARED.items()
    for entry in entries
    if entry.each is not None or getattr(entry, "fold", None) is not None
}
"""Entries with a total, by the name of its accumulator."""


def count_dtype(lanes: int) -> np.dtype[Any]:
    """Return the dtype of a row's step accumulators, per lane."""
    whole = {name: "i8" for name, entry in _TOTALS.items() if getattr(entry, "whole", False)}
    fields = [
        ("position", "f8"),  # memory between milliseconds, see PROGRESS
        ("touched", "i8"),
        ("furthest", "f8"),
        ("time", "f8"),
        ("quiet", "f8"),
        ("loaded_at", "f8"),
        ("tip", "f8"),
        ("speed", "f8"),
        ("end", "i8"),
        ("updates", "i8"),
        ("target", "f8"),  # limits of the task, see TASK
        ("deadline", "f8"),
        ("force_limit_per_depth", "f8"),
        ("friction_per_depth", "f8"),
        ("speed_min", "f8"),
        ("speed_max", "f8"),
        *((name, whole.get(name, "f8")) for name in _TOTALS),
    ]
    return np.dtype((np.record, [(name, kind, (lanes,)) for name, kind in fields]))


COUNT = count_dtype(LANES)  # accumulators of a row of a batch
COUNT_ONE = count_dtype(1)  # accumulators of a single cut


def _fused(name: str, parameters: Iterable[str], lines: Iterable[str]) -> Any:
    return njit_fused(fuse(name, list(parameters), list(lines), [reward, observation, info, __name__]))


def _start_lines() -> list[str]:
    return [
        f"count.{name}[k] = {repr(getattr(entry, 'start', 0)).replace('inf', 'math.inf')}"
        for name, entry in _TOTALS.items()
    ]


def _add_lines() -> list[str]:
    lines = []
    for name, entry in _TOTALS.items():
        total = f"count.{name}[k]"
        if entry.each is not None:
            lines.append(f"{total} += {expression(entry.each, OF_MILLISECOND)}")
        else:
            lines.append(f"{total} = {expression(entry.fold, OF_MILLISECOND, {'total': total})}")
    return lines


def _end_lines() -> list[str]:
    ended = "0"
    for code, end in reversed(list(enumerate(CUT_ENDS, start=1))):
        ended = f"{code} if {expression(end.when, OF_MILLISECOND)} else ({ended})"
    return [f"count.end[k] = {ended}"]


def _charge_lines() -> list[str]:
    lines = []
    for term in REWARD:
        words = {"weight": f"task.{term.name}", "total": f"count.reward_{term.name}[k]"}
        charged = "0.0"
        if term.gain is not None:
            charged = expression(term.gain, reward.OF_STEP, words)
        elif term.cost is not None:
            charged = f"0.0 - {expression(term.cost, reward.OF_STEP, words)}"
        lines.append(f"info.reward_terms_{term.name} = {charged}")
    return lines


def _charge_end_lines() -> list[str]:
    """Generate lines that charge an end's gains, costs and safety cost."""
    lines: list[str] = []
    passing: list[str] = []
    final: list[str] = []
    for term in REWARD:
        words = {"weight": f"task.{term.name}"}
        if term.end_gain is not None:
            lines.append(f"info.reward_terms_{term.name} += {expression(term.end_gain, reward.OF_END, words)}")
        if term.end_cost is not None:
            lines.append(f"info.reward_terms_{term.name} -= {expression(term.end_cost, reward.OF_END, words)}")
        if term.largest is not None:
            (final if term.end_cost is not None else passing).append(expression(term.largest, reward.OF_STEP, words))
    safety = " or ".join(f"progress.end == {ENDS.index(name)}" for name in reward.SAFETY_ENDS)
    lines += [f"if {safety}:", *(f"    info.reward_terms_safety -= {cost}" for cost in passing)]
    return [*lines, f"    info.reward_terms_safety -= {' + '.join(final)}"]


def _stored_lines() -> list[str]:
    (term,) = (term for term in REWARD if term.name == "stored")
    assert term.end_cost is not None
    cost = expression(term.end_cost, reward.OF_END, {"weight": f"task.{term.name}"})
    return [f"info.reward_terms_{term.name} = 0.0 - {cost}"]


def _observe_lines() -> list[str]:
    lines = []
    for number, one in enumerate(COMPONENTS):
        words = {"total": f"count.seen_{one.name}[k]"}
        value = one.name if one.value is None else expression(one.value, observation.QUANTITIES, words)
        scaled = f"({value} - {one.offset!r}) / {one.scale!r}"
        lines.append(f"observation[{number}] = min(max({scaled}, {-CLIP}), {CLIP})")
    return lines


def _info_lines(groups: set[str], quantities: Iterable[str]) -> list[str]:
    return [
        f"info.{column(field)} = {expression(field.value, set(quantities), {'total': f'count.info_{field.name}[k]'})}"
        for field in INFO_FIELDS
        if field.value is not None and field.group in groups
    ]


_start = _fused("_start", ("count", "k"), _start_lines())
_add = _fused("_add", ("count", "k", *OF_MILLISECOND), [*_add_lines(), *_end_lines()])
_charge = _fused(
    "_charge",
    ("count", "k", "task", *reward.OF_STEP, "info"),
    [*_charge_lines(), *_info_lines({"cost_terms", ""}, info.OF_COST)],
)
_charge_end = _fused("_charge_end", ("task", "progress", *reward.OF_END, "info"), _charge_end_lines())
_charge_stored = _fused("_charge_stored", ("task", "stored", "toughness", "info"), _stored_lines())
_fill = _fused("_fill", ("count", "k", *observation.QUANTITIES, "observation"), _observe_lines())
_tell = _fused(
    "_tell",
    ("state", "law", "task", "energy", "modulus", "resistance", "info"),
    _info_lines({"truth", "energy"}, info.OF_INFO),
)

N_FIELDS = np.int64(len(INFO_FIELDS))
_TERMS = info.PLACES["reward_terms"]
_FIRST_TERM, _LAST_TERM = np.int64(_TERMS.start), np.int64(_TERMS.stop)


@njit_inline
def begin_count(count: Struct, k: Integer, task: Struct, progress: Struct) -> None:
    """Prepare the accumulators of lane ``k`` for a step."""
    count.position[k], count.touched[k], count.furthest[k] = progress.position, progress.touched, progress.furthest
    count.time[k], count.quiet[k], count.tip[k] = progress.time, progress.quiet, progress.tip
    count.loaded_at[k] = progress.loaded_at
    count.end[k], count.updates[k] = 0, 0
    count.target[k], count.deadline[k] = task.target, task.deadline
    count.force_limit_per_depth[k], count.friction_per_depth[k] = task.force_limit_per_depth, task.friction_per_depth
    count.speed_min[k], count.speed_max[k] = task.speed_min, task.speed_max
    _start(count, k)


class Millisecond(NamedTuple):
    """A millisecond of a cut, as it is counted."""

    position: float  # position of the blade [m]
    velocity: float  # velocity of the blade [m/s]
    force: float  # force on the blade, true or measured [N]
    felt: float  # measured force [N]
    held: float
    """Force with which the tissue holds the blade [N]: measured, and where it has a part across the cut, their norm."""
    tip: float  # crack tip, true or estimated [m]
    jump: float  # unstable growth, true or estimated [m]
    depth: float  # depth of cut at the blade [m]


@njit_inline
def norm_held(felt: float, across: float, pull: float) -> float:
    """Return the force with which tissue holds a blade [N].

    ``felt`` and ``across`` are the parts along the blade and across it, ``pull`` is that along the cut: where it is
    negative, a blade that is drawn back feels friction.
    """
    back = max(pull, 0.0)
    return math.sqrt(back * back + max((felt * felt - pull * pull) + across * across, 0.0))


@njit_inline
def count_lane(count: Struct, k: Integer, now: Millisecond) -> None:
    """Count a millisecond of lane ``k``, setting ``count.end`` (:data:`~cutenv.task.reward.ENDS`)."""
    position, velocity, force, felt, held, tip, jump, depth = now
    moved, speed, size = position - count.position[k], abs(velocity), abs(force)
    depth = max(depth, SHALLOWEST)
    furthest = max(count.furthest[k], position)
    unloaded = held < count.friction_per_depth[k] * depth + FORCE_UNLOADED
    may_finish = unloaded and furthest >= count.target[k] - NEAR_TARGET
    resting = may_finish and speed < SPEED_AT_REST
    loaded_at = count.loaded_at[k] if may_finish else position
    time, quiet = count.time[k] + TICK, count.quiet[k] + TICK if resting else 0.0
    _add(
        count, k, felt, size, count.force_limit_per_depth[k] * depth, depth, position, moved, speed, tip, jump,
        count.touched[k], time, quiet, loaded_at - position, count.target[k], count.deadline[k], count.speed_min[k],
        count.speed_max[k],
    )  # fmt: skip
    count.touched[k] = 1 if position > tip else count.touched[k]
    count.position[k], count.speed[k], count.tip[k] = position, velocity, tip
    count.furthest[k], count.time[k], count.quiet[k] = furthest, time, quiet
    count.loaded_at[k] = loaded_at
    count.updates[k] += 1


@njit_inline
def conclude(stepping: Any, k: Integer, action: StructArray, observation: StructArray, info: Struct) -> None:
    """Conclude lane ``k``'s step: reward terms, progress and observation.

    ``stepping`` is a row of cuts (:class:`cutenv.task.declare.Stepping`); :data:`~cutenv.task.reward.PROGRESS` of the
    lane's cut is changed, the observation, (12,), and the terms and cost of :data:`~cutenv.task.info.INFO` are filled.
    """
    cuts, row, count = stepping.cuts, stepping.row, stepping.count
    c = row.cut[k]
    task, progress, measured = cuts.tasks[c], cuts.progresses[c], cuts.nominals[c]
    tip_before, tip, angle = progress.tip, count.tip[k], row.angle[k]
    progress.position, progress.touched, progress.furthest = count.position[k], count.touched[k], count.furthest[k]
    progress.time, progress.quiet, progress.end = count.time[k], count.quiet[k], count.end[k]
    progress.loaded_at = count.loaded_at[k]
    progress.tip, progress.angle, progress.updates = tip, angle, count.updates[k]
    time_left = max(task.deadline - progress.time, 0.0)
    _charge(count, k, task, progress.updates, task.target, tip, tip_before, time_left, info)
    _fill(
        count, k, row.felt[k], progress.updates, progress.position, count.speed[k], angle,
        depth_at(measured, progress.position), progress.time, task.target, task.deadline, action[0], action[1],
        observation,
    )  # fmt: skip


@njit
def succeeded(task: Struct, progress: Struct) -> bool:
    """Return True for a finished cut within 3 mm of the target, upright within 10 degrees."""
    near = tip_error(progress.tip, task.target) <= TIP_TOLERANCE
    upright = abs(0.5 * math.pi - progress.angle) <= ANGLE_TOLERANCE
    success: bool = progress.end == _FINISHED and near and upright
    return success


@njit
def charge_end(task: Struct, progress: Struct, profile: Struct, info: Struct) -> None:
    """Charge an end's terminal and safety cost; add a success's gain."""
    tip = progress.tip
    stored = 0.5 * stiffness_at(profile, tip)[0] * lag(progress.position, tip) ** 2
    _charge_end(
        task, progress, progress.updates, task.target, tip, tip, max(task.deadline - progress.time, 0.0),
        progress.angle, stored, toughness_at(profile, tip), 1.0 if succeeded(task, progress) else 0.0, info,
    )  # fmt: skip


@njit_inline
def reward_of(numbers: StructArray, cut: Integer) -> float:
    """Return a step's reward from infos as a flat float64 view."""
    total = 0.0
    for k in range(_FIRST_TERM, _LAST_TERM):
        total += numbers[N_FIELDS * cut + k]
    return total


@njit_inline
def add_terms(numbers: StructArray, totals: StructArray) -> float:
    """Add a step's reward terms to ``totals``; return the reward."""
    for k in range(len(totals)):
        totals[k] += numbers[_FIRST_TERM + k]
    return reward_of(numbers, 0)


@njit_inline
def tell(cuts: Any, c: Integer, info: Struct) -> None:
    """Fill an info's record with cut ``c``'s hidden state and energies."""
    state, specimen = cuts.states[c], cuts.specimens[c]
    place = min(int(state.tip * POINTS_PER_METRE + 0.5), N_POINTS - 1)
    _tell(
        state, cuts.laws[c], cuts.tasks[c], account(state, cuts.profiles[c]), specimen.modulus[place],
        specimen.fracture_resistance[place], info,
    )  # fmt: skip


@njit_inline
def observe_rest(counts: StructArray, cuts: Any, c: Integer, angle: float, observation: StructArray) -> None:
    """Fill the observation of a blade at rest, force tared."""
    task, position = cuts.tasks[c], cuts.progresses[c].position
    _fill(
        first_row(counts), 0, 0.0, 1, position, 0.0, angle, depth_at(cuts.nominals[c], position), 0.0, task.target,
        task.deadline, 0.0, (angle - ANGLE_CENTRE) / ANGLE_SCALE, observation,
    )  # fmt: skip


@njit_inline
def charge_stored(task: Struct, energy: float, toughness: float, info: Struct) -> None:
    """Charge an end for ``energy`` [J] stored at ``toughness`` R B [N]."""
    _charge_stored(task, energy, toughness, info)
