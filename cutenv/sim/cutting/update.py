"""One force update, a millisecond, of every cut in a row.

Drive, cutting law and force sensor.

The functions of :mod:`cutenv.sim.cutting.law` and its neighbours are called in loops over the lanes of a row, a
structure of arrays (:mod:`cutenv.sim.cutting.row`).  A loop that does nothing but arithmetic is compiled to vector
instructions, eight numbers at once on a processor that has them; for a row of one lane it is compiled to plain
instructions. Gathering from each cut's own profile has separate loops; so has turning, skipped where no blade turns,
and the unstable run of a crack, which is computed one cut after the other.  A cut's results do not depend on the lanes
beside it (tested).

Viscoelastic relaxation is off unless a share of the modulus is set to relax. It is one Maxwell arm beside a spring: the
spring K responds at once, and part of what it holds creeps away.  With rho the relaxing share, u the displacement of
the tissue at the tip (x - a while the blade holds it), and g the part of u that has crept,

    F = K (u - g),        dg/dt = (rho u - g) / ((1 - rho) T),

so that a held blade's force falls to (1 - rho) K u, and free tissue recovers within T, the time constant of creep
under constant load.  The stored energy is K (u - g)^2 / 2 + K g^2 (1 - rho) / (2 rho).  The law uses u - g in place of
x - a.
"""

from __future__ import annotations

from collections.abc import Callable

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.declared import compiled_for
from cutenv._engine.jit import njit_inline
from cutenv.sim.cutting.drive import (
    VelocityLoop,
    backlash_motion,
    coupling_step,
    dead_time_step,
    rate_limited,
    velocity_loop_step,
)
from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.cutting.friction import (
    deflected,
    deflected_in_plane,
    friction_force,
    friction_work,
    friction_work_in_plane,
    grip,
)
from cutenv.sim.cutting.law import (
    LONGEST_ADVANCE,
    Loaded,
    Loading,
    RunningCrack,
    at_share,
    elastic_part,
    force_to_grow,
    grid_index,
    in_parts,
    initiation_excess,
    leaning,
    lerp,
    loading_step,
    on_unload,
    run_crack,
    slope,
    stable_growth,
    stiffness_at,
    sweeping,
    value_and_rise,
)
from cutenv.sim.cutting.motion import Motion, Moving
from cutenv.sim.cutting.row import BladeInRow, DriveInRow, law_in_row
from cutenv.sim.cutting.sensor import feel_row


@njit_inline
def crept(law: Struct, reach: float, creep: float, dt: float) -> float:
    """Return the creep [m] after ``dt`` at ``reach`` [m]."""
    rate = dt / ((1.0 - law.relaxing_share) * law.creep_time)
    return (creep + rate * law.relaxing_share * max(reach, creep)) / (1.0 + rate)  # type: ignore[no-any-return]


@njit_inline
def energy_of_creep(law: Struct, K: float, creep: float) -> float:
    """Return the energy [J] that recovery from creep would release."""
    return 0.5 * K * creep**2 * (1.0 - law.relaxing_share) / law.relaxing_share  # type: ignore[no-any-return]


@njit_inline
def relaxed(law: Struct, K: float, reach: float, creep: float, dt: float) -> tuple[float, float, float, float]:
    """Return creep [m], energy before and after, and loss [J]."""
    here = energy_of_creep(law, K, creep)
    next_creep = crept(law, reach, creep, dt)
    next_locked = energy_of_creep(law, K, next_creep)
    before = 0.5 * K * max(reach - creep, 0.0) ** 2 + here
    after = 0.5 * K * max(reach - next_creep, 0.0) ** 2 + next_locked
    return next_creep, here, next_locked, before - after


@compiled_for(njit_inline)
def update_row(motion: Motion) -> Callable[..., None]:
    """Return the function that advances a row by one update."""
    drive, cut = motion.drive, cut_row(motion)

    def update_row(row: Struct, moving: Moving, profiles: StructArray, sensors: StructArray, first: bool) -> None:
        """Advance a row by 1 ms under speed ``given`` and angle ``aim``.

        ``first`` is True for the first update since the row was loaded.
        """
        drive_row(row, TICK)
        if drive is not None:
            drive(row, moving, profiles, TICK)
        cut(row, moving, profiles, TICK)
        feel_row(row, sensors, first)

    return update_row


