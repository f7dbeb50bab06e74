"""Record cuts as a Minari data set with the force in newtons: by a script, a trained agent or a person.

    python agents/datasets.py --dataset cutenv/probe-v0 --policy "probe and creep" --cuts 100
    python agents/datasets.py --dataset cutenv/agent-v0 --policy ppo-free
    python agents/datasets.py --dataset cutenv/people-v0 --records cuts/*.csv

A policy is named as in agents/evaluate.py; records are those of ``cutenv play`` or of a rig (``cutenv.recording``).
The data set lies where Minari keeps them, MINARI_DATASETS_PATH or ~/.minari/datasets; nothing is downloaded.

``minari.load_dataset(id)`` loads it, and ``recover_environment()`` the environment; after a reset with an episode's
seed, a simulated cut's actions give exactly the recorded rewards.  ``agents/bc.py --dataset ID`` clones its policy;
:func:`lessons` converts it into inputs and targets for cloning.
"""

from __future__ import annotations

import inspect
import json
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from demonstrated import ESTIMATED, FELT, HIDDEN, Demonstration, recorded, simulated
from evaluate import ENVIRONMENT, TRAINING_SEEDS, contestant
from options import option, parse
from tqdm import tqdm

import cutenv
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.policy import Features
from cutenv.policy.trained import observation_scaling
from cutenv.recording import load
from cutenv.recording.columns import parse_length
from cutenv.task.observation import COMPONENTS
from cutenv.tissue.specimen import CLASSES

if TYPE_CHECKING:
    from minari import MinariDataset

ACTIONS = ("target speed / 2.54 cm/s", "(target angle - 67.5 deg) / 22.5 deg")
_ID = re.compile(r"([-\w]+/)*[-\w]+-v\d+")
_NOT_TOLD = "`(author|author_email|code_permalink|eval_env)` is set to None"  # Minari warns about each


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments for a data set; every field is an option of the command line."""

    dataset: str = option("", "id of the data set, such as cutenv/probe-and-creep-v0")
    policy: str = option("", "baseline, shipped policy, or folder of a trained one that cuts")
    records: tuple[str, ...] = option((), "records of cuts instead: CSV, Parquet or HDF5")
    cuts: int = option(100, "number of cuts that the policy makes, each of another specimen")
    seed: int = option(TRAINING_SEEDS.stop // 2, "seed of the first specimen, below a million, where nothing is tested")
    specimen_class: str = option("mixed", "tissue that the policy cuts", CLASSES)
    angle_mode: str = option("free", "whether the blade may be turned", ("free", "fixed"))
    control_hz: int = option(10, "decisions per second; a trained policy has its own")
    target_length: str = option("", "length of the cut where records do not give it, such as 80mm")

    def __post_init__(self) -> None:
        if not _ID.fullmatch(self.dataset):
            raise ValueError(f"--dataset {self.dataset!r} must be an id with a version, such as cutenv/mine-v0.")
        if bool(self.policy) == bool(self.records):
            raise ValueError("give either --policy, which cuts in the simulator, or --records of cuts that were made.")
        if not (0 < self.cuts and 0 <= self.seed and self.seed + self.cuts <= TRAINING_SEEDS.stop):
            raise ValueError(
                f"--seed {self.seed} and --cuts {self.cuts}: give one cut or more with seeds from 0 to "
                f"{TRAINING_SEEDS.stop}; from there on specimens are kept for validation and test."
            )
        if not (0 < self.control_hz <= 1000 and 1000 % self.control_hz == 0):
            raise ValueError(f"--control-hz {self.control_hz} does not divide 1000; take 10, 20 or 50.")

    @property
    def environment(self) -> dict[str, Any]:
        """Keyword arguments of the environment."""
        return {name: getattr(self, name) for name in ("specimen_class", "angle_mode", "control_hz")}


def of_policy(arguments: Arguments) -> tuple[dict[str, Any], list[Demonstration]]:
    """Return the keyword arguments of the environment, and a policy's cuts in it."""
    chosen = contestant(arguments.policy)
    keywords = arguments.environment | dict(chosen.arguments)
    env = gymnasium.make(ENVIRONMENT, **keywords)
    seeds = range(arguments.seed, arguments.seed + arguments.cuts)
    return keywords, [simulated(env, chosen.policy, seed) for seed in tqdm(seeds, desc="cutting", unit="cut")]


def of_records(arguments: Arguments) -> tuple[dict[str, Any], list[Demonstration]]:
    """Return the keyword arguments of an environment that would assess the cuts likewise, and the recorded cuts.

    Raises
    ------
    ValueError
        If a record lacks what is needed; the message names file, cut and field.
    """
    given = arguments.target_length
    target = parse_length("--target-length", given) if given else None
    found = []
    for path in tqdm(arguments.records, desc="reading", unit="file"):
        for number, trace in enumerate(load(Path(path)), 1):
            try:
                made = recorded(trace, control_hz=arguments.control_hz, target_length=target)
            except ValueError as error:
                raise ValueError(f"{path}, cut {number}: {error}") from None
            made.about.setdefault("record", Path(path).name)
            found.append(made)
    return arguments.environment | {"reward_from": "estimate"}, found


