"""One cut as the programs of laboratories write it: each format after its maker's description, with the truth."""

from __future__ import annotations

import datetime
import json
import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

RATE = 200.0  # readings a second [Hz]
N = 1361
TIME = np.arange(N) / RATE
START = datetime.datetime(2026, 3, 2, 10, 11, 12)
EPOCH = 1_772_446_272  # the same in UTC
DURATION, TRAVEL = float(TIME[-1]), 30.0


def _cut(seed: int, peak: float, end: float) -> tuple[Any, Any]:
    """Force [N] and position [mm] of a cut: rest, a rise with drops, an unloading, rest."""
    noise = 0.02 * np.random.default_rng(seed).standard_normal(N)
    moving = np.clip((TIME - 1.0) / 4.0, 0.0, 1.0)
    saw = 0.25 * ((TIME * 3.0) % 1.0)
    load = np.where((TIME > 1.2) & (TIME < 5.0), 1.0 - np.exp(-(TIME - 1.2) / 0.6), 0.0)
    unloading = np.where(TIME >= 5.0, np.exp(-(TIME - 5.0) / 0.05), 0.0)
    force = (load * (0.85 + saw) + 0.9 * unloading) + noise / 3.0
    return force * (peak / force.max()), end * moving


FORCE, WAY = _cut(1, 3.13, TRAVEL)
OTHER_FORCE, OTHER_WAY = _cut(2, 2.71, 24.0)


@dataclass(frozen=True, kw_only=True)
class Truth:
    """Duration [s], peak [N] and travel [mm] of a record; travel None where the file has none."""

    duration_s: float = DURATION
    peak_N: float = 3.13
    travel_mm: float | None = TRAVEL


ONE = (Truth(),)
TWO = (Truth(), Truth(peak_N=2.71, travel_mm=24.0))
FORCE_ALONE = (Truth(travel_mm=None),)


@dataclass(frozen=True, kw_only=True)
class LabFormat:
    """A file of a laboratory.

    Attributes
    ----------
    name : str
        Name of the file.
    maker : str
        Program or instrument that writes it.
    about : str
        Peculiarity of the format.
    content : bytes
        The file.
    truth : tuple of Truth
        Its records.
    asks : int
        Questions that the file itself leaves open.
    left_out : int
        Rows that are no readings.
    readable : bool
        False if the file leaves open what nobody can guess.
    """

    name: str
    maker: str
    about: str
    content: bytes
    truth: tuple[Truth, ...] = ONE
    asks: int = 0
    left_out: int = 0
    readable: bool = True


FORMATS: list[LabFormat] = []


def table(columns: Sequence[tuple[Any, str]], separator: str = ",", decimal: str = ".", quote: str = "") -> list[str]:
    """Rows of columns, each with its printf format."""
    cells = [[f"{quote}{(form % value).replace('.', decimal)}{quote}" for value in values] for values, form in columns]
    return [separator.join(row) for row in zip(*cells, strict=True)]


def add(
    name: str,
    maker: str,
    about: str,
    lines: Sequence[str] | str,
    *,
    newline: str = "\n",
    encoding: str = "utf-8",
    **facts: Any,
) -> None:
    text = lines if isinstance(lines, str) else newline.join([*lines, ""])
    FORMATS.append(LabFormat(name=name, maker=maker, about=about, content=text.encode(encoding), **facts))


def clock_time(seconds: float) -> str:
    return (START + datetime.timedelta(seconds=float(seconds))).strftime("%H:%M:%S.%f")[:-3]


T, F, X = (TIME, "%.4f"), (FORCE, "%.5f"), (WAY, "%.4f")
MILLINEWTONS, MICRO_X = (1e3 * FORCE, "%.2f"), (1e3 * WAY, "%.1f")
STANDARD = table([T, F, X])


