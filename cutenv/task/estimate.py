"""Where a rig thinks the tip is: the blade less the elastic force over the nominal stiffness."""

from __future__ import annotations

from cutenv.compiled import compiled
from cutenv.cutting.law import depth_at, stiffness_at
from cutenv.cutting.records import Record, Records

_RUN = 0.3e-3  # [m] of tip advance beyond the blade's own, below which it is noise and not an unstable run
_ITERATIONS = 3  # of a = x - F/K(a): converges by K'(x - a)/K each time


@compiled
def estimate(
    task: Record, progress: Record, nominal: Records, readings: Records, tips: Records, jumps: Records
) -> None:
    """Fill ``tips`` [m] and ``jumps`` [m], shape (ticks,), from what was felt.

    A cut never heals, so the tip never goes back.  Over the step as a whole, the tip's advance beyond the blade's is
    taken for an unstable run, booked at the last tick.
    """
    a = progress.tip
    start = a
    for i in range(len(readings)):
        reading = readings[i]
        friction = task.friction_per_depth * depth_at(nominal, reading.position)
        moving = 1.0 if reading.speed > 0.0 else (-1.0 if reading.speed < 0.0 else 0.0)
        elastic = max(reading.force - moving * friction, 0.0)
        guess = a
        for _ in range(_ITERATIONS):
            guess = reading.position - elastic / stiffness_at(nominal, max(guess, 0.0))[0]
        if elastic > 0.0:
            a = max(a, guess)
        tips[i] = a
        jumps[i] = 0.0
    feed = max(readings[len(readings) - 1].position - progress.position, 0.0)
    run = a - start - feed
    if run > _RUN:
        jumps[len(readings) - 1] = run
