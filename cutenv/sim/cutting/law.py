"""The cutting law.

The parts of the tissue's response to one small motion of the blade.

:func:`cutenv.sim.cutting.update.cut_row` puts them together.

A blade at x stands ahead of the crack tip at a; the tissue between pulls back with F = K(a) (x - a).  The crack
grows in two ways: steadily while the blade loads it (which is why the measured modulus falls with speed and angle),
and in sudden runs once the force reaches the initiation force.  A ledger keeps the energy account exact:

    work = stored + fracture + friction + loss + ledger        at every instant, for every motion.

Symbols: x, a blade and tip [m]; theta angle [rad], 90 degrees upright; K stiffness [N/m]; R fracture resistance
without its share of friction [J/m2]; B depth [m]; eta excess of the initiation force; U = K (x - a)^2 / 2 [J].
Source: chapters 3 to 6 of the thesis (docs/validation); :mod:`cutenv.sim.cutting.dtypes` lists which constants are
measured, derived or assumed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.elementary import cotangent
from cutenv._engine.jit import njit, njit_inline, njit_internal
from cutenv.sim.tissue.specimen import N_POINTS, POINTS_PER_METRE

LONGEST_ADVANCE = 1e-4  # stable growth [m] that is integrated in one piece: over it R B is taken to change linearly
_MOST_PARTS = 1024  # limit on the parts of a longer one: even across the whole specimen, each stays below 0.15 mm
_SOFTEST = 0.1  # share of K: if force hardly falls with growth, the tip would have to leap; loading is then elastic


class Loading(NamedTuple):
    """Motion of a blade that loads the tissue."""

    x: float  # position of the blade at its end [m]
    length: float  # length of the motion [m]
    speed: float  # speed of the blade [m/s]
    angle: float  # angle of the blade [rad]


class Loaded(NamedTuple):
    """Crack tip and tissue before a step of loading."""

    a: float  # tip [m]
    F: float  # elastic force [N]
    U: float  # stored energy [J]
    K: float  # stiffness at the tip [N/m]
    toughness: float  # R B there [N]
    ledger: float  # ledger [J]


class RunningCrack(NamedTuple):
    """Tip of a running crack, and the energies of its growth."""

    tip: float  # tip [m]
    ledger: float  # ledger [J]
    fracture: float  # fracture energy so far [J]
    loss: float  # loss so far [J]


@njit_inline
def grid_index(at: float) -> tuple[int, float]:
    """Return the grid index before ``at`` [m], and the fraction beyond."""
    s = at * POINTS_PER_METRE
    i = min(max(int(s), 0), N_POINTS - 2)
    return i, s - i


@njit_inline
def value_and_rise(values: StructArray, i: int) -> tuple[float, float]:
    """Return a profile's value and difference to the next at ``i``."""
    return values[i], values[i + 1] - values[i]


@njit_inline
def at_share(value: float, rise: float, share: float) -> float:
    """Interpolate a profile linearly at the fraction ``share`` of a step."""
    return value + share * rise


@njit_inline
def lerp(values: StructArray, i: int, share: float) -> float:
    """Interpolate a profile linearly at index and fraction from :func:`grid_index`."""
    value, rise = value_and_rise(values, i)
    return at_share(value, rise, share)


@njit_inline
def slope(rise: float) -> float:
    """Return a profile's derivative [1/m] from its difference per point."""
    return rise * POINTS_PER_METRE


@njit_internal
def stiffness_at(profile: Struct, a: float) -> tuple[float, float]:
    """Return K [N/m] and K' [N/m2] at tip position ``a`` [m]."""
    i, share = grid_index(a)
    value, rise = value_and_rise(profile.stiffness, i)
    return at_share(value, rise, share), slope(rise)


@njit_internal
def toughness_at(profile: Struct, a: float) -> float:
    """Return R B [N], the force of fracture alone, at ``a``."""
    i, share = grid_index(a)
    return lerp(profile.toughness, i, share)


@njit_internal
def depth_at(profile: Struct, x: float) -> float:
    """Return the depth of cut B [m] at ``x`` [m]."""
    i, share = grid_index(x)
    return lerp(profile.depth, i, share)


@njit_internal
def elastic_force(profile: Struct, x: float, a: float) -> float:
    """Return the elastic force, K(a) max(x - a, 0) [N]."""
    return stiffness_at(profile, a)[0] * max(x - a, 0.0)


