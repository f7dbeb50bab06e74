"""The cutting law: what one small motion of the blade does to the tissue.

A blade at x stands ahead of the crack tip at a; the tissue between pulls back with F = K(a) (x - a).  The crack
grows in two ways: steadily while the blade loads it (which is why the measured modulus falls with speed and angle),
and in sudden runs once the force reaches the initiation force.  A ledger keeps the energy account exact:

    work = stored + fracture + friction + loss + ledger        at every instant, for every motion.

Symbols: x, a blade and tip [m]; theta angle [rad], 90 degrees upright; K stiffness [N/m]; R fracture resistance
without its share of friction [J/m2]; B depth [m]; eta excess of the initiation force; U = K (x - a)^2 / 2 [J].
After chapters 3 to 6 of the thesis named in the README; what is measured, derived or assumed stands in
:mod:`cutenv.cutting.parameters`.
"""

from __future__ import annotations

import math

from cutenv.compiled import compiled
from cutenv.cutting.records import Record, Records
from cutenv.tissue.specimen import SPACING

_SOFTEST = 0.1  # of K: where a force that hardly falls with growth would need a leap of the tip, loading is elastic


@compiled
def stiffness_at(profile: Records, a: float) -> tuple[float, float]:
    """K [N/m] and its derivative K' [N/m2] at tip position ``a`` [m], linear between the points of the profile."""
    s = a / SPACING
    i = min(max(int(s), 0), len(profile) - 2)
    rise = profile[i + 1].stiffness - profile[i].stiffness
    return profile[i].stiffness + (s - i) * rise, rise / SPACING


@compiled
def toughness_at(profile: Records, a: float) -> float:
    """R B [N], the force per advance that fracture alone would take, at ``a`` [m]."""
    s = a / SPACING
    i = min(max(int(s), 0), len(profile) - 2)
    toughness: float = profile[i].toughness + (s - i) * (profile[i + 1].toughness - profile[i].toughness)
    return toughness


@compiled
def depth_at(profile: Records, x: float) -> float:
    """Depth of cut B [m] at ``x`` [m]."""
    s = x / SPACING
    i = min(max(int(s), 0), len(profile) - 2)
    depth: float = profile[i].depth + (s - i) * (profile[i + 1].depth - profile[i].depth)
    return depth


@compiled
def elastic_force(profile: Records, x: float, a: float) -> float:
    """F = K(a) max(x - a, 0) [N]."""
    return stiffness_at(profile, a)[0] * max(x - a, 0.0)


@compiled
def stored_energy(profile: Records, x: float, a: float) -> float:
    """U = K(a) max(x - a, 0)^2 / 2 [J]: a function of state, so that no motion can pump work out of the tissue."""
    return 0.5 * stiffness_at(profile, a)[0] * max(x - a, 0.0) ** 2


@compiled
def loading_ratio(law: Record, speed: float, angle: float) -> float:
    """R = min(1, LEM(v, theta) / E0): how fast the force rises, over how fast it would rise without growth."""
    v = min(max(abs(speed), law.speed_min), law.speed_max)
    upright = law.intercept_90 + law.slope_90 * v
    inclined = law.intercept_45 + law.slope_45 * v
    modulus = inclined + (upright - inclined) * (angle - 0.25 * math.pi) / (0.25 * math.pi)
    ratio: float = min(1.0, modulus / law.quasi_static_modulus)
    return ratio


@compiled
def initiation_excess(law: Record, angle: float) -> float:
    """eta(theta) = eta90 sin^2(theta): a slicing edge starts a crack more easily than a pushing one (assumed)."""
    eta: float = law.eta90 * math.sin(angle) ** 2
    return eta


@compiled
def may_grow(state: Record, change: float, toughness: float, debt_length: float) -> bool:
    """Whether growth may change the ledger so: never below -R B l, unless the growth raises it."""
    return change >= 0.0 or state.ledger + change >= -toughness * debt_length


@compiled
def settle(state: Record) -> None:
    """At full unloading, book what the tissue gave beyond fracture as loss; a debt stays."""
    state.loss += max(state.ledger, 0.0)
    state.ledger = min(state.ledger, 0.0)


@compiled
def turn(state: Record, profile: Records, angle: float) -> None:
    """Turn the blade.  Toward upright, its leaning edge sweeps B^2 |d cot(theta)| / 2 and pays R for it."""
    swept = 1.0 / math.tan(state.angle) - 1.0 / math.tan(angle)
    if swept > 0.0:
        energy = 0.5 * toughness_at(profile, state.blade) * depth_at(profile, state.blade) * swept
        state.work += energy
        state.fracture += energy
    state.angle = angle


