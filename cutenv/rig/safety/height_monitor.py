"""Checks of the height axis, as of the blade's motion along the cut; a blade that cannot be raised is a fault."""

from __future__ import annotations

from cutenv.rig.config.settings import HeightAxis
from cutenv.rig.safety.following_monitor import NOMINAL_LAG, FollowingMonitor
from cutenv.rig.safety.linear_monitor import LinearLimits, LinearMonitor
from cutenv.rig.safety.stop_causes import Breach, Cause

_SLOW = 3e-4  # [m/s] expected speed below which the axis may stand still: it lowers the blade by tenths of a millimetre
_UNMOVED = 5e-6  # [m] within which it counts as standing


class HeightMonitor(LinearMonitor):
    """Monitor of the height axis; commands are upwards.

    Parameters
    ----------
    axis : HeightAxis
        The axis with its limits.
    sync : float
        Time between samples [s].
    """

    def __init__(self, axis: HeightAxis, sync: float) -> None:
        limits = LinearLimits(
            axis.lowest, axis.highest, axis.fastest, axis.most_acceleration, axis.following, outside=Cause.HEIGHT,
            place="blade at a height of", way=" upwards",
        )  # fmt: skip
        following = FollowingMonitor(
            lag=NOMINAL_LAG, acceleration=axis.acceleration, sync=sync, slow=_SLOW, unmoved=_UNMOVED
        )
        super().__init__(limits, following, sync)

    def _stuck(self, command: float) -> Breach:
        if command > 0.0:
            return Breach(Cause.NOT_RAISED, f"commanded upwards at {1e3 * command:.1f} mm/s, but the encoder stands")
        return Breach(Cause.STUCK, f"commanded downwards at {-1e3 * command:.1f} mm/s, but the encoder stands")

    def _astray(self, off: float, command: float) -> Breach:
        cause = Cause.NOT_RAISED if command > 0.0 > off else Cause.FOLLOWING
        return Breach(cause, f"the blade is {1e3 * off:+.2f} mm above where it should be")
