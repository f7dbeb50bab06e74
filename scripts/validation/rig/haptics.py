"""Passivity of a haptic device in ``cutenv play``, and the stiffnesses that it can render: tables for the pages.

    python -m scripts.validation.rig.haptics passivity [--minutes 10] [--late 0.02]
    python -m scripts.validation.rig.haptics z-width

*passivity*: a scripted hand (a spring and a damper that are led to and fro, with jerks and tremor; firm in one cut,
slack in the next) holds an emulated device, which cuts specimen after specimen in simulated time. An observer
integrates the work of the hand on the device. Never may the hand have got back more than it gave: work minus kinetic
energy stays at or above zero.

*z-width*: for periods of 1 to 10 ms the bound 2 (b - B)/T, the stiffness from which a hand that moves to and fro at
the worst moment gets energy out of the sampled spring, and the stiffness at which a device that nobody holds swings up.
Then the energy that such a hand gets from a spring ten times as stiff as the bound, without the energy account and with
it.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np

from cutenv.people.play.haptics import FeltForce, Stylus, VirtualCoupling
from cutenv.people.play.inverse3 import INVERSE3_COUPLING
from cutenv.people.play.inverse3_emulator import EmulatedHandle
from cutenv.people.play.played_cut import PlayedCut
from cutenv.sim.cutting.dtypes import TICK

_SUBSTEPS = 4
_STIFFEST = 1e5  # [N/m]


class NoAccount(FeltForce):
    """Force of a coupling without the energy account, and as stiff as asked: what the account protects from."""

    def __init__(self, coupling: VirtualCoupling, stiffness: float) -> None:
        super().__init__(coupling)
        self.stiffness = stiffness

    def update(self, position: float, blade: float) -> float:
        """Return the force to hold for the next period [N]."""
        lead = position - blade
        moved = lead - self._lead
        c = self.coupling
        wanted = self.stiffness * lead + c.damping / c.period * moved
        self.force, self._lead = min(max(wanted, -c.force_limit), c.force_limit), lead
        return self.force


def led(seed: int) -> Callable[[float], float]:
    """Return where a hand aims [m] by the time in a cut [s]: onward, with strokes back, tremor at 8 Hz, and jerks."""
    rng = np.random.default_rng(seed)
    pace, depth, tremor = rng.uniform(0.004, 0.02), rng.uniform(0.0, 0.02), rng.uniform(0.0, 0.003)
    rhythm, jerk_every, jerk = rng.uniform(0.3, 1.5), rng.uniform(0.7, 3.0), rng.uniform(-0.02, 0.02)

    def aim(time: float) -> float:
        stroke = depth * math.sin(2.0 * math.pi * rhythm * time)
        shaken = tremor * math.sin(2.0 * math.pi * 8.0 * time)
        pulled = jerk if math.fmod(time, jerk_every) < 0.1 else 0.0
        return min(max(pace * time, 0.0), 0.11) + stroke + shaken + pulled

    return aim


@dataclass
class Observed:
    """Record of an observer of the hand's work."""

    seconds: float = 0.0
    cuts: int = 0
    given: float = 0.0  # [J] work of the hand on the device
    least: float = 0.0  # [J] work minus kinetic energy at its least
    strongest: float = 0.0  # [N]
    longest_hold: float = 0.0  # [s]


def observe(
    seconds: float, made: Callable[[], FeltForce], *, late: float, damping: float, mass: float, seed: int = 0
) -> Observed:
    """Let the hand cut for so many seconds of simulated time; a share ``late`` of the samples is held up to 5 ms."""
    seen, rng = Observed(), np.random.default_rng(seed)
    while seen.seconds < seconds:
        cut = PlayedCut(seed=seed, episode=seen.cuts, specimen_class="liver")
        firm = {"hand_stiffness": 400.0, "hand_damping": 8.0}
        hand_of_cut = {"hand_stiffness": 40.0, "hand_damping": 0.3} if seen.cuts % 2 else firm
        felt, handle = made(), EmulatedHandle(led(seen.cuts), mass=mass, damping=damping, **hand_of_cut)
        held, work_before = 0.0, seen.given
        wait = 0
        while not cut.end and seen.seconds < seconds:
            stylus = Stylus(min(max(handle.position, 0.0), 0.149), 0.5 * math.pi)
            cut.tick(stylus)
            if wait == 0:
                blade = float(cut.readings["position"][-1])
                handle.force = -felt.update(handle.position, blade)
                seen.longest_hold = max(seen.longest_hold, held)
                held = 0.0
                wait = int(rng.integers(1, 5)) if rng.random() < late else 0
            else:
                wait -= 1
            held += TICK
            for _ in range(_SUBSTEPS):
                step = TICK / _SUBSTEPS
                before = handle.position, handle.speed
                hand = handle.hand_stiffness * (handle.target(handle.time) - before[0])
                hand -= handle.hand_damping * before[1]
                # The mean of the speeds before and after a step makes the work that of the step's own kinetic energy.
                handle.speed += step / mass * (hand + handle.force - damping * before[1])
                handle.position += step * 0.5 * (before[1] + handle.speed)
                handle.time += step
                seen.given += hand * step * 0.5 * (before[1] + handle.speed)
            seen.seconds += TICK
            seen.strongest = max(seen.strongest, abs(handle.force))
            kinetic = 0.5 * mass * handle.speed**2
            seen.least = min(seen.least, seen.given - work_before - kinetic)
        seen.cuts += 1
    return seen