@compiled
def move(state: Record, profile: Records, law: Record, dx: float, speed: float) -> None:
    """Move the blade by ``dx`` [m] at ``speed`` [m/s]: elastic motion, and stable growth while it loads."""
    a = state.tip
    K, dK = stiffness_at(profile, a)
    gap = max(a - state.blade, 0.0)
    F = K * max(state.blade - a, 0.0)

    # Elastic, up to the force at which a loading blade begins to cut.  Its work is the change of U, exactly.
    eta = initiation_excess(law, state.angle)
    F_start = min(state.arrest_ratio, 1.0 - eta) * toughness_at(profile, a)
    elastic = dx if dx <= 0.0 else min(dx, gap + max(F_start - F, 0.0) / K)
    U = stored_energy(profile, state.blade, a)
    state.blade += elastic
    state.work += stored_energy(profile, state.blade, a) - U
    if state.blade <= a:
        settle(state)
    loading = dx - elastic
    if loading <= 0.0:
        return

    # Stable growth: the tip follows so that the force rises only r times as fast as elastically.
    lag = state.blade - a
    F = K * lag
    softening = K - dK * lag  # -dF/da at fixed x
    da = 0.0
    if softening > _SOFTEST * K:
        da = (1.0 - loading_ratio(law, speed, state.angle)) * K * loading / softening
    toughness = 0.5 * (toughness_at(profile, a) + toughness_at(profile, a + da))
    state.blade += loading
    work = 0.5 * (F + elastic_force(profile, state.blade, a + da)) * loading
    U_before = 0.5 * K * lag**2
    change = work - (stored_energy(profile, state.blade, a + da) - U_before) - toughness * da
    if da > 0.0 and may_grow(state, change, toughness, law.debt_length):
        state.tip = a + da
        state.ledger += change
        state.fracture += toughness * da
        state.work += work
    else:
        state.work += stored_energy(profile, state.blade, a) - U_before


@compiled
def run_crack(state: Record, profile: Records, law: Record) -> float:
    """Let the crack run at fixed blade if the force has reached (1 + eta) R B; return the length of the run [m]."""
    x = state.blade
    start = state.tip
    toughness = toughness_at(profile, start)
    F = elastic_force(profile, x, start)
    if F < (1.0 + initiation_excess(law, state.angle)) * toughness:
        state.running = 0
        return 0.0
    U = stored_energy(profile, x, start)
    while True:
        a = min(state.tip + law.growth_step, x)
        next_toughness = toughness_at(profile, a)
        spent = 0.5 * (toughness + next_toughness) * (a - state.tip)
        next_U = stored_energy(profile, x, a)
        change = U - next_U - spent
        if not may_grow(state, change, next_toughness, law.debt_length):
            break
        state.tip = a
        state.ledger += change
        state.fracture += spent
        toughness = next_toughness
        U = next_U
        F = elastic_force(profile, x, a)
        if a >= x:
            settle(state)
            break
        if state.ledger <= 0.0 and F < toughness:
            break
    length: float = state.tip - start
    if length > 0.0:
        state.arrest_ratio = F / toughness
        state.uncontrolled += length
        state.units += 1 - state.running  # a run that the ledger lets on only bit by bit is one unit
        state.running = 1
    return length


@compiled
def rub(state: Record, profile: Records, law: Record, dx: float, speed: float) -> float:
    """Book friction of the blade's faces over ``dx``; return its force [N], against the motion, zero at rest."""
    if dx == 0.0:
        return 0.0
    force = friction_force(state, profile, law, speed)
    state.work += force * abs(dx)
    state.friction += force * abs(dx)
    return math.copysign(force, dx)


@compiled
def friction_force(state: Record, profile: Records, law: Record, speed: float) -> float:
    """Size of the friction force [N] on a moving blade: proportional to depth, and optionally to speed."""
    per_depth = law.friction_per_depth + law.friction_per_depth_speed * abs(speed)
    force: float = per_depth * depth_at(profile, state.blade)
    return force


@compiled
def cut(state: Record, profile: Records, law: Record, dx: float, angle: float, dt: float) -> tuple[float, float, float]:
    """One update of the law: the blade turns to ``angle``, moves by ``dx`` in ``dt``, and the tissue answers.

    Parameters
    ----------
    state : Record
        One :data:`~cutenv.cutting.records.STATE`, changed in place.
    profile : Records
        :data:`~cutenv.cutting.records.PROFILE`, shape (n_points,).
    law : Record
        One :data:`~cutenv.cutting.records.LAW`.
    dx, angle, dt : float
        Motion of the blade [m], its new angle [rad], duration [s].

    Returns
    -------
    elastic, friction, jump : float
        Force of the tissue on the blade, back toward the clamp, and force of friction, against the motion: a sensor
        feels their sum [N].  Length of an unstable run [m].
    """
    speed = dx / dt
    turn(state, profile, angle)
    friction = rub(state, profile, law, dx, speed)
    move(state, profile, law, dx, speed)
    jump = run_crack(state, profile, law)
    return elastic_force(profile, state.blade, state.tip), friction, jump
