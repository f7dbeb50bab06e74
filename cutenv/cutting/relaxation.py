"""Viscoelastic relaxation of the tissue: an option, off unless a share of the modulus is set to relax.

One Maxwell arm beside a spring: the spring K responds at once, and part of what it holds creeps away.  With rho the
relaxing share, u the displacement of the tissue at the tip (x - a while the blade holds it), and g the part of u that
has crept,

    F = K (u - g),        dg/dt = (rho u - g) / ((1 - rho) T),

so that a held blade's force falls to (1 - rho) K u, and free tissue recovers within T, the time constant of creep
under constant load.  The stored energy is K (u - g)^2 / 2 + K g^2 (1 - rho) / (2 rho).  The law uses u - g in place of
x - a.
"""

from __future__ import annotations

from cutenv._base.arrays import Struct
from cutenv._engine.jit import njit_inline


@njit_inline
def crept(law: Struct, reach: float, creep: float, dt: float) -> float:
    """Return the creep g [m] after ``dt``, for a blade ``reach`` [m] ahead of the tip."""
    rate = dt / ((1.0 - law.relaxing_share) * law.creep_time)
    return (creep + rate * law.relaxing_share * max(reach, creep)) / (1.0 + rate)  # type: ignore[no-any-return]


@njit_inline
def energy_of_creep(law: Struct, K: float, creep: float) -> float:
    """Return the energy [J] that the tissue would give back as it recovers."""
    return 0.5 * K * creep**2 * (1.0 - law.relaxing_share) / law.relaxing_share  # type: ignore[no-any-return]


@njit_inline
def relaxed(law: Struct, K: float, reach: float, creep: float, dt: float) -> tuple[float, float, float, float]:
    """Return creep [m] after ``dt``, its energy before and then, and the loss [J]; the blade is ``reach`` [m] ahead."""
    here = energy_of_creep(law, K, creep)
    next_creep = crept(law, reach, creep, dt)
    next_locked = energy_of_creep(law, K, next_creep)
    before = 0.5 * K * max(reach - creep, 0.0) ** 2 + here
    after = 0.5 * K * max(reach - next_creep, 0.0) ** 2 + next_locked
    return next_creep, here, next_locked, before - after
