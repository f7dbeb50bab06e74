"""Cuts as a LeRobot data set v3.0: nothing is lost, forces are in newtons, and LeRobot's own library reads it."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pyarrow.parquet as parquet
import pytest

from cutenv.agents.learning import lerobot
from cutenv.agents.learning.demonstration import Demonstration
from cutenv.agents.learning.lerobot import INSTRUCTION, lerobot_folder, make_env, write_lerobot
from cutenv.commands import cli
from cutenv.commands.datasets import Arguments, cuts_of

ROOT = Path(__file__).parents[3]
PYTHON = ROOT / (".venv-lerobot/Scripts/python.exe" if os.name == "nt" else ".venv-lerobot/bin/python")


Made = tuple[dict[str, Any], list[Demonstration]]


@pytest.fixture(scope="module")
def made() -> Made:
    return cuts_of(Arguments(dataset="cutenv/x", format="lerobot", policy="probe and creep", cuts=3))


@pytest.fixture
def folder(tmp_path: Path, made: Made) -> Path:
    write_lerobot(tmp_path / "set", "probe and creep", *made)
    return tmp_path / "set"


def test_every_decision_is_a_frame_with_the_force_in_newtons(folder, made):
    cuts = made[1]
    table = parquet.read_table(folder / "data/chunk-000/file-000.parquet").to_pydict()
    info = json.loads((folder / "meta/info.json").read_text())
    force = info["features"]["observation.state"]["names"].index("force_N")
    for number, cut in enumerate(cuts):
        rows = [k for k, episode in enumerate(table["episode_index"]) if episode == number]
        assert len(rows) == len(cut.rewards)
        found = {name: np.array([table[name][k] for k in rows]) for name in table}
        assert np.array_equal(found["observation.state"][:, force], cut.infos["force_N"][:-1].astype(np.float32))
        assert np.array_equal(found["action"], cut.actions)
        assert np.array_equal(found["observation.environment_state"], cut.observations[:-1])
        assert np.array_equal(found["next.reward"], cut.rewards.astype(np.float32))
        assert found["next.done"].tolist() == [False] * (len(rows) - 1) + [True]
        assert found["next.success"][-1] == bool(cut.infos["is_success"][-1])
        assert np.allclose(found["timestamp"], np.arange(len(rows)) / 10, atol=1e-6)
        assert found["frame_index"].tolist() == list(range(len(rows)))
    assert table["index"] == list(range(len(table["index"])))
    assert {name: len(np.atleast_1d(table[name][0])) for name in table} == {
        name: feature["shape"][0] for name, feature in info["features"].items()
    }
    assert info["features"]["info"]["names"] == ["tip_m", "true_force_N"]
    assert info["total_frames"] == len(table["index"])
    assert info["codebase_version"] == "v3.0"


def test_the_wrench_states_its_components_unit_frame_and_rate(folder, made):
    table = parquet.read_table(folder / "data/chunk-000/file-000.parquet").to_pydict()
    wrench = json.loads((folder / "meta/info.json").read_text())["features"]["observation.wrench"]
    assert (wrench["dtype"], wrench["shape"], wrench["names"]) == ("float32", [1], ["force_x_N"])
    assert wrench["info"] == {
        "unit": "N", "frame": "blade: x against its motion, y to its right, z up", "rate_hz": 10.0
    }  # fmt: skip
    force = np.concatenate([cut.infos["force_N"][:-1] for cut in made[1]]).astype(np.float32)
    assert np.array_equal(np.array(table["observation.wrench"], np.float32), force)


@pytest.mark.parametrize(
    ("policy", "components"),
    [("follow the depth", {"force_x_N": "force_N", "force_z_N": "vertical_force_N"}),
     ("steer by force", {"force_x_N": "force_N", "force_y_N": "lateral_force_N"})],
)  # fmt: skip
def test_a_task_with_more_components_of_force_writes_them(tmp_path, policy, components):
    keywords, cuts = cuts_of(Arguments(dataset="cutenv/x", format="lerobot", policy=policy, cuts=1))
    write_lerobot(tmp_path / "set", "x", keywords, cuts)
    table = parquet.read_table(tmp_path / "set/data/chunk-000/file-000.parquet").to_pydict()
    wrench = json.loads((tmp_path / "set/meta/info.json").read_text())["features"]["observation.wrench"]
    assert wrench["names"] == list(components)
    felt = np.column_stack([cuts[0].infos[name][:-1] for name in components.values()])
    assert np.array_equal(np.array(table["observation.wrench"], np.float32), felt.astype(np.float32))


def test_the_statistics_are_those_of_the_frames(folder: Path) -> None:
    stats = json.loads((folder / "meta/stats.json").read_text())
    table = parquet.read_table(folder / "data/chunk-000/file-000.parquet")
    values = np.array(table["action"].to_pylist())
    assert stats["action"]["max"] == values.max(axis=0).tolist()
    assert stats["action"]["count"] == [len(values)]
    assert np.allclose(stats["action"]["q90"], np.quantile(values, 0.9, axis=0))
    episodes = parquet.read_table(folder / "meta/episodes/chunk-000/file-000.parquet").to_pylist()
    last = episodes[-1]
    part = values[last["dataset_from_index"] : last["dataset_to_index"]]
    assert np.allclose(last["stats/action/mean"], part.mean(axis=0))
    assert json.loads(last["cutenv/about"])["target_length_m"] > 0.05
    assert last["tasks"] == [INSTRUCTION]


def test_more_frames_than_a_file_takes_go_into_the_next(tmp_path, made, monkeypatch):
    monkeypatch.setattr(lerobot, "_FRAMES_IN_FILE", 100)
    monkeypatch.setattr(lerobot, "_FILES_IN_CHUNK", 2)
    write_lerobot(tmp_path / "set", "x", *made)
    files = sorted(path.relative_to(tmp_path).as_posix() for path in (tmp_path / "set/data").rglob("*.parquet"))
    assert files[0].endswith("chunk-000/file-000.parquet")
    assert files[-1].endswith("chunk-001/file-000.parquet")
    rows = parquet.read_table(tmp_path / "set/meta/episodes/chunk-000/file-000.parquet").to_pylist()
    assert [(row["data/chunk_index"], row["data/file_index"]) for row in rows] == [(0, 0), (0, 1), (1, 0)]


def test_nothing_is_left_of_a_data_set_that_cannot_be_written(tmp_path, made, monkeypatch):
    def full(*_: Any) -> None:
        raise OSError("no space left on device")

    monkeypatch.setattr(lerobot, "_info", full)
    with pytest.raises(OSError, match="no space left"):
        write_lerobot(tmp_path / "set", "x", *made)
    assert not list(tmp_path.iterdir())


def test_the_command_writes_where_lerobot_looks_and_never_over_another(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("HF_LEROBOT_HOME", str(tmp_path))
    given = ["datasets", "--format", "lerobot", "--cuts", "1", "--policy", "probe and creep", "--dataset"]
    assert cli.main([*given, "cutenv/probe"]) == 0
    assert "1 cuts" in capsys.readouterr().out
    assert (tmp_path / "cutenv/probe/README.md").is_file()
    assert cli.main([*given, "cutenv/probe"]) == 2
    assert "exists in" in capsys.readouterr().err
    assert cli.main([*given, "probe"]) == 2
    assert "must be owner/name for LeRobot" in capsys.readouterr().err
    monkeypatch.delenv("HF_LEROBOT_HOME")
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hf"))
    assert lerobot_folder("a/b") == tmp_path / "hf/lerobot/a/b"


def test_the_data_sets_own_environment_observes_what_the_data_set_holds(folder, made):
    spec = importlib.util.spec_from_file_location("hub_env", folder / "env.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    (vector,) = module.make_env(n_envs=1)["cutenv/GentleCut-v1"].values()
    table = parquet.read_table(folder / "data/chunk-000/file-000.parquet").to_pydict()
    cut, rows = made[1][1], [k for k, number in enumerate(table["episode_index"]) if number == 1]
    observation, _ = vector.reset(seed=[cut.seed])
    for k, row in enumerate(rows):
        assert observation["agent_pos"][0].tolist() == table["observation.state"][row]
        assert observation["environment_state"][0].tolist() == table["observation.environment_state"][row]
        observation, reward, ended, _, info = vector.step(cut.actions[k][None])
        assert np.float32(reward[0]) == table["next.reward"][row]
        assert ended[0] == table["next.done"][row]
    assert info["final_info"]["is_success"][0] == table["next.success"][rows[-1]]
    vector.close()


@pytest.mark.parametrize(
    ("task", "states", "observed", "in_processes"), [("depth", 11, 22, False), ("path", 12, 28, True)]
)
def test_environments_for_lerobot_are_there_for_every_task_in_processes_too(task, states, observed, in_processes):
    environment = {"task": task, "control_hz": 10}
    ((name, numbered),) = make_env(2, use_async_envs=in_processes, environment=environment).items()
    vector = numbered[0]
    observation, _ = vector.reset(seed=[0, 1])
    assert observation["agent_pos"].shape == (2, states)
    assert observation["environment_state"].shape == (2, observed)
    assert vector.step(vector.action_space.sample())[1].shape == (2,)
    assert name in vector.call("task")
    vector.close()


def test_environments_for_lerobot_refuse_what_cannot_be() -> None:
    with pytest.raises(ValueError, match="n_envs = 0"):
        make_env(0)
    with pytest.raises(ValueError, match=r"cfg\.task = 'PushT-v0': this is cutenv/GentleCut-v1"):
        make_env(cfg=SimpleNamespace(task="PushT-v0"))


@pytest.mark.skipif(
    not PYTHON.exists(), reason="LeRobot wants packages of its own: 'pip install lerobot' in .venv-lerobot"
)
def test_lerobots_library_reads_the_same_numbers(folder, made):
    offline = os.environ | {"HF_HUB_OFFLINE": "1", "HF_HOME": str(folder.parent / "home"), "PYTHONPATH": str(ROOT)}
    seeds = [str(cut.seed) for cut in made[1][:2]]
    command = [str(PYTHON), str(Path(__file__).with_name("in_lerobot.py")), "cutenv/probe", str(folder), *seeds]
    ran = subprocess.run(command, env=offline, capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr[-3000:]
    found = json.loads(ran.stdout.splitlines()[-1])
    cuts = made[1]
    force = np.concatenate([cut.infos["force_N"][:-1] for cut in cuts]).astype(np.float32)
    assert found["episodes"] == len(cuts)
    assert found["fps"] == 10
    assert found["names"][0] == "force_N"
    assert np.array_equal(np.float32(found["force"]), force)
    assert np.array_equal(np.float32(found["force_before"][1:20]), force[:19])  # a tenth of a second earlier
    assert np.array_equal(np.float32(found["actions"]), np.concatenate([cut.actions for cut in cuts]))
    assert np.array_equal(
        np.float32(found["rewards"]), np.concatenate([cut.rewards for cut in cuts]).astype(np.float32)
    )
    assert sum(found["done"]) == len(cuts)
    assert found["task"] == INSTRUCTION
    assert np.float32(found["greatest_force"]) == force.max()
    assert found["second"] == len(cuts[1].rewards)
    for k, cut in enumerate(cuts[:2]):  # the data set's own env.py pays the recorded actions the recorded rewards
        assert np.float32(found["replayed_rewards"][k]).tolist() == cut.rewards.astype(np.float32).tolist()
        assert np.array_equal(
            np.float32(found["replayed_states"][k])[:, 0], cut.infos["force_N"][:-1].astype(np.float32)
        )
        assert found["replayed_success"][k] == bool(cut.infos["is_success"][-1])
    assert found["most_steps"] == 300
    assert found["described"] == INSTRUCTION
