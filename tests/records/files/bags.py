"""Bags as robots record them, written by rosbags: a wrench at 500 Hz, joints at 100 Hz, a picture, text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

WRENCH, JOINTS, IMAGE, TEXT = (
    "geometry_msgs/msg/WrenchStamped",
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/Image",
    "std_msgs/msg/String",
)
START = 1_700_000_000_000_000_000  # [ns]


def force_at(seconds: float) -> float:
    """Force of a cut: air for half a second, then a load that rises, then nothing."""
    return 0.4 + (1.5 * (seconds - 0.5) if 0.5 < seconds < 3.0 else 0.0)


def position_at(seconds: float) -> float:
    return 0.0127 * min(max(seconds - 0.4, 0.0), 2.6)


def write_bag(folder: Path, kind: str, *, seconds: float = 4.0, joints_from: float = 0.0, bad: bool = False) -> Path:
    """Write a bag of a kind ("mcap", "db3" or "bag"); return the path of its file."""
    ros1 = kind == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if ros1 else Stores.ROS2_HUMBLE)
    types = store.types

    def header(seconds: float) -> Any:
        at = START + round(seconds * 1e9)
        stamp = types["builtin_interfaces/msg/Time"](sec=at // 10**9, nanosec=at % 10**9)
        more = {"seq": 0} if ros1 else {}
        return types["std_msgs/msg/Header"](stamp=stamp, frame_id="ft", **more)

    def vector(x: float, y: float, z: float) -> Any:
        return types["geometry_msgs/msg/Vector3"](x=x, y=y, z=z)

    messages: list[tuple[str, str, float, Any]] = []
    for k in range(round(seconds * 500)):
        at = k / 500
        force = float("nan") if bad and k == 700 else force_at(at)
        wrench = types["geometry_msgs/msg/Wrench"](force=vector(-force, 0.1, 0.2), torque=vector(0.0, 0.0, 0.01))
        messages.append(("/ft/wrench", WRENCH, at, types[WRENCH](header=header(at), wrench=wrench)))
    for k in range(round(joints_from * 100), round(seconds * 100) + 1):
        at = k / 100
        places = np.array([position_at(at), 1.2])
        state = types[JOINTS](
            header=header(at), name=["feed", "tilt"], position=places, velocity=np.zeros(2), effort=np.zeros(0)
        )
        messages.append(("/stage", JOINTS, at, state))
    image = types[IMAGE](
        header=header(0.0), height=64, width=64, encoding="mono8", is_bigendian=0, step=64,
        data=np.zeros(64 * 64, np.uint8),
    )  # fmt: skip
    messages += [("/camera", IMAGE, 0.0, image), ("/note", TEXT, 0.0, types[TEXT](data="liver 3"))]
    messages.sort(key=lambda message: message[2])
    kinds = {topic: name for topic, name, *_ in messages}
    path = folder / ("rig.bag" if ros1 else f"rig_{kind}")
    if ros1:
        with Writer1(path) as writer:
            made = {topic: writer.add_connection(topic, name, typestore=store) for topic, name in kinds.items()}
            for topic, name, at, message in messages:
                writer.write(made[topic], START + round(at * 1e9), store.serialize_ros1(message, name))
        return path
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    with Writer2(path, version=9, storage_plugin=plugin) as writer2:
        made2 = {topic: writer2.add_connection(topic, name, typestore=store) for topic, name in kinds.items()}
        for topic, name, at, message in messages:
            writer2.write(made2[topic], START + round(at * 1e9), store.serialize_cdr(message, name))
    return next(path.glob(f"*.{kind}"))
