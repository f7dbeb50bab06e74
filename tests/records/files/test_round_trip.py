"""What is saved comes back; a damaged file loads or ends in a clear error."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up import FULL, traces

from cutenv.records import SCHEMA, RecordError, load, save
from cutenv.sim.trace import Reading, Trace
from scripts.benchmarks.speed import reading
from scripts.validation.records import record_trials
from scripts.validation.records.record_trials import KINDS, damaged, sound

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
@settings(max_examples=50)
def test_any_traces_come_back_to_the_last_bit(folder, suffix, given):
    save(given, folder / f"any{suffix}")
    check_same(load(folder / f"any{suffix}"), given)


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


DAMAGED = (".csv", ".parquet", ".h5", ".mcap")


@pytest.fixture(scope="module")
def damaged_folder(tmp_path_factory):
    return tmp_path_factory.mktemp("damaged")


@given(number=st.integers(0, 2**32 - 1))
@settings(max_examples=800)
def test_damage_of_any_kind_ends_in_clear_errors_only(damaged_folder, number):
    suffix, _, content, file = record_trials.case(number)
    assert record_trials.ending(damaged_folder / f"damaged{suffix}", content, file) in record_trials.CLEAR


@pytest.mark.parametrize("suffix", DAMAGED)
@given(file=st.integers(0, 2), share=st.floats(0.0, 1.0, exclude_max=True))
@settings(max_examples=60)
def test_a_file_that_lost_its_end_never_loads(damaged_folder, suffix, file, share):
    content = sound(suffix)[file].content
    path = damaged_folder / f"part{suffix}"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(RecordError):
        load(path)


@pytest.mark.parametrize("suffix", DAMAGED)
def test_the_last_bytes_count_too(damaged_folder, suffix):
    content, traces, _ = sound(suffix)[0]
    path = damaged_folder / f"last{suffix}"
    for lost in range(1, 12):
        path.write_bytes(content[:-lost])
        with pytest.raises(RecordError):
            load(path)
    path.write_bytes(content)
    assert load(path) == traces


def test_every_kind_of_damage_changes_the_file():
    for suffix, kinds in KINDS.items():
        for kind in kinds:
            content = sound(suffix)[1].content
            changed = [damaged(content, kind, np.random.default_rng(seed)) != content for seed in range(20)]
            needs_comments = kind in ("comments lost", "JSON damaged")
            assert sum(changed) >= 10 or (suffix == ".txt" and needs_comments), (suffix, kind)


def test_an_unclear_ending_is_noticed(damaged_folder):
    file = sound(".csv")[0]

    def ends(error: Exception) -> str:
        def fail(path: Path) -> None:
            raise error

        return record_trials.ending(damaged_folder / "damaged.csv", file.content, file._replace(read=fail))

    assert ends(KeyError("x")) == "KeyError: 'x'"
    assert ends(RecordError("elsewhere", "a reason of some length")).startswith("unclear")
    assert ends(RecordError(damaged_folder / "damaged.csv", "bad")).startswith("unclear")
    assert ends(RecordError(damaged_folder / "damaged.csv", "a reason of some length")) == "refused"


def test_the_script_prints_its_tables(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["record_trials.py", "--files", "60", "--valid", "4"])
    assert record_trials.main() == 0
    said = capsys.readouterr().out
    (counted,) = [line.split() for line in said.splitlines() if line.startswith("all")]
    assert sum(map(int, counted[1:])) == 60
    assert counted[-1] == "0"
    assert "4 valid records with mild noise: 4 accepted" in said


def test_reading_takes_at_most_three_times_as_long_as_loadtxt():
    seconds = reading.reading_times(reading.cuts(readings=10_000, count=2), rounds=3)
    for suffix in (".csv", ".parquet", ".h5"):
        assert seconds[suffix] <= reading.TIMES_LOADTXT * seconds["numpy.loadtxt"], (suffix, seconds)
