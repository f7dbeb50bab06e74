"""Weights of the metrics by which a record without tip or target is scored: steadiness of the force alone."""

from __future__ import annotations

from collections.abc import Mapping

FORCE_WEIGHTS: Mapping[str, float] = {
    "force_rate": 0.30,
    "force_jerk": 0.20,
    "force_drops": 0.20,  # tissue that tears lets go of the blade
    "mean_force_drop": 0.15,
    "force_variation": 0.15,
}
"""Weights of the leading metrics' percentiles for a record without tip or target; they sum to 1.

They are a choice that follows research on force-based assessment: steadiness of the force leads, the peak force is only
a safety limit, and smoothness of the motion is reported but not scored.
"""
