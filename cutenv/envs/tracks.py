"""Tracks: ``cutenv/GentleCut-v1`` under frozen protocols, for comparison between authors."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from cutenv._base.validation import one_of, unexpected_keyword
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.vector import GentleCutVectorEnv, Observations
from cutenv.task.observation import CLIP, COMPONENTS
from cutenv.task.privileged import PRIVILEGED_FEATURES, append_privileged

PROTOCOL: dict[str, Any] = {"specimen_class": "mixed", "control_hz": 10}
"""Keyword arguments of ``cutenv/GentleCut-v1`` that every track fixes."""
COST_BUDGET_MM = 2.3
"""Budget of ``cutenv/SafeCut-v1`` for the mean cost of a cut [mm]: two thirds of what probe and creep costs.

PPO without a constraint costs three quarters of it: to keep to the budget it loses 0.010 of return.
"""


def _refuse(track: type[GentleCutEnv], keywords: dict[str, Any], taken: tuple[str, ...]) -> None:
    """Raise TypeError for a keyword that a track does not take."""
    for name in keywords:
        cure = "The protocol of a track is frozen: leave it out, or make cutenv/GentleCut-v1 with it."
        raise unexpected_keyword(track.__name__, name, taken, cure)


class SafeCutEnv(GentleCutEnv):
    """``cutenv/SafeCut-v1``: cut with the highest return within a cost budget.

    Observation, action, reward and ends are those of :class:`~cutenv.envs.gentle_cut.GentleCutEnv`, with specimens of
    class "mixed" and 10 decisions a second.  The cost of a step is ``info["cost"]`` [mm]; the mean over cuts of its
    sum over the cut must not exceed ``cost_budget_mm``.

    The only keywords are ``render_mode`` and ``flat_info``.
    """

    cost_budget_mm = COST_BUDGET_MM  # budget for the mean cost of a cut [mm]

    def __init__(self, *, flat_info: bool = False, render_mode: str | None = None, **others: Any) -> None:
        _refuse(SafeCutEnv, others, ("flat_info", "render_mode"))
        super().__init__(**PROTOCOL, flat_info=flat_info, render_mode=render_mode)


class SafeCutVectorEnv(GentleCutVectorEnv):
    """Many ``cutenv/SafeCut-v1``."""

    single_class = SafeCutEnv


class GentleCutRawEnv(GentleCutEnv):
    """``cutenv/GentleCutRaw-v1``: cut by the 12 raw numbers alone, with memory.

    Only memory can tell what is hidden.  Observation, action, reward and ends are those of
    :class:`~cutenv.envs.gentle_cut.GentleCutEnv`, with specimens of class "mixed" and 10 decisions a second.  The
    protocol allows any memory of past observations and actions (stacked observations, a recurrent network) and forbids
    features that are computed with knowledge of tissue or law.

    With ``hidden_state=True`` it is the fully observed twin: the hidden state of the simulator follows the 12 numbers,
    :data:`cutenv.task.privileged.PRIVILEGED_FEATURES`.  It bounds what memory can be worth, and its results are no
    results of the track.  The only other keywords are ``render_mode`` and ``flat_info``.
    """

    def __init__(
        self, *, hidden_state: bool = False, flat_info: bool = False, render_mode: str | None = None, **others: Any
    ) -> None:
        _refuse(GentleCutRawEnv, others, ("hidden_state", "flat_info", "render_mode"))
        self.hidden_state = one_of("hidden_state", hidden_state, (False, True))
        super().__init__(**PROTOCOL, flat_info=flat_info, render_mode=render_mode)
        if hidden_state:
            self.observation_space = spaces.Box(-CLIP, CLIP, (len(COMPONENTS) + len(PRIVILEGED_FEATURES),), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Draw the next specimen; ``options`` as in :class:`GentleCutEnv`."""
        observation, info = super().reset(seed=seed, options=options)
        return self._shown(observation), info

    def step(self, action: NDArray[np.float32]) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Command target speed and angle until the next decision."""
        observation, reward, ended, truncated, info = super().step(action)
        return self._shown(observation), reward, ended, truncated, info

    def _shown(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        if not self.hidden_state:
            return observation
        cuts, which = self.cutting.snapshot(), np.zeros(1, np.int64)
        return append_privileged(cuts, self.task, observation[None], which).reshape(-1)


class GentleCutRawVectorEnv(GentleCutVectorEnv):
    """Many ``cutenv/GentleCutRaw-v1``."""

    single_class = GentleCutRawEnv
    single: GentleCutRawEnv

    def _shown(self) -> Observations:
        observations = super()._shown()
        if not self.single.hidden_state:
            return observations
        shown = np.zeros((self.num_envs, len(COMPONENTS) + len(PRIVILEGED_FEATURES)), np.float32)
        begun = np.flatnonzero(self.batch.begun)
        shown[begun] = append_privileged(self.cuts, self.batch.task, observations[begun], begun)
        return shown
