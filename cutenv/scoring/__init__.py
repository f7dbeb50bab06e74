"""One score for people, scripts, agents and rigs, from what a rig can measure."""

from cutenv.scoring import force, motion, outcome  # noqa: F401  they enter their metrics
from cutenv.scoring.card import ScoreCard, Scored, score
from cutenv.scoring.cut import ScoredCut, Truth
from cutenv.scoring.faults import Fault
from cutenv.scoring.metric import INVARIANCES, METRICS, Metric, Unavailable
from cutenv.scoring.reference import ReferenceSet
from cutenv.scoring.weights import ForceOnlyWeights, Weights

__all__ = [
    "INVARIANCES",
    "METRICS",
    "Fault",
    "ForceOnlyWeights",
    "Metric",
    "ReferenceSet",
    "ScoreCard",
    "Scored",
    "ScoredCut",
    "Truth",
    "Unavailable",
    "Weights",
    "score",
]
