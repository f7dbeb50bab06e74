"""Reset of episodes, compiled: specimen, target length, prior knowledge by one key."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.declared import compiled_for
from cutenv._engine.jit import njit, njit_internal, njit_nogil
from cutenv._engine.parallel import WorkQueue, mark_done, next_chunk
from cutenv._engine.randomness import DEPTH_ERROR, LENGTH_DRAW, TASK, Integer, uniform_at
from cutenv.sim.quantities import MEASURABLE_DEPTH
from cutenv.sim.tissue.grid import N_POINTS
from cutenv.sim.tissue.slab import fill_stiffness
from cutenv.sim.tissue.specimen import nominal_stiffness, vary_surface
from cutenv.sim.tissue.specimen_kernels import add_vessels, is_vascular, sample_profiles, smooth_field
from cutenv.task.assessment import COUNT_ONE, observe_rest
from cutenv.task.declare import Cuts, OneCut, Task
from cutenv.task.stepper import batch_of_one

SHORTEST, LONGEST = 0.060, 0.100  # range from which the target length is sampled [m]

_FIRST = np.int64(0)  # not a literal, for which Numba would compile the function again

LIVER, VASCULAR, MIXED, GIVEN = range(4)  # sources of specimens: sampled from a class, or one that is given


@njit
def drawn_length(seed: Integer, episode: Integer) -> float:
    """Return the target length [m] sampled for a key."""
    return SHORTEST + (LONGEST - SHORTEST) * uniform_at(seed, episode, TASK, LENGTH_DRAW)


@njit
def measure_depth(key: tuple[Integer, Integer], noise: float, modes: Array, depth: Array, measured: Array) -> None:
    """Fill ``measured``, (301,), with depth [m] plus a smooth error."""
    smooth_field(key, DEPTH_ERROR, _FIRST, modes, measured)
    for i in range(len(depth)):
        measured[i] = max(depth[i] + noise * measured[i], MEASURABLE_DEPTH)


@njit_internal
def begin_at(state: Struct, progress: Struct, place: float) -> None:
    """Put the blade, unloaded, at ``place`` [m], where the cut ends."""
    state.blade = state.tip = state.hand = place
    progress.position = progress.furthest = progress.tip = place


@njit_internal
def expect(nominal: Struct, profile: Struct) -> None:
    """Fill a profile with mean tissue at its depth of cut."""
    for i in range(N_POINTS):
        depth = profile.depth[i]
        profile.stiffness[i] = nominal_stiffness(nominal, i, depth)
        profile.toughness[i] = nominal.toughness_per_depth * depth


class Start(NamedTuple):
    """Settings that n cuts share when they begin."""

    cuts: Cuts  # one cut at its start; what depends on the key is filled in
    expected: StructArray  # mean tissue, NOMINAL of shape (1,), that a rig expects
    source: int  # LIVER, VASCULAR, MIXED or GIVEN
    target: float  # length of every cut [m]; 0: sampled
    before: float  # distance from the target to which every cut is already made [m]; 0: all begin at the clamp


class Keys(NamedTuple):
    """Random keys of n cuts, uint64, and indices of those that begin."""

    which: StructArray
    seeds: StructArray
    episodes: StructArray


class Drawing(NamedTuple):
    """Tables from which specimens, surfaces and lab knowledge are drawn."""

    recipe: StructArray  # see sample_profiles, and for ``modes``
    modes: Array
    depth_noise: float  # see measure_depth, and for ``depth_modes``
    depth_modes: Array
    surface: tuple[float, float, Array]
    """Spread [m], greatest depth [m] and modes of :func:`cutenv.sim.tissue.specimen.vary_surface`; spread 0: every
    drawn specimen has the mean surface."""
    worn: Array
    """Fracture resistance over that of a new blade, :meth:`cutenv.sim.tissue.specimen.BladeWear.factors`, shape (301,);
    a given specimen has it already."""


@njit_internal
def know_start(cuts: Cuts, c: Integer) -> None:
    """Give a rig the start positions of blade and tip."""
    tip, place = cuts.known[c].tip[0], cuts.progresses[c].tip
    tip.position = tip.tip = place


@compiled_for(njit)
def begin_one(task: Task) -> Callable[..., None]:
    """Return the function that begins a task's additions to a cut."""
    begin, expect, from_truth = task.begin, task.expect, task.from_truth

    def begin_one(one: OneCut, given: tuple[Any, ...], key: tuple[Integer, Integer]) -> None:
        """Begin one cut from ``given`` and a key: seed, episode."""
        cuts = batch_of_one(one)
        if begin is not None:
            begin(cuts, 0, given, key)
        if not from_truth:
            know_start(cuts, 0)
            if expect is not None:
                expect(cuts, 0, given, key)

    return begin_one


