"""Parquet and HDF5 of other programs: read if columns name their units, refused with place and cure if not."""

from __future__ import annotations

import math
from typing import Any

import h5py
import numpy as np
import pyarrow
import pyarrow.parquet
import pytest
from made_up import FULL

from cutenv.records import RecordError, load, load_one, save
from cutenv.sim.trace import Trace

TIME, FORCE = [0.0, 0.001, 0.002], [0.5, 0.75, 1.0]
CUT = Trace(time=TIME, force=FORCE)


@pytest.fixture
def parquet(tmp_path):
    return tmp_path / "cut.parquet"


@pytest.fixture
def hdf5(tmp_path):
    return tmp_path / "cut.h5"


def write_parquet(path, columns: dict[str, Any], notes: dict[str, str] | None = None) -> None:
    pyarrow.parquet.write_table(pyarrow.table(columns).replace_schema_metadata(notes), path)


def write_hdf5(path, groups: dict[str, dict[str, Any]], **attributes: Any) -> None:
    """Groups of datasets, "" for the root; ``name[unit]`` gives a dataset the attribute."""
    with h5py.File(path, "w") as file:
        file.attrs.update(attributes)
        for group, datasets in groups.items():
            for name, values in datasets.items():
                name, _, unit = name.rstrip("]").partition("[")
                dataset = (file.require_group(group) if group else file).create_dataset(name, data=values)
                if unit:
                    dataset.attrs["unit"] = unit


def check_refused(path, message: str) -> None:
    with pytest.raises(RecordError, match=message) as caught:
        load(path)
    assert caught.value.path == path
    assert "\n" not in str(caught.value)


def test_parquet_with_units_in_its_columns_is_a_record(parquet):
    time_ms = pyarrow.array([0, 1, 2], pyarrow.int32())
    write_parquet(parquet, {"time_ms": time_ms, "force_mN": [500, 750.0, 1000], "angle_deg": np.float32([90, 90, 45])})
    cut = load_one(parquet)
    assert (list(cut.time), list(cut.force), cut.metadata) == (TIME, FORCE, {})
    assert cut.angle == pytest.approx([math.pi / 2, math.pi / 2, math.pi / 4])


def test_parquet_tells_cuts_apart(parquet):
    write_parquet(parquet, {"time_s": TIME * 2, "force_N": FORCE * 2, "cut": [5, 5, 5, 2, 2, 2]})
    assert [cut.metadata for cut in load(parquet)] == [{"cut": 5}, {"cut": 2}]


PARQUET_REFUSED = {
    "missing value": ({"time_s": TIME, "force_N": [0.5, None, 1.0]}, r"row 1 \(the first is 0\), column force_N: nan"),
    "NaN": ({"time_s": TIME, "force_N": [0.5, 0.75, math.nan]}, "row 2 .* nan is no reading"),
    "time": ({"time_s": [0.0, 0.002, 0.001], "force_N": FORCE}, "row 2 .*time goes from 0.002 s to 0.001 s"),
    "no unit": ({"time": TIME, "force_N": FORCE}, "'time' has no unit"),
    "no force": ({"time_s": TIME}, "no column force_N"),
    "text": (
        {"time_s": TIME, "force_N": ["a", "b", "c"]},
        "column 'force_N' holds string, no numbers. Write it as float64",
    ),
    "lists": ({"time_s": TIME, "force_N": [[1.0], [2.0], []]}, "holds list<.*no numbers"),
    "truths": ({"time_s": TIME, "force_N": [True, False, True]}, "holds bool, no numbers"),
    "twice": ({"time_s": TIME, "time_s ": TIME, "force_N": FORCE}, "have the same meaning"),
    "empty": ({"time_s": pyarrow.array([], "f8"), "force_N": pyarrow.array([], "f8")}, "holds no readings"),
    "no columns": ({}, "no column time_s .*it has none"),
}


@pytest.mark.parametrize("name", PARQUET_REFUSED)
def test_what_is_wrong_with_parquet_is_said_with_its_place(parquet, name):
    columns, message = PARQUET_REFUSED[name]
    write_parquet(parquet, columns)
    check_refused(parquet, message)


