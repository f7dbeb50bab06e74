"""A policy that remembers: NumPy does what sb3-contrib does, cut after cut, and its folder is read back exactly."""

from __future__ import annotations

import json

import gymnasium
import numpy as np
import pytest
from kept_policy import ABOUT, SIZE, network

from cutenv.agents.policy import RecurrentNetwork, TrainedPolicy, save_policy
from cutenv.agents.policy.trained import CARD, PolicyCard
from cutenv.task.observation import COMPONENTS

pytest.importorskip("safetensors", reason="policies are kept with an extra: pip install 'cutenv[rl]'")

UNITS = 7


def remembering(seed: int = 0, **changes) -> RecurrentNetwork:
    rng = np.random.default_rng(seed)
    parts = {
        name: rng.normal(size=shape, scale=0.5).astype(np.float32)
        for name, shape in {
            "weight_ih": (4 * UNITS, SIZE),
            "weight_hh": (4 * UNITS, UNITS),
            "bias_ih": (4 * UNITS,),
            "bias_hh": (4 * UNITS,),
        }.items()
    }
    return RecurrentNetwork(**(parts | {"head": network(seed, (UNITS, 5, 2))} | changes))


def observations(decisions: int, cuts: int) -> np.ndarray:
    rng = np.random.default_rng(1)
    return rng.uniform(-1.0, 1.0, (decisions, cuts, len(COMPONENTS))).astype(np.float32)


@pytest.fixture(scope="module")
def learner():
    """An agent of sb3-contrib whose actions fill the range."""
    pytest.importorskip("sb3_contrib", reason="the learner is an extra: pip install 'cutenv[rl]'")
    import torch
    from sb3_contrib import RecurrentPPO

    from cutenv.agents.learning.asymmetric_actors import RecurrentAsymmetricActorCritic

    env = gymnasium.Env()
    env.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (SIZE + 10,), np.float32)
    env.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    sizes = {"features": SIZE, "critic": SIZE + 10, "hidden": 16}
    model = RecurrentPPO(RecurrentAsymmetricActorCritic, env, policy_kwargs=sizes, seed=0, device="cpu")
    with torch.no_grad():
        for name, values in model.policy.named_parameters():
            if name.endswith("bias"):
                values.normal_(0.0, 0.3)
        model.policy.action_net.weight.mul_(100.0)
    return model


def along(learner, own: RecurrentNetwork) -> float:
    """Largest difference of the actions over 40 decisions in 6 cuts, some of which begin anew on the way."""
    rng = np.random.default_rng(0)
    memory, state, worst, actions = None, own.start(6), 0.0, []
    for decision in range(40):
        seen = rng.uniform(-2.0, 2.0, (6, SIZE + 10)).astype(np.float32)
        begun = rng.random(6) < (1.0 if decision == 0 else 0.1)
        theirs, memory = learner.predict(seen, state=memory, episode_start=begun, deterministic=True)
        for values in state:
            values[begun] = 0.0
        ours, state = own(seen[:, :SIZE], state)
        worst = max(worst, float(np.abs(np.clip(ours, -1.0, 1.0) - theirs).max()))
        actions.append(theirs)
    assert np.mean(np.abs(actions) < 0.99) > 0.3, "actions at the limit would prove nothing"
    assert np.std(actions, axis=(0, 1)).min() > 0.1, "nor would actions that are always the same"
    return worst


def exported(learner) -> RecurrentNetwork:
    arrays = {name: values.numpy() for name, values in learner.policy.state_dict().items()}
    return RecurrentNetwork.from_state_dict(arrays, "tanh")


def test_the_network_acts_as_the_learner_does_over_cuts_that_begin_anew(learner):
    assert exported(learner).sizes == (SIZE, 16, 16, 2)
    assert along(learner, exported(learner)) < 1e-5


def test_learning_sees_a_sequence_as_it_was_walked_through(learner):
    """Whole sequences at once, as gradients need them, give what single steps gave."""
    import torch

    policy, steps = learner.policy, 12
    seen = torch.randn(3, steps, SIZE + 10, generator=torch.Generator().manual_seed(0))
    begins = torch.zeros(3, steps)
    begins[:, 0] = 1.0
    with torch.no_grad():
        state = (torch.randn(1, 3, 16), torch.randn(1, 3, 16))
        whole, _ = policy._process_sequence(
            seen[..., :SIZE].reshape(-1, SIZE), state, begins.flatten(), policy.lstm_actor
        )
        single = []
        for k in range(steps):
            latent, state = policy._process_sequence(seen[:, k, :SIZE], state, begins[:, k], policy.lstm_actor)
            single.append(latent)
    assert torch.allclose(whole.reshape(3, steps, -1), torch.stack(single, dim=1), atol=1e-6)


