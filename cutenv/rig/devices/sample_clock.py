"""Sample times of readings: packets arrive with jitter, but their numbers are regular."""

from __future__ import annotations

from cutenv._base.validation import in_range

SEQUENCES = 1 << 32
"""Numbers of readings, which are counted modulo this."""
LEAK = 1e-3
"""Rate at which the least delay may grow [s/s]: ten times the drift between two quartz clocks."""
FAR = 100
"""Number of readings by which an old one may come late; beyond it, the sensor has restarted."""
_AHEAD = 1.0  # [s] by which a number may come early and still belong to the same stream


class SampleClock:
    """Estimator of the even time grid on which readings were sampled.

    A reading ``n`` cannot arrive before it was sampled, and some arrive with almost no delay. The least delay seen
    (over ``n / rate``) is therefore taken as the transport delay; anything above it is lateness. The least delay grows
    at ``leak``, so that it follows a sensor whose clock runs slower than this computer's; it follows a faster one by
    itself. An added constant delay shows at once in full, and is forgotten at that same rate: 10 ms of it in 10 s.

    Parameters
    ----------
    rate : float
        Rate of the readings [Hz], as the sensor reports it.
    leak : float
        Rate at which the least delay may grow [s/s], above the relative error of ``rate``.

    Raises
    ------
    ValueError
        If the rate is not above zero.
    """

    def __init__(self, rate: float, leak: float = LEAK) -> None:
        self._period = 1.0 / in_range("rate", rate, 1e-3, 1e6, "Hz", "Give the readings a second of the sensor.")
        self._leak = leak
        self._sequence = -1  # of the last reading; -1: none so far
        self._elapsed = 0.0  # [s] by the sensor's numbers, since the first
        self._least = 0.0  # [s] of the clock at which reading zero would have arrived, had it come without delay
        self._arrival = 0.0
        self._time = 0.0

    def sensed(self, sequence: int, arrival: float) -> tuple[float, float]:
        """Return when a reading was sampled, and how much later than usual it arrives.

        Parameters
        ----------
        sequence : int
            Number of the reading, modulo 2**32; missing ones in between do not matter.
        arrival : float
            Arrival on the clock [s].

        Returns
        -------
        time : float
            Time of sampling [s], up to the least transport delay, which cannot be known; never after its arrival, and
            never before that of an earlier call.
        lateness : float
            Delay beyond the least one [s], 0 or more.
        """
        if self._sequence < 0:
            return self._begin(sequence, arrival)
        step = (sequence - self._sequence) % SEQUENCES
        if step >= SEQUENCES // 2:
            step -= SEQUENCES  # an earlier one
        elapsed = self._elapsed + step * self._period
        delay = arrival - elapsed
        # A restarted sensor counts from the beginning again, or from anywhere.
        if step < -FAR or delay < self._least - _AHEAD:
            return self._begin(sequence, arrival)
        self._least = min(self._least + self._leak * max(arrival - self._arrival, 0.0), delay)
        self._sequence, self._elapsed, self._arrival = sequence, elapsed, arrival
        self._time = max(self._time, self._least + elapsed)
        return self._time, delay - self._least

    def _begin(self, sequence: int, arrival: float) -> tuple[float, float]:
        self._sequence, self._elapsed = sequence, 0.0
        self._least = self._arrival = self._time = arrival
        return arrival, 0.0
