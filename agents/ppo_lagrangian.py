"""PPO with a Lagrange multiplier: highest return within SafeCut-v1's budget.

    python agents/ppo_lagrangian.py                 some ten minutes; writes runs/<name>/policy/
    python agents/ppo_lagrangian.py --timesteps 1000000 --name careful
    python -m scripts.benchmarks.policies.safe_cut runs/careful/policy  its cost and return beside those of scripts

It is ppo.py but for the cost.  It first imitates a careful return stroke, which gives up wherever the crack
would run beyond the target, and begins with a price lambda of the cost.  It learns from (reward - lambda cost) /
(1 + lambda).  After every rollout lambda rises in proportion to the mean cost of the cuts that ended in it, less the
budget, and falls where that is negative (dual ascent); lambda is never below 0.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from cutenv.agents.learning.arguments import BadArguments, PPOArguments
from cutenv.agents.learning.asymmetric_actors import AsymmetricActorCritic
from cutenv.agents.learning.cloning import Cloning, demonstrations
from cutenv.agents.learning.on_policy import sb3_keywords
from cutenv.agents.learning.option_fields import option
from cutenv.agents.learning.progress import Progress
from cutenv.agents.learning.run_folder import export, record_run, run_program
from cutenv.agents.policy import Network, OneReturnStroke
from cutenv.agents.sb3 import FeatureVecEnv
from cutenv.envs.tracks import COST_BUDGET_MM


@dataclass(frozen=True, kw_only=True)
class LagrangianArguments(PPOArguments):
    """Options of PPO with a Lagrange multiplier."""

    budget: float = option(COST_BUDGET_MM, "budget for the mean cost of a cut [mm]", (0.0, 1e3))
    multiplier: float = option(0.05, "first multiplier: price of a mm of cost, in units of return", (0.0, 1e3))
    multiplier_rate: float = option(
        0.005, "rise of the multiplier after a rollout, per mm of mean cost above the budget", (0.0, 1e3)
    )
    beyond: float = option(
        0.0, "run beyond the target at which the teacher, a return stroke, gives up [m]", (-0.05, 0.05)
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rigs != 1:
            raise BadArguments(f"--rigs {self.rigs} has no effect here: SafeCut-v1 has one rig; leave it out")


class PenalisedVecEnv(FeatureVecEnv):
    """Environments with reward (reward - multiplier cost) / (1 + multiplier).

    The infos have both apart.
    """

    multiplier = 0.0
    """Price of a millimetre of cost, in units of return."""

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Return observations, penalised rewards, ends and infos."""
        shown, rewards, ended, infos = super().step_wait()
        costs = np.array([info["cost"] for info in infos], np.float32)
        return shown, (rewards - self.multiplier * costs) / (1.0 + self.multiplier), ended, infos


class DualAscent(BaseCallback):
    """Callback that updates the multiplier by a rollout's mean cost."""

    def __init__(self, environments: PenalisedVecEnv, budget: float, rate: float) -> None:
        super().__init__()
        self._environments, self._budget, self._rate = environments, budget, rate
        self._costs: list[float] = []

    def _on_step(self) -> bool:
        self._costs += [info["episode"]["cost"] for info in self.locals["infos"] if "episode" in info]
        return True

    def _on_rollout_end(self) -> None:
        if self._costs:
            excess = float(np.mean(self._costs)) - self._budget
            self._environments.multiplier = max(self._environments.multiplier + self._rate * excess, 0.0)
            self.logger.record("rollout/mean_cost", float(np.mean(self._costs)))
            self.logger.record("rollout/multiplier", self._environments.multiplier)
        self._costs.clear()


def train(arguments: LagrangianArguments, run: Path) -> None:
    """Train an agent, and write its actor into ``run``/policy."""
    torch.set_num_threads(1)
    facts = record_run(arguments, run, "PPO-Lagrangian")
    environments = PenalisedVecEnv(
        arguments.training_seeds, hidden_state=True, **arguments.features, **arguments.environment
    )
    model = PPO(AsymmetricActorCritic, environments, **sb3_keywords(arguments))
    if arguments.demonstrations:
        shown = demonstrations(
            environments,
            lambda: OneReturnStroke(beyond=arguments.beyond),
            decisions=arguments.demonstrations,
            noise=arguments.demonstration_noise,
            seed=arguments.seed,
        )
        actor: Any = model.policy
        Cloning(actor.action_for, actor.actor_parameters(), shown.by_decision(), seed=arguments.seed).run()

    environments.multiplier = arguments.multiplier
    # The multiplier's callback comes first: what Progress does at the end of a rollout may end the training.
    progress = Progress(run, arguments, curve=[])
    ascent = DualAscent(environments, arguments.budget, arguments.multiplier_rate)
    model.learn(arguments.timesteps, callback=[ascent, progress])
    print(f"multiplier at the end: {environments.multiplier:.4f} per mm")

    # The running average of the end, not the best by validation: the best return alone would be the least careful.
    with progress.averaged():
        weights = {name: values.numpy().copy() for name, values in model.policy.state_dict().items()}
    export(arguments, run / "policy", Network.from_state_dict(weights, "tanh"), facts)


if __name__ == "__main__":
    run_program(train, LagrangianArguments, "ppo-lagrangian", __doc__)
