"""Groups of environments that differ in their keyword arguments.

They are on rigs drawn at random, or easier than the task.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from stable_baselines3.common.vec_env import VecEnv

from cutenv._base.validation import parameter_table
from cutenv.agents.sb3 import FeatureVecEnv
from cutenv.envs.constants import Knowledge
from cutenv.sim.cutting.drive import Rig
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.cutting.sensor import SensorParameters

RANDOM_GROUPS = (Rig, SensorParameters, Knowledge)  # groups of the constants that are drawn


def random_rigs(count: int, seed: int) -> list[dict[str, float]]:
    """Draw keyword arguments of ``count`` rigs; the first has the defaults.

    Each constant is drawn uniformly between the ends of its sensitivity range, those of the parameter table.
    """
    swept = [row for row in parameter_table(*RANDOM_GROUPS) if row["sensitivity"]]
    ranges = {row["name"]: (row["default"], *row["sensitivity"]) for row in swept}
    rng = np.random.default_rng([seed, count])
    drawn = [
        {name: float(rng.uniform(min(values), max(values))) for name, values in ranges.items()} for _ in range(count)
    ]
    return [{}, *drawn[1:]]


class EnvironmentGroups(VecEnv):
    """Groups of :class:`~cutenv.agents.sb3.FeatureVecEnv` that share seeds and step together.

    Each group has keyword arguments of its own, such as the constants of a rig, beside ``arguments`` that all share;
    there are at least as many seeds, one for each environment, as groups.
    """

    def __init__(self, groups: Sequence[Mapping[str, float]], seeds: Sequence[int], **arguments: Any) -> None:
        parts = np.array_split(np.asarray(seeds), len(groups))
        if not len(parts[-1]):
            raise ValueError(f"{len(seeds)} environments are fewer than {len(groups)} groups; give more.")
        self.parts = [
            FeatureVecEnv(part.tolist(), **{**arguments, **own}) for part, own in zip(parts, groups, strict=True)
        ]
        self._ends = np.cumsum([part.num_envs for part in self.parts])[:-1]
        super().__init__(len(seeds), self.parts[0].observation_space, self.parts[0].action_space)

    @property
    def observations(self) -> np.ndarray:
        """Observations of ``cutenv/GentleCut-v1``, shape (n, 12)."""
        return np.concatenate([part.observations for part in self.parts])

    @property
    def cuts(self) -> int:
        """Number of cuts begun so far."""
        return sum(part.cuts for part in self.parts)

    @cuts.setter
    def cuts(self, number: int) -> None:
        for k, part in enumerate(self.parts):
            part.cuts = number if k == 0 else 0

    @property
    def seconds(self) -> float:
        """Time spent in steps and resets so far [s]."""
        return sum(part.seconds for part in self.parts)

    @property
    def first_episode(self) -> int:
        """Number of the episode with which :meth:`reset` begins every environment."""
        return self.parts[0].first_episode

    @first_episode.setter
    def first_episode(self, number: int) -> None:
        for part in self.parts:
            part.first_episode = number

    def reset(self) -> np.ndarray:
        """Reset every environment to episode :attr:`first_episode` of its seed."""
        return np.concatenate([part.reset() for part in self.parts])

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Return the environments' seeds, which were given one by one."""
        return [own for part in self.parts for own in part.seed(seed)]

    def set_options(self, options: list[dict[str, Any]] | dict[str, Any] | None = None) -> None:
        """Set options of the next reset, for all environments or each.

        See the environments of one rig.
        """
        bounds = itertools.pairwise([0, *self._ends.tolist(), None])
        for part, (first, last) in zip(self.parts, bounds, strict=True):
            part.set_options(options[first:last] if isinstance(options, list) else options)

    def step_async(self, actions: np.ndarray) -> None:
        """Store the actions, shape (n, 2), for :meth:`step_wait`."""
        for part, own in zip(self.parts, np.split(np.asarray(actions), self._ends), strict=True):
            part.step_async(own)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Return observations, rewards, ends and infos; ended cuts restart at once."""
        shown, rewards, ended, infos = zip(*(part.step_wait() for part in self.parts), strict=True)
        every = [info for own in infos for info in own]
        return np.concatenate(shown), np.concatenate(rewards), np.concatenate(ended), every

    def close(self) -> None:
        """Do nothing: the environments hold no files, processes or windows."""

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return what :meth:`~cutenv.agents.sb3.NativeVecEnv.env_is_wrapped` does, for each environment."""
        return self.parts[0].env_is_wrapped(wrapper_class, [0]) * len(list(self._get_indices(indices)))

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of each environment's ``GentleCutEnv``."""
        every = [value for part in self.parts for value in part.get_attr(attr_name)]
        return [every[n] for n in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Raise NotImplementedError: keyword arguments of environments are fixed."""
        self.parts[0].set_attr(attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Raise NotImplementedError: there are no single environments with methods."""
        return self.parts[0].env_method(method_name)


NEARER = (0.015, 0.025, 0.040, 0.055)
"""Distances before the target from which cuts of an easier task begin [m]; from 10 mm a cut could be over at once."""
COSTS_AT_FIRST = 0.1  # part of every cost that an easier task charges at first
IMPATIENCE = 1.0  # charge of an easier task at first for the whole time until the deadline, beside the reward


class EasierEnvironments(EnvironmentGroups):
    """Environments that begin easier than the task and become it.

    A curriculum for an actor that has learned nothing.

    Half of the cuts begin nearer to the target, at :data:`NEARER`, to the end.  Costs count a tenth at first, so that
    trying is not charged more than it gains; and time counts more, so that it does not pay to stand still and wait: an
    end for safety, too, is charged the time that is left.  Both become those of the task linearly, within the share
    ``until`` of the training, above 0; who trains sets ``share``, what is done of it.  Returns in the infos are the
    task's own.
    """

    def __init__(self, until: float, seeds: Sequence[int], **arguments: Any) -> None:
        groups: list[dict[str, float]] = [{}] * len(NEARER) + [{"start_before_target": distance} for distance in NEARER]
        super().__init__(groups, seeds, **arguments)
        self.share, self._until = 0.0, until
        single = self.parts[0].native.single
        self._decision = single.ticks * TICK / single.deadline  # share of a deadline

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Return observations, easier rewards, ends, infos; ended cuts restart at once."""
        shown, rewards, ended, infos = super().step_wait()
        easier = max(1.0 - self.share / self._until, 0.0)
        if easier:
            gained = np.concatenate([part.gained for part in self.parts])
            waited = np.full(len(rewards), self._decision)
            for n in np.flatnonzero(ended):
                if infos[n]["end"] not in ("finished", "deadline"):
                    waited[n] += max(1.0 - infos[n]["episode"]["l"] * self._decision, 0.0)
            costs = (1.0 - (1.0 - COSTS_AT_FIRST) * easier) * (gained - rewards)
            rewards = (gained - costs - IMPATIENCE * easier * waited).astype(np.float32)
        return shown, rewards, ended, infos