@compiled_for(njit)
def expect_one(task: Task) -> Callable[..., None]:
    """Return the function that begins a rig's knowledge of a cut."""
    expect = task.expect

    def expect_one(one: OneCut, given: tuple[Any, ...], key: tuple[Integer, Integer]) -> None:
        """Begin what is known of one cut at the clamp."""
        if expect is not None:
            expect(batch_of_one(one), 0, given, key)

    return expect_one


@compiled_for(njit_nogil)
def begin_some(task: Task) -> Callable[..., None]:
    """Return the function that resets many cuts."""
    begin_task, know, observe, from_truth = task.begin, task.expect, task.observe_start, task.from_truth
    length = task.length

    def begin_some(
        passed: WorkQueue,
        core: int,
        cuts: Cuts,
        start: Start,
        keys: Keys,
        drawing: Drawing,
        given: tuple[Any, ...],
        observations: StructArray,
        vascular: StructArray,
    ) -> None:
        """Reset the cuts ``keys.which``, each exactly as a single environment.

        ``passed`` and ``core`` are those of :func:`cutenv._engine.parallel.parallel_for`.  ``given`` is what the task
        needs besides, see its hook ``begin``.  For the cuts that are reset ``observations`` is filled, and
        ``vascular``, with 1 for a sampled specimen with vessels.
        """
        counts = np.zeros(1, COUNT_ONE)
        recipe = drawing.recipe[0]
        k, end = next_chunk(passed, core, 1)
        while k < end:
            n = keys.which[k]
            seed, episode = keys.seeds[n], keys.episodes[n]
            cuts.states[n] = start.cuts.states[0]
            cuts.laws[n] = start.cuts.laws[0]
            cuts.drives[n] = start.cuts.drives[0]
            cuts.sensors[n] = start.cuts.sensors[0]
            cuts.tasks[n] = start.cuts.tasks[0]
            cuts.progresses[n] = start.cuts.progresses[0]
            cuts.motions[n], cuts.wholes[n] = start.cuts.motions[0], start.cuts.wholes[0]
            if not from_truth:
                cuts.known[n] = start.cuts.known[0]
            cuts.sensors[n].seed = seed
            cuts.sensors[n].episode = episode
            target = start.target
            if target <= 0.0:
                target = drawn_length(seed, episode) if length is None else length(given, (seed, episode))
            cuts.tasks[n].target = target
            if start.before > 0.0:
                begin_at(cuts.states[n], cuts.progresses[n], cuts.tasks[n].target - start.before)
            profile, nominal, along = cuts.profiles[n], cuts.nominals[n], cuts.specimens[n]
            if start.source == GIVEN:
                cuts.profiles[n] = start.cuts.profiles[0]
                cuts.specimens[n] = start.cuts.specimens[0]
            else:
                vessels = start.source == VASCULAR or (start.source == MIXED and is_vascular(seed, episode))
                friction, inclined = sample_profiles((seed, episode), 0.0, recipe, drawing.modes, along)
                if vessels:
                    add_vessels((seed, episode), along.fracture_resistance)
                for i in range(N_POINTS):
                    along.fracture_resistance[i] *= drawing.worn[i]
                vascular[n] = 1 if vessels else 0
                cuts.laws[n].friction_per_depth = friction
                cuts.laws[n].intercept_45 *= inclined
                cuts.laws[n].slope_45 *= inclined
                if from_truth:
                    cuts.tasks[n].friction_per_depth = friction
                fracture_share = 1.0 - recipe.friction_share
                fill_stiffness(recipe.slab, along.modulus, recipe.effective_depth, recipe.share, profile.stiffness)
                for i in range(N_POINTS):
                    profile.depth[i] = recipe.depth[i]
                if drawing.surface[0] > 0.0:
                    spread, deepest, surfaces = drawing.surface
                    vary_surface((seed, episode), spread, deepest, surfaces, profile.depth)
                for i in range(N_POINTS):
                    profile.toughness[i] = fracture_share * along.fracture_resistance[i] * profile.depth[i]
            key = seed, episode
            measure_depth(key, drawing.depth_noise, drawing.depth_modes, profile.depth, nominal.depth)
            expect(start.expected[0], nominal)
            if begin_task is not None:
                begin_task(cuts, n, given, key)
            if not from_truth:
                know_start(cuts, n)
                if know is not None:
                    know(cuts, n, given, key)
            observe_rest(counts, cuts, n, cuts.states[n].angle, observations[n])
            if observe is not None:
                observe(cuts, n, cuts.motions[n] if from_truth else cuts.known[n].motion[0], observations[n])
            mark_done(passed, core, 1)
            k, end = next_chunk(passed, core, 1)

    return begin_some
