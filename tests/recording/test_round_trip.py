"""What is saved comes back: every number to the last bit, every field, every cut, every word of the metadata."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up import FULL, traces

from cutenv.recording import SCHEMA, load, load_one, save
from cutenv.trace import Reading, Trace

SUFFIXES = (".csv", ".parquet", ".h5", ".hdf5", ".CSV", ".mcap")


def check_same(found: list[Trace], given: list[Trace]) -> None:
    """Equal as traces, and in the bits of every number: -0.0 is not 0.0."""
    assert found == given
    for one, other in zip(found, given, strict=True):
        for name in one.known:
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("records")


@pytest.mark.parametrize("suffix", [".csv", ".parquet", ".h5", ".mcap"])
@given(given=st.lists(traces(), min_size=1, max_size=3))
@settings(max_examples=100)
def test_any_traces_come_back_to_the_last_bit(folder, suffix, given):
    save(given, folder / f"any{suffix}")
    check_same(load(folder / f"any{suffix}"), given)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_one_cut_is_saved_and_loaded_as_one(tmp_path, suffix):
    save(FULL, tmp_path / f"cut{suffix}")
    check_same([load_one(tmp_path / f"cut{suffix}")], [FULL])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_many_cuts_come_back_in_their_order(tmp_path, suffix):
    cuts = [FULL.select(slice(i, i + 20)) for i in range(12)]  # more than 9: by name, 10 would come before 2
    save(iter(cuts), str(tmp_path / f"cuts{suffix}"))
    check_same(load(str(tmp_path / f"cuts{suffix}")), cuts)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_smallest_largest_and_negative_zero_come_back(tmp_path, suffix):
    force = np.array([-0.0, 5e-324, -2.2e-308, 1 / 3, np.nextafter(1e9, 0.0), 0.1 + 0.2])
    odd = Trace(time=np.arange(6) / 7, force=force, force_unit="1")
    save(odd, tmp_path / f"odd{suffix}")
    check_same(load(tmp_path / f"odd{suffix}"), [odd])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_cuts_that_hold_different_things_come_back_as_they_were(tmp_path, suffix):
    bare = Trace(time=FULL.time, force=FULL.force)
    normalised = Trace(time=FULL.time, force=FULL.force, depth=FULL.depth, force_unit="1", metadata={"n": [1, None]})
    for cuts in ([bare, FULL], [FULL, normalised], [normalised, bare, FULL, bare]):
        save(cuts, tmp_path / f"mixed{suffix}")
        check_same(load(tmp_path / f"mixed{suffix}"), cuts)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_metadata_come_back_whatever_the_text(tmp_path, suffix):
    told = FULL.select(slice(0, 9))
    odd = {"é\n,#": "a\x00b\ud800\u2028", "": {"cut": [1.5e-300, 10**30, True, None]}, "cut": 7, "long": "x" * 200_000}
    told = Trace(time=told.time, force=told.force, metadata=odd)
    save([told, told], tmp_path / f"odd{suffix}")
    check_same(load(tmp_path / f"odd{suffix}"), [told, told])


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_what_was_loaded_can_be_saved_and_loaded_again(tmp_path, suffix):
    (tmp_path / "hand.csv").write_text("cut,time_ms,force_x_mN,force_y_mN\n4,0,3,4\n4,1,30,40\n9,0,5,12\n9,1,5,12\n")
    cuts = load(tmp_path / "hand.csv", force="-y")
    save(cuts, tmp_path / f"again{suffix}")
    check_same(load(tmp_path / f"again{suffix}"), cuts)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_every_file_says_its_schema(tmp_path, suffix):
    save(FULL, tmp_path / f"cut{suffix}")
    assert SCHEMA.encode() in (tmp_path / f"cut{suffix}").read_bytes()


def test_a_csv_file_is_read_by_a_person(tmp_path):
    save(FULL.select(slice(0, 2)), tmp_path / "cut.csv")
    assert (tmp_path / "cut.csv").read_text().splitlines()[:-1] == [
        "# cutenv-record/1",
        "# rows: 2",
        '# metadata: {"rig": "bench 2", "trial": 3}',
        "time_s,force_N,position_m,speed_m_s,angle_rad,depth_m",
        "0.0,0.0,0.0,0.01,1.5707963267948966,0.02",
    ]


def test_a_file_of_another_program_reads_the_same(tmp_path):
    """h5py and pyarrow by themselves find the numbers and their units where docs/reference/files/records.md states."""
    import h5py
    import pyarrow.parquet

    save([FULL, FULL], tmp_path / "cuts.h5")
    with h5py.File(tmp_path / "cuts.h5") as file:
        assert np.array_equal(file["cut_1/force"][:], FULL.force)
        assert {name: file["cut_1"][name].attrs["unit"].decode() for name in file["cut_1"]} == {
            "time": "s",
            "force": "N",
            "position": "m",
            "speed": "m/s",
            "angle": "rad",
            "depth": "m",
        }
    save([FULL, FULL], tmp_path / "cuts.parquet")
    table = pyarrow.parquet.read_table(tmp_path / "cuts.parquet")
    assert table.column_names == ["cut", "time_s", "force_N", "position_m", "speed_m_s", "angle_rad", "depth_m"]
    assert table["cut"].to_pylist() == [0] * 40 + [1] * 40
    assert np.array_equal(table["force_N"].to_numpy()[40:], FULL.force)


def test_every_field_is_written():
    assert FULL.known == Reading._fields
