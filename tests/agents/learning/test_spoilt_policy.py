"""What is off in a policy's folder is refused, with the file, what was found, and what to do."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from kept_policy import SIZE, change_card, network, swap_weights

from cutenv.agents.policy import trained
from cutenv.agents.policy.trained import CARD, WEIGHTS, TrainedPolicy
from cutenv.task.observation import COMPONENTS

pytest.importorskip("safetensors", reason="policies are kept with an extra: pip install 'cutenv[rl]'")


def check_refused(folder: Path, file: str, found: str) -> None:
    with pytest.raises(ValueError, match=found) as raised:
        TrainedPolicy.load(folder)
    assert str(folder / file) in str(raised.value)
    assert str(raised.value).endswith(trained._CURE) or "or train it again." in str(raised.value)


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
        ({"features": None}, r"missing field\(s\) features"),
        ({"activation": "gelu"}, "activation must be one of 'tanh', 'relu', got 'gelu'"),
        ({"activation": ["tanh"]}, "activation must be one of"),
        ({"layers": [SIZE, 9, 6, 2]}, f"layers is {SIZE}-9-6-2, but the network's are {SIZE}-8-6-2"),
        ({"layers": "64"}, "layers must be two or more positive whole numbers.*'64'"),
        ({"layers": [SIZE, 8.5, 2]}, "layers must be two or more positive whole numbers"),
        ({"features": {"histroy": 2}}, "features .*histroy"),
        ({"features": [2]}, "features must be a mapping"),
        ({"features": {"history": 3}}, "must begin with"),
        ({"dead_zone": 0.1}, r"dead_zone = 0\.1: the policy had a dead zone of its own, .* Train it again"),
        ({"dead_zone": 0.25}, r"dead_zone = 0\.25: the policy had a dead zone of its own"),
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
    check_refused(folder, WEIGHTS, f"its SHA-256 is .*{CARD} has .*changed or damaged")


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
