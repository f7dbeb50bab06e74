"""A person's hand beside an agent, whose action it replaces."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

PersonsAction = Callable[[], NDArray[np.float32] | None]
"""Asked once a decision: the action of a person who intervenes, in the environment's action space, else None."""


class SharedControl(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Environment in which a person can override the agent's decisions.

    ``info["is_intervention"]`` says whether the person's action was carried out, and ``info["action"]`` which action
    was, as recorders need it. The agent goes on to observe, and leads again at the first decision without a person.

    Parameters
    ----------
    env : gymnasium.Env
        Environment of this package, in simulation or on a rig.
    person : callable
        Returns the action of a person who intervenes, or None; see :data:`PersonsAction`. It must not wait.

    Examples
    --------
    >>> import cutenv
    >>> env = SharedControl(gymnasium.make("cutenv/GentleCut-v1"), lambda: np.array([0.3, 1.0], np.float32))
    >>> _ = env.reset(seed=0)
    >>> info = env.step(np.array([1.0, 0.0], np.float32))[-1]
    >>> info["is_intervention"], info["action"].tolist()
    (True, [0.30000001192092896, 1.0])
    """

    def __init__(self, env: gymnasium.Env[Any, Any], person: PersonsAction) -> None:
        super().__init__(env)
        self._person = person

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin a cut; see the environment."""
        observation, info = super().reset(seed=seed, options=options)
        return observation, {**info, "is_intervention": False}

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Apply the person's action, if any, else the agent's.

        ValueError names a person's action that is not in the action space; the environment is then not stepped.
        """
        persons = self._person()
        intervenes = persons is not None
        if intervenes and not self.action_space.contains(persons):
            raise ValueError(
                f"the person's action {persons!r} is not in {self.action_space}. Give float32 in it, or None."
            )
        carried_out = persons if intervenes else action
        observation, reward, terminated, truncated, info = self.env.step(carried_out)
        told = {"is_intervention": intervenes, "action": np.array(carried_out, np.float32)}
        return observation, reward, terminated, truncated, {**info, **told}