@njit
def stored_energy(profile: Struct, x: float, a: float) -> float:
    """Return the stored energy of a state, K(a) max(x - a, 0)^2 / 2 [J]."""
    return 0.5 * stiffness_at(profile, a)[0] * max(x - a, 0.0) ** 2


@njit_inline
def fallen(by: float, start: float, per: float, speed: float) -> float:
    """Return a LEM's fall [Pa]: 0 up to ``start``, then linear in ``speed``, ``by`` at most."""
    return by * min(max((speed - start) * per, 0.0), 1.0)


@njit_inline
def loading_ratio(law: Struct, speed: float, angle: float) -> float:
    """Return r = min(1, LEM(v, theta) / LEM(0, 90 deg)).

    It is the rate of rise of the force over that without crack growth.
    """
    v = min(max(abs(speed), law.speed_min), law.speed_max)
    upright = law.intercept_90 + law.slope_90 * v
    upright -= fallen(law.fall_1, law.fall_1_from, law.fall_1_per, v)
    upright -= fallen(law.fall_2, law.fall_2_from, law.fall_2_per, v)
    upright -= fallen(law.fall_3, law.fall_3_from, law.fall_3_per, v)
    inclined = law.intercept_45 + law.slope_45 * v
    modulus = inclined + (upright - inclined) * (angle - 0.25 * math.pi) * (4.0 / math.pi)
    ratio: float = min(1.0, modulus / law.quasi_static_modulus)
    return ratio


@njit_inline
def initiation_excess(law: Struct, pushing: float) -> float:
    """Return eta(theta) = eta90 sin^2(theta), least for slicing (assumed)."""
    eta: float = law.eta90 * pushing
    return eta


@njit_inline
def may_grow(ledger: float, change: float, toughness: float, debt_length: float) -> bool:
    """Return True if growth keeps the ledger above -R B l or raises it."""
    return change >= 0.0 or ledger + change >= -toughness * debt_length


@njit_inline
def on_unload(ledger: float, loss: float) -> tuple[float, float]:
    """Return ledger and loss after full unloading: a surplus is lost, a debt stays."""
    return min(ledger, 0.0), loss + max(ledger, 0.0)


@njit_inline
def force_to_grow(law: Struct, arrest_ratio: float, held_force: float, pushing: float, toughness: float) -> float:
    """Return the force [N] above which a loading blade cuts.

    Below it, it loads and unloads elastically.

    It is the force at which the crack last came to rest, or (1 - eta) R B where that is lower.  A blade that cut up to
    a higher force and drew back reaches that force again before it goes on cutting (thesis, Figures 6.6 and 6.7).
    """
    return max(min(arrest_ratio, 1.0 - initiation_excess(law, pushing)) * toughness, held_force)


@njit_inline
def elastic_part(x: float, a: float, K: float, F_start: float, dx: float) -> float:
    """Return the elastic part of ``dx``: backward, or up to ``F_start``."""
    if dx > 0.0:
        return min(dx, max(a - x, 0.0) + max(F_start - K * max(x - a, 0.0), 0.0) / K)
    return dx


@njit_inline
def stable_growth(law: Struct, K: float, dK: float, lag: float, loading: Loading) -> float:
    """Return the tip's advance [m] for a force rise r times elastic."""
    softening = K - dK * lag  # -dF/da at fixed x
    if loading.length > 0.0 and softening > _SOFTEST * K:
        return (1.0 - loading_ratio(law, loading.speed, loading.angle)) * K * loading.length / softening
    return 0.0


@njit_inline
def loading_step(
    law: Struct, loading: Loading, before: Loaded, da: float, ahead: tuple[float, float]
) -> tuple[float, float, float, float, float, float]:
    """Advance a blade by ``loading``, and its tip by ``da`` if admitted.

    ``ahead`` are K [N/m] and R B [N] where the tip would come to.  Returns the tip, F, R B, work, change of the ledger
    and energy of fracture; if the tip may not follow, those of elastic motion.
    """
    (next_K, next_toughness), x, a = ahead, loading.x, before.a
    next_F = next_K * max(x - (a + da), 0.0)
    next_U = 0.5 * next_K * max(x - (a + da), 0.0) ** 2
    spent = 0.5 * (before.toughness + next_toughness) * da
    work = 0.5 * (before.F + next_F) * loading.length
    change = work - (next_U - before.U) - spent
    if da > 0.0 and may_grow(before.ledger, change, 0.5 * (before.toughness + next_toughness), law.debt_length):
        return a + da, next_F, next_toughness, work, change, spent
    lag = max(x - a, 0.0)
    return a, before.K * lag, before.toughness, 0.5 * before.K * lag**2 - before.U, 0.0, 0.0


