"""Implicit Q-learning.

Learn from the cuts of scripts, or of a Minari data set, to do better than they do on average.

Kostrikov, Nair and Levine, "Offline reinforcement learning with implicit Q-learning", ICLR 2022 (arXiv:2110.06169).
The value of a state is an expectile of the values of the actions that the data contain, so that no action is ever
valued that nobody took; the actor imitates every action with a weight that grows with its advantage.  The critics see
the hidden state where the data contain it, as cuts in the simulator do.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from cutenv.agents.learning import bc
from cutenv.agents.learning.arguments import BadArguments, IQLArguments
from cutenv.agents.learning.cloning import Batch, DecisionDataset, EpochFit, FitNumbers, Transitions, demonstrations
from cutenv.agents.learning.minari_datasets import cloning_data, opened
from cutenv.agents.learning.run_folder import RunRequest
from cutenv.agents.policy import BASELINES

if TYPE_CHECKING:
    from minari import MinariDataset

_HEAVIEST = 100.0  # largest weight of an action, as in the paper


def _layers(inputs: int, hidden: int) -> torch.nn.Sequential:
    return torch.nn.Sequential(
        torch.nn.Linear(inputs, hidden),
        torch.nn.ReLU(),
        torch.nn.Linear(hidden, hidden),
        torch.nn.ReLU(),
        torch.nn.Linear(hidden, 1),
    )


class Agent(bc.Clone):
    """Actor, value of states, and two critics with their targets.

    ``inputs`` is the size of the data's observations.
    """

    def __init__(self, arguments: IQLArguments, inputs: int) -> None:
        super().__init__(arguments)
        self.value = _layers(inputs, arguments.hidden)
        self.critics, self.targets = (
            torch.nn.ModuleList(_layers(inputs + 2, arguments.hidden) for _ in range(2)) for _ in range(2)
        )
        self.targets.load_state_dict(self.critics.state_dict())
        self.module = torch.nn.ModuleDict(
            {"actor": self.actor, "value": self.value, "critics": self.critics, "targets": self.targets}
        )


class ImplicitQLearning(EpochFit):
    """Fit of an agent to transitions."""

    def __init__(self, agent: Agent, data: Transitions, arguments: IQLArguments) -> None:
        self._agent, self._arguments = agent, arguments
        self._decisions = DecisionDataset(*data)
        learned = (agent.actor, agent.value, agent.critics)
        super().__init__(
            [parameter for part in learned for parameter in part.parameters()],
            self._decisions,
            FitNumbers(arguments.epochs, arguments.batch_size, arguments.learning_rate, arguments.seed),
        )

    def stepped(self) -> None:
        """Let the targets follow the critics."""
        with torch.no_grad():
            for target, own in zip(self._agent.targets.parameters(), self._agent.critics.parameters(), strict=True):
                target.lerp_(own, self._arguments.tau)

    def loss(self, batch: Batch) -> torch.Tensor:
        """Return the sum of the losses, each of another network."""
        (seen, actions, rewards, following, ends), a, agent = batch, self._arguments, self._agent
        both = torch.cat((seen, actions), dim=1)
        with torch.no_grad():
            least = torch.min(*(target(both)[:, 0] for target in agent.targets))
            wanted = rewards + a.gamma * torch.where(ends, 0.0, agent.value(following)[:, 0])
        advantage = least - agent.value(seen)[:, 0]
        weight = torch.where(advantage > 0.0, a.expectile, 1.0 - a.expectile)
        value_loss = (weight * advantage**2).mean()  # equation 5
        critic_loss = sum(((critic(both)[:, 0] - wanted) ** 2).mean() for critic in agent.critics)  # equation 6
        liked = torch.exp(a.temperature * advantage.detach()).clamp(max=_HEAVIEST)
        actor_loss = (liked * ((agent(seen) - actions) ** 2).mean(-1)).mean()  # equation 7
        loss: torch.Tensor = value_loss + critic_loss + actor_loss
        return loss

    def error(self) -> float:
        """Return the root mean square error of the actor's actions."""
        seen, actions, *_ = self._decisions.parts
        with torch.no_grad():
            return float(((self._agent(seen) - actions) ** 2).mean().sqrt())


def transitions(dataset: MinariDataset, features: Mapping[str, Any]) -> Transitions:
    """Return all decisions of a data set with their outcomes.

    ``features`` are the keyword arguments of Features.
    """
    observations, actions = cloning_data(dataset, **features)
    rewards = [cut.rewards for cut in dataset.iterate_episodes()]
    ends = np.zeros(len(observations), bool)
    ends[np.cumsum([len(own) for own in rewards]) - 1] = True
    following = np.roll(observations, -1, axis=0)
    return Transitions(observations, actions, np.concatenate(rewards).astype(np.float32), following, ends)


def transition_data(arguments: IQLArguments) -> tuple[Transitions, dict[str, Any]]:
    """Return the decisions to learn from, and facts for the card.

    Raises BadArguments if the data set does not fit the options.
    """
    if arguments.dataset:
        _, facts = bc.training_data(arguments)  # refuses a data set that has changed
        try:
            return transitions(opened(arguments.dataset), arguments.features), facts
        except ValueError as error:
            raise BadArguments(f"--dataset: {error}") from None
    seeds = arguments.training_seeds
    middle = max(len(seeds) // 2, 1)
    shown = [
        demonstrations(
            arguments.environments_at(own),
            BASELINES[script],
            decisions=arguments.demonstrations // 2,
            noise=arguments.demonstration_noise,
            seed=arguments.seed,
        ).transitions()
        for script, own in ((arguments.script, seeds[:middle]), (arguments.other_script, seeds[middle:] or seeds))
    ]
    both = Transitions(*map(np.concatenate, zip(*shown, strict=True)))
    facts = {"script": f"{arguments.script}, {arguments.other_script}", "cuts": int(both.ends.sum())}
    return both, {**facts, "decisions": arguments.demonstrations}


def train(request: RunRequest[IQLArguments], facts: dict[str, Any]) -> None:
    """Fit the agent; write the files that :func:`cutenv.agents.learning.bc.train` writes."""
    begun, arguments = time.monotonic(), request.arguments
    data, facts["taught_by"] = transition_data(arguments)
    agent = Agent(arguments, data.observations.shape[1])
    bc.fit(agent, ImplicitQLearning(agent, data, arguments), request, facts, begun)


def run_learner(request: RunRequest[IQLArguments], resume_command: str) -> None:
    """Fit, evaluate and report into the run's folder.

    See :func:`cutenv.agents.learning.on_policy.run_learner`.
    """
    bc.run_learner(request, resume_command, "IQL", train)
