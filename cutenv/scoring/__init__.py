"""One score for people, scripts, agents and rigs, from what a rig can measure."""

from cutenv.scoring import cut_metrics  # noqa: F401  they enter their metrics
from cutenv.scoring.cut_map import DepthMap, PathMap
from cutenv.scoring.cut_metrics import INVARIANCES, MAP_METRICS, METRICS, Metric, all_metrics
from cutenv.scoring.points import ScorePoints
from cutenv.scoring.reference import ReferenceSet
from cutenv.scoring.score_card import ScoreCard, Scored, score
from cutenv.scoring.scored_cut import ScoredCut
from cutenv.scoring.technique import TechniqueFault
from cutenv.scoring.truth import Truth
from cutenv.scoring.validity import Unavailable

__all__ = [
    "INVARIANCES",
    "MAP_METRICS",
    "METRICS",
    "DepthMap",
    "Metric",
    "PathMap",
    "ReferenceSet",
    "ScoreCard",
    "ScorePoints",
    "Scored",
    "ScoredCut",
    "TechniqueFault",
    "Truth",
    "Unavailable",
    "all_metrics",
    "score",
]
