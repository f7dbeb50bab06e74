"""Test machines, texture analysers and recorders of physiology: each after its maker's description of the export."""

from __future__ import annotations

import numpy as np
from lab_cut import (
    COUNT,
    FORCE,
    GRAMS,
    MILLINEWTONS,
    OTHER_FORCE,
    OTHER_WAY,
    RATE,
    STANDARD,
    TIME,
    TWO,
    WAY,
    F,
    N,
    T,
    Truth,
    X,
    add,
    each,
    table,
)


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


add("no_x.lvm", "LabVIEW: no column of time: step in the header, an empty first cell", *_lvm("No"), newline="\r\n")
add("one_x.lvm", "LabVIEW: one column of time, unit labels", *_lvm("One", ("mN", "mm"), (1e3, 1.0)), newline="\r\n")
add("multi_x.lvm", "LabVIEW: a column of time for each channel", *_lvm("Multi"), newline="\r\n")
add("comma.lvm", "LabVIEW: decimal comma, comments", *_lvm("One", ("g", "cm"), (1e3 / 9.80665, 0.1), ",", comment=True))
add("comments.lvm", "LabVIEW: no column of time, comments", *_lvm("No", comment=True))
add("comma_separator.lvm", "LabVIEW: separator comma", *_lvm("One", separator=","))
add("segments.lvm", "LabVIEW: three segments of one record, time goes on", *_lvm("One", segments=3))
add("segments_no_x.lvm", "LabVIEW: three segments, time in X0 alone", *_lvm("No", segments=3))
add(
    "segments_again.lvm",
    "LabVIEW: three segments that count from their own clock time",
    *_lvm("One", segments=3, restart=True),
)

# Instron Bluehill: raw data exported as CSV.
BLUEHILL = ["Specimen number (included),3", 'Length,"26.00000",mm', 'Specimen label,"A 7"', ""]
STRAIN = (WAY / 1e3, "%.5f")
add(
    "bluehill.csv",
    "Instron Bluehill: names, then a row of units of which some are foreign",
    *BLUEHILL,
    "Time,Extension,Load,Tensile strain (Strain 1),Tensile stress",
    "(s),(mm),(N),(%),(MPa)",
    *table([T, X, F, STRAIN, (FORCE / 20, "%.4f")], quote='"'),
    newline="\r\n",
)
add(
    "bluehill_german.csv",
    "Instron Bluehill, German: decimal comma in quotation marks between commas",
    *BLUEHILL,
    "Zeit,Verl\u00e4ngerung,Last,Druckdehnung (Verl\u00e4ngerung)",
    "(s),(mm),(N),(mm/mm)",
    *table([T, X, F, STRAIN], decimal=",", quote='"'),
    newline="\r\n",
    encoding="cp1252",
)
add(
    "bluehill_thousands.csv",
    "Instron Bluehill: thousands in quotation marks, millinewtons",
    "Time,Extension,Load",
    "(s),(mm),(mN)",
    *each(lambda t, f, x: f'"{t:.4f}","{x:.4f}","{1e3 * f:,.3f}"'),
)
add(
    "bluehill_below.csv",
    "Instron Bluehill: two specimens below one another, each with its header",
    *BLUEHILL,
    "Time,Extension,Load",
    "(s),(mm),(N)",
    *table([T, X, F], quote='"'),
    "",
    *BLUEHILL,
    "Time,Extension,Load",
    "(s),(mm),(N)",
    *table([T, (OTHER_WAY, "%.4f"), (OTHER_FORCE, "%.5f")], quote='"'),
    truth=TWO,
    left_out=5,
)

