"""Policies on a slow rig, beside the same on the rig of the tasks: can a cheap rig be used.

    python -m scripts.benchmarks.policies.slow_rig_agents --train
                                                         trains three policies for it, 5 minutes each, and compares
    python -m scripts.benchmarks.policies.slow_rig_agents  compares with the policies trained before
    python -m scripts.benchmarks.policies.slow_rig_agents --on-rig 6
                                                         cuts some specimens on the emulated serial rig too

The slow rig is that of ``cutenv rig init --profile serial`` with an HX711: force at 80 readings a second, 10 decisions
a second, 4.8 mm/s, the blade upright.  Its drive and noise are as ``cutenv rig identify`` measures them on the emulated
one.  All is kept in runs/slow-rig; ``scripts/update_docs.py slow-rig-agents`` puts the table on its page.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.agents.learning.evaluation import Contestant, contestant, evaluate
from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.learning.statistics import by_policy, differences
from cutenv.agents.policy import SCRIPTS, ConstantFeed, Policy
from cutenv.agents.sim_to_real import ComparedCut
from cutenv.agents.sim_to_real.paired_experiment import LOST_TIME, cut_once, simulator_like
from cutenv.drivers.rig_names import settings_of
from cutenv.envs import RigCutEnv
from cutenv.rig.config.settings import Identified, RigSettings
from cutenv.rig.errors import RigError
from cutenv.rig.operation.suitability import decisions, simulator_keywords, top_speed
from cutenv.rig.toml_file import to_toml, write_identified
from cutenv.task.reward import STOPPED
from scripts.tables import interval_text, keep_json, kept_json, mean_text

FOLDER = Path("runs") / "slow-rig"
DEFAULT = FOLDER / "table.json"
FILE = FOLDER / "rig.toml"
IDENTIFIED = Identified(  # properties of the emulated serial rig, as 'cutenv rig identify' has measured them
    date="2026-11-25", motor_lag=0.0068, dead_time=0.0, acceleration=0.0993, force_noise=0.0013,
    force_resolution=2.34e-5, force_drift=0.0,
)  # fmt: skip
UPRIGHT: dict[str, Any] = {"specimen_class": "mixed", "angle_mode": "fixed", "fixed_angle_deg": 90.0}
_NAMES = ("force feedback", "fast then slow", "probe and creep", "return stroke")
_TRAINED, _SHIPPED = "trained for the slow rig", "ppo-fixed"
_SCORES = ("return", "success", "tip_error_mm", "largest_jump_mm", "time_s")
_STEPPED = "return stroke"
_TRIES = 8  # at a specimen, on a computer that is late
_SHORT_CUT = 0.06  # [m] target of the cuts in real time
_CHECKED = ("return stroke", f"{_TRAINED}, seed 0")


def slow_rig() -> RigSettings:
    """Return the settings of the slow rig."""
    return replace(settings_of("serial"), name="slow rig", identified=IDENTIFIED)


def write_rig() -> None:
    """Write the file of the slow rig, for ``cutenv train --rig``."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    port = "/dev/null"  # nothing is connected: training reads the file alone
    rig = slow_rig()
    blade = replace(rig.blade, options=replace(rig.blade.options, port=port))
    sensor = replace(rig.sensor, options=replace(rig.sensor.options, port=port))
    profile = ((0.0, 0.0175), (0.15, 0.0175))
    told = replace(rig, blade=blade, sensor=sensor, emulated=False, armed_by="", depth_profile=profile)
    FILE.write_text(to_toml(replace(told, identified=Identified())), encoding="utf-8")
    write_identified(FILE, IDENTIFIED)


def train(seeds: int) -> None:
    """Train a policy for the slow rig with each seed that has none yet, by the command that a user gives."""
    write_rig()
    for seed in range(seeds):
        if not _folder(seed).exists():
            name = str(_folder(seed).parent.relative_to("runs"))
            command = [sys.executable, "-m", "cutenv", "train", "--rig", str(FILE), "--seed", str(seed)]
            subprocess.run([*command, "--specimens", "0", "--minutes", "7", "--name", name], check=True)


def _folder(seed: int) -> Path:
    return FOLDER / f"seed-{seed}" / "policy"


