"""Studies of people by the metrics of their cuts.

Learning, reliability, separation. No claim of skill is made.
"""

from cutenv.records.scoring.study.crossover import Crossover, condition_of, crossover, crossovers
from cutenv.records.scoring.study.estimate import Estimate
from cutenv.records.scoring.study.learning import Cusum, LearningCurve, cusum, learning_curve
from cutenv.records.scoring.study.pass_mark import (
    ErrorRate,
    PassMark,
    Proficiency,
    Standard,
    StandardSetting,
    ValidityEvidence,
    pass_mark,
    proficiency,
    validity_evidence,
)
from cutenv.records.scoring.study.reliability import (
    Intraclass,
    OneWay,
    RaterAgreement,
    RaterCorrelation,
    intraclass_correlation,
    one_way_reliability,
    rater_agreement,
    rater_correlation,
)
from cutenv.records.scoring.study.separation import Separation, separation
from cutenv.records.scoring.study.study import Findings, NotEstimable, StudiedCut, Study

__all__ = [
    "Crossover",
    "Cusum",
    "ErrorRate",
    "Estimate",
    "Findings",
    "Intraclass",
    "LearningCurve",
    "NotEstimable",
    "OneWay",
    "PassMark",
    "Proficiency",
    "RaterAgreement",
    "RaterCorrelation",
    "Separation",
    "Standard",
    "StandardSetting",
    "StudiedCut",
    "Study",
    "ValidityEvidence",
    "condition_of",
    "crossover",
    "crossovers",
    "cusum",
    "intraclass_correlation",
    "learning_curve",
    "one_way_reliability",
    "pass_mark",
    "proficiency",
    "rater_agreement",
    "rater_correlation",
    "separation",
    "validity_evidence",
]
