"""Beginning cuts whose depth is an action: wanted depth, layer below, place of the blade."""

from __future__ import annotations

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.jit import njit, njit_internal, njit_nogil
from cutenv._engine.randomness import Integer
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.cutting.descent import renew
from cutenv.task.cuts import Cuts
from cutenv.task.depth_assessment import UNFELT, observe_depth, survey
from cutenv.task.wanted_depth import AT_LEVEL, draw_layer, draw_wanted
from cutenv.tissue.grid import N_POINTS, POINTS_PER_METRE
from cutenv.tissue.slab import cut_through


@njit_internal
def begin_depth(
    profile: Struct,
    measured: Struct,
    along: Struct,
    state: Struct,
    task: Struct,
    descent: Struct,
    depth: Struct,
    slab: Struct,
    shared: tuple[float, float],
    kinds: tuple[int, int],
    key: tuple[Integer, Integer],
) -> None:
    """Begin one cut, whose records were begun as those of gentle cutting: wanted depth, layer, place of the blade.

    ``shared`` are the fracture part of the resistance and the bed's stiffness over the modulus; ``kinds`` the kind of
    wanted depth, and 1 if the layer below is drawn; ``key`` seed and episode.
    """
    for i in range(N_POINTS):
        descent.surface[i] = descent.floor[i] = profile.depth[i]
        descent.toughness[i] = shared[0] * along.fracture_resistance[i]
    descent.modulus = cut_through(slab, along.modulus, descent.far, descent.near)
    descent.bed = shared[1] * descent.modulus
    depth.level_wanted = 1 if kinds[0] == AT_LEVEL else 0
    if kinds[0] == AT_LEVEL:
        for i in range(N_POINTS):
            depth.wanted[i] = profile.depth[i]
    else:
        draw_wanted(key[0], key[1], kinds[0], task.target, depth.wanted)
    if kinds[1] == 1:
        draw_layer(key[0], key[1], depth.wanted, descent)
    cell = int(state.tip * POINTS_PER_METRE + 0.5)
    for i in range(cell + 1):  # what is already cut is as deep as wanted, by the measured surface
        descent.floor[i] = 0.0 if kinds[0] == AT_LEVEL else measured.depth[i] - depth.wanted[i]
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
    survey(depth, descent, 0.0)


@njit
def begin_depth_one(
    cuts: StructArray, episodes: StructArray, descents: StructArray, depths: StructArray, slabs: StructArray,
    shared: tuple[float, float], kinds: tuple[int, int], key: tuple[Integer, Integer],
) -> None:  # fmt: skip
    """Begin one cut: :func:`begin_depth` for records of shape (1,)."""
    c, e = cuts[0], episodes[0]
    begin_depth(
        c.profiles[0], e.nominals[0], e.specimens[0], c.states[0], e.tasks[0], descents[0], depths[0], slabs[0],
        shared, kinds, key,
    )  # fmt: skip


@njit
def observe_depth_at_start(
    cuts: StructArray, episodes: StructArray, descents: StructArray, depths: StructArray, observation: StructArray
) -> None:
    """Fill what depth adds to the observation of one cut at its start."""
    c, e = cuts[0], episodes[0]
    observe_depth(
        depths[0], descents[0], e.nominals[0], c.sensors[0], 0, 0, e.progresses[0].position, UNFELT, 0.0, observation
    )


@njit_nogil
def begin_depth_some(
    passed: WorkQueue,
    core: int,
    cuts: Cuts,
    descents: StructArray,
    depths: StructArray,
    start: tuple[StructArray, StructArray, StructArray],
    shared: tuple[float, float],
    kinds: tuple[int, int],
    which: StructArray,
    seeds: StructArray,
    episodes: StructArray,
    observations: StructArray,
) -> None:
    """Begin the depth of the cuts with indices ``which``, after :func:`cutenv.task.beginning.begin_some`.

    ``start`` has the records that all share, each of shape (1,): vertical motion, depth, slab.  The others are those
    of :func:`begin_depth` and :func:`cutenv.task.beginning.begin_some`.
    """
    k, end = next_chunk(passed, core, 1)
    while k < end:
        n = which[k]
        descents[n], depths[n] = start[0][0], start[1][0]
        begin_depth(
            cuts.profiles[n], cuts.nominals[n], cuts.specimens[n], cuts.states[n], cuts.tasks[n], descents[n],
            depths[n], start[2][0], shared, kinds, (seeds[n], episodes[n]),
        )  # fmt: skip
        observe_depth(
            depths[n], descents[n], cuts.nominals[n], cuts.sensors[n], 0, 0, cuts.progresses[n].position, UNFELT,
            0.0, observations[n],
        )  # fmt: skip
        mark_done(passed, core, 1)
        k, end = next_chunk(passed, core, 1)
