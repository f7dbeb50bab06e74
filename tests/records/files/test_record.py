"""Traces as records: what the first had, the sensor's six components, and where they come from, but not whose hand."""

from __future__ import annotations

import dataclasses
import math
import shlex
from pathlib import Path

import numpy as np
import pytest
from made_up import FULL
from recorded_cut import recorded_cut

import cutenv.records as recording
from cutenv.records import Provenance, RecordError, load, load_one, parse_header, save
from cutenv.records.appending import AppendingRecord
from cutenv.records.foreign.column_map import ColumnMap
from cutenv.records.importers import load_foreign, read_record
from cutenv.records.scoring import score
from cutenv.sim.trace import CHANNELS, COMPONENTS_OF_FORCE, Reading, Trace

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
    "no_header.csv": table(",").encode(),
    "latin.csv": table(";", "Zeit [s];Kr\xe4fte [mN]\n", ",").encode("latin-1"),
    "labview.lvm": (
        "LabVIEW Measurement\t\nSeparator\tTab\n***End_of_Header***\t\n\nX_Value\tForce\n" + table("\t")
    ).encode(),
    "utf16.txt": table("\t", "t\tF\n").encode("utf-16"),
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
    assert record.force == pytest.approx(force / 1000 if name == "latin.csv" else force)


@pytest.mark.parametrize(
    ("header", "options"),
    [
        ("Zeit [s];Kraft [N];Weg [mm]", "time=Zeit force=Kraft position=Weg"),
        ("temps (s);force (N);d\xe9placement (mm)", "time=temps force=force 'position=d\xe9placement'"),
        ("t [s];x [mm];F [N]", "time=t force=F position=x"),
        ("t [s];F [N];tool displacement / mm", "time=t force=F 'position=#3'"),
        ("t [s];F [N];position depth [mm]", "time=t force=F"),
        ("t [s];F [N];x [N]", "time=t force=F"),
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


def test_what_no_guess_can_answer_is_asked(tmp_path: Path) -> None:
    path = tmp_path / "no_time.csv"
    path.write_text(table(",", "position_mm,force_N\n"))
    with pytest.raises(
        RecordError, match=r"How many readings a second\? .*rate=\.\.\.Hz.* --map force=force_N position=position_mm"
    ):
        read_record(path)
    path.write_text(table(",", "position_mm,way_mm\n"))
    with pytest.raises(RecordError, match=r"none of its columns .* can be a force"):
        load_foreign(path)


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


@pytest.mark.parametrize("name", ["none.csv", "none.txt", "none.h5"])
def test_a_missing_file_is_an_os_error(name: str, tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError):
        read_record(tmp_path / name, None if name.endswith("5") else MAPPING)


def test_every_public_name_is_there_and_no_other() -> None:
    for name in recording.__all__:
        assert getattr(recording, name) is not None
    with pytest.raises(AttributeError, match="has no attribute 'load_foregin'"):
        _ = recording.load_foregin


N = len(FULL)
MORE = {name: np.random.default_rng(k).normal(0.0, 0.05, N) for k, name in enumerate(CHANNELS)}
SIX = Trace(**{name: getattr(FULL, name) for name in FULL.known}, **MORE, metadata=FULL.metadata)
HEADER = (
    "time_s,force_N,position_m,speed_m_s,angle_rad,depth_m,height_m,vertical_force_N,force_x_N,force_y_N,force_z_N,"
    "torque_x_N_m,torque_y_N_m,torque_z_N_m,blade_x_m,blade_y_m,lateral_force_N"
)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".h5"])
def test_all_come_back_to_the_last_bit_beside_cuts_without_them(tmp_path, suffix):
    save([FULL, SIX, FULL], tmp_path / f"cuts{suffix}")
    assert load(tmp_path / f"cuts{suffix}") == [FULL, SIX, FULL]
    assert SIX.known == (*Reading._fields, *CHANNELS)
    assert np.array_equal(SIX.wrench, np.column_stack([MORE[name] for name in COMPONENTS_OF_FORCE]))
    assert FULL.wrench is None
    assert SIX != FULL


