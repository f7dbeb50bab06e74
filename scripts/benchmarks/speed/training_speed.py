"""Measure how fast PPO trains with the settings of ``cutenv train``, and the share of the environments.

    python -m scripts.benchmarks.speed.training_speed  some 30 seconds; prints one line of JSON
    python -m scripts.benchmarks.speed.training_speed --memory
                                                       agents/ppo_gru.py, and RecurrentPPO of sb3-contrib: two minutes

Part of scripts/benchmarks/speed/bench.py.  The agent has the skill of the shipped one, explores as at the end of
training, and keeps its skill (its learning rate is almost zero): an untrained one stands still until the deadline,
which is cheaper to simulate than cutting and starting again.  Pre-training, validation and report are left out, because
they are not part of the cost of a decision.

With ``--memory`` two learners with a memory train from nothing, one after the other in this process, with the settings
of ``agents/ppo_gru.py``: environments, decisions, minibatches, epochs, size of the memory and of the layers after it.
Actor and critic of RecurrentPPO share one LSTM, as those of the other share the GRU.  The rates are decisions a second
of processor time.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import math
import sys
import time

import torch
from stable_baselines3 import PPO

from cutenv.agents.learning.arguments import PPOArguments
from cutenv.agents.learning.on_policy import ON_POLICY
from cutenv.agents.policy import shipped
from cutenv.agents.sb3 import NativeVecEnv
from cutenv.envs import set_cores
from scripts import ROOT

sys.path.append(str(ROOT / "agents"))  # the programs there are no package
import ppo_gru

SKILLED = "ppo-free"  # name of the shipped agent whose weights are used
_NEXT_TO_NOTHING = 1e-9  # learning rate


def speed(arguments: PPOArguments, updates: int) -> dict[str, float]:
    """Train for ``updates`` updates after the first one, which compiles and resets every environment."""
    torch.set_num_threads(1)  # as in training: two thread pools on two cores compete
    model = ON_POLICY["ppo"].new_model(arguments, arguments.training_environments())
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


def memory_speed(args: ppo_gru.Args, updates: int) -> dict[str, float]:
    """Train both learners with a memory for ``updates`` updates; return their rates and the ratio of these."""
    from sb3_contrib import RecurrentPPO

    torch.set_num_threads(1)
    set_cores(1)
    decisions = updates * args.batch_size
    ppo_gru.train(dataclasses.replace(args, total_decisions=args.batch_size), verbose=False)  # compiles
    begun = time.process_time()
    ppo_gru.train(dataclasses.replace(args, total_decisions=decisions), verbose=False)
    gru_s = time.process_time() - begun

    memory = {"lstm_hidden_size": args.hidden_size, "shared_lstm": True, "enable_critic_lstm": False, "net_arch": [64]}
    model = RecurrentPPO(
        "MlpLstmPolicy",
        NativeVecEnv(args.num_envs, control_hz=args.control_hz),
        n_steps=args.num_steps,
        batch_size=args.batch_size // args.num_minibatches,
        n_epochs=args.update_epochs,
        policy_kwargs=memory,
        device="cpu",
    )
    begun = time.process_time()
    model.learn(decisions)
    recurrent_s = time.process_time() - begun
    return {
        "decisions": decisions,
        "gru_decisions_per_s": decisions / gru_s,
        "recurrent_ppo_decisions_per_s": decisions / recurrent_s,
        "ratio": recurrent_s / gru_s,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--updates", type=int, default=8, metavar="N", help="number of updates of the networks; default 8"
    )
    parser.add_argument("--memory", action="store_true", help="measure the learners with a memory")
    arguments = parser.parse_args()
    updates = arguments.updates
    if updates < 1:
        parser.error(f"--updates {updates} is less than 1: nothing would be measured")
    if arguments.memory:
        found = memory_speed(ppo_gru.Args(), updates)
    else:
        found = speed(PPOArguments(learning_rate=_NEXT_TO_NOTHING), updates)
    print(json.dumps(found))


if __name__ == "__main__":
    main()
