"""One cut in files that are no text, written by their makers' libraries or after their makers' descriptions."""

from __future__ import annotations

import datetime
import gzip
import io
import json
import struct
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import openpyxl
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import scipy.io
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from lab_formats import (
    EPOCH,
    FORCE,
    OTHER_FORCE,
    OTHER_WAY,
    RATE,
    START,
    TIME,
    TWO,
    WAY,
    LabFormat,
    N,
    Truth,
)  # fmt: skip
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from nptdms import ChannelObject, RootObject, TdmsWriter
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.typesys import Stores, get_typestore

BINARY: list[LabFormat] = []
ROWS = list(zip(TIME.tolist(), FORCE.tolist(), WAY.tolist(), strict=True))
OTHER_ROWS = list(zip(TIME.tolist(), OTHER_FORCE.tolist(), OTHER_WAY.tolist(), strict=True))
STAMPS = (np.datetime64(START, "us") + (TIME * 1e6).round().astype("timedelta64[us]")).astype("datetime64[us]")
SLOW = slice(None, None, 4)  # readings of a stage at 50 Hz
NANOSECONDS = [EPOCH * 10**9 + round(time * 1e9) for time in TIME.tolist()]


def add(name: str, maker: str, about: str, write: Callable[[Path], object], **facts: Any) -> None:
    """Add what a function writes to a path of this name."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        BINARY.append(LabFormat(name=name, maker=maker, about=about, content=path.read_bytes(), **facts))


# Workbooks: openpyxl writes as Excel does.


def workbook(**sheets: list[Any]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        book = openpyxl.Workbook()
        book.remove(book.active)
        for title, rows in sheets.items():
            sheet = book.create_sheet(title.replace("_", " "))
            for row in rows:
                sheet.append(row)
        book.save(path)

    return write


HEADER = ["Time (s)", "Force (N)", "Position (mm)"]
add("plain.xlsx", "Excel", "one sheet", workbook(Sheet1=[HEADER, *ROWS]))
add(
    "units_row.xlsx", "Bluehill", "facts above, a row of units",
    workbook(Sheet1=[["Specimen", "liver 3"], ["Operator", 7], [], ["Zeit", "Kraft", "Weg"], ["s", "mN", "mm"],
                     *[(time, 1e3 * force, way) for time, force, way in ROWS]]),
)  # fmt: skip
add(
    "moments.xlsx", "Excel", "cells with date and time",
    workbook(Data=[["Timestamp", "Load [N]", "Extension [mm]"],
                   *[(START + datetime.timedelta(seconds=time), force, way) for time, force, way in ROWS]]),
)  # fmt: skip
add(
    "excel_days.xlsx", "a macro", "days since 1900 as plain numbers",
    workbook(Data=[["Time", "Force [N]", "Position [mm]"],
                   *[(46083.5 + time / 86400.0, force, way) for time, force, way in ROWS]]),
)  # fmt: skip
add(
    "text_cells.xlsx", "a German export", "numbers kept as text with a decimal comma",
    workbook(Data=[["Zeit [s]", "Kraft [N]", "Weg [mm]"],
                   *[[f"{value:.4f}".replace(".", ",") for value in row] for row in ROWS]]),
)  # fmt: skip
add(
    "offset_table.xlsx", "LabVIEW", "the table begins at C3, a gap, and a line of results below",
    workbook(Data=[[], [], [None, None, "t [ms]", "F [N]", "x [mm]"],
                   *[(None, None, 1e3 * time, force, way) for time, force, way in ROWS[:70]],
                   (None, None, 1e3 * TIME[70], None, WAY[70]),
                   *[(None, None, 1e3 * time, force, way) for time, force, way in ROWS[71:]],
                   [None, None, "Maximum", 3.13, 30.0]]),
    left_out=2,
)  # fmt: skip
TESTER = [["Time", "Force", "Displacement"], ["s", "N", "mm"]]
add(
    "sheets.xlsx", "TestXpert", "results, then a sheet for each specimen",
    workbook(Results=[["Specimen", "Fmax"], ["", "N"], [1, 3.13], [2, 2.71]],
             Specimen_1=[*TESTER, *ROWS], Specimen_2=[*TESTER, *OTHER_ROWS]),
    truth=TWO,
)  # fmt: skip
add(
    "text.xls", "many loggers", "text with tabs, called a workbook",
    lambda path: path.write_text("\n".join(["\t".join(HEADER), *("\t".join(map(str, row)) for row in ROWS)])),
)  # fmt: skip

# MATLAB: savemat writes versions 4 and 5; version 7.3 is HDF5 behind 512 bytes, with the class of each variable.


def saved(**facts: Any) -> Callable[[Path], None]:
    options = {name: facts.pop(name) for name in ("format", "do_compression", "oned_as") if name in facts}
    return lambda path: scipy.io.savemat(path, facts, **options)


def cells(*texts: str) -> Any:
    return np.array(texts, dtype=object)


add("vectors.mat", "MATLAB", "save t F x", saved(t=TIME, F=FORCE, x_mm=WAY, oned_as="column"), asks=1)
add("version_4.mat", "Octave -v4", "version 4", saved(t=TIME, F_N=FORCE, x_mm=WAY, format="4"))
add("packed.mat", "MATLAB -v7", "compressed", saved(time_s=TIME, force_N=FORCE, pos_mm=WAY, do_compression=True))
add(
    "structure.mat", "MATLAB", "a structure with its units beside it",
    saved(rec={"time": TIME, "force": 1e3 * FORCE, "pos": WAY, "units": cells("s", "mN", "mm")}),
)  # fmt: skip
add(
    "units_by_name.mat", "MATLAB", "units in a structure of the same names",
    saved(time=TIME, force=FORCE, pos=WAY, units={"time": "s", "force": "N", "pos": "mm"}),
)  # fmt: skip
add("rate.mat", "MATLAB", "no time, but Fs", saved(Fs=RATE, force_N=FORCE, pos_mm=WAY))
add("step.mat", "MATLAB", "no time, but dt in ms", saved(dt_ms=1e3 / RATE, force_N=FORCE, pos_mm=WAY))
add(
    "labelled.mat", "importdata", "a matrix with colheaders",
    saved(data=np.column_stack([TIME, FORCE, WAY]), colheaders=cells("t (s)", "Load (N)", "Crosshead (mm)")),
)  # fmt: skip
add(
    "acknowledge.mat", "BIOPAC AcqKnowledge", "data, labels, units, isi",
    saved(data=np.column_stack([1e3 * FORCE, WAY]), labels=np.array(["Force   ", "Position"]),
          units=np.array(["mN", "mm"]), isi=5.0, isi_units="ms", start_sample=0.0),
)  # fmt: skip


def labchart(path: Path) -> None:
    """Two blocks of two channels in one row, with the places from 1 on, as ADInstruments describes its export."""
    data = np.concatenate([1e3 * FORCE, WAY, 1e3 * OTHER_FORCE, OTHER_WAY])
    starts = 1 + N * np.array([[0, 2], [1, 3]])
    scipy.io.savemat(path, {
        "data": data[None], "datastart": starts, "dataend": starts + N - 1, "titles": np.array(["Force", "Travel"]),
        "unittext": np.array(["mN", "mm"]), "unittextmap": np.array([[1, 1], [2, 2]]),
        "samplerate": np.full((2, 2), RATE), "tickrate": np.full((1, 2), RATE), "blocktimes": [[740042.4, 740042.5]],
    })  # fmt: skip


add("labchart.mat", "LabChart", "blocks in one row", labchart, truth=TWO)
add(
    "several.mat", "MATLAB", "an array of structures",
    saved(trial=np.array([[(TIME, FORCE, WAY), (TIME, OTHER_FORCE, OTHER_WAY)]],
                         dtype=[("time_s", object), ("force_N", object), ("pos_mm", object)])),
    truth=TWO,
)  # fmt: skip
add(
    "two_clocks.mat", "MATLAB", "force at 200 Hz, position at 50 Hz, each with its times",
    saved(t_force=TIME, force_N=FORCE, t_pos=TIME[SLOW], pos_mm=WAY[SLOW]),
)  # fmt: skip
add(
    "datenum.mat", "MATLAB", "datenum: days since the year 0",
    saved(time=740042.4244444444 + TIME / 86400.0, force_N=FORCE, pos_mm=WAY),
)  # fmt: skip


def version_7_3(path: Path) -> None:
    """Write variables as MATLAB does with -v7.3: columns first, text as codes, cells as references."""
    with h5py.File(path, "w", userblock_size=512) as file:

        def variable(group: Any, name: str, values: Any, kind: str = "double") -> Any:
            made = group.create_dataset(name, data=values)
            made.attrs["MATLAB_class"] = np.bytes_(kind)
            return made

        variable(file, "matrix", np.stack([TIME, FORCE, WAY]))
        labels = ("t [s]", "F [N]", "x [mm]")
        refs = [
            variable(file, f"#refs#/{k}", np.array([[ord(letter)] for letter in text], "u2"), "char").ref
            for k, text in enumerate(labels)
        ]
        variable(file, "names", np.array(refs, dtype=h5py.ref_dtype)[:, None], "cell")
        noted = file.create_group("about")
        noted.attrs["MATLAB_class"] = np.bytes_("struct")
        variable(noted, "specimen", np.array([[ord(letter)] for letter in "liver"], "u2"), "char")
    with path.open("r+b") as content:
        content.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64 HDF5 schema 1.00 .".ljust(124) + b"\x00\x02IM")


add("version_7_3.mat", "MATLAB -v7.3", "a matrix, and a cell array of its names", version_7_3)

# NumPy.
add("arrays.npz", "NumPy", "savez", lambda path: np.savez(path, time=TIME, force=FORCE, position_mm=WAY), asks=1)
add(
    "matrix.npz", "NumPy", "a matrix by rows, and its rate",
    lambda path: np.savez_compressed(path, force_N=FORCE, x_mm=WAY, fs=RATE),
)  # fmt: skip
RECORDS = np.array(ROWS, dtype=[("time_s", "f8"), ("force_N", "f4"), ("pos_mm", "f4")])
add("records.npy", "NumPy", "an array of records", lambda path: np.save(path, RECORDS))

# HDF5.


def hdf5(fill: Callable[[Any], None]) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with h5py.File(path, "w") as file:
            fill(file)

    return write


def with_units(file: Any) -> None:
    for name, values, unit in (("time", TIME, "s"), ("Fz", FORCE, "N"), ("disp", WAY, "mm")):
        file.create_dataset(f"measurement/{name}", data=values).attrs["units"] = unit


def one_dataset(file: Any) -> None:
    made = file.create_dataset("daq/raw", data=np.column_stack([FORCE, WAY]).astype("f4"))
    made.attrs["sampling_rate"], made.attrs["columns"], made.attrs["units"] = RATE, ["force", "position"], ["N", "mm"]


def compound(file: Any) -> None:
    file["table"] = RECORDS


def trials(file: Any) -> None:
    for k, (force, way) in enumerate([(FORCE, WAY), (OTHER_FORCE, OTHER_WAY)]):
        group = file.create_group(f"data/demo_{k}")
        group.attrs["num_samples"] = N
        group["time_s"], group["obs/force_N"], group["obs/x_mm"] = TIME, force, way
        group["dones"] = np.arange(N) == N - 1
    file["mask/train"] = np.array([b"demo_0", b"demo_1"])


def frame(file: Any) -> None:
    """Write a DataFrame as pandas does with format="fixed"."""
    group = file.create_group("df")
    group.attrs["pandas_type"] = "frame"
    group["axis0"], group["axis1"] = np.array([name.encode() for name in HEADER]), np.arange(N)
    group["block0_items"], group["block0_values"] = group["axis0"][()], np.array(ROWS)


add("units.h5", "h5py", "groups, units in attributes", hdf5(with_units))
add("raw.hdf5", "a logger", "one dataset, names and rate in attributes", hdf5(one_dataset))
add("compound.h5", "PyTables", "a table of records", hdf5(compound))
add("demonstrations.hdf5", "robomimic", "a group for each demonstration", hdf5(trials), truth=TWO)
add("frame.h5", "pandas", "to_hdf", hdf5(frame))

# Parquet and Feather.
FRAME = pd.DataFrame({"Time (s)": TIME, "Force (N)": FORCE, "Position (mm)": WAY})
MOMENTS = FRAME.drop(columns="Time (s)").set_index(pd.DatetimeIndex(STAMPS, tz="Europe/Berlin", name="when"))
add("frame.parquet", "pandas", "to_parquet", FRAME.to_parquet)
add("frame.feather", "pandas", "to_feather", FRAME.to_feather)
add("moments.parquet", "pandas", "times with a zone as the index", MOMENTS.to_parquet)
WRENCH = [[force, 0.1, -0.2, 0.0, 0.0, 0.01] for force in FORCE.tolist()]
add(
    "nested.parquet", "a robot's logger", "a wrench as a list in each cell, a pose as a structure",
    lambda path: pq.write_table(pa.table({
        "timestamp": TIME, "observation.wrench": WRENCH, "pose": pa.StructArray.from_arrays([pa.array(WAY)], ["x_mm"]),
    }), path),
    asks=1,
)  # fmt: skip
add(
    "gaps.parquet", "pandas", "nulls, a column of text, decimals",
    lambda path: pq.write_table(pa.table({
        "t_s": TIME, "force_N": [None if k == 30 else force for k, force in enumerate(FORCE.tolist())],
        "note": ["" if k else "start" for k in range(N)], "x_mm": pa.array(WAY.round(3)).cast(pa.decimal128(12, 3)),
    }), path),
    left_out=1,
)  # fmt: skip
add(
    "episodes.parquet", "LeRobot", "one file of a data set, two episodes",
    lambda path: pq.write_table(pa.table({
        "observation.force_N": np.concatenate([FORCE, OTHER_FORCE]),
        "observation.position_mm": np.concatenate([WAY, OTHER_WAY]), "timestamp": np.tile(TIME, 2).astype(np.float32),
        "frame_index": np.tile(np.arange(N), 2), "episode_index": np.repeat([0, 1], N), "index": np.arange(2 * N),
        "task_index": np.zeros(2 * N, int),
    }), path),
    truth=TWO,
)  # fmt: skip

# TDMS: TdmsWriter writes as LabVIEW does; waveforms have wf_increment [s].


def tdms(*channels: Any) -> Callable[[Path], None]:
    def write(path: Path) -> None:
        with TdmsWriter(path) as writer:
            writer.write_segment([RootObject({"Operator": "7"}), *channels])

    return write


def waveform(group: str, name: str, values: Any, unit: str, step: float = 1.0 / RATE) -> Any:
    facts = {"wf_increment": step, "wf_start_offset": 0.0, "wf_samples": len(values), "unit_string": unit}
    return ChannelObject(group, name, values, facts)


add(
    "waveform.tdms", "LabVIEW", "waveforms",
    tdms(waveform("Untitled", "Force", FORCE, "N"), waveform("Untitled", "Position", WAY, "mm")),
)  # fmt: skip
add(
    "channels.tdms", "DIAdem", "a channel of times, milli-newtons",
    tdms(ChannelObject("M", "Time", TIME, {"unit_string": "s"}),
         ChannelObject("M", "Kraft", 1e3 * FORCE, {"NI_UnitDescription": "mN"}),
         ChannelObject("M", "Weg", WAY, {"unit_string": "mm"})),
)  # fmt: skip
add(
    "stamps.tdms", "FlexLogger", "time stamps",
    tdms(ChannelObject("Log", "Timestamp", STAMPS), ChannelObject("Log", "Force", FORCE, {"unit_string": "N"}),
         ChannelObject("Log", "Position", WAY, {"unit_string": "mm"})),
)  # fmt: skip
add(
    "groups.tdms", "LabVIEW", "a group for each specimen",
    tdms(*(waveform(group, name, values, unit)
           for group, pair in (("Liver A", (FORCE, WAY)), ("Liver B", (OTHER_FORCE, OTHER_WAY)))
           for name, values, unit in zip(("Force", "Travel"), pair, ("N", "mm"), strict=True))),
    truth=TWO,
)  # fmt: skip
add(
    "rates.tdms", "LabVIEW", "two rates",
    tdms(waveform("Load", "Force", FORCE, "N"), waveform("Stage", "Position", WAY[SLOW], "mm", 4.0 / RATE)),
)  # fmt: skip


# XDF 1.0: chunks of length, tag and content (github.com/sccn/xdf/wiki/Specifications).


def xdf(path: Path) -> None:
    def chunk(tag: int, content: bytes) -> bytes:
        return b"\x04" + struct.pack("<IH", len(content) + 2, tag) + content

    def stream(number: int, name: str, rate: float, channels: dict[str, str], times: Any, rows: Any) -> Iterator[bytes]:
        described = "".join(f"<channel><label>{k}</label><unit>{unit}</unit></channel>" for k, unit in channels.items())
        head = (
            f'<?xml version="1.0"?><info><name>{name}</name><type>Force</type><channel_count>{len(channels)}'
            f"</channel_count><nominal_srate>{rate}</nominal_srate><channel_format>double64</channel_format>"
            f"<desc><channels>{described}</channels></desc></info>"
        )
        yield chunk(2, struct.pack("<I", number) + head.encode())
        samples = b"".join(
            b"\x08" + struct.pack(f"<d{len(row)}d", time, *row) for time, row in zip(times, rows, strict=True)
        )
        yield chunk(3, struct.pack("<IBI", number, 4, len(times)) + samples)
        foot = f"<info><sample_count>{len(times)}</sample_count></info>"
        yield chunk(6, struct.pack("<I", number) + foot.encode())

    force = stream(1, "Sensor", RATE, {"Fx": "N", "Fy": "N"}, 5000.0 + TIME, np.column_stack([FORCE, 0.0 * FORCE]))
    stage = stream(2, "Stage", RATE / 4, {"Position": "mm"}, 5000.0 + TIME[SLOW], WAY[SLOW, None])
    head = chunk(1, b'<?xml version="1.0"?><info><version>1.0</version></info>')
    path.write_bytes(b"XDF:" + head + b"".join(force) + b"".join(stage))


add("streams.xdf", "LabRecorder", "two streams with labels and units", xdf)

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


add("tree.mcap", "Foxglove", "JSON with times of their own", mcap_of_json)
add("tactile.mcap", "Foxglove", "Protobuf in LZ4", mcap_of_protobuf)

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


add("rosbag2.mcap", "ROS 2", "wrench and joints", bag([*forces(ROS), *stage(ROS)]))
add("odd_topics.mcap", "ROS 2", "two publishers, changing length", bag([*forces(ROS), *stage(ROS), *odd_topics(ROS)]))
REPEATED = [stamp if k % 100 else NANOSECONDS[max(k - 1, 0)] for k, stamp in enumerate(NANOSECONDS)]
add("repeated.mcap", "ROS 2", "some stamps repeat", bag([*forces(ROS, REPEATED), *stage(ROS)]), left_out=13)
COARSE = [stamp // 10**7 * 10**7 for stamp in NANOSECONDS]
add("coarse.mcap", "ROS 2", "stamps of 100 Hz for 200 readings a second", bag([*forces(ROS, COARSE), *stage(ROS)]))
add("clocks.mcap", "ROS 2", "the stage's clock is an hour behind", bag([*forces(ROS), *stage(ROS, 3600 * 10**9)]))
for each in (CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD):
    name = each.name.lower()
    add(f"killed_{name}.mcap", "ROS 2", f"killed, chunks: {name}", lambda path, each=each: killed(path, each),
        truth=(Truth(duration_s=TIME[-1]),))  # fmt: skip


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


add("rig.bag", "ROS 1", "wrench and joints", ros1)
add("rig.bag.active", "ROS 1", "killed", ros1_active)

# Packed.
for plain in [each for each in BINARY if each.name in ("plain.xlsx", "packed.mat", "frame.parquet", "waveform.tdms")]:
    BINARY.append(
        LabFormat(name=f"{plain.name}.gz", maker="gzip", about=plain.name, content=gzip.compress(plain.content))
    )
TEXT = "\n".join([",".join(HEADER), *(",".join(map(str, row)) for row in ROWS)])
BINARY.append(LabFormat(name="table.csv.gz", maker="gzip", about="text", content=gzip.compress(TEXT.encode())))