def test_a_plain_record_is_the_same_file_as_before(tmp_path):
    save(FULL, tmp_path / "plain.csv")
    assert "height" not in (tmp_path / "plain.csv").read_text()
    save(SIX, tmp_path / "six.csv")
    assert (tmp_path / "six.csv").read_text().splitlines()[3] == HEADER


def test_parts_of_a_record_keep_them():
    part = SIX.select(slice(3, 9))
    assert np.array_equal(part.torque_z, MORE["torque_z"][3:9])
    assert np.array_equal(part.require("vertical_force", by="a test")[0], MORE["vertical_force"][3:9])


def test_the_score_uses_the_force_along_the_cut_alone():
    six, full = score(SIX, target_length=0.005), score(FULL, target_length=0.005)
    assert {name: six.metrics[name] for name in full.metrics} == full.metrics
    assert six.points == full.points


def test_units_are_converted_and_a_component_without_the_others_is_left_out(tmp_path):
    six = "force_x_mN,force_y_N,force_z_N,torque_x_N_mm,torque_y_N_m,torque_z_N_m"
    (tmp_path / "six.csv").write_text(f"time_s,force_N,height_mm,{six}\n0,1,2,3,4,5,6,7,8\n1e-3,1,2,3,4,5,6,7,8\n")
    trace = load_one(tmp_path / "six.csv")
    assert (trace.height[0], trace.force[0], trace.wrench[0].tolist()) == (0.002, 1.0, [0.003, 4, 5, 0.006, 7, 8])
    assert load_one(tmp_path / "six.csv", force="-x").force[0] == -0.003
    (tmp_path / "two.csv").write_text("time_s,force_N,force_x_N,torque_x_N_m\n0,1,2,3\n1e-3,1,2,3\n")
    assert load_one(tmp_path / "two.csv").known == ("time", "force")


@pytest.mark.parametrize(
    ("header", "message"),
    [
        ("torque_N_m", "names no axis. Write torque_x_N_m"),
        ("torque_x_N", "unit 'N', which is not known. Write one of torque_x_N_m"),
        ("height", "has no unit. Write one of height_m"),
        ("vertical_force_kg", "unit 'kg', which is not known. Write one of vertical_force_N"),
        ("lateral_force", "has no unit. Write one of lateral_force_N"),
        ("blade_m", "names no axis. Write blade_x_m"),
        ("blade_z_m", "names no axis. Write blade_x_m"),
        ("vertical_N", "is no quantity of a cut"),
    ],
)
def test_a_wrong_header_is_refused_with_the_right_one(header, message):
    with pytest.raises(ValueError, match=message):
        parse_header(header)


def test_five_components_and_a_height_in_millimetres_are_refused():
    with pytest.raises(ValueError, match=r"of the six components it holds force_x only. Give all six, or none"):
        Trace(time=[0.0, 1e-3], force=[0.0, 0.0], force_x=[0.0, 0.0])
    with pytest.raises(ValueError, match=r"height = 2 .*looks like millimetres, which is 0.002"):
        Trace(time=[0.0, 1e-3], force=[0.0, 0.0], height=[0.0, 2.0])


def rows(count: int) -> list[tuple[float, ...]]:
    return [tuple(float(MORE[name][i]) for name in CHANNELS) for i in range(count)]


def test_a_growing_record_holds_them(tmp_path):
    with AppendingRecord(tmp_path / "cut.csv", FULL.metadata, channels=CHANNELS) as record:
        record.append([FULL[i] for i in range(9)], rows(9))
        record.append([FULL[9]], rows(10)[9:])
    assert load_one(tmp_path / "cut.csv") == SIX.select(slice(0, 10))


def test_a_growing_record_refuses_rows_that_do_not_fit(tmp_path):
    with AppendingRecord(tmp_path / "cut.csv", channels=CHANNELS) as record:
        with pytest.raises(ValueError, match="a row has 6 values for time_s, force_N"):
            record.append([FULL[0]])
        with pytest.raises(ValueError, match="height_m = nan"):
            record.append([FULL[0]], [(np.nan, *rows(1)[0][1:])])
        with pytest.raises(ValueError, match="argument 2 is shorter"):
            record.append([FULL[0], FULL[1]], rows(1))
        assert record.rows == 0
        record.append([FULL[0], FULL[1]], rows(2))
    with pytest.raises(ValueError, match="channels"):
        AppendingRecord(tmp_path / "other.csv", channels=["depth"])


