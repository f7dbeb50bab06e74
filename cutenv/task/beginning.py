"""Reset of episodes, compiled: specimen, target length and the lab's prior knowledge, all from one random key."""

from __future__ import annotations

import numpy as np

from cutenv._base.arrays import Array, Struct, StructArray
from cutenv._engine.jit import njit, njit_internal, njit_nogil
from cutenv._engine.randomness import DEPTH_ERROR, LENGTH_DRAW, TASK, Integer, uniform_at
from cutenv._engine.work_queue import WorkQueue, mark_done, next_chunk
from cutenv.task.assessment import COUNT_ONE, observe_rest
from cutenv.task.cuts import Cuts
from cutenv.task.observation import ANGLE_CENTRE, ANGLE_SCALE
from cutenv.task_quantities import MEASURABLE_DEPTH
from cutenv.tissue.grid import N_POINTS
from cutenv.tissue.nominal import nominal_stiffness
from cutenv.tissue.sampling import is_vascular, sample_profiles, smooth_field
from cutenv.tissue.slab import fill_stiffness
from cutenv.tissue.surface import vary_surface

SHORTEST, LONGEST = 0.060, 0.100
"""Range from which the target length is sampled [m]."""

_FIRST = np.int64(0)  # not a literal, for which Numba would compile the function again

LIVER, VASCULAR, MIXED, GIVEN = range(4)
"""Sources of specimens: sampled from a class, or one that is given."""


@njit
def drawn_length(seed: Integer, episode: Integer) -> float:
    """Return the target length [m] sampled for a key."""
    return SHORTEST + (LONGEST - SHORTEST) * uniform_at(seed, episode, TASK, LENGTH_DRAW)


@njit
def measure_depth(seed: Integer, episode: Integer, noise: float, modes: Array, depth: Array, measured: Array) -> None:
    """Fill ``measured``, shape (301,), with the measured depth of cut [m]: true depth plus a smooth error."""
    smooth_field(seed, episode, DEPTH_ERROR, _FIRST, modes, measured)
    for i in range(len(depth)):
        measured[i] = max(depth[i] + noise * measured[i], MEASURABLE_DEPTH)


@njit_internal
def begin_at(state: Struct, progress: Struct, tip: Struct, place: float) -> None:
    """Put a blade that stands at the clamp to ``place`` [m], where the cut that is already made ends: unloaded."""
    state.blade = state.tip = state.hand = place
    progress.position = progress.furthest = progress.tip = place
    tip.position = tip.tip = place


@njit_internal
def expect(nominal: Struct, profile: Struct) -> None:
    """Fill stiffness and toughness of a ``profile`` with those of the mean tissue at its depth of cut."""
    for i in range(N_POINTS):
        depth = profile.depth[i]
        profile.stiffness[i] = nominal_stiffness(nominal, i, depth)
        profile.toughness[i] = nominal.toughness_per_depth * depth


