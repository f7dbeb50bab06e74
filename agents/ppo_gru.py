"""Recurrent PPO in plain torch: ``agents/ppo_minimal.py`` with a GRU.

    python agents/ppo_gru.py                                               about three minutes on one core
    python agents/ppo_gru.py --env cutenv/PathCut-v1 --seed 3              another task
    python agents/ppo_gru.py --env cutenv/GentleCutRaw-v1 --control-hz 0   a track, which takes no keyword

It needs cutenv's environment, gymnasium, numpy and torch, and nothing from cutenv.agents.learning.  One observation
does not tell the crack tip; the GRU may keep what earlier ones told.  Actor and critic both see the observation and the
memory, and no more.  The memory is empty where a cut begins.  It is trained by truncated backpropagation through time:
the rollout is divided into chunks, each begins with the memory that the rollout had there, and gradients end at its
start. The standard deviation of the actions is not learned but falls on a schedule, so that at last the mean action,
which is what is evaluated, does without the noise.
What it gets is on the page docs/results/from-scratch.md.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from torch.distributions.normal import Normal

import cutenv  # noqa: F401  registers the environments

HELD_OUT = 2_000_000
"""Seed of the first specimen of the evaluation; those of training are far below."""


@dataclass
class Args:
    """Options of the command line."""

    env: str = "cutenv/GentleCut-v1"  # id of an environment with a native vector environment
    # decisions a second; 0: those of the environment, for the tracks, which have 10 and take no keyword
    control_hz: int = 10
    seed: int = 0
    total_decisions: int = 3_000_000
    num_envs: int = 256
    num_steps: int = 64  # decisions of each environment between updates
    chunk: int = 16  # decisions through which gradients go back; divides num_steps
    hidden_size: int = 64  # numbers in the memory
    num_minibatches: int = 16
    update_epochs: int = 6
    learning_rate: float = 7e-4
    anneal_lr: bool = True
    gamma: float = 1.0  # a cut ends by itself, and its score is the plain sum of the rewards
    gae_lambda: float = 0.95
    clip_coef: float = 0.2
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5
    exploration: float = 0.8  # standard deviation of the actions at the start
    last_exploration: float = 0.1  # the same at the end, to which it falls linearly
    forward: float = 0.0  # mean of the first action, the speed, before anything is learned
    eval_specimens: int = 200  # number of held-out specimens of the evaluation

    @property
    def batch_size(self) -> int:
        """Decisions of an update."""
        return self.num_envs * self.num_steps


def make_env(args: Args, num_envs: int) -> gym.vector.VectorEnv:
    """Make the native vector environment, which resets at an end."""
    rate: dict[str, Any] = {"control_hz": args.control_hz} if args.control_hz else {}
    return gym.make_vec(
        args.env, num_envs=num_envs, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", **rate
    )


def layer_init(layer: nn.Linear, std: float = np.sqrt(2)) -> nn.Linear:
    """Initialise a layer orthogonally, without bias."""
    nn.init.orthogonal_(layer.weight, std)
    nn.init.zeros_(layer.bias)
    return layer


class Agent(nn.Module):
    """GRU, followed by one tanh layer each for actor and critic."""

    def __init__(self, observation_size: int, action_size: int, hidden_size: int) -> None:
        super().__init__()
        self.gru = nn.GRUCell(observation_size, hidden_size)
        for weight in (self.gru.weight_ih, self.gru.weight_hh):
            nn.init.orthogonal_(weight)
        for bias in (self.gru.bias_ih, self.gru.bias_hh):
            nn.init.zeros_(bias)
        self.critic = nn.Sequential(
            layer_init(nn.Linear(observation_size + hidden_size, 64)),
            nn.Tanh(),
            layer_init(nn.Linear(64, 1), std=1.0),
        )
        self.actor_mean = nn.Sequential(
            layer_init(nn.Linear(observation_size + hidden_size, 64)),
            nn.Tanh(),
            layer_init(nn.Linear(64, action_size), std=0.01),
        )
        self.exploration = 1.0  # standard deviation of the actions; training sets it

    def initial_memory(self, count: int) -> torch.Tensor:
        """Return the memory with which a cut begins, shape (count, hidden_size)."""
        return torch.zeros(count, self.gru.hidden_size)

    def remember(
        self, observations: torch.Tensor, memory: torch.Tensor, begun: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the networks' inputs at T decisions, and the last memory.

        Parameters
        ----------
        observations : (T, n, observation_size)
        memory : (n, hidden_size)
            Memory before the first decision.
        begun : (T, n)
            1 where a decision is the first of its cut, which forgets the cut before, 0 elsewhere.
        """
        remembered = []
        for observed, going_on in zip(observations, (1.0 - begun).unsqueeze(2), strict=True):
            memory = self.gru(observed, memory * going_on)
            remembered.append(memory)
        return torch.cat([observations, torch.stack(remembered)], dim=2), memory

    def get_value(self, seen: torch.Tensor) -> torch.Tensor:
        """Return the critic's values, shape (T, n)."""
        value: torch.Tensor = self.critic(seen)
        return value.squeeze(-1)

    def get_action_and_value(
        self, seen: torch.Tensor, actions: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return actions, drawn unless given, their log probabilities and the values."""
        mean = self.actor_mean(seen)
        distribution = Normal(mean, self.exploration)
        if actions is None:
            actions = distribution.sample()
        log_probabilities = distribution.log_prob(actions).sum(-1)
        return actions, log_probabilities, self.get_value(seen)


def new_agent(args: Args, envs: gym.vector.VectorEnv | None = None) -> Agent:
    """Return an untrained agent that fits the environments, seeded."""
    torch.manual_seed(args.seed)
    sized = envs or make_env(args, 1)
    observation_size, action_size = (
        space.shape[0] for space in (sized.single_observation_space, sized.single_action_space)
    )
    if envs is None:
        sized.close()
    agent = Agent(observation_size, action_size, args.hidden_size)
    nn.init.constant_(agent.actor_mean[-1].bias[0], args.forward)
    return agent


def to_env(actions: torch.Tensor) -> np.ndarray:
    """Clip actions to the range of the environment."""
    return actions.numpy().clip(-1.0, 1.0)


def evaluate(agent: Agent, args: Args) -> tuple[float, float]:
    """Return mean return and success of the mean action on held-out specimens."""
    specimens = args.eval_specimens
    envs = make_env(args, specimens)
    observations, _ = envs.reset(seed=HELD_OUT)
    memory, begun = agent.initial_memory(specimens), torch.ones(1, specimens)
    returns, success = np.zeros(specimens), np.zeros(specimens, bool)
    running = np.ones(specimens, bool)
    while running.any():
        with torch.no_grad():
            seen, memory = agent.remember(torch.as_tensor(observations)[None], memory, begun)
            actions = agent.actor_mean(seen[0])
        observations, rewards, terminated, truncated, infos = envs.step(to_env(actions))
        begun = torch.zeros(1, specimens)  # what follows an end is not counted
        returns[running] += rewards[running]
        ended = running & (terminated | truncated)
        if ended.any():
            success[ended] = infos["final_info"]["is_success"][ended]
        running &= ~ended
    envs.close()
    return float(returns.mean()), float(success.mean())


class Sequences(NamedTuple):
    """Chunks of a rollout: tensors (chunk, number of sequences, ...).

    ``memory``, shape (1, number of sequences, hidden_size), is the rollout's before the first decision of each.
    """

    obs: torch.Tensor
    memory: torch.Tensor
    begun: torch.Tensor
    actions: torch.Tensor
    logprobs: torch.Tensor
    advantages: torch.Tensor
    targets: torch.Tensor

    def choose(self, which: np.ndarray) -> Sequences:
        """Return the sequences with these indices."""
        return Sequences(*(kept[:, torch.as_tensor(which)] for kept in self))


class Rollout:
    """Rollout between updates: tensors of shape (num_steps, num_envs, ...).

    ``memories`` are those before each decision, and ``begun`` is 1 where it is the first of its cut.  The next
    decision has the index num_steps in ``obs``, ``memories`` and ``begun``, and begins the following rollout.
    """

    def __init__(self, args: Args, envs: gym.vector.VectorEnv, agent: Agent) -> None:
        steps, count = args.num_steps, args.num_envs
        self.envs, self.agent = envs, agent
        self.obs = torch.zeros(steps + 1, *envs.observation_space.shape)
        self.memories = torch.zeros(steps + 1, count, args.hidden_size)
        self.begun = torch.zeros(steps + 1, count)
        self.actions = torch.zeros(steps, *envs.action_space.shape)
        self.logprobs, self.rewards, self.values = (torch.zeros(steps, count) for _ in range(3))
        self.obs[-1] = torch.as_tensor(envs.reset(seed=1000 * args.seed)[0])
        self.memories[-1], self.begun[-1] = agent.initial_memory(count), 1.0
        self.returns_so_far = np.zeros(count)

    @torch.no_grad()
    def collect(self) -> list[float]:
        """Decide num_steps times in every environment; return ended cuts' returns."""
        finished: list[float] = []
        for kept in (self.obs, self.memories, self.begun):
            kept[0] = kept[-1]
        for t in range(len(self.actions)):
            seen, self.memories[t + 1] = self.agent.remember(
                self.obs[t : t + 1], self.memories[t], self.begun[t : t + 1]
            )
            self.actions[t], self.logprobs[t], self.values[t] = self.agent.get_action_and_value(seen[0])
            observed, rewards, terminated, truncated, _ = self.envs.step(to_env(self.actions[t]))
            done = terminated | truncated
            self.rewards[t] = torch.as_tensor(rewards)
            self.obs[t + 1], self.begun[t + 1] = torch.as_tensor(observed), torch.as_tensor(done)
            self.returns_so_far += rewards
            finished += self.returns_so_far[done].tolist()
            self.returns_so_far[done] = 0.0
        return finished

    @torch.no_grad()
    def advantages(self, args: Args) -> torch.Tensor:
        """Return generalised advantage estimates; ends are never truncations here."""
        seen, _ = self.agent.remember(self.obs[-1:], self.memories[-1], self.begun[-1:])
        following, lastgaelam = self.agent.get_value(seen)[0], torch.zeros(args.num_envs)
        advantages = torch.zeros_like(self.rewards)
        for t in reversed(range(args.num_steps)):
            nonterminal = 1.0 - self.begun[t + 1]
            delta = self.rewards[t] + args.gamma * following * nonterminal - self.values[t]
            advantages[t] = lastgaelam = delta + args.gamma * args.gae_lambda * nonterminal * lastgaelam
            following = self.values[t]
        return advantages

    def sequences(self, args: Args) -> Sequences:
        """Divide the rollout into sequences of ``args.chunk`` decisions."""

        def divided(kept: torch.Tensor) -> torch.Tensor:
            return kept.unflatten(0, (-1, args.chunk)).transpose(0, 1).flatten(1, 2)

        advantages = self.advantages(args)
        obs, memories, begun = (divided(kept[:-1]) for kept in (self.obs, self.memories, self.begun))
        targets = advantages + self.values
        rest = (divided(kept) for kept in (self.actions, self.logprobs, advantages, targets))
        return Sequences(obs, memories[:1], begun, *rest)


def loss_of(agent: Agent, chosen: Sequences, args: Args) -> tuple[torch.Tensor, torch.Tensor]:
    """Return PPO's loss on sequences, and the actions' probability ratios."""
    seen, _ = agent.remember(chosen.obs, chosen.memory[0], chosen.begun)
    _, newlogprob, newvalue = agent.get_action_and_value(seen, chosen.actions)
    ratio = (newlogprob - chosen.logprobs).exp()
    advantages = (chosen.advantages - chosen.advantages.mean()) / (chosen.advantages.std() + 1e-8)
    clipped = ratio.clamp(1.0 - args.clip_coef, 1.0 + args.clip_coef)
    policy_loss = -torch.min(advantages * ratio, advantages * clipped).mean()
    value_loss = 0.5 * ((newvalue - chosen.targets) ** 2).mean()
    return policy_loss + args.vf_coef * value_loss, ratio


def train(
    args: Args,
    verbose: bool = True,
    envs: gym.vector.VectorEnv | None = None,
    watch: Callable[[Agent, int], None] | None = None,
) -> tuple[Agent, list[float]]:
    """Train; return the agent, and each update's mean return.

    Parameters
    ----------
    envs : VectorEnv, optional
        By default those of ``args.env``.
    watch : callable, optional
        Called with the agent and the number of decisions after every update.
    """
    if args.num_steps % args.chunk:
        raise SystemExit(f"--num-steps {args.num_steps} is no multiple of --chunk {args.chunk}.")
    if args.batch_size // args.chunk < args.num_minibatches:
        raise SystemExit(f"--num-minibatches {args.num_minibatches} is more than there are sequences in an update.")
    torch.set_num_threads(1)
    rng = np.random.default_rng(args.seed)
    envs = envs or make_env(args, args.num_envs)
    agent = new_agent(args, envs)
    optimizer = torch.optim.Adam(agent.parameters(), lr=args.learning_rate, eps=1e-5)
    rollout = Rollout(args, envs, agent)

    start, curve = time.time(), []
    num_updates = max(args.total_decisions // args.batch_size, 1)
    for update in range(num_updates):
        done = update / num_updates
        if args.anneal_lr:
            optimizer.param_groups[0]["lr"] = args.learning_rate * (1.0 - done)
        agent.exploration = args.exploration + done * (args.last_exploration - args.exploration)
        finished = rollout.collect()
        if finished:
            curve.append(float(np.mean(finished)))
        sequences = rollout.sequences(args)

        # Update: sequences are shuffled, the decisions within one are not
        for _ in range(args.update_epochs):
            for chosen in np.array_split(rng.permutation(sequences.obs.shape[1]), args.num_minibatches):
                loss, _ = loss_of(agent, sequences.choose(chosen), args)
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), args.max_grad_norm)
                optimizer.step()

        if watch:
            watch(agent, (update + 1) * args.batch_size)
        if verbose and (update % 10 == 9 or update == num_updates - 1):
            decisions = (update + 1) * args.batch_size
            speed = decisions / (time.time() - start)
            latest = f"{curve[-1]:.3f}" if curve else "none has ended"
            print(f"{decisions:9d} decisions, {speed:6.0f} per second, return {latest}", flush=True)
    envs.close()
    return agent, curve


def main() -> None:
    """Read the options, train, and evaluate the untrained and the trained agent."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for field in dataclasses.fields(Args):
        flag = "--" + field.name.replace("_", "-")
        if isinstance(field.default, bool):
            parser.add_argument(flag, action=argparse.BooleanOptionalAction, default=field.default)
        else:
            parser.add_argument(flag, type=type(field.default), default=field.default, help=f"default {field.default}")
    args = Args(**vars(parser.parse_args()))
    before, _ = evaluate(new_agent(args), args)
    agent, _ = train(args)
    after, success = evaluate(agent, args)
    print(f"{args.eval_specimens} held-out specimens: return {before:.3f} untrained, {after:.3f} trained")
    print(f"success {100.0 * success:.0f} %")


if __name__ == "__main__":
    main()
