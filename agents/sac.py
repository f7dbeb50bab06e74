"""SAC from parts of the package: off-policy, with scripted replays.

    python agents/sac.py                            some four minutes; writes runs/<name>/policy/
    python agents/sac.py --timesteps 30000 --name mine

``cutenv train --learner sac`` makes the same policy, with --resume, --quick, an evaluation and a report; the comments
in ppo.py apply here too.
"""

from __future__ import annotations

from pathlib import Path

import torch
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import NStepReplayBuffer

from cutenv.agents.learning.arguments import SACArguments
from cutenv.agents.learning.asymmetric_actors import AsymmetricSACPolicy
from cutenv.agents.learning.cloning import script_demonstrations
from cutenv.agents.learning.off_policy import imitate, network, remember
from cutenv.agents.learning.on_policy import FallingRate
from cutenv.agents.learning.progress import Progress
from cutenv.agents.learning.run_folder import export, record_run, run_program


def train(arguments: SACArguments, run: Path) -> None:
    """Train an agent, and write its actor into ``run``/policy."""
    torch.set_num_threads(1)
    facts = record_run(arguments, run, "SAC")
    environments = arguments.training_environments()
    layers = {"pi": [arguments.hidden] * 2, "qf": [arguments.critic_hidden] * 2}
    model = SAC(
        AsymmetricSACPolicy,
        environments,
        learning_rate=FallingRate(arguments.learning_rate),
        learning_starts=0,
        train_freq=arguments.train_freq,
        gradient_steps=arguments.gradient_steps,
        batch_size=arguments.batch_size,
        buffer_size=arguments.buffer_size,
        gamma=arguments.gamma,
        replay_buffer_class=NStepReplayBuffer,
        replay_buffer_kwargs={"n_steps": arguments.n_steps, "gamma": arguments.gamma},
        tau=arguments.tau,
        ent_coef=arguments.ent_coef,
        target_entropy=arguments.target_entropy,
        policy_kwargs=arguments.sizes | {"exploration": arguments.exploration, "net_arch": layers},
        seed=arguments.seed,
        device="cpu",
    )

    # The replay buffer begins with what a script does, and the actor as a clone of the script.
    if arguments.demonstrations:
        shown = script_demonstrations(environments, arguments)
        remember(model, shown)
        imitate(model.policy, shown, arguments)

    # Progress lets only the critics learn at first, averages the actor, and keeps in policy.zip the best average.
    progress = Progress(run, arguments, curve=[])
    model.learn(arguments.timesteps, callback=progress)
    progress.validate()

    best = SAC.load(run / "policy.zip", device="cpu").policy.state_dict()
    weights = {name: values.numpy() for name, values in best.items()}
    export(arguments, run / "policy", network(weights, "relu"), facts)


if __name__ == "__main__":
    run_program(train, SACArguments, "sac", __doc__)