@compiled_for(njit_inline)
def cut_row(motion: Motion) -> Callable[..., None]:
    """Return the function that advances the cutting law of a row."""
    aim, move, renew, renew_runs, respond = motion.aim, motion.move, motion.renew, motion.renew_runs, motion.respond
    grow, rub = grow_row(motion), None if motion.across is None else rub_row(motion)

    def cut_row(row: Struct, moving: Moving, profiles: StructArray, dt: float) -> None:
        """Turn blades to ``row.next_angle``, and move them by ``row.dx``.

        ``row.turns`` is the number of blades that turn.  The force on the blade is ``row.force``: that of the tissue,
        ``row.elastic``, and of friction on its faces, positive toward the clamp [N]; ``row.jump`` the unstable growth
        [m].
        """
        if row.turns > 0:
            turn_row(row, profiles)
        if row.relaxing > 0:
            relax_row(row, dt)
        if aim is not None:
            aim(row, moving, profiles, dt)
        load_row(row, dt)
        if move is not None:
            move(row, moving, profiles, dt)
        if renew is not None and (row.points > 0 or row.leaps > 0):
            renew(row, moving, profiles, dt)
        if row.leaps > 0:
            leap_row(row, profiles)
        if row.points > 0:
            look_row(row, profiles)
        grow(row)
        if rub is not None:
            rub(row, moving, dt)
        if row.runs > 0:
            if renew_runs is not None:
                renew_runs(row, moving, profiles, dt)
            run_row(row, profiles)
        for n in range(len(row.blade)):
            row.force[n] = row.elastic[n] + row.rubbing[n]
        if respond is not None:
            respond(row, moving, profiles, dt)

    return cut_row


@njit_inline
def drive_row(row: Struct, dt: float) -> None:
    """Advance every drive in a row; the blades' motion is ``row.dx``."""
    for n in range(len(row.blade)):
        row.command[n] = row.given[n]
    if row.late > 0:
        for n in range(len(row.blade)):
            if row.dead_ticks[n] > 0:
                row.next_target[n], row.waiting[n], row.target[n] = dead_time_step(
                    row.given[n], row.dead_ticks[n], row.next_target[n], row.waiting[n], row.target[n]
                )
                row.command[n] = row.target[n]
    turns = 0
    for n in range(len(row.blade)):
        loop = VelocityLoop(row.share[n], row.acceleration[n], row.travel[n])
        hand, hand_speed = velocity_loop_step(loop, row.hand[n], row.hand_speed[n], row.command[n], dt)
        row.hand[n], row.hand_speed[n] = hand, hand_speed
        row.dx[n] = backlash_motion(hand, row.blade[n], row.backlash[n])
        row.next_angle[n] = rate_limited(row.angle[n], row.aim[n], row.rotation_rate[n], dt)
        turns += 1 if row.next_angle[n] != row.angle[n] else 0
    row.turns = turns
    if row.hands > 0:
        for n in range(len(row.blade)):
            if row.mass[n] > 0.0:
                drive = DriveInRow(
                    row.travel[n], row.mass[n], row.coupling_stiffness[n], row.coupling_damping[n], row.drag[n]
                )
                row.dx[n] = coupling_step(
                    drive, BladeInRow(row.hand[n], row.hand_speed[n], row.blade[n], row.speed[n]),
                    row.K[n] * max(row.blade[n] - row.creep[n] - row.tip[n], 0.0),
                    grip(law_in_row(row, n), row.depth[n], row.bristle[n]), dt,
                )  # fmt: skip


@njit_inline
def turn_row(row: Struct, profiles: StructArray) -> None:
    """Turn the blades to ``row.next_angle``."""
    for n in range(len(row.blade)):
        row.blade_point[n], row.blade_share[n] = grid_index(row.blade[n])
    for n in range(len(row.blade)):
        profile, i, share = profiles[row.cut[n]], row.blade_point[n], row.blade_share[n]
        row.edge_toughness[n] = lerp(profile.toughness, i, share)
    for n in range(len(row.blade)):  # a blade that does not turn keeps its angle
        lean, pushing = leaning(row.next_angle[n])
        energy = sweeping(row.lean[n], lean, row.edge_toughness[n], row.depth[n])
        row.lean[n], row.pushing[n], row.angle[n] = lean, pushing, row.next_angle[n]
        row.work[n] += energy
        row.fracture[n] += energy


@njit_inline
def relax_row(row: Struct, dt: float) -> None:
    """Let relaxing tissue creep."""
    for n in range(row.taken):
        if row.relaxing_share[n] > 0.0:
            row.creep[n], here, locked, lost = relaxed(
                law_in_row(row, n), row.K[n], row.blade[n] - row.tip[n], row.creep[n], dt
            )
            # What the crack's growth has released of the creep's energy since the last update, because the stiffness
            # fell, goes to the ledger, like all energy that growth releases.
            row.ledger[n] += row.locked[n] - here
            row.locked[n] = locked
            row.loss[n] += lost


