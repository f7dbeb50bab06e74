"""Minari data sets of cuts, with the force in newtons.

The cuts are by a script, a trained agent or a person.

``minari.load_dataset(id)`` reads a data set, and ``recover_environment()`` makes its environment; reset there with an
episode's seed, a simulated cut's actions give the recorded rewards again.  :func:`cloning_data` turns a data set into
features and actions for behaviour cloning.
"""

from __future__ import annotations

import inspect
import json
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

import cutenv
from cutenv._base.output import watched
from cutenv.agents.learning.demonstration import (
    ESTIMATED,
    FELT,
    HIDDEN,
    INTERVENED,
    Demonstration,
    infos_of,
    recorded,
    simulated,
)
from cutenv.agents.learning.evaluation import contestant
from cutenv.agents.learning.seeds import ENVIRONMENT
from cutenv.agents.policy import Features
from cutenv.agents.policy.trained import observation_scaling
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.records import load
from cutenv.task.observation import COMPONENTS
from cutenv.task.registry import RegisteredTask, task_of

if TYPE_CHECKING:
    from minari import MinariDataset

_UNSET = "`(author|author_email|code_permalink|eval_env)` is set to None"  # Minari warns of each


def meanings_of(task: RegisteredTask, source: str, cut: Demonstration) -> dict[str, Any]:
    """Return source, and meaning of observations and actions, for a data set's metadata."""
    actions = ["target speed: 0 within 0.1, 2.54 cm/s at 1", "(target angle - 67.5 deg) / 22.5 deg"]
    if (axis := task.task.axis) is not None:
        actions.append(f"{axis.meaning}: 0 within 0.1, then {axis.shown} {axis.unit}")
    return {
        "source": source,
        "observations": observation_scaling(task.id),  # value = number x scale + offset
        "actions": actions,
        "actions_are": "commands" if cut.seed is not None else "motion of the blade until the next decision",
    }


def simulated_cuts(
    policy: str, environment: Mapping[str, Any], seeds: Sequence[int]
) -> tuple[dict[str, Any], list[Demonstration]]:
    """Let a policy, by name or folder, cut one specimen for each seed.

    Return the environment's keyword arguments, those that the policy was trained with taking precedence, and the cuts.

    Raises ValueError if there is no such policy.
    """
    chosen = contestant(policy)
    keywords = {**environment, **chosen.arguments}
    task, own = task_of(keywords)
    env = gymnasium.make(task.id, **own)
    return keywords, [simulated(env, chosen.policy, seed) for seed in watched(seeds, "cutting", "cut")]


def recorded_cuts(
    paths: Sequence[str | Path], environment: Mapping[str, Any], target_length: float | None
) -> tuple[dict[str, Any], list[Demonstration]]:
    """Make demonstrations of the cuts in these files; see :func:`simulated_cuts`.

    The ``environment`` has ``control_hz``; its reward is computed from estimates, as it is on a rig.  ``target_length``
    [m] is for records that have none of their own.

    Raises ValueError if a record lacks what is needed; the message names file, cut and field.
    """
    found = []
    for path in watched(paths, "reading", "file"):
        for number, trace in enumerate(load(Path(path)), 1):
            try:
                made = recorded(trace, control_hz=environment["control_hz"], target_length=target_length)
            except ValueError as error:
                raise ValueError(f"{path}, cut {number}: {error}") from None
            made.about.setdefault("record", Path(path).name)
            found.append(made)
    shared = ["is_intervention" in cut.infos for cut in found]
    if any(shared) and not all(shared):
        others = ", ".join(str(cut.about["record"]) for cut, told in zip(found, shared, strict=True) if not told)
        raise ValueError(
            f"some records were shared with an agent, and {others} not: give them for two data sets, for in one every "
            "decision says who led."
        )
    return {**environment, "reward_from": "estimate"}, found


