"""Read a data set, and cut in its environment, by LeRobot's own library, in its own environment; print it as JSON."""

from __future__ import annotations

import importlib
import importlib.machinery
import json
import sys
from pathlib import Path
from unittest.mock import MagicMock

import datasets  # before a stand-in for torchvision, which it looks for

try:
    importlib.import_module("torchvision")
except Exception:  # it reads pictures, of which there are none, and needs a build that fits torch's
    names = ("", ".transforms", ".transforms.functional", ".transforms.v2", ".transforms.v2.functional", ".io")
    sys.modules |= {f"torchvision{name}": MagicMock() for name in names}
    sys.modules["torchvision"].__spec__ = importlib.machinery.ModuleSpec("torchvision", None)
    sys.modules["torchvision.transforms.v2"].Transform = object

import lerobot.envs.utils
import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset
from lerobot.envs.factory import make_env
from lerobot.envs.utils import preprocess_observation

data = LeRobotDataset(sys.argv[1], root=sys.argv[2], delta_timestamps={"observation.state": [-0.1, 0.0]})
frames = [data[k] for k in range(len(data))]
second = LeRobotDataset(sys.argv[1], root=sys.argv[2], episodes=[1])
# The hub, without a network.
lerobot.envs.utils.hf_hub_download = lambda filename, **_: str(Path(sys.argv[2]) / filename)
(vector,) = make_env(sys.argv[1], n_envs=2, trust_remote_code=True)["cutenv/GentleCut-v1"].values()
cuts = [[frame for frame in frames if frame["episode_index"] == k] for k in (0, 1)]
observation, _ = vector.reset(seed=[int(seed) for seed in sys.argv[3:5]])
rewards, states, succeeded, done = [[], []], [[], []], [None, None], np.zeros(2, bool)
while not done.all():
    seen = preprocess_observation(observation)["observation.state"]
    step = [min(len(rewards[k]), len(cuts[k]) - 1) for k in (0, 1)]
    observation, reward, ended, _, info = vector.step(np.stack([cuts[k][step[k]]["action"].numpy() for k in (0, 1)]))
    for k in np.flatnonzero(~done):
        rewards[k].append(float(reward[k]))
        states[k].append(seen[k].tolist())
        if ended[k]:
            succeeded[k] = bool(info["final_info"]["is_success"][k])  # where their evaluation looks for it
    done |= ended
print(
    json.dumps(
        {
            "episodes": data.meta.total_episodes,
            "fps": data.fps,
            "names": data.meta.features["observation.state"]["names"],
            "force": [float(frame["observation.state"][-1][0]) for frame in frames],
            "force_before": [float(frame["observation.state"][0][0]) for frame in frames],
            "actions": [frame["action"].tolist() for frame in frames],
            "rewards": [float(frame["next.reward"]) for frame in frames],
            "done": [bool(frame["next.done"]) for frame in frames],
            "task": frames[0]["task"],
            "greatest_force": float(data.meta.stats["observation.state"]["max"][0]),
            "second": len(second),
            "datasets": datasets.__version__,
            "replayed_rewards": rewards,
            "replayed_states": states,
            "replayed_success": succeeded,
            "most_steps": vector.call("_max_episode_steps")[0],
            "described": vector.call("task_description")[0],
        }
    )
)