@njit_internal
def in_parts(profile: Struct, law: Struct, loading: Loading, before: Loaded) -> tuple[Loading, Loaded, float, float]:
    """Divide stable growth over a long ``loading`` into advances of :data:`LONGEST_ADVANCE`.

    All parts but the last are integrated here.  Returns the loading that is left, crack and tissue before it, and the
    work and fracture energy [J] until then.  A crack that such a motion would start runs afterwards.
    """
    shortest = loading.length / _MOST_PARTS
    work = fracture = 0.0
    a, F, U, ledger = before.a, before.F, before.U, before.ledger
    K, dK = stiffness_at(profile, a)
    da = stable_growth(law, K, dK, max(loading.x - loading.length - a, 0.0), loading)
    while da > LONGEST_ADVANCE and loading.length > shortest:
        length, speed, angle = loading.length, loading.speed, loading.angle
        part = max(length * (LONGEST_ADVANCE / da), shortest)
        advance = da * (part / length)
        left = Loading(loading.x, length - part, speed, angle)
        i, share = grid_index(a + advance)
        ahead = lerp(profile.stiffness, i, share), lerp(profile.toughness, i, share)
        step = Loading(left.x - left.length, part, speed, angle)
        a, F, _, cutting_work, change, spent = loading_step(
            law, step, Loaded(a, F, U, K, toughness_at(profile, a), ledger), advance, ahead
        )
        ledger += change
        work += cutting_work
        fracture += spent
        K, dK = stiffness_at(profile, a)
        lag = max(step.x - a, 0.0)
        U = 0.5 * K * lag**2
        da = stable_growth(law, K, dK, lag, left)
        loading = left
    return loading, Loaded(a, F, U, K, toughness_at(profile, a), ledger), work, fracture


@njit_internal
def run_crack(profile: Struct, law: Struct, x: float, crack: RunningCrack) -> tuple[RunningCrack, float, float]:
    """Run a crack at fixed ``x`` from initiation to arrest.

    Returns the crack, and force and R B where it comes to rest.
    """
    a, ledger, fracture, loss = crack
    toughness = toughness_at(profile, a)
    U = stored_energy(profile, x, a)
    F = elastic_force(profile, x, a)
    while True:
        tip = min(a + law.growth_step, x)
        next_toughness = toughness_at(profile, tip)
        spent = 0.5 * (toughness + next_toughness) * (tip - a)
        next_U = stored_energy(profile, x, tip)
        change = U - next_U - spent
        if not may_grow(ledger, change, next_toughness, law.debt_length):
            break
        a = tip
        ledger += change
        fracture += spent
        toughness = next_toughness
        U = next_U
        F = elastic_force(profile, x, a)
        if a >= x:
            ledger, loss = on_unload(ledger, loss)
            break
        if ledger <= 0.0 and F < toughness:
            break
    return RunningCrack(a, ledger, fracture, loss), F, toughness


@njit_inline
def leaning(angle: float) -> tuple[float, float]:
    """Return cotangent and sin^2 of the ``angle`` [rad] of a blade."""
    lean = cotangent(angle)
    return lean, 1.0 / (1.0 + lean**2)


@njit_inline
def sweeping(lean: float, next_lean: float, toughness: float, depth: float) -> float:
    """Return the energy [J] of turning a blade between two cotangents.

    Toward upright, its inclined edge sweeps B^2 |d cot(theta)| / 2 and pays R for it.
    """
    return 0.5 * toughness * depth * max(lean - next_lean, 0.0)


class EnergyAccount(NamedTuple):
    """Energies since reset [J]."""

    work: float
    stored: float
    fracture: float
    friction: float
    loss: float
    ledger: float
    residual: float  # work minus all the others


@njit_inline
def account(state: Struct, profile: Struct) -> EnergyAccount:
    """Return a cut's energy account, without energies of the motion."""
    stored = stored_energy(profile, state.blade - state.creep, state.tip) + state.locked
    residual = state.work - stored - state.fracture - state.friction - state.loss - state.ledger
    return EnergyAccount(state.work, stored, state.fracture, state.friction, state.loss, state.ledger, residual)
