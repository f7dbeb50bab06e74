"""An LSTM network followed by dense layers, in NumPy: the actor of a trained recurrent policy."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cutenv._base.arrays import Array32
from cutenv.policy.actor_network import Network, checked_array, row_by_row

State = tuple[Array32, Array32]
"""Recurrent state: hidden state h and cell state c, shape (..., units) each."""

_PREFIX = "memory."
_PARTS = {"weight_ih": 2, "weight_hh": 2, "bias_ih": 1, "bias_hh": 1}  # names and numbers of axes
_ACTOR = "lstm_actor"
_GATES = 4  # input i, forget f, cell g, output o: stacked in this order, as in PyTorch


@dataclass(frozen=True, eq=False)
class RecurrentNetwork:
    """One LSTM layer (long short-term memory, Hochreiter and Schmidhuber 1997), then a :class:`Network`.

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
        for part, dimensions in _PARTS.items():
            object.__setattr__(self, part, checked_array(_PREFIX + part, getattr(self, part), dimensions))
        rows, units = self.weight_hh.shape
        if rows != _GATES * units:
            raise ValueError(
                f"{_PREFIX}weight_hh has shape {self.weight_hh.shape}; it must have four times as many rows as columns."
            )
        for part in _PARTS:
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
        """Return the output, shape (n, ``sizes[-1]``), and the next state, for features, shape (n, ``sizes[0]``)."""
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
        """Return weights and biases by name: ``memory.weight_ih`` and so on, then those of the head."""
        return {_PREFIX + part: getattr(self, part) for part in _PARTS} | self.head.to_arrays()

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, Array32], activation: str) -> RecurrentNetwork:
        """Build the network from arrays named as by :meth:`to_arrays`.

        Raises
        ------
        ValueError
            If an array is missing, has an unknown name, or is invalid.
        """
        own = {part: _found(arrays, _PREFIX + part) for part in _PARTS}
        others = {name: array for name, array in arrays.items() if name not in {_PREFIX + part for part in _PARTS}}
        return cls(**own, head=Network.from_arrays(others, activation))

    @classmethod
    def from_state_dict(cls, arrays: Mapping[str, Array32], activation: str) -> RecurrentNetwork:
        """Build the actor of sb3-contrib's ``MlpLstmPolicy`` with one LSTM layer; see :meth:`Network.from_state_dict`.

        Raises
        ------
        ValueError
            If a parameter of the actor is missing, or it has more than one LSTM layer.
        """
        if f"{_ACTOR}.weight_ih_l1" in arrays:
            raise ValueError(f"{_ACTOR} has more than one layer; train with n_lstm_layers=1.")
        own = {part: _found(arrays, f"{_ACTOR}.{part}_l0") for part in _PARTS}
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
