"""The rig's estimate of the crack tip: blade position less elastic force over nominal stiffness."""

from __future__ import annotations

from cutenv._base.arrays import Struct
from cutenv._engine.jit import njit_inline, njit_internal
from cutenv.cutting.dtypes import TICK
from cutenv.cutting.law import depth_at, stiffness_at
from cutenv.cutting.parameters import LawParameters
from cutenv.task_quantities import RUN_WINDOW, SMALLEST_RUN

PRESLIDING = LawParameters().presliding_length
"""Motion over which friction is taken to reverse [m]."""
_SETTLE = 50  # updates for which friction must have kept its direction, because the measured force is delayed
_WINDOW = round(RUN_WINDOW / TICK)  # updates, independent of the decision rate
_ITERATIONS = 3  # of a = x - F/K(a): converges by K'(x - a)/K each time


@njit_inline
def dragged(bristle: float, moved: float) -> float:
    """Return the deflection [m] of friction's bristles after the blade has moved: limited to the presliding length."""
    return min(max(bristle + moved, -PRESLIDING), PRESLIDING)


@njit_internal
def estimated_tip(
    task: Struct, progress: Struct, nominal: Struct, a: float, tick: int, x: float, speed: float, force: float
) -> tuple[float, float]:
    """Return tip and unstable growth [m] at update ``tick`` (from 1 at reset), given the last estimate ``a``.

    A cut never heals, so the tip never goes back.  In every window of 20 ms, the tip's advance beyond the blade's
    counts as an unstable run, booked at the window's last millisecond.  ``progress`` is changed in place.
    """
    friction = task.friction_per_depth * depth_at(nominal, x)
    bristle = dragged(progress.bristle, speed * TICK)
    progress.settled = progress.settled + 1 if bristle == progress.bristle else 0
    progress.bristle = bristle
    elastic = max(force - bristle / PRESLIDING * friction, 0.0)
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