def write(
    dataset_id: str, source: str, keywords: dict[str, Any], demonstrations: Sequence[Demonstration]
) -> MinariDataset:
    """Write cuts as a data set; units and meanings go into its metadata, under "cutenv".

    Parameters
    ----------
    dataset_id : str
        Id with a version, such as ``cutenv/probe-and-creep-v0``.
    source : str
        Author of the cuts, for people.
    keywords : dict
        Keyword arguments of the environment.
    demonstrations : sequence of Demonstration
        At least one, all by policies or all recorded.

    Raises
    ------
    FileExistsError
        If there is a data set of that id.
    """
    from minari import create_dataset_from_buffers
    from minari.data_collector import EpisodeBuffer

    _check_free(dataset_id)
    is_simulated = demonstrations[0].seed is not None
    buffers = [
        EpisodeBuffer(
            seed=cut.seed,
            observations=cut.observations,  # type: ignore[arg-type]  # any array will do
            actions=cut.actions,  # type: ignore[arg-type]
            rewards=cut.rewards.tolist(),
            terminations=[False] * (len(cut.rewards) - 1) + [cut.terminated],
            truncations=[False] * (len(cut.rewards) - 1) + [not cut.terminated],
            infos=cut.infos,
        )
        for cut in demonstrations
    ]
    env = gymnasium.make(ENVIRONMENT, **keywords)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=_NOT_TOLD)
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
                "source": source,
                "infos": FELT | (HIDDEN if is_simulated else ESTIMATED),
                "observations": observation_scaling(),  # value = number x scale + offset
                "actions": list(ACTIONS),
                "actions_are": "commands" if is_simulated else "what the blade did until the next decision",
            }
        }
    )
    return dataset


def opened(dataset_id: str) -> MinariDataset:
    """Open a data set on this machine.

    Raises
    ------
    ValueError
        If there is none of that id, or Minari is not installed.
    """
    try:
        import minari
    except ModuleNotFoundError:
        raise ValueError("a data set needs Minari: pip install 'cutenv[data]'.") from None
    try:
        return minari.load_dataset(dataset_id)
    except FileNotFoundError:
        raise ValueError(
            f"there is no data set {dataset_id!r} where Minari keeps them; record one with agents/datasets.py, or set "
            "MINARI_DATASETS_PATH to their folder."
        ) from None


def environment_of(dataset: MinariDataset) -> dict[str, Any]:
    """Return what the actions of a data set assume: ``control_hz``, ``angle_mode`` and a fixed angle.

    Raises
    ------
    ValueError
        If it does not belong to an environment of this package.
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


def lessons(
    dataset: MinariDataset, *, history: int, dead_zone: float, force: bool = True
) -> tuple[np.ndarray, np.ndarray]:
    """Convert a data set for cloning: features, shape (n, size), and actions before the dead zone, shape (n, 2).

    Parameters
    ----------
    dataset : minari.MinariDataset
        Data set with this package's observation; ``filter_episodes`` selects some cuts.
    history, force
        See :class:`cutenv.policy.Features`.
    dead_zone : float
        See :func:`cutenv.policy.past_dead_zone`.

    Raises
    ------
    ValueError
        If its observations are not those of cutenv, or it contains no decision.
    """
    cuts = list(lessons_by_cut(dataset, history=history, dead_zone=dead_zone, force=force))
    if not cuts:
        raise ValueError(f"data set {dataset.id!r} holds no cut; record some, or filter fewer away.")
    shown, taught = zip(*cuts, strict=True)
    return np.concatenate(shown), np.concatenate(taught)


def lessons_by_cut(
    dataset: MinariDataset, *, history: int, dead_zone: float, force: bool = True
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield :func:`lessons` for every cut by itself, for a recurrent network."""
    from cloning import before_dead_zone  # imports torch, which recording does not need

    if dataset.observation_space.shape != (len(COMPONENTS),):
        raise ValueError(
            f"data set {dataset.id!r} has observations of shape {dataset.observation_space.shape}; those of cutenv "
            f"have ({len(COMPONENTS)},). Give one that agents/datasets.py wrote."
        )
    features = Features(history=history, force=force)
    for cut in dataset.iterate_episodes():
        features.reset()
        shown = np.stack([features(observation) for observation in cut.observations[:-1]])
        yield shown, before_dead_zone(cut.actions, dead_zone)


def _check_free(dataset_id: str) -> Path:
    from minari.storage import get_dataset_path

    folder: Path = get_dataset_path(dataset_id)
    if folder.exists():
        raise FileExistsError(f"data set {dataset_id!r} exists in {folder}; give another id, or the next version.")
    return folder


def main() -> None:
    """Record, and print a summary."""
    try:
        arguments = parse(Arguments, __doc__)
        folder = _check_free(arguments.dataset)
        keywords, cuts = of_policy(arguments) if arguments.policy else of_records(arguments)
        dataset = write(arguments.dataset, arguments.policy or "recorded cuts", keywords, cuts)
    except (OSError, ValueError) as error:
        raise SystemExit(f"datasets: {error}") from None
    returns, ended = [cut.rewards.sum() for cut in cuts], [cut.infos["is_success"][-1] for cut in cuts]
    print(f"{dataset.total_episodes} cuts, {dataset.total_steps} decisions in {folder}")
    print(f"mean return {np.mean(returns):.3f}, success {np.mean(ended):.2f}")


if __name__ == "__main__":
    main()
