"""Recorders, oscilloscopes, data tables and robots' logs, each after its maker's description or public examples."""

from __future__ import annotations

import json

import numpy as np
from lab_cut import (
    COUNT,
    EPOCH,
    FORCE,
    FORCE_ALONE,
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
    X,
    add,
    at,
    clock_time,
    each,
    table,
)

FX = table([F, X])
VOLTS = (0.4 * FORCE, "%.5f")

# Recorders: names and units in lines with a label in front, in a cell more than the rows have, or above an empty one.
add(
    "hioki.csv",
    "Hioki Memory HiCorder: labels in front of names and units, which shift them",
    '"COMMENT",""',
    '"NUM_SIGS",3',
    '"INTERVAL",5.000E-03',
    '"HORZ_UNITS","S"',
    '"VERT_UNITS","S","N","mm"',
    '"SIGNAL","TIME","ACH1","ACH2"',
    '"DATA"',
    *STANDARD,
)
add(
    "yokogawa.csv",
    "Yokogawa DLM: a header by traces above an empty first column, no time",
    '"Model Name","DLM3024",',
    '"TraceName","Force","Stage"',
    '"VUnit","N","mm"',
    f'"SampleRate",{RATE:.0f},{RATE:.0f}',
    '"HUnit","s","s"',
    '"Date","2026/03/02","2026/03/02"',
    "",
    *each(lambda row: f",{row}", FX),
)
add(
    "mdo.csv",
    "Tektronix MDO: a header of labels, units of two channels in one line",
    "Model,MDO3014",
    "Horizontal Units,s,",
    f"Sample Interval,{1 / RATE},",
    "Vertical Units,N,mm",
    ",,",
    "Label,Force,Stage",
    "TIME,CH1,CH2",
    *STANDARD,
)
_BESIDE = [("Record Length", f"{N}"), ("Source", "CH1"), ("Vertical Units", "V"), ("Horizontal Units", "s")]
add(
    "tds.csv",
    "Tektronix TDS: the header beside the first rows; volts",
    *[f"{k},{v},,{row}," for (k, v), row in zip([*_BESIDE, *[("", "")] * N][:N], table([T, VOLTS], ", "), strict=True)],
    asks=1,
    readable=False,
)
add(
    "infiniivision.csv",
    "Keysight InfiniiVision: units in words: volts",
    "x-axis,1",
    "second,Volt",
    *table([T, VOLTS]),
    asks=1,
    readable=False,
)
add(
    "infiniivision_newton.csv",
    "Keysight InfiniiVision: units in words",
    "x-axis,1,2",
    "second,Newton,Millimeter",
    *STANDARD,
)
add(
    "signal_express.txt",
    "SignalExpress: names, beginnings and steps in lines of their own",
    "channel names: ",
    "Force (N)\tPosition (mm)",
    "start times:",
    "\t".join([at(0.25).strftime("%m/%d/%Y %H:%M:%S.%f")] * 2),
    "dt:",
    f"{1 / RATE}\t{1 / RATE}",
    "data:",
    *table([F, X], "\t"),
)
add(
    "dated.txt",
    "Dewesoft: dates below a time without a unit, UTF-16",
    "Zeit (-)\tKraft (N)\tWeg (mm)",
    *each(lambda t, row: f"{at(t):%d.%m.%Y %H:%M:%S},{round(t % 1 * 1000):03d}\t{row}", TIME, table([F, X], "\t", ",")),
    encoding="utf-16",
)
add(
    "catman_amplifier.asc",
    "HBM catman: the amplifier in front of the names",
    "HBM_CATMAN_DATAFILE_40\tVersion 5.1",
    "",
    "Zeit  1 - Standardmessrate [s]\tMX840_CH 1 Kraft [N]\tMX840_CH 2 Weg [mm]",
    *table([T, F, X], "\t", ","),
    encoding="cp1252",
)
add(
    "picolog.csv",
    "PicoLog 6: times without a name, one channel",
    '"","Load cell Last (N)"',
    *each(lambda t, f, x: f'"{at(t):%Y-%m-%dT%H:%M:%S.%f}+00:00",{f:.5f}'),
    truth=FORCE_ALONE,
)
add(
    "shift_jis.csv",
    "Shimadzu Trapezium: Japanese names in Shift-JIS",
    "時間,試験力,ストローク",
    "sec,N,mm",
    *STANDARD,
    encoding="shift_jis",
)
add(
    "capstone.csv",
    "PASCO Capstone: the run behind the unit, two runs",
    "Time (s) Run #1,Force (N) Run #1,Position (mm) Run #1,Time (s) Run #2,Force (N) Run #2,Position (mm) Run #2",
    *table([T, F, X, T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")]),
    truth=TWO,
)
add(
    "net_ft_counts.csv",
    "ATI Net F/T: counts, and how many make a newton; a sequence",
    '"RDT Sample Rate: 200"',
    '"Force Units: N","Counts per Unit Force: 1000000.0"',
    '"Torque Units: N-m","Counts per Unit Torque: 1000000.0"',
    "Status (hex),RDT Sequence,F/T Sequence,Fx,Fy,Fz,Tx,Ty,Tz,Time",
    *each(
        lambda k: f'0,{35 * k},{k},{1e6 * FORCE[k]:.0f},{1e3 * np.sin(k):.0f},{k % 3},3,-5,8,"{clock_time(TIME[k])}"',
        range(N),
    ),
    truth=FORCE_ALONE,
)

add(
    "wavematrix.csv",
    "Instron WaveMatrix: commas within the brackets of the names",
    "Total Time (s),Cycle,Step,Load(8800 (0,3):Load) (N),Position(8800 (0,3):Position) (mm)",
    *each(lambda t, f, x: f"{t:.4f},1,1,{f:.5f},{x:.4f}"),
)
add(
    "dasylab.asc",
    "DASYLab: a separator at the end of every row, but not of the names",
    "DASYLab - V 13.00",
    f"Delta: {1 / RATE:.7f} sec",
    "Measurement time[s];Force [N];Way [mm]",
    *each(lambda row: f"{row};", table([T, F, X], ";", ",")),
)
add(
    "keyence.csv",
    "Keyence: units of the last two columns alone, behind their label",
    '"Sampling","5ms"',
    '"Unit","N","mm"',
    '"No.","Time","(1)Force","(2)Stroke"',
    *each(lambda k, row: f"{k},{row}", COUNT, STANDARD),
)
add(
    "graphtec.csv",
    "Graphtec midi LOGGER: date, and its milliseconds in a column of their own; signs in front of all numbers",
    "Vendor,GRAPHTEC Corporation",
    "Sampling interval,5ms",
    "Number,Date&Time,ms,CH1,CH2",
    "NO.,Time,ms,N,mm",
    *each(
        lambda k, t, f, x: f"{k},{at(t):%Y/%m/%d %H:%M:%S},{round(t * 1e3) % 1000},{f:+.5f},{x:+.4f}",
        range(1, N + 1),
        TIME,
        FORCE,
        WAY,
    ),
)
add(
    "foxglove.csv",
    "Foxglove: a topic in front of every row, which is no comment",
    "topic,receive_time,wrench.force.x,wrench.force.y",
    *each(lambda t, f, x: f"/ft,{EPOCH + t:.6f},{f:.5f},0.01"),
    truth=FORCE_ALONE,
    asks=1,
)

# Channels below one another.
add(
    "waves.itx",
    "Igor Pro: two waves in one block, step and units in commands below",
    "IGOR",
    "WAVES/D\tforce\tstage",
    "BEGIN",
    *each(lambda row: f"\t{row}", table([F, (WAY / 1e3, "%.7f")], "\t")),
    "END",
    f'X SetScale/P x 0,{1 / RATE},"s", force; SetScale y 0,0,"N", force',
    f'X SetScale/P x 0,{1 / RATE},"s", stage; SetScale y 0,0,"m", stage',
)
add(
    "blocks.itx",
    "Igor Pro: a block for each wave",
    "IGOR",
    *(
        line
        for name, unit, column in (("load", "N", F), ("way", "mm", X))
        for line in (
            f"WAVES\t{name}",
            "BEGIN",
            *table([column]),
            "END",
            f'X SetScale/P x 0,{1 / RATE},"s", {name}; SetScale y 0,0,"{unit}", {name}',
        )
    ),
)
add(
    "spike2.txt",
    "Spike2: a block for each channel, with its begin and step",
    '"INFORMATION"',
    '"cut.smrx"',
    "",
    *(
        line
        for k, (name, unit, column) in enumerate((("Force", "N", F), ("Stage", "mm", X)), 1)
        for line in (
            f'"CHANNEL"\t"{k}"',
            '"Waveform"',
            f'"{name}"',
            f'"{unit}"',
            "",
            f'"START"\t0.00000\t{1 / RATE:.5f}',
            *table([column]),
            "",
        )
    ),
)
add(
    "tidy.csv",
    "R tidyr, databases: a row for each channel of each time",
    "time_s,name,value",
    *(
        row
        for t, f, x in zip(TIME, FORCE, WAY, strict=True)
        for row in (f"{t:.3f},force_N,{f:.5f}", f"{t:.3f},position_mm,{x:.4f}")
    ),
)

# Data frames.
add(
    "multi_index.csv",
    "pandas to_csv: three levels of names, the index named below them",
    "sensor,ft,stage",
    "axis,Fx,x",
    "unit,mN,mm",
    "time_s,,",
    *table([T, MILLINEWTONS, X]),
)
add(
    "brackets.csv",
    "R write.csv: brackets of the names as dots",
    '"","Time..s.","Force..N.","Travel..mm."',
    *each(lambda k, row: f'"{k}",{row}', range(1, N + 1), STANDARD),
)

# Robots.
_POSE = [f"actual_TCP_pose_{k}" for k in range(6)]
_WRENCH = [f"actual_TCP_force_{k}" for k in range(6)]
add(
    "rtde.csv",
    "Universal Robots RTDE: pose and wrench by numbers, blanks",
    " ".join(["timestamp", *_POSE, *_WRENCH]),
    *each(
        lambda t, f, x: f"{1234.5 + t:.4f} {-0.4 + x / 1e3:.7f} -0.2 0.3 3.1 0.01 0.02 {-f:.5f} 0.1 0.2 0.01 0.02 0.03"
    ),
    asks=1,
)
add(
    "franka.jsonl",
    "libfranka: a pose as a matrix of 16 numbers, an external wrench",
    *each(
        lambda t, f, x: json.dumps(
            {
                "time": round(EPOCH + t, 4),
                "O_T_EE": [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, round(0.4 + x / 1e3, 7), 0.1, 0.3, 1],
                "O_F_ext_hat_K": [round(f, 5), 0.1, 0.2, 0.01, 0.02, 0.03],
            }
        ),
        TIME.tolist(),
        FORCE.tolist(),
        WAY.tolist(),
    ),
    asks=1,
)
_BITS = {"column": ["nSeq", "DI", "CH1"], "sensor": ["RAW"], "sampling rate": 200, "resolution": [16], "label": ["CH1"]}
add(
    "plux.txt",
    "OpenSignals: raw numbers of a sensor",
    "# OpenSignals Text File Format. Version 1",
    f"# {json.dumps({'00:07': _BITS})}",
    "# EndOfHeader",
    *each(lambda k, f: f"{k % 16}\t0\t{32768 + 1000 * f:.0f}\t", COUNT, FORCE),
    asks=1,
    readable=False,
)
add(
    "hx711_raw.csv",
    "HX711 loggers: whole numbers without a unit",
    "millis,load",
    *each(lambda t, f, x: f"{1e3 * t:.0f},{84000 + 1e5 * f:.0f}"),
    asks=1,
    readable=False,
)