# LabVIEW measurement files: NI, "Specification for the LabVIEW Measurement File (.lvm)".
def _lvm(
    x_columns: str,
    units: tuple[str, str] = ("N", "mm"),
    scale: tuple[float, float] = (1.0, 1.0),
    decimal: str = ".",
    separator: str = "\t",
    comment: bool = False,
    segments: int = 1,
    restart: bool = False,
) -> list[str]:
    name = {"\t": "Tab", ",": "Comma"}[separator]
    s = separator
    head = [
        f"LabVIEW Measurement{s}",
        f"Writer_Version{s}2",
        f"Reader_Version{s}2",
        f"Separator{s}{name}",
        f"Decimal_Separator{s}{decimal}",
        f"Multi_Headings{s}Yes",
        f"X_Columns{s}{x_columns}",
        f"Time_Pref{s}Relative",
        f"Operator{s}lab",
        f"Date{s}2026/03/02",
        f"Time{s}10:11:12.123456",
        f"***End_of_Header***{s}",
        s,
    ]
    lines = head
    for part in np.array_split(np.arange(N), segments):
        begin = float(TIME[part[0]])
        x0 = 0.0 if restart else begin
        clock = f"10:11:{12.5 + begin if restart else 12.5:07.4f}"
        count = 2

        def number(value: float) -> str:
            return f"{value:.6f}".replace(".", decimal)

        lines += [
            f"Channels{s}{count}{s * 2}",
            f"Samples{s}{len(part)}{s}{len(part)}{s}",
            f"Date{s}2026/03/02{s}2026/03/02{s}",
            f"Time{s}{clock}{s}{clock}{s}",
            f"Y_Unit_Label{s}{units[0]}{s}{units[1]}{s}",
            f"X_Dimension{s}Time{s}Time{s}",
            f"X0{s}{number(x0)}{s}{number(x0)}{s}",
            f"Delta_X{s}{number(1 / RATE)}{s}{number(1 / RATE)}{s}",
            f"***End_of_Header***{s * 3}",
        ]
        if x_columns == "Multi":
            lines.append(s.join(["X_Value", "Force", "X_Value", "Position", "Comment"]))
        else:
            lines.append(s.join(["X_Value", "Force", "Position", "Comment"]))
        for k in part:
            x = number(TIME[k] - begin + x0)
            f, y = number(FORCE[k] * scale[0]), number(WAY[k] * scale[1])
            row = {"No": ["", f, y], "One": [x, f, y], "Multi": [x, f, x, y]}[x_columns]
            lines.append(s.join(row + (["blade down"] if comment and k == 300 else [])))
        lines.append("")
    return lines


add("no_x.lvm", "LabVIEW", "no column of time: step in the header, an empty first cell", _lvm("No"), newline="\r\n")
add("one_x.lvm", "LabVIEW", "one column of time, unit labels", _lvm("One", ("mN", "mm"), (1e3, 1.0)), newline="\r\n")
add("multi_x.lvm", "LabVIEW", "a column of time for each channel", _lvm("Multi"), newline="\r\n")
add(
    "comma.lvm", "LabVIEW", "decimal comma, comments", _lvm("One", ("g", "cm"), (1e3 / 9.80665, 0.1), ",", comment=True)
)
add("comments.lvm", "LabVIEW", "no column of time, comments", _lvm("No", comment=True))
add("comma_separator.lvm", "LabVIEW", "separator comma", _lvm("One", separator=","))
add("segments.lvm", "LabVIEW", "three segments of one record, time goes on", _lvm("One", segments=3))
add("segments_no_x.lvm", "LabVIEW", "three segments, time in X0 alone", _lvm("No", segments=3))
add(
    "segments_again.lvm",
    "LabVIEW",
    "three segments that count from their own clock time",
    _lvm("One", segments=3, restart=True),
)