@njit_inline
def load_row(row: Struct, dt: float) -> None:
    """Compute the elastic motion and the tip's target position."""
    points = leaps = 0
    for n in range(len(row.blade)):
        law = law_in_row(row, n)
        x, a, dx, K = row.blade[n] - row.creep[n], row.tip[n], row.dx[n], row.K[n]
        speed = dx / dt
        row.speed[n] = speed
        U = 0.5 * K * max(x - a, 0.0) ** 2
        F_start = force_to_grow(law, row.arrest_ratio[n], row.held_force[n], row.pushing[n], row.toughness[n])
        elastic = elastic_part(x, a, K, F_start, dx)
        x += elastic
        lag = max(x - a, 0.0)
        row.F[n] = K * lag
        row.U[n] = 0.5 * K * lag**2
        row.elastic_work[n] = row.U[n] - U
        ledger, loss = row.ledger[n], row.loss[n]
        if x <= a:
            ledger, loss = on_unload(ledger, loss)
        row.ledger[n], row.loss[n] = ledger, loss

        loading = dx - elastic
        x += loading
        da = stable_growth(law, K, row.dK[n], lag, Loading(x, loading, speed, row.angle[n]))
        row.x[n], row.blade[n], row.loading[n], row.da[n] = x, x + row.creep[n], loading, da
        row.tip_point[n], row.tip_share[n] = grid_index(a + da)
        row.blade_point[n], row.blade_share[n] = grid_index(row.blade[n])
        same = row.tip_point[n] == row.seen_tip_point[n] and row.blade_point[n] == row.seen_blade_point[n]
        points += 0 if same else 1
        leaps += 1 if da > LONGEST_ADVANCE else 0
    row.points, row.leaps = points, leaps


@njit_inline
def loading_in_row(row: Struct, n: int) -> Loading:
    """Gather the loading of the cut in lane ``n``."""
    return Loading(row.x[n], row.loading[n], row.speed[n], row.angle[n])


@njit_inline
def loaded_in_row(row: Struct, n: int) -> Loaded:
    """Gather tip and tissue of lane ``n`` before its loading."""
    return Loaded(row.tip[n], row.F[n], row.U[n], row.K[n], row.toughness[n], row.ledger[n])


@njit_inline
def leap_row(row: Struct, profiles: StructArray) -> None:
    """Integrate long advances of the tip, except their last part."""
    for n in range(row.taken):
        if row.going[n] == 0 or row.da[n] <= LONGEST_ADVANCE:
            continue
        law, profile = law_in_row(row, n), profiles[row.cut[n]]
        loading, loaded, work, spent = in_parts(profile, law, loading_in_row(row, n), loaded_in_row(row, n))
        row.elastic_work[n] += work
        row.fracture[n] += spent
        a, row.F[n], row.U[n], row.toughness[n], row.ledger[n] = (
            loaded.a, loaded.F, loaded.U, loaded.toughness, loaded.ledger,
        )  # fmt: skip
        row.K[n], row.dK[n] = stiffness_at(profile, a)
        da = stable_growth(law, row.K[n], row.dK[n], max(loading.x - loading.length - a, 0.0), loading)
        row.tip[n], row.loading[n], row.da[n] = a, loading.length, da
        row.tip_point[n], row.tip_share[n] = grid_index(a + da)
        row.points = 1


@njit_inline
def look_row(row: Struct, profiles: StructArray) -> None:
    """Gather profiles at blade and next tip after a grid step."""
    for n in range(len(row.blade)):
        i, j = row.tip_point[n], row.blade_point[n]
        if i != row.seen_tip_point[n]:
            profile = profiles[row.cut[n]]
            row.point_K[n], row.rise_K[n] = value_and_rise(profile.stiffness, i)
            row.point_toughness[n], row.rise_toughness[n] = value_and_rise(profile.toughness, i)
            row.seen_tip_point[n] = i
        if j != row.seen_blade_point[n]:
            row.point_depth[n], row.rise_depth[n] = value_and_rise(profiles[row.cut[n]].depth, j)
            row.seen_blade_point[n] = j


