"""Bags of ROS without ROS: ours are read by others' libraries, others' are read by us, and damaged ones are refused."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from bags import force_at, position_at, write_bag
from made_up import FULL
from rosbags.highlevel import AnyReader

from cutenv.commands import cli
from cutenv.records import ColumnMap, RecordError, load, load_foreign, read_record, save
from cutenv.sim.trace import COMPONENTS_OF_FORCE, Trace

KINDS = ("mcap", "db3", "bag")
MAP = ["time=stamp", "force=-/ft/wrench.wrench.force.x", "position=/stage.position.feed[m]", "depth=20mm"]
SIX = Trace(
    time=FULL.time,
    force=FULL.force,
    position=FULL.position,
    vertical_force=-FULL.force,
    **{name: FULL.force * k for k, name in enumerate(COMPONENTS_OF_FORCE)},
    metadata={"date": "2026-03-01T14:05:00+01:00"},
)


@pytest.fixture(scope="module")
def bags(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("bags")
    return {kind: write_bag(folder, kind) for kind in KINDS}


def test_another_library_reads_our_cut_as_standard_messages_in_si(tmp_path: Path) -> None:
    save([FULL, SIX], tmp_path / "cuts.mcap")
    found: dict[str, list] = {}
    with AnyReader([tmp_path / "cuts.mcap"]) as reader:
        for connection, stamp, content in reader.messages():
            found.setdefault(connection.topic, []).append((stamp, reader.deserialize(content, connection.msgtype)))
    assert {topic: len(messages) for topic, messages in found.items()} == {
        f"/cut_{k}/{name}": len(FULL) for k in (0, 1) for name in ("reading", "wrench", "blade")
    }
    wrench, blade = found["/cut_0/wrench"][-1][1], found["/cut_0/blade"][-1][1]
    assert wrench.wrench.force.x == FULL.force[-1]
    assert wrench.header.frame_id == "cut"
    assert blade.name == ["feed", "tilt"]
    assert blade.position.tolist() == [FULL.position[-1], FULL.angle[-1]]
    assert blade.velocity[0] == FULL.speed[-1]
    stamp, six = found["/cut_1/wrench"][-1]
    assert six.header.frame_id == "sensor"
    assert six.wrench.torque.z == SIX.torque_z[-1]
    assert stamp == 1772370300 * 10**9 + round(
        SIX.time[-1] * 1e9
    )  # the date of the record, and how long it has gone on
    assert found["/cut_1/reading"][3][1].vertical_force == SIX.vertical_force[3]
    assert np.isnan(found["/cut_0/reading"][3][1].height)


@pytest.mark.parametrize("kind", KINDS)
def test_a_bag_of_a_robot_is_read_by_its_topics(bags: dict[str, Path], kind: str) -> None:
    imported = load_foreign(bags[kind], ColumnMap.parse(MAP), search=None)
    (trace,) = imported.records
    assert trace.force_unit == "N"
    assert np.allclose(trace.force, [force_at(time) for time in trace.time], atol=1e-12)
    assert np.allclose(trace.position, [position_at(time) for time in trace.time], atol=1.3e-4 / 4)
    assert np.allclose(np.diff(trace.time), 0.002, atol=1e-6)
    assert trace.depth is not None
    assert np.ptp(trace.depth) == 0.0


def test_the_cut_in_a_bag_is_found_and_its_offset_taken_off(bags: dict[str, Path]) -> None:
    imported = load_foreign(bags["mcap"], ColumnMap.parse(MAP))
    (cut,) = imported.sound
    assert cut.metadata["tare_N"]["/ft/wrench.wrench.force.x"] == pytest.approx(0.4)
    assert cut.force.max() == pytest.approx(3.75, abs=0.02)


def test_a_bag_without_a_map_is_answered_with_one_that_reads_it(bags: dict[str, Path]) -> None:
    with pytest.raises(RecordError) as refused:
        read_record(bags["bag"])
    guess = str(refused.value).rpartition("--map ")[2].split()
    assert "/stage.position.feed" in str(refused.value)
    assert "/camera" not in str(refused.value)
    trace = read_record(bags["bag"], ColumnMap.parse(guess), search=None).records[0]
    assert trace.force[0] == pytest.approx(0.4)  # the bag counts the force negative, and the map turns it


def test_topics_that_do_not_overlap_are_cut_to_where_both_are(tmp_path: Path) -> None:
    trace = load_foreign(write_bag(tmp_path, "mcap", joints_from=1.0), ColumnMap.parse(MAP), search=None).records[0]
    assert trace.time[0] == pytest.approx(1.0 - 0.01, abs=1e-3)  # a step of the joints earlier


@pytest.mark.parametrize(
    ("items", "said"),
    [
        (["time=stamp", "force=/ft/wrench.wrench.force.w"], "there is no column '/ft/wrench.wrench.force.w'"),
        (["time=stamp", "force=/stage.position.tilt"], "unit of force is not known"),
        (["time=stamp", "force=/ft/wrench.wrench.force.x[mN]"], "mapped in mN, but the file has N"),
        (["time=/ft/wrench.wrench.force.y[s]", "force=/ft/wrench.wrench.force.x"], "is in N, which is no time"),
    ],
)
def test_a_wrong_map_is_refused_with_the_reason(bags: dict[str, Path], items: list[str], said: str) -> None:
    with pytest.raises(RecordError) as refused:
        load_foreign(bags["mcap"], ColumnMap.parse(items), search=None)
    assert said in str(refused.value)


def test_a_reading_that_is_no_number_is_left_out_and_named(tmp_path: Path) -> None:
    imported = load_foreign(write_bag(tmp_path, "mcap", bad=True), ColumnMap.parse(MAP), search=None)
    (left_out,) = imported.left_out
    assert left_out.count == 1
    assert re.search(r"reading 701: 'nan' in column .*force\.x", left_out.reason)
    assert 701 not in (imported.records[0].time * 500 + 1).round()


@pytest.mark.parametrize("kind", ["mcap", "bag"])
def test_a_bag_whose_recorder_was_killed_is_read_up_to_there(bags: dict[str, Path], kind: str, tmp_path: Path) -> None:
    content = bags[kind].read_bytes()
    path = tmp_path / f"half.{kind}"
    path.write_bytes(content[: len(content) // 2])
    imported = load_foreign(path, ColumnMap.parse(MAP), search=None)
    (trace,) = imported.records
    assert 1.0 < trace.duration < 3.0
    assert np.allclose(trace.force, [force_at(time) for time in trace.time], atol=1e-12)
    assert any("the recorder was killed" in note for note in imported.notes)


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_bag_is_refused(bags: dict[str, Path], kind: str, tmp_path: Path) -> None:
    content = bags[kind].read_bytes()
    spoilt = {"none": b"", "text": b"time,force\n1,2\n"} | (
        {"half": content[: len(content) // 2]} if kind == "db3" else {}
    )
    for name, damaged in spoilt.items():
        path = tmp_path / f"{name}.{kind}"
        path.write_bytes(damaged)
        with pytest.raises(RecordError, match=r"no bag of ROS, or a damaged one|no two readings"):
            load_foreign(path, ColumnMap.parse(MAP))


def test_convert_carries_records_through_every_format_without_a_loss(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    named = [trace.with_metadata({"name": f"c{k}", **trace.metadata}) for k, trace in enumerate((FULL, SIX))]
    save(named, tmp_path / "a.csv")
    for before, after in (("a.csv", "b.mcap"), ("b.mcap", "c.h5"), ("c.h5", "d.parquet"), ("d.parquet", "e.csv")):
        assert cli.main(["convert", str(tmp_path / before), "--out", str(tmp_path / after)]) == 0
    assert load(tmp_path / "e.csv") == named
    assert "2 records, 80 readings" in capsys.readouterr().out


def test_convert_makes_records_of_a_bag_and_says_what_it_assumed(
    bags: dict[str, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = tmp_path / "rig.bag"
    shutil.copy(bags["bag"], given)
    out = tmp_path / "new" / "rig.csv"
    assert cli.main(["convert", str(given), "--out", str(out), "--cuts", "--map", *MAP]) == 0
    assert "taken off the force" in capsys.readouterr().err
    assert load(out)[0].metadata["source"] == "rig.bag"
    assert cli.main(["convert", str(given), "--out", str(out), "--map", *MAP]) == 2
    assert "exists; give another name, or --force" in capsys.readouterr().err
    assert cli.main(["convert", str(given), "--out", str(out), "--force", "--map", *MAP]) == 0
    assert len(load(out)[0]) == 2000


def test_convert_refuses_a_format_before_it_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["convert", str(tmp_path / "missing.csv"), "--out", str(tmp_path / "a.xlsx")]) == 2
    assert "its suffix '.xlsx' is no format of a record" in capsys.readouterr().err