# Zwick testXpert: text export, German.
add(
    "testxpert.tra",
    "ZwickRoell testXpert: semicolons, decimal comma, names and units in two rows",
    '"Pr\u00fcfzeit";"Standardkraft";"Traversenweg absolut"',
    '"s";"N";"mm"',
    *table([T, F, X], ";", ","),
    newline="\r\n",
    encoding="cp1252",
)
add(
    "testxpert_compression.txt",
    "ZwickRoell testXpert: tabs; compression counts negative, the crosshead downwards",
    "Pr\u00fcfzeit\tKraft\tWeg",
    "s\tN\tmm",
    *table([T, (-FORCE, "%.5f"), (130.0 - WAY, "%.4f")], "\t", ","),
    encoding="cp1252",
)
# MTS TestSuite / TestWorks: tab-separated export.
add(
    "mts.txt",
    "MTS TestSuite: tabs, units in capitals: Sec, in, lbf",
    "Data Header:\tTimed Data",
    "",
    "Time\tCrosshead\tLoad",
    "Sec\tin\tlbf",
    *table([T, (WAY / 25.4, "%.6f"), (FORCE / 4.4482216152605, "%.6f")], "\t"),
)
add(
    "mts_kilonewton.txt",
    "MTS TestSuite: kilonewtons",
    "Time (Sec)\tLoad (KN)\tCrosshead (MM)",
    *table([T, (FORCE / 1e3, "%.8f"), X], "\t"),
)
# Stable Micro Systems Exponent, texture analysers.
add(
    "texture.csv",
    "Exponent (texture analyser): force in grams",
    "Force (g),Distance (mm),Time (sec)",
    *table([GRAMS, X, T]),
)
add(
    "texture_tests.csv",
    "Exponent (texture analyser): two tests side by side below their names",
    "Test 1,,,Test 2,,",
    "Force,Distance,Time,Force,Distance,Time",
    "g,mm,sec,g,mm,sec",
    *table([GRAMS, X, T, (1e3 * OTHER_FORCE / 9.80665, "%.3f"), (OTHER_WAY, "%.4f"), T]),
    truth=TWO,
)
# Mecmesin Emperor: samples side by side.
add(
    "emperor.csv",
    "Mecmesin Emperor: samples side by side, names for the first alone, minutes",
    "Force,Distance,Time,Event,,,,",
    "N,mm,min,,,,,",
    "Sample 1,,,,Sample 2,,,",
    ",,,,,,,",
    *each(
        lambda a, b: f"{a},{b}",
        table([F, X, (TIME / 60, "%.7f"), (0 * TIME, "%d")]),
        [
            *table([(OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f"), (TIME / 60, "%.7f"), (0 * TIME, "%d")])[:-60],
            *[",,,"] * 60,
        ],
    ),
    newline="\r\n",
    truth=(Truth(), Truth(duration_s=float(TIME[-61]), peak_N=2.71, travel_mm=24.0)),
)
# Shimadzu Trapezium.
add(
    "trapezium.csv",
    "Shimadzu Trapezium: names and units in quotation marks, way called stroke",
    '"Test","cut"',
    '"Time","Force","Stroke"',
    '"sec","N","mm"',
    *STANDARD,
    newline="\r\n",
)
add(
    "trapezium_side.csv",
    "Shimadzu Trapezium: specimens side by side, each named above",
    '"1 _ 1",,,"1 _ 2",,',
    '"Time","Force","Stroke","Time","Force","Stroke"',
    '"sec","N","mm","sec","N","mm"',
    *table([T, F, X, T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")]),
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
    "labchart.txt", "LabChart: units in a header of keys", *LABCHART, *table([T, MILLINEWTONS, X], "\t"), newline="\r\n"
)
add(
    "labchart_comment.txt",
    "LabChart: a comment behind a row",
    *LABCHART,
    *each(lambda k, row: row + ("\t#* blade down" if k == 240 else ""), COUNT, table([T, MILLINEWTONS, X], "\t")),
)
add("labchart_no_time.txt", "LabChart: no column of time", *LABCHART, *table([MILLINEWTONS, X], "\t"))
# BIOPAC AcqKnowledge: text export with header.
BIOPAC = ["cut.acq", "5 msec/sample", "2 channels", "Force", "mN", "Position", "mm"]
add(
    "biopac.txt",
    "BIOPAC AcqKnowledge: names and units below one another, time in minutes",
    *BIOPAC,
    "min\tCH1\tCH2\t",
    f"\t{N}\t{N}\t",
    *each(lambda row: row + "\t", table([(TIME / 60, "%.8f"), MILLINEWTONS, X], "\t")),
    newline="\r\n",
)
add(
    "biopac_no_time.txt",
    "BIOPAC AcqKnowledge: no column of time: interval above",
    *BIOPAC,
    "CH1\tCH2\t",
    f"{N}\t{N}\t",
    *each(lambda row: row + "\t", table([MILLINEWTONS, X], "\t")),
    newline="\r\n",
)
# Vernier Logger Pro and Graphical Analysis.
add(
    "vernier.csv",
    "Vernier Logger Pro: the run in front of each name",
    '"Latest: Time (s)","Latest: Force (N)","Latest: Position (m)"',
    *table([T, F, (WAY / 1e3, "%.6f")]),
)
add(
    "vernier_runs.csv",
    "Vernier Graphical Analysis: two runs side by side",
    "Run 1: Time (s),Run 1: Force (N),Run 1: Position (mm),Run 2: Time (s),Run 2: Force (N),Run 2: Position (mm)",
    *table([T, F, X, T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")]),
    truth=TWO,
)
add(
    "data_sets.csv",
    "Vernier Graphical Analysis: data set in front of each name, no blank before the unit",
    "Data Set 1:Time(s),Data Set 1:Force(N),Data Set 1:Position(cm)",
    *table([T, F, (WAY / 10, "%.5f")]),
)
