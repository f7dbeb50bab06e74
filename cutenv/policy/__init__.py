"""Policies that need no learning library: functions from an observation to an action."""

from cutenv.policy.actor_network import Network
from cutenv.policy.baselines import (
    BASELINES,
    CONSTANT_FEEDS,
    GRID_ANGLES,
    GRID_SPEEDS,
    NULL_POLICIES,
    ORACLE,
    SCRIPTS,
    feed_name,
)
from cutenv.policy.features import Features
from cutenv.policy.feedback import ForceFeedback, ProbeAndCreep
from cutenv.policy.interface import ArrayPolicy, Policy, PrivilegedPolicy
from cutenv.policy.one_return_stroke import OneReturnStroke
from cutenv.policy.planner import PlannerNominal, PlannerWithTruth
from cutenv.policy.recurrent import RecurrentNetwork
from cutenv.policy.scripted import ConstantFeed, FastThenSlow, InclineBetween, NoAction, RandomAction, Script
from cutenv.policy.shipped import DEFAULT_SHIPPED, SHIPPED, gentle_policy, named_policy, shipped
from cutenv.policy.tip_estimate import TipEstimate
from cutenv.policy.trained import PolicyCard, TrainedPolicy, save_policy
from cutenv.policy.unloading import StopAndUnload

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
