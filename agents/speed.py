"""How fast PPO trains here with the settings of ppo.py, and how much of the time the environments take.

    python agents/speed.py               some 15 seconds; prints one line of JSON
    python agents/speed.py --updates 20  for a steadier number

Part of `cutenv bench`. Validation, clone and report are left out: they are not what a decision costs.
"""

from __future__ import annotations

import argparse
import json
import time

import torch
from ppo import Arguments, new_model


def speed(arguments: Arguments, updates: int) -> dict[str, float]:
    """Train for so many updates after the first one, which compiles and begins every environment."""
    torch.set_num_threads(1)  # as in training: two pools of threads on two cores fight
    model = new_model(arguments, arguments.environments_at(arguments.training_seeds))
    rollout = arguments.environments * arguments.rollout
    model.learn(rollout)
    environments = model.get_env()
    begun, spent = time.perf_counter(), environments.seconds
    model.learn(updates * rollout, reset_num_timesteps=False)
    seconds = time.perf_counter() - begun
    return {
        "decisions": updates * rollout,
        "decisions_per_s": updates * rollout / seconds,
        "environments_share": (environments.seconds - spent) / seconds,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--updates", type=int, default=8, metavar="N", help="of the networks (default 8)")
    updates = parser.parse_args().updates
    if updates < 1:
        parser.error(f"--updates {updates} is less than 1: nothing would be measured")
    print(json.dumps(speed(Arguments(), updates)))


if __name__ == "__main__":
    main()
