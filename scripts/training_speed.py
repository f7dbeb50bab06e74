"""Measure how fast PPO trains with the settings of ``cutenv train``, and the share of the environments.

    python scripts/training_speed.py               some 30 seconds; prints one line of JSON
    python scripts/training_speed.py --updates 20  for a less variable number

Part of scripts/bench.py.  The agent has the skill of the shipped one, explores as at the end of training, and keeps its
skill (its learning rate is almost zero): an untrained one stands still until the deadline, which is cheaper to simulate
than cutting and starting again.  Pre-training, validation and report are left out, because they are not part of the
cost of a decision.
"""

from __future__ import annotations

import argparse
import itertools
import json
import math
import time

import torch
from stable_baselines3 import PPO

from cutenv.learning.arguments import PPOArguments
from cutenv.learning.ppo import LEARNER
from cutenv.policy import shipped

SKILLED = "ppo-free"
"""Name of the shipped agent whose weights are used."""
_NEXT_TO_NOTHING = 1e-9  # learning rate


def speed(arguments: PPOArguments, updates: int) -> dict[str, float]:
    """Train for ``updates`` updates after the first one, which compiles and resets every environment."""
    torch.set_num_threads(1)  # as in training: two thread pools on two cores compete
    model = LEARNER.new_model(arguments, arguments.training_environments())
    rollout = arguments.environments * arguments.rollout
    give_skill(model, arguments.last_exploration)
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


def give_skill(model: PPO, exploration: float) -> None:
    """Set the actor to the weights of the shipped agent, with this standard deviation of exploration."""
    weights = itertools.chain.from_iterable(shipped(SKILLED).network.layers)
    with torch.no_grad():
        for own, known in zip(model.policy.actor_parameters(), weights, strict=True):
            own.copy_(torch.tensor(known))
        model.policy.log_std.fill_(math.log(exploration))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--updates", type=int, default=8, metavar="N", help="number of updates of the networks; default 8"
    )
    updates = parser.parse_args().updates
    if updates < 1:
        parser.error(f"--updates {updates} is less than 1: nothing would be measured")
    print(json.dumps(speed(PPOArguments(learning_rate=_NEXT_TO_NOTHING), updates)))


if __name__ == "__main__":
    main()
