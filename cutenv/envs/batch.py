"""Batched cuts, each with its own key, that compiled calls begin and advance on all cores, without building infos.

:class:`cutenv.envs.vector.GentleCutVectorEnv` builds its info from them; a learner that needs only observations,
rewards and ends can use this class, which is faster.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import StructArray
from cutenv._engine.parallel import MIN_CHUNK, parallel_for
from cutenv._engine.randomness import check_key
from cutenv.cutting.dtypes import READING
from cutenv.envs.gentle_cut import GentleCutEnv, checked_episode, checked_length, listed
from cutenv.task.beginning import GIVEN, LIVER, LONGEST, MIXED, VASCULAR, Drawing, Keys, Start, begin_some
from cutenv.task.declare import Cuts
from cutenv.task.episode import ShownDepth
from cutenv.task.info import INFO
from cutenv.task.observation import all_within_reach
from cutenv.task.privileged import append_privileged
from cutenv.task.stepper import Decision, step_some
from cutenv.tissue.description import measured_liver
from cutenv.tissue.sampling import sampler, tissue_modes
from cutenv.tissue.specimen import Specimen, nominal_tissue

_SOURCES = {"liver": LIVER, "vascular": VASCULAR, "mixed": MIXED}
_DRAWN = np.array(["liver", "vascular"], dtype=object)
_NO_READINGS = np.zeros((0, 0), READING)  # given to a kernel that is to keep none
_FEWEST_TICKS = 4000  # updates of all cuts, below which waking another thread costs more than it saves


class CutBatch:
    """``count`` cuts, bit for bit equal to those of single environments with the same keys and actions.

    Parameters
    ----------
    count : int
        Number of cuts.
    single : GentleCutEnv
        Environment whose settings all cuts share.

    Attributes
    ----------
    cuts : Cuts
        State of all cuts.
    observations : array of float32, shape (count, 12)
        Present observations; overwritten by :meth:`begin` and :meth:`decide`.
    seeds, episodes : array of uint64, shape (count,)
        Keys: those of the next cut of each.
    classes : array of object, shape (count,)
        Classes of the specimens; None where no cut has begun.
    begun : array of bool, shape (count,)
        True where a cut has begun.
    """

    def __init__(self, count: int, single: GentleCutEnv) -> None:
        self.single, self.task = single, single.task
        self.end_names: NDArray[Any] = np.array(self.task.ends, dtype=object)
        """Names of the ends by code."""
        self.cuts = Cuts.empty(self.task, count)
        self.observations = np.zeros((count, len(self.task.all_components)), np.float32)
        self.seeds, self.episodes = np.zeros(count, np.uint64), np.zeros(count, np.uint64)
        self.classes = np.full(count, None, dtype=object)
        self.begun = np.zeros(count, bool)
        self._all_begun = False
        self._vascular = np.zeros(count, np.int8)
        self._none_waits = np.zeros(count, bool)
        self._start: tuple[Cuts, StructArray, tuple[Any, ...], str | None] | None = None
        self._tissue = single.tissue.tissue or measured_liver()

    def __len__(self) -> int:
        return len(self.begun)

    @cached_property
    def _drawing(self) -> Drawing:
        """Return how specimens and depths are drawn."""
        knowledge, surface = self.single.constants.knowledge, self.single.options.surface
        return Drawing(
            recipe=sampler(self._tissue),
            modes=tissue_modes(self._tissue),
            depth_noise=knowledge.depth_noise,
            depth_modes=knowledge.depth_modes(),
            surface=(surface.surface_spread, self._tissue.thickness, surface.modes()),
            worn=self.single.constants.wear.factors(),
        )

    def give_seeds(self, seeds: Sequence[int | None], which: NDArray[np.int64], chance: np.random.Generator) -> None:
        """Assign ``seeds``, one for each cut of the batch, to the cuts numbered ``which``; None keeps a cut's own.

        A cut without a seed draws one from ``chance``.
        """
        if len(seeds) != len(self):
            raise ValueError(f"seed holds {len(seeds)} numbers; give one for each of {len(self)} environments.")
        for n in which:
            given = seeds[n]
            if given is None and not self.begun[n]:
                given = int(chance.integers(2**63))
            if given is not None:
                check_key(given, 0)
                self.seeds[n] = given
                self.episodes[n] = 0
        self.begun[which] = True
        self._all_begun = bool(self.begun.all())

    def begin(self, which: NDArray[np.int64], options: dict[str, Any] | None = None) -> None:
        """Begin the next cut of those numbered ``which``; ``options`` as in :meth:`GentleCutEnv.reset`.

        Raises
        ------
        ValueError, TypeError
            For an unknown or invalid option.
        """
        options = options or {}
        if options.get("episode") is not None:
            self.episodes[which] = checked_episode(options["episode"])
        if options.get("specimen") is not None:
            cut, expected, beginning, given = self._shared_start(options)
        else:
            cut, expected, beginning, given = self._start = self._start or self._shared_start(options)
        target = self.single.target_length or 0.0
        if options.get("target_length") is not None:
            target = checked_length(options["target_length"])
            self.single.check_start(target)
        source = GIVEN if given else _SOURCES[self.single.specimen_class]
        start = Start(cut, expected, source, target, self.single.start_before_target or 0.0)
        self.cuts = self.cuts._replace(shared=cut.shared)
        parallel_for(
            begin_some(self.task), len(which), self.cuts, start, Keys(which, self.seeds, self.episodes), self._drawing,
            beginning, self.observations, self._vascular,
        )  # fmt: skip
        drawn = self._vascular[which]
        classes = self.classes.copy()  # callers keep the arrays they were given
        classes[which] = _DRAWN[drawn] if given is None else given
        classes.setflags(write=False)
        self.classes = classes
        self.episodes[which] += np.uint64(1)

    def decide(
        self,
        actions: ArrayLike,
        waiting: NDArray[np.bool_] | None = None,
        infos: StructArray | None = None,
        meanwhile: Callable[[], None] | None = None,
        readings: StructArray | None = None,
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Apply an action to every cut, and advance to the next decision.

        Parameters
        ----------
        actions : array, shape (count, 2), or (count, 3) of a task with a third axis
            Actions, clipped to [-1, 1].
        waiting : array of bool, shape (count,), optional
            True for cuts that are not advanced.
        infos : Records, shape (count,), optional
            Array of :data:`cutenv.task.info.INFO` that is filled.
        meanwhile : callable, optional
            Called while other cores wake up.
        readings : Records, shape (count, ticks), optional
            Array of :data:`~cutenv.cutting.dtypes.READING` that is filled with every millisecond of the step, for each
            cut up to its end.

        Returns
        -------
        rewards, ends : array, shape (count,), and of int64, shape (count,)
            Rewards, and indices in :data:`~cutenv.task.reward.ENDS`; 0 while a cut goes on.

        Raises
        ------
        ResetNeeded
            If some cuts were never begun.
        ValueError
            For actions of another shape, and for NaN.
        """
        count = len(self)
        waiting = self._none_waits if waiting is None else waiting
        commands = self.checked_actions(actions, waiting)
        infos = np.empty(count, INFO) if infos is None else infos
        rewards, ends = np.empty(count), np.empty(count, np.int64)
        readings = _NO_READINGS if readings is None else readings
        parallel_for(
            step_some(self.task), count, self.cuts,
            Decision(self.single.ticks, waiting, commands, self.observations, rewards, ends, infos, readings),
            fewest=max(MIN_CHUNK, _FEWEST_TICKS // self.single.ticks), meanwhile=meanwhile,
        )  # fmt: skip
        return rewards, ends

    def checked_actions(self, actions: ArrayLike, waiting: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return a copy of the actions, clipped to [-1, 1]; those of cuts that wait may be NaN.

        Raises
        ------
        ResetNeeded
            If some cuts were never begun.
        ValueError
            For actions of another shape, and for NaN.
        """
        if not self._all_begun:
            raise gymnasium.error.ResetNeeded("in some environments no cut is going on: call reset() before step().")
        commands = np.array(actions, np.float64)
        names = self.task.action_names
        if commands.shape != (len(self), len(names)):
            raise ValueError(
                f"actions have shape {commands.shape}; give ({len(self)}, {len(names)}): {listed(names)} of each."
            )
        bad = all_within_reach(commands, waiting, self.single.fixed_angle or math.nan)
        if bad >= 0:
            raise ValueError(
                f"actions[{bad}] = {np.asarray(actions)[bad]} must hold {len(names)} numbers in [-1, 1] "
                f"({', '.join(names)}), and none may be NaN."
            )
        if (most := self.single.greatest_action) < 1.0:
            np.clip(commands[:, 0], -most, most, out=commands[:, 0])
        return commands

    def extra_terms(self) -> dict[str, NDArray[np.float64]]:
        """Return the terms of the last step's reward that the infos do not hold, by name; each of shape (count,)."""
        return self.task.charges(self.cuts.wholes)

    def further_scores(self) -> dict[str, NDArray[np.float64]]:
        """Return scores that the task adds to those of gentle cutting, by name; each of shape (count,)."""
        return self.task.numbers_of(self.cuts)[1]

    def further_infos(self) -> dict[str, dict[str, NDArray[np.float64]]]:
        """Return what the task adds to the info, by group and name; each of shape (count,)."""
        if not (group := self.task.shown_as):
            return {}
        truth, errors = self.task.numbers_of(self.cuts)
        return {"truth": truth, "reward_terms": self.extra_terms(), group: errors}

    def shown_depth(self, cut: int) -> ShownDepth | None:
        """Return a copy of the depth of a cut as a picture shows it; None where no depth is wanted."""
        return self.single.options.shown_depth(self.cuts, cut)

    def append_hidden(self, features: NDArray[np.float32], which: NDArray[np.int64]) -> NDArray[np.float32]:
        """Append the hidden state of the cuts numbered ``which``, for a critic, to features of shape (m, size)."""
        return append_privileged(self.cuts, self.task, features, which)

    def succeeded(self) -> NDArray[np.bool_]:
        """Return which cuts ended in success, shape (count,)."""
        success: NDArray[np.bool_] = self.cuts.wholes["success"] == 1
        return success

    def _shared_start(self, options: dict[str, Any]) -> tuple[Cuts, StructArray, tuple[Any, ...], str | None]:
        """Return what every key shares: a cut, mean tissue, what a task's begin takes, class of a given specimen."""
        specimen = self.single.given_specimen(options.get("specimen"))
        if specimen is None and self.single.specimen_class == "uniform":
            specimen = Specimen.drawn(0, specimen_class="uniform", tissue=self._tissue)
        given = specimen is not None
        if specimen is not None:
            specimen = self.single.constants.wear.of(specimen)
        specimen = specimen or Specimen.mean(self._tissue)  # only its tissue matters
        single = self.single
        single.set_up(specimen, single.target_length or LONGEST, seed=0, episode=0, depth=specimen.depth, begun=False)
        beginning = single.options.beginning(specimen.tissue)
        cut = single.cutting.snapshot()
        return cut, nominal_tissue(specimen.tissue), beginning, (specimen.specimen_class if given else None)
