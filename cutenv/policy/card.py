"""What must be known of a trained network to act with it: the card beside its weights."""

from __future__ import annotations

import dataclasses
import itertools
import json
import re
from dataclasses import dataclass
from typing import Any, ClassVar

from cutenv.policy.network import ACTIVATIONS
from cutenv.task.observation import COMPONENTS
from cutenv.tissue.description import checked_fields
from cutenv.validation import in_range, one_of

SCHEMA = "cutenv-policy/1"
MEMORIES = (None, "lstm")
_SCALING = ("name", "unit", "scale", "offset")


def observation_scaling() -> list[dict[str, Any]]:
    """How this version of cutenv scales an observation: name, unit, scale and offset of its numbers, in order."""
    return [{key: getattr(component, key) for key in _SCALING} for component in COMPONENTS]


@dataclass(frozen=True, kw_only=True)
class PolicyCard:
    """What must be known of a network to act with it; all values as JSON holds them.

    Parameters
    ----------
    environment : str
        Id of the environment that it was trained in, such as ``cutenv/GentleCut-v1``.
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
    memory : {None, "lstm"}
        What remembers before the dense layers: nothing, or a long short-term memory of ``layers[1]`` units.  A card
        without this field has none.
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
    memory: str | None = None
    scaling: list[dict[str, Any]] = dataclasses.field(default_factory=observation_scaling)

    def __post_init__(self) -> None:
        if not (isinstance(self.environment, str) and self.environment):
            raise TypeError(f"environment must be an id such as 'cutenv/GentleCut-v1', got {self.environment!r}.")
        if not (isinstance(self.sha256, str) and re.fullmatch("[0-9a-f]{64}", self.sha256)):
            raise ValueError(f"sha256 must be 64 hexadecimal digits, got {self.sha256!r}.")
        one_of("activation", self.activation, ACTIVATIONS)
        one_of("memory", self.memory, MEMORIES)
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
        content = {"schema": SCHEMA, **dataclasses.asdict(self)}
        if self.memory is None:
            del content["memory"]  # as cards were before there was a memory
        return json.dumps(content, indent=1)

    @classmethod
    def from_json(cls, text: str) -> PolicyCard:
        """Read :meth:`to_json`'s text.

        Raises
        ------
        TypeError, ValueError
            For another schema, an unknown or a missing field, or a value that is refused.
        """
        return cls(**checked_fields(text, SCHEMA, {field.name for field in dataclasses.fields(cls)}, ("memory",)))


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
