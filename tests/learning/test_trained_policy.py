"""A trained policy's folder: read back exactly, run by NumPy as the learner runs it, refused when anything is off."""

from __future__ import annotations

import hashlib
import itertools
import json
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cutenv.policy import trained
from cutenv.policy.features import Features, past_dead_zone
from cutenv.policy.network import ACTIVATIONS, Network
from cutenv.policy.trained import CARD, WEIGHTS, PolicyCard, TrainedPolicy, save_policy
from cutenv.task.observation import BOUND, COMPONENTS

pytest.importorskip("safetensors", reason="policies are kept with an extra: pip install 'cutenv[rl]'")

FEATURES = {"history": 2}
SIZE = Features(**FEATURES).size
ABOUT = {
    "environment": "cutenv/GentleCut-v0",
    "environment_arguments": {"control_hz": 10, "angle_mode": "free"},
    "features": FEATURES,
    "dead_zone": 0.25,
    "training": {"seed": 3, "decisions": 1_500_000, "versions": {"numpy": np.__version__}, "return": 0.1},
}


def network(seed: int = 0, sizes: tuple[int, ...] = (SIZE, 8, 6, 2), activation: str = "tanh") -> Network:
    rng = np.random.default_rng(seed)
    layers = tuple(
        (rng.normal(size=(after, before)).astype(np.float32), rng.normal(size=after).astype(np.float32))
        for before, after in itertools.pairwise(sizes)
    )
    return Network(layers, activation)


def observations(number: int, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (number, len(COMPONENTS))).astype(np.float32)


def actions(policy: TrainedPolicy, seen: np.ndarray) -> np.ndarray:
    policy.reset(np.random.default_rng(0))
    return np.stack([policy(observation) for observation in seen])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    save_policy(tmp_path / "policy", network(), **ABOUT)
    return tmp_path / "policy"


def change_card(folder: Path, **changes) -> None:
    """Change fields of a card behind the package's back; None removes one."""
    content = json.loads((folder / CARD).read_text()) | changes
    kept = {name: value for name, value in content.items() if value is not None}
    (folder / CARD).write_text(json.dumps(kept))


def swap_weights(folder: Path, arrays: dict[str, np.ndarray]) -> None:
    """Put other weights there, with their hash in the card."""
    from safetensors.numpy import save

    content = save(arrays)
    (folder / WEIGHTS).write_bytes(content)
    change_card(folder, sha256=hashlib.sha256(content).hexdigest())


# What a learner's actor does, the network does.


def spaces() -> gymnasium.Env:
    """What PPO must know of an environment to build its networks, and no more."""
    env = gymnasium.Env()
    env.observation_space = gymnasium.spaces.Box(-BOUND, BOUND, (SIZE,), np.float32)
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


@pytest.mark.parametrize("size", [0.1, 3.0, BOUND])
def test_the_network_acts_as_the_learner_does(learner, size):
    model, activation = learner
    own = Network.from_state_dict(actor(model), activation)
    assert own.sizes == (SIZE, 64, 64, 2)
    assert difference(model, own, size) < 1e-5


def test_before_clipping_the_network_says_what_the_learner_says(learner):
    import torch

    model, activation = learner
    features = np.random.default_rng(0).uniform(-1e3, 1e3, (500, SIZE)).astype(np.float32)
    with torch.no_grad():
        theirs = model.policy.get_distribution(torch.as_tensor(features)).mode().numpy()
    own = Network.from_state_dict(actor(model), activation)(features)
    assert np.abs(own - theirs).max() < 1e-5 * np.abs(theirs).max()


def test_a_learner_that_always_answers_the_limit_would_prove_nothing(learner):
    features = np.random.default_rng(0).uniform(-3.0, 3.0, (500, SIZE)).astype(np.float32)
    inside = np.abs(learner[0].predict(features, deterministic=True)[0]) < 0.99
    assert 0.3 < inside.mean() < 1.0


def test_an_activation_left_out_is_noticed(learner, monkeypatch):
    model, activation = learner
    monkeypatch.setitem(ACTIVATIONS, activation, lambda values: values)
    assert difference(model, Network.from_state_dict(actor(model), activation), 1.0) > 0.1


def test_a_policy_from_its_folder_acts_as_the_learner_does_throughout_a_cut(learner, tmp_path):
    model, activation = learner
    save_policy(tmp_path, Network.from_state_dict(actor(model), activation), **ABOUT)
    policy, features = TrainedPolicy.load(tmp_path), Features(**FEATURES)
    for seed in (1, 2):  # two cuts: the second must know nothing of the first
        seen = observations(30, seed)
        features.reset()
        expected = [
            past_dead_zone(model.predict(features(observation), deterministic=True)[0], ABOUT["dead_zone"])
            for observation in seen
        ]
        np.testing.assert_allclose(actions(policy, seen), expected, rtol=0.0, atol=2e-5)


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


