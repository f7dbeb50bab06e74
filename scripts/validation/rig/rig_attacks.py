"""Attacks on a rig over sockets, processes, clocks, load and memory: each a small function, run on an emulated rig.

    python -m scripts.validation.rig.rig_attacks                               each once, some minutes
    python -m scripts.validation.rig.rig_attacks --json runs/rig-attacks.json
        added to what the file has; scripts/update_docs.py

A blade cuts at 1.5 cm/s when the attack comes.  For each it is defined beforehand whether it has to stop the blade
(within 5 mm), must not, or may; in any case nothing may move that was stopped.  Exit code 1 if one of them fails.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from cutenv.rig.errors import RigError
from scripts.tables import keep_json, kept_json, markdown_table
from scripts.validation.rig import (
    attacks_by_drivers,
    attacks_by_policy,
    attacks_on_process,
    attacks_on_spine,
    attacks_on_wires,
)
from scripts.validation.rig.attack_scene import Attack, Outcome, Scene

_ATTEMPTS = 8  # at an attack that the host's stalls prevent
_PARTS = (attacks_on_wires, attacks_on_process, attacks_on_spine, attacks_by_drivers)
_HELD: dict[str, Callable[[Outcome], bool]] = {
    "stopped": lambda outcome: outcome.stops,
    "ignored": lambda outcome: outcome.goes_on,
    "either": lambda outcome: outcome.safe,
}
ATTACKS: dict[str, tuple[Attack, str]] = {  # attacks by name, each with the required outcome
    attack.__name__: (attack, wanted)
    for part in _PARTS
    for wanted, attacks in (("stopped", part.STOPPED), ("ignored", part.IGNORED), ("either", part.EITHER))
    for attack in attacks
}
TRIALS = {trial.__name__: trial for trial in (*attacks_on_spine.ENDS, *attacks_by_policy.POLICIES)}
"""Trials by name, each on an emulated rig of its own: what was wrong, or nothing, and what was seen."""
ABOUT = {name: str(attack.__doc__) for name, (attack, _) in ATTACKS.items()} | {  # description of each, by its name
    name: str(trial.__doc__) for name, trial in TRIALS.items()
}


@dataclass(frozen=True)
class Made:
    """Attack that was made: whether it was withstood, all that was seen, what stopped the blade, and its way [m]."""

    name: str
    held: bool
    seen: str
    cause: str | None = None
    way: float | None = None


def made(scene: Scene, name: str, seed: int) -> Made:
    """Run one attack; return what came of it."""
    if name in TRIALS:
        for attempt in range(1, _ATTEMPTS + 1):
            try:
                wrong, seen = TRIALS[name]()
                break
            except RigError as error:
                if attempt == _ATTEMPTS:
                    return Made(name, False, f"! no trial: {error}")
            finally:
                attacks_by_policy.close_all()
        return Made(name, not wrong, "; ".join([*(f"! {each}" for each in wrong), *seen]))
    attack, wanted = ATTACKS[name]
    for attempt in range(1, _ATTEMPTS + 1):
        try:
            outcome = scene.attacked(attack, seed)
        except RigError as error:  # a busy machine keeps the rig from becoming ready
            if attempt == _ATTEMPTS:
                return Made(name, False, f"! no trial: {error}")
            continue
        finally:
            scene.renew()
        if not (outcome.before or (wanted == "ignored" and outcome.disturbed)):
            break
    way = "" if outcome.way is None else f"{1e3 * outcome.way:.2f} mm"
    told = "; ".join([outcome.cause or "goes on", way, *outcome.notes])
    host = f" [host stalled {outcome.stalls} times]" if outcome.stalls else ""
    again = f" [made {attempt} times: the host stopped it]" if attempt > 1 else ""
    held = not outcome.before and _HELD[wanted](outcome)
    return Made(name, held, f"to be {wanted}: {told}{host}{again}", outcome.cause, outcome.way)


def markdown(kept: dict[str, Any]) -> str:
    """Return the table for the documentation."""
    lines = []
    for name, about in ABOUT.items():
        rows = [Made(**row) for row in kept["attacks"] if row["name"] == name]
        if not rows:
            continue
        wanted = ATTACKS[name][1] if name in ATTACKS else "as it says"
        causes = Counter(row.cause or "goes on" for row in rows) if name in ATTACKS else {}
        ways = [1e3 * abs(row.way) for row in rows if row.way is not None and row.cause is not None]
        way = f"{min(ways):.1f} to {max(ways):.1f}" if ways else "-"
        held = f"{sum(row.held for row in rows)} of {len(rows)}"
        lines.append((about, wanted, held, ", ".join(causes) or "-", way))
    return markdown_table(("attack", "has to be", "held", "stopped as", "way [mm]"), lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Run the attacks; return 0 if all were withstood."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    known = [*ATTACKS, *TRIALS]
    parser.add_argument("--only", choices=known, nargs="+", default=known, metavar="ATTACK")
    parser.add_argument("--times", type=int, default=1, metavar="N", help="of each; default 1")
    parser.add_argument("--json", type=Path, metavar="FILE", help="add what came of each to this file")
    parser.add_argument("--list", action="store_true", help="print what each does")
    arguments = parser.parse_args(argv)
    if arguments.list:
        for name, about in ABOUT.items():
            print(f"{name:<28} {about}")
        return 0
    failed = 0
    with Scene() as scene:
        for name in arguments.only:
            for number in range(arguments.times):
                came = made(scene, name, number)
                failed += not came.held
                print(f"{'held' if came.held else 'FELL'}  {name:<28} {came.seen}", flush=True)
                if arguments.json is not None:
                    before = kept_json(arguments.json, "")["attacks"] if arguments.json.exists() else []
                    keep_json(arguments.json, {"attacks": [*before, asdict(came)]})
    print(f"\n{len(arguments.only) * arguments.times} attacks, {failed} did not hold")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
