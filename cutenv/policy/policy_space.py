"""Spaces of trained policies by environment: what they observe, how many numbers they act with, and their features."""

from __future__ import annotations

from dataclasses import dataclass

from cutenv.policy.depth_features import DepthFeatures
from cutenv.policy.features import Features
from cutenv.policy.path_features import PathFeatures
from cutenv.task.depth_terms import ALL_COMPONENTS
from cutenv.task.observation import COMPONENTS, Component
from cutenv.task.path_terms import ALL_PATH_COMPONENTS


@dataclass(frozen=True, kw_only=True)
class PolicySpace:
    """Components of an observation, names of the actions, and class of the features."""

    components: tuple[Component, ...]
    actions: tuple[str, ...]
    features: type[Features] | type[DepthFeatures] | type[PathFeatures]


GENTLE_SPACE = PolicySpace(components=COMPONENTS, actions=("speed", "angle"), features=Features)
"""Space of ``cutenv/GentleCut-v1``, and of every environment with the same observations and actions."""
DEPTH_SPACE = PolicySpace(
    components=ALL_COMPONENTS, actions=("speed", "angle", "descent"), features=DepthFeatures
)  # fmt: skip
"""Space of ``cutenv/DepthCut-v1``."""
PATH_SPACE = PolicySpace(components=ALL_PATH_COMPONENTS, actions=("speed", "angle", "turn"), features=PathFeatures)
"""Space of ``cutenv/PathCut-v1``."""
_OTHERS = {"cutenv/DepthCut-v1": DEPTH_SPACE, "cutenv/PathCut-v1": PATH_SPACE}


def space_of(environment: str) -> PolicySpace:
    """Return the space of a policy for the environment with this id."""
    return _OTHERS.get(environment, GENTLE_SPACE)
