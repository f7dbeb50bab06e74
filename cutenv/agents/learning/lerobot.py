"""LeRobot data sets (format v3.0) of cuts, and hub environments.

The data sets are Parquet, with the force in newtons, of cuts by a script, a trained agent or a person. ``make_env``
for an ``env.py`` of the hub, makes environments with their observations.

A frame is a decision. ``observation.state`` holds what a rig measures, in the units of its names;
``observation.wrench`` those of it that are forces on the blade, with their unit, frame and rate;
``observation.environment_state`` the environment's own observation, scaled, as a policy of this package sees it. The
observation after the last decision is left out, as LeRobot has it. ``info`` is nothing that a policy may see.
:func:`cutenv.records.read_record` reads such a data set, or anybody's with a force, an episode as a record.
"""

from __future__ import annotations

import json
import math
import os
import re
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict
from gymnasium.vector import AsyncVectorEnv, AutoresetMode, SyncVectorEnv, VectorEnv
from numpy.typing import NDArray

import cutenv
from cutenv._base.imports import optional_import
from cutenv._base.validation import in_range
from cutenv.agents.learning.demonstration import (
    FELT,
    INTERVENED,
    Demonstration,
    added_infos,
    felt_at_rest,
    felt_now,
    infos_of,
)
from cutenv.agents.learning.minari_datasets import meanings_of
from cutenv.agents.policy.trained import observation_scaling
from cutenv.task.registry import task_of

LEROBOT_FORMAT = "v3.0"  # version of LeRobot's format that is written
ENV_FILE = "env.py"  # file in which LeRobot looks for the environment of a repository of its hub
INSTRUCTION = "Cut the slice of liver gently to the target length, and unload the blade there."
"""Task of every cut in words, as LeRobot gives it to policies that read."""
_ELSEWHERE = ("time_s", "is_success", *INTERVENED)
_FORCES = {"force_N": "force_x_N", "lateral_force_N": "force_y_N", "vertical_force_N": "force_z_N"}
"""Components of ``observation.wrench`` that may be measured, by the names of the infos, in their order."""
_FRAME = "blade: x against its motion, y to its right, z up"
_FRAMES_IN_FILE, _FILES_IN_CHUNK, _MEGABYTES = 200_000, 1000, 100  # LeRobot's limit is 100 MB; a frame is 0.3 kB
_DATA = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
_EPISODES = "meta/episodes/chunk-000/file-000.parquet"
_QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
_ID = re.compile(r"[-\w.]+/[-\w.]+")
Columns = dict[str, NDArray[Any]]


def lerobot_folder(dataset_id: str) -> Path:
    """Return a new data set's folder below ``HF_LEROBOT_HOME`` or its default.

    Raises ValueError if the id is not ``owner/name``; FileExistsError if there is a data set of that id.
    """
    if not _ID.fullmatch(dataset_id):
        raise ValueError(f"--dataset {dataset_id!r} must be owner/name for LeRobot, such as cutenv/probe.")
    hugging_face = Path(os.environ.get("HF_HOME", Path.home() / ".cache/huggingface"))
    folder = Path(os.environ.get("HF_LEROBOT_HOME", hugging_face / "lerobot")).expanduser() / dataset_id
    if folder.exists():
        raise FileExistsError(f"data set {dataset_id!r} exists in {folder}; give another id.")
    return folder


def measured_names(environment: str) -> tuple[str, ...]:
    """Return the names of ``observation.state`` in an environment, by its id."""
    return tuple(name for name in (*FELT, *infos_of(environment).felt) if name not in _ELSEWHERE)


