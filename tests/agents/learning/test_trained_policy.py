"""A trained policy's folder is read back exactly, overwritten only when told, and needs no learning library."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from kept_policy import ABOUT, SIZE, actions, network, observations

from cutenv.agents.policy import trained
from cutenv.agents.policy.actor_network import ACTIVATIONS, Network
from cutenv.agents.policy.trained import CARD, WEIGHTS, PolicyCard, TrainedPolicy, save_policy
from cutenv.task.observation import COMPONENTS

pytest.importorskip("safetensors", reason="policies are kept with an extra: pip install 'cutenv[rl]'")


def test_a_policy_read_back_acts_exactly_as_before(folder):
    policy = TrainedPolicy.load(str(folder))
    before = TrainedPolicy(policy.card, network())
    seen = observations(20)
    np.testing.assert_array_equal(actions(policy, seen), actions(before, seen))
    assert not np.array_equal(actions(policy, seen), actions(TrainedPolicy(policy.card, network(seed=1)), seen))
    assert policy.environment_arguments == ABOUT["environment_arguments"]
    assert policy.card.training == ABOUT["training"]


def test_actions_fit_the_action_space(folder):
    found = actions(TrainedPolicy.load(folder), observations(300))
    assert found.dtype == np.float32
    assert found.shape == (300, 2)
    assert np.abs(found).max() == 1.0


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
    sha256=st.text("0123456789abcdef", min_size=64, max_size=64),
    training=MAPPINGS,
)


@settings(max_examples=40)
@given(CARDS)
def test_any_card_is_read_back_exactly(card):
    assert PolicyCard.from_json(card.to_json()) == card


# Nothing is overwritten by accident, and nothing is left half.


def test_the_same_policy_is_saved_again_with_new_facts(folder):
    save_policy(folder, network(), **(ABOUT | {"training": {"seed": 4}}))
    assert TrainedPolicy.load(folder).card.training == {"seed": 4}


@pytest.mark.parametrize(("seed", "change"), [(1, {}), (0, {"environment_arguments": {"control_hz": 20}})])
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
from cutenv.agents.policy.trained import TrainedPolicy

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


def test_a_missing_safetensors_names_the_extra(folder):
    ran = run_without(("safetensors",), RUN, folder)
    assert ran.returncode != 0
    assert "ModuleNotFoundError" in ran.stderr
    assert "pip install 'cutenv[rl]'" in ran.stderr