def passivity(minutes: float, late: float) -> None:
    """Print the table of the observer."""
    coupling = INVERSE3_COUPLING
    settings = {"late": late, "damping": coupling.device_damping, "mass": coupling.device_mass}
    seen = observe(60.0 * minutes, coupling.felt, **settings)
    print("| time [s] | cuts | greatest force [N] | longest hold [ms] | work of the hand [J] | least [mJ] |")
    print("| --- | --- | --- | --- | --- | --- |")
    print(
        f"| {seen.seconds:.0f} | {seen.cuts} | {seen.strongest:.2f} | {1e3 * seen.longest_hold:.0f} "
        f"| {seen.given:.2f} | {1e3 * seen.least:.3f} |"
    )


def got_out(coupling: VirtualCoupling, stiffness: float | None) -> float:
    """Return the energy [J] that a hand gets from a blade that stands, by moves of 0.1 mm at the worst moments.

    It leans on the spring first. ``stiffness`` None: with the account, as stiff as the coupling.
    """
    felt = coupling.felt() if stiffness is None else NoAccount(coupling, stiffness)
    moves = [0.001, *([1e-4, -1e-4] * 500)]
    position, given = 0.0, 0.0
    felt.update(position, 0.0)
    for move in moves:
        given += felt.force * move + coupling.device_damping / coupling.period * move**2
        position += move
        felt.update(position, 0.0)
    given += felt.force * -position + coupling.device_damping / coupling.period * position**2
    return -given


def largest(good: Callable[[float], bool]) -> float:
    """Return the largest stiffness [N/m] that is good, by bisection."""
    low, high = 0.0, _STIFFEST
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if good(middle) else (low, middle)
    return low


def z_width() -> None:
    """Print the table of stiffnesses."""
    print("| period [ms] | passive bound [N/m] | a hand gets energy from [N/m] | swings up alone from [N/m] | "
          "got at ten times the bound, no account [mJ] | with it [mJ] |")  # fmt: skip
    print("| --- | --- | --- | --- | --- | --- |")
    base = replace(INVERSE3_COUPLING, stiffness=1.0, force_limit=100.0)
    for period in (0.001, 0.002, 0.005, 0.010):
        coupling = replace(base, period=period, damping=min(base.damping, 0.4 * base.device_damping))
        b, damping = coupling.device_damping, coupling.damping
        bound = 2.0 * (b - damping) / period
        drawn = largest(lambda stiffness, c=coupling: per_cycle(c, stiffness) <= 0.0)
        alone = largest(lambda stiffness, c=coupling: growth(c, stiffness) < 1.0)
        got = [abs(max(got_out(_unchecked(coupling, 10.0 * bound), stiff), 0.0)) for stiff in (10.0 * bound, None)]
        limits = f"{bound:.0f} | {drawn:.0f} | {alone:.0f}"
        print(f"| {1e3 * period:g} | {limits} | {1e3 * got[0]:.2f} | {1e3 * got[1]:.2f} |")
    print(f"\nThe device alone, force off, resists with {base.device_damping:g} N s/m: the lower end.")


def per_cycle(coupling: VirtualCoupling, stiffness: float) -> float:
    """Return the energy [J] that one move to and fro gets out of the sampled spring; negative: it costs."""
    b, damping, period, move = coupling.device_damping, coupling.damping, coupling.period, 1e-4
    out_force = -damping / period * move  # held while it moves out: the damper still has the move before
    back_force = stiffness * move + damping / period * move
    return -(out_force * move - back_force * move + 2.0 * b / period * move**2)


def growth(coupling: VirtualCoupling, stiffness: float) -> float:
    """Return the growth of a free device's motion under a spring that may be stiffer than a coupling allows."""
    values = {name: getattr(coupling, name) for name in ("damping", "device_mass", "device_damping", "period")}
    grown: float = VirtualCoupling.growth.fget(SimpleNamespace(stiffness=stiffness, **values))  # type: ignore[attr-defined]
    return grown


def _unchecked(coupling: VirtualCoupling, stiffness: float) -> VirtualCoupling:
    """Return a coupling that is stiffer than the bound, which only an experiment may have."""
    made = replace(coupling)
    object.__setattr__(made, "stiffness", stiffness)
    return made


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("passivity", "z-width"), help="table")
    parser.add_argument("--minutes", type=float, default=10.0, help="simulated time; default 10")
    parser.add_argument("--late", type=float, default=0.02, help="share of samples held up to 5 ms; default 0.02")
    arguments = parser.parse_args()
    if arguments.what == "z-width":
        z_width()
    else:
        passivity(arguments.minutes, arguments.late)