def contestants(rate: int) -> dict[str, Contestant]:
    """Return policies by name; scripts decide ``rate`` times a second."""
    pace = {"control_hz": rate}
    found = {"constant 0.48 cm/s": Contestant(ConstantFeed(speed=top_speed(slow_rig()), angle=np.pi / 2), pace)}
    found |= {name: Contestant(SCRIPTS[name](), pace) for name in _NAMES}
    found[_SHIPPED] = contestant(_SHIPPED)
    trained = sorted(FOLDER.glob("seed-*/policy"))
    return found | {
        f"{_TRAINED}, {folder.parent.name.replace('-', ' ')}": contestant(str(folder)) for folder in trained
    }


def measure(specimens: int, processes: int | None) -> dict[str, Any]:
    """Return scores of every cut on both rigs, and the constants of the slow one."""
    slow, seeds = slow_rig(), TEST_SEEDS[:specimens]
    rate = decisions(slow)
    rows = {
        "slow": evaluate(contestants(rate), seeds, {**UPRIGHT, **simulator_keywords(slow)}, processes=processes),
        "tasks": evaluate(contestants(rate), seeds, UPRIGHT, processes=processes),
    }
    steps = {
        name: evaluate({_STEPPED: Contestant(SCRIPTS[_STEPPED](), pace)}, seeds, UPRIGHT | more, processes=processes)
        for name, pace, more in steps_of(slow)
    }
    return {"constants": simulator_keywords(slow), "decisions": rate, "rows": _short(rows), "steps": _short(steps)}


def steps_of(slow: RigSettings) -> list[tuple[str, dict[str, int], dict[str, float]]]:
    """Return the way from the rig of the tasks to the slow one: name, decisions a second, and constants."""
    pace, constants = {"control_hz": decisions(slow)}, simulator_keywords(slow)
    delay = {"force_delay": constants["force_delay"]}
    return [
        ("of the tasks, 50 decisions a second", {}, {}),
        (f"{pace['control_hz']} decisions a second", pace, {}),
        (f"and the force {1e3 * delay['force_delay']:.0f} ms late", pace, delay),
        (f"and {1e3 * constants['top_speed']:.1f} mm/s: the slow rig", pace, constants),
    ]


def _short(rows: Mapping[str, Sequence[Mapping[str, Any]]]) -> dict[str, list[dict[str, Any]]]:
    return {
        key: [{each: row[each] for each in ("policy", "seed", *_SCORES)} for row in own] for key, own in rows.items()
    }


def check(specimens: int, rate: int) -> list[dict[str, Any]]:
    """Cut specimens on the emulated serial rig, in real time, and in its simulator; return what both found."""
    shared: dict[str, Any] = {"control_hz": rate, "specimen_class": "mixed", "target_length": _SHORT_CUT}
    found = []
    for name in _CHECKED:
        policy, again = contestants(rate)[name].policy, 0
        rig = RigCutEnv(rig="serial", **shared)
        own = simulator_keywords(replace(rig.settings, identified=IDENTIFIED))
        simulator = simulator_like(rig, **shared, **own)
        pairs = []
        try:
            for episode in range(specimens):
                cut, late = cut_in_time(rig, policy, episode)
                again += late
                if cut is not None:
                    pairs.append((cut, cut_once(simulator, policy, seed=0, episode=episode)))
        finally:
            rig.close()
        for where, cuts in zip(("rig", "simulator"), zip(*pairs, strict=True), strict=False):
            value, success = (float(np.mean([getattr(cut, key) for cut in cuts])) for key in ("value", "success"))
            found.append({"policy": name, "where": where, "cuts": len(cuts), "return": value, "success": success})
            found[-1]["again"] = again if where == "rig" else 0
    return found


def cut_in_time(rig: RigCutEnv, policy: Policy, episode: int) -> tuple[ComparedCut | None, int]:
    """Cut a specimen, again where a late computer stopped the rig; return the cut, None if none came, and how often."""
    for again in range(_TRIES):
        try:
            cut = cut_once(rig, policy, seed=0, episode=episode)
        except RigError as error:  # stopped before the blade was at the clamp: begin with another emulator
            print(f"specimen {episode}: {error}", file=sys.stderr)
            rig.close()
            continue
        report = rig.session.plant.supervisor.report
        if cut.end != STOPPED or report is None or report.cause not in LOST_TIME:
            return cut, again
        print(f"specimen {episode}: {report}", file=sys.stderr)
    return None, _TRIES