@pytest.mark.parametrize(
    ("notes", "message"),
    [
        ({"cutenv_schema": "cutenv-record/2"}, "newer than this cutenv.*pip install -U cutenv"),
        ({"cutenv_schema": "else"}, "its schema is 'else'"),
        ({"cutenv_cuts": "{"}, "cutenv_cuts is not JSON"),
        ({"cutenv_cuts": "[]"}, r"cutenv_cuts is \[\]"),
        ({"cutenv_cuts": b'{"metadata": {"a": "\xff"}}'}, "cutenv_cuts is not JSON"),
        ({"cutenv_cuts": '{"metadata": 3}'}, "metadata is 3"),
        ({"cutenv_cuts": '{"metadata_of_cut": {"one": {}}}'}, "metadata_of_cut names cut 'one', which is no number"),
        ({"cutenv_cuts": '{"metadata_of_cut": {"4": {}}}'}, "names metadata of cut 4, but holds no such cut"),
        ({"cutenv_cuts": '{"columns_of_cut": {"0": [1]}}'}, "columns_of_cut 0 is"),
    ],
)
def test_what_is_wrong_with_the_notes_of_parquet_is_said(parquet, notes, message):
    write_parquet(parquet, {"time_s": TIME, "force_N": FORCE}, notes)
    check_refused(parquet, message)


def test_hdf5_may_have_one_cut_at_its_root(hdf5):
    write_hdf5(hdf5, {"": {"time[ms]": [0, 1, 2], "force_mN": [500, 750, 1000]}}, metadata='{"rig": "bench 2"}')
    assert load_one(hdf5) == Trace(time=TIME, force=FORCE, metadata={"rig": "bench 2"})


def test_hdf5_may_name_its_groups_as_it_likes(hdf5):
    write_hdf5(hdf5, {name: {"time_s": TIME, "force_N": np.add(FORCE, i)} for i, name in enumerate(["a9", "b", "a10"])})
    assert [cut.force[0] for cut in load(hdf5)] == [0.5, 2.5, 1.5]


def test_hdf5_may_have_components_and_speeds(hdf5):
    write_hdf5(hdf5, {"": {"time[s]": TIME, "force_x[N]": [3.0] * 3, "force_y[N]": [4] * 3, "speed[cm/s]": [1.0] * 3}})
    cut = load_one(hdf5, force="-x")
    assert list(cut.force) == [-3, -3, -3]
    assert list(cut.speed) == [0.01] * 3


GOOD = {"time_s": TIME, "force_N": FORCE}
HDF5_REFUSED = {
    "empty": ({}, {}, "no column time_s .*it has none"),
    "missing force": ({"cut_1": GOOD, "cut_2": {"time_s": TIME}}, {}, "cut_2: it has no column force_N"),
    "unknown unit": (
        {"a": {"time[s]": TIME, "force[stone]": FORCE}},
        {},
        "a: column 'force_stone' has the unit 'stone'",
    ),
    "lengths": (
        {"a": {"time_s": TIME, "force_N": FORCE[1:]}},
        {},
        "a: the datasets have different lengths: force_N 2, time_s 3",
    ),
    "shape": ({"a": {"time_s": TIME, "force_N": [FORCE]}}, {}, r"'/a/force_N' has shape \(1, 3\). Give one value"),
    "text": ({"a": {"time_s": TIME, "force_N": [b"a", b"b", b"c"]}}, {}, "holds object, no numbers"),
    "NaN": (
        {"a": {"time_s": TIME, "force_N": [0.0, math.nan, 1.0]}},
        {},
        r"a: row 1 \(the first is 0\), column force_N: nan",
    ),
    "time": ({"a": {"time_s": [0.0, 0.2, 0.1], "force_N": FORCE}}, {}, "a: row 2 .*time goes from 0.2 s to 0.1 s"),
    "beside": ({"": GOOD, "a": GOOD}, {}, "datasets beside groups. Put each cut into a group"),
    "inside": ({"a/b": GOOD, "a": GOOD}, {}, "'/a/b' is no dataset"),
    "twice": ({"": {"time_s": TIME, "force_N": FORCE, "force[N]": FORCE}}, {}, "holds force_N twice"),
    "newer": ({"a": GOOD}, {"schema": "cutenv-record/9"}, "newer than this cutenv"),
    "cut lost": (
        {"a": GOOD},
        {"schema": "cutenv-record/1", "cuts": 2},
        "announces .*2.* cuts and holds 1. Take the whole",
    ),
    "no JSON": ({"": GOOD}, {"metadata": "{"}, "metadata is not JSON"),
    "numbers for JSON": ({"": GOOD}, {"metadata": [1, 2]}, "the attribute metadata holds .*Write JSON text"),
}


