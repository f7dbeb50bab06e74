"""PPO in one readable file of plain torch, like CleanRL.

    python agents/ppo_minimal.py                          about two minutes on one core
    python agents/ppo_minimal.py --total-decisions 200000 --seed 3

It needs cutenv's environment, gymnasium, numpy and torch, and nothing from cutenv.agents.learning.  It sees the 12
numbers of the observation and learns by trial alone: no features, no demonstrations, and a critic that sees no more
than the actor.  Doing nothing earns -0.1.  What learners get from these numbers is on the page
docs/results/from-scratch.md. The agent of ``cutenv train`` has all of these: its demonstrations alone bring it to
0.75.
"""

from __future__ import annotations

import argparse
import dataclasses
import time
from collections.abc import Callable
from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import torch
from torch import nn
from torch.distributions.normal import Normal

import cutenv  # noqa: F401  registers the environment

HELD_OUT = 2_000_000
"""Seed of the first specimen of the evaluation; those of training are far below."""


@dataclass
class Args:
    """Options of the command line."""

    seed: int = 0
    total_decisions: int = 1_500_000
    num_envs: int = 64
    num_steps: int = 256  # decisions of each environment between updates
    num_minibatches: int = 16
    update_epochs: int = 8
    learning_rate: float = 3e-4
    anneal_lr: bool = False
    gamma: float = 1.0  # a cut ends by itself, and its score is the plain sum of the rewards
    gae_lambda: float = 0.95
    clip_coef: float = 0.2
    ent_coef: float = 0.0
    vf_coef: float = 0.5
    max_grad_norm: float = 0.5
    log_std: float = 0.0  # logarithm of the standard deviation of the actions at the start
    eval_specimens: int = 200  # number of held-out specimens of the evaluation

    @property
    def batch_size(self) -> int:
        """Decisions of an update."""
        return self.num_envs * self.num_steps


def make_env(num_envs: int) -> gym.vector.VectorEnv:
    """Make the native vector environment, 10 decisions a second.

    It resets within the step of an end.
    """
    return gym.make_vec("cutenv/GentleCut-v1", num_envs=num_envs, autoreset_mode="SameStep", control_hz=10)


def layer_init(layer: nn.Linear, std: float = np.sqrt(2)) -> nn.Linear:
    """Initialise a layer orthogonally, without bias."""
    nn.init.orthogonal_(layer.weight, std)
    nn.init.zeros_(layer.bias)
    return layer


