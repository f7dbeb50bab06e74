"""Attacks on a rig over sockets, processes, clocks, load and memory: each a small function, run on an emulated rig.

    python scripts/rig_attacks.py                               each once, some minutes
    python scripts/rig_attacks.py --only foreign_sync --times 5
    python scripts/rig_attacks.py --list

A blade cuts at 1.5 cm/s when the attack comes.  For each it is defined beforehand whether it has to stop the blade
(within 5 mm), must not, or may; in any case nothing may move that was stopped.  Exit code 1 if one of them fails.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence

import attacks_by_drivers
import attacks_by_policy
import attacks_on_process
import attacks_on_spine
import attacks_on_wires
from attack_scene import Attack, Outcome, Scene

from cutenv.rig.errors import RigError

_ATTEMPTS = 8  # at an attack that the host's stalls prevent
_PARTS = (attacks_on_wires, attacks_on_process, attacks_on_spine, attacks_by_drivers)
_HELD: dict[str, Callable[[Outcome], bool]] = {
    "stopped": lambda outcome: outcome.stops,
    "ignored": lambda outcome: outcome.goes_on,
    "either": lambda outcome: outcome.safe,
}
ATTACKS: dict[str, tuple[Attack, str]] = {
    attack.__name__: (attack, wanted)
    for part in _PARTS
    for wanted, attacks in (("stopped", part.STOPPED), ("ignored", part.IGNORED), ("either", part.EITHER))
    for attack in attacks
}
"""Attacks by name, each with the required outcome."""
TRIALS = {trial.__name__: trial for trial in (*attacks_on_spine.ENDS, *attacks_by_policy.POLICIES)}
"""Trials by name, each on an emulated rig of its own: what was wrong, or nothing, and what was seen."""


def made(scene: Scene, name: str, seed: int) -> tuple[bool, str]:
    """Run one attack; return whether it was withstood, and the observations."""
    if name in TRIALS:
        wrong, seen = TRIALS[name]()
        return not wrong, "; ".join([*(f"! {each}" for each in wrong), *seen])
    attack, wanted = ATTACKS[name]
    for attempt in range(1, _ATTEMPTS + 1):
        try:
            outcome = scene.attacked(attack, seed)
        except RigError as error:  # a busy machine keeps the rig from becoming ready
            if attempt == _ATTEMPTS:
                return False, f"! no trial: {error}"
            continue
        finally:
            scene.renew()
        if not (outcome.before or (wanted == "ignored" and outcome.disturbed)):
            break
    way = "" if outcome.way is None else f"{1e3 * outcome.way:.2f} mm"
    told = "; ".join([outcome.cause or "goes on", way, *outcome.notes])
    host = f" [host stalled {outcome.stalls} times]" if outcome.stalls else ""
    again = f" [made {attempt} times: the host stopped it]" if attempt > 1 else ""
    return not outcome.before and _HELD[wanted](outcome), f"to be {wanted}: {told}{host}{again}"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the attacks; return 0 if all were withstood."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = [*ATTACKS, *TRIALS]
    parser.add_argument("--only", choices=known, nargs="+", default=known, metavar="ATTACK")
    parser.add_argument("--times", type=int, default=1, metavar="N", help="of each; default 1")
    parser.add_argument("--list", action="store_true", help="print what each does")
    arguments = parser.parse_args(argv)
    if arguments.list:
        for name, about in ({name: attack for name, (attack, _) in ATTACKS.items()} | TRIALS).items():
            print(f"{name:<28} {about.__doc__}")
        return 0
    failed = 0
    with Scene() as scene:
        for name in arguments.only:
            for number in range(arguments.times):
                held, seen = made(scene, name, number)
                failed += not held
                print(f"{'held' if held else 'FELL'}  {name:<28} {seen}", flush=True)
    print(f"\n{len(arguments.only) * arguments.times} attacks, {failed} did not hold")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
