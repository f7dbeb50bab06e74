"""Speed of training by PPO with the settings of ``cutenv train``: decisions per second, share of the environments.

The measurement is made by ``scripts/benchmarks/speed/training_speed.py`` in a process of its own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import find_spec

from scripts import ROOT
from scripts.benchmarks.speed.measured import Measured, Number, at_most

PROGRAM = ("-m", "scripts.benchmarks.speed.training_speed")
LEARNERS = ("stable_baselines3", "torch", "safetensors")
ALLOWED_SHARE = 0.1  # share of the time of training that the environments may take
_LIMIT_S = 600.0
_UNITS = {"decisions": "1", "decisions_per_s": "1/s", "environments_share": "1"}


def missing() -> str | None:
    """Return the reason why PPO cannot be measured, with the cure; None if it can."""
    absent = [name for name in LEARNERS if find_spec(name) is None]
    return f"{', '.join(absent)} not installed: pip install 'cutenv[rl]'" if absent else None


def training_speed(program: Sequence[str] = PROGRAM) -> dict[str, float]:
    """Run the program; return its decisions, decisions_per_s and environments_share, or raise RuntimeError."""
    path = os.pathsep.join([str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])])
    try:
        done = subprocess.run(
            [sys.executable, *program],
            env=os.environ | {"PYTHONPATH": path},
            capture_output=True,
            text=True,
            timeout=_LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"{program[-1]} was not done after {_LIMIT_S:g} s") from None
    if done.returncode != 0:
        said = (done.stderr.strip() or "nothing").splitlines()[-1]
        raise RuntimeError(f"{program[-1]} failed with status {done.returncode}: {said}")
    found = json.loads(done.stdout.splitlines()[-1])
    return {name: float(found[name]) for name in _UNITS}


def measure() -> Measured:
    """Measure a short training run; without the learners, print the reason."""
    why = missing()
    if why is None:
        try:
            found = training_speed(PROGRAM)
        except RuntimeError as error:
            why = str(error)
    if why is not None:
        return Measured({}, [f"PPO is not measured: {why}"])
    share = found["environments_share"]
    taken = f"the environments take {100.0 * share:.0f} % of the time"
    lines = [
        "PPO (Stable-Baselines3) with the settings of cutenv train, of an agent that cuts",
        f"  {found['decisions_per_s']:.0f} decisions a second over {found['decisions']:.0f}",
        at_most(taken, share, ALLOWED_SHARE, f"{100.0 * ALLOWED_SHARE:g} %"),
    ]
    return Measured({name: Number(found[name], unit) for name, unit in _UNITS.items()}, lines)
