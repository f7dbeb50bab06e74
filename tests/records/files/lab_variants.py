"""Spellings of headers, units, signs and times that programs and people use, one in each file."""

from __future__ import annotations

import numpy as np
from lab_cut import (
    FORCE,
    FORCE_ALONE,
    MICRO_X,
    MILLINEWTONS,
    OTHER_FORCE,
    OTHER_WAY,
    STANDARD,
    TIME,
    TWO,
    WAY,
    F,
    T,
    Truth,
    X,
    add,
    at,
    table,
)

add("tab_cap.txt", "people and programs", "tab cap", ["TIME\tFORCE\tPOSITION", "S\tN\tMM", *table([T, F, X], "\t")])
add(
    "blanks_units.txt",
    "people and programs",
    "blanks units",
    [
        "  Time (s)    Load (N)    Crosshead Position (mm)",
        *table([(TIME, "%10.4f"), (FORCE, "%10.5f"), (WAY, "%10.4f")], " "),
    ],
)
add("semi_point.csv", "people and programs", "semi point", ["Zeit in s;Kraft in N;Weg in mm", *table([T, F, X], ";")])
add(
    "thou_space.csv",
    "people and programs",
    "thou space",
    [
        "t [ms];F [mN];x [um]",
        *(
            f"{1e3 * t:.0f};{1e3 * f:,.1f};{1e3 * x:,.0f}".replace(",", "\u202f").replace(".", ",")
            for t, f, x in zip(TIME, FORCE, WAY, strict=True)
        ),
    ],
)
add(
    "thou_dot.csv",
    "people and programs",
    "thou dot",
    [
        "t [ms];F [mN];x [um]",
        *(
            f"{1e3 * t:.0f};{1e3 * f:,.2f};{1e3 * x:,.1f}".replace(",", "_").replace(".", ",").replace("_", ".")
            for t, f, x in zip(TIME, FORCE, WAY, strict=True)
        ),
    ],
)
add(
    "thou_dot_whole.csv",
    "people and programs",
    "thou dot whole",
    [
        "t [ms];F [mN];x [um]",
        *(
            f"{1e3 * t:.0f};{1e3 * f:,.0f};{1e3 * x:,.0f}".replace(",", ".")
            for t, f, x in zip(TIME, FORCE, WAY, strict=True)
        ),
    ],
)
add(
    "thou_apos.csv",
    "people and programs",
    "thou apos",
    [
        "t [ms];F [mN]",
        *(f"{1e3 * t:.0f};{1e3 * f:,.1f}".replace(",", "'") for t, f, x in zip(TIME, FORCE, WAY, strict=True)),
    ],
    truth=FORCE_ALONE,
)
add(
    "thou_time.csv",
    "people and programs",
    "thou time",
    ['"t (ms)","F (mN)"', *(f'"{1e3 * t:,.0f}","{1e3 * f:,.2f}"' for t, f, x in zip(TIME, FORCE, WAY, strict=True))],
    truth=FORCE_ALONE,
)
add(
    "quoted_all.csv",
    "people and programs",
    "quoted all",
    ['"Time (s)","Force (N)","Disp. (mm)"', *table([T, F, X], quote='"')],
)
add("trailing.csv", "people and programs", "trailing", ["Time (s),Force (N),Disp. (mm),", *(r + "," for r in STANDARD)])
add(
    "kv_units_hdr.txt",
    "people and programs",
    "kv units hdr",
    ["Force unit: N", "Position unit: mm", "Time unit: s", "", "Time\tForce\tPosition", *table([T, F, X], "\t")],
)
add("pos_m.csv", "people and programs", "pos m", ["time,force,position", *table([T, F, (WAY / 1e3, "%.6f")])], asks=1)
add("cm.csv", "people and programs", "cm", ["time [s],force [N],position [cm]", *table([T, F, (WAY / 10, "%.5f")])])
add(
    "ft.csv",
    "people and programs",
    "ft",
    ["time [s],force [lbf],position [ft]", *table([T, (FORCE / 4.4482216, "%.6f"), (WAY / 304.8, "%.7f")])],
)
add(
    "lbs.csv",
    "people and programs",
    "lbs",
    [
        "Elapsed Time (sec),Load (lbs),Extension (inches)",
        *table([T, (FORCE / 4.4482216, "%.6f"), (WAY / 25.4, "%.6f")]),
    ],
)
add(
    "kgf.csv",
    "people and programs",
    "kgf",
    [
        "No.,Time(s),Load(kgf),Stroke(mm)",
        *(f"{k + 1},{r}" for k, r in enumerate(table([T, (FORCE / 9.80665, "%.6f"), X]))),
    ],
)
add(
    "ozf.csv",
    "people and programs",
    "ozf",
    ["Time (s),Load (ozf)", *table([T, (FORCE / 0.27801385, "%.6f")])],
    truth=FORCE_ALONE,
)
add(
    "us.csv",
    "people and programs",
    "us",
    ["micros,force_mN,pos_um", *table([(1e6 * TIME, "%d"), MILLINEWTONS, MICRO_X])],
)
add(
    "ms_float.csv",
    "people and programs",
    "ms float",
    ["Timestamp (ms),Force (mN),Position (mm)", *table([(1e3 * TIME, "%.1f"), MILLINEWTONS, X])],
)
add(
    "iso_plus.csv",
    "people and programs",
    "iso plus",
    [
        "time,F [N]",
        *(f"{at(t).isoformat(timespec='microseconds')}+01:00,{f:.4f}" for t, f in zip(TIME, FORCE, strict=True)),
    ],
    truth=FORCE_ALONE,
)
add(
    "iso_space.csv",
    "people and programs",
    "iso space",
    [
        "time;F [N]",
        *(
            f"{at(t).isoformat(sep=' ', timespec='milliseconds').replace('.', ',')};{f:.4f}".replace(".", ",")
            for t, f in zip(TIME, FORCE, strict=True)
        ),
    ],
    truth=FORCE_ALONE,
)
add(
    "us_date.csv",
    "people and programs",
    "us date",
    [
        "time,F [N]",
        *(f"{at(t).strftime('%m/%d/%Y %I:%M:%S.%f %p')},{f:.4f}" for t, f in zip(TIME, FORCE, strict=True)),
    ],
    truth=FORCE_ALONE,
)
add(
    "clock_only_ms.csv",
    "people and programs",
    "clock only ms",
    [
        "Uhrzeit\tKraft[N]",
        *(f"{at(t).strftime('%H:%M:%S,%f')[:-3]}\t{f:.4f}".replace(".", ",") for t, f in zip(TIME, FORCE, strict=True)),
    ],
    truth=FORCE_ALONE,
)
add(
    "clock_sec_ms.csv",
    "people and programs",
    "clock sec ms",
    [
        "Time,Millis,Force (N)",
        *(f"{at(t).strftime('%H:%M:%S')},{round(t * 1000) % 1000},{f:.4f}" for t, f in zip(TIME, FORCE, strict=True)),
    ],
    truth=FORCE_ALONE,
)
add(
    "sample_rate_hdr.csv",
    "people and programs",
    "sample rate hdr",
    ["Sample Rate: 200 Hz", "", "Force [N],Displacement [mm]", *table([F, X])],
)
add(
    "rate_hash.csv",
    "people and programs",
    "rate hash",
    ["# fs = 200", "# channels: force (N), position (mm)", "force_N;position_mm", *table([F, X], ";")],
)
add(
    "abtast.csv", "people and programs", "abtast", ["Abtastrate;200 Hz", "Kraft [N];Weg [mm]", *table([F, X], ";", ",")]
)
add("dt.csv", "people and programs", "dt", ["dt;0,005 s", "Kraft [N];Weg [mm]", *table([F, X], ";", ",")])
add(
    "index_rate.csv",
    "people and programs",
    "index rate",
    ["Sampling interval (ms): 5", "Sample,Force (N),Position (mm)", *(f"{k},{r}" for k, r in enumerate(table([F, X])))],
)
add(
    "neg_pull.csv",
    "people and programs",
    "neg pull",
    ["Time (s),Force (N),Position (mm)", *table([T, (-FORCE, "%.5f"), X])],
)
add(
    "offset.csv",
    "people and programs",
    "offset",
    ["Time (s),Force (N),Position (mm)", *table([T, (FORCE + 2.5, "%.5f"), X])],
    truth=(Truth(peak_N=5.63),),
)
add(
    "six.csv",
    "people and programs",
    "six",
    [
        "time,Fx,Fy,Fz,Tx,Ty,Tz",
        *table(
            [
                T,
                (0.02 * FORCE, "%.5f"),
                F,
                (0.01 * FORCE, "%.5f"),
                (0 * FORCE, "%.5f"),
                (0 * FORCE, "%.5f"),
                (0 * FORCE, "%.5f"),
            ]
        ),
    ],
    truth=FORCE_ALONE,
    asks=1,
)
add(
    "six_units.csv",
    "people and programs",
    "six units",
    [
        "Time (s),Fx (N),Fy (N),Fz (N),Tx (Nmm),Ty (Nmm),Tz (Nmm)",
        *table(
            [
                T,
                (0.3 * FORCE, "%.5f"),
                F,
                (0.4 * FORCE, "%.5f"),
                (0 * FORCE, "%.5f"),
                (0 * FORCE, "%.5f"),
                (0 * FORCE, "%.5f"),
            ]
        ),
    ],
    truth=FORCE_ALONE,
    asks=1,
)
add(
    "pose.csv",
    "people and programs",
    "pose",
    ["t_s,fx_N,x_mm,y_mm,z_mm", *table([T, F, X, (0 * WAY, "%.3f"), (0 * WAY + 5, "%.3f")])],
)
add(
    "sto.sto",
    "",
    "OpenSim",
    [
        "Force",
        "version=1",
        "nRows=1361",
        "nColumns=3",
        "inDegrees=no",
        "endheader",
        "time\tground_force_vx\tpos_x",
        *table([T, F, (WAY / 1e3, "%.6f")], "\t"),
    ],
    asks=1,
)
add(
    "tdms_txt.txt",
    "people and programs",
    "tdms txt",
    ["Root Name\tTitle", "cut\t", "", "Group\tChannel", "", "Time*\tForce*", "s\tN", *table([T, F], "\t")],
    truth=FORCE_ALONE,
)
add(
    "markdown.md",
    "people and programs",
    "markdown",
    ["| t [s] | F [N] | x [mm] |", "| --- | --- | --- |", *(f"| {r} |" for r in table([T, F, X], " | "))],
)
add("jsonarr.txt", "people and programs", "jsonarr", [f"[{r}]" for r in table([T, F, X], ", ")], asks=1)
add(
    "py_log.txt",
    "people and programs",
    "py log",
    [f"INFO: time={t:.3f} force={f:.4f} pos={x:.3f}" for t, f, x in zip(TIME, FORCE, WAY, strict=True)],
    asks=1,
)
add(
    "dewesoft.txt",
    "people and programs",
    "dewesoft",
    [
        "Data1",
        "",
        "Start time: 3/2/2026 10:11:12.000",
        "Sample rate: 200.0 Hz",
        "",
        "Time (s)\tForce (N)\tPosition (mm)",
        "s\tN\tmm",
        *table([T, F, X], "\t"),
    ],
)
add(
    "itx.itx",
    "people and programs",
    "itx",
    [
        "IGOR",
        "WAVES/D\ttime_s\tforce_N",
        "BEGIN",
        *(f"\t{r}" for r in table([T, F], "\t")),
        "END",
        'X SetScale/P x 0,1,"", time_s',
    ],
    truth=FORCE_ALONE,
)
add(
    "octave.txt",
    "people and programs",
    "octave",
    [
        "# Created by Octave 8.4",
        "# name: data",
        "# type: matrix",
        "# rows: 1361",
        "# columns: 3",
        *(f" {r}" for r in table([T, F, (WAY / 1e3, "%.6f")], " ")),
        "",
        "",
    ],
    asks=1,
)
add(
    "nan_pos.csv",
    "people and programs",
    "nan pos",
    [
        "t [s],F [N],x [mm]",
        *(
            f"{t:.4f},{f:.5f},{x if k % 5 == 0 else float('nan')}"
            for k, (t, f, x) in enumerate(zip(TIME, FORCE, WAY, strict=True))
        ),
    ],
)
add(
    "text_col.csv",
    "people and programs",
    "text col",
    [
        "t [s],state,F [N],x [mm]",
        *(
            f"{t:.4f},{'cut' if 1 < t < 5 else 'idle'},{f:.5f},{x:.4f}"
            for t, f, x in zip(TIME, FORCE, WAY, strict=True)
        ),
    ],
)
add(
    "trial_col.csv",
    "people and programs",
    "trial col",
    [
        "trial,t [s],F [N],x [mm]",
        *(f"1,{r}" for r in STANDARD),
        *(f"2,{r}" for r in table([T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")])),
    ],
    truth=TWO,
)
add(
    "hdr_repeat_time0.csv",
    "people and programs",
    "hdr repeat time0",
    [
        "t [s],F [N],x [mm]",
        *STANDARD,
        "",
        "t [s],F [N],x [mm]",
        *table([T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")]),
    ],
    truth=TWO,
    left_out=1,
)
add(
    "dup_time.csv",
    "people and programs",
    "dup time",
    ["t [s],F [N],x [mm]", *(r for k, row in enumerate(STANDARD) for r in ([row, row] if k in (5, 600) else [row]))],
    left_out=2,
)
add(
    "late.csv",
    "people and programs",
    "late",
    ["t [s],F [N],x [mm]", *STANDARD[:600], STANDARD[601], STANDARD[600], *STANDARD[602:]],
)
add(
    "trigger0.csv",
    "people and programs",
    "trigger0",
    [
        ",time,Fx,Fy",
        *(f"{k},0.0,{f:.4f},0.0" for k, f in enumerate(FORCE[:6])),
        *(f"{k + 6},{t + 0.005:.4f},{f:.4f},0.0" for k, (t, f) in enumerate(zip(TIME, FORCE, strict=True))),
    ],
    truth=FORCE_ALONE,
    asks=1,
    left_out=5,
)
add(
    "excel_time_frac.csv",
    "people and programs",
    "excel time frac",
    [
        "Time;Force [N]",
        *(f"{0.4244444 + t / 86400:.12f};{f:.4f}".replace(".", ",") for t, f in zip(TIME, FORCE, strict=True)),
    ],
    truth=FORCE_ALONE,
)
add(
    "degC.csv",
    "people and programs",
    "degC",
    ["Time (s),Temp (\u00b0C),Force (N),Position (mm)", *table([T, (0 * TIME + 21.3, "%.1f"), F, X])],
    encoding="cp1252",
)
add(
    "stress_first.csv",
    "people and programs",
    "stress first",
    [
        "Time (s),Stress (MPa),Strain (%),Load (N),Stroke (mm)",
        *table([T, (FORCE / 5, "%.4f"), (WAY / 3, "%.4f"), F, X]),
    ],
)
add(
    "two_loads.csv",
    "people and programs",
    "two loads",
    ["Time (s),Load (N),Peak Load (N),Position (mm)", *table([T, F, (np.maximum.accumulate(FORCE), "%.5f"), X])],
)
add(
    "cmd_pos.csv",
    "people and programs",
    "cmd pos",
    ["time_s,force_N,commanded_position_mm,position_mm", *table([T, F, (WAY + 0.1, "%.4f"), X])],
)
add(
    "speed_first.csv",
    "people and programs",
    "speed first",
    ["Time [s];Speed [mm/min];Force [N];Travel [mm]", *table([T, (0 * TIME + 450, "%.1f"), F, X], ";", ",")],
)
add("utf8bom.csv", "people and programs", "utf8bom", ["\ufeffTime (s),Force (N),Position (mm)", *STANDARD])
add("mac.csv", "people and programs", "mac", ["Time (s),Force (N),Position (mm)", *STANDARD], newline="\r")
add(
    "spaces_sep.csv",
    "people and programs",
    "spaces sep",
    ["Time (s), Force (N), Position (mm)", *(r.replace(",", ", ") for r in STANDARD)],
)
add(
    "fixed.txt",
    "people and programs",
    "fixed",
    [
        "      time     force  position",
        "        s         N        mm",
        *table([(TIME, "%10.4f"), (FORCE, "%10.5f"), (WAY, "%10.4f")], ""),
    ],
)
add(
    "winwedge.txt",
    "people and programs",
    "winwedge",
    [f"{t:8.3f} s  {f:+.3f} N" for t, f in zip(TIME, FORCE, strict=True)],
    truth=FORCE_ALONE,
    asks=0,
)
add(
    "gauge.txt",
    "people and programs",
    "gauge",
    [f"{at(t).strftime('%H:%M:%S.%f')[:-3]}, {f:+.3f} N" for t, f in zip(TIME, FORCE, strict=True)],
    truth=FORCE_ALONE,
)
add(
    "kN_small.csv",
    "people and programs",
    "kN small",
    ["Time;Force;Position", "[s];[kN];[mm]", *table([T, (FORCE / 1e3, "%.7f"), X], ";", ",")],
)
add(
    "units_below_paren.csv",
    "people and programs",
    "units below paren",
    ["Time,Load,Position", "(sec),(lbf),(in)", *table([T, (FORCE / 4.4482216, "%.6f"), (WAY / 25.4, "%.6f")])],
)
add(
    "time_named_units.csv",
    "people and programs",
    "time named units",
    ["Elapsed seconds,Force newtons,Travel millimeters", *STANDARD],
)
add("dash_name.csv", "people and programs", "dash name", ["time-s,force-N,position-mm", *STANDARD])
add(
    "camel.csv",
    "people and programs",
    "camel",
    ["timeMs,forceMn,positionMm", *table([(1e3 * TIME, "%d"), MILLINEWTONS, X])],
    asks=1,
)
add(
    "kraft_sensor.csv",
    "people and programs",
    "kraft sensor",
    ["Zeit;Kraftsensor 1;Wegsensor", "s;N;mm", *table([T, F, X], ";", ",")],
)
add(
    "fr.csv",
    "people and programs",
    "fr",
    ["Temps (s);Force (N);D\u00e9placement (mm)", *table([T, F, X], ";", ",")],
    encoding="cp1252",
)
add("jp.csv", "people and programs", "jp", ["\u6642\u9593(s),\u8377\u91cd(N),\u5909\u4f4d(mm)", *STANDARD])
add(
    "cn_gbk.csv",
    "people and programs",
    "cn gbk",
    ["\u65f6\u95f4(s),\u529b(N),\u4f4d\u79fb(mm)", *STANDARD],
    encoding="gbk",
)