@pytest.mark.parametrize("name", HDF5_REFUSED)
def test_what_is_wrong_with_hdf5_is_said_with_its_place(hdf5, name):
    groups, attributes, message = HDF5_REFUSED[name]
    write_hdf5(hdf5, groups, **attributes)
    check_refused(hdf5, message)


def test_hdf5_does_not_lead_to_other_files(hdf5, tmp_path):
    save(FULL, tmp_path / "other.h5")
    for link in (h5py.ExternalLink("other.h5", "cut_0"), h5py.SoftLink("/nowhere")):
        with h5py.File(hdf5, "w") as file:
            file["cut_0"] = link
        check_refused(hdf5, "'cut_0' is a link, perhaps into another file. Copy into it")
    layout = h5py.VirtualLayout((40,), "f8")
    layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "cut_0/force", (40,))
    with h5py.File(hdf5, "w") as file:
        file["time_s"] = FULL.time
        file.create_virtual_dataset("force_N", layout)
    check_refused(hdf5, "'/force_N' lies in another file")
    with h5py.File(hdf5, "w") as file:
        file["time_s"] = FULL.time
        file.create_dataset("force_N", (40,), "f8", external=[(str(tmp_path / "raw"), 0, 320)])
    check_refused(hdf5, "'/force_N' lies in another file")


def test_hdf5_that_announces_more_than_it_holds_does_not_take_all_memory(hdf5):
    with h5py.File(hdf5, "w") as file:
        for name in ("time_s", "force_N"):
            file.create_dataset(name, (10**12,), "f8", chunks=(1000,))
    check_refused(hdf5, "'/force_N' announces 1000000000000 values, more than the file can hold")


def test_hdf5_with_a_damaged_heap_of_text_does_not_run_in_circles(hdf5):
    """h5py keeps text of any length, as its users write it, in a heap; a zero there is read for ever."""
    write_hdf5(hdf5, {"": {"time[s]": TIME, "force[N]": FORCE}})
    content = hdf5.read_bytes()
    heap = content.index(b"GCOL")
    size = int.from_bytes(content[heap + 8 : heap + 16], "little")
    for place, new in (
        (heap + 16, bytes(16)),  # the first object is free space of no length
        (heap + 24, b"\xff" * 8),  # the first object ends far behind the heap
        (heap + 8, (size * 2**32).to_bytes(8, "little")),  # the heap ends far behind the file
    ):
        hdf5.write_bytes(content[:place] + new + content[place + len(new) :])
        check_refused(hdf5, "damaged HDF5 file: its text is not to be read. Take the file again")
    hdf5.write_bytes(content)
    assert load_one(hdf5) == CUT


@pytest.mark.parametrize("suffix", [".parquet", ".h5"])
def test_a_changed_byte_among_the_numbers_is_noticed(tmp_path, suffix):
    """Both formats carry checksums: a changed reading is not taken for a measured one."""
    path = tmp_path / f"cut{suffix}"
    rng = np.random.default_rng(0)
    noisy = Trace(time=np.arange(4000) * 1e-3, force=rng.uniform(size=4000))  # little to be packed: the file is numbers
    save(noisy, path)
    content = bytearray(path.read_bytes())
    refused = 0
    for place in rng.integers(len(content) // 4, len(content) * 3 // 4, 20):
        changed = content.copy()
        changed[place] ^= 1
        path.write_bytes(changed)
        try:
            assert load_one(path) == noisy
        except RecordError:
            refused += 1
    assert refused >= 18


@pytest.mark.parametrize("suffix", [".parquet", ".h5"])
@pytest.mark.parametrize("content", [b"time_s,force_N\n0,1\n", bytes(4096), b"PAR1" + bytes(99) + b"PAR1"])
def test_what_is_neither_is_refused(tmp_path, suffix, content):
    path = tmp_path / f"cut{suffix}"
    path.write_bytes(content)
    check_refused(path, "it is no (Parquet|HDF5)")
