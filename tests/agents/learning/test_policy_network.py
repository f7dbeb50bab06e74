"""What a learner's actor does, the network of a policy does."""

from __future__ import annotations

import itertools

import gymnasium
import numpy as np
import pytest
from kept_policy import ABOUT, SIZE

from cutenv.agents.policy.actor_network import Network
from cutenv.agents.policy.trained import TrainedPolicy, save_policy
from cutenv.task.observation import CLIP

pytest.importorskip("safetensors", reason="policies are kept with an extra: pip install 'cutenv[rl]'")


def spaces() -> gymnasium.Env:
    """What PPO must know of an environment to build its networks, and no more."""
    env = gymnasium.Env()
    env.observation_space = gymnasium.spaces.Box(-CLIP, CLIP, (SIZE,), np.float32)
    env.action_space = gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    return env


@pytest.fixture(scope="module", params=["tanh", "relu"])
def learner(request: pytest.FixtureRequest):
    """A PPO agent of Stable-Baselines3 whose actions fill the range, and its activation."""
    sb3 = pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")
    import torch

    kind = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}[request.param]
    model = sb3.PPO(
        "MlpPolicy", spaces(), policy_kwargs={"net_arch": [64, 64], "activation_fn": kind}, seed=0, device="cpu"
    )
    with torch.no_grad():  # as built, biases are zero and actions a hundred times smaller
        for name, values in model.policy.named_parameters():
            if name.endswith("bias"):
                values.normal_(0.0, 0.3)
        model.policy.action_net.weight.mul_(100.0)
    return model, request.param


def actor(model) -> dict[str, np.ndarray]:
    return {name: values.numpy() for name, values in model.policy.state_dict().items()}


def difference(model, own: Network, size: float) -> float:
    """The largest difference between the learner's actions and the network's, for features up to ``size``."""
    features = np.random.default_rng(0).uniform(-size, size, (500, SIZE)).astype(np.float32)
    theirs = model.predict(features, deterministic=True)[0]
    return float(np.abs(np.clip(own(features), -1.0, 1.0) - theirs).max())


@pytest.mark.parametrize("size", [0.1, 3.0, CLIP])
def test_the_network_acts_as_the_learner_does(learner, size):
    model, activation = learner
    own = Network.from_state_dict(actor(model), activation)
    assert own.sizes == (SIZE, 64, 64, 2)
    assert difference(model, own, size) < 1e-5


def state(*places: int) -> dict[str, np.ndarray]:
    """An actor's parameters, with dense layers at these places."""
    widths = [SIZE, *(4 for _ in places), 2]
    prefixes = [*(f"mlp_extractor.policy_net.{place}" for place in places), "action_net"]
    arrays = {"log_std": np.zeros(2, np.float32), "value_net.bias": np.zeros(1, np.float32)}
    for prefix, (before, after) in zip(prefixes, itertools.pairwise(widths), strict=True):
        arrays[f"{prefix}.weight"] = np.ones((after, before), np.float32)
        arrays[f"{prefix}.bias"] = np.ones(after, np.float32)
    return arrays


def test_layers_are_taken_in_order_of_their_numbers():
    arrays = state(0, 2, 4, 6, 8, 10)
    arrays["mlp_extractor.policy_net.10.bias"] = np.full(4, 7.0, np.float32)
    found = Network.from_state_dict(dict(sorted(arrays.items())), "tanh")  # as text, 10 comes before 2
    assert found.layers[-2][1].tolist() == [7.0] * 4
    assert found.sizes == (SIZE, 4, 4, 4, 4, 4, 4, 2)


@pytest.mark.parametrize(
    ("places", "without", "message"),
    [
        ((0, 2), "action_net.bias", "'action_net.bias' is missing"),
        ((0, 2), "mlp_extractor.policy_net.2.weight", r"'mlp_extractor\.policy_net\.2\.weight' is missing"),
        ((2,), None, r"parameters at \[2\] instead of \[0\]"),
        ((0, 1, 3), None, r"parameters at \[0, 1, 3\] instead of \[0, 2, 4\]"),
    ],
)
def test_a_state_that_is_not_an_actor_names_what_is_missing(places, without, message):
    arrays = {name: values for name, values in state(*places).items() if name != without}
    with pytest.raises(ValueError, match=message):
        Network.from_state_dict(arrays, "tanh")


def test_a_card_tells_its_output_only_where_tanh_follows(tmp_path):
    layers = Network.from_state_dict(state(0, 2), "relu").layers
    features = np.random.default_rng(0).uniform(-1.0, 1.0, (5, SIZE)).astype(np.float32)
    for output, told in (("linear", False), ("tanh", True)):
        network = Network(layers, "relu", output)
        save_policy(tmp_path / output, network, **ABOUT)
        assert ('"output"' in (tmp_path / output / "card.json").read_text()) == told
        kept = TrainedPolicy.load(tmp_path / output).network
        assert (kept(features) == network(features)).all()
    assert np.tanh(Network(layers, "relu")(features)) == pytest.approx(network(features))
    with pytest.raises(ValueError, match="output"):
        Network(layers, "relu", "sigmoid")
