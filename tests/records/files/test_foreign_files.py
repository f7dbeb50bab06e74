"""Files of other programs that are no text: what is odd in them is said, and what cannot be read has a cure."""

from __future__ import annotations

import dataclasses
import gzip
import importlib
import json
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io
from lab_bags import ROS, CompressionType, forces, ros2, stage
from lab_binary import ROWS, workbook
from lab_cut import FORCE, FORMATS, RATE, TIME, WAY, N

from cutenv.commands import cli
from cutenv.records import ColumnMap, RecordError, load_foreign, read_record, save
from cutenv.records.foreign.files_by_suffix import FOREIGN_SUFFIXES, foreign_columns
from cutenv.records.importers import look_at

CONTENT = {each.name: each.content for each in FORMATS}


def given(folder: Path, name: str) -> Path:
    path = folder / name
    path.write_bytes(CONTENT[name])
    return path


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("two_clocks.mat", "no unit is given, s is assumed"),
        ("sheets.xlsx", "sheets that are left out: 'Results'"),
        ("demonstrations.hdf5", "left out beside the records: returns"),
        ("ragged.parquet", "left out, because they are no columns of numbers: cells (list<element: double>)"),
        ("coarse.mcap", "680 stamps repeat; the times of the log are taken"),
        ("clocks.mcap", "of different clocks; the times of the log are taken"),
        ("killed_zstd.mcap", "the recorder was killed, or the file lost its end; 1702 messages up to there"),
        ("rig.bag.active", "the recorder was killed, so it has no index; 1702 messages up to there"),
    ],
)
def test_what_is_odd_in_a_file_is_said(name: str, said: str, tmp_path: Path) -> None:
    imported = look_at(given(tmp_path, name))
    assert [note for note in imported.notes if said in note], imported.notes


@pytest.mark.parametrize("compression", list(CompressionType))
def test_a_chunk_of_which_part_is_left_is_read_so_far(compression: CompressionType, tmp_path: Path) -> None:
    content = ros2([*forces(ROS), *stage(ROS)], compression, chunk=1 << 24)
    path = tmp_path / "half.mcap"
    chunk = 17 + int.from_bytes(content[9:17], "little")  # behind the magic bytes and the header
    length = int.from_bytes(content[chunk + 1 : chunk + 9], "little")
    path.write_bytes(content[: chunk + 9 + int(0.85 * length)])
    (trace,) = look_at(path).records
    assert 0.3 * TIME[-1] < trace.duration < 0.9 * TIME[-1]
    assert np.allclose(trace.force, FORCE[: len(trace)], atol=1e-12)