@njit_nogil
def begin_some(
    passed: WorkQueue,
    core: int,
    cuts: Cuts,
    start: Cuts,
    expected: StructArray,
    which: StructArray,
    seeds: StructArray,
    episodes: StructArray,
    source: int,
    from_truth: bool,
    target: float,
    before: float,
    recipe: StructArray,
    modes: Array,
    depth_noise: float,
    depth_modes: Array,
    surface: tuple[float, float, Array],
    worn: Array,
    observations: StructArray,
    vascular: StructArray,
) -> None:
    """Reset the cuts with indices ``which``, each from its own key, exactly as a single environment would.

    Parameters
    ----------
    passed, core : WorkQueue, int
        Work queue over ``which`` and number of the thread, see :func:`cutenv._engine.parallel.parallel_for`.
    cuts : Cuts
        n cuts; those in ``which`` are reset.
    start : Cuts
        One cut at its start with everything that all share; what depends on the key is filled in here.
    expected : Records, shape (1,)
        Mean tissue, :data:`cutenv.tissue.nominal.NOMINAL`, from which the profiles that a rig expects are made.
    which : array of int, shape (m,)
        Indices of the cuts to reset.
    seeds, episodes : array of uint64, shape (n,)
        Random keys.
    source : int
        LIVER, VASCULAR, MIXED or GIVEN.
    from_truth : bool
        True: the assessment knows the specimen's friction. False: it uses that of the mean tissue.
    target : float
        Length of every cut [m]; 0: sampled.
    before : float
        Distance from the target to which every cut is already made [m]; 0: all begin at the clamp.
    recipe, modes
        See :func:`cutenv.tissue.sampling.sample_profiles`.
    depth_noise, depth_modes
        See :func:`measure_depth`.
    surface : tuple
        Spread [m], greatest depth [m] and modes of :func:`cutenv.tissue.surface.vary_surface`; spread 0: every drawn
        specimen has the mean surface.
    worn : array, shape (301,)
        Fracture resistance over that of a new blade, :meth:`cutenv.tissue.blade_wear.BladeWear.factors`; a given
        specimen has it already.
    observations : array of float32, shape (n, 12)
        Filled for the cuts in ``which``.
    vascular : array of int8, shape (n,)
        1 for a sampled specimen with vessels, 0 without.
    """
    counts = np.zeros(1, COUNT_ONE)
    k, end = next_chunk(passed, core, 1)
    while k < end:
        n = which[k]
        seed, episode = seeds[n], episodes[n]
        cuts.states[n] = start.states[0]
        cuts.laws[n] = start.laws[0]
        cuts.drives[n] = start.drives[0]
        cuts.sensors[n] = start.sensors[0]
        cuts.tasks[n] = start.tasks[0]
        cuts.progresses[n] = start.progresses[0]
        cuts.tips[n] = start.tips[0]
        cuts.sensors[n].seed = seed
        cuts.sensors[n].episode = episode
        cuts.tasks[n].target = target if target > 0.0 else drawn_length(seed, episode)
        if before > 0.0:
            begin_at(cuts.states[n], cuts.progresses[n], cuts.tips[n], cuts.tasks[n].target - before)
        profile, nominal, along = cuts.profiles[n], cuts.nominals[n], cuts.specimens[n]
        if source == GIVEN:
            cuts.profiles[n] = start.profiles[0]
            cuts.specimens[n] = start.specimens[0]
        else:
            vessels = source == VASCULAR or (source == MIXED and is_vascular(seed, episode))
            friction, inclined = sample_profiles(
                seed, episode, vessels, 0.0, recipe[0], modes, along.modulus, along.fracture_resistance
            )
            for i in range(N_POINTS):
                along.fracture_resistance[i] *= worn[i]
            vascular[n] = 1 if vessels else 0
            cuts.laws[n].friction_per_depth = friction
            cuts.laws[n].intercept_45 *= inclined
            cuts.laws[n].slope_45 *= inclined
            if from_truth:
                cuts.tasks[n].friction_per_depth = friction
            fracture_share = 1.0 - recipe[0].friction_share
            fill_stiffness(recipe[0].slab, along.modulus, recipe[0].effective_depth, recipe[0].share, profile.stiffness)
            for i in range(N_POINTS):
                profile.depth[i] = recipe[0].depth[i]
            if surface[0] > 0.0:
                vary_surface(seed, episode, surface[0], surface[1], surface[2], profile.depth)
            for i in range(N_POINTS):
                profile.toughness[i] = fracture_share * along.fracture_resistance[i] * profile.depth[i]
        measure_depth(seed, episode, depth_noise, depth_modes, profile.depth, nominal.depth)
        expect(expected[0], nominal)
        angle = cuts.states[n].angle
        last_angle = (angle - ANGLE_CENTRE) / ANGLE_SCALE
        observe_rest(counts, cuts.tasks[n], cuts.progresses[n], nominal, angle, last_angle, observations[n])
        mark_done(passed, core, 1)
        k, end = next_chunk(passed, core, 1)
