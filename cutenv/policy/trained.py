"""Trained policies: a folder with ``policy.safetensors`` and ``card.json``, run without a learning library."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.arrays import Array32, Indices
from cutenv._base.atomic_file import atomic_write
from cutenv.policy.actor_network import Network
from cutenv.policy.interface import ArrayPolicy, script_of
from cutenv.policy.policy_card import PolicyCard, check_scaling, observation_scaling
from cutenv.policy.recurrent import RecurrentNetwork
from cutenv.task.registry import task_made_as

__all__ = ["PolicyCard", "TrainedPolicy", "observation_scaling", "save_policy"]


WEIGHTS, CARD = "policy.safetensors", "card.json"
_AGAIN = "Copy the whole folder again, or save the policy again with this version of cutenv."


class TrainedPolicy(ArrayPolicy):
    """A trained deterministic policy: features, network, the script that it corrects if any, clipping to [-1, 1].

    :meth:`load` reads one from a folder that :func:`save_policy` wrote.

    Parameters
    ----------
    card : PolicyCard
        Description of the network.
    network : Network or RecurrentNetwork
        Network from features to action.

    Raises
    ------
    ValueError
        If the card does not fit the network or this version of observation or features.
    """

    def __init__(self, card: PolicyCard, network: Network | RecurrentNetwork) -> None:
        check_scaling(card.scaling, card.environment)
        self._card, self._network = card, network
        task = task_made_as(card.environment)
        size = _features(card, 1).size + (0 if card.script is None else len(task.task.action_names))
        if isinstance(network, RecurrentNetwork) != (card.memory is not None):
            kind = "one" if isinstance(network, RecurrentNetwork) else "none"
            raise ValueError(f"memory is {card.memory!r}, but the network has {kind}. {_AGAIN}")
        if network.sizes != card.layers:
            found = _shown(network.sizes)
            raise ValueError(f"layers is {_shown(card.layers)}, but the network's are {found}. {_AGAIN}")
        needed = (size, len(task.task.action_names))
        if (network.sizes[0], network.sizes[-1]) != needed:
            raise ValueError(
                f"layers is {_shown(card.layers)}; with features {card.features} it must begin with {needed[0]} and "
                f"end with {needed[1]}. Train with the features that the card names."
            )
        self._script = None if card.script is None else script_of(task, card.script)
        self.begin([np.random.default_rng()])

    @property
    def card(self) -> PolicyCard:
        """Description of the policy."""
        return self._card

    @property
    def network(self) -> Network | RecurrentNetwork:
        """The network from features to actions; its weights can initialise further training."""
        return self._network

    @property
    def environment_arguments(self) -> dict[str, Any]:
        """Arguments for making the environment, so that observations and actions mean the same as in training."""
        return dict(self._card.environment_arguments)

    def begin(self, rngs: Sequence[np.random.Generator]) -> None:
        """Forget all cuts, and begin ``len(rngs)``; the policy uses no randomness."""
        count = len(rngs)
        if self._script is not None:
            self._script.begin(rngs)
        self._features = _features(self._card, count)
        self._added = np.zeros((count, len(task_made_as(self._card.environment).task.action_names)), np.float32)
        self._decided = np.zeros(count, int)
        self._state = self._network.start(count) if isinstance(self._network, RecurrentNetwork) else None

    def forget(self, cuts: Indices) -> None:
        """Begin those cuts again that are given by index."""
        self._features.forget(cuts)
        self._decided[cuts] = 0
        if self._script is not None:
            self._script.forget(cuts)
        for values in self._state or ():
            values[cuts] = 0.0

    def act(self, observations: Array32) -> Array32:
        """Return the actions, shape (n, 2), for the observations of all cuts, shape (n, 12), or those of its space."""
        features = self._features(observations)
        if self._script is not None:
            return self._corrected(self._script.act(observations), features)
        if isinstance(self._network, RecurrentNetwork):
            assert self._state is not None
            actions, self._state = self._network(features, self._state)
        else:
            actions = self._network(features)
        return _clipped(actions)

    def _corrected(self, scripted: Array32, features: Array32) -> Array32:
        """Add to the script's actions, shape (n, k), what the network thought of last, or thinks of now."""
        due = self._decided % self._card.hold == 0
        self._decided += 1
        if due.any():
            assert isinstance(self._network, Network)
            self._added[due] = _clipped(self._network(np.concatenate([features[due], scripted[due]], axis=1)))
        return _clipped(scripted + self._added)

    @classmethod
    def load(cls, folder: str | Path) -> TrainedPolicy:
        """Load a policy from its folder.

        Raises
        ------
        FileNotFoundError
            If the folder or one of its two files is missing.
        ValueError
            If a file is damaged, was changed, or does not fit the other or this version of cutenv; names the file.
        ModuleNotFoundError
            If safetensors is not installed.
        """
        folder = Path(folder)
        if not folder.is_dir():
            raise FileNotFoundError(f"{folder} is not a folder; give one that holds {CARD} and {WEIGHTS}.")
        with _named(folder / CARD):
            card = PolicyCard.from_json(_content(folder / CARD).decode())
        content = _content(folder / WEIGHTS)
        with _named(folder / WEIGHTS):
            found = hashlib.sha256(content).hexdigest()
            if found != card.sha256:
                raise ValueError(
                    f"its SHA-256 is {found}, but {CARD} has {card.sha256}: changed or damaged since it was saved."
                )
            arrays = _unpacked(content)
            network: Network | RecurrentNetwork
            if card.memory is None:
                network = Network.from_arrays(arrays, card.activation, card.output)
            else:
                network = RecurrentNetwork.from_arrays(arrays, card.activation)
        with _named(folder / CARD):
            return cls(card, network)


