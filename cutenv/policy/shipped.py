"""The trained policies that come with the package, by name; and any policy by name or folder."""

from __future__ import annotations

from pathlib import Path

from cutenv._base import resources
from cutenv._base.validation import one_of
from cutenv.policy.policy_space import GENTLE_SPACE, space_of
from cutenv.policy.trained import CARD, TrainedPolicy

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
    return TrainedPolicy.load(resources.path(f"{_FOLDER}/{one_of('policy', name, SHIPPED)}"))


def named_policy(name: str | Path) -> TrainedPolicy:
    """Load a shipped policy by its name, or the one in a folder, as the command line accepts either.

    Raises
    ------
    ValueError
        If it is neither (the message lists the shipped ones), or the policy's files are damaged.
    FileNotFoundError
        If the folder lacks one of a policy's files.
    ModuleNotFoundError
        If safetensors is not installed.
    """
    if name in SHIPPED:
        return shipped(str(name))
    if not Path(name).is_dir():
        raise ValueError(
            f"policy {str(name)!r} is neither shipped ({', '.join(SHIPPED)}) nor the folder of one. "
            "Give such a name, or the folder that holds its card.json."
        )
    return TrainedPolicy.load(name)


def gentle_policy(name: str | Path) -> TrainedPolicy:
    """Load a policy as :func:`named_policy` does, if it is one of gentle cutting.

    Raises
    ------
    ValueError
        If it is not, and as :func:`named_policy`.
    FileNotFoundError, ModuleNotFoundError
        As :func:`named_policy`.
    """
    policy = named_policy(name)
    space = space_of(policy.card.environment)
    if space is not GENTLE_SPACE:
        raise ValueError(
            f"policy {str(name)!r} was trained in {policy.card.environment}, which has a third action, "
            f"{space.actions[2]}. Give one of cutenv/GentleCut-v1, or compare it by 'cutenv evaluate'."
        )
    return policy
