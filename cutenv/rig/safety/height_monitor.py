"""Checks of the height axis, as of the blade's motion along the cut; a blade that cannot be raised is a fault."""

from __future__ import annotations

from cutenv.rig.safety.linear_monitor import LinearMonitor
from cutenv.rig.safety.stop_causes import Breach, Cause


class HeightMonitor(LinearMonitor):
    """Monitor of the height axis; commands are upwards."""

    def _stuck(self, command: float) -> Breach:
        if command > 0.0:
            return Breach(Cause.NOT_RAISED, f"commanded upwards at {1e3 * command:.1f} mm/s, but the encoder stands")
        return Breach(Cause.STUCK, f"commanded downwards at {-1e3 * command:.1f} mm/s, but the encoder stands")

    def _astray(self, off: float, command: float) -> Breach:
        cause = Cause.NOT_RAISED if command > 0.0 > off else Cause.FOLLOWING
        return Breach(cause, f"the blade is {1e3 * off:+.2f} mm above where it should be")