@compiled_for(njit_inline)
def grow_row(motion: Motion) -> Callable[..., None]:
    """Return the function that advances the tip and adds friction.

    Friction with a part across the cut is left to :func:`rub_row`.
    """
    rubs_along = motion.across is None

    def grow_row(row: Struct) -> None:
        """Advance admitted tips, and add friction along the cut."""
        runs = 0
        for n in range(len(row.blade)):
            law = law_in_row(row, n)
            a, K, dK, running, share = row.tip[n], row.K[n], row.dK[n], row.running[n], row.tip_share[n]
            next_K = at_share(row.point_K[n], row.rise_K[n], share)
            next_toughness = at_share(row.point_toughness[n], row.rise_toughness[n], share)
            tip, F, toughness, work, change, spent = loading_step(
                law, loading_in_row(row, n), loaded_in_row(row, n), row.da[n], (next_K, next_toughness)
            )
            row.K[n] = next_K if tip > a else K
            row.dK[n] = slope(row.rise_K[n]) if tip > a else dK
            row.tip[n], row.elastic[n], row.toughness[n] = tip, F, toughness
            row.held_force[n] = F if row.loading[n] > 0.0 else row.held_force[n]
            row.work[n] += row.elastic_work[n] + work
            if rubs_along:
                _rub(row, n)
            row.ledger[n] += change
            row.fracture[n] += spent
            row.jump[n] = 0.0
            row.tick[n] += 1
            waits = F < (1.0 + initiation_excess(law, row.pushing[n])) * toughness
            row.waits[n] = 1 if waits else 0
            row.running[n] = 0 if waits else running
            runs += 0 if waits else 1
        row.runs = runs

    return grow_row


@compiled_for(njit_inline)
def rub_row(motion: Motion) -> Callable[..., None]:
    """Return the function that adds friction along and across cuts."""
    across, rub = motion.across, motion.rub
    assert across is not None
    assert rub is not None

    def rub_row(row: Struct, moving: Moving, dt: float) -> None:
        """Add friction on each blade's faces, along and across the cut."""
        lanes = moving.lanes
        rubs = 0
        for n in range(len(row.blade)):
            bristle, motion = across(lanes, n)
            rubs += 1 if bristle != 0.0 or motion != 0.0 else 0
        if rubs == 0:
            for n in range(len(row.blade)):
                _rub(row, n)
                rub(lanes, n, 0.0, 0.0)
        else:
            for n in range(len(row.blade)):
                bristle, force = _rub_in_plane(row, n, across(lanes, n), dt)
                rub(lanes, n, bristle, force)

    return rub_row


@njit_inline
def _rub(row: Struct, n: int) -> None:
    """Add friction on the blade's faces to one cut."""
    law, dx, speed, bristle, depth = law_in_row(row, n), row.dx[n], row.speed[n], row.bristle[n], row.depth[n]
    next_depth = at_share(row.point_depth[n], row.rise_depth[n], row.blade_share[n])
    next_bristle = deflected(law, bristle, dx)
    rubbed = friction_work(law, (depth, next_depth), (bristle, next_bristle), dx, speed)
    row.work[n] += rubbed
    row.friction[n] += rubbed
    row.depth[n], row.bristle[n] = next_depth, next_bristle
    row.rubbing[n] = friction_force(law, next_depth, next_bristle, speed)


@njit_inline
def _rub_in_plane(row: Struct, n: int, across: tuple[float, float], dt: float) -> tuple[float, float]:
    """Add friction to one cut; return that of motion ``across`` [m].

    That is the bristles' next deflection [m], and the force [N] against a motion across.
    """
    law, depth = law_in_row(row, n), row.depth[n]
    before, motion, speeds = (row.bristle[n], across[0]), (row.dx[n], across[1]), (row.speed[n], across[1] / dt)
    next_depth = at_share(row.point_depth[n], row.rise_depth[n], row.blade_share[n])
    after = deflected_in_plane(law, before, motion)
    bristles = (before[0], after[0]), (before[1], after[1])
    rubbed = friction_work_in_plane(law, (depth, next_depth), bristles, motion, speeds)
    row.work[n] += rubbed
    row.friction[n] += rubbed
    row.depth[n], row.bristle[n] = next_depth, after[0]
    row.rubbing[n] = friction_force(law, next_depth, after[0], speeds[0])
    return after[1], friction_force(law, next_depth, after[1], speeds[1])


@njit_inline
def run_row(row: Struct, profiles: StructArray) -> None:
    """Run the cracks whose force has reached initiation."""
    for n in range(row.taken):
        if row.going[n] == 0 or row.waits[n] == 1:
            continue
        law, start, profile = law_in_row(row, n), row.tip[n], profiles[row.cut[n]]
        crack = RunningCrack(start, row.ledger[n], row.fracture[n], row.loss[n])
        crack, row.elastic[n], row.toughness[n] = run_crack(profile, law, row.blade[n] - row.creep[n], crack)
        row.tip[n], row.ledger[n], row.fracture[n], row.loss[n] = crack
        row.jump[n] = row.tip[n] - start
        if row.jump[n] > 0.0:
            row.K[n], row.dK[n] = stiffness_at(profile, row.tip[n])
            row.arrest_ratio[n] = row.elastic[n] / row.toughness[n]
            row.held_force[n] = row.elastic[n]
            row.uncontrolled[n] += row.jump[n]
            row.units[n] += 1 - row.running[n]
            row.running[n] = 1
