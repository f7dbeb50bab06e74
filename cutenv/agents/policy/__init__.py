"""Policies that need no learning library.

Functions from an observation to an action.
"""

from cutenv.agents.policy.actor_network import Network, RecurrentNetwork
from cutenv.agents.policy.features import Features
from cutenv.agents.policy.interface import ArrayPolicy, Policy, PrivilegedPolicy
from cutenv.agents.policy.planner import PlannerNominal, PlannerWithTruth
from cutenv.agents.policy.scripted import (
    ConstantFeed,
    FastThenSlow,
    ForceFeedback,
    InclineBetween,
    NoAction,
    OneReturnStroke,
    ProbeAndCreep,
    RandomAction,
    Script,
    StopAndUnload,
)
from cutenv.agents.policy.shipped import (
    BASELINES,
    CONSTANT_FEEDS,
    DEFAULT_SHIPPED,
    GRID_ANGLES,
    GRID_SPEEDS,
    NULL_POLICIES,
    ORACLE,
    SCRIPTS,
    SHIPPED,
    experts,
    feed_name,
    gentle_policy,
    named_policy,
    shipped,
)
from cutenv.agents.policy.tip_estimate import TipEstimate
from cutenv.agents.policy.trained import PolicyCard, TrainedPolicy, save_policy

__all__ = [
    "BASELINES",
    "CONSTANT_FEEDS",
    "DEFAULT_SHIPPED",
    "GRID_ANGLES",
    "GRID_SPEEDS",
    "NULL_POLICIES",
    "ORACLE",
    "SCRIPTS",
    "SHIPPED",
    "ArrayPolicy",
    "ConstantFeed",
    "FastThenSlow",
    "Features",
    "ForceFeedback",
    "InclineBetween",
    "Network",
    "NoAction",
    "OneReturnStroke",
    "PlannerNominal",
    "PlannerWithTruth",
    "Policy",
    "PolicyCard",
    "PrivilegedPolicy",
    "ProbeAndCreep",
    "RandomAction",
    "RecurrentNetwork",
    "Script",
    "StopAndUnload",
    "TipEstimate",
    "TrainedPolicy",
    "experts",
    "feed_name",
    "gentle_policy",
    "named_policy",
    "save_policy",
    "shipped",
]
