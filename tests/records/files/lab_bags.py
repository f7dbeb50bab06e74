"""One cut in bags of ROS and in MCAP of other programs, as their recorders write them, whole or killed."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from lab_binary import SLOW, add_file
from lab_cut import EPOCH, FORCE, TIME, WAY
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_typestore

NANOSECONDS = [EPOCH * 10**9 + round(time * 1e9) for time in TIME.tolist()]

# MCAP of JSON and Protobuf.


def mcap_of_json(path: Path) -> None:
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        schema = writer.register_schema("Reading", "jsonschema", json.dumps({"type": "object"}).encode())
        channel = writer.register_channel("/load_cell", "json", schema)
        for stamp, force, way in zip(NANOSECONDS, FORCE.tolist(), WAY.tolist(), strict=True):
            facts = {
                "timestamp": {"sec": stamp // 10**9, "nsec": stamp % 10**9},
                "force_N": force, "stage": {"x_mm": way, "homed": True}, "state": "cut",
            }  # fmt: skip
            writer.add_message(channel, stamp + 300_000, json.dumps(facts).encode(), stamp)
        writer.finish()


def mcap_without_log_times(path: Path) -> None:
    with path.open("wb") as file:
        writer = McapWriter(file)
        writer.start()
        channel = writer.register_channel("/cell", "json", schema_id=0)
        for time, force, way in zip(TIME.tolist(), FORCE.tolist(), WAY.tolist(), strict=True):
            writer.add_message(channel, 0, json.dumps({"t_s": time, "force_N": force, "x_mm": way}).encode(), 0)
        writer.finish()


def protobuf_message() -> tuple[bytes, Any]:
    """File descriptors and class of a message with a time, two forces and a list."""
    kinds = descriptor_pb2.FieldDescriptorProto
    made = descriptor_pb2.FileDescriptorProto(
        name="taf.proto", package="taf", syntax="proto3", dependency=["google/protobuf/timestamp.proto"]
    )
    message = made.message_type.add(name="Tactile")
    message.field.add(
        name="timestamp", number=1, type=kinds.TYPE_MESSAGE, type_name=".google.protobuf.Timestamp", label=1
    )
    message.field.add(name="force_N", number=2, type=kinds.TYPE_DOUBLE, label=1)
    message.field.add(name="travel_mm", number=3, type=kinds.TYPE_DOUBLE, label=1)
    message.field.add(name="cells", number=4, type=kinds.TYPE_FLOAT, label=3)
    stamp = descriptor_pb2.FileDescriptorProto.FromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool = descriptor_pool.DescriptorPool()
    pool.Add(stamp)
    pool.Add(made)
    content = descriptor_pb2.FileDescriptorSet(file=[stamp, made]).SerializeToString()
    return content, message_factory.GetMessageClass(pool.FindMessageTypeByName("taf.Tactile"))


def mcap_of_protobuf(path: Path) -> None:
    described, message = protobuf_message()
    with path.open("wb") as file:
        writer = McapWriter(file, compression=CompressionType.LZ4)
        writer.start()
        channel = writer.register_channel(
            "/finger", "protobuf", writer.register_schema("taf.Tactile", "protobuf", described)
        )
        for stamp, force, way in zip(NANOSECONDS, FORCE.tolist(), WAY.tolist(), strict=True):
            one = message(force_N=force, travel_mm=way, cells=[0.25, 0.5])
            one.timestamp.seconds, one.timestamp.nanos = stamp // 10**9, stamp % 10**9
            writer.add_message(channel, stamp, one.SerializeToString(), stamp)
        writer.finish()


add_file("tree.mcap", "Foxglove", "JSON with times of their own", mcap_of_json)
add_file("untimed.mcap", "a script", "JSON without a schema and without times of the log", mcap_without_log_times)
add_file("tactile.mcap", "Foxglove", "Protobuf in LZ4", mcap_of_protobuf)

# Bags of ROS. Each message is topic, type, time of its log [ns] and content.
ROS = get_typestore(Stores.ROS2_HUMBLE)
WRENCH_TYPE, JOINTS, ARRAY = (
    "geometry_msgs/msg/WrenchStamped", "sensor_msgs/msg/JointState", "std_msgs/msg/Float64MultiArray",
)  # fmt: skip
Messages = list[tuple[str, str, int, Any]]


def header(store: Any, stamp: int) -> Any:
    time = store.types["builtin_interfaces/msg/Time"](sec=stamp // 10**9, nanosec=stamp % 10**9)
    more = {"seq": 0} if "seq" in store.types["std_msgs/msg/Header"].__dataclass_fields__ else {}
    return store.types["std_msgs/msg/Header"](stamp=time, frame_id="ft", **more)


def wrench(store: Any, stamp: int, force: float) -> Any:
    vector, kind = store.types["geometry_msgs/msg/Vector3"], store.types["geometry_msgs/msg/Wrench"]
    made = kind(force=vector(x=force, y=0.1, z=0.2), torque=vector(x=0.0, y=0.0, z=0.0))
    return store.types[WRENCH_TYPE](header=header(store, stamp), wrench=made)


def joints(store: Any, stamp: int, effort: bool = False, **positions: float) -> Any:
    places = np.array(list(positions.values()))
    efforts = 0.5 * places if effort else np.zeros(0)
    return store.types[JOINTS](
        header=header(store, stamp), name=list(positions), position=places, velocity=np.zeros(0), effort=efforts
    )


def forces(store: Any, stamps: list[int] = NANOSECONDS) -> Messages:
    return [
        ("/ft/wrench", WRENCH_TYPE, logged, wrench(store, stamp, force))
        for stamp, logged, force in zip(stamps, NANOSECONDS, FORCE.tolist(), strict=True)
    ]


def stage(store: Any, late: int = 0) -> Messages:
    """Positions of a stage at 50 Hz; `late` is what its clock is behind [ns]."""
    pairs = zip(NANOSECONDS[SLOW], WAY[SLOW].tolist(), strict=True)
    return [("/stage", JOINTS, stamp, joints(store, stamp - late, feed=1e-3 * way)) for stamp, way in pairs]


def odd_topics(store: Any) -> Messages:
    """The gripper on the stage's topic, effort that comes later, and arrays of changing length."""
    layout = store.types["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
    odd: Messages = []
    for k, stamp in enumerate(NANOSECONDS[::10]):
        odd.append(("/stage", JOINTS, stamp, joints(store, stamp, effort=k > 50, left=0.01, right=0.01)))
        data = np.arange(float(1 + k % 5))
        odd.append(("/tactile", ARRAY, stamp, store.types[ARRAY](layout=layout, data=data)))
    return odd


def ros2(messages: Messages, compression: CompressionType = CompressionType.ZSTD, chunk: int = 1 << 16) -> bytes:
    """Return a bag of ROS 2 as rosbag2's storage plugin for MCAP writes it."""
    file = io.BytesIO()
    writer = McapWriter(file, compression=compression, chunk_size=chunk)
    writer.start(profile="ros2", library="libmcap 1.1.0")
    channels: dict[tuple[str, str], int] = {}
    for topic, kind, logged, message in sorted(messages, key=lambda each: each[2]):
        if (topic, kind) not in channels:
            definition, _ = ROS.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", definition.encode())
            channels[topic, kind] = writer.register_channel(topic, "cdr", schema)
        writer.add_message(channels[topic, kind], logged, bytes(ROS.serialize_cdr(message, kind)), logged)
    writer.finish()
    return file.getvalue()


def bag(messages: Messages, **options: Any) -> Callable[[Path], None]:
    return lambda path: path.write_bytes(ros2(messages, **options)) and None


def killed(path: Path, compression: CompressionType) -> None:
    content = ros2([*forces(ROS), *stage(ROS)], compression)
    path.write_bytes(content[: content.rindex(b"ros2msg") - 2000])  # the summary repeats the schemas


add_file("rosbag2.mcap", "ROS 2", "wrench and joints", bag([*forces(ROS), *stage(ROS)]))
add_file(
    "odd_topics.mcap", "ROS 2", "two publishers, changing length", bag([*forces(ROS), *stage(ROS), *odd_topics(ROS)])
)
REPEATED = [stamp if k % 100 else NANOSECONDS[max(k - 1, 0)] for k, stamp in enumerate(NANOSECONDS)]
add_file("repeated.mcap", "ROS 2", "some stamps repeat", bag([*forces(ROS, REPEATED), *stage(ROS)]), left_out=13)
COARSE = [stamp // 10**7 * 10**7 for stamp in NANOSECONDS]
add_file("coarse.mcap", "ROS 2", "stamps of 100 Hz for 200 readings a second", bag([*forces(ROS, COARSE), *stage(ROS)]))
add_file("clocks.mcap", "ROS 2", "the stage's clock is an hour behind", bag([*forces(ROS), *stage(ROS, 3600 * 10**9)]))
for each in (CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD):
    killed_so = partial(killed, compression=each)
    add_file(f"killed_{each.name.lower()}.mcap", "ROS 2", f"killed, chunks: {each.name}", killed_so)


def ros1(path: Path) -> None:
    store = get_typestore(Stores.ROS1_NOETIC)
    with Ros1Writer(path) as writer:
        made = {}
        for topic, kind, logged, message in sorted([*forces(store), *stage(store)], key=lambda each: each[2]):
            if topic not in made:
                made[topic] = writer.add_connection(topic, kind, typestore=store)
            writer.write(made[topic], logged, store.serialize_ros1(message, kind))


def ros1_active(path: Path) -> None:
    """A bag whose recorder was killed: the header has no place of the index, and the index is not there."""
    ros1(path)
    content = bytearray(path.read_bytes())
    place = content.index(b"index_pos=") + len(b"index_pos=")
    (index,) = struct.unpack_from("<Q", content, place)
    content[place : place + 8] = bytes(8)
    path.write_bytes(content[:index])


add_file("rig.bag", "ROS 1", "wrench and joints", ros1)
add_file("rig.bag.active", "ROS 1", "killed", ros1_active)