# Instron Bluehill: raw data exported as CSV.
BLUEHILL = ["Specimen number (included),3", 'Length,"26.00000",mm', 'Specimen label,"A 7"', ""]
STRAIN = (WAY / 1e3, "%.5f")
add(
    "bluehill.csv",
    "Instron Bluehill",
    "names, then a row of units of which some are foreign",
    [
        *BLUEHILL,
        "Time,Extension,Load,Tensile strain (Strain 1),Tensile stress",
        "(s),(mm),(N),(%),(MPa)",
        *table([T, X, F, STRAIN, (FORCE / 20, "%.4f")], quote='"'),
    ],
    newline="\r\n",
)
add(
    "bluehill_german.csv",
    "Instron Bluehill, German",
    "decimal comma in quotation marks between commas",
    [
        *BLUEHILL,
        "Zeit,Verl\u00e4ngerung,Last,Druckdehnung (Verl\u00e4ngerung)",
        "(s),(mm),(N),(mm/mm)",
        *table([T, X, F, STRAIN], decimal=",", quote='"'),
    ],
    newline="\r\n",
    encoding="cp1252",
)
add(
    "bluehill_thousands.csv",
    "Instron Bluehill",
    "thousands in quotation marks, millinewtons",
    [
        "Time,Extension,Load",
        "(s),(mm),(mN)",
        *(f'"{t:.4f}","{x:.4f}","{1e3 * f:,.3f}"' for t, f, x in zip(TIME, FORCE, WAY, strict=True)),
    ],
)
add(
    "bluehill_below.csv",
    "Instron Bluehill",
    "two specimens below one another, each with its header",
    [
        *BLUEHILL,
        "Time,Extension,Load",
        "(s),(mm),(N)",
        *table([T, X, F], quote='"'),
        "",
        *BLUEHILL,
        "Time,Extension,Load",
        "(s),(mm),(N)",
        *table([T, (OTHER_WAY, "%.4f"), (OTHER_FORCE, "%.5f")], quote='"'),
    ],
    truth=TWO,
    left_out=5,
)

