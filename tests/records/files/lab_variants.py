"""Spellings of headers, units, signs and times that programs and people use, one in each file."""

from __future__ import annotations

import numpy as np
from lab_cut import (
    COUNT,
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
    add_odd,
    at,
    each,
    table,
)

add_odd("tab_cap.txt", "TIME\tFORCE\tPOSITION", "S\tN\tMM", *table([T, F, X], "\t"))
add_odd(
    "blanks_units.txt",
    "  Time (s)    Load (N)    Crosshead Position (mm)",
    *table([(TIME, "%10.4f"), (FORCE, "%10.5f"), (WAY, "%10.4f")], " "),
)
add_odd("semi_point.csv", "Zeit in s;Kraft in N;Weg in mm", *table([T, F, X], ";"))
add_odd(
    "thou_space.csv",
    "t [ms];F [mN];x [um]",
    *each(lambda t, f, x: f"{1e3 * t:.0f};{1e3 * f:,.1f};{1e3 * x:,.0f}".replace(",", "\u202f").replace(".", ",")),
)
add_odd(
    "thou_dot.csv",
    "t [ms];F [mN];x [um]",
    *each(
        lambda t, f, x: (
            f"{1e3 * t:.0f};{1e3 * f:,.2f};{1e3 * x:,.1f}".replace(",", "_").replace(".", ",").replace("_", ".")
        )
    ),
)
add_odd(
    "thou_dot_whole.csv",
    "t [ms];F [mN];x [um]",
    *each(lambda t, f, x: f"{1e3 * t:.0f};{1e3 * f:,.0f};{1e3 * x:,.0f}".replace(",", ".")),
)
add_odd(
    "thou_apos.csv",
    "t [ms];F [mN]",
    *each(lambda t, f, x: f"{1e3 * t:.0f};{1e3 * f:,.1f}".replace(",", "'")),
    truth=FORCE_ALONE,
)
add_odd(
    "thou_time.csv", '"t (ms)","F (mN)"', *each(lambda t, f, x: f'"{1e3 * t:,.0f}","{1e3 * f:,.2f}"'), truth=FORCE_ALONE
)
add_odd("quoted_all.csv", '"Time (s)","Force (N)","Disp. (mm)"', *table([T, F, X], quote='"'))
add_odd("trailing.csv", "Time (s),Force (N),Disp. (mm),", *each(lambda r: r + ",", STANDARD))
add_odd(
    "kv_units_hdr.txt",
    "Force unit: N",
    "Position unit: mm",
    "Time unit: s",
    "",
    "Time\tForce\tPosition",
    *table([T, F, X], "\t"),
)
add_odd("pos_m.csv", "time,force,position", *table([T, F, (WAY / 1e3, "%.6f")]), asks=1)
add_odd("cm.csv", "time [s],force [N],position [cm]", *table([T, F, (WAY / 10, "%.5f")]))
add_odd("ft.csv", "time [s],force [lbf],position [ft]", *table([T, (FORCE / 4.4482216, "%.6f"), (WAY / 304.8, "%.7f")]))
add_odd(
    "lbs.csv",
    "Elapsed Time (sec),Load (lbs),Extension (inches)",
    *table([T, (FORCE / 4.4482216, "%.6f"), (WAY / 25.4, "%.6f")]),
)
add_odd(
    "kgf.csv",
    "No.,Time(s),Load(kgf),Stroke(mm)",
    *each(lambda k, r: f"{k + 1},{r}", COUNT, table([T, (FORCE / 9.80665, "%.6f"), X])),
)
add_odd("ozf.csv", "Time (s),Load (ozf)", *table([T, (FORCE / 0.27801385, "%.6f")]), truth=FORCE_ALONE)
add_odd("us.csv", "micros,force_mN,pos_um", *table([(1e6 * TIME, "%d"), MILLINEWTONS, MICRO_X]))
add_odd("ms_float.csv", "Timestamp (ms),Force (mN),Position (mm)", *table([(1e3 * TIME, "%.1f"), MILLINEWTONS, X]))
add_odd(
    "iso_plus.csv",
    "time,F [N]",
    *each(lambda t, f, x: f"{at(t).isoformat(timespec='microseconds')}+01:00,{f:.4f}"),
    truth=FORCE_ALONE,
)
add_odd(
    "iso_space.csv",
    "time;F [N]",
    *each(
        lambda t, f, x: f"{at(t).isoformat(sep=' ', timespec='milliseconds').replace('.', ',')};{f:.4f}".replace(
            ".", ","
        )
    ),
    truth=FORCE_ALONE,
)
add_odd(
    "us_date.csv",
    "time,F [N]",
    *each(lambda t, f, x: f"{at(t).strftime('%m/%d/%Y %I:%M:%S.%f %p')},{f:.4f}"),
    truth=FORCE_ALONE,
)
add_odd(
    "clock_only_ms.csv",
    "Uhrzeit\tKraft[N]",
    *each(lambda t, f, x: f"{at(t).strftime('%H:%M:%S,%f')[:-3]}\t{f:.4f}".replace(".", ",")),
    truth=FORCE_ALONE,
)
add_odd(
    "clock_sec_ms.csv",
    "Time,Millis,Force (N)",
    *each(lambda t, f, x: f"{at(t).strftime('%H:%M:%S')},{round(t * 1000) % 1000},{f:.4f}"),
    truth=FORCE_ALONE,
)
add_odd("sample_rate_hdr.csv", "Sample Rate: 200 Hz", "", "Force [N],Displacement [mm]", *table([F, X]))
add_odd(
    "rate_hash.csv", "# fs = 200", "# channels: force (N), position (mm)", "force_N;position_mm", *table([F, X], ";")
)
add_odd("abtast.csv", "Abtastrate;200 Hz", "Kraft [N];Weg [mm]", *table([F, X], ";", ","))
add_odd("dt.csv", "dt;0,005 s", "Kraft [N];Weg [mm]", *table([F, X], ";", ","))
add_odd(
    "index_rate.csv",
    "Sampling interval (ms): 5",
    "Sample,Force (N),Position (mm)",
    *each(lambda k, r: f"{k},{r}", COUNT, table([F, X])),
)
add_odd("neg_pull.csv", "Time (s),Force (N),Position (mm)", *table([T, (-FORCE, "%.5f"), X]))
add_odd(
    "offset.csv", "Time (s),Force (N),Position (mm)", *table([T, (FORCE + 2.5, "%.5f"), X]), truth=(Truth(peak_N=5.63),)
)
add_odd(
    "six.csv",
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
    truth=FORCE_ALONE,
    asks=1,
)
add_odd(
    "six_units.csv",
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
    truth=FORCE_ALONE,
    asks=1,
)
add_odd("pose.csv", "t_s,fx_N,x_mm,y_mm,z_mm", *table([T, F, X, (0 * WAY, "%.3f"), (0 * WAY + 5, "%.3f")]))
add(
    "sto.sto",
    ": OpenSim",
    "Force",
    "version=1",
    "nRows=1361",
    "nColumns=3",
    "inDegrees=no",
    "endheader",
    "time\tground_force_vx\tpos_x",
    *table([T, F, (WAY / 1e3, "%.6f")], "\t"),
    asks=1,
)
add_odd(
    "tdms_txt.txt",
    "Root Name\tTitle",
    "cut\t",
    "",
    "Group\tChannel",
    "",
    "Time*\tForce*",
    "s\tN",
    *table([T, F], "\t"),
    truth=FORCE_ALONE,
)
add_odd(
    "markdown.md",
    "| t [s] | F [N] | x [mm] |",
    "| --- | --- | --- |",
    *each(lambda r: f"| {r} |", table([T, F, X], " | ")),
)
add_odd("jsonarr.txt", *each(lambda r: f"[{r}]", table([T, F, X], ", ")), asks=1)
add_odd("py_log.txt", *each(lambda t, f, x: f"INFO: time={t:.3f} force={f:.4f} pos={x:.3f}"), asks=1)
add_odd(
    "dewesoft.txt",
    "Data1",
    "",
    "Start time: 3/2/2026 10:11:12.000",
    "Sample rate: 200.0 Hz",
    "",
    "Time (s)\tForce (N)\tPosition (mm)",
    "s\tN\tmm",
    *table([T, F, X], "\t"),
)
add_odd(
    "itx.itx",
    "IGOR",
    "WAVES/D\ttime_s\tforce_N",
    "BEGIN",
    *each(lambda r: f"\t{r}", table([T, F], "\t")),
    "END",
    'X SetScale/P x 0,1,"", time_s',
    truth=FORCE_ALONE,
)
add_odd(
    "octave.txt",
    "# Created by Octave 8.4",
    "# name: data",
    "# type: matrix",
    "# rows: 1361",
    "# columns: 3",
    *each(lambda r: f" {r}", table([T, F, (WAY / 1e3, "%.6f")], " ")),
    "",
    "",
    asks=1,
)
add_odd(
    "nan_pos.csv",
    "t [s],F [N],x [mm]",
    *each(lambda k, t, f, x: f"{t:.4f},{f:.5f},{x if k % 5 == 0 else float('nan')}", COUNT, TIME, FORCE, WAY),
)
add_odd(
    "text_col.csv",
    "t [s],state,F [N],x [mm]",
    *each(lambda t, f, x: f"{t:.4f},{'cut' if 1 < t < 5 else 'idle'},{f:.5f},{x:.4f}"),
)
add_odd(
    "trial_col.csv",
    "trial,t [s],F [N],x [mm]",
    *each(lambda r: f"1,{r}", STANDARD),
    *each(lambda r: f"2,{r}", table([T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")])),
    truth=TWO,
)
add_odd(
    "hdr_repeat_time0.csv",
    "t [s],F [N],x [mm]",
    *STANDARD,
    "",
    "t [s],F [N],x [mm]",
    *table([T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")]),
    truth=TWO,
    left_out=1,
)
add_odd(
    "dup_time.csv",
    "t [s],F [N],x [mm]",
    *(r for k, row in enumerate(STANDARD) for r in ([row, row] if k in (5, 600) else [row])),
    left_out=2,
)
add_odd("late.csv", "t [s],F [N],x [mm]", *STANDARD[:600], STANDARD[601], STANDARD[600], *STANDARD[602:])
add_odd(
    "trigger0.csv",
    ",time,Fx,Fy",
    *(f"{k},0.0,{f:.4f},0.0" for k, f in enumerate(FORCE[:6])),
    *each(lambda k, t, f: f"{k + 6},{t + 0.005:.4f},{f:.4f},0.0", COUNT, TIME, FORCE),
    truth=FORCE_ALONE,
    asks=1,
    left_out=5,
)
add_odd(
    "excel_time_frac.csv",
    "Time;Force [N]",
    *each(lambda t, f, x: f"{0.4244444 + t / 86400:.12f};{f:.4f}".replace(".", ",")),
    truth=FORCE_ALONE,
)
add_odd(
    "degC.csv",
    "Time (s),Temp (\u00b0C),Force (N),Position (mm)",
    *table([T, (0 * TIME + 21.3, "%.1f"), F, X]),
    encoding="cp1252",
)
add_odd(
    "stress_first.csv",
    "Time (s),Stress (MPa),Strain (%),Load (N),Stroke (mm)",
    *table([T, (FORCE / 5, "%.4f"), (WAY / 3, "%.4f"), F, X]),
)
add_odd(
    "two_loads.csv",
    "Time (s),Load (N),Peak Load (N),Position (mm)",
    *table([T, F, (np.maximum.accumulate(FORCE), "%.5f"), X]),
)
add_odd("cmd_pos.csv", "time_s,force_N,commanded_position_mm,position_mm", *table([T, F, (WAY + 0.1, "%.4f"), X]))
add_odd(
    "speed_first.csv",
    "Time [s];Speed [mm/min];Force [N];Travel [mm]",
    *table([T, (0 * TIME + 450, "%.1f"), F, X], ";", ","),
)
add_odd("utf8bom.csv", "\ufeffTime (s),Force (N),Position (mm)", *STANDARD)
add_odd("mac.csv", "Time (s),Force (N),Position (mm)", *STANDARD, newline="\r")
add_odd("spaces_sep.csv", "Time (s), Force (N), Position (mm)", *each(lambda r: r.replace(",", ", "), STANDARD))
add_odd(
    "fixed.txt",
    "      time     force  position",
    "        s         N        mm",
    *table([(TIME, "%10.4f"), (FORCE, "%10.5f"), (WAY, "%10.4f")], ""),
)
add_odd("winwedge.txt", *each(lambda t, f, x: f"{t:8.3f} s  {f:+.3f} N"), truth=FORCE_ALONE, asks=0)
add_odd("gauge.txt", *each(lambda t, f, x: f"{at(t).strftime('%H:%M:%S.%f')[:-3]}, {f:+.3f} N"), truth=FORCE_ALONE)
add_odd("kN_small.csv", "Time;Force;Position", "[s];[kN];[mm]", *table([T, (FORCE / 1e3, "%.7f"), X], ";", ","))
add_odd(
    "units_below_paren.csv",
    "Time,Load,Position",
    "(sec),(lbf),(in)",
    *table([T, (FORCE / 4.4482216, "%.6f"), (WAY / 25.4, "%.6f")]),
)
add_odd("time_named_units.csv", "Elapsed seconds,Force newtons,Travel millimeters", *STANDARD)
add_odd("dash_name.csv", "time-s,force-N,position-mm", *STANDARD)
add_odd("camel.csv", "timeMs,forceMn,positionMm", *table([(1e3 * TIME, "%d"), MILLINEWTONS, X]), asks=1)
add_odd("kraft_sensor.csv", "Zeit;Kraftsensor 1;Wegsensor", "s;N;mm", *table([T, F, X], ";", ","))
add_odd("fr.csv", "Temps (s);Force (N);D\u00e9placement (mm)", *table([T, F, X], ";", ","), encoding="cp1252")
add_odd("jp.csv", "\u6642\u9593(s),\u8377\u91cd(N),\u5909\u4f4d(mm)", *STANDARD)
add_odd("cn_gbk.csv", "\u65f6\u95f4(s),\u529b(N),\u4f4d\u79fb(mm)", *STANDARD, encoding="gbk")
