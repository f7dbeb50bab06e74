"""Trained policies, run by NumPy alone.

A folder with ``policy.safetensors``, and ``card.json`` with all it needs.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from cutenv._base.arrays import Array32, Indices
from cutenv._base.output import atomic_write
from cutenv._base.validation import one_of
from cutenv.agents.policy.actor_network import ACTIVATIONS, OUTPUTS, Network, RecurrentNetwork
from cutenv.agents.policy.interface import ArrayPolicy, script_of
from cutenv.sim.tissue.description import checked_fields
from cutenv.task.observation import DEAD_ZONE
from cutenv.task.registry import task_made_as

POLICY_SCHEMA = "cutenv-policy/1"
MEMORIES = (None, "lstm")
_LATER = {"memory": None, "output": "linear", "script": None, "hold": 1}  # fields that the first cards did not have
_SCALING = ("name", "unit", "scale", "offset")


def observation_scaling(environment: str = "cutenv/GentleCut-v1") -> list[dict[str, Any]]:
    """Return an environment's observation scaling: name, unit, scale, offset.

    The components are in order.
    """
    components = task_made_as(environment).task.all_components
    return [{key: getattr(component, key) for key in _SCALING} for component in components]


@dataclass(frozen=True, kw_only=True)
class PolicyCard:
    """JSON-serialisable description of a trained network, sufficient to run it.

    Parameters
    ----------
    environment : str
        Id of the environment in which it was trained, such as ``cutenv/GentleCut-v1``.
    environment_arguments : dict
        Arguments with which to make the environment, so that observations and actions mean the same as
        in training, such as ``{"control_hz": 10, "angle_mode": "free"}``.
    layers : tuple of int
        Widths of the network from input to output.
    activation : {"tanh", "relu"}
        Activation function after every layer but the last.
    output : {"linear", "tanh"}
        What follows the last layer: nothing, or tanh.  A card without this field has nothing.
    features : dict
        Keyword arguments of :class:`cutenv.agents.policy.features.Features`, or of the task's own class of features.
    sha256 : str
        SHA-256 of ``policy.safetensors``, in hexadecimal digits.
    training : dict
        Facts about the training: seed, decisions, versions, commit and the like; for information only.
    memory : {None, "lstm"}
        Recurrent part before the dense layers: none, or an LSTM of ``layers[1]`` units.  A card without this field
        has none.
    script : str, optional
        Script to whose action the network's is added.  Its action follows the features in what the network sees.
        Default: none; the network acts alone.
    hold : int
        Number of decisions for which what the network adds to the script's action is held.
    scaling : list of dict
        Name, unit, scale and offset of each component of the observation; default those of ``cutenv/GentleCut-v1``.

    Raises
    ------
    TypeError, ValueError
        If a value is out of range or not JSON-serialisable; names the field.
    """

    schema: ClassVar[str] = POLICY_SCHEMA

    environment: str
    environment_arguments: dict[str, Any]
    layers: tuple[int, ...]
    activation: str
    features: dict[str, Any]
    sha256: str
    training: dict[str, Any]
    memory: str | None = None
    output: str = "linear"
    script: str | None = None
    hold: int = 1
    scaling: list[dict[str, Any]] = dataclasses.field(default_factory=observation_scaling)

    def __post_init__(self) -> None:
        if not (isinstance(self.environment, str) and self.environment):
            raise TypeError(f"environment must be an id such as 'cutenv/GentleCut-v1', got {self.environment!r}.")
        if not (isinstance(self.sha256, str) and re.fullmatch("[0-9a-f]{64}", self.sha256)):
            raise ValueError(f"sha256 must be 64 hexadecimal digits, got {self.sha256!r}.")
        one_of("activation", self.activation, ACTIVATIONS)
        one_of("output", self.output, OUTPUTS)
        one_of("memory", self.memory, MEMORIES)
        if self.script is not None:
            one_of("script", self.script, task_made_as(self.environment).scripts)
        if type(self.hold) is not int or self.hold < 1:
            raise ValueError(f"hold must be a whole number of decisions, 1 or more, got {self.hold!r}.")
        if (self.script is None and self.hold > 1) or (self.script is not None and self.memory is not None):
            raise ValueError(
                f"script = {self.script!r} does not go with memory = {self.memory!r} and hold = {self.hold}: a network "
                "with a memory corrects no script, and what a network without a script does is not held."
            )
        kept: dict[str, Any] = {
            "environment_arguments": _mapping("environment_arguments", self.environment_arguments),
            "layers": _sizes(self.layers),
            "features": _mapping("features", self.features),
            "training": _mapping("training", self.training),
            "scaling": _plain("scaling", self.scaling),
        }
        for name, value in kept.items():
            object.__setattr__(self, name, value)

    def to_json(self) -> str:
        """Return JSON text, which :meth:`from_json` reads back exactly."""
        content = {"schema": POLICY_SCHEMA, **dataclasses.asdict(self)}
        for name, default in _LATER.items():
            if content[name] == default:
                del content[name]  # the same text as before this field existed
        return json.dumps(content, indent=1)

    @classmethod
    def from_json(cls, text: str) -> PolicyCard:
        """Parse the text of :meth:`to_json`.

        Raises
        ------
        TypeError, ValueError
            For another schema, an unknown or missing field, or an invalid value.
        """
        names = {field.name for field in dataclasses.fields(cls)}
        content = checked_fields(text, POLICY_SCHEMA, names | {"dead_zone"}, (*_LATER, "dead_zone"))
        if "dead_zone" in content:
            raise ValueError(
                f"dead_zone = {content['dead_zone']!r}: the policy had a dead zone of its own, which is the action's "
                f"now ({DEAD_ZONE:g}); its actions would mean other speeds. Train it again."
            )
        return cls(**content)


def check_scaling(scaling: list[dict[str, Any]], environment: str = "cutenv/GentleCut-v1") -> None:
    """Raise if an environment's observations are scaled differently in this version."""
    if not isinstance(scaling, list):
        raise TypeError(f"scaling must be a list with {', '.join(_SCALING)} of each component, got {scaling!r}.")
    components = task_made_as(environment).task.all_components
    for given, component, ours in itertools.zip_longest(scaling, components, observation_scaling(environment)):
        if given != ours:  # exactly: JSON keeps every digit
            name = f"component {component.name!r}" if component else f"a component after {components[-1].name!r}"
            raise ValueError(
                f"scaling: {name} is {given} in the card and {ours} in this version of cutenv. "
                "Use the version that the policy was trained with, or train it again."
            )


