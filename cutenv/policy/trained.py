"""A trained policy as a folder, ``policy.safetensors`` and ``card.json``, run without a learning library."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from cutenv.atomic import replacing
from cutenv.policy.features import Features, past_dead_zone
from cutenv.policy.network import ACTIVATIONS, Network
from cutenv.task.observation import COMPONENTS, checked_observation
from cutenv.tissue.description import checked_fields
from cutenv.validation import in_range, one_of

Array32 = NDArray[np.float32]

SCHEMA = "cutenv-policy/1"
WEIGHTS, CARD = "policy.safetensors", "card.json"
_ACTIONS = 2
_SCALING = ("name", "unit", "scale", "offset")
_AGAIN = "Copy the whole folder again, or save the policy again with this version of cutenv."


def observation_scaling() -> list[dict[str, Any]]:
    """How this version of cutenv scales an observation: name, unit, scale and offset of its numbers, in order."""
    return [{key: getattr(component, key) for key in _SCALING} for component in COMPONENTS]


@dataclass(frozen=True, kw_only=True)
class PolicyCard:
    """What must be known of a network to act with it; all values as JSON holds them.

    Parameters
    ----------
    environment : str
        Id of the environment that it was trained in, such as ``cutenv/GentleCut-v0``.
    environment_arguments : dict
        With what an environment must be made so that observations and actions mean the same, such as
        ``{"control_hz": 10, "angle_mode": "free"}``.
    layers : tuple of int
        How many numbers stand between the network's layers, from input to output.
    activation : {"tanh", "relu"}
        After every layer but the last.
    features : dict
        Keywords of :class:`cutenv.policy.features.Features`.
    dead_zone : float
        Share of the speed's action that means rest, 0 to 0.9 [1].
    sha256 : str
        Of ``policy.safetensors``, in hexadecimal digits.
    training : dict
        Facts about the training: seed, decisions, versions, commit and the like.  Nothing depends on them.
    scaling : list of dict
        Name, unit, scale and offset of the observation's numbers; default :func:`observation_scaling`.

    Raises
    ------
    TypeError, ValueError
        If a value is out of range or cannot be held by JSON; names the field.
    """

    schema: ClassVar[str] = SCHEMA

    environment: str
    environment_arguments: dict[str, Any]
    layers: tuple[int, ...]
    activation: str
    features: dict[str, Any]
    dead_zone: float
    sha256: str
    training: dict[str, Any]
    scaling: list[dict[str, Any]] = dataclasses.field(default_factory=observation_scaling)

    def __post_init__(self) -> None:
        if not (isinstance(self.environment, str) and self.environment):
            raise TypeError(f"environment must be an id such as 'cutenv/GentleCut-v0', got {self.environment!r}.")
        if not (isinstance(self.sha256, str) and re.fullmatch("[0-9a-f]{64}", self.sha256)):
            raise ValueError(f"sha256 must be 64 hexadecimal digits, got {self.sha256!r}.")
        one_of("activation", self.activation, ACTIVATIONS)
        kept: dict[str, Any] = {
            "environment_arguments": _mapping("environment_arguments", self.environment_arguments),
            "layers": _sizes(self.layers),
            "features": _mapping("features", self.features),
            "dead_zone": in_range("dead_zone", self.dead_zone, 0.0, 0.9, "1", "A quarter is 0.25."),
            "training": _mapping("training", self.training),
            "scaling": _plain("scaling", self.scaling),
        }
        for name, value in kept.items():
            object.__setattr__(self, name, value)

    def to_json(self) -> str:
        """JSON text, read back exactly by :meth:`from_json`."""
        return json.dumps({"schema": SCHEMA, **dataclasses.asdict(self)}, indent=1)

    @classmethod
    def from_json(cls, text: str) -> PolicyCard:
        """Read :meth:`to_json`'s text.

        Raises
        ------
        TypeError, ValueError
            For another schema, an unknown or a missing field, or a value that is refused.
        """
        return cls(**checked_fields(text, SCHEMA, {field.name for field in dataclasses.fields(cls)}))


class TrainedPolicy:
    """A trained network that acts without chance: features, network, clipped to [-1, 1], past the dead zone.

    :meth:`load` reads one from a folder that :func:`save_policy` wrote.

    Parameters
    ----------
    card : PolicyCard
        What must be known of the network.
    network : Network
        From features to the action.

    Raises
    ------
    ValueError
        If the card belongs to another network or to another version of observation or features.
    """

    def __init__(self, card: PolicyCard, network: Network) -> None:
        check_scaling(card.scaling)
        self._card, self._network = card, network
        self._features = _features(card)
        if network.sizes != card.layers:
            found = _shown(network.sizes)
            raise ValueError(f"layers is {_shown(card.layers)}, but the network's are {found}. {_AGAIN}")
        needed = (self._features.size, _ACTIONS)
        if (network.sizes[0], network.sizes[-1]) != needed:
            raise ValueError(
                f"layers is {_shown(card.layers)}; with features {card.features} it must begin with {needed[0]} and "
                f"end with {needed[1]}. Train with the features that the card names."
            )

    @property
    def card(self) -> PolicyCard:
        """What is known of the policy."""
        return self._card

    @property
    def environment_arguments(self) -> dict[str, Any]:
        """With what an environment must be made so that observations and actions mean the same."""
        return dict(self._card.environment_arguments)

    def reset(self, rng: np.random.Generator) -> None:
        """Forget the last cut; ``rng`` is not used."""
        self._features.reset()

    def __call__(self, observation: Array32) -> Array32:
        """The action, shape (2,), for an observation, shape (12,), of the cut since :meth:`reset`."""
        checked_observation(observation)
        action = np.clip(self._network(self._features(observation)), np.float32(-1.0), np.float32(1.0))
        return past_dead_zone(action, self._card.dead_zone)

    @classmethod
    def load(cls, folder: str | Path) -> TrainedPolicy:
        """Read a policy from its folder.

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
                    f"its SHA-256 is {found}, but {CARD} says {card.sha256}: changed or damaged since it was saved."
                )
            network = Network.from_arrays(_unpacked(content), card.activation)
        with _named(folder / CARD):
            return cls(card, network)


