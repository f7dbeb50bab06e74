"""Training by PPO with the project's own settings: decisions per second, and the environments' share of the time.

The package holds no learner: ``agents/speed.py`` of a checkout measures, in a process of its own.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

from cutenv.bench.measured import Measured, Number, at_most

CHECKOUT = Path(__file__).resolve().parents[2]
LEARNERS = ("stable_baselines3", "torch", "safetensors")
ALLOWED_SHARE = 0.1
"""Of the time of training that the environments may take."""
_LIMIT_S = 600.0
_UNITS = {"decisions": "1", "decisions_per_s": "1/s", "environments_share": "1"}


def missing(checkout: Path) -> str | None:
    """Why PPO cannot be measured, and the cure; None if it can."""
    if not (checkout / "pyproject.toml").is_file() or not (checkout / "agents" / "speed.py").is_file():
        return "its learner, agents/speed.py, is not installed with the package; run this in a checkout of cutenv"
    absent = [name for name in LEARNERS if find_spec(name) is None]
    return f"{', '.join(absent)} not installed: pip install 'cutenv[rl]'" if absent else None


def training_speed(checkout: Path) -> dict[str, float]:
    """What ``agents/speed.py`` prints: decisions, decisions_per_s, environments_share.

    Raises
    ------
    RuntimeError
        If the program fails; ends in its last words.
    """
    path = os.pathsep.join([str(checkout), *filter(None, [os.environ.get("PYTHONPATH")])])
    try:
        done = subprocess.run(
            [sys.executable, str(checkout / "agents" / "speed.py")],
            env=os.environ | {"PYTHONPATH": path},
            capture_output=True,
            text=True,
            timeout=_LIMIT_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise RuntimeError(f"agents/speed.py was not done after {_LIMIT_S:g} s") from None
    if done.returncode != 0:
        said = (done.stderr.strip() or "nothing").splitlines()[-1]
        raise RuntimeError(f"agents/speed.py failed with status {done.returncode}: {said}")
    found = json.loads(done.stdout.splitlines()[-1])
    return {name: float(found[name]) for name in _UNITS}


def measure() -> Measured:
    """A short training run; without a checkout or the learner, why there is none."""
    why = missing(CHECKOUT)
    if why is None:
        try:
            found = training_speed(CHECKOUT)
        except RuntimeError as error:
            why = str(error)
    if why is not None:
        return Measured({}, [f"PPO is not measured: {why}"])
    share = found["environments_share"]
    taken = f"the environments take {100.0 * share:.0f} % of the time"
    lines = [
        "PPO (Stable-Baselines3) with the settings of agents/ppo.py, of an agent that cuts",
        f"  {found['decisions_per_s']:.0f} decisions a second over {found['decisions']:.0f}",
        at_most(taken, share, ALLOWED_SHARE, f"{100.0 * ALLOWED_SHARE:g} %"),
    ]
    return Measured({name: Number(found[name], unit) for name, unit in _UNITS.items()}, lines)
