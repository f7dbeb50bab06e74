"""Movements by which the law repeats a cut, and an expert's way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import Array, StructArray, joined_records
from cutenv.agents.policy.shipped import ORACLE, shipped
from cutenv.task.registry import TASKS

MOVEMENTS = "movements"
"""Key of a record's metadata: the movements of the hand, :func:`in_runs`."""
_STEP = 0.02  # [s], between the moments of a way
_MOST_SHOWN = 20
_HELD = 16  # ms for which a hand stays, as a pointer does from picture to picture
_FIELDS: Mapping[str, int] = {"time": 3, "position": 6, "angle": 4, "force": 3, "tip": 6}
"""Fields of a way, and their decimals; SI units."""
_FURTHER: Mapping[str, int] = {"height": 6, "blade_x": 6, "blade_y": 6}


def in_runs(movements: Array) -> list[list[float]]:
    """Run-length encode movements, given as a row each millisecond.

    A pointer moves once for each picture, so that a run has some 16 rows.  The numbers are not changed.
    """
    rows = np.asarray(movements, np.float64)
    if not len(rows):
        return []
    first = np.flatnonzero(np.append(True, (rows[1:] != rows[:-1]).any(axis=1)))
    counts = np.diff(np.append(first, len(rows)))
    return [[count, *row] for count, row in zip(counts.tolist(), rows[first].tolist(), strict=True)]


def from_runs(runs: Sequence[Sequence[float]]) -> Array:
    """Return the movements, shape (n, k), of :func:`in_runs`; ValueError if damaged."""
    table = np.array(runs, np.float64)
    if table.ndim != 2 or table.shape[1] < 3 or not np.isfinite(table).all() or not (table[:, 0] >= 1.0).all():
        raise ValueError("the movements of this record are damaged.")
    return np.repeat(table[:, 1:], table[:, 0].astype(int), axis=0)


def way_of(readings: StructArray, further: Mapping[str, Array]) -> dict[str, list[float]]:
    """Return times, places and forces, thinned to 50 Hz [SI], and known ``further`` fields."""
    time = readings["time"]
    moments = np.unique(np.append(np.searchsorted(time, np.arange(time[0], time[-1], _STEP)), len(time) - 1))
    columns = {name: readings[name] for name in _FIELDS}
    columns |= {name: values for name, values in further.items() if name in _FURTHER}
    digits = {**_FIELDS, **_FURTHER}
    return {name: np.round(values[moments], digits[name]).tolist() for name, values in columns.items()}


def kind_of_expert(expert: str) -> str:
    """Return by which words a page calls an expert: those of the "planner", or of an "agent"."""
    return "planner" if expert == ORACLE else "agent"


@lru_cache(256)
def expert_way(
    specimen_class: str,
    seed: int,
    episode: int,
    target_length: float | None = None,
    *,
    task: str = "gentle",
    line: str | None = None,
    tissue: str | Path | None = None,
    expert: str = ORACLE,
) -> dict[str, list[float]]:
    """Return the :func:`way_of` one of the :func:`~cutenv.agents.policy.experts`.

    It takes some seconds. The blade is on a drive.
    """
    known = TASKS[task]
    policy: Any = known.planner() if expert == ORACLE else shipped(expert)
    arguments: dict[str, Any] = {} if line is None else {"line": line}
    arguments |= {} if expert == ORACLE else policy.environment_arguments
    env = known.single(specimen_class=specimen_class, target_length=target_length, tissue=tissue, **arguments)
    observation, _ = env.reset(seed=seed, options={"episode": episode})
    policy.reset(np.random.default_rng(seed))
    if expert == ORACLE:
        policy.set_state(env.cutting)
    parts, further, ended = [], [], False
    while not ended:
        observation, _, ended, _, _ = env.step(policy(observation))
        parts.append(env.cutting.readings.copy())
        further.append({name: values.copy() for name, values in env.cutting.channels.items()})
    joined = {name: np.concatenate([each[name] for each in further]) for name in further[0]}
    return way_of(joined_records(parts), joined)


@lru_cache(64)
def shown_cut(
    specimen_class: str,
    target_length: float | None = None,
    *,
    task: str = "gentle",
    line: str | None = None,
    tissue: str | Path | None = None,
) -> tuple[int, list[list[float]]]:
    """Return seed and movements of a successful demonstration cut.

    It takes some seconds. The hand sees the tip. It is of the first of some specimens in which that hand succeeds, or
    else of the last of them.
    """
    seed = 0
    movements: list[list[float]] = []
    while seed < _MOST_SHOWN:
        seed += 1
        movements, success = _watching(
            task, line, specimen_class=specimen_class, seed=seed, target_length=target_length, tissue=tissue
        )
        if success:
            break
    return seed, movements


def _watching(task: str, line: str | None, **key: Any) -> tuple[list[list[float]], bool]:
    of_line: dict[str, Any] = {} if line is None else {"line": line}
    cut = TASKS[task].hand(**key, **of_line)
    device = cut.simple_hand()
    rows: list[list[float]] = []
    while not cut.end:
        stylus = [device.read() for _ in range(_HELD)][-1]
        row = [stylus.position, stylus.angle, *([getattr(stylus, cut.third)] if cut.third else [])]
        rows += [row] * len(cut.follow([row] * _HELD))
    return in_runs(np.array(rows)), cut.success