def _mapping(name: str, value: Any) -> dict[str, Any]:
    if not (isinstance(value, dict) and all(isinstance(key, str) for key in value)):
        raise TypeError(f"{name} must be a mapping with text as keys, got {value!r}.")
    copy: dict[str, Any] = _plain(name, value)
    return copy


def _plain(name: str, value: Any) -> Any:
    """Return a copy through JSON; raise ValueError if not serialisable."""
    try:
        return json.loads(json.dumps(value, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must hold what JSON can: {error}. Give finite plain numbers, text, lists.") from None


def _sizes(layers: Any) -> tuple[int, ...]:
    if not (isinstance(layers, (list, tuple)) and len(layers) > 1 and all(type(n) is int and n > 0 for n in layers)):
        raise ValueError(f"layers must be two or more positive whole numbers, from input to output, got {layers!r}.")
    return tuple(layers)


__all__ = ["PolicyCard", "TrainedPolicy", "observation_scaling", "save_policy"]


WEIGHTS, CARD = "policy.safetensors", "card.json"
_CURE = "Copy the whole folder again, or save the policy again with this version of cutenv."


class TrainedPolicy(ArrayPolicy):
    """A trained deterministic policy.

    Features, network, the script that it corrects if any, clipping to [-1, 1].

    :meth:`load` reads one from a folder that :func:`save_policy` wrote.

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
            raise ValueError(f"memory is {card.memory!r}, but the network has {kind}. {_CURE}")
        if network.sizes != card.layers:
            found = _shown(network.sizes)
            raise ValueError(f"layers is {_shown(card.layers)}, but the network's are {found}. {_CURE}")
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
        """Network from features to actions; its weights can start training."""
        return self._network

    @property
    def environment_arguments(self) -> dict[str, Any]:
        """Environment arguments that keep the training's observations and actions."""
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
        """Return actions, (n, 2), for observations, (n, 12) or the policy's own."""
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
        """Add the network's last or present correction to scripted actions, (n, k)."""
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
    environment, environment_arguments, features, training, script, hold
        Same as in :class:`PolicyCard`.
    replace : bool
        Whether a different policy in the folder is overwritten.

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
    """Build a card's features, the only user of their keywords."""
    try:
        return task_made_as(card.environment).features(count, **card.features)
    except (TypeError, ValueError) as error:
        raise ValueError(f"features {card.features} are not understood: {error} {_CURE}") from None


def _shown(sizes: tuple[int, ...]) -> str:
    return "-".join(map(str, sizes))


def _holds_same(path: Path, card: PolicyCard) -> bool:
    """Return True if ``path`` holds this card, apart from training facts."""
    try:
        kept = PolicyCard.from_json(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, TypeError, ValueError):
        return False
    return dataclasses.replace(kept, training={}) == dataclasses.replace(card, training={})


def _content(path: Path) -> bytes:
    if not path.is_file():
        raise FileNotFoundError(f"{path.parent} holds no {path.name}: not a policy, or not all of one. {_CURE}")
    return path.read_bytes()


def _write(path: Path, content: bytes) -> None:
    """Write a file atomically: an interruption leaves the earlier or none."""
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
    """Raise errors of the block again with the file's name."""
    try:
        yield
    except (TypeError, ValueError) as error:
        cure = "" if _CURE in str(error) else f" {_CURE}"
        raise ValueError(f"{path}: {error}{cure}") from None