def write_lerobot(
    folder: Path, source: str, keywords: Mapping[str, Any], demonstrations: Sequence[Demonstration]
) -> None:
    """Write cuts of one task as a LeRobot data set.

    The new ``folder`` is complete or does not exist; ``source`` is the policy or person that cut, for readers;
    ``keywords`` are those of the environment.

    Raises ModuleNotFoundError if pyarrow is not installed; OSError if the folder cannot be written.
    """
    parquet = optional_import("pyarrow.parquet", "pyarrow", "A LeRobot data set")
    task, _ = task_of(dict(keywords))
    measured = measured_names(task.id)
    episodes = _episodes(demonstrations, float(keywords["control_hz"]), measured)
    features = _features(episodes[0], keywords, demonstrations[0])
    part = folder.with_name(f"{folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    try:
        rows = []
        for number, group in enumerate(_files(episodes)):
            chunk, file = divmod(number, _FILES_IN_CHUNK)
            path = part / _DATA.format(chunk_index=chunk, file_index=file)
            path.parent.mkdir(parents=True, exist_ok=True)
            joined = {name: np.concatenate([episodes[k][name] for k in group]) for name in features}
            parquet.write_table(_table(joined), path)
            rows += [_episode_row(episodes[k], demonstrations[k], chunk, file) for k in group]
        (part / _EPISODES).parent.mkdir(parents=True)
        arrow = optional_import("pyarrow", "pyarrow", "A LeRobot data set")
        parquet.write_table(arrow.Table.from_pylist(rows), part / _EPISODES)
        parquet.write_table(_tasks(), part / "meta/tasks.parquet")
        every = {name: np.concatenate([episode[name] for episode in episodes]) for name in features}
        stats = {name: _statistics(values) for name, values in every.items()}
        info = _info(episodes, features, source, keywords, demonstrations[0])
        for name, content in (("stats", stats), ("info", info)):
            (part / f"meta/{name}.json").write_text(json.dumps(content, indent=4), encoding="utf-8")
        (part / "README.md").write_text(_card(source), encoding="utf-8")
        (part / ENV_FILE).write_text(_env_file(keywords), encoding="utf-8")
        part.rename(folder)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        raise


def _episodes(demonstrations: Sequence[Demonstration], rate: float, measured: Sequence[str]) -> list[Columns]:
    """Return the columns of each cut, one row for each decision."""
    episodes: list[Columns] = []
    before = 0
    for number, cut in enumerate(demonstrations):
        n = len(cut.rewards)
        infos = {name: values[:-1] for name, values in cut.infos.items()}
        hidden = [name for name in infos if name not in (*measured, *_ELSEWHERE)]
        episodes.append(
            {
                "observation.state": np.column_stack([infos[name] for name in measured]).astype(np.float32),
                "observation.wrench": _forces(infos, measured),
                "observation.environment_state": cut.observations[:-1].astype(np.float32),
                "action": cut.actions.astype(np.float32),
                "next.reward": cut.rewards.astype(np.float32),
                "next.done": np.arange(n) == n - 1,
                "next.success": cut.infos["is_success"][1:] == 1.0,
                "info": np.column_stack([infos[name] for name in hidden]).astype(np.float32),
                "timestamp": (np.arange(n) / rate).astype(np.float32),
                "frame_index": np.arange(n),
                "episode_index": np.full(n, number),
                "index": before + np.arange(n),
                "task_index": np.zeros(n, np.int64),
            }
        )
        if "is_intervention" in cut.infos:
            episodes[-1]["complementary_info.is_intervention"] = cut.infos["is_intervention"][1:] == 1.0
        before += n
    return episodes


def _forces(infos: Mapping[str, NDArray[np.float64]], measured: Sequence[str]) -> NDArray[np.float32]:
    """Return measured force components [N] as LeRobot stores them.

    They are of shape (n, k), or (n,) for one.
    """
    columns = [infos[name].astype(np.float32) for name in _FORCES if name in measured]
    return columns[0] if len(columns) == 1 else np.column_stack(columns)


def _features(episode: Columns, keywords: Mapping[str, Any], cut: Demonstration) -> dict[str, dict[str, Any]]:
    """Return LeRobot's description of every column."""
    task, _ = task_of(dict(keywords))
    measured = measured_names(task.id)
    names: dict[str, list[str] | None] = {
        "observation.state": list(measured),
        "observation.wrench": [component for name, component in _FORCES.items() if name in measured],
        "observation.environment_state": [each["name"] for each in observation_scaling(task.id)],
        "action": list(task.task.action_names),
        "info": [name for name in cut.infos if name not in (*measured, *_ELSEWHERE)],
    }
    kinds = {"f": "float32", "i": "int64", "b": "bool"}
    described: dict[str, dict[str, Any]] = {
        name: {"dtype": kinds[values.dtype.kind], "shape": list(values.shape[1:]) or [1], "names": names.get(name)}
        for name, values in episode.items()
    }
    described["observation.wrench"]["info"] = {"unit": "N", "frame": _FRAME, "rate_hz": float(keywords["control_hz"])}
    return described


def _files(episodes: Sequence[Columns]) -> list[list[int]]:
    """Return the numbers of the episodes in each file of data."""
    groups: list[list[int]] = []
    room = 0
    for number, episode in enumerate(episodes):
        if not groups or room < len(episode["index"]):
            groups.append([])
            room = _FRAMES_IN_FILE
        groups[-1].append(number)
        room -= len(episode["index"])
    return groups


def _table(columns: Columns) -> Any:
    arrow = optional_import("pyarrow", "pyarrow", "A LeRobot data set")
    made = {
        name: arrow.array(values)
        if values.ndim == 1
        else arrow.FixedSizeListArray.from_arrays(arrow.array(values.ravel()), values.shape[1])
        for name, values in columns.items()
    }
    return arrow.table(made)


def _episode_row(episode: Columns, cut: Demonstration, chunk: int, file: int) -> dict[str, Any]:
    first, count = int(episode["index"][0]), len(episode["index"])
    statistics = {
        f"stats/{name}/{key}": value for name, values in episode.items() for key, value in _statistics(values).items()
    }
    return {
        "episode_index": int(episode["episode_index"][0]),
        "tasks": [INSTRUCTION],
        "length": count,
        "data/chunk_index": chunk,
        "data/file_index": file,
        "dataset_from_index": first,
        "dataset_to_index": first + count,
        "cutenv/seed": -1 if cut.seed is None else cut.seed,
        "cutenv/about": json.dumps(cut.about),
        **statistics,
        "meta/episodes/chunk_index": 0,
        "meta/episodes/file_index": 0,
    }


def _statistics(values: NDArray[Any]) -> dict[str, list[Any]]:
    """Return minimum, maximum, mean, SD, count and quantiles per number."""
    rows = values.reshape(len(values), -1)
    real = rows.astype(np.float64)
    found = {"min": rows.min(axis=0), "max": rows.max(axis=0), "mean": real.mean(axis=0), "std": real.std(axis=0)}
    found |= {"count": np.array([len(rows)])}
    found |= dict(zip(_QUANTILES, np.quantile(real, list(_QUANTILES.values()), axis=0), strict=True))
    return {name: value.tolist() for name, value in found.items()}


def _tasks() -> Any:
    """Return the task table, indexed by text as pandas reads it."""
    arrow = optional_import("pyarrow", "pyarrow", "A LeRobot data set")
    index = "__index_level_0__"
    kinds = {"task_index": ("int64", "int64"), index: ("unicode", "object")}
    columns = [
        {"name": None if name == index else name, "field_name": name, "pandas_type": kind, "numpy_type": numpy}
        for name, (kind, numpy) in kinds.items()
    ]
    pandas = {"index_columns": [index], "column_indexes": [], "columns": columns, "pandas_version": "2.0.0"}
    table = arrow.table({"task_index": [0], index: [INSTRUCTION]})
    return table.replace_schema_metadata({"pandas": json.dumps(pandas)})


def _info(
    episodes: Sequence[Columns],
    features: dict[str, dict[str, Any]],
    source: str,
    keywords: Mapping[str, Any],
    cut: Demonstration,
) -> dict[str, Any]:
    task, _ = task_of(dict(keywords))
    rate = float(keywords["control_hz"])
    return {
        "codebase_version": LEROBOT_FORMAT,
        "robot_type": "cutenv",
        "total_episodes": len(episodes),
        "total_frames": sum(len(episode["index"]) for episode in episodes),
        "total_tasks": 1,
        "chunks_size": _FILES_IN_CHUNK,
        "data_files_size_in_mb": _MEGABYTES,
        "video_files_size_in_mb": 200,
        "fps": int(rate) if rate == math.floor(rate) else rate,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": _DATA,
        "video_path": None,
        "features": features,
        "cutenv": {
            "version": cutenv.__version__,
            "environment": {"id": task.id, **keywords},
            **meanings_of(task, source, cut),
        },
    }


def _card(source: str) -> str:
    return f"""---
license: mit
task_categories: [robotics]
tags: [LeRobot, surgery, cutting, force]
configs:
- config_name: default
  data_files: data/*/*.parquet
---

Gentle cutting of measured liver by {source}, made with cutenv {cutenv.__version__}.
`observation.state` holds the force in newtons; every name ends with its unit.
Not a medical device, and not validated for the assessment of people.
"""


def _env_file(environment: Mapping[str, Any]) -> str:
    """Return the text of ``env.py`` for an environment's arguments."""
    return f'''"""Environment for LeRobot's hub; it needs: pip install "cutenv>={cutenv.__version__}"."""

from cutenv.agents.learning import lerobot

ENVIRONMENT = {dict(environment)!r}


def make_env(n_envs=1, use_async_envs=False, cfg=None):
    """Make n_envs environments that are stepped together."""
    return lerobot.make_env(n_envs, use_async_envs, cfg, environment=ENVIRONMENT)
'''


class LeRobotEnv(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Environment with LeRobot's names for what it observes.

    ``agent_pos`` is the data sets' ``observation.state``: what a rig measures, the force in newtons;
    ``environment_state`` the environment's own observation, scaled.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        super().__init__(env)
        spec = env.spec
        assert spec is not None  # it was made by its id
        self.task, self.task_description = spec.id, INSTRUCTION
        self._max_episode_steps = spec.max_episode_steps
        self.state_names = measured_names(spec.id)
        state = Box(-np.inf, np.inf, (len(self.state_names),), np.float32)
        self.observation_space = Dict({"agent_pos": state, "environment_state": env.observation_space})

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin a cut; see the environment."""
        observation, info = super().reset(seed=seed, options=options)
        inner: Any = self.env.unwrapped
        felt = felt_at_rest(inner.cutting, inner.start_angle)
        return self._named(observation, felt, info), info

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Carry out a decision; see the environment."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        inner: Any = self.env.unwrapped
        return self._named(observation, felt_now(inner.cutting), info), reward, terminated, truncated, info

    def _named(self, observation: NDArray[np.float32], felt: dict[str, float], info: dict[str, Any]) -> dict[str, Any]:
        known = felt | added_infos(self.task, observation, info)
        state = np.array([known[name] for name in self.state_names], np.float32)
        return {"agent_pos": state, "environment_state": observation}


def make_env(
    n_envs: int = 1, use_async_envs: bool = False, cfg: Any = None, *, environment: Mapping[str, Any] | None = None
) -> dict[str, dict[int, VectorEnv[Any, Any, Any]]]:
    """Make environments for LeRobot, by the environment's id and a number.

    ``n_envs`` are stepped together, each in a process of its own if ``use_async_envs``; ``cfg`` is LeRobot's
    ``EnvConfig``, whose ``task``, where it has one, must be the environment's; ``environment`` are its keyword
    arguments, with "task" for another than gentle cutting.

    Raises ValueError if an argument is out of range, or ``cfg`` is for another task.
    """
    task, keywords = task_of(environment or {})
    count = round(in_range("n_envs", n_envs, 1, 4096, "1", "Give how many environments are stepped together."))
    wanted = getattr(cfg, "task", None)
    if wanted not in (None, "", task.id):
        raise ValueError(f"cfg.task = {wanted!r}: this is {task.id}. Leave the task out, or take another repository.")

    def made() -> LeRobotEnv:
        return LeRobotEnv(gymnasium.make(task.id, **keywords))

    kind = AsyncVectorEnv if use_async_envs else SyncVectorEnv
    vector = kind([made] * count, autoreset_mode=AutoresetMode.SAME_STEP)
    return {task.id: {0: vector}}
