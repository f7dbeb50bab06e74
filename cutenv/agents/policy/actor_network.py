"""Networks in NumPy, the actors of trained policies.

Dense layers, and an LSTM followed by dense layers.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array32
from cutenv._base.validation import one_of

Layer = tuple[Array32, Array32]  # weight, shape (outputs, inputs), and bias, shape (outputs,)

ACTIVATIONS: dict[str, Callable[[Array32], Array32]] = {
    "tanh": np.tanh,
    "relu": lambda values: np.maximum(values, np.float32(0.0)),
}
OUTPUTS = ("linear", "tanh")
_PARTS = ("weight", "bias")
_HIDDEN = re.compile(r"mlp_extractor\.policy_net\.(\d+)\.(?:weight|bias)")


@dataclass(frozen=True, eq=False)
class Network:
    """Dense layers, each followed by an activation.

    After the last comes none, or tanh.

    Parameters
    ----------
    layers : tuple of (weight, bias)
        Weight and bias of each layer from input to output, float32, shapes (outputs, inputs) and (outputs,).
    activation : {"tanh", "relu"}
        Activation function after every layer but the last.
    output : {"linear", "tanh"}
        What follows the last layer: nothing, or tanh, as in the actors of SAC and its kin.

    Raises
    ------
    ValueError
        If shapes do not fit, a number is not float32 or not finite, or activation or output is unknown.
    """

    layers: tuple[Layer, ...]
    activation: str = "tanh"
    output: str = "linear"

    def __post_init__(self) -> None:
        one_of("activation", self.activation, ACTIVATIONS)
        one_of("output", self.output, OUTPUTS)
        if not self.layers:
            raise ValueError("layers is empty; give at least one (weight, bias).")
        checked = tuple(
            (checked_array(_name(k, "weight"), weight, 2), checked_array(_name(k, "bias"), bias, 1))
            for k, (weight, bias) in enumerate(self.layers)
        )
        inputs = checked[0][0].shape[1]
        for k, (weight, bias) in enumerate(checked):
            if weight.shape[1] != inputs:
                raise ValueError(f"{_name(k, 'weight')} takes {weight.shape[1]} numbers, but {inputs} come in.")
            if bias.shape != weight.shape[:1]:
                raise ValueError(f"{_name(k, 'bias')} has shape {bias.shape}; its weight gives {weight.shape[0]}.")
            inputs = weight.shape[0]
        object.__setattr__(self, "layers", checked)

    @property
    def sizes(self) -> tuple[int, ...]:
        """Widths from input to output."""
        return (self.layers[0][0].shape[1], *(len(bias) for _, bias in self.layers))

    def __call__(self, features: Array32) -> Array32:
        """Return the output, shape (..., ``sizes[-1]``), for features, shape (..., ``sizes[0]``)."""
        values = np.asarray(features, dtype=np.float32)
        if values.shape[-1:] != self.sizes[:1]:
            raise ValueError(f"features has shape {values.shape}; its last axis must hold {self.sizes[0]} numbers.")
        activate = ACTIVATIONS[self.activation]
        *hidden, (last_weight, last_bias) = self.layers
        for weight, bias in hidden:
            values = activate(row_by_row(values, weight) + bias)
        values = row_by_row(values, last_weight) + last_bias
        return np.tanh(values) if self.output == "tanh" else values

    def to_arrays(self) -> dict[str, Array32]:
        """Return weights and biases by name: ``layer_0.weight``, ``layer_0.bias`` and so on."""
        return {
            _name(k, part): array
            for k, layer in enumerate(self.layers)
            for part, array in zip(_PARTS, layer, strict=True)
        }

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array32], activation: str, output: str = "linear") -> Network:
        """Build the network from arrays named as by :meth:`to_arrays`.

        Raises
        ------
        ValueError
            If an array is missing, has an unknown name, or is invalid.
        """
        prefixes = [f"layer_{k}" for k in range(max(len(arrays) // 2, 1))]
        layers = tuple(_layer(arrays, prefix) for prefix in prefixes)
        unknown = sorted(arrays.keys() - {f"{prefix}.{part}" for prefix in prefixes for part in _PARTS})
        if unknown:
            raise ValueError(f"array {unknown[0]!r} belongs to no layer of {prefixes[0]} to {prefixes[-1]}.")
        return cls(layers, activation, output)

    @classmethod
    def from_state_dict(cls, arrays: Mapping[str, Array32], activation: str) -> Network:
        """Build the actor of Stable-Baselines3's ``MlpPolicy``: its deterministic action before clipping.

        Parameters
        ----------
        arrays : mapping
            Parameters of the policy by name, as NumPy arrays; the critic's and the action's log_std are ignored.
        activation : {"tanh", "relu"}
            The policy's ``activation_fn``, which the names do not contain.

        Raises
        ------
        ValueError
            If a parameter of the actor is missing (the message names it), or there are other modules than
            activations between the dense layers.
        """
        places = sorted({int(found[1]) for name in arrays if (found := _HIDDEN.fullmatch(name))})
        expected = list(range(0, 2 * len(places), 2))  # every second module is an activation, without parameters
        if places != expected:
            raise ValueError(
                f"mlp_extractor.policy_net has parameters at {places} instead of {expected}: one is missing, or it is "
                "not dense layers with an activation after each."
            )
        prefixes = [*(f"mlp_extractor.policy_net.{place}" for place in places), "action_net"]
        return cls(tuple(_layer(arrays, prefix) for prefix in prefixes), activation)


def row_by_row(values: Array32, weight: Array32) -> Array32:
    """Multiply ``values``, (..., inputs), by ``weight``, (outputs, inputs), row by row.

    One product of all rows rounds differently from single rows, and a cut amplifies the last bit.
    """
    product: Array32 = (values[..., None, :] @ weight.T)[..., 0, :]
    return product


def _name(number: int, part: str) -> str:
    return f"layer_{number}.{part}"


def _layer(arrays: Mapping[str, Array32], prefix: str) -> Layer:
    weight, bias = (_found(arrays, f"{prefix}.{part}") for part in _PARTS)
    return weight, bias


def checked_array(name: str, values: Array32, dimensions: int) -> Array32:
    """Return a read-only C-ordered copy; raise ValueError unless finite float32 of ``dimensions``."""
    array = np.array(values, order="C")
    if array.dtype != np.float32:
        raise ValueError(f"{name} is {array.dtype}; give float32: array.astype(numpy.float32).")
    if array.ndim != dimensions or array.size == 0:
        raise ValueError(f"{name} has shape {array.shape}; it must have {dimensions} axes, none empty.")
    wrong = int(np.count_nonzero(~np.isfinite(array)))
    if wrong:
        raise ValueError(
            f"{name} holds {wrong} of {array.size} numbers that are NaN or infinite: training "
            "diverged. Take an earlier checkpoint."
        )
    array.setflags(write=False)
    return array


State = tuple[Array32, Array32]  # recurrent state: hidden state h and cell state c, shape (..., units) each

_PREFIX = "memory."
_LSTM_PARTS = {"weight_ih": 2, "weight_hh": 2, "bias_ih": 1, "bias_hh": 1}  # names and numbers of axes
_ACTOR = "lstm_actor"
_GATES = 4  # input i, forget f, cell g, output o: stacked in this order, as in PyTorch


@dataclass(frozen=True, eq=False)
class RecurrentNetwork:
    """LSTM layer (Hochreiter and Schmidhuber 1997), followed by a :class:`Network`.

    With features x and state (h, c): i, f, g, o = W_ih x + b_ih + W_hh h + b_hh,
    c' = sigmoid(f) c + sigmoid(i) tanh(g), h' = sigmoid(o) tanh(c'); the network's input is h'.

    Parameters
    ----------
    weight_ih, weight_hh : array
        Float32, shapes (4 units, inputs) and (4 units, units).
    bias_ih, bias_hh : array
        Float32, shape (4 units,).
    head : Network
        Network from h' to the action.

    Raises
    ------
    ValueError
        If shapes do not fit, or a number is not float32 or not finite; the message names the array.
    """

    weight_ih: Array32
    weight_hh: Array32
    bias_ih: Array32
    bias_hh: Array32
    head: Network

    def __post_init__(self) -> None:
        for part, dimensions in _LSTM_PARTS.items():
            object.__setattr__(self, part, checked_array(_PREFIX + part, getattr(self, part), dimensions))
        rows, units = self.weight_hh.shape
        if rows != _GATES * units:
            raise ValueError(
                f"{_PREFIX}weight_hh has shape {self.weight_hh.shape}; it must have four times as many rows as columns."
            )
        for part in _LSTM_PARTS:
            found = getattr(self, part).shape
            if found[0] != rows:
                raise ValueError(f"{_PREFIX}{part} has shape {found}; {units} units need {rows} rows.")
        if self.head.sizes[0] != units:
            raise ValueError(f"layer_0.weight takes {self.head.sizes[0]} numbers, but the memory has {units} units.")

    @property
    def units(self) -> int:
        """Number of units in h and in c."""
        return int(self.weight_hh.shape[1])

    @property
    def sizes(self) -> tuple[int, ...]:
        """Widths from input to output, beginning with the LSTM's input."""
        return (self.weight_ih.shape[1], *self.head.sizes)

    @property
    def activation(self) -> str:
        """Activation function of the network after the LSTM."""
        return self.head.activation

    def start(self, count: int) -> State:
        """Return the initial state of ``count`` cuts: zeros."""
        return np.zeros((count, self.units), np.float32), np.zeros((count, self.units), np.float32)

    def __call__(self, features: Array32, state: State) -> tuple[Array32, State]:
        """Return output, (n, ``sizes[-1]``), and next state for features, (n, ``sizes[0]``)."""
        x = np.asarray(features, dtype=np.float32)
        if x.shape[-1:] != self.sizes[:1]:
            raise ValueError(f"features has shape {x.shape}; its last axis must hold {self.sizes[0]} numbers.")
        h, c = state
        gates = row_by_row(x, self.weight_ih) + self.bias_ih + row_by_row(h, self.weight_hh) + self.bias_hh
        i, f, g, o = np.split(gates, _GATES, axis=-1)
        c = _sigmoid(f) * c + _sigmoid(i) * np.tanh(g)
        h = _sigmoid(o) * np.tanh(c)
        return self.head(h), (h, c)

    def to_arrays(self) -> dict[str, Array32]:
        """Return weights and biases by name: memory (``memory.weight_ih``), then head."""
        return {_PREFIX + part: getattr(self, part) for part in _LSTM_PARTS} | self.head.to_arrays()

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array32], activation: str) -> RecurrentNetwork:
        """Build the network from arrays named as by :meth:`to_arrays`.

        Raises
        ------
        ValueError
            If an array is missing, has an unknown name, or is invalid.
        """
        own = {part: _found(arrays, _PREFIX + part) for part in _LSTM_PARTS}
        others = {name: array for name, array in arrays.items() if name not in {_PREFIX + part for part in _LSTM_PARTS}}
        return cls(**own, head=Network.from_arrays(others, activation))

    @classmethod
    def from_state_dict(cls, arrays: Mapping[str, Array32], activation: str) -> RecurrentNetwork:
        """Build sb3-contrib's ``MlpLstmPolicy`` actor, like :meth:`Network.from_state_dict`.

        Raises
        ------
        ValueError
            If a parameter of the actor is missing, or it has more than one LSTM layer.
        """
        if f"{_ACTOR}.weight_ih_l1" in arrays:
            raise ValueError(f"{_ACTOR} has more than one layer; train with n_lstm_layers=1.")
        own = {part: _found(arrays, f"{_ACTOR}.{part}_l0") for part in _LSTM_PARTS}
        return cls(**own, head=Network.from_state_dict(arrays, activation))


def _found(arrays: Mapping[str, Array32], name: str) -> Array32:
    if name not in arrays:
        some = ", ".join(sorted(arrays)[:6]) or "nothing"
        raise ValueError(f"array {name!r} is missing; found {some}{', ...' if len(arrays) > 6 else ''}.")
    return arrays[name]


def _sigmoid(values: Array32) -> Array32:
    """Compute 1/(1 + exp(-x)) in a form that cannot overflow."""
    result: Array32 = np.float32(0.5) * (np.float32(1.0) + np.tanh(np.float32(0.5) * values))
    return result
