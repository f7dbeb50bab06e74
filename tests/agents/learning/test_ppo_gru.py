"""PPO with a memory in one file: what it remembers, what it forgets, and that training sees what the rollout saw."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the learner is an extra: pip install 'cutenv[rl]'")

import ppo_gru  # noqa: E402

ARGS = ppo_gru.Args(num_envs=16, num_steps=64, hidden_size=16, seed=1)
NEAR = {"rtol": 0.0, "atol": 1e-5}


@pytest.fixture(scope="module")
def rollout():
    """A rollout of an untrained agent that begins in the midst of cuts, and in which some end."""
    collected = ppo_gru.Rollout(ARGS, ppo_gru.make_env(ARGS, ARGS.num_envs), ppo_gru.new_agent(ARGS))
    for _ in range(5):  # a cut that does not get anywhere ends after 300 decisions
        collected.collect()
    assert collected.begun[1:-1].any()
    assert not collected.begun[0].any()
    return collected


def test_the_memory_is_empty_where_a_cut_begins_and_nowhere_else(rollout):
    agent, began = rollout.agent, rollout.begun[:-1] > 0.0
    obs, memories = rollout.obs[:-1].flatten(0, 1)[None], rollout.memories[:-1].flatten(0, 1)
    empty, nothing_begins = agent.initial_memory(began.numel()), torch.zeros(1, began.numel())
    assert memories[began.flatten()].abs().max() > 0.1  # there was something to forget
    with torch.no_grad():
        (forgotten, kept) = (
            agent.get_value(agent.remember(obs, memory, nothing_begins)[0]).view(began.shape)
            for memory in (empty, memories)
        )
    assert torch.allclose(rollout.values[began], forgotten[began], **NEAR)
    assert torch.allclose(rollout.values[~began], kept[~began], **NEAR)
    assert not torch.allclose(rollout.values[began], kept[began], **NEAR)
    assert not torch.allclose(rollout.values[~began], forgotten[~began], **NEAR)


def test_before_the_first_update_training_finds_the_probabilities_of_the_rollout(rollout):
    sequences = rollout.sequences(ARGS)
    sequences = sequences.choose(np.random.default_rng(0).permutation(sequences.obs.shape[1]))

    def ratio(**changed):
        return ppo_gru.loss_of(rollout.agent, sequences._replace(**changed), ARGS)[1]

    assert sequences.obs.shape == (ARGS.chunk, ARGS.batch_size // ARGS.chunk, 12)
    one = torch.ones(ARGS.chunk, ARGS.batch_size // ARGS.chunk)
    assert torch.allclose(ratio(), one, **NEAR)
    assert not torch.allclose(ratio(memory=torch.zeros_like(sequences.memory)), one, **NEAR)
    assert not torch.allclose(ratio(begun=torch.zeros_like(sequences.begun)), one, **NEAR)


def test_gradients_go_back_to_where_the_sequence_or_the_cut_begins():
    agent, begun = ppo_gru.new_agent(ARGS), torch.zeros(ARGS.chunk, 2)
    begun[5, 1] = 1.0
    obs, memory = torch.randn(ARGS.chunk, 2, 12, requires_grad=True), torch.randn(2, ARGS.hidden_size)
    agent.get_value(agent.remember(obs, memory, begun)[0])[-1].sum().backward()
    reached = obs.grad.abs().sum(2) > 0.0
    assert reached[:, 0].all()
    assert reached[5:, 1].all()
    assert not reached[:5, 1].any()


def test_two_trainings_of_one_seed_are_the_same_and_another_differs():
    args = dataclasses.replace(ARGS, total_decisions=8_000, num_minibatches=4, update_epochs=2)
    (one, curve), (other, again) = (ppo_gru.train(args, verbose=False) for _ in range(2))
    assert curve == again
    assert all(torch.equal(a, b) for a, b in zip(one.parameters(), other.parameters(), strict=True))
    untrained = ppo_gru.new_agent(args)
    assert not any(torch.equal(a, b) for a, b in zip(one.parameters(), untrained.parameters(), strict=True))
    assert ppo_gru.train(dataclasses.replace(args, seed=2), verbose=False)[1] != curve


@pytest.mark.parametrize(
    ("env", "control_hz", "actions"), [("cutenv/PathCut-v1", 10, 3), ("cutenv/GentleCutRaw-v1", 0, 2)]
)
def test_it_reads_the_sizes_of_other_environments(env, control_hz, actions):
    args = ppo_gru.Args(
        env=env, control_hz=control_hz, eval_specimens=2, total_decisions=1, num_envs=4, num_steps=32, num_minibatches=2
    )
    agent, _ = ppo_gru.train(args, verbose=False)
    assert agent.actor_mean[-1].out_features == actions
    returned, success = ppo_gru.evaluate(agent, args)
    assert np.isfinite(returned)
    assert 0.0 <= success <= 1.0


@pytest.mark.parametrize(
    ("wrong", "told"),
    [
        ({"num_steps": 60}, "--num-steps 60 is no multiple of --chunk 16"),
        ({"num_envs": 2}, "--num-minibatches 16 is more than there are sequences"),
    ],
)
def test_a_rollout_that_cannot_be_divided_is_refused(wrong, told):
    with pytest.raises(SystemExit, match=told):
        ppo_gru.train(ppo_gru.Args(**wrong))
