"""Policies that need no learning library: they see an observation and answer with an action."""

from cutenv.policy.interface import Policy
from cutenv.policy.scripted import ConstantFeed, FastThenSlow, NoAction, RandomAction
from cutenv.policy.tip_estimate import TipEstimate
from cutenv.policy.unloading import StopAndUnload

__all__ = [
    "ConstantFeed",
    "FastThenSlow",
    "NoAction",
    "Policy",
    "RandomAction",
    "StopAndUnload",
    "TipEstimate",
]
