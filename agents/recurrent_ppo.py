"""Recurrent PPO from parts of the package, with LSTM memory.

    python agents/recurrent_ppo.py                  some twenty minutes; writes runs/<name>/policy/
    python agents/recurrent_ppo.py --timesteps 400000 --name mine

``cutenv train --learner recurrent-ppo`` makes the same policy, with --resume, an evaluation and a report; the comments
in ppo.py apply here too.
"""

from __future__ import annotations

from pathlib import Path

import torch
from sb3_contrib import RecurrentPPO

from cutenv.agents.learning.arguments import RecurrentPPOArguments
from cutenv.agents.learning.asymmetric_actors import RecurrentAsymmetricActorCritic
from cutenv.agents.learning.cloning import Cloning, script_demonstrations
from cutenv.agents.learning.on_policy import sb3_keywords
from cutenv.agents.learning.progress import Progress
from cutenv.agents.learning.run_folder import export, record_run, run_program
from cutenv.agents.policy import RecurrentNetwork


def train(arguments: RecurrentPPOArguments, run: Path) -> None:
    """Train an agent, and write its actor into ``run``/policy."""
    torch.set_num_threads(1)
    facts = record_run(arguments, run, "recurrent PPO")
    environments = arguments.training_environments()
    model = RecurrentPPO(RecurrentAsymmetricActorCritic, environments, **sb3_keywords(arguments))

    # A network with memory is cloned along whole cuts.
    if arguments.demonstrations:
        shown = script_demonstrations(environments, arguments)
        Cloning(
            model.policy.actions_along,
            model.policy.actor_parameters(),
            shown.by_cut(),
            epochs=arguments.cloning_epochs,
            batch_size=4096,
            learning_rate=4e-3,
            seed=arguments.seed,
        ).run()

    progress = Progress(run, arguments, curve=[])
    model.learn(arguments.timesteps, callback=progress)
    progress.validate()

    best = RecurrentPPO.load(run / "policy.zip", device="cpu").policy.state_dict()
    weights = {name: values.numpy() for name, values in best.items()}
    export(arguments, run / "policy", RecurrentNetwork.from_state_dict(weights, "tanh"), facts)


if __name__ == "__main__":
    run_program(train, RecurrentPPOArguments, "recurrent-ppo", __doc__)
