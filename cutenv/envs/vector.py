"""Batches of independently keyed cuts, and the vector environment.

Compiled calls begin and advance the cuts of a :class:`CutBatch` on all cores, without building infos; a learner that
needs only observations, rewards and ends is faster with it. :class:`GentleCutVectorEnv` builds its info from them.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import StructArray
from cutenv._base.validation import in_range, one_of
from cutenv._engine.jit import warn_before_first_compile
from cutenv._engine.parallel import MIN_CHUNK, parallel_for
from cutenv._engine.randomness import check_key
from cutenv.envs.gentle_cut import RESET_OPTIONS, GentleCutEnv, checked_episode, checked_length, listed
from cutenv.envs.gymnasium_facts import LimitedSpec, flat_infos
from cutenv.sim.cutting.dtypes import READING
from cutenv.sim.tissue.description import measured_liver
from cutenv.sim.tissue.specimen import Specimen, nominal_tissue
from cutenv.sim.tissue.specimen_kernels import sampler, tissue_modes
from cutenv.task.beginning import GIVEN, LIVER, LONGEST, MIXED, VASCULAR, Drawing, Keys, Start, begin_some
from cutenv.task.declare import Cuts, Task
from cutenv.task.episode import ShownDepth
from cutenv.task.info import GROUPS, INFO, column
from cutenv.task.observation import all_within_reach
from cutenv.task.privileged import append_privileged
from cutenv.task.stepper import Decision, step_some, tell_of_all

_SOURCES = {"liver": LIVER, "vascular": VASCULAR, "mixed": MIXED}
_DRAWN = np.array(["liver", "vascular"], dtype=object)
_NO_READINGS = np.zeros((0, 0), READING)  # given to a kernel that is to keep none
_FEWEST_TICKS = 4000  # updates of all cuts, below which waking another thread costs more than it saves


def warn_before_first_batch(task: Task) -> None:
    """Print on stderr, once, that the first batch of a task compiles for some seconds, if it does."""
    warn_before_first_compile(step_some(task), begin_some(task))


class CutBatch:
    """Batch of ``count`` cuts, bit-equal to single environments.

    All share the settings of ``single``.

    Attributes
    ----------
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
        """Assign a seed each to cuts ``which``; None keeps a cut's own, or draws by ``chance``."""
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
        """Begin the next cuts ``which``; ``options``, and errors, as in :meth:`GentleCutEnv.reset`."""
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
        """Advance every cut by its action to the next decision.

        Parameters
        ----------
        actions : array, shape (count, 2), or (count, 3) of a task with a third axis
            Actions, clipped to [-1, 1]; ValueError for another shape, and for NaN.
        waiting : array of bool, shape (count,), optional
            True for cuts that are not advanced.
        infos : StructArray, shape (count,), optional
            Array of :data:`cutenv.task.info.INFO` that is filled.
        meanwhile : callable, optional
            Called while other cores wake up.
        readings : StructArray, shape (count, ticks), optional
            Array of :data:`~cutenv.sim.cutting.dtypes.READING` that is filled with every millisecond of the step, for
            each cut up to its end.

        Returns
        -------
        rewards, ends : array, shape (count,), and of int64, shape (count,)
            Rewards, and indices in :data:`~cutenv.task.reward.ENDS`; 0 while a cut goes on.

        Raises
        ------
        ResetNeeded
            If some cuts were never begun.
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
        """Return a copy of actions, clipped to [-1, 1]; errors as in :meth:`decide`."""
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
        """Return last step's reward terms missing from infos, each (count,)."""
        return self.task.charges(self.cuts.wholes)

    def further_scores(self) -> dict[str, NDArray[np.float64]]:
        """Return the task's further scores by name, each (count,)."""
        return self.task.numbers_of(self.cuts)[1]

    def further_infos(self) -> dict[str, dict[str, NDArray[np.float64]]]:
        """Return the task's info by group and name, each (count,)."""
        if not (group := self.task.shown_as):
            return {}
        truth, errors = self.task.numbers_of(self.cuts)
        return {"truth": truth, "reward_terms": self.extra_terms(), group: errors}

    def shown_depth(self, cut: int) -> ShownDepth | None:
        """Return a copy of a cut's depth for a picture, or None."""
        return self.single.options.shown_depth(self.cuts, cut)

    def append_hidden(self, features: NDArray[np.float32], which: NDArray[np.int64]) -> NDArray[np.float32]:
        """Append hidden state of cuts ``which``, for critics, to features."""
        return append_privileged(self.cuts, self.task, features, which)

    def succeeded(self) -> NDArray[np.bool_]:
        """Return which cuts ended in success, shape (count,)."""
        success: NDArray[np.bool_] = self.cuts.wholes["success"] == 1
        return success

    def _shared_start(self, options: dict[str, Any]) -> tuple[Cuts, StructArray, tuple[Any, ...], str | None]:
        """Return what keys share: cut, mean tissue, task arguments, specimen class."""
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


