"""PPO from parts of the package, from environments to policy.

    python agents/ppo.py                            some ten minutes; writes runs/<name>/policy/
    python agents/ppo.py --timesteps 400000 --name mine
    cutenv evaluate runs/mine/policy "return stroke"

``cutenv train`` does the same, with --resume, --quick, an evaluation with every baseline and a report; with the same
options both make the same policy, bit for bit.  The options are explained in ``cutenv/agents/learning/arguments.py``.
"""

from __future__ import annotations

from pathlib import Path

import torch
from stable_baselines3 import PPO

from cutenv.agents.learning.arguments import PPOArguments
from cutenv.agents.learning.asymmetric_actors import AsymmetricActorCritic
from cutenv.agents.learning.cloning import Cloning, script_demonstrations
from cutenv.agents.learning.on_policy import FallingRate
from cutenv.agents.learning.progress import Progress
from cutenv.agents.learning.run_folder import export, record_run, run_program
from cutenv.agents.policy import Network


def train(arguments: PPOArguments, run: Path) -> None:
    """Train an agent, and write its actor into ``run``/policy."""
    torch.set_num_threads(1)
    facts = record_run(arguments, run, "PPO")

    # A thousand cuts at once (a FeatureVecEnv of cutenv.agents.sb3).  The actor sees features of the observations; the
    # hidden state after them is for the critic alone.
    environments = arguments.training_environments()
    model = PPO(
        AsymmetricActorCritic,
        environments,
        learning_rate=FallingRate(arguments.learning_rate),
        n_steps=arguments.rollout,
        batch_size=arguments.batch_size,
        n_epochs=arguments.epochs,
        gamma=arguments.gamma,
        gae_lambda=arguments.gae_lambda,
        policy_kwargs=arguments.sizes,
        seed=arguments.seed,
        device="cpu",
    )

    # The actor first imitates a script, or else begins as one whose actions it is to correct (--base script).
    if arguments.demonstrations:
        shown = script_demonstrations(environments, arguments)
        actor = model.policy
        Cloning(actor.action_for, actor.actor_parameters(), shown.by_decision(), seed=arguments.seed).run()

    # Then it learns by trial.  Progress sets the exploration, trains only the critic at first, averages the actor, and
    # keeps in policy.zip the average that does best on validation specimens.
    progress = Progress(run, arguments, curve=[])
    model.learn(arguments.timesteps, callback=progress)
    progress.validate()

    # The exported policy needs no torch: the actor's weights in safetensors, and a card.
    best = PPO.load(run / "policy.zip", device="cpu").policy.state_dict()
    weights = {name: values.numpy() for name, values in best.items()}
    export(arguments, run / "policy", Network.from_state_dict(weights, "tanh"), facts)


if __name__ == "__main__":
    run_program(train, PPOArguments, "ppo", __doc__)
