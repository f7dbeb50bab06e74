"""Six components of force, height and vertical force: written, read back, and no part of what is scored."""

from __future__ import annotations

import numpy as np
import pytest
from made_up import FULL

from cutenv.recording import load, load_one, parse_header, save
from cutenv.recording.appending import AppendingRecord
from cutenv.recording.record_errors import RecordError
from cutenv.scoring import score
from cutenv.trace import BESIDE, COMPONENTS_OF_FORCE, Reading, Trace

N = len(FULL)
MORE = {name: np.random.default_rng(k).normal(0.0, 0.05, N) for k, name in enumerate(BESIDE)}
SIX = Trace(**{name: getattr(FULL, name) for name in FULL.known}, **MORE, metadata=FULL.metadata)
HEADER = (
    "time_s,force_N,position_m,speed_m_s,angle_rad,depth_m,height_m,vertical_force_N,force_x_N,force_y_N,force_z_N,"
    "torque_x_N_m,torque_y_N_m,torque_z_N_m,blade_x_m,blade_y_m,lateral_force_N"
)


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".h5"])
def test_all_come_back_to_the_last_bit_beside_cuts_without_them(tmp_path, suffix):
    save([FULL, SIX, FULL], tmp_path / f"cuts{suffix}")
    assert load(tmp_path / f"cuts{suffix}") == [FULL, SIX, FULL]
    assert SIX.known == (*Reading._fields, *BESIDE)
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
    return [tuple(float(MORE[name][i]) for name in BESIDE) for i in range(count)]


def test_a_growing_record_holds_them(tmp_path):
    with AppendingRecord(tmp_path / "cut.csv", FULL.metadata, beside=BESIDE) as record:
        record.append([FULL[i] for i in range(9)], rows(9))
        record.append([FULL[9]], rows(10)[9:])
    assert load_one(tmp_path / "cut.csv") == SIX.select(slice(0, 10))


def test_a_growing_record_refuses_rows_that_do_not_fit(tmp_path):
    with AppendingRecord(tmp_path / "cut.csv", beside=BESIDE) as record:
        with pytest.raises(ValueError, match="a row has 6 values for time_s, force_N"):
            record.append([FULL[0]])
        with pytest.raises(ValueError, match="height_m = nan"):
            record.append([FULL[0]], [(np.nan, *rows(1)[0][1:])])
        with pytest.raises(ValueError, match="argument 2 is shorter"):
            record.append([FULL[0], FULL[1]], rows(1))
        assert record.rows == 0
        record.append([FULL[0], FULL[1]], rows(2))
    with pytest.raises(ValueError, match="beside"):
        AppendingRecord(tmp_path / "other.csv", beside=["depth"])


def test_a_cut_that_lost_a_component_in_a_file_of_ours_is_found(tmp_path):
    save([SIX, FULL], tmp_path / "cuts.csv")
    text = (tmp_path / "cuts.csv").read_text().replace('"torque_z_N_m"', '"torque_w_N_m"')
    (tmp_path / "cuts.csv").write_text(text.replace("torque_z_N_m,", "torque_w_N_m,"))
    with pytest.raises(RecordError, match="torque_w_N_m"):
        load(tmp_path / "cuts.csv")
