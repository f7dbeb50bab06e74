"""Soak test: cut after cut on an emulated rig for minutes, and the timing of its clock.

    python -m scripts.validation.rig.rig_soak                             5 minutes of cutting, in some ten
    python -m scripts.validation.rig.rig_soak --json runs/rig-soak.json   for scripts/update_docs.py rig-soak

Decisions at 50 Hz by a slow feed that ends where it estimates the tip at the target, force at 1 kHz, SYNC every 5 ms,
ways back to the clamp between cuts, drive and sensor in a separate process.  The minutes are those of cuts.  A stop
caused by the machine's own delay is the price of a busy computer: it is counted, the operator (here the script) resets
it, and the next cut begins.
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.agents.policy import Policy
from cutenv.commands.rig.run import chosen_policy, rehearse
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.rig.devices.camera import RigCamera
from cutenv.rig.devices.protocols import ForceSample, MotionSample
from cutenv.rig.errors import RigError
from cutenv.rig.plant import RigPlant
from scripts.tables import keep_json
from scripts.validation.rig.cutting_rig import HostWatch

DEFAULT = Path("runs") / "rig-soak.json"
POLICY = "constant 0.38 cm/s 90 deg"
PERIOD = 0.020  # [s]
PERCENTILES = (50.0, 99.0, 99.9, 100.0)


class Times:
    """Times of events during the cuts, in lists by name; all [s]."""

    def __init__(self) -> None:
        self.series: dict[str, list[float]] = {
            "from command to command": [],
            "difference to 20 ms": [],
            "command later than due": [],
            "newest reading to command": [],
            "between force readings": [],
            "between samples of the blade": [],
        }
        self.counts: Counter[str] = Counter()
        self.stops: Counter[str] = Counter()
        self.host: list[float] = []
        self._moved = self._felt = 0.0

    def listen(self, plant: RigPlant) -> None:
        """Record the times of the drivers' events before they reach the plant."""
        force, motion = plant.force, plant.motion

        def felt(sample: ForceSample) -> None:
            if self._felt:
                self.series["between force readings"].append(sample.time - self._felt)
            self._felt = sample.time
            force(sample)

        def moved(axis: str, sample: MotionSample) -> None:
            if axis == "blade":
                if self._moved:
                    self.series["between samples of the blade"].append(sample.time - self._moved)
                self._moved = sample.time
            motion(axis, sample)

        plant.force, plant.motion = felt, moved  # type: ignore[method-assign]

    def take(self, plant: RigPlant) -> None:
        """Store the clock statistics of a cut."""
        timing = plant.timing
        periods = np.array(timing.periods)
        self.series["from command to command"] += timing.periods
        self.series["difference to 20 ms"] += np.abs(periods - PERIOD).tolist()
        self.series["command later than due"] += timing.lateness
        self.series["newest reading to command"] += timing.latencies
        self.counts.update(cuts=1, decisions=len(periods) + 1, overruns=timing.overruns, garbled=timing.garbled)


