"""Baselines by name, each tuned on validation specimens, to which learned policies are compared."""

from __future__ import annotations

import math
from collections.abc import Callable

from cutenv.policy.feedback import ForceFeedback, ProbeAndCreep
from cutenv.policy.interface import Policy
from cutenv.policy.one_return_stroke import OneReturnStroke
from cutenv.policy.planner import PlannerNominal, PlannerWithTruth
from cutenv.policy.scripted import ConstantFeed, FastThenSlow, InclineBetween, NoAction, RandomAction

GRID_SPEEDS = (0.10, 0.38, 0.89, 1.27, 1.65, 2.16, 2.54)
"""Speeds of the constant feeds [cm/s]: the seven at which the tissue was measured."""
GRID_ANGLES = (45, 60, 75, 90)
"""Angles of the constant feeds [deg]."""

SCRIPTS: dict[str, Callable[[], Policy]] = {
    "fast then slow": FastThenSlow,
    "90-45-90": InclineBetween,
    "force feedback": ForceFeedback,
    "probe and creep": ProbeAndCreep,
    "return stroke": OneReturnStroke,
    "planner (nominal)": PlannerNominal,
}
"""Scripts that an engineer would program, besides the constant feeds."""
ORACLE = "planner with truth"
"""Name of the oracle: it knows the hidden state and does not compete."""
NULL_POLICIES: dict[str, Callable[[], Policy]] = {"random": RandomAction, "nothing": NoAction}


def feed_name(speed_cm_s: float, angle_deg: float) -> str:
    """Return the name of a constant feed."""
    return f"constant {speed_cm_s:.2f} cm/s {angle_deg:.0f} deg"


CONSTANT_FEEDS: dict[str, tuple[float, float]] = {
    feed_name(speed, angle): (speed, angle) for speed in GRID_SPEEDS for angle in GRID_ANGLES
}
"""Speed [cm/s] and angle [deg] of each constant feed, by name."""


def _feed(speed_cm_s: float, angle_deg: float) -> Callable[[], Policy]:
    return lambda: ConstantFeed(speed=speed_cm_s / 100.0, angle=math.radians(angle_deg))


BASELINES: dict[str, Callable[[], Policy]] = {
    **{name: _feed(*feed) for name, feed in CONSTANT_FEEDS.items()},
    **SCRIPTS,
    ORACLE: PlannerWithTruth,
    **NULL_POLICIES,
}
"""All baselines by name; call a value to make the policy."""
