"""What was measured of a rig, as the simulator takes it."""

from __future__ import annotations

from cutenv.rig.settings import Identified

SIMULATED = (
    "motor_lag", "dead_time", "acceleration", "backlash", "force_noise", "force_resolution", "force_drift",
)  # fmt: skip
"""Fields that are constants of the simulated rig too, under the same names.  Friction of the axis is none: a stiff
drive does not yield to it, and the sensor sits behind it."""


def environment_arguments(identified: Identified) -> dict[str, float]:
    """Keyword arguments for ``gymnasium.make("cutenv/GentleCut-v1", ...)`` in SI: only what was measured.

    Examples
    --------
    >>> environment_arguments(Identified(motor_lag=0.052, friction=3.0))
    {'motor_lag': 0.052}
    """
    measured = {name: getattr(identified, name) for name in SIMULATED}
    return {name: float(value) for name, value in measured.items() if value is not None}
