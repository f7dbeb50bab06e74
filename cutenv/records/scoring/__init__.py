"""Score for people, scripts, agents and rigs, from measurable quantities.

A record is looked at before it is scored: ``record_check`` names faults of its signal for the person who made it
(``cutenv check``), ``validity`` refuses what cannot be scored, ``doubts`` notes what can hardly be true.
"""

from cutenv.records.scoring import cut_metrics  # noqa: F401  they enter their metrics
from cutenv.records.scoring.cut_map import DepthMap, PathMap
from cutenv.records.scoring.cut_metrics import INVARIANCES, MAP_METRICS, METRICS, Metric, all_metrics
from cutenv.records.scoring.points import ScorePoints
from cutenv.records.scoring.reference import ReferenceSet
from cutenv.records.scoring.score_card import ScoreCard, Scored, score
from cutenv.records.scoring.scored_cut import ScoredCut
from cutenv.records.scoring.technique import TechniqueFault
from cutenv.records.scoring.truth import Truth
from cutenv.records.scoring.validity import Unavailable

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