def save_policy(
    folder: str | Path,
    network: Network | RecurrentNetwork,
    *,
    environment: str,
    environment_arguments: Mapping[str, Any],
    features: Mapping[str, Any],
    training: Mapping[str, Any],
    script: str | None = None,
    hold: int = 1,
    replace: bool = False,
) -> PolicyCard:
    """Save a policy as a folder that :meth:`TrainedPolicy.load` reads.

    The card is written last: a folder without one was left by an interruption and is not a policy.

    Parameters
    ----------
    folder : path
        Created if missing.  It may hold the same policy already, also with other facts about its training.
    network : Network or RecurrentNetwork
        Network from features to action.
    environment, environment_arguments, features, training, script, hold
        Same as in :class:`PolicyCard`.
    replace : bool
        Whether a different policy in the folder is overwritten.

    Returns
    -------
    PolicyCard
        The card as written.

    Raises
    ------
    FileExistsError
        If the folder holds a different policy.
    TypeError, ValueError
        If the saved policy could not be loaded; nothing is written.
    ModuleNotFoundError
        If safetensors is not installed.
    """
    content: bytes = _safetensors().save(network.to_arrays())
    card = PolicyCard(
        environment=environment,
        environment_arguments=dict(environment_arguments),
        layers=network.sizes,
        activation=network.activation,
        features=dict(features),
        sha256=hashlib.sha256(content).hexdigest(),
        training=dict(training),
        memory="lstm" if isinstance(network, RecurrentNetwork) else None,
        output="linear" if isinstance(network, RecurrentNetwork) else network.output,
        script=script,
        hold=hold,
        scaling=observation_scaling(environment),
    )
    TrainedPolicy(card, network)  # raises now what loading would raise
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if not _holds_same(folder / CARD, card):
        if (folder / CARD).exists() and not replace:
            raise FileExistsError(
                f"{folder / CARD} belongs to a different policy; give another folder, or replace=True to overwrite it."
            )
        (folder / CARD).unlink(missing_ok=True)  # never the old card beside the new weights
    _write(folder / WEIGHTS, content)
    _write(folder / CARD, (card.to_json() + "\n").encode())
    return card


def _clipped(actions: Array32) -> Array32:
    return np.clip(actions, np.float32(-1.0), np.float32(1.0))


def _features(card: PolicyCard, count: int) -> Any:
    """Build the features described by a card; the only place that knows their keywords."""
    try:
        return task_made_as(card.environment).features(count, **card.features)
    except (TypeError, ValueError) as error:
        raise ValueError(f"features {card.features} are not understood: {error} {_AGAIN}") from None


def _shown(sizes: tuple[int, ...]) -> str:
    return "-".join(map(str, sizes))


def _holds_same(path: Path, card: PolicyCard) -> bool:
    """Return True if the card at ``path`` describes the same policy, apart from facts about its training."""
    try:
        kept = PolicyCard.from_json(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, TypeError, ValueError):
        return False
    return dataclasses.replace(kept, training={}) == dataclasses.replace(card, training={})


def _content(path: Path) -> bytes:
    if not path.is_file():
        raise FileNotFoundError(f"{path.parent} holds no {path.name}: not a policy, or not all of one. {_AGAIN}")
    return path.read_bytes()


def _write(path: Path, content: bytes) -> None:
    """Write a file atomically: an interruption leaves the earlier one, or none."""
    with atomic_write(path) as part:
        part.write_bytes(content)


def _unpacked(content: bytes) -> dict[str, Array32]:
    library = _safetensors()
    from safetensors import SafetensorError

    try:
        arrays: dict[str, Array32] = library.load(content)
    except (SafetensorError, KeyError) as error:  # KeyError: a dtype that NumPy does not have
        raise ValueError(f"not a safetensors file of NumPy's numbers: {error}.") from None
    return arrays


def _safetensors() -> Any:
    try:
        import safetensors.numpy  # an extra
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            "Trained policies are stored with safetensors, which is not installed: pip install 'cutenv[rl]'",
            name="safetensors",
        ) from None
    return safetensors.numpy


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Raise errors of the block again with the name of the file."""
    try:
        yield
    except (TypeError, ValueError) as error:
        cure = "" if _AGAIN in str(error) else f" {_AGAIN}"
        raise ValueError(f"{path}: {error}{cure}") from None