# What is written is read back.


def test_a_policy_read_back_acts_exactly_as_before(folder):
    policy = TrainedPolicy.load(str(folder))
    before = TrainedPolicy(policy.card, network())
    seen = observations(20)
    np.testing.assert_array_equal(actions(policy, seen), actions(before, seen))
    assert not np.array_equal(actions(policy, seen), actions(TrainedPolicy(policy.card, network(seed=1)), seen))
    assert policy.environment_arguments == ABOUT["environment_arguments"]
    assert policy.card.training == ABOUT["training"]


def test_actions_fit_the_action_space_and_rest_within_the_dead_zone(folder):
    found = actions(TrainedPolicy.load(folder), observations(300))
    assert found.dtype == np.float32
    assert found.shape == (300, 2)
    assert np.abs(found).max() == 1.0
    assert (found[:, 0] == 0.0).any()
    assert not (found[:, 1] == 0.0).any()


def test_a_policy_without_chance_repeats_itself_after_a_reset(folder):
    policy, seen = TrainedPolicy.load(folder), observations(10)
    np.testing.assert_array_equal(actions(policy, seen), actions(policy, seen))


def test_an_observation_that_is_not_one_is_refused(folder):
    policy = TrainedPolicy.load(folder)
    policy.reset(np.random.default_rng(0))
    with pytest.raises(ValueError, match="finite"):
        policy(np.full(len(COMPONENTS), np.nan, np.float32))
    with pytest.raises(ValueError, match="shape"):
        policy(np.zeros(5, np.float32))


def test_the_same_weights_have_the_same_hash_however_they_lie_in_memory(tmp_path):
    own = network()
    columns = Network(tuple((np.asfortranarray(weight), bias) for weight, bias in own.layers))
    first, second = (save_policy(tmp_path / name, kind, **ABOUT) for name, kind in (("a", own), ("b", columns)))
    assert first == second
    seen = observations(5)
    np.testing.assert_array_equal(
        actions(TrainedPolicy.load(tmp_path / "a"), seen), actions(TrainedPolicy.load(tmp_path / "b"), seen)
    )


def test_weights_cannot_change_once_they_are_a_networks():
    given_weight = np.ones((2, SIZE), np.float32)
    own = Network(((given_weight, np.zeros(2, np.float32)),))
    given_weight[:] = 5.0
    assert own(np.ones(SIZE, np.float32)).tolist() == [SIZE, SIZE]
    with pytest.raises(ValueError, match="read-only"):
        own.layers[0][0][:] = 5.0


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False, allow_infinity=False) | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=8,
)
MAPPINGS = st.dictionaries(st.text(max_size=5), JSON, max_size=3)
CARDS = st.builds(
    PolicyCard,
    environment=st.text(min_size=1, max_size=20),
    environment_arguments=MAPPINGS,
    layers=st.lists(st.integers(1, 10**6), min_size=2, max_size=5).map(tuple),
    activation=st.sampled_from(sorted(ACTIVATIONS)),
    features=MAPPINGS,
    dead_zone=st.floats(0.0, 0.9),
    sha256=st.text("0123456789abcdef", min_size=64, max_size=64),
    training=MAPPINGS,
)


@given(CARDS)
def test_any_card_is_read_back_exactly(card):
    assert PolicyCard.from_json(card.to_json()) == card


# Nothing is overwritten by accident, and nothing is left half.


def test_the_same_policy_is_saved_again_with_new_facts(folder):
    save_policy(folder, network(), **(ABOUT | {"training": {"seed": 4}}))
    assert TrainedPolicy.load(folder).card.training == {"seed": 4}


@pytest.mark.parametrize(
    ("seed", "change"), [(1, {}), (0, {"dead_zone": 0.1}), (0, {"environment_arguments": {"control_hz": 20}})]
)
def test_a_different_policy_is_overwritten_only_when_told(folder, seed, change):
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(FileExistsError, match="replace=True"):
        save_policy(folder, network(seed), **(ABOUT | change))
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    card = save_policy(folder, network(seed), **(ABOUT | change), replace=True)
    assert TrainedPolicy.load(folder).card == card


def test_a_card_that_cannot_be_read_counts_as_a_different_policy(folder):
    (folder / CARD).write_text("torn")
    with pytest.raises(FileExistsError, match="replace=True"):
        save_policy(folder, network(), **ABOUT)


