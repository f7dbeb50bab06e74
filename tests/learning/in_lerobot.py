"""Read a data set by LeRobot's own library, in its own environment, and print what it holds as JSON."""

from __future__ import annotations

import importlib
import json
import sys
from unittest.mock import MagicMock

import datasets  # before a stand-in for torchvision, which it looks for

try:
    importlib.import_module("torchvision")
except Exception:  # it reads pictures, of which there are none, and needs a build that fits torch's
    names = ("", ".transforms", ".transforms.v2", ".transforms.v2.functional", ".io")
    sys.modules |= {f"torchvision{name}": MagicMock() for name in names}
    sys.modules["torchvision.transforms.v2"].Transform = object

from lerobot.datasets.lerobot_dataset import LeRobotDataset

data = LeRobotDataset(sys.argv[1], root=sys.argv[2], delta_timestamps={"observation.state": [-0.1, 0.0]})
frames = [data[k] for k in range(len(data))]
second = LeRobotDataset(sys.argv[1], root=sys.argv[2], episodes=[1])
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
        }
    )
)