def test_the_actor_never_sees_what_the_critic_sees(learner):
    import torch

    seen = np.zeros((2, SIZE + 10), np.float32)
    seen[1, SIZE:] = 3.0
    actions, _ = learner.predict(seen, deterministic=True)
    assert (actions[0] == actions[1]).all()
    nothing = (torch.zeros(1, 2, 16), torch.zeros(1, 2, 16))
    with torch.no_grad():
        values = learner.policy.predict_values(torch.as_tensor(seen), nothing, torch.ones(2))
    assert values[0] != values[1]


def test_a_folder_is_read_back_exactly_and_its_card_names_the_memory(tmp_path):
    card = save_policy(tmp_path / "policy", remembering(), **ABOUT)
    policy = TrainedPolicy.load(tmp_path / "policy")
    assert policy.card == card
    assert (card.memory, card.layers) == ("lstm", (SIZE, UNITS, 5, 2))
    original, seen = TrainedPolicy(card, remembering()), observations(20, 1)[:, 0]
    for one in (policy, original):
        one.reset(np.random.default_rng(0))
    assert all((policy(observation) == original(observation)).all() for observation in seen)


def test_a_cut_is_forgotten_with_a_reset_and_remembered_without(tmp_path):
    policy = TrainedPolicy(save_policy(tmp_path / "policy", remembering(), **ABOUT), remembering())
    seen = observations(5, 1)[:, 0]
    policy.reset(np.random.default_rng(0))
    first = [policy(observation) for observation in seen]
    on = policy(seen[0])
    policy.reset(np.random.default_rng(0))
    assert all((policy(observation) == action).all() for observation, action in zip(seen, first, strict=True))
    assert (on != first[0]).any()


def test_a_card_from_before_there_was_a_memory_is_one_without(tmp_path):
    card = save_policy(tmp_path / "policy", network(sizes=(SIZE, 4, 2)), **ABOUT)
    written = json.loads((tmp_path / "policy" / CARD).read_text())
    assert "memory" not in written
    assert PolicyCard.from_json(json.dumps(written)).memory is None
    assert card.memory is None


def test_a_card_that_belongs_to_the_other_kind_of_network_is_refused(tmp_path):
    card = save_policy(tmp_path / "policy", remembering(), **ABOUT)
    with pytest.raises(ValueError, match="memory is 'lstm', but the network has none"):
        TrainedPolicy(card, network(sizes=card.layers))


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"weight_hh": np.zeros((4 * UNITS, 6), np.float32)}, "four times as many rows as columns"),
        ({"bias_ih": np.zeros(3, np.float32)}, r"memory.bias_ih has shape \(3,\); 7 units need 28 rows"),
        ({"weight_ih": np.full((4 * UNITS, SIZE), np.nan, np.float32)}, "memory.weight_ih holds .* NaN"),
        ({"bias_hh": np.zeros(4 * UNITS)}, "memory.bias_hh is float64"),
        ({"head": network(sizes=(6, 2))}, "layer_0.weight takes 6 numbers, but the memory has 7 units"),
    ],
)
def test_weights_that_make_no_memory_are_refused_by_name(change, found):
    with pytest.raises(ValueError, match=found):
        remembering(**change)


def test_a_missing_array_is_named():
    arrays = remembering().to_arrays()
    del arrays["memory.bias_hh"]
    with pytest.raises(ValueError, match=r"'memory.bias_hh' is missing"):
        RecurrentNetwork.from_arrays(arrays, "tanh")


# Many cuts side by side.


@pytest.mark.parametrize("own", [network(sizes=(SIZE, 16, 2)), remembering()], ids=["dense", "remembering"])
def test_a_batch_acts_bit_for_bit_as_single_policies_do_also_when_a_cut_begins_anew(own, tmp_path):
    policy = TrainedPolicy(save_policy(tmp_path / "policy", own, **ABOUT), own)
    seen = observations(30, 5)
    policy.begin([np.random.default_rng(0)] * 5)
    together = []
    for decision in range(30):
        if decision == 11:
            policy.forget(np.array([2]))
        together.append(policy.act(seen[decision]))
    for cut in range(5):
        policy.reset(np.random.default_rng(0))
        for decision in range(30):
            if cut == 2 and decision == 11:
                policy.reset(np.random.default_rng(0))
            assert (policy(seen[decision, cut]) == together[decision][cut]).all()