def test_a_cut_that_lost_a_component_in_a_file_of_ours_is_found(tmp_path):
    save([SIX, FULL], tmp_path / "cuts.csv")
    text = (tmp_path / "cuts.csv").read_text().replace('"torque_z_N_m"', '"torque_w_N_m"')
    (tmp_path / "cuts.csv").write_text(text.replace("torque_z_N_m,", "torque_w_N_m,"))
    with pytest.raises(RecordError, match="torque_w_N_m"):
        load(tmp_path / "cuts.csv")


WHOLE = Provenance(
    rig="bench 2",
    sensor="ATI Nano17, No. FT12345",
    blade="No. 10, new",
    specimen="porcine liver 3, left lobe",
    date="2026-03-01T14:05:00+01:00",
    operator="P07",
    consent=True,
    calibration={"gain_N_per_V": 4.98, "offset_N": -0.02, "by": "weights of 50 to 500 g"},
)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".h5"])
def test_it_comes_back_from_a_file_beside_other_metadata(tmp_path, suffix):
    cut = Trace(time=[0.0, 0.001], force=[0.0, 0.1], metadata={"trial": 3, **WHOLE.metadata})
    save(cut, tmp_path / f"cut{suffix}")
    kept = load_one(tmp_path / f"cut{suffix}").metadata
    assert Provenance.from_metadata(kept) == WHOLE
    assert kept["trial"] == 3


def test_what_is_not_known_is_left_out():
    assert Provenance().metadata == {}
    assert Provenance(rig="bench 2", consent=False).metadata == {"rig": "bench 2", "consent": False}
    assert repr(Provenance(rig="bench 2")) == "Provenance(rig='bench 2')"


@pytest.mark.parametrize(
    "code", ["P07", "7", "A3", "op-12", "S_003", "12b", "surgeon07", "Trainee-4", "a3f9c2e1", "0f" * 32]
)
def test_a_code_is_taken(code):
    assert Provenance(operator=code).operator == code


@pytest.mark.parametrize(
    "name",
    [
        *("Jane Doe", "jane", "Smith", "Dr. Lee", "Doe, Jane", "JD", "Li", "jdoe", "john1", "Müller2", "李1", "R2 D2"),
        *(
            "jane.doe@clinic.org",
            "j7@x.de",
            "+49 30 123456",
            "030123456",
            "19800131",
            "1980-01-31",
            "",
            " P07",
            "P07\n",
        ),
    ],
)
def test_what_may_be_a_name_an_address_a_number_or_a_birthday_is_refused(name):
    with pytest.raises(ValueError, match=r"operator .* may identify a person. Give a code of up to three letters"):
        Provenance(operator=name)


@pytest.mark.parametrize(
    ("field", "value", "error", "message"),
    [
        ("rig", "", ValueError, "rig must be a text of 1 to 500 characters"),
        ("blade", "x" * 501, ValueError, "blade must be a text of 1 to 500"),
        ("sensor", 5, TypeError, "sensor must be text, got 5"),
        ("date", "yesterday", ValueError, "date 'yesterday' is none in ISO 8601. Write it as '2026-03-01'"),
        ("date", "01.03.2026", ValueError, "ISO 8601"),
        ("date", 20260301, TypeError, "date must be text"),
        ("operator", 7, TypeError, "operator must be a code such as 'P07'"),
        ("consent", "yes", TypeError, "consent must be True, False or None"),
        ("consent", 1, TypeError, "consent must be True, False or None"),
        ("calibration", 4.98, TypeError, "calibration must map names to values"),
        ("calibration", {"gain": math.nan}, TypeError, "not what JSON can hold"),
    ],
)
def test_nonsense_is_refused_with_its_name(field, value, error, message):
    with pytest.raises(error, match=message):
        Provenance(**{field: value})


def test_a_wrong_entry_in_metadata_is_refused_too():
    with pytest.raises(TypeError, match="consent must be True"):
        Provenance.from_metadata({"consent": "yes"})
