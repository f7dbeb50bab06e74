"""Policies by name.

Baselines tuned on validation specimens, the trained ones of the package, and any by folder.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from importlib import import_module
from pathlib import Path

from cutenv._base import resources
from cutenv._base.imports import import_from_here
from cutenv._base.validation import nearest_choices, one_of
from cutenv.agents.policy.interface import Policy
from cutenv.agents.policy.planner import PlannerNominal, PlannerWithTruth
from cutenv.agents.policy.scripted import (
    ConstantFeed,
    FastThenSlow,
    ForceFeedback,
    InclineBetween,
    NoAction,
    OneReturnStroke,
    ProbeAndCreep,
    RandomAction,
)
from cutenv.agents.policy.trained import CARD, TrainedPolicy
from cutenv.task.registry import TASKS, task_made_as

GRID_SPEEDS = (0.10, 0.38, 0.89, 1.27, 1.65, 2.16, 2.54)
"""Speeds of the constant feeds [cm/s]: the seven at which the tissue was measured."""
GRID_ANGLES = (45, 60, 75, 90)
"""Angles of the constant feeds [deg]."""

SCRIPTS: dict[str, Callable[[], Policy]] = {
    "fast then slow": FastThenSlow,
    "90-45-90": InclineBetween,
    "force feedback": ForceFeedback,
    "probe and creep": ProbeAndCreep,
    "return stroke": OneReturnStroke,
    "planner (nominal)": PlannerNominal,
}
"""Scripts that an engineer would program, besides the constant feeds."""
ORACLE = "planner with truth"
"""Name of the oracle: it knows the hidden state and does not compete."""
NULL_POLICIES: dict[str, Callable[[], Policy]] = {"random": RandomAction, "nothing": NoAction}


def feed_name(speed_cm_s: float, angle_deg: float) -> str:
    """Return the name of a constant feed."""
    return f"constant {speed_cm_s:.2f} cm/s {angle_deg:.0f} deg"


CONSTANT_FEEDS: dict[str, tuple[float, float]] = {
    feed_name(speed, angle): (speed, angle) for speed in GRID_SPEEDS for angle in GRID_ANGLES
}
"""Speed [cm/s] and angle [deg] of each constant feed, by name."""


def _feed(speed_cm_s: float, angle_deg: float) -> Callable[[], Policy]:
    return lambda: ConstantFeed(speed=speed_cm_s / 100.0, angle=math.radians(angle_deg))


BASELINES: dict[str, Callable[[], Policy]] = {
    **{name: _feed(*feed) for name, feed in CONSTANT_FEEDS.items()},
    **SCRIPTS,
    ORACLE: PlannerWithTruth,
    **NULL_POLICIES,
}
"""All baselines by name; call a value to make the policy."""


_FOLDER = "policies"

SHIPPED = tuple(sorted(card.parent.name for card in resources.path(_FOLDER).glob(f"*/{CARD}")))
"""Names of the policies in ``assets/policies``."""
DEFAULT_SHIPPED = "ppo-free"
"""Name of the policy that is demonstrated by default."""


def shipped(name: str) -> TrainedPolicy:
    """Load a trained policy that comes with the package.

    Parameters
    ----------
    name : str
        One of :data:`SHIPPED`, such as ``"ppo-free"``: PPO of ``cutenv train``, free angle, ten decisions a second.

    Raises
    ------
    ValueError
        If there is none of that name (the nearest is named), or its files are damaged.
    ModuleNotFoundError
        If safetensors is not installed.
    """
    return TrainedPolicy.load(_shipped_folder(one_of("policy", name, SHIPPED)))


def _shipped_folder(name: str) -> Path:
    return resources.path(f"{_FOLDER}/{name}")


def experts(task: str) -> tuple[str, ...]:
    """Return the names of the oracle and of the shipped policies that can cut in a task.

    A policy can if it was trained in a task with the same law and actions: ``"ppo-excision"`` in ``"path"``.

    Raises
    ------
    ValueError
        If there is no such task.
    """
    environments = {name: json.loads((_shipped_folder(name) / CARD).read_bytes())["environment"] for name in SHIPPED}
    same = TASKS[one_of("task", task, tuple(TASKS))].task
    return ORACLE, *(name for name, environment in environments.items() if task_made_as(environment).task is same)


def policy_folder(name: str | Path) -> Path:
    """Return a policy's folder, also from its training run's folder."""
    inside = Path(name, "policy")
    return inside if (inside / CARD).is_file() else Path(name)


def named_folder(name: str | Path) -> Path | None:
    """Return the folder of :func:`named_policy`'s policy, or None."""
    if name in SHIPPED:
        return _shipped_folder(str(name))
    return policy_folder(name) if Path(name).is_dir() else None


def policy_of_class(name: str) -> Policy | None:
    """Make a policy of a user's own class, named ``MODULE:CLASS``.

    It is None if the name has not that form. The module is one in the present folder or an installed one. The class may
    tell in ``environment_arguments`` with which keywords its environment is made, such as ``{"control_hz": 10}``, and
    in ``files`` which files it reads, relative to the present folder: they are part of an entry on the leaderboard.

    Raises ValueError if there is no such module or class; tells why.
    """
    module, colon, made = name.partition(":")
    if not (colon and module.replace(".", "").isidentifier()):
        return None
    import_from_here()
    try:
        own: Policy = getattr(import_module(module), made)()
    except (ImportError, AttributeError) as error:
        raise ValueError(f"policy {name!r}: {error}. Give MODULE:CLASS, of a module in this folder.") from error
    return own


def named_policy(name: str | Path) -> TrainedPolicy:
    """Load a policy by shipped name, own folder or training run.

    Raises
    ------
    ValueError
        If it is neither (the message names the nearest), or the policy's files are damaged.
    FileNotFoundError
        If the folder lacks one of a policy's files.
    ModuleNotFoundError
        If safetensors is not installed.
    """
    folder = named_folder(name)
    if folder is None:
        raise ValueError(
            f"policy {str(name)!r} is neither shipped nor the folder of one.{nearest_choices(name, SHIPPED, most=3)} "
            "'cutenv evaluate --list' prints the names; a folder is the one that holds its card.json."
        )
    return TrainedPolicy.load(folder)


def gentle_policy(name: str | Path) -> TrainedPolicy:
    """Load a gentle-cutting policy as :func:`named_policy` does.

    Raises
    ------
    ValueError
        If it is not, and as :func:`named_policy`.
    FileNotFoundError, ModuleNotFoundError
        As :func:`named_policy`.
    """
    policy = named_policy(name)
    task = task_made_as(policy.card.environment)
    if task is not TASKS["gentle"]:
        raise ValueError(
            f"policy {str(name)!r} was trained in {policy.card.environment}, which has a third action, "
            f"{task.task.action_names[2]}. Give one of cutenv/GentleCut-v1, or compare it by 'cutenv evaluate'."
        )
    return policy