def write(
    dataset_id: str, source: str, keywords: dict[str, Any], demonstrations: Sequence[Demonstration]
) -> MinariDataset:
    """Write cuts, all by policies or all recorded, as a data set.

    Units and meanings go into its metadata, below "cutenv".  The id has a version, such as
    ``cutenv/probe-and-creep-v0``; ``source`` is the policy or person that cut, for readers.

    Raises FileExistsError if there is a data set of that id.
    """
    from minari import create_dataset_from_buffers
    from minari.data_collector import EpisodeBuffer

    free_folder(dataset_id)
    is_simulated = demonstrations[0].seed is not None
    buffers = [
        EpisodeBuffer(
            seed=cut.seed,
            observations=cut.observations,
            actions=cut.actions,
            rewards=cut.rewards.tolist(),
            terminations=[False] * (len(cut.rewards) - 1) + [cut.terminated],
            truncations=[False] * (len(cut.rewards) - 1) + [not cut.terminated],
            infos=cut.infos,
        )
        for cut in demonstrations
    ]
    task, own = task_of(keywords)
    env = gymnasium.make(task.id, **own)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=_UNSET)
        dataset = create_dataset_from_buffers(
            dataset_id,
            buffers,
            env=env,
            algorithm_name=source,
            description=f"Gentle cutting of measured liver by {source}; the force in newtons is in the infos.",
            requirements=[f"cutenv=={cutenv.__version__}"],
        )
    dataset.storage.update_episode_metadata({"about": json.dumps(cut.about)} for cut in demonstrations)
    dataset.storage.update_metadata(
        {
            "cutenv": {
                **meanings_of(task, source, demonstrations[0]),
                "infos": FELT
                | (HIDDEN if is_simulated else ESTIMATED)
                | infos_of(task.id).meanings
                | (INTERVENED if "is_intervention" in demonstrations[0].infos else {}),
            }
        }
    )
    return dataset


def opened(dataset_id: str) -> MinariDataset:
    """Open a data set that is on this machine.

    Raises ValueError if there is none of that id, or Minari is not installed.
    """
    try:
        import minari
    except ModuleNotFoundError:
        raise ValueError("a data set needs Minari: pip install 'cutenv[data]'.") from None
    try:
        return minari.load_dataset(dataset_id)
    except FileNotFoundError:
        raise ValueError(
            f"there is no data set {dataset_id!r} where Minari keeps them; record one with 'cutenv datasets', or set "
            "MINARI_DATASETS_PATH to their folder."
        ) from None


def environment_of(dataset: MinariDataset) -> dict[str, Any]:
    """Return a data set's environment arguments: decision rate and angle.

    Raises ValueError if the data set belongs to no environment of this package.
    """
    spec = dataset.env_spec
    if spec is None or spec.id != ENVIRONMENT:
        raise ValueError(
            f"data set {dataset.id!r} is of environment {None if spec is None else spec.id}; give one of {ENVIRONMENT}."
        )
    defaults = inspect.signature(GentleCutEnv).parameters
    names = ["control_hz", "angle_mode"]
    if spec.kwargs.get("angle_mode") == "fixed":
        names.append("fixed_angle_deg")
    return {name: spec.kwargs.get(name, defaults[name].default) for name in names}


def cloning_data(dataset: MinariDataset, *, history: int, force: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """Return features, (n, size), and actions, (n, 2), for cloning.

    ``filter_episodes`` of the data set selects some cuts; for the rest see :class:`cutenv.agents.policy.Features`.

    Raises ValueError if its observations are not those of cutenv, or it contains no decision.
    """
    cuts = list(cloning_data_by_cut(dataset, history=history, force=force))
    if not cuts:
        raise ValueError(f"data set {dataset.id!r} contains no cut; record some, or filter fewer away.")
    features, actions = zip(*cuts, strict=True)
    return np.concatenate(features), np.concatenate(actions)


def cloning_data_by_cut(
    dataset: MinariDataset, *, history: int, force: bool = True
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield :func:`cloning_data` of every cut, for a network with memory."""
    if dataset.observation_space.shape != (len(COMPONENTS),):
        raise ValueError(
            f"data set {dataset.id!r} has observations of shape {dataset.observation_space.shape}; those of cutenv "
            f"have ({len(COMPONENTS)},). Give one that 'cutenv datasets' wrote."
        )
    features = Features(history=history, force=force)
    for cut in dataset.iterate_episodes():
        features.reset()
        shown = np.stack([features(observation) for observation in cut.observations[:-1]])
        yield shown, cut.actions


def free_folder(dataset_id: str) -> Path:
    """Return the folder for a new data set.

    Raises FileExistsError if there is a data set of that id.
    """
    from minari.storage import get_dataset_path

    folder: Path = get_dataset_path(dataset_id)
    if folder.exists():
        raise FileExistsError(f"data set {dataset_id!r} exists in {folder}; give another id, or the next version.")
    return folder
