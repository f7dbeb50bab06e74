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
from cutenv.cutting.records import Record
from cutenv.tissue.specimen import N_POINTS, POINTS_PER_METRE

_SOFTEST = 0.1  # of K: where a force that hardly falls with growth would need a leap of the tip, loading is elastic


@compiled
def stiffness_at(profile: Record, a: float) -> tuple[float, float]:
    """K [N/m] and its derivative K' [N/m2] at tip position ``a`` [m], linear between the points of the profile."""
    s = a * POINTS_PER_METRE
    i = min(max(int(s), 0), N_POINTS - 2)
    rise = profile.stiffness[i + 1] - profile.stiffness[i]
    return profile.stiffness[i] + (s - i) * rise, rise * POINTS_PER_METRE


@compiled
def toughness_at(profile: Record, a: float) -> float:
    """R B [N], the force per advance that fracture alone would take, at ``a`` [m]."""
    s = a * POINTS_PER_METRE
    i = min(max(int(s), 0), N_POINTS - 2)
    toughness: float = profile.toughness[i] + (s - i) * (profile.toughness[i + 1] - profile.toughness[i])
    return toughness


@compiled
def depth_at(profile: Record, x: float) -> float:
    """Depth of cut B [m] at ``x`` [m]."""
    s = x * POINTS_PER_METRE
    i = min(max(int(s), 0), N_POINTS - 2)
    depth: float = profile.depth[i] + (s - i) * (profile.depth[i + 1] - profile.depth[i])
    return depth


@compiled
def elastic_force(profile: Record, x: float, a: float) -> float:
    """F = K(a) max(x - a, 0) [N]."""
    return stiffness_at(profile, a)[0] * max(x - a, 0.0)


@compiled
def stored_energy(profile: Record, x: float, a: float) -> float:
    """U = K(a) max(x - a, 0)^2 / 2 [J]: a function of state, so that no motion can pump work out of the tissue."""
    return 0.5 * stiffness_at(profile, a)[0] * max(x - a, 0.0) ** 2


@compiled
def loading_ratio(law: Record, speed: float, angle: float) -> float:
    """R = min(1, LEM(v, theta) / E0): how fast the force rises, over how fast it would rise without growth."""
    v = min(max(abs(speed), law.speed_min), law.speed_max)
    upright = law.intercept_90 + law.slope_90 * v
    inclined = law.intercept_45 + law.slope_45 * v
    modulus = inclined + (upright - inclined) * (angle - 0.25 * math.pi) * (4.0 / math.pi)
    ratio: float = min(1.0, modulus / law.quasi_static_modulus)
    return ratio


@compiled
def initiation_excess(state: Record, law: Record) -> float:
    """eta(theta) = eta90 sin^2(theta): a slicing edge starts a crack more easily than a pushing one (assumed)."""
    eta: float = law.eta90 * state.pushing
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
def turn(state: Record, profile: Record, angle: float) -> None:
    """Turn the blade.  Toward upright, its leaning edge sweeps B^2 |d cot(theta)| / 2 and pays R for it."""
    if angle == state.angle:
        return
    lean = 1.0 / math.tan(angle)
    swept = state.lean - lean
    if swept > 0.0:
        energy = 0.5 * toughness_at(profile, state.blade) * depth_at(profile, state.blade) * swept
        state.work += energy
        state.fracture += energy
    state.angle = angle
    state.lean = lean
    state.pushing = 1.0 / (1.0 + lean**2)


@compiled
def move(state: Record, profile: Record, law: Record, dx: float, speed: float) -> tuple[float, float]:
    """Move the blade by ``dx`` [m] at ``speed`` [m/s]: elastic motion, and stable growth while it loads.

    Returns the elastic force and R B at the tip [N].
    """
    x = state.blade
    a = state.tip
    K, dK = stiffness_at(profile, a)
    toughness = toughness_at(profile, a)
    lag = max(x - a, 0.0)
    U = 0.5 * K * lag**2

    # Elastic, up to the force at which a loading blade begins to cut.  Its work is the change of U, exactly.
    elastic = dx
    if dx > 0.0:
        F_start = min(state.arrest_ratio, 1.0 - initiation_excess(state, law)) * toughness
        elastic = min(dx, max(a - x, 0.0) + max(F_start - K * lag, 0.0) / K)
    x += elastic
    lag = max(x - a, 0.0)
    F = K * lag
    loaded_U = 0.5 * K * lag**2
    work = loaded_U - U
    if x <= a:
        settle(state)

    # Stable growth: the tip follows so that the force rises only r times as fast as elastically.
    loading = dx - elastic
    if loading > 0.0:
        x += loading
        da = 0.0
        softening = K - dK * lag  # -dF/da at fixed x
        if softening > _SOFTEST * K:
            da = (1.0 - loading_ratio(law, speed, state.angle)) * K * loading / softening
        next_K = stiffness_at(profile, a + da)[0]
        next_toughness = toughness_at(profile, a + da)
        next_F = next_K * max(x - (a + da), 0.0)
        next_U = 0.5 * next_K * max(x - (a + da), 0.0) ** 2
        spent = 0.5 * (toughness + next_toughness) * da
        cutting_work = 0.5 * (F + next_F) * loading
        change = cutting_work - (next_U - loaded_U) - spent
        if da > 0.0 and may_grow(state, change, 0.5 * (toughness + next_toughness), law.debt_length):
            state.tip = a + da
            state.ledger += change
            state.fracture += spent
            work += cutting_work
            F = next_F
            toughness = next_toughness
        else:
            lag = max(x - a, 0.0)
            work += 0.5 * K * lag**2 - loaded_U
            F = K * lag
    state.blade = x
    state.work += work
    return F, toughness


@compiled
def run_crack(state: Record, profile: Record, law: Record) -> float:
    """Let the crack run at fixed blade, its force having reached (1 + eta) R B; return the length of the run [m]."""
    x = state.blade
    start = state.tip
    toughness = toughness_at(profile, start)
    U = stored_energy(profile, x, start)
    F = 0.0
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
def rub(state: Record, profile: Record, law: Record, dx: float, speed: float) -> float:
    """Book friction of the blade's faces over ``dx``; return its force [N], against the motion, zero at rest."""
    if dx == 0.0:
        return 0.0
    force = friction_force(state, profile, law, speed)
    state.work += force * abs(dx)
    state.friction += force * abs(dx)
    return math.copysign(force, dx)


@compiled
def friction_force(state: Record, profile: Record, law: Record, speed: float) -> float:
    """Size of the friction force [N] on a moving blade: proportional to depth, and optionally to speed."""
    per_depth = law.friction_per_depth + law.friction_per_depth_speed * abs(speed)
    force: float = per_depth * depth_at(profile, state.blade)
    return force


@compiled
def cut(state: Record, profile: Record, law: Record, dx: float, angle: float, dt: float) -> tuple[float, float, float]:
    """One update of the law: the blade turns to ``angle``, moves by ``dx`` in ``dt``, and the tissue answers.

    Parameters
    ----------
    state : Record
        One :data:`~cutenv.cutting.records.STATE`, changed in place.
    profile : Record
        :data:`~cutenv.cutting.records.PROFILE`.
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
    elastic, toughness = move(state, profile, law, dx, speed)
    jump = 0.0
    if elastic < (1.0 + initiation_excess(state, law)) * toughness:
        state.running = 0
    else:
        jump = run_crack(state, profile, law)
        elastic = elastic_force(profile, state.blade, state.tip)
    return elastic, friction, jump
