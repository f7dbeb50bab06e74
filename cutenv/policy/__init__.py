"""Policies that need no learning library.

Functions from an observation to an action.
"""

from cutenv.policy.actor_network import Network, RecurrentNetwork
from cutenv.policy.features import Features
from cutenv.policy.interface import ArrayPolicy, Policy, PrivilegedPolicy
from cutenv.policy.planner import PlannerNominal, PlannerWithTruth
from cutenv.policy.scripted import (
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
from cutenv.policy.shipped import (
    BASELINES,
    CONSTANT_FEEDS,
    DEFAULT_SHIPPED,
    GRID_ANGLES,
    GRID_SPEEDS,
    NULL_POLICIES,
    ORACLE,
    SCRIPTS,
    SHIPPED,
    feed_name,
    gentle_policy,
    named_policy,
    shipped,
)
from cutenv.policy.tip_estimate import TipEstimate
from cutenv.policy.trained import PolicyCard, TrainedPolicy, save_policy

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
    "feed_name",
    "gentle_policy",
    "named_policy",
    "save_policy",
    "shipped",
]