@pytest.mark.parametrize("file", [WEIGHTS, CARD])
def test_an_interrupted_save_leaves_no_policy_and_can_be_repeated(folder, monkeypatch, file):
    write = trained._write

    def interrupted(path: Path, content: bytes) -> None:
        if path.name == file:
            raise KeyboardInterrupt
        write(path, content)

    monkeypatch.setattr(trained, "_write", interrupted)
    with pytest.raises(KeyboardInterrupt):
        save_policy(folder, network(seed=1), **ABOUT, replace=True)
    monkeypatch.undo()
    with pytest.raises(FileNotFoundError, match=f"holds no {CARD}"):
        TrainedPolicy.load(folder)
    save_policy(folder, network(seed=1), **ABOUT)
    assert sorted(path.name for path in folder.iterdir()) == [CARD, WEIGHTS]
    TrainedPolicy.load(folder)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"training": {"return": float("nan")}}, "training must hold what JSON can"),
        ({"training": {"return": np.float32(1.0)}}, "training must hold what JSON can"),
        ({"environment_arguments": {3: 4}}, "environment_arguments must be a mapping with text as keys"),
        ({"dead_zone": 1.0}, "dead_zone = 1 is outside 0 to 0.9"),
        ({"environment": ""}, "environment must be an id"),
        ({"features": {"histroy": 2}}, "features .*histroy"),
        ({"features": {"history": 3}}, "must begin with"),
    ],
)
def test_what_could_not_be_loaded_is_not_saved(tmp_path, change, message):
    with pytest.raises((TypeError, ValueError), match=message):
        save_policy(tmp_path / "policy", network(), **(ABOUT | change))
    assert not (tmp_path / "policy").exists()


def test_a_network_with_other_than_two_actions_is_not_saved(tmp_path):
    with pytest.raises(ValueError, match="end with 2"):
        save_policy(tmp_path, network(sizes=(SIZE, 4, 3)), **ABOUT)


# What is off is refused, with the file, what was found, and what to do.


def check_refused(folder: Path, file: str, found: str) -> None:
    with pytest.raises(ValueError, match=found) as raised:
        TrainedPolicy.load(folder)
    assert str(folder / file) in str(raised.value)
    assert str(raised.value).endswith(trained._AGAIN) or "or train it again." in str(raised.value)


def test_a_missing_folder_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match=f"nowhere is not a folder; give one that holds {CARD}"):
        TrainedPolicy.load(tmp_path / "nowhere")


@pytest.mark.parametrize("file", [CARD, WEIGHTS])
def test_a_missing_file_is_named(folder, file):
    (folder / file).unlink()
    with pytest.raises(FileNotFoundError, match=f"holds no {file}.*save the policy again"):
        TrainedPolicy.load(folder)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        ({"schema": "cutenv-policy/9"}, "schema 'cutenv-policy/1', found 'cutenv-policy/9'"),
        ({"activations": "tanh"}, "'activations'.*Did you mean 'activation'"),
        ({"dead_zone": None}, r"missing field\(s\) dead_zone"),
        ({"activation": "gelu"}, "activation must be one of 'tanh', 'relu', got 'gelu'"),
        ({"activation": ["tanh"]}, "activation must be one of"),
        ({"layers": [SIZE, 9, 6, 2]}, f"layers is {SIZE}-9-6-2, but the network's are {SIZE}-8-6-2"),
        ({"layers": "64"}, "layers must be two or more positive whole numbers.*'64'"),
        ({"layers": [SIZE, 8.5, 2]}, "layers must be two or more positive whole numbers"),
        ({"features": {"histroy": 2}}, "features .*histroy"),
        ({"features": [2]}, "features must be a mapping"),
        ({"features": {"history": 3}}, "must begin with"),
        ({"dead_zone": "a quarter"}, "dead_zone must be one real number.*'a quarter'"),
        ({"sha256": "12"}, "sha256 must be 64 hexadecimal digits, got '12'"),
        ({"environment": 5}, "environment must be an id"),
        ({"scaling": [5]}, "scaling: component 'force' is 5 in the card"),
        ({"scaling": 5}, "scaling must be a list"),
    ],
)
def test_a_changed_card_is_refused(folder, change, found):
    change_card(folder, **change)
    check_refused(folder, CARD, found)


@pytest.mark.parametrize(
    ("index", "change"),
    [(0, {"scale": 4.0}), (6, {"offset": 0.0}), (9, {"unit": "ms"}), (2, {"name": "force_low"})],
)
def test_another_scaling_of_the_observation_is_refused_by_the_components_name(folder, index, change):
    scaling = json.loads((folder / CARD).read_text())["scaling"]
    scaling[index] |= change
    change_card(folder, scaling=scaling)
    check_refused(folder, CARD, f"scaling: component '{COMPONENTS[index].name}' is")


