"""Sim-to-real comparison of a policy on a rig and in the simulator: paired differences, curves, the control clock."""

from cutenv.agreement.agreement import Agreement, Finding, Untold, Verdict
from cutenv.agreement.clock import ClockKept
from cutenv.agreement.curves import force_over_position, force_rmse, position_rmse
from cutenv.agreement.cut import ComparedCut
from cutenv.agreement.measures import MEASURES, Measure
from cutenv.agreement.shift import FEWEST, Shift, holm, mean_shift, signed_rank_shift

__all__ = [
    "FEWEST",
    "MEASURES",
    "Agreement",
    "ClockKept",
    "ComparedCut",
    "Finding",
    "Measure",
    "Shift",
    "Untold",
    "Verdict",
    "force_over_position",
    "force_rmse",
    "holm",
    "mean_shift",
    "position_rmse",
    "signed_rank_shift",
]
