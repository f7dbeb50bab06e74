"""The policy card: everything needed to run a trained network, stored beside its weights."""

from __future__ import annotations

import dataclasses
import itertools
import json
import re
from dataclasses import dataclass
from typing import Any, ClassVar

from cutenv._base.validation import one_of
from cutenv.policy.actor_network import ACTIVATIONS, OUTPUTS
from cutenv.task.observation import DEAD_ZONE
from cutenv.task.registry import task_made_as
from cutenv.tissue.description import checked_fields

POLICY_SCHEMA = "cutenv-policy/1"
MEMORIES = (None, "lstm")
_LATER = {"memory": None, "output": "linear", "script": None, "hold": 1}  # fields that the first cards did not have
_SCALING = ("name", "unit", "scale", "offset")


def observation_scaling(environment: str = "cutenv/GentleCut-v1") -> list[dict[str, Any]]:
    """Return this version's scaling of an environment's observations: name, unit, scale and offset of each component.

    The components are in order.
    """
    components = task_made_as(environment).task.all_components
    return [{key: getattr(component, key) for key in _SCALING} for component in components]


@dataclass(frozen=True, kw_only=True)
class PolicyCard:
    """Description of a trained network, with all that is needed to run it; JSON-serialisable.

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
        Keyword arguments of :class:`cutenv.policy.features.Features`, or of the task's own class of features.
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
    """Raise if observations of an environment were scaled differently from this version of cutenv."""
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
    """Return a copy that went through JSON; raise ValueError if it is not serialisable."""
    try:
        return json.loads(json.dumps(value, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must hold what JSON can: {error}. Give finite plain numbers, text, lists.") from None


def _sizes(layers: Any) -> tuple[int, ...]:
    if not (isinstance(layers, (list, tuple)) and len(layers) > 1 and all(type(n) is int and n > 0 for n in layers)):
        raise ValueError(f"layers must be two or more positive whole numbers, from input to output, got {layers!r}.")
    return tuple(layers)