class Agent(nn.Module):
    """Two networks of two tanh layers: actor and critic."""

    def __init__(self, observation_size: int, action_size: int, log_std: float) -> None:
        super().__init__()
        self.critic = nn.Sequential(
            layer_init(nn.Linear(observation_size, 64)),
            nn.Tanh(),
            layer_init(nn.Linear(64, 64)),
            nn.Tanh(),
            layer_init(nn.Linear(64, 1), std=1.0),
        )
        self.actor_mean = nn.Sequential(
            layer_init(nn.Linear(observation_size, 64)),
            nn.Tanh(),
            layer_init(nn.Linear(64, 64)),
            nn.Tanh(),
            layer_init(nn.Linear(64, action_size), std=0.01),
        )
        self.actor_logstd = nn.Parameter(torch.full((1, action_size), log_std))

    def get_value(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the critic's values, shape (n,)."""
        return self.critic(observations).flatten()

    def get_action_and_value(
        self, observations: torch.Tensor, actions: torch.Tensor | None = None
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return actions, drawn unless given, log probabilities, entropies and values."""
        mean = self.actor_mean(observations)
        distribution = Normal(mean, self.actor_logstd.exp().expand_as(mean))
        if actions is None:
            actions = distribution.sample()
        log_probabilities = distribution.log_prob(actions).sum(1)
        return actions, log_probabilities, distribution.entropy().sum(1), self.get_value(observations)


def to_env(actions: torch.Tensor) -> np.ndarray:
    """Clip actions to the range of the environment."""
    return actions.numpy().clip(-1.0, 1.0)


def evaluate(agent: Agent, specimens: int) -> tuple[float, float]:
    """Return mean return and success of the mean action on held-out specimens."""
    envs = make_env(specimens)
    observations, _ = envs.reset(seed=HELD_OUT)
    returns, success = np.zeros(specimens), np.zeros(specimens, bool)
    running = np.ones(specimens, bool)
    while running.any():
        with torch.no_grad():
            actions = agent.actor_mean(torch.as_tensor(observations))
        observations, rewards, terminated, truncated, infos = envs.step(to_env(actions))
        returns[running] += rewards[running]
        ended = running & (terminated | truncated)
        if ended.any():
            success[ended] = infos["final_info"]["is_success"][ended]
        running &= ~ended
    envs.close()
    return float(returns.mean()), float(success.mean())


def train(
    args: Args, verbose: bool = True, make: Callable[[int], gym.vector.VectorEnv] = make_env
) -> tuple[Agent, list[float]]:
    """Train on environments from ``make``; return agent and mean returns."""
    torch.manual_seed(args.seed)
    torch.set_num_threads(1)
    rng = np.random.default_rng(args.seed)
    envs = make(args.num_envs)
    agent = Agent(envs.single_observation_space.shape[0], envs.single_action_space.shape[0], args.log_std)
    optimizer = torch.optim.Adam(agent.parameters(), lr=args.learning_rate, eps=1e-5)

    # Storage
    shape = (args.num_steps, args.num_envs)
    obs = torch.zeros((*shape, *envs.single_observation_space.shape))
    actions = torch.zeros((*shape, *envs.single_action_space.shape))
    logprobs, rewards, dones, values = (torch.zeros(shape) for _ in range(4))

    start = time.time()
    first, _ = envs.reset(seed=1000 * args.seed)
    next_obs, next_done = torch.as_tensor(first).clone(), torch.zeros(args.num_envs)
    returns_so_far, curve = np.zeros(args.num_envs), []
    num_updates = max(args.total_decisions // args.batch_size, 1)
    for update in range(num_updates):
        if args.anneal_lr:
            optimizer.param_groups[0]["lr"] = args.learning_rate * (1.0 - update / num_updates)

        # Rollout
        finished = []
        for step in range(args.num_steps):
            obs[step], dones[step] = next_obs, next_done
            with torch.no_grad():
                actions[step], logprobs[step], _, values[step] = agent.get_action_and_value(next_obs)
            observed, reward, terminated, truncated, _ = envs.step(to_env(actions[step]))
            done = terminated | truncated
            rewards[step] = torch.as_tensor(reward)
            next_obs, next_done = torch.as_tensor(observed).clone(), torch.as_tensor(done, dtype=torch.float32)
            returns_so_far += reward
            finished += returns_so_far[done].tolist()
            returns_so_far[done] = 0.0
        if finished:
            curve.append(float(np.mean(finished)))

        # Generalised advantage estimate; an end is never a truncation here
        with torch.no_grad():
            next_value = agent.get_value(next_obs)
            advantages = torch.zeros_like(rewards)
            lastgaelam = torch.zeros(args.num_envs)
            for t in reversed(range(args.num_steps)):
                nonterminal = 1.0 - (next_done if t == args.num_steps - 1 else dones[t + 1])
                following = next_value if t == args.num_steps - 1 else values[t + 1]
                delta = rewards[t] + args.gamma * following * nonterminal - values[t]
                advantages[t] = lastgaelam = delta + args.gamma * args.gae_lambda * nonterminal * lastgaelam
            targets = advantages + values

        # Update
        b_obs, b_actions = obs.flatten(0, 1), actions.flatten(0, 1)
        b_logprobs, b_advantages, b_targets = logprobs.flatten(), advantages.flatten(), targets.flatten()
        for _ in range(args.update_epochs):
            for chosen in np.array_split(rng.permutation(args.batch_size), args.num_minibatches):
                mb = torch.as_tensor(chosen)
                _, newlogprob, entropy, newvalue = agent.get_action_and_value(b_obs[mb], b_actions[mb])
                ratio = (newlogprob - b_logprobs[mb]).exp()
                mb_advantages = b_advantages[mb]
                mb_advantages = (mb_advantages - mb_advantages.mean()) / (mb_advantages.std() + 1e-8)
                clipped = ratio.clamp(1.0 - args.clip_coef, 1.0 + args.clip_coef)
                policy_loss = -torch.min(mb_advantages * ratio, mb_advantages * clipped).mean()
                value_loss = 0.5 * ((newvalue - b_targets[mb]) ** 2).mean()
                loss = policy_loss - args.ent_coef * entropy.mean() + args.vf_coef * value_loss
                optimizer.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(agent.parameters(), args.max_grad_norm)
                optimizer.step()

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
    torch.manual_seed(args.seed)
    before, _ = evaluate(Agent(12, 2, args.log_std), args.eval_specimens)
    agent, _ = train(args)
    after, success = evaluate(agent, args.eval_specimens)
    print(f"{args.eval_specimens} held-out specimens: return {before:.3f} untrained, {after:.3f} trained")
    print(f"success {100.0 * success:.0f} %")


if __name__ == "__main__":
    main()