def processor_time(pid: int) -> float:
    """Return the processor time of a process so far, on Linux [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def cut(env: RigCutEnv, policy: Policy, *, seed: int, episode: int, most: int) -> dict[str, Any]:
    """Make one cut, or the first ``most`` decisions of it; return the last info."""
    observation, info = env.reset(seed=seed, options={"episode": episode})
    policy.reset(np.random.default_rng([seed, episode]))
    ended, made = False, 0
    while not ended and made < most:
        observation, _, ended, _, info = env.step(policy(observation))
        made += 1
    return info


def soak(minutes: float, *, seed: int, records: Path | None = None, camera: RigCamera | None = None) -> dict[str, Any]:
    """Cut for ``minutes``, ways back not counted; return the results. With records, a camera can be beside the rig."""
    policy, keywords = chosen_policy(POLICY)
    env = RigCutEnv(rig="emulator", specimen_class="liver", records=records, **keywords)
    rehearse(env, policy, seed=seed)
    times = Times()
    with env:
        plant = env.session.plant
        times.listen(plant)
        env.session.open()
        env._source._camera = camera  # an emulated rig has no file that names one
        watch = HostWatch(plant.clock)
        control = env._source.emulator.control  # type: ignore[union-attr]  # it runs since there is a session
        before, began, episode = len(control.events()), time.monotonic(), 0
        processes = {"program": os.getpid(), "spine": plant.spine.pid, "emulator": env._source.emulator.pid}  # type: ignore[union-attr]
        spent = {name: processor_time(pid) for name, pid in processes.items()}
        wanted, patience = round(60.0 * minutes / PERIOD), began + 240.0 * minutes + 60.0
        while (left := wanted - times.counts["decisions"]) > 0 and time.monotonic() < patience:
            try:
                info = cut(env, policy, seed=seed, episode=episode, most=left)
            except RigError as error:  # stopped on the way to the clamp, or not ready: a busy computer
                times.stops[f"between cuts: {str(error).partition(':')[0]}"] += 1
                continue
            finally:
                episode += 1
            times.take(plant)
            if "stop" in info:
                times.stops[info["stop"]["cause"]] += 1
        took = time.monotonic() - began
        shares = {name: (processor_time(pid) - spent[name]) / took for name, pid in processes.items()}
        watch.stop()
        emulator = [event["late_s"] for event in control.events(before) if event["what"] == "stall"]
        real = {"rig": env.session.plant.spine.real_time, "emulator": control.state()["real_time"]}
        env.session.end_cut()
    return {
        "minutes": took / 60.0,
        "real_time": real,
        "processor_shares": shares,
        "machine": {"system": platform.platform(), "cores": os.cpu_count(), "python": platform.python_version()},
        "percentiles_ms": {
            name: [1e3 * float(np.percentile(values, each)) for each in PERCENTILES]
            for name, values in times.series.items()
            if values
        },
        "counts": dict(times.counts),
        "stops": dict(times.stops),
        "host_stalls_ms": {
            "rig": [round(1e3 * late, 1) for _, late in watch.stalls],
            "emulator": [round(1e3 * late, 1) for late in emulator],
        },
    }


def text(kept: dict[str, Any]) -> str:
    """Return what is printed, and shown in the documentation."""
    counts, stalls = kept["counts"], kept["host_stalls_ms"]
    allowed = ", ".join(f"{name}: {'yes' if yes else 'no'}" for name, yes in kept["real_time"].items())
    shares = ", ".join(f"{name} {100.0 * share:.0f} %" for name, share in kept["processor_shares"].items())
    lines = [
        f"{counts.get('decisions', 0) * PERIOD / 60.0:.1f} minutes of cutting in {kept['minutes']:.1f}, "
        f"{counts.get('cuts', 0)} cuts, {counts.get('decisions', 0)} decisions",
        f"{kept['machine']['cores']} cores; real-time priority ({allowed})",
        f"of a core: {shares}",
        "",
        f"{'[ms]':29s}" + "".join(f"{name:>9s}" for name in ("50 %", "99 %", "99.9 %", "max")),
    ]
    for name, values in kept["percentiles_ms"].items():
        lines.append(f"{name:29s}" + "".join(f"{value:9.2f}" for value in values))
    stops = ", ".join(f"{cause} {count}" for cause, count in sorted(kept["stops"].items())) or "none"
    lines += [
        "",
        f"commands more than 2 ms late: {counts.get('overruns', 0)}; packets that were no readings: "
        f"{counts.get('garbled', 0)}",
        f"stops: {stops}",
        *(
            f"host stalls of more than 5 ms, {name}: {len(late)}" + (f", longest {max(late):.0f} ms" if late else "")
            for name, late in stalls.items()
        ),
    ]
    return "\n".join(lines)


def markdown(kept: dict[str, Any]) -> str:
    """Return the same as a block of code."""
    return f"```\n{text(kept)}\n```"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--minutes", type=float, default=5.0, metavar="M", help="of cutting; default 5")
    add("--seed", type=int, default=0, help="of the specimens; default 0")
    add("--json", type=Path, metavar="FILE", help=f"keep the numbers there; the documentation is made from {DEFAULT}")
    arguments = parser.parse_args()
    kept = soak(arguments.minutes, seed=arguments.seed)
    if arguments.json is not None:
        keep_json(arguments.json, kept)
    print(text(kept))
