"""The loop in which the tasks that assess a cut by a map step many cuts: one source, compiled for each task."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import StructArray
from cutenv._engine.intrinsics import as_float64_view, keep_alive, without_refcount
from cutenv._engine.jit import njit_nogil
from cutenv._engine.lanes import first_row
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.beside_row import beside_views, pad_beside, put_beside, take_beside
from cutenv.cutting.row import LANES, ROW, begin, plain_views, put
from cutenv.task.assessment import COUNT, reward_of
from cutenv.task.cuts import Cuts, fetch_some, flat_views, take_cut


class MapLanes(NamedTuple):
    """Rows of a task beside that of the law, for a number of lanes."""

    motion: np.dtype[Any]
    """Row of what the task adds to the motion, see :mod:`cutenv.cutting.beside_row`."""
    scalars: int
    """Scalars of its record that a lane holds."""
    step: np.dtype[Any]
    """Counts of a step."""

    @property
    def memory(self) -> np.dtype[Any]:
        """Record of both, for the step of one cut; in a browser the step itself can allocate nothing."""
        return np.dtype((np.record, [("motion", self.motion, (1,)), ("step", self.step, (1,))]))


def step_counts(names: Sequence[str], lanes: int) -> np.dtype[Any]:
    """Return the structured dtype of what is counted in a step, by name; one number for each lane."""
    return np.dtype((np.record, [(name, "f8", (lanes,)) for name in names]))


def map_stepper(
    name: str,
    rows_beside: MapLanes,
    begin_lane: Callable[..., None],
    fetch: Callable[..., None],
    advance: Callable[..., int],
    conclude: Callable[..., int],
    terms: Callable[..., float],
) -> Callable[..., None]:
    """Return the kernel, of a ``name``, that steps n cuts of a task by one decision.

    Parameters
    ----------
    name : str
        Name of the kernel.
    rows_beside : MapLanes
        What the task adds to a row of :data:`~cutenv.cutting.row.LANES`.
    begin_lane, fetch, advance, conclude, terms : callable
        What differs between the tasks, compiled by :func:`~cutenv._engine.jit.njit_inline`: prepare a lane for an
        action, prefetch records of the next row, advance and count a millisecond, conclude the step of a cut, and sum
        the costs of its map.
    """
    motion_row, scalars, step_row = rows_beside

    def step_some(
        passed: WorkQueue,
        core: int,
        cuts: Cuts,
        beside: tuple[StructArray, ...],
        ticks: int,
        waiting: StructArray,
        actions: StructArray,
        observations: StructArray,
        rewards: StructArray,
        ends: StructArray,
        infos: StructArray,
        readings: StructArray,
    ) -> None:
        """Step n cuts by one decision, assessed by hidden state; as :func:`cutenv.task.cuts.step_some`.

        Parameters
        ----------
        passed, core : WorkQueue, int
            Work queue and number of the thread, see :func:`cutenv._engine.parallel.parallel_for`.
        cuts, beside : Cuts, tuple of Records
            The cuts, and the records that the task adds: of its motion, of its map, and what all share.
        ticks, waiting, rewards, ends, infos, readings
            See :func:`cutenv.task.cuts.step_some`; ``ends`` are those of the task.
        actions, observations : array, shape (n, 3), (n, components) float32
            Actions within [-1, 1]; observations: filled.
        """
        cuts, beside = without_refcount(cuts), without_refcount(beside)
        waiting, actions, observations, rewards, ends, infos, readings = without_refcount(
            (waiting, actions, observations, rewards, ends, infos, readings)
        )
        rows, counts = np.zeros(1, ROW), np.zeros(1, COUNT)
        motions, steps = np.zeros(1, motion_row), np.zeros(1, step_row)
        row, count, motion, step = first_row(rows), first_row(counts), first_row(motions), first_row(steps)
        along = beside_views(motions, beside[0], LANES, scalars)
        plain, numbers = plain_views(rows, cuts.states, cuts.laws, cuts.drives), as_float64_view(infos)
        fetched = flat_views(cuts, plain, infos)
        first, last = next_chunk(passed, core, LANES)
        while first < last:
            following = next_chunk(passed, core, LANES)
            taken = 0
            for n in range(first, last):
                if waiting[n]:
                    rewards[n], ends[n] = 0.0, 0
                else:
                    take_cut(cuts, row, plain, count, actions, taken, n)
                    take_beside(along, taken, n)
                    begin_lane(step, taken, actions[n, 2], cuts.states[n], motion)
                    taken += 1
            if taken > 0:
                begin(row, plain, taken)
                pad_beside(along, taken)
            for i in range(ticks + 1 if taken > 0 else 0):
                fetch_some(cuts, fetched, i, following[0], following[1])
                fetch(beside, cuts, i, following[0], following[1])
                over = taken  # after the last millisecond, all of them
                if i < ticks:
                    over = advance(cuts, beside, row, motion, along, count, step, readings, i)
                for k in range(taken if over > 0 else 0):
                    if row.going[k] == 1 and (i == ticks or count.end[k] != 0):
                        c = row.cut[k]
                        row.going[k] = 0
                        put(row, plain, k, c)
                        put_beside(along, k, c)
                        ends[c] = conclude(cuts, beside, c, row, count, step, k, actions[c], observations[c], infos[c])
                        rewards[c] = reward_of(numbers, c) + terms(beside[1][c])
            mark_done(passed, core, last - first)
            first, last = following
        keep_alive(rows)
        keep_alive(counts)
        keep_alive(steps)
        keep_alive(motions)

    kernel: Any = step_some
    kernel.__name__ = kernel.__qualname__ = name  # of its file in the cache,
    kernel.__module__ = conclude.__module__  # which stands for what the task imports, too
    return njit_nogil(step_some)