def save_policy(
    folder: str | Path,
    network: Network,
    *,
    environment: str,
    environment_arguments: Mapping[str, Any],
    features: Mapping[str, Any],
    dead_zone: float,
    training: Mapping[str, Any],
    replace: bool = False,
) -> PolicyCard:
    """Write a policy as a folder that :meth:`TrainedPolicy.load` reads.

    The card comes last: a folder without one is not a policy, but what an interruption left.

    Parameters
    ----------
    folder : path
        Made if it is missing.  The same policy may be there already, also with other facts about its training.
    network : Network
        From features to the action.
    environment, environment_arguments, features, dead_zone, training
        As in :class:`PolicyCard`.
    replace : bool
        Whether a different policy in the folder is overwritten.

    Returns
    -------
    PolicyCard
        As written.

    Raises
    ------
    FileExistsError
        If a different policy is there.
    TypeError, ValueError
        If the policy could not be loaded again; nothing is written.
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
        dead_zone=dead_zone,
        sha256=hashlib.sha256(content).hexdigest(),
        training=dict(training),
    )
    TrainedPolicy(card, network)  # refuses now what loading would refuse
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


def check_scaling(scaling: list[dict[str, Any]]) -> None:
    """Refuse an observation that is scaled in another way than this version of cutenv scales it."""
    if not isinstance(scaling, list):
        raise TypeError(f"scaling must be a list with {', '.join(_SCALING)} of each component, got {scaling!r}.")
    for given, component, ours in itertools.zip_longest(scaling, COMPONENTS, observation_scaling()):
        if given != ours:  # exactly: JSON keeps every digit
            name = f"component {component.name!r}" if component else f"a component after {COMPONENTS[-1].name!r}"
            raise ValueError(
                f"scaling: {name} is {given} in the card and {ours} in this version of cutenv. "
                "Use the version that the policy was trained with, or train it again."
            )


def _features(card: PolicyCard) -> Features:
    """The features that a card names: the one place that knows their keywords."""
    try:
        return Features(**card.features)
    except (TypeError, ValueError) as error:
        raise ValueError(f"features {card.features} are not understood: {error} {_AGAIN}") from None


def _mapping(name: str, value: Any) -> dict[str, Any]:
    if not (isinstance(value, dict) and all(isinstance(key, str) for key in value)):
        raise TypeError(f"{name} must be a mapping with text as keys, got {value!r}.")
    copy: dict[str, Any] = _plain(name, value)
    return copy


def _plain(name: str, value: Any) -> Any:
    """A copy, as JSON gives it back."""
    try:
        return json.loads(json.dumps(value, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must hold what JSON can: {error}. Give finite plain numbers, text, lists.") from None


def _sizes(layers: Any) -> tuple[int, ...]:
    if not (isinstance(layers, (list, tuple)) and len(layers) > 1 and all(type(n) is int and n > 0 for n in layers)):
        raise ValueError(f"layers must be two or more positive whole numbers, from input to output, got {layers!r}.")
    return tuple(layers)


def _shown(sizes: tuple[int, ...]) -> str:
    return "-".join(map(str, sizes))


def _holds_same(path: Path, card: PolicyCard) -> bool:
    """Whether a card acts as another does, whatever it tells of its training."""
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
    """Write a file all at once: an interruption leaves the earlier one, or none."""
    with replacing(path) as part:
        part.write_bytes(content)


def _unpacked(content: bytes) -> dict[str, Array32]:
    library = _safetensors()
    from safetensors import SafetensorError

    try:
        arrays: dict[str, Array32] = library.load(content)
    except (SafetensorError, KeyError) as error:  # KeyError: a kind of number that NumPy does not have
        raise ValueError(f"not a safetensors file of NumPy's numbers: {error}.") from None
    return arrays


def _safetensors() -> Any:
    try:
        import safetensors.numpy  # an extra
    except ModuleNotFoundError:
        raise ModuleNotFoundError(
            "Trained policies are kept with safetensors, which is not installed: pip install 'cutenv[rl]'",
            name="safetensors",
        ) from None
    return safetensors.numpy


@contextmanager
def _named(path: Path) -> Iterator[None]:
    """Say of what is wrong in which file it is."""
    try:
        yield
    except (TypeError, ValueError) as error:
        cure = "" if _AGAIN in str(error) else f" {_AGAIN}"
        raise ValueError(f"{path}: {error}{cure}") from None
