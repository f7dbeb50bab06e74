"""When a reading was sensed: packets come with jitter, their numbers do not."""

from __future__ import annotations

from cutenv.rig.netft.packets import SEQUENCES
from cutenv.validation import in_range

LEAK = 1e-3
"""Seconds a second by which the least delay is allowed to grow: ten times what two quartz clocks drift apart."""
FAR = 100
"""Readings by which an old one may come late; beyond, the sensor has begun anew."""
_AHEAD = 1.0  # [s] by which a number comes too early to be of the same stream


class SampleClock:
    """Puts readings back on the even grid on which they were sensed.

    A reading ``n`` cannot arrive before it was sensed, and some arrive with almost no delay.  The least delay seen
    (over ``n / rate``) is therefore taken for the way's own; what is above it is lateness.  The least delay leaks
    upwards by ``LEAK``, so that it follows a sensor whose clock runs slower than this computer's; of a faster one it
    follows by itself.  A delay that is added and stays shows at once in full, and is forgotten at that same rate:
    10 ms of it in 10 s.

    Parameters
    ----------
    rate : float
        Readings a second [Hz], as the sensor says.

    Raises
    ------
    ValueError
        If the rate is not above zero.
    """

    def __init__(self, rate: float) -> None:
        self._period = 1.0 / in_range("rate", rate, 1e-3, 1e6, "Hz", "Give the readings a second of the sensor.")
        self._sequence = -1  # of the last reading, none so far
        self._elapsed = 0.0  # [s] by the sensor's numbers, since the first
        self._least = 0.0  # [s] of the clock at which reading zero would have arrived, had it come without delay
        self._arrival = 0.0
        self._time = 0.0

    def sensed(self, sequence: int, arrival: float) -> tuple[float, float]:
        """Say when a reading was sensed, and how much later than usual it comes.

        Parameters
        ----------
        sequence : int
            Of the reading, modulo 2**32; what is missing between is no matter.
        arrival : float
            Of the clock [s].

        Returns
        -------
        time : float
            When it was sensed [s], up to the least delay of the way, which nobody can know; never after its arrival,
            and never before that of an earlier call.
        lateness : float
            Beyond the least delay [s], 0 or more.
        """
        if self._sequence < 0:
            return self._begin(sequence, arrival)
        step = (sequence - self._sequence) % SEQUENCES
        if step >= SEQUENCES // 2:
            step -= SEQUENCES  # an earlier one
        elapsed = self._elapsed + step * self._period
        delay = arrival - elapsed
        # A sensor that was restarted counts from the beginning again, or from anywhere.
        if step < -FAR or delay < self._least - _AHEAD:
            return self._begin(sequence, arrival)
        self._least = min(self._least + LEAK * max(arrival - self._arrival, 0.0), delay)
        self._sequence, self._elapsed, self._arrival = sequence, elapsed, arrival
        self._time = max(self._time, self._least + elapsed)
        return self._time, delay - self._least

    def _begin(self, sequence: int, arrival: float) -> tuple[float, float]:
        self._sequence, self._elapsed = sequence, 0.0
        self._least = self._arrival = self._time = arrival
        return arrival, 0.0