_NAMED = tuple(
    (group, "_" + group, [(field.name, "_" + field.name, column(field)) for field in fields])
    for group, fields in GROUPS.items()
)
"""Layout of the info: groups with their masks, and within each, names, masks and columns."""

Flags = NDArray[np.bool_]
Numbers = NDArray[np.float64]
Observations = NDArray[np.float32]


class GentleCutVectorEnv(VectorEnv[Observations, Observations, NDArray[Any]]):
    """Vector of ``num_envs`` environments, bit-equal to single ones.

    ``gymnasium.make_vec("cutenv/GentleCut-v1", num_envs=1024)`` makes one. Environment i of ``reset(seed=s)`` equals
    that of ``GentleCutEnv.reset(seed=s + i)``, episode after episode.

    Parameters
    ----------
    num_envs : int
        Number of environments, at least 1.
    autoreset_mode : AutoresetMode or str
        Treatment of an environment whose cut has ended: "NextStep" (Gymnasium's default), "SameStep" (its last
        observation and info are in ``info["final_obs"]`` and ``info["final_info"]``) or "Disabled" (reset it with
        ``reset(options={"reset_mask": mask})``).
    render_mode : None
        Only None: a batch is not drawn; use one environment to draw.
    max_episode_steps : int, optional
        As ``spec`` has it when the environment is made again; at least the decisions of a whole cut, which ends itself.
    **keywords
        Keywords of :class:`~cutenv.envs.gentle_cut.GentleCutEnv`, the same for all.

    Notes
    -----
    ``info`` holds the single environment's entries as arrays of length ``num_envs``, each with a mask ``_name`` that is
    True where it is present.
    """

    spec = LimitedSpec()
    single_class: ClassVar[type[GentleCutEnv]] = GentleCutEnv
    """Class of the single environment."""
    metadata: dict[str, Any] = {  # noqa: RUF012  as in VectorEnv
        "render_modes": [],
        "render_fps": 50,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }

    def __init__(
        self,
        num_envs: int = 1,
        *,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: None = None,
        max_episode_steps: int | None = None,
        **keywords: Any,
    ) -> None:
        cure = "Give the whole number of environments."
        if in_range("num_envs", num_envs, 1, 10**7, "1", cure) % 1.0:
            raise ValueError(f"num_envs = {num_envs:g} is not a whole number. {cure}")
        if not isinstance(autoreset_mode, AutoresetMode):
            one_of("autoreset_mode", autoreset_mode, [mode.value for mode in AutoresetMode])
        if render_mode is not None:
            raise ValueError(
                f"render_mode = {render_mode!r}: a batch is not drawn; "
                'use vectorization_mode="sync", or one environment.'
            )
        self.num_envs = int(num_envs)
        self.render_mode = None
        self.autoreset_mode = AutoresetMode(autoreset_mode)
        self.single = self.single_class(**keywords)  # checks the keywords, and makes the start that all share
        self.most_steps = self.single.most_steps
        """Decisions after which a cut has ended, whatever was done."""
        if max_episode_steps is not None and max_episode_steps < self.most_steps:
            raise ValueError(
                f"max_episode_steps = {max_episode_steps}: a batch does not truncate its cuts, which the deadline ends "
                f'after {self.most_steps} decisions. Give deadline_s, or vectorization_mode="sync".'
            )
        warn_before_first_batch(self.single.task)
        self.metadata = {
            **self.metadata,
            "render_fps": self.single.metadata["render_fps"],
            "autoreset_mode": self.autoreset_mode,
        }
        self.single_observation_space = self.single.observation_space
        self.single_action_space = self.single.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space: spaces.Space[Any] = batch_space(self.single_action_space, self.num_envs)

        self.batch = CutBatch(self.num_envs, self.single)
        """Batch of the cuts, for callers without need of an info; do not mix its steps with these."""
        self._ended = np.zeros(self.num_envs, bool)
        self._none_waits = np.zeros(self.num_envs, bool)

    @property
    def cuts(self) -> Cuts:
        """State of all cuts."""
        return self.batch.cuts

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, dict[str, Any]]:
        """Begin every environment's next cut, or those in ``options["reset_mask"]``, an array of bool.

        Environment i gets the seed ``seed + i``, or its own of a sequence; None: the next episode of its present seed.
        The other options are those of :meth:`GentleCutEnv.reset`.
        """
        options = dict(options or {})
        which = self._masked(options.pop("reset_mask", None))
        for name in options:
            one_of("option", name, (*RESET_OPTIONS, "reset_mask"))
        if seed is not None or not self.batch.begun[which].all():
            self.batch.give_seeds(self._seeds_of_all(seed), which, self.np_random)
        self.batch.begin(which, options)
        self._ended[which] = False
        return self._shown(), self._told(self._info(self._infos_at_start(which), self._mask(which)))

    def step(self, actions: Observations) -> tuple[Observations, Numbers, Flags, Flags, dict[str, Any]]:
        """Apply actions, shape (num_envs, 2); see ``autoreset_mode`` for ends."""
        waiting = self._ended if self.autoreset_mode == AutoresetMode.NEXT_STEP else self._none_waits
        if waiting is self._none_waits and self._ended.any():
            raise gymnasium.error.ResetNeeded("in some environments no cut is going on: call reset() before step().")
        infos = np.empty(self.num_envs, INFO)
        info: dict[str, Any] = {}
        present = np.ones(self.num_envs, bool)
        rewards, ends = self.batch.decide(
            actions, waiting, infos, meanwhile=lambda: info.update(_by_name(infos, present))
        )
        ended = ends != 0
        finished = ended.nonzero()[0]  # np.flatnonzero takes a microsecond longer
        began = waiting.nonzero()[0] if waiting is self._ended else finished[:0]
        final: dict[str, Any] = {}
        if self.autoreset_mode == AutoresetMode.SAME_STEP and len(finished):
            final = self._final(finished, ended, ends, infos)
            began = finished
        if len(began):
            self.batch.begin(began)
            self._infos_at_start(began, infos)
        info = {**final, **self._completed(info, infos, present)}
        if len(finished) and self.autoreset_mode != AutoresetMode.SAME_STEP:
            self._add_ends(info, ended, ends)
        self._ended = self._none_waits if self.autoreset_mode == AutoresetMode.SAME_STEP else ended
        return self._shown(), rewards, ended.copy(), np.zeros(self.num_envs, bool), self._told(info)

    def _told(self, info: dict[str, Any]) -> dict[str, Any]:
        return flat_infos(info, self.batch.task.ends) if self.single.flat_info else info

    def _shown(self) -> Observations:
        """Return the present observations of all environments, a copy."""
        return self.batch.observations.copy()

    def _masked(self, mask: Any) -> NDArray[np.int64]:
        """Return the environments that a reset mask selects; all without one."""
        if mask is None:
            return np.arange(self.num_envs)
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            raise ValueError(f"reset_mask = {mask!r} must be an array of bool of shape ({self.num_envs},).")
        if not mask.any():
            raise ValueError("reset_mask names no environment; leave the reset out.")
        return np.flatnonzero(mask)

    def _seeds_of_all(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        """Return the seeds given to ``reset``, one for each environment."""
        if not (seed is None or isinstance(seed, int | np.integer)):
            return list(seed)
        super().reset(seed=None if seed is None else int(seed))
        return [None if seed is None else int(seed) + n for n in range(self.num_envs)]

    def _infos_at_start(self, which: NDArray[np.int64], infos: StructArray | None = None) -> StructArray:
        if infos is None:
            infos = np.zeros(self.num_envs, INFO)
        infos[which] = np.zeros((), INFO)
        tell_of_all(self.cuts, which, infos)
        return infos

    def _mask(self, which: NDArray[np.int64]) -> Flags:
        mask = np.zeros(self.num_envs, bool)
        mask[which] = True
        return mask

    def _info(self, infos: StructArray, present: Flags) -> dict[str, Any]:
        """Return the info as arrays by name, each with its mask."""
        return self._completed(_by_name(infos, present), infos, present)

    def _completed(self, info: dict[str, Any], infos: StructArray, present: Flags) -> dict[str, Any]:
        """Return ``info`` completed with non-field entries: names and flags."""
        truth = info["truth"]
        truth["specimen_class"], truth["_specimen_class"] = _where(present, self.batch.classes), present
        info["cost"], info["_cost"] = infos["cost"], present
        info["speed_out_of_range"], info["_speed_out_of_range"] = infos["out_of_range"] > 0, present
        for group, values in self.batch.further_infos().items():
            inside, info["_" + group] = info.setdefault(group, {}), present
            for name, value in values.items():
                inside[name], inside["_" + name] = np.where(present, value, 0.0), present
        return info

    def _add_ends(self, info: dict[str, Any], ended: Flags, ends: NDArray[np.int64]) -> None:
        info["end"], info["_end"] = _where(ended, self.batch.end_names[ends]), ended
        info["is_success"], info["_is_success"] = self.batch.succeeded() & ended, ended

    def _final(
        self, finished: NDArray[np.int64], ended: Flags, ends: NDArray[np.int64], infos: StructArray
    ) -> dict[str, Any]:
        """Return the last observation and info of ended cuts."""
        last = np.zeros_like(infos)
        last[finished] = infos[finished]
        final_info = self._info(last, ended)
        self._add_ends(final_info, ended, ends)
        final_obs = np.full(self.num_envs, None, dtype=object)
        shown = self._shown()
        for n in finished:  # an array of arrays, by Gymnasium's convention
            final_obs[n] = shown[n]
        return {"final_obs": final_obs, "_final_obs": ended, "final_info": final_info, "_final_info": ended}

    def close_extras(self, **kwargs: Any) -> None:
        """Release nothing: there are no resources to release."""


def _by_name(infos: StructArray, present: Flags) -> dict[str, Any]:
    """Return fields as views by group and name, with masks."""
    info: dict[str, Any] = {}
    for group, mask, fields in _NAMED:
        inside: dict[str, Any] = {}
        for name, field_mask, place in fields:
            inside[name], inside[field_mask] = infos[place], present
        info[group], info[mask] = inside, present
    return info


def _where(present: Flags, values: NDArray[Any]) -> NDArray[Any]:
    """Return the objects that are present; None elsewhere."""
    if np.count_nonzero(present) == len(present):  # faster than all()
        return values
    chosen = np.full(len(values), None, dtype=object)
    chosen[present] = values[present]
    return chosen