def _cells(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    mean = {score: np.mean([row[score] for row in rows]) for score in _SCORES}
    return [
        mean_text(row["return"] for row in rows), f"{100.0 * mean['success']:.0f} %",
        f"{mean['tip_error_mm']:.1f}", f"{mean['largest_jump_mm']:.1f}",
        f"{mean['time_s']:.1f}",
    ]  # fmt: skip


def markdown(kept: Mapping[str, Any]) -> str:
    """Return the table for the documentation, with the sentence that answers the question."""
    slow, tasks = by_policy(kept["rows"]["slow"]), by_policy(kept["rows"]["tasks"])
    head = ("policy", "return", "success", "tip error [mm]", "largest run [mm]", "time [s]")
    lines = [
        f"| {' | '.join(head)} | return on the rig of the tasks | success there |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    lines += [f"| {' | '.join([name, *_cells(own), *_cells(tasks[name])[:2]])} |" for name, own in slow.items()]
    count = len({row["seed"] for row in kept["rows"]["slow"]})
    made = "held-out specimens of class mixed, simulated, blade upright"
    lines += ["", f"{count} {made}, {kept['decisions']} decisions a second; mean with 95 % interval."]
    lines += ["", answer(kept), "", f'What it is that costs, by the script "{_STEPPED}":', ""]
    lines += [f"| {' | '.join(('rig', *head[1:]))} |", "| --- | --- | --- | --- | --- | --- |"]
    lines += [f"| {' | '.join([name, *_cells(own)])} |" for name, own in kept["steps"].items()]
    if kept.get("check"):
        lines += ["", f"A check in real time, to {1e3 * _SHORT_CUT:.0f} mm, by what a rig can know itself:", ""]
        head = ("policy", "cuts on", "cuts", "return", "success", "stopped by a late computer, and cut again")
        lines += [f"| {' | '.join(head)} |", "| --- | --- | --- | --- | --- | --- |"]
        for each in kept["check"]:
            where = "the emulated serial rig" if each["where"] == "rig" else "its simulator, the same specimens"
            told = f"{each['return']:.3f} | {100.0 * each['success']:.0f} % | {each['again']}"
            lines.append(f"| {each['policy']} | {where} | {each['cuts']} | {told} |")
    return "\n".join(lines)


def answer(kept: Mapping[str, Any]) -> str:
    """Return one sentence: what the best policy does on the slow rig, less what the best does on the other."""
    slow, tasks = (by_policy(kept["rows"][rig]) for rig in ("slow", "tasks"))
    means = [{name: float(np.mean([row["return"] for row in own])) for name, own in by.items()} for by in (slow, tasks)]
    best, best_of_tasks = (max(each, key=lambda name: each[name]) for each in means)
    success = 100.0 * float(np.mean([row["success"] for row in slow[best]]))
    trained = [name for name in slow if name.startswith(_TRAINED)]

    def gains(other: str) -> str:
        rows = [row for name in trained for row in differences(kept["rows"]["slow"], name, ("return",))]
        told = [row for row in rows if row["baseline"] == other]
        return ", ".join(interval_text(row, sign="+") for row in told)

    there, here = means[1][best_of_tasks], means[0][best]
    text = (
        f'**A cheap rig can be used, and costs {there - here:.2f} of the return:** the best on it, "{best}", returns '
        f'{here:.3f} with {success:.0f} % successes; "{best_of_tasks}" returns {there:.3f} on the rig of the tasks.'
    )
    if trained:
        text += (
            f" A policy trained for the slow rig returns more than {_SHIPPED}, which was not, by {gains(_SHIPPED)} "
            f'(paired, each seed), and beside the script "{_STEPPED}" from which it began, {gains(_STEPPED)}.'
        )
    return text


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--train", action="store_true", help="train policies for the slow rig first")
    parser.add_argument("--seeds", type=int, default=3, metavar="N", help="number of policies to train; default 3")
    parser.add_argument("--specimens", type=int, default=200, metavar="N", help="number of specimens; default 200")
    parser.add_argument("--processes", type=int, metavar="N", help="number of processes; default one per core")
    parser.add_argument("--on-rig", type=int, default=0, metavar="N", help="specimens on the emulated serial rig, 6 or "
                        "more; default none, as before")  # fmt: skip
    parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
    arguments = parser.parse_args()
    if arguments.train:
        train(arguments.seeds)
    if not arguments.print:
        before = kept_json(DEFAULT, "") if DEFAULT.is_file() else {}
        found = before
        if not arguments.on_rig or not before:
            found = measure(arguments.specimens, arguments.processes) | {"check": before.get("check", [])}
        if arguments.on_rig:
            found["check"] = check(arguments.on_rig, found["decisions"])
        keep_json(DEFAULT, found)
    print(markdown(kept_json(DEFAULT, "scripts.benchmarks.policies.slow_rig_agents --train")), flush=True)


if __name__ == "__main__":
    main()
