"""Sim-to-real comparison of a policy on rig and simulator.

By paired differences, curves, and the control clock.
"""

from cutenv.agents.sim_to_real.equivalence import (
    FEWEST_SPECIMENS,
    Agreement,
    EffectEstimate,
    Finding,
    Inconclusive,
    Verdict,
    holm,
    mean_shift,
    signed_rank_shift,
)
from cutenv.agents.sim_to_real.measures import (
    MEASURES,
    ClockKept,
    ComparedCut,
    Measure,
    force_over_position,
    force_rmse,
    position_rmse,
)

__all__ = [
    "FEWEST_SPECIMENS",
    "MEASURES",
    "Agreement",
    "ClockKept",
    "ComparedCut",
    "EffectEstimate",
    "Finding",
    "Inconclusive",
    "Measure",
    "Verdict",
    "force_over_position",
    "force_rmse",
    "holm",
    "mean_shift",
    "position_rmse",
    "signed_rank_shift",
]