def test_a_changed_byte_in_a_bag_is_noticed(tmp_path: Path) -> None:
    content = bytearray(ros2(forces(ROS), CompressionType.NONE))
    content[len(content) // 2] ^= 1
    (tmp_path / "rig.mcap").write_bytes(content)
    with pytest.raises(RecordError, match="its checksum is wrong"):
        foreign_columns(tmp_path / "rig.mcap")


def test_one_that_publishes_beside_another_gets_columns_of_its_own(tmp_path: Path) -> None:
    headers = foreign_columns(given(tmp_path, "odd_topics.mcap")).headers
    assert {"/stage.position.feed", "/stage.position.left", "/stage.effort.left", "/tactile.data.4"} <= {*headers}


def test_an_encoding_that_nobody_reads_costs_its_topic_alone(tmp_path: Path) -> None:
    from mcap.writer import Writer

    with (tmp_path / "more.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("x", "jsonschema", b"{}")
        odd, good = writer.register_channel("/odd", "cbor", schema), writer.register_channel("/ft", "json", schema)
        for k in range(N):
            writer.add_message(odd, k * 5_000_000, b"\x00", 0)
            writer.add_message(good, k * 5_000_000, json.dumps({"force_N": float(FORCE[k])}).encode(), 0)
        writer.finish()
    imported = look_at(tmp_path / "more.mcap")
    assert imported.records[0].force.max() == pytest.approx(FORCE.max())
    assert "/odd is left out: a message of it is not read (messages in cbor are not read)" in imported.notes


def test_the_folder_of_a_bag_is_one_record(tmp_path: Path) -> None:
    folder = tmp_path / "rig"
    folder.mkdir()
    messages = sorted([*forces(ROS), *stage(ROS)], key=lambda each: each[2])
    for k, part in enumerate((messages[:800], messages[800:])):
        (folder / f"rig_{k}.mcap").write_bytes(ros2(part))
    (folder / "metadata.yaml").write_text("rosbag2_bagfile_information:\n  version: 9\n")
    imported = look_at(folder)
    assert imported.records[0].duration == pytest.approx(TIME[-1])
    assert np.allclose(imported.records[0].force, FORCE)


READ_SO_FAR = ("waveform.tdms", "rosbag2.mcap", "rig.bag")  # made of parts, of which the first are whole


@pytest.mark.parametrize("name", ["plain.xlsx", "vectors.mat", "version_7_3.mat", "units.h5", "frame.parquet",
                                  "frame.feather", "waveform.tdms", "streams.xdf", "arrays.npz", "rosbag2.mcap",
                                  "rig.bag", "plain.xlsx.gz"])  # fmt: skip
@pytest.mark.parametrize("spoil", ["cut", "text", "none"])
def test_a_damaged_file_is_refused_by_name_or_read_so_far(name: str, spoil: str, tmp_path: Path) -> None:
    path = tmp_path / name
    whole = CONTENT[name]
    path.write_bytes({"cut": whole[: len(whole) // 3], "text": b"time,force\n1,2\n", "none": b""}[spoil])
    if spoil == "cut" and name in READ_SO_FAR:
        assert 0 < len(foreign_columns(path)) < N
        return
    with pytest.raises(RecordError, match=r"Take the file again|Save it again|Record .* too") as refused:
        foreign_columns(path)
    assert refused.value.path == path


LIBRARIES = {"plain.xlsx": "python_calamine", "waveform.tdms": "nptdms", "streams.xdf": "pyxdf",
             "version_7_3.mat": "h5py", "tactile.mcap": "google.protobuf.descriptor_pb2"}  # fmt: skip


@pytest.mark.parametrize("name", LIBRARIES)
def test_a_missing_library_is_answered_with_the_extra(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    importlib.invalidate_caches()
    monkeypatch.setitem(sys.modules, LIBRARIES[name], None)
    with pytest.raises(ModuleNotFoundError, match=r"is not installed: pip install 'cutenv\[formats\]'"):
        foreign_columns(given(tmp_path, name))


def test_a_table_of_matlab_is_named_with_its_cure(tmp_path: Path) -> None:
    """Tables are objects, which savemat cannot write; scipy marks them as this type."""
    import scipy.io.matlab

    from cutenv.records.foreign import array_files

    opaque = scipy.io.matlab.MatlabOpaque(
        np.zeros(1, dtype=[("s0", object), ("s1", object), ("s2", object), ("arr", object)])
    )
    notes: list[str] = []
    assert array_files._plain("T", opaque, notes) is None
    assert notes == ["T is a table or an object of MATLAB, which only MATLAB reads: writetable(T) there"]


def test_objects_of_python_are_not_unpickled(tmp_path: Path) -> None:
    np.savez(tmp_path / "odd.npz", about=np.array([{"a": 1}], dtype=object), time=TIME, force=FORCE)
    imported = look_at(tmp_path / "odd.npz")
    assert "about left out: it holds objects of Python, which are not unpickled" in imported.notes
    np.save(tmp_path / "odd.npy", np.array([{"a": 1}], dtype=object))
    with pytest.raises(RecordError, match="it is no file of NumPy"):
        foreign_columns(tmp_path / "odd.npy")


def test_what_has_no_times_and_no_rate_is_asked_for_them(tmp_path: Path) -> None:
    scipy.io.savemat(tmp_path / "a.mat", {"force_N": FORCE, "step": 3.0})
    with pytest.raises(RecordError, match="How many readings a second"):
        look_at(tmp_path / "a.mat")


def test_an_image_beside_the_readings_is_left_out_with_its_shape(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", time=TIME, force_N=FORCE, picture=np.zeros((480, 640)))
    imported = look_at(tmp_path / "a.npz")
    assert "picture left out: its shape (480, 640) is that of no table" in imported.notes


# Data sets of LeRobot, after the description of its format v3.0 and, an episode a file, v2.1.


def lerobot(folder: Path, wrench: dict[str, Any], values: np.ndarray[Any, Any], *, fps: float, version: str) -> Path:
    """Write a data set of two episodes with the force in a feature of this description; return its folder."""
    (folder / "meta").mkdir(parents=True)
    frames = len(values)
    scalar = {"dtype": "int64", "shape": [1], "names": None}
    features = {
        "observation.wrench": wrench,
        "observation.state": {"dtype": "float32", "shape": [2], "names": {"motors": ["x_mm", "gripper"]}},
        "observation.images.wrist": {"dtype": "video", "shape": [480, 640, 3], "names": ["height", "width", "channel"]},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        **dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), scalar),
    }
    info = {"codebase_version": version, "fps": fps, "robot_type": "ur5e", "total_episodes": 2, "features": features}
    (folder / "meta/info.json").write_text(json.dumps(info))
    way = WAY[:: N // frames][:frames]
    for episode in (0, 1):
        table = pa.table({
            "observation.wrench": ((1.0 - 0.2 * episode) * values).tolist(),
            "observation.state": np.column_stack([way, np.zeros(frames)]).tolist(),
            "timestamp": (np.arange(frames) / fps).astype(np.float32), "frame_index": np.arange(frames),
            "episode_index": np.full(frames, episode), "index": episode * frames + np.arange(frames),
            "task_index": np.zeros(frames, int),
        })  # fmt: skip
        place = folder / ("data/chunk-000/" + (f"episode_{episode:06d}" if version < "v3" else f"file-{episode:03d}"))
        place.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(table, place.with_suffix(".parquet"))
    return folder


SIX = np.column_stack([FORCE, 0.0 * FORCE, 0.0 * FORCE, *[0.01 * FORCE] * 3]).astype(np.float32)
NAMES = ["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"]


@pytest.mark.parametrize("version", ["v2.1", "v3.0"])
@pytest.mark.parametrize(
    ("described", "asks"),
    [
        ({"names": NAMES}, 1),
        ({"names": {"axes": NAMES}, "info": {"unit": ["N"] * 3 + ["N m"] * 3, "frame": "tool"}}, 0),
        ({"names": [f"{name}_N" if name[0] == "F" else f"{name}_Nm" for name in NAMES]}, 0),
        ({"names": None}, 1),
    ],
)
def test_every_episode_with_a_wrench_is_a_record(
    described: dict[str, Any], asks: int, version: str, tmp_path: Path
) -> None:
    wrench = {"dtype": "float32", "shape": [6], **described}
    imported = look_at(lerobot(tmp_path / "set", wrench, SIX, fps=RATE, version=version))
    assert len(imported.questions) == asks
    assert [record.duration for record in imported.records] == [pytest.approx(TIME[-1])] * 2
    assert [record.force.max() for record in imported.records] == [
        pytest.approx(share * FORCE.max(), rel=1e-5) for share in (1.0, 0.8)
    ]
    assert all(np.ptp(record.position) == pytest.approx(0.030) for record in imported.records)


def test_a_sensor_that_is_faster_than_the_frames_is_read_in_full(tmp_path: Path) -> None:
    """Readings between two frames in one cell, an array of shape (readings, components)."""
    frames = N // 4
    window = SIX[: 4 * frames].reshape(frames, 4, 6)
    wrench = {"dtype": "float32", "shape": [4, 6], "names": NAMES, "info": {"unit": "N"}}
    imported = look_at(lerobot(tmp_path / "set", wrench, window, fps=RATE / 4, version="v3.0"))
    first = imported.records[0]
    assert np.allclose(first.time, TIME[: 4 * frames], atol=1e-6)
    assert np.allclose(first.force, FORCE[: 4 * frames], atol=1e-6)


def test_our_own_data_set_comes_back_with_its_force_and_position(tmp_path: Path) -> None:
    from cutenv.agents.learning.lerobot import write_lerobot
    from cutenv.commands.datasets import Arguments, cuts_of

    keywords, cuts = cuts_of(Arguments(dataset="cutenv/x", format="lerobot", policy="probe and creep", cuts=2))
    write_lerobot(tmp_path / "set", "x", keywords, cuts)
    imported = look_at(tmp_path / "set")
    assert not imported.questions
    for record, cut in zip(imported.records, cuts, strict=True):
        assert np.allclose(record.force, cut.infos["force_N"][:-1], atol=1e-5)
        assert np.allclose(record.position, cut.infos["position_m"][:-1], atol=1e-6)
        assert np.allclose(np.diff(record.time), 0.1, atol=1e-4)


# Folders.


def test_a_folder_is_scored_whatever_we_wrote_into_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (cut,) = load_foreign(given(tmp_path, "rosbag2.mcap"), look_at(given(tmp_path, "rosbag2.mcap")).mapping).traces
    (tmp_path / "cuts").mkdir()
    for k, suffix in enumerate((".csv", ".mcap", ".parquet", ".h5")):
        save([cut.with_metadata({"name": f"c{k}"})], tmp_path / "cuts" / f"c{k}{suffix}")
    assert cli.main(["score", str(tmp_path / "cuts"), "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    assert [k for k in range(4) if f"c{k}:" not in out] == []


def test_a_folder_with_a_map_is_scored_whatever_another_program_wrote(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "rig"
    folder.mkdir()
    workbook(Data=[["Time", "Force", "Position"], ["s", "N", "mm"], *ROWS])(folder / "a.xlsx")
    scipy.io.savemat(folder / "b.mat", {"Time_s": TIME, "Force_N": FORCE, "Position_mm": WAY})
    text = "\n".join(["Time [s]\tForce [N]\tPosition [mm]", *("\t".join(map(str, row)) for row in ROWS)])
    (folder / "c.txt").write_text(text)
    (folder / "d.txt.gz").write_bytes(gzip.compress(text.encode()))
    (folder / "picture.png").write_bytes(b"\x89PNG")
    assert cli.main(["score", str(folder), "--out", str(tmp_path / "out")]) == 2
    assert "no records in" in capsys.readouterr().err
    columns = ["--map", "time=Time", "force=Force", "position=Position"]
    assert cli.main(["score", str(folder), "--out", str(tmp_path / "out"), *columns]) == 0
    out = capsys.readouterr().out
    assert [name for name in ("a:", "b:", "c:", "d.txt:") if name not in out] == []
    assert cli.main(["score", str(folder), "--out", str(tmp_path / "again")]) == 0  # by the map that was kept


def test_the_folders_of_bags_and_data_sets_in_a_folder_are_found(tmp_path: Path) -> None:
    from types import SimpleNamespace

    from cutenv.commands.inputs import record_files

    (tmp_path / "rig_7").mkdir()
    (tmp_path / "rig_7/rig_7_0.mcap").write_bytes(CONTENT["killed_lz4.mcap"])
    (tmp_path / "other").mkdir()
    found = lerobot(tmp_path / "set", {"dtype": "float32", "shape": [6], "names": NAMES}, SIX, fps=RATE, version="v3.0")
    arguments = SimpleNamespace(records=[tmp_path], map=None)
    assert record_files(arguments) == [tmp_path / "rig_7", found]
    assert record_files(SimpleNamespace(records=[tmp_path / "rig_7"], map=None)) == [tmp_path / "rig_7"]


def test_a_record_of_ours_keeps_its_names_and_takes_no_map(tmp_path: Path) -> None:
    trace = look_at(given(tmp_path, "plain.xlsx")).records[0]
    for suffix in (".parquet", ".h5", ".mcap"):
        path = tmp_path / f"ours{suffix}"
        save([dataclasses.replace(trace, metadata={})], path)
        with pytest.raises(RecordError, match="a mapping is for other programs' files"):
            read_record(path, ColumnMap.parse(["time=time_s", "force=force_N"]))
        path.write_bytes(path.read_bytes()[:-40])
        with pytest.raises(RecordError, match=r"Take the file again|Take it again|damaged"):
            read_record(path)


def test_every_suffix_that_is_read_stands_in_the_documentation() -> None:
    page = (Path(__file__).parents[3] / "docs/how-to/foreign-records.md").read_text(encoding="utf-8")
    assert [suffix for suffix in FOREIGN_SUFFIXES if f"`{suffix}`" not in page] == []


def test_a_series_on_another_clock_is_said(tmp_path: Path) -> None:
    path, times = tmp_path / "two_clocks.h5", np.arange(600) / 100.0
    with h5py.File(path, "w") as file:
        for group, name, clock, values in (
            ("sensor", "force", 1.714e9 + times, np.sin(times)),
            ("stage", "position", times, times / 300.0),
        ):
            file[f"{group}/time_s"] = clock[:: 1 if group == "sensor" else 2]
            file[f"{group}/{name}"] = values[:: 1 if group == "sensor" else 2]
            file[f"{group}/{name}"].attrs["unit"] = "N" if name == "force" else "m"
    understood = look_at(path)
    assert understood.records[0].position is None
    assert any("no reading of stage.time_s lies in the time of sensor.time_s" in note for note in understood.notes)
