"""Headers that mislead, clocks that hide their digits, blocks and spikes: what a hurried reader gets wrong."""

from __future__ import annotations

import numpy as np
from lab_cut import (
    COUNT,
    FORCE,
    FORCE_ALONE,
    GRAMS,
    ONE,
    OTHER_FORCE,
    OTHER_WAY,
    STANDARD,
    TIME,
    TWO,
    WAY,
    F,
    N,
    T,
    Truth,
    X,
    add_odd,
    at,
    each,
    table,
)

add_odd("volt_and_n.csv", "Time (s),Ch1 (V),Ch2 (N)", *table([T, (FORCE * 2, "%.4f"), F]), truth=FORCE_ALONE)
add_odd("mm_force_named.csv", "Time (s),Load (mm),Pos (N)", *table([T, X, F]))
add_odd("unit_row_unknown.csv", "Time,Load,Ext", "s,zork,mm", *table([T, F, X]), asks=1, readable=False)
add_odd("meganewton.csv", "Time [s],Force [MN],x [mm]", *table([T, (FORCE / 1e6, "%.10f"), X]), asks=1, readable=False)
add_odd("dyn.csv", "Time [s],Force [dyn],x [mm]", *table([T, (FORCE * 1e5, "%.1f"), X]), asks=1, readable=False)
add_odd(
    "min_sec.csv",
    "Time,Force (N)",
    *each(lambda t, f: f"{int(t // 60):02d}:{t % 60:06.3f},{f:.4f}", TIME + 58, FORCE),
    truth=FORCE_ALONE,
)
add_odd(
    "hms_nofrac.csv", "Time,Force (N)", *each(lambda t, f, x: f"10:11:{12 + int(t):02d},{f:.4f}"), truth=FORCE_ALONE
)
add_odd(
    "unpadded_ms.csv",
    "Time,Force (N)",
    *each(lambda t, f, x: f"10:11:{12 + int(t)}:{round(t * 1000) % 1000},{f:.4f}"),
    truth=FORCE_ALONE,
)
add_odd(
    "spikes3.csv",
    "t [s],F [N],x [mm]",
    *each(
        lambda k, r: (
            r if k not in (100, 500, 900) else f"{TIME[k]:.4f},{[-8388.608, 8388.607, 99.9][k // 400]},{WAY[k]:.4f}"
        ),
        COUNT,
        STANDARD,
    ),
    left_out=3,
)
add_odd(
    "pos_spike.csv",
    "t [s],F [N],x [mm]",
    *each(lambda k, r: r if k != 500 else f"{TIME[k]:.4f},{FORCE[k]:.4f},6553.5", COUNT, STANDARD),
    left_out=1,
)
add_odd("x_neg.csv", "t [s],F [N],x [mm]", *table([T, F, (-WAY, "%.4f")]))
add_odd("zero_x.csv", "t [s],F [N],x [mm]", *table([T, F, (0 * WAY, "%.4f")]), truth=FORCE_ALONE)
add_odd(
    "fwd_back.csv",
    "t [s],F [N],x [mm]",
    *table([T, F, (np.concatenate([WAY[:1000], WAY[1000] * np.linspace(1, 0.2, N - 1000)]), "%.4f")]),
)
add_odd(
    "three_spec.csv",
    "Time (s),Load (N),Ext (mm),Time (s),Load (N),Ext (mm),Time (s),Load (N),Ext (mm)",
    *table([T, F, X, T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f"), T, F, X]),
    truth=TWO + ONE,
)
add_odd(
    "pandas_dup.csv",
    "time,force,pos,time.1,force.1,pos.1",
    *table([T, F, X, T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")]),
    truth=TWO,
    asks=1,
)
add_odd(
    "shared_time.csv",
    "Time (s),Force 1 (N),Force 2 (N)",
    *table([T, F, (OTHER_FORCE, "%.5f")]),
    truth=FORCE_ALONE,
    asks=1,
)
add_odd(
    "uneven.csv",
    "t [s],F [N]",
    *each(lambda k, t, f: f"{t + 0.001 * (k % 3):.4f},{f:.4f}", COUNT, TIME, FORCE),
    truth=FORCE_ALONE,
)
add_odd("gap.csv", "t [s],F [N]", *(r for k, r in enumerate(table([T, F])) if not 600 < k < 640), truth=FORCE_ALONE)
add_odd(
    "blank_rows.csv", "t [s],F [N]", *(r for k, row in enumerate(table([T, F])) for r in (row, "")), truth=FORCE_ALONE
)
add_odd(
    "comments_in.csv",
    "t [s],F [N]",
    *(r for k, row in enumerate(table([T, F])) for r in ((row, "# note 5") if k == 50 else (row,))),
    truth=FORCE_ALONE,
)
add_odd(
    "semi_decimal_mixed.csv", "t [s];F [N];x [mm]", *each(lambda t, f, x: f"{t:.3f};{f:.4f};{x:.3f}".replace(".", ","))
)
add_odd("ints.csv", "t_ms;F_mN;x_um", *each(lambda t, f, x: f"{1e3 * t:.0f};{1e3 * f:.0f};{1e3 * x:.0f}"))
add_odd(
    "labchart2.txt",
    "Interval=\t5 ms",
    "ExcelDateTime=\t4.6e+004",
    "TimeFormat=\tTimeOfDay",
    "ChannelTitle=\tKraft\tWeg",
    "Range=\t1 V\t1 V",
    "UnitName=\tN\tmm",
    *each(lambda t, f, x: f"10:11:{12 + t:.3f}\t{f:.4f}\t{x:.3f}".replace(".", ",")),
)
add_odd(
    "lab2blocks.txt",
    "Interval=\t0.005 s",
    "ChannelTitle=\tForce\tPosition",
    "UnitName=\tN\tmm",
    *table([T, F, X], "\t"),
    "",
    "Interval=\t0.005 s",
    "ChannelTitle=\tForce\tPosition",
    "UnitName=\tN\tmm",
    *table([T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")], "\t"),
    truth=TWO,
)
add_odd(
    "biopac_hz.txt",
    "test.acq",
    "200 samples/second",
    "1 channels",
    "Force",
    "grams",
    "sec\tCH1",
    f"\t{N}",
    *table([T, GRAMS], "\t"),
    truth=FORCE_ALONE,
)
add_odd(
    "bluehill_res.csv",
    "Results Table 1",
    ",Maximum Load,Extension at max",
    "(unit),(N),(mm)",
    '1,"3.13","25.0"',
    'Mean,"3.13","25.0"',
    "",
    "Specimen,1",
    "Time,Extension,Load",
    "(s),(mm),(N)",
    *table([T, X, F], quote='"'),
)
add_odd(
    "tx_multi.txt",
    "Pr\u00fcfung 1",
    "Zeit;Kraft;Weg",
    "s;N;mm",
    *table([T, F, X], ";", ","),
    "",
    "Pr\u00fcfung 2",
    "Zeit;Kraft;Weg",
    "s;N;mm",
    *table([T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")], ";", ","),
    truth=TWO,
    left_out=3,
    encoding="cp1252",
)
add_odd("mark10.csv", "Mark-10 data", "Load [N];Position [mm];Time [s]".replace(";", ","), *table([F, X, T]))
add_odd(
    "index_time.csv",
    "Index,Time,Force",
    *each(lambda k, r: f"{k},{r}", COUNT, table([T, F])),
    truth=FORCE_ALONE,
    asks=1,
)
add_odd("sample_only.csv", "sample,force_N", *each(lambda k, f: f"{k},{f:.4f}", COUNT, FORCE), asks=1, readable=False)
add_odd("ms_int_noname.csv", "time,force_N", *each(lambda k, f: f"{5 * k},{f:.4f}", COUNT, FORCE), truth=FORCE_ALONE)
add_odd(
    "time_1ms_546.csv",
    *each(lambda k, f: f"{f:.4f},{0.2:.1f},{np.floor(k / 546 * 1000) / 1000:.3f}", COUNT, FORCE),
    truth=(Truth(duration_s=(N - 1) / 546, travel_mm=None),),
    asks=1,
)
add_odd(
    "quoted_semicolon.csv",
    '"Zeit [s]";"Kraft [N]";"Weg [mm]"',
    *each(lambda r: ";".join(f'"{c}"' for c in r.split(";")), table([T, F, X], ";", ",")),
)
add_odd(
    "ft_temp.csv",
    "Time (s),Force (N),Temperature (C),Humidity (%),Position (mm)",
    *table([T, F, (0 * TIME + 22, "%.1f"), (0 * TIME + 40, "%.1f"), X]),
)
add_odd(
    "depth_too.csv",
    "Time (s),Force (N),Position (mm),Depth (mm),Angle (deg)",
    *table([T, F, X, (0 * TIME + 20, "%.1f"), (0 * TIME + 90, "%.1f")]),
)
add_odd(
    "iso_tz_named.csv",
    "time,F [N]",
    *each(lambda t, f, x: f"{at(t).isoformat(timespec='milliseconds')}+00:00[UTC],{f:.4f}"),
    truth=FORCE_ALONE,
)
add_odd(
    "am_pm_space.csv",
    "time,F [N]",
    *each(lambda t, f, x: f"{at(t).strftime('%I:%M:%S.%f')[:-3]} a.m.,{f:.4f}"),
    truth=FORCE_ALONE,
)
add_odd(
    "ctime.csv",
    "time,F [N]",
    *each(lambda t, f, x: f"Mon Mar  2 {at(t).strftime('%H:%M:%S.%f')} 2026,{f:.4f}"),
    truth=FORCE_ALONE,
)
add_odd(
    "dash_missing.csv",
    "t [s],F [N],x [mm]",
    *each(lambda k, r: r if k % 200 else f"{TIME[k]:.4f},---,{WAY[k]:.4f}", COUNT, STANDARD),
    left_out=7,
)
add_odd(
    "lvm_clock.txt",
    "LabVIEW Measurement\t",
    "Separator\tTab",
    "Decimal_Separator\t.",
    "X_Columns\tOne",
    "Time_Pref\tAbsolute",
    "***End_of_Header***\t",
    "",
    "Channels\t1",
    "Samples\t1361",
    "Y_Unit_Label\tNewtons",
    "X_Dimension\tTime",
    "X0\t3.8E9",
    "Delta_X\t0.005",
    "***End_of_Header***",
    "X_Value\tUntitled\tComment",
    *each(lambda t, f, x: f"{3855291072 + t:.6f}\t{f:.5f}"),
    truth=FORCE_ALONE,
)
add_odd("tdms_excel.csv", "Time,Untitled 1,Untitled 2", *table([T, F, X]), asks=1)
