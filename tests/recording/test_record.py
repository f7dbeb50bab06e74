"""One function reads any record, native or foreign, and judges it."""

from __future__ import annotations

import dataclasses
import math
import shlex
from pathlib import Path

import numpy as np
import pytest
from recorded_cut import recorded_cut

from cutenv import recording
from cutenv.recording import RecordError, save
from cutenv.recording.column_map import ColumnMap
from cutenv.recording.importers import read_record
from cutenv.trace import Trace

MAPPING = ColumnMap.parse(["time=t", "force=F"], unit="N")
FOREIGN = "t,F\n" + "".join(f"{i / 100},{1.0 + math.sin(i / 9.0)!r}\n" for i in range(200))


def cuts() -> list[Trace]:
    cut = recorded_cut("2 cm", turns=(0.03, 0.0)).trace
    force = cut.force.copy()
    force[1000:2500] = force[1000]
    return [cut, dataclasses.replace(cut, force=force)]


@pytest.mark.parametrize("suffix", [".csv", ".h5", ".parquet"])
def test_a_native_record_is_taken_as_it_is_and_judged(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"record{suffix}"
    save(cuts(), path)
    found = read_record(path)
    assert found.mapping is None
    for trace, cut in zip(found.traces, cuts(), strict=True):
        assert np.array_equal(trace.force, cut.force)
    assert [[flaw.kind for flaw in each] for each in found.flaws] == [[], ["stuck"]]
    assert found.sound == found.traces[:1]
    assert found.picture(1)["flaws"] == (found.flaws[1],)
    assert found.notes == (f"record{suffix}: 2 cuts, as recorded.",)


def test_a_foreign_record_is_read_by_a_mapping_given_or_saved(tmp_path: Path) -> None:
    path = tmp_path / "record.csv"
    path.write_text(FOREIGN)
    given = read_record(path, MAPPING)
    MAPPING.save(tmp_path)
    saved = read_record(path)
    assert given.mapping == saved.mapping == MAPPING
    assert given.traces == saved.traces
    save(cuts(), tmp_path / "native.csv")
    assert read_record(tmp_path / "native.csv").mapping is None  # its header says more than a mapping beside it


ROWS = [(i / 100, 1.0 + math.sin(i / 9.0)) for i in range(200)]


def table(separator: str, header: str = "", decimal: str = ".") -> str:
    return header + "".join(f"{t!r}{separator}{f!r}\n".replace(".", decimal) for t, f in ROWS)


ORDINARY = {
    "comma.csv": table(",", "t,F\n").encode(),
    "semicolon.csv": table(";", "t;F\n", ",").encode(),
    "tab.csv": table("\t", "t\tF\n").encode(),
    "no_header.csv": table(",").encode(),
    "no_units.csv": table(",", "time,force\n").encode(),
    "no_time.csv": table(",", "position_mm,force_N\n").encode(),
    "latin.csv": table(";", "Zeit [s];Kr\xe4fte [mN]\n", ",").encode("latin-1"),
    "plain.txt": table("\t", "t\tF\n").encode(),
    "blanks.dat": table(" ").encode(),
    "labview.lvm": (
        "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\nX_Value\tForce\n" + table("\t")
    ).encode(),
    "utf16.csv": table(",", "t,F\n").encode("utf-16"),
}


@pytest.mark.parametrize("name", ORDINARY)
def test_an_ordinary_foreign_file_is_refused_with_a_mapping_that_reads_it(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(ORDINARY[name])
    with pytest.raises(RecordError, match=r"if another program wrote it.* --map ") as caught:
        read_record(path)
    example = caught.value.reason.rpartition("--map ")[2]
    items, _, unit = example.partition(" --unit ")
    mapping = ColumnMap.parse(shlex.split(items), unit=unit or None)
    (record,) = read_record(path, mapping, search=None).records
    assert len(record) == len(ROWS)
    force = np.array([f for _, f in ROWS])
    assert record.force == pytest.approx(force / 1000 if "mN" in caught.value.reason else force)


@pytest.mark.parametrize(
    ("header", "options"),
    [
        ("Zeit [s];Kraft [N];Weg [mm]", "time=Zeit force=Kraft position=Weg"),
        ("temps (s);force (N);d\xe9placement (mm)", "time=temps force=force 'position=d\xe9placement'"),
        ("t [s];x [mm];F [N]", "time=t force=F position=x"),
        ("t [s];F [N];tool displacement / mm", "time=t force=F 'position=#3'"),
        ("t [s];F [N];position depth [mm]", "time=t force=F"),
        ("t [s];F [N];x [N]", "time=t force=F"),
        ("t [s];Weg 1 [mm];Weg 2 [mm]", "time=t 'force=Weg 1' --unit N"),
        ("F [N];x [mm];#", "'time=#3' force=F position=x"),
    ],
)
def test_the_message_leads_with_the_cure_and_ends_with_the_mapping(header: str, options: str, tmp_path: Path) -> None:
    path = tmp_path / "trial.csv"
    path.write_bytes((header + "\n" + "".join(f"{t!r};{f!r};{t!r}\n" for t, f in ROWS)).encode("cp1252"))
    with pytest.raises(RecordError) as caught:
        read_record(path)
    assert caught.value.reason.startswith("if another program wrote it, leave it as it is and name its columns")
    assert caught.value.reason.endswith(f": --map {options}")


DAMAGED = {
    "row.csv": b"# cutenv-record/1\ntime_s,force_N\n0,1\n0.01,x\n",
    "header.csv": b"# cutenv-record/1\ntime_s,farce_N\n0,1\n0.01,2\n",
    "by_hand.csv": b"time_s,force_N\n0,1\n0.01,x\n",
    "no_table.csv": b"a letter,\nnot a table\n",
}


@pytest.mark.parametrize("name", DAMAGED)
def test_a_damaged_record_of_ours_and_what_is_no_table_are_not_sent_to_the_mapping(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(DAMAGED[name])
    with pytest.raises(RecordError) as caught:
        read_record(path)
    assert "--map" not in caught.value.reason


def test_a_mapping_is_for_files_of_other_programs(tmp_path: Path) -> None:
    save(cuts(), tmp_path / "record.h5")
    with pytest.raises(RecordError, match="a mapping is for other programs' text and bags"):
        read_record(tmp_path / "record.h5", MAPPING)


@pytest.mark.parametrize("name", ["none.csv", "none.txt", "none.h5"])
def test_a_missing_file_is_an_os_error(name: str, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_record(tmp_path / name, None if name.endswith("5") else MAPPING)


def test_every_public_name_is_there_and_no_other() -> None:
    for name in recording.__all__:
        assert getattr(recording, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'load_foregin'"):
        _ = recording.load_foregin