def test_a_component_too_few_or_too_many_is_named(folder):
    scaling = json.loads((folder / CARD).read_text())["scaling"]
    change_card(folder, scaling=scaling[:-1])
    check_refused(folder, CARD, "scaling: component 'last_angle' is None in the card")
    change_card(folder, scaling=[*scaling, {"name": "sound", "unit": "1", "scale": 1.0, "offset": 0.0}])
    check_refused(folder, CARD, "scaling: a component after 'last_angle' is .*'sound'")


@pytest.mark.parametrize("content", [b"", b"[]", b'{"schema": "cutenv-pol', b"\xff\xfe\x00"])
def test_a_torn_card_is_refused(folder, content):
    (folder / CARD).write_bytes(content)
    check_refused(folder, CARD, "not JSON|expected a JSON object|decode")


@pytest.mark.parametrize("place", [0, 100, -1])
def test_a_single_damaged_byte_of_the_weights_is_noticed(folder, place):
    content = bytearray((folder / WEIGHTS).read_bytes())
    content[place] ^= 1
    (folder / WEIGHTS).write_bytes(content)
    check_refused(folder, WEIGHTS, f"its SHA-256 is .*{CARD} says .*changed or damaged")


def test_weights_that_are_no_safetensors_are_refused_even_with_their_hash(folder):
    (folder / WEIGHTS).write_bytes(b"PK\x03\x04")
    change_card(folder, sha256=hashlib.sha256(b"PK\x03\x04").hexdigest())
    check_refused(folder, WEIGHTS, "not a safetensors file")


def with_value(name: str, value: float) -> dict[str, np.ndarray]:
    array = network().to_arrays()[name].copy()
    array.flat[1] = value
    return {name: array}


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (with_value("layer_1.weight", np.nan), "layer_1.weight holds 1 of 48 numbers that are NaN or infinite"),
        (with_value("layer_2.bias", np.inf), "layer_2.bias holds 1 of 2 numbers"),
        ({"layer_0.bias": np.zeros(8)}, "layer_0.bias is float64; give float32"),
        ({"layer_1.weight": np.zeros((6, 7), np.float32)}, "layer_1.weight takes 7 numbers, but 8 come in"),
        ({"layer_1.bias": np.zeros(5, np.float32)}, r"layer_1.bias has shape \(5,\); its weight gives 6"),
        ({"layer_1.bias": np.zeros((6, 1), np.float32)}, r"layer_1.bias has shape \(6, 1\); it must have 1 axes"),
        ({"layer_1.bias": None}, "array 'layer_1.bias' is missing"),
        ({"scale": np.ones(1, np.float32)}, "array 'scale' belongs to no layer"),
    ],
)
def test_weights_that_make_no_network_are_refused_even_with_their_hash(folder, change, found):
    arrays = network().to_arrays() | change
    swap_weights(folder, {name: values for name, values in arrays.items() if values is not None})
    check_refused(folder, WEIGHTS, found)


def test_weights_of_another_size_are_refused_even_with_their_hash(folder):
    swap_weights(folder, network(sizes=(SIZE, 5, 2)).to_arrays())
    check_refused(folder, CARD, f"layers is {SIZE}-8-6-2, but the network's are {SIZE}-5-2")


# It needs no learning library.

BLOCKED = """
import sys

class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {blocked!r}:
            raise ModuleNotFoundError("blocked: " + name, name=name)

sys.meta_path.insert(0, Blocked())
{statements}
"""
RUN = """
import numpy as np
from cutenv.policy.trained import TrainedPolicy

policy = TrainedPolicy.load(sys.argv[1])
policy.reset(np.random.default_rng(0))
print(policy(np.full(12, 0.1, np.float32)).tolist())
"""


def run_without(blocked: tuple[str, ...], statements: str, folder: Path) -> subprocess.CompletedProcess[str]:
    code = BLOCKED.format(blocked=blocked, statements=statements)
    return subprocess.run([sys.executable, "-c", code, str(folder)], capture_output=True, text=True, check=False)


LEARNING = ("torch", "stable_baselines3")


def test_a_policy_runs_where_no_learning_library_is_installed(folder):
    ran = run_without(LEARNING, RUN, folder)
    assert ran.returncode == 0, ran.stderr
    expected = actions(TrainedPolicy.load(folder), np.full((1, 12), 0.1, np.float32))[0]
    np.testing.assert_allclose(json.loads(ran.stdout), expected, rtol=0.0, atol=1e-6)


def test_a_learning_library_would_be_noticed(folder):
    ran = run_without(LEARNING, "import torch" + RUN, folder)
    assert ran.returncode != 0
    assert "blocked: torch" in ran.stderr


def test_a_missing_safetensors_names_the_extra(folder):
    ran = run_without(("safetensors",), RUN, folder)
    assert ran.returncode != 0
    assert "ModuleNotFoundError" in ran.stderr
    assert "pip install 'cutenv[rl]'" in ran.stderr