# Zwick testXpert: text export, German.
add(
    "testxpert.tra",
    "ZwickRoell testXpert",
    "semicolons, decimal comma, names and units in two rows",
    ['"Pr\u00fcfzeit";"Standardkraft";"Traversenweg absolut"', '"s";"N";"mm"', *table([T, F, X], ";", ",")],
    newline="\r\n",
    encoding="cp1252",
)
add(
    "testxpert_compression.txt",
    "ZwickRoell testXpert",
    "tabs; compression counts negative, the crosshead downwards",
    ["Pr\u00fcfzeit\tKraft\tWeg", "s\tN\tmm", *table([T, (-FORCE, "%.5f"), (130.0 - WAY, "%.4f")], "\t", ",")],
    encoding="cp1252",
)
# MTS TestSuite / TestWorks: tab-separated export.
add(
    "mts.txt",
    "MTS TestSuite",
    "tabs, units in capitals: Sec, in, lbf",
    [
        "Data Header:\tTimed Data",
        "",
        "Time\tCrosshead\tLoad",
        "Sec\tin\tlbf",
        *table([T, (WAY / 25.4, "%.6f"), (FORCE / 4.4482216152605, "%.6f")], "\t"),
    ],
)
add(
    "mts_kilonewton.txt",
    "MTS TestSuite",
    "kilonewtons",
    ["Time (Sec)\tLoad (KN)\tCrosshead (MM)", *table([T, (FORCE / 1e3, "%.8f"), X], "\t")],
)
# Stable Micro Systems Exponent, texture analysers.
GRAMS = (1e3 * FORCE / 9.80665, "%.3f")
add(
    "texture.csv",
    "Exponent (texture analyser)",
    "force in grams",
    ["Force (g),Distance (mm),Time (sec)", *table([GRAMS, X, T])],
)
add(
    "texture_tests.csv",
    "Exponent (texture analyser)",
    "two tests side by side below their names",
    [
        "Test 1,,,Test 2,,",
        "Force,Distance,Time,Force,Distance,Time",
        "g,mm,sec,g,mm,sec",
        *table([GRAMS, X, T, (1e3 * OTHER_FORCE / 9.80665, "%.3f"), (OTHER_WAY, "%.4f"), T]),
    ],
    truth=TWO,
)
# Mecmesin Emperor: samples side by side.
add(
    "emperor.csv",
    "Mecmesin Emperor",
    "samples side by side, names for the first alone, minutes",
    [
        "Force,Distance,Time,Event,,,,",
        "N,mm,min,,,,,",
        "Sample 1,,,,Sample 2,,,",
        ",,,,,,,",
        *(
            f"{a},{b}"
            for a, b in zip(
                table([F, X, (TIME / 60, "%.7f"), (0 * TIME, "%d")]),
                [
                    *table([(OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f"), (TIME / 60, "%.7f"), (0 * TIME, "%d")])[:-60],
                    *[",,,"] * 60,
                ],
                strict=True,
            )
        ),
    ],
    newline="\r\n",
    truth=(Truth(), Truth(duration_s=float(TIME[-61]), peak_N=2.71, travel_mm=24.0)),
)
# Shimadzu Trapezium.
add(
    "trapezium.csv",
    "Shimadzu Trapezium",
    "names and units in quotation marks, way called stroke",
    ['"Test","cut"', '"Time","Force","Stroke"', '"sec","N","mm"', *STANDARD],
    newline="\r\n",
)
add(
    "trapezium_side.csv",
    "Shimadzu Trapezium",
    "specimens side by side, each named above",
    [
        '"1 _ 1",,,"1 _ 2",,',
        '"Time","Force","Stroke","Time","Force","Stroke"',
        '"sec","N","mm","sec","N","mm"',
        *table([T, F, X, T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")]),
    ],
    newline="\r\n",
    truth=TWO,
)
# ADInstruments LabChart: exported text with its header.
LABCHART = [
    "Interval=\t0.005 s",
    "ExcelDateTime=\t4.6083424444444445e+004\t3/2/2026 10:11:12.0",
    "TimeFormat=\tStartOfBlock",
    "DateFormat=\t",
    "ChannelTitle=\tForce\tPosition",
    "Range=\t10.000 V\t10.000 V",
    "UnitName=\tmN\tmm",
]
add(
    "labchart.txt",
    "LabChart",
    "units in a header of keys",
    [*LABCHART, *table([T, MILLINEWTONS, X], "\t")],
    newline="\r\n",
)
add(
    "labchart_comment.txt",
    "LabChart",
    "a comment behind a row",
    [
        *LABCHART,
        *(row + ("\t#* blade down" if k == 240 else "") for k, row in enumerate(table([T, MILLINEWTONS, X], "\t"))),
    ],
)
add("labchart_no_time.txt", "LabChart", "no column of time", [*LABCHART, *table([MILLINEWTONS, X], "\t")])
# BIOPAC AcqKnowledge: text export with header.
BIOPAC = ["cut.acq", "5 msec/sample", "2 channels", "Force", "mN", "Position", "mm"]
add(
    "biopac.txt",
    "BIOPAC AcqKnowledge",
    "names and units below one another, time in minutes",
    [
        *BIOPAC,
        "min\tCH1\tCH2\t",
        f"\t{N}\t{N}\t",
        *(row + "\t" for row in table([(TIME / 60, "%.8f"), MILLINEWTONS, X], "\t")),
    ],
    newline="\r\n",
)
add(
    "biopac_no_time.txt",
    "BIOPAC AcqKnowledge",
    "no column of time: interval above",
    [*BIOPAC, "CH1\tCH2\t", f"{N}\t{N}\t", *(row + "\t" for row in table([MILLINEWTONS, X], "\t"))],
    newline="\r\n",
)
# Vernier Logger Pro and Graphical Analysis.
add(
    "vernier.csv",
    "Vernier Logger Pro",
    "the run in front of each name",
    ['"Latest: Time (s)","Latest: Force (N)","Latest: Position (m)"', *table([T, F, (WAY / 1e3, "%.6f")])],
)
add(
    "vernier_runs.csv",
    "Vernier Graphical Analysis",
    "two runs side by side",
    [
        "Run 1: Time (s),Run 1: Force (N),Run 1: Position (mm),Run 2: Time (s),Run 2: Force (N),Run 2: Position (mm)",
        *table([T, F, X, T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")]),
    ],
    truth=TWO,
)
add(
    "data_sets.csv",
    "Vernier Graphical Analysis",
    "data set in front of each name, no blank before the unit",
    ["Data Set 1:Time(s),Data Set 1:Force(N),Data Set 1:Position(cm)", *table([T, F, (WAY / 10, "%.5f")])],
)
# Arduino: serial monitor and loggers.
add(
    "serial_monitor.txt",
    "Arduino serial monitor",
    "clock and arrow in front of the numbers",
    [f"{clock_time(t)} -> {row}" for t, row in zip(TIME, table([F, X]), strict=True)],
    asks=1,
)
add(
    "serial_pairs.txt",
    "Arduino serial monitor",
    "clock, arrow, keys and values",
    [f"{clock_time(t)} -> Force:{f:.4f} Position:{x:.3f}" for t, f, x in zip(TIME, FORCE, WAY, strict=True)],
    asks=1,
)
add(
    "key_value.txt",
    "Arduino serial plotter",
    "keys and values",
    [f"t:{t:.3f},F:{f:.4f},x:{x:.3f}" for t, f, x in zip(TIME, FORCE, WAY, strict=True)],
    asks=1,
)
add(
    "key_unit.log",
    "loggers",
    "keys, values and units in every line",
    [
        f"time={1e3 * t:.0f} ms; force={1e3 * f:.2f} mN; position={x:.3f} mm"
        for t, f, x in zip(TIME, FORCE, WAY, strict=True)
    ],
)
add(
    "lines.jsonl",
    "loggers",
    "JSON, an object a line",
    [
        json.dumps({"t": round(t, 4), "data": {"force_N": round(f, 5), "position_mm": round(x, 4)}})
        for t, f, x in zip(TIME.tolist(), FORCE.tolist(), WAY.tolist(), strict=True)
    ],
)
add(
    "lists.json",
    "loggers",
    "JSON, a list for each column",
    json.dumps(
        {
            "meta": {"rig": 2},
            "time_s": TIME.round(4).tolist(),
            "force_N": FORCE.round(5).tolist(),
            "position_mm": WAY.round(4).tolist(),
        }
    ),
)
add(
    "objects.json",
    "loggers",
    "JSON, a list of objects",
    json.dumps(
        [{"time (s)": round(t, 4), "force (N)": round(f, 5)} for t, f in zip(TIME, FORCE, strict=True)], indent=1
    ),
    truth=FORCE_ALONE,
)
# HX711 loggers.
add(
    "hx711.csv",
    "HX711 loggers",
    "grams of a load cell, milliseconds",
    ["time (ms),load (g)", *table([(1e3 * TIME, "%d"), GRAMS])],
    truth=FORCE_ALONE,
)
add(
    "hx711_kg.csv",
    "HX711 loggers",
    "kilograms in the name",
    ["millis,weight_kg", *table([(1e3 * TIME, "%d"), (FORCE / 9.80665, "%.6f")])],
    truth=FORCE_ALONE,
)
add(
    "hx711_spike.csv",
    "HX711 loggers",
    "one reading of 2^23 - 1 among good ones",
    [
        "t [s],F [N],x [mm]",
        *(row if k != 700 else f"{TIME[700]:.4f},250.00000,{WAY[700]:.4f}" for k, row in enumerate(STANDARD)),
    ],
    left_out=1,
)
add(
    "hx711_counts.csv",
    "HX711 loggers",
    "counts of the converter",
    ["time (ms),load (counts)", *table([(1e3 * TIME, "%d"), (1e5 * FORCE + 8e6, "%d")])],
    asks=1,
    readable=False,
)
# ROS.
NS = [str(EPOCH * 10**9 + round(t * 1e9)) for t in TIME]
add(
    "rostopic.csv",
    "rostopic echo -p",
    "nanoseconds since 1970, every field a column",
    [
        "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.wrench.force.x,field.wrench.force.y,field.wrench.force.z",
        *(f"{ns},{k},{ns},ft,{f:.6f},0.01,0.02" for k, (ns, f) in enumerate(zip(NS, FORCE, strict=True))),
    ],
    truth=FORCE_ALONE,
    asks=1,
)
add(
    "bag_export.csv",
    "rosbag exporters",
    "seconds and nanoseconds in two columns",
    [
        "secs,nsecs,force.x,position",
        *(f"{ns[:-9]},{int(ns[-9:])},{f:.6f},{x / 1e3:.6f}" for ns, f, x in zip(NS, FORCE, WAY, strict=True)),
    ],
    asks=1,
)
add(
    "net_ft.csv",
    "Net F/T loggers",
    "nanoseconds of a monotonic clock, six components",
    [
        "t_monotonic_ns,Fx_N,Fy_N,Fz_N,Tx_Nm,Ty_Nm,Tz_Nm",
        *(
            f"{8123456789012 + round(t * 1e9)},{0.001 * k % 0.01:.4f},0.0100,{f:.5f},0.0001,0.0002,0.0003"
            for k, (t, f) in enumerate(zip(TIME, FORCE, strict=True))
        ),
    ],
    truth=FORCE_ALONE,
)


def _sparse() -> list[str]:
    rows = [(t, f"{EPOCH + t:.6f},{f:.6f},") for t, f in zip(TIME, FORCE, strict=True)]
    rows += [(t + 0.001, f"{EPOCH + t + 0.001:.6f},,{x / 1e3:.6f}") for t, x in zip(TIME[::4], WAY[::4], strict=True)]
    return [row for _, row in sorted(rows)]


add(
    "plotjuggler.csv",
    "PlotJuggler",
    "topics merged: the slower one has empty cells",
    ["__time,/ft/wrench/force/x,/stage/position/feed", *_sparse()],
    asks=1,
)
add(
    "plotjuggler_iso.csv",
    "PlotJuggler",
    "ISO 8601 with a zone",
    [
        "timestamp,force (N),position (mm)",
        *(
            f"{(START + datetime.timedelta(seconds=float(t))).isoformat(timespec='milliseconds')}Z,{row}"
            for t, row in zip(TIME, table([F, X]), strict=True)
        ),
    ],
)
# pandas, Excel, MATLAB, R, Origin, Octave.
add(
    "pandas.csv",
    "pandas to_csv",
    "an unnamed index, no units",
    [",t,F,x", *(f"{k},{row}" for k, row in enumerate(STANDARD))],
    asks=1,
)
add(
    "timedelta.csv",
    "pandas to_csv",
    "timedelta",
    [
        "time,force_N,position_mm",
        *(f"0 days 00:00:{t:09.6f},{row}" for t, row in zip(TIME, table([F, X]), strict=True)),
    ],
)
add(
    "timetable.csv",
    "MATLAB writetimetable",
    "durations with their unit",
    ["Time,Force,Position", *(f"{t:.4f} sec,{f:.5f},{x:.4f}" for t, f, x in zip(TIME, FORCE, WAY, strict=True))],
    asks=1,
)
add(
    "datetime.csv",
    "MATLAB writetable",
    "dates by the names of months",
    [
        "Time,Force_N,Way_mm",
        *(
            f"{(START + datetime.timedelta(seconds=float(t))).strftime('%d-%b-%Y %H:%M:%S.%f')[:-3]},{row}"
            for t, row in zip(TIME, table([F, X]), strict=True)
        ),
    ],
)
add(
    "excel_days.csv",
    "Excel",
    "day numbers",
    ["Date,Force [N],Position [mm]", *table([(46083.4244444444 + TIME / 86400, "%.12f"), F, X])],
)
add(
    "excel_german.csv",
    "Excel, German",
    "semicolons, decimal comma, clock times with a comma",
    [
        "sep=;",
        "Time;Force [N];Position [mm]",
        *(
            f"10:11:{12 + t:06.3f}".replace(".", ",") + ";" + row
            for t, row in zip(TIME, table([F, X], ";", ","), strict=True)
        ),
    ],
)
add(
    "excel_thousands.csv",
    "Excel",
    "whole numbers with thousands",
    ["t [ms];F [mN]", *(f"{1e3 * t:.0f};{1e3 * f:,.0f}" for t, f in zip(TIME, FORCE, strict=True))],
    truth=FORCE_ALONE,
)
add(
    "unicode.txt",
    "Excel, Unicode text",
    "UTF-16, tabs",
    ["Zeit [s]\tKraft [N]\tWeg [mm]", *table([T, F, X], "\t", ",")],
    encoding="utf-16",
)
add(
    "write_table.txt",
    "R write.table",
    "row names without a header",
    [
        '"time" "force" "position"',
        *(f'"{k + 1}" {row}' for k, row in enumerate(table([T, F, (WAY / 1e3, "%.6f")], " "))),
    ],
    asks=1,
)
add(
    "origin.txt",
    "Origin",
    "long names, units and comments in three rows",
    ["Time\tForce\tDisplacement", "s\tmN\t\u00b5m", "\tchannel 1\tchannel 2", *table([T, MILLINEWTONS, MICRO_X], "\t")],
)
add(
    "fortran.dat",
    "Fortran",
    "exponents with D, blanks",
    [
        "# time [s]   force [N]   position [m]",
        *(f"  {t:.6E}  {f:.6E}  {x / 1e3:.6E}".replace("E", "D") for t, f, x in zip(TIME, FORCE, WAY, strict=True)),
    ],
)
add("gnuplot.dat", "gnuplot", "names behind a comment mark", ["# t(s) F(mN) x(mm)", *table([T, MILLINEWTONS, X], " ")])
add(
    "diadem.csv",
    "DIAdem",
    "micronewtons and micrometres",
    ["t [s],F [\u00b5N],x [\u00b5m]", *table([T, (1e6 * FORCE, "%.1f"), MICRO_X])],
    encoding="cp1252",
)
add(
    "catman.asc",
    "HBM catman",
    "the rate in the name of the time",
    ["CATMAN", "Zeit  1 - Standardmessrate [s]\tKraft [N]\tWeg [mm]", *table([T, F, X], "\t", ",")],
    encoding="cp1252",
)
add(
    "mesur.csv",
    "Mark-10 MESURgauge",
    "reading and travel, lbF and in.",
    ["Reading [lbF],Travel [in.],Time [sec.]", *table([(FORCE / 4.4482216152605, "%.5f"), (WAY / 25.4, "%.5f"), T])],
)
add(
    "sensit.csv",
    "FUTEK SENSIT",
    "elapsed time, pounds",
    ["Sampling Rate,200", "Elapsed Time (sec),Tracking Value (lb)", *table([T, (FORCE / 4.4482216152605, "%.6f")])],
    truth=FORCE_ALONE,
)
add(
    "opensignals.txt",
    "OpenSignals",
    "a header of JSON with the rate, a counter",
    [
        "# OpenSignals Text File Format",
        '# {"00:07": {"sampling rate": 200, "label": ["force"]}}',
        "# EndOfHeader",
        *(f"{k % 16}\t{f:.5f}\t" for k, f in enumerate(FORCE)),
    ],
    truth=FORCE_ALONE,
    asks=1,
)
add(
    "oscilloscope.csv",
    "Tektronix",
    "the step above the table",
    ["Sample Interval,5.0E-03,s", "Vertical Units,N", "Force [N],Position [mm]", *table([F, X])],
)


# Clocks.
def _clock(form: Callable[[datetime.datetime], str], start: datetime.datetime = START) -> list[str]:
    return [
        f"{form(start + datetime.timedelta(seconds=float(t)))},{row}"
        for t, row in zip(TIME, table([F, X]), strict=True)
    ]


add(
    "epoch_ms.csv",
    "loggers",
    "milliseconds since 1970",
    [
        "ts,force (N),position (mm)",
        *(f"{EPOCH * 1000 + round(1e3 * t)},{row}" for t, row in zip(TIME, table([F, X]), strict=True)),
    ],
)
add(
    "epoch_us.csv",
    "loggers",
    "microseconds since 1970",
    [
        "timestamp,force (N),position (mm)",
        *(f"{EPOCH * 10**6 + round(1e6 * t)},{row}" for t, row in zip(TIME, table([F, X]), strict=True)),
    ],
)
add(
    "epoch_s.csv",
    "loggers",
    "seconds since 1970",
    [
        "timestamp,force (N),position (mm)",
        *(f"{EPOCH + t:.4f},{row}" for t, row in zip(TIME, table([F, X]), strict=True)),
    ],
)
add(
    "epoch_float32.csv",
    "loggers",
    "seconds since 1970 in 32 bits, which lose them",
    [
        "timestamp,force (N),position (mm)",
        *(
            f"{struct.unpack('f', struct.pack('f', EPOCH + t))[0]:.0f},{row}"
            for t, row in zip(TIME, table([F, X]), strict=True)
        ),
    ],
    asks=1,
    readable=False,
)
add(
    "two_columns.csv",
    "loggers",
    "date and time in two columns",
    ["Date,Time,Force (N),Position (mm)", *_clock(lambda at: at.strftime("%d.%m.%Y,%H:%M:%S.%f")[:-3])],
)
add(
    "half_day.csv",
    "loggers",
    "AM and PM, past noon",
    [
        "Time,Force (N),Position (mm)",
        *_clock(
            lambda at: at.strftime("%I:%M:%S.%f")[:-3] + at.strftime(" %p"), datetime.datetime(2026, 3, 2, 11, 59, 57)
        ),
    ],
)
add(
    "midnight.csv",
    "loggers",
    "a clock past midnight",
    [
        "Time,Force (N),Position (mm)",
        *_clock(lambda at: at.strftime("%H:%M:%S.%f")[:-3], datetime.datetime(2026, 3, 2, 23, 59, 57)),
    ],
)
add(
    "summer_time.csv",
    "loggers",
    "local time at the change to winter",
    [
        "Time,Force (N),Position (mm)",
        *_clock(
            lambda at: (at - datetime.timedelta(hours=at.hour >= 3)).strftime("%Y-%m-%d %H:%M:%S.%f")[:-3],
            datetime.datetime(2026, 10, 25, 2, 59, 57),
        ),
    ],
)
add(
    "coarse.csv",
    "loggers",
    "times in steps of 0.05 s",
    ["t (s),F (N),x (mm)", *table([(np.floor(TIME * 20 + 1e-9) / 20, "%.2f"), F, X])],
)
add("time_last.csv", "loggers", "no header, time in the last column", table([F, T]), truth=FORCE_ALONE, asks=1)
add("hours.csv", "loggers", "hours", ["time [h],force [N],position [mm]", *table([(TIME / 3600, "%.9f"), F, X])])
# Damage.
add(
    "footer.csv",
    "loggers",
    "a summary below the table",
    ["t [s],F [N],x [mm]", *STANDARD, "", "Maximum,3.130,30.0", "Mean,1.107,"],
    left_out=2,
)
add(
    "cut_off.csv",
    "loggers",
    "killed in the last line",
    "\n".join(["t [s],F [N],x [mm]", *STANDARD[:-1], "6.800,0.0"]),
    left_out=1,
    truth=(Truth(duration_s=float(TIME[-2])),),
)
add(
    "restarted.csv",
    "loggers",
    "header repeated after a restart, time goes on",
    ["t [s],F [N],x [mm]", *STANDARD[:500], "t [s],F [N],x [mm]", *STANDARD[500:]],
    left_out=1,
)
add(
    "overload.csv",
    "loggers",
    "OL and nan among the numbers",
    [
        "t [s],F [N],x [mm]",
        *(
            row if k not in (90, 91, 1300) else f"{TIME[k]:.4f},{'nan' if k == 90 else 'OL'},{WAY[k]:.4f}"
            for k, row in enumerate(STANDARD)
        ),
    ],
    left_out=3,
)
add(
    "reversed.csv",
    "stages",
    "the way counts toward the clamp",
    ["t [s],F [N],x [mm]", *table([T, F, (80.0 - WAY, "%.4f")])],
)
add(
    "absolute.csv",
    "stages",
    "an absolute position far from its zero",
    ["t [s],F [N],x [mm]", *table([T, F, (812.0 + WAY, "%.4f")])],
)
add(
    "two_clocks.csv",
    "loggers",
    "two records, the clock starts again",
    ["t [s],F [N],x [mm]", *STANDARD, *table([T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")])],
    truth=TWO,
)
add(
    "wrong_unit.csv",
    "loggers",
    "the header says ms, the numbers are seconds",
    ["t [ms],F [N]", *table([T, F])],
    asks=1,
    readable=False,
)
add("volts.csv", "loggers", "volts of an amplifier", ["Time (s),Force (V)", *table([T, F])], asks=1, readable=False)
add(
    "unknown_unit.csv",
    "loggers",
    "a unit that nobody knows",
    ["Time (s),Force (zork)", *table([T, F])],
    asks=1,
    readable=False,
)
add(
    "no_time.csv",
    "loggers",
    "neither time nor rate",
    ["force [N],position [mm]", *table([F, X])],
    asks=1,
    readable=False,
)
