"""One cut in files that are no text, written by their makers' libraries or after their makers' descriptions."""

from __future__ import annotations

import datetime
import gzip
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
from lab_cut import FORCE, FORMATS, OTHER_FORCE, OTHER_WAY, RATE, START, TIME, TWO, WAY, LabFormat, N, Truth
from nptdms import ChannelObject, RootObject, TdmsWriter

ROWS = list(zip(TIME.tolist(), FORCE.tolist(), WAY.tolist(), strict=True))
OTHER_ROWS = list(zip(TIME.tolist(), OTHER_FORCE.tolist(), OTHER_WAY.tolist(), strict=True))
STAMPS = (np.datetime64(START, "us") + (TIME * 1e6).round().astype("timedelta64[us]")).astype("datetime64[us]")
SLOW = slice(None, None, 4)  # readings of a stage at 50 Hz


def add_file(name: str, maker: str, about: str, write: Callable[[Path], object], **facts: Any) -> None:
    """Add what a function writes to a path of this name."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        write(path)
        FORMATS.append(LabFormat(name=name, maker=maker, about=about, content=path.read_bytes(), **facts))


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
add_file("plain.xlsx", "Excel", "one sheet", workbook(Sheet1=[HEADER, *ROWS]))
add_file(
    "units_row.xlsx", "Bluehill", "facts above, a row of units",
    workbook(Sheet1=[["Specimen", "liver 3"], ["Operator", 7], [], ["Zeit", "Kraft", "Weg"], ["s", "mN", "mm"],
                     *[(time, 1e3 * force, way) for time, force, way in ROWS]]),
)  # fmt: skip
add_file(
    "moments.xlsx", "Excel", "cells with date and time",
    workbook(Data=[["Timestamp", "Load [N]", "Extension [mm]"],
                   *[(START + datetime.timedelta(seconds=time), force, way) for time, force, way in ROWS]]),
)  # fmt: skip
add_file(
    "excel_days.xlsx", "a macro", "days since 1900 as plain numbers",
    workbook(Data=[["Time", "Force [N]", "Position [mm]"],
                   *[(46083.5 + time / 86400.0, force, way) for time, force, way in ROWS]]),
)  # fmt: skip
add_file(
    "text_cells.xlsx", "a German export", "numbers kept as text with a decimal comma",
    workbook(Data=[["Zeit [s]", "Kraft [N]", "Weg [mm]"],
                   *[[f"{value:.4f}".replace(".", ",") for value in row] for row in ROWS]]),
)  # fmt: skip
add_file(
    "offset_table.xlsx", "LabVIEW", "the table begins at C3, a gap, and a line of results below",
    workbook(Data=[[], [], [None, None, "t [ms]", "F [N]", "x [mm]"],
                   *[(None, None, 1e3 * time, force, way) for time, force, way in ROWS[:70]],
                   (None, None, 1e3 * TIME[70], None, WAY[70]),
                   *[(None, None, 1e3 * time, force, way) for time, force, way in ROWS[71:]],
                   [None, None, "Maximum", 3.13, 30.0]]),
    left_out=2,
)  # fmt: skip
TESTER = [["Time", "Force", "Displacement"], ["s", "N", "mm"]]
add_file(
    "sheets.xlsx", "TestXpert", "results, then a sheet for each specimen",
    workbook(Results=[["Specimen", "Fmax"], ["", "N"], [1, 3.13], [2, 2.71]],
             Specimen_1=[*TESTER, *ROWS], Specimen_2=[*TESTER, *OTHER_ROWS]),
    truth=TWO,
)  # fmt: skip
add_file(
    "text.xls", "many loggers", "text with tabs, called a workbook",
    lambda path: path.write_text("\n".join(["\t".join(HEADER), *("\t".join(map(str, row)) for row in ROWS)])),
)  # fmt: skip

# MATLAB: savemat writes versions 4 and 5; version 7.3 is HDF5 behind 512 bytes, with the class of each variable.


def saved(**facts: Any) -> Callable[[Path], None]:
    options = {name: facts.pop(name) for name in ("format", "do_compression", "oned_as") if name in facts}
    return lambda path: scipy.io.savemat(path, facts, **options)


def cells(*texts: str) -> Any:
    return np.array(texts, dtype=object)


add_file("vectors.mat", "MATLAB", "save t F x", saved(t=TIME, F=FORCE, x_mm=WAY, oned_as="column"), asks=1)
add_file("version_4.mat", "Octave -v4", "version 4", saved(t=TIME, F_N=FORCE, x_mm=WAY, format="4"))
add_file("packed.mat", "MATLAB -v7", "compressed", saved(time_s=TIME, force_N=FORCE, pos_mm=WAY, do_compression=True))
add_file(
    "structure.mat", "MATLAB", "a structure with its units beside it",
    saved(rec={"time": TIME, "force": 1e3 * FORCE, "pos": WAY, "units": cells("s", "mN", "mm")}),
)  # fmt: skip
add_file(
    "units_by_name.mat", "MATLAB", "units in a structure of the same names",
    saved(time=TIME, force=FORCE, pos=WAY, units={"time": "s", "force": "N", "pos": "mm"}),
)  # fmt: skip
add_file("rate.mat", "MATLAB", "no time, but Fs", saved(Fs=RATE, force_N=FORCE, pos_mm=WAY))
add_file("step.mat", "MATLAB", "no time, but dt in ms", saved(dt_ms=1e3 / RATE, force_N=FORCE, pos_mm=WAY))
add_file(
    "labelled.mat", "importdata", "a matrix with colheaders",
    saved(data=np.column_stack([TIME, FORCE, WAY]), colheaders=cells("t (s)", "Load (N)", "Crosshead (mm)")),
)  # fmt: skip
add_file(
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


add_file("labchart.mat", "LabChart", "blocks in one row", labchart, truth=TWO)
add_file(
    "several.mat", "MATLAB", "an array of structures",
    saved(trial=np.array([[(TIME, FORCE, WAY), (TIME, OTHER_FORCE, OTHER_WAY)]],
                         dtype=[("time_s", object), ("force_N", object), ("pos_mm", object)])),
    truth=TWO,
)  # fmt: skip
add_file(
    "two_clocks.mat", "MATLAB", "force at 200 Hz, position at 50 Hz, each with its times",
    saved(t_force=TIME, force_N=FORCE, t_pos=TIME[SLOW], pos_mm=WAY[SLOW]),
)  # fmt: skip
SIGNALS = np.array([[(FORCE, "Force [N]"), (WAY, "Stage [mm]")]], dtype=[("values", object), ("label", object)])
add_file(
    "simulink.mat", "Simulink", "structure with time",
    saved(logged={"time": TIME, "signals": SIGNALS, "blockName": "rig/log"}),
)  # fmt: skip
add_file(
    "spike2.mat", "Spike2", "a structure for each channel",
    saved(**{f"rig_Ch{k}": {"title": title, "interval": 1.0 / RATE, "units": unit, "values": values, "length": N}
             for k, title, unit, values in ((1, "Force", "mN", 1e3 * FORCE), (2, "Travel", "mm", WAY))}),
)  # fmt: skip
add_file(
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


add_file("version_7_3.mat", "MATLAB -v7.3", "a matrix, and a cell array of its names", version_7_3)

# NumPy.
add_file("arrays.npz", "NumPy", "savez", lambda path: np.savez(path, time=TIME, force=FORCE, position_mm=WAY), asks=1)
add_file(
    "matrix.npz", "NumPy", "a matrix by rows, and its rate",
    lambda path: np.savez_compressed(path, force_N=FORCE, x_mm=WAY, fs=RATE),
)  # fmt: skip
add_file(
    "named_matrix.npz", "NumPy", "a matrix, its names and units in arrays of text",
    lambda path: np.savez(path, data=np.array(ROWS), columns=["time", "force", "pos"], units=["s", "N", "mm"]),
)  # fmt: skip
RECORDS = np.array(ROWS, dtype=[("time_s", "f8"), ("force_N", "f4"), ("pos_mm", "f4")])
add_file("records.npy", "NumPy", "an array of records", lambda path: np.save(path, RECORDS))

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


def six(file: Any) -> None:
    file["time_s"], file["tcp/x_mm"] = TIME, WAY
    file["ft/wrench"] = np.column_stack([FORCE, 0.0 * FORCE, 0.0 * FORCE, *[0.02 * FORCE] * 3])


def compound(file: Any) -> None:
    file["table"] = RECORDS


def trials(file: Any) -> None:
    for k, (force, way) in enumerate([(FORCE, WAY), (OTHER_FORCE, OTHER_WAY)]):
        group = file.create_group(f"data/demo_{k}")
        group.attrs["num_samples"] = N
        group["time_s"], group["obs/force_N"], group["obs/x_mm"] = TIME, force, way
        group["dones"] = np.arange(N) == N - 1
    file["mask/train"], file["returns"] = np.array([b"demo_0", b"demo_1"]), np.array([0.5, 0.7])


def frame(file: Any) -> None:
    """Write a DataFrame as pandas does with format="fixed"."""
    group = file.create_group("df")
    group.attrs["pandas_type"] = "frame"
    group["axis0"], group["axis1"] = np.array([name.encode() for name in HEADER]), np.arange(N)
    group["block0_items"], group["block0_values"] = group["axis0"][()], np.array(ROWS)


add_file("units.h5", "h5py", "groups, units in attributes", hdf5(with_units))
add_file("raw.hdf5", "a logger", "one dataset, names and rate in attributes", hdf5(one_dataset))
add_file("compound.h5", "PyTables", "a table of records", hdf5(compound))
add_file("demonstrations.hdf5", "robomimic", "a group for each demonstration", hdf5(trials), truth=TWO)
add_file("wrench.h5", "a robot's logger", "a wrench in six columns", hdf5(six), asks=1)
add_file("frame.h5", "pandas", "to_hdf", hdf5(frame))

# Parquet and Feather.
FRAME = pd.DataFrame({"Time (s)": TIME, "Force (N)": FORCE, "Position (mm)": WAY})
MOMENTS = FRAME.drop(columns="Time (s)").set_index(pd.DatetimeIndex(STAMPS, tz="Europe/Berlin", name="when"))
add_file("frame.parquet", "pandas", "to_parquet", FRAME.to_parquet)
add_file("frame.feather", "pandas", "to_feather", FRAME.to_feather)
add_file("moments.parquet", "pandas", "times with a zone as the index", MOMENTS.to_parquet)
WRENCH = [[force, 0.1, -0.2, 0.0, 0.0, 0.01] for force in FORCE.tolist()]
add_file(
    "nested.parquet", "a robot's logger", "a wrench as a list in each cell, a pose as a structure",
    lambda path: pq.write_table(pa.table({
        "timestamp": TIME, "observation.wrench": WRENCH, "pose": pa.StructArray.from_arrays([pa.array(WAY)], ["x_mm"]),
    }), path),
    asks=1,
)  # fmt: skip
add_file(
    "gaps.parquet", "pandas", "nulls, a column of text, decimals",
    lambda path: pq.write_table(pa.table({
        "t_s": TIME, "force_N": [None if k == 30 else force for k, force in enumerate(FORCE.tolist())],
        "note": ["" if k else "start" for k in range(N)], "x_mm": pa.array(WAY.round(3)).cast(pa.decimal128(12, 3)),
    }), path),
    left_out=1,
)  # fmt: skip
add_file(
    "ragged.parquet", "a robot's logger", "lists of changing length beside the force",
    lambda path: pq.write_table(pa.table({
        "t_s": TIME, "force_N": FORCE, "x_mm": WAY, "cells": [[0.5] * (k % 3) for k in range(N)],
    }), path),
)  # fmt: skip
add_file(
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


add_file(
    "waveform.tdms", "LabVIEW", "waveforms",
    tdms(waveform("Untitled", "Force", FORCE, "N"), waveform("Untitled", "Position", WAY, "mm")),
)  # fmt: skip
add_file(
    "channels.tdms", "DIAdem", "a channel of times, milli-newtons",
    tdms(ChannelObject("M", "Time", TIME, {"unit_string": "s"}),
         ChannelObject("M", "Kraft", 1e3 * FORCE, {"NI_UnitDescription": "mN"}),
         ChannelObject("M", "Weg", WAY, {"unit_string": "mm"})),
)  # fmt: skip
add_file(
    "stamps.tdms", "FlexLogger", "time stamps",
    tdms(ChannelObject("Log", "Timestamp", STAMPS), ChannelObject("Log", "Force", FORCE, {"unit_string": "N"}),
         ChannelObject("Log", "Position", WAY, {"unit_string": "mm"})),
)  # fmt: skip
add_file(
    "groups.tdms", "LabVIEW", "a group for each specimen",
    tdms(*(waveform(group, name, values, unit)
           for group, pair in (("Liver A", (FORCE, WAY)), ("Liver B", (OTHER_FORCE, OTHER_WAY)))
           for name, values, unit in zip(("Force", "Travel"), pair, ("N", "mm"), strict=True))),
    truth=TWO,
)  # fmt: skip
LATE = np.datetime64(START, "us") + np.timedelta64(100_000, "us")
add_file(
    "late_stage.tdms", "LabVIEW", "two rates, the stage's a tenth of a second later",
    tdms(ChannelObject("Load", "Force", FORCE, {"wf_increment": 1.0 / RATE, "unit_string": "N",
                                                "wf_start_time": np.datetime64(START, "us")}),
         ChannelObject("Stage", "Position", WAY[20::4],
                       {"wf_increment": 4.0 / RATE, "unit_string": "mm", "wf_start_time": LATE})),
    truth=(Truth(duration_s=float(TIME[-1]) - 0.08),),
)  # fmt: skip
add_file(
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


add_file("streams.xdf", "LabRecorder", "two streams with labels and units", xdf)

# Packed.
for plain in [each for each in FORMATS if each.name in ("plain.xlsx", "packed.mat", "frame.parquet", "waveform.tdms")]:
    FORMATS.append(
        LabFormat(name=f"{plain.name}.gz", maker="gzip", about=plain.name, content=gzip.compress(plain.content))
    )
TEXT = "\n".join([",".join(HEADER), *(",".join(map(str, row)) for row in ROWS)])
FORMATS.append(LabFormat(name="table.csv.gz", maker="gzip", about="text", content=gzip.compress(TEXT.encode())))
