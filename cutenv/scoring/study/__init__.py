"""Studies of people by the metrics of their cuts: learning, reliability, separation. No claim of skill is made."""

from cutenv.scoring.study.estimate import Estimate
from cutenv.scoring.study.learning import Cusum, LearningCurve, cusum, learning_curve
from cutenv.scoring.study.reliability import Intraclass, OneWay, intraclass_correlation, one_way_reliability
from cutenv.scoring.study.separation import Separation, separation
from cutenv.scoring.study.study import Findings, NotEstimable, StudiedCut, Study, numbered

__all__ = [
    "Cusum",
    "Estimate",
    "Findings",
    "Intraclass",
    "LearningCurve",
    "NotEstimable",
    "OneWay",
    "Separation",
    "StudiedCut",
    "Study",
    "cusum",
    "intraclass_correlation",
    "learning_curve",
    "numbered",
    "one_way_reliability",
    "separation",
]
