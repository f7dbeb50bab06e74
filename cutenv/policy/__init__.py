"""Policies that need no learning library: functions from an observation to an action."""

from cutenv.policy.baselines import BASELINES, BOUND, GRID, GRID_ANGLES, GRID_SPEEDS, IDLE, SCRIPTS, feed_name
from cutenv.policy.features import FeatureBatch, Features, past_dead_zone
from cutenv.policy.feedback import ForceFeedback, ProbeAndCreep
from cutenv.policy.interface import Policy, SeesTruth
from cutenv.policy.network import Network
from cutenv.policy.planner import PlannerNominal, PlannerWithTruth
from cutenv.policy.recurrent import RecurrentNetwork
from cutenv.policy.scripted import ConstantFeed, FastThenSlow, InclineBetween, NoAction, RandomAction, Script
from cutenv.policy.shipped import SHIPPED, SHOWN, named_policy, shipped
from cutenv.policy.tip_estimate import TipEstimate
from cutenv.policy.trained import PolicyBatch, PolicyCard, TrainedPolicy, save_policy
from cutenv.policy.unloading import StopAndUnload

__all__ = [
    "BASELINES",
    "BOUND",
    "GRID",
    "GRID_ANGLES",
    "GRID_SPEEDS",
    "IDLE",
    "SCRIPTS",
    "SHIPPED",
    "SHOWN",
    "ConstantFeed",
    "FastThenSlow",
    "FeatureBatch",
    "Features",
    "ForceFeedback",
    "InclineBetween",
    "Network",
    "NoAction",
    "PlannerNominal",
    "PlannerWithTruth",
    "Policy",
    "PolicyBatch",
    "PolicyCard",
    "ProbeAndCreep",
    "RandomAction",
    "RecurrentNetwork",
    "Script",
    "SeesTruth",
    "StopAndUnload",
    "TipEstimate",
    "TrainedPolicy",
    "feed_name",
    "named_policy",
    "past_dead_zone",
    "save_policy",
    "shipped",
]
