"""Where a rig thinks the tip is: the blade less the elastic force over the nominal stiffness."""

from __future__ import annotations

from cutenv.compiled import for_kernels
from cutenv.cutting.law import depth_at, stiffness_at
from cutenv.cutting.records import TICK, Record, Records
from cutenv.terms import RUN_WINDOW, SMALLEST_RUN

_SETTLE = 50  # updates for which the blade must keep its direction: a delayed force holds the friction of before
_WINDOW = round(RUN_WINDOW / TICK)  # updates, whatever the decision rate
_ITERATIONS = 3  # of a = x - F/K(a): converges by K'(x - a)/K each time


@for_kernels
def estimate(task: Record, progress: Record, nominal: Record, readings: Records, tips: Records, jumps: Records) -> None:
    """Fill ``tips`` [m] and ``jumps`` [m], shape (ticks,), from what was felt."""
    a = progress.tip
    tick = round(progress.time / TICK)
    for i in range(len(readings)):
        tick += 1
        reading = readings[i]
        a, jumps[i] = estimated(task, progress, nominal, a, tick, reading.position, reading.speed, reading.force)
        tips[i] = a


@for_kernels
def estimated(
    task: Record, progress: Record, nominal: Record, a: float, tick: int, x: float, speed: float, force: float
) -> tuple[float, float]:
    """Tip and unstable growth [m] at update ``tick`` (from 1 at reset), the tip having been estimated at ``a`` before.

    A cut never heals, so the tip never goes back.  Over every 20 ms, the tip's advance beyond the blade's is taken for
    an unstable run, booked at their last millisecond.  ``progress`` remembers.
    """
    friction = task.friction_per_depth * depth_at(nominal, x)
    moving = 1.0 if speed > 0.0 else (-1.0 if speed < 0.0 else 0.0)
    progress.settled = progress.settled + 1 if moving == progress.direction else 0
    progress.direction = moving
    elastic = max(force - moving * friction, 0.0)
    guess = a
    for _ in range(_ITERATIONS):
        guess = x - elastic / stiffness_at(nominal, max(guess, 0.0))[0]
    if elastic > 0.0 and progress.settled >= _SETTLE:
        a = max(a, guess)
    jump = 0.0
    if tick % _WINDOW == 0:
        run = a - progress.window_tip - max(x - progress.window_position, 0.0)
        if run > SMALLEST_RUN:
            jump = run
        progress.window_tip = a
        progress.window_position = x
    return a, jump
