"""Spaces of trained policies by environment: what they observe, how many numbers they act with, and their features."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from cutenv._base.validation import one_of
from cutenv.policy.baselines import SCRIPTS
from cutenv.policy.depth_features import DepthFeatures
from cutenv.policy.depth_scripts import DEPTH_SCRIPTS
from cutenv.policy.features import Features
from cutenv.policy.interface import ArrayPolicy, Policy, as_array_policy
from cutenv.policy.path_features import PathFeatures
from cutenv.policy.path_scripts import PATH_SCRIPTS
from cutenv.task.depth import DEPTH_CUT
from cutenv.task.observation import COMPONENTS, Component
from cutenv.task.path import PATH_CUT


@dataclass(frozen=True, kw_only=True)
class PolicySpace:
    """Components of an observation, names of the actions, class of the features, and scripts by name."""

    components: tuple[Component, ...]
    actions: tuple[str, ...]
    features: type[Features] | type[DepthFeatures] | type[PathFeatures]
    scripts: Mapping[str, Callable[[], Policy]]

    def script(self, name: str) -> ArrayPolicy:
        """Make the script of that name.

        Raises
        ------
        ValueError
            If there is none.
        """
        return as_array_policy(self.scripts[one_of("script", name, self.scripts)]())


GENTLE_SPACE = PolicySpace(components=COMPONENTS, actions=("speed", "angle"), features=Features, scripts=SCRIPTS)
"""Space of ``cutenv/GentleCut-v1``, and of every environment with the same observations and actions."""
DEPTH_SPACE = PolicySpace(
    components=DEPTH_CUT.all_components, actions=DEPTH_CUT.action_names, features=DepthFeatures, scripts=DEPTH_SCRIPTS
)  # fmt: skip
"""Space of ``cutenv/DepthCut-v1``."""
PATH_SPACE = PolicySpace(
    components=PATH_CUT.all_components, actions=PATH_CUT.action_names, features=PathFeatures, scripts=PATH_SCRIPTS
)
"""Space of ``cutenv/PathCut-v1``."""
_OTHERS = {"cutenv/DepthCut-v1": DEPTH_SPACE, "cutenv/PathCut-v1": PATH_SPACE}


def space_of(environment: str) -> PolicySpace:
    """Return the space of a policy for the environment with this id."""
    return _OTHERS.get(environment, GENTLE_SPACE)
