"""Headers that mislead, clocks that hide their digits, blocks and spikes: what a hurried reader gets wrong."""

from __future__ import annotations

import numpy as np
from lab_cut import (
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
    add,
    at,
    table,
)

add(
    "volt_and_n.csv",
    "people and programs",
    "volt and n",
    ["Time (s),Ch1 (V),Ch2 (N)", *table([T, (FORCE * 2, "%.4f"), F])],
    truth=FORCE_ALONE,
)
add("mm_force_named.csv", "people and programs", "mm force named", ["Time (s),Load (mm),Pos (N)", *table([T, X, F])])
add(
    "unit_row_unknown.csv",
    "people and programs",
    "unit row unknown",
    ["Time,Load,Ext", "s,zork,mm", *table([T, F, X])],
    asks=1,
    readable=False,
)
add(
    "meganewton.csv",
    "people and programs",
    "meganewton",
    ["Time [s],Force [MN],x [mm]", *table([T, (FORCE / 1e6, "%.10f"), X])],
    asks=1,
    readable=False,
)
add(
    "dyn.csv",
    "people and programs",
    "dyn",
    ["Time [s],Force [dyn],x [mm]", *table([T, (FORCE * 1e5, "%.1f"), X])],
    asks=1,
    readable=False,
)
add(
    "min_sec.csv",
    "people and programs",
    "min sec",
    ["Time,Force (N)", *(f"{int(t // 60):02d}:{t % 60:06.3f},{f:.4f}" for t, f in zip(TIME + 58, FORCE, strict=True))],
    truth=FORCE_ALONE,
)
add(
    "hms_nofrac.csv",
    "people and programs",
    "hms nofrac",
    ["Time,Force (N)", *(f"10:11:{12 + int(t):02d},{f:.4f}" for t, f in zip(TIME, FORCE, strict=True))],
    truth=FORCE_ALONE,
)
add(
    "unpadded_ms.csv",
    "people and programs",
    "unpadded ms",
    [
        "Time,Force (N)",
        *(f"10:11:{12 + int(t)}:{round(t * 1000) % 1000},{f:.4f}" for t, f in zip(TIME, FORCE, strict=True)),
    ],
    truth=FORCE_ALONE,
)
add(
    "spikes3.csv",
    "people and programs",
    "spikes3",
    [
        "t [s],F [N],x [mm]",
        *(
            r if k not in (100, 500, 900) else f"{TIME[k]:.4f},{[-8388.608, 8388.607, 99.9][k // 400]},{WAY[k]:.4f}"
            for k, r in enumerate(STANDARD)
        ),
    ],
    left_out=3,
)
add(
    "pos_spike.csv",
    "people and programs",
    "pos spike",
    [
        "t [s],F [N],x [mm]",
        *(r if k != 500 else f"{TIME[k]:.4f},{FORCE[k]:.4f},6553.5" for k, r in enumerate(STANDARD)),
    ],
    left_out=1,
)
add("x_neg.csv", "people and programs", "x neg", ["t [s],F [N],x [mm]", *table([T, F, (-WAY, "%.4f")])])
add(
    "zero_x.csv",
    "people and programs",
    "zero x",
    ["t [s],F [N],x [mm]", *table([T, F, (0 * WAY, "%.4f")])],
    truth=FORCE_ALONE,
)
add(
    "fwd_back.csv",
    "people and programs",
    "fwd back",
    [
        "t [s],F [N],x [mm]",
        *table([T, F, (np.concatenate([WAY[:1000], WAY[1000] * np.linspace(1, 0.2, N - 1000)]), "%.4f")]),
    ],
)
add(
    "three_spec.csv",
    "people and programs",
    "three spec",
    [
        "Time (s),Load (N),Ext (mm),Time (s),Load (N),Ext (mm),Time (s),Load (N),Ext (mm)",
        *table([T, F, X, T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f"), T, F, X]),
    ],
    truth=TWO + ONE,
)
add(
    "pandas_dup.csv",
    "people and programs",
    "pandas dup",
    ["time,force,pos,time.1,force.1,pos.1", *table([T, F, X, T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")])],
    truth=TWO,
    asks=1,
)
add(
    "shared_time.csv",
    "people and programs",
    "shared time",
    ["Time (s),Force 1 (N),Force 2 (N)", *table([T, F, (OTHER_FORCE, "%.5f")])],
    truth=FORCE_ALONE,
    asks=1,
)
add(
    "uneven.csv",
    "people and programs",
    "uneven",
    ["t [s],F [N]", *(f"{t + 0.001 * (k % 3):.4f},{f:.4f}" for k, (t, f) in enumerate(zip(TIME, FORCE, strict=True)))],
    truth=FORCE_ALONE,
)
add(
    "gap.csv",
    "people and programs",
    "gap",
    ["t [s],F [N]", *(r for k, r in enumerate(table([T, F])) if not 600 < k < 640)],
    truth=FORCE_ALONE,
)
add(
    "blank_rows.csv",
    "people and programs",
    "blank rows",
    ["t [s],F [N]", *(r for k, row in enumerate(table([T, F])) for r in (row, ""))],
    truth=FORCE_ALONE,
)
add(
    "comments_in.csv",
    "people and programs",
    "comments in",
    ["t [s],F [N]", *(r for k, row in enumerate(table([T, F])) for r in ((row, "# note 5") if k == 50 else (row,)))],
    truth=FORCE_ALONE,
)
add(
    "semi_decimal_mixed.csv",
    "people and programs",
    "semi decimal mixed",
    [
        "t [s];F [N];x [mm]",
        *(f"{t:.3f};{f:.4f};{x:.3f}".replace(".", ",") for t, f, x in zip(TIME, FORCE, WAY, strict=True)),
    ],
)
add(
    "ints.csv",
    "people and programs",
    "ints",
    [
        "t_ms;F_mN;x_um",
        *(f"{1e3 * t:.0f};{1e3 * f:.0f};{1e3 * x:.0f}" for t, f, x in zip(TIME, FORCE, WAY, strict=True)),
    ],
)
add(
    "labchart2.txt",
    "people and programs",
    "labchart2",
    [
        "Interval=\t5 ms",
        "ExcelDateTime=\t4.6e+004",
        "TimeFormat=\tTimeOfDay",
        "ChannelTitle=\tKraft\tWeg",
        "Range=\t1 V\t1 V",
        "UnitName=\tN\tmm",
        *(f"10:11:{12 + t:.3f}\t{f:.4f}\t{x:.3f}".replace(".", ",") for t, f, x in zip(TIME, FORCE, WAY, strict=True)),
    ],
)
add(
    "lab2blocks.txt",
    "people and programs",
    "lab2blocks",
    [
        "Interval=\t0.005 s",
        "ChannelTitle=\tForce\tPosition",
        "UnitName=\tN\tmm",
        *table([T, F, X], "\t"),
        "",
        "Interval=\t0.005 s",
        "ChannelTitle=\tForce\tPosition",
        "UnitName=\tN\tmm",
        *table([T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")], "\t"),
    ],
    truth=TWO,
)
add(
    "biopac_hz.txt",
    "people and programs",
    "biopac hz",
    ["test.acq", "200 samples/second", "1 channels", "Force", "grams", "sec\tCH1", f"\t{N}", *table([T, GRAMS], "\t")],
    truth=FORCE_ALONE,
)
add(
    "bluehill_res.csv",
    "people and programs",
    "bluehill res",
    [
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
    ],
)
add(
    "tx_multi.txt",
    "people and programs",
    "tx multi",
    [
        "Pr\u00fcfung 1",
        "Zeit;Kraft;Weg",
        "s;N;mm",
        *table([T, F, X], ";", ","),
        "",
        "Pr\u00fcfung 2",
        "Zeit;Kraft;Weg",
        "s;N;mm",
        *table([T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")], ";", ","),
    ],
    truth=TWO,
    left_out=3,
    encoding="cp1252",
)
add(
    "mark10.csv",
    "people and programs",
    "mark10",
    ["Mark-10 data", "Load [N];Position [mm];Time [s]".replace(";", ","), *table([F, X, T])],
)
add(
    "index_time.csv",
    "people and programs",
    "index time",
    ["Index,Time,Force", *(f"{k},{r}" for k, r in enumerate(table([T, F])))],
    truth=FORCE_ALONE,
    asks=1,
)
add(
    "sample_only.csv",
    "people and programs",
    "sample only",
    ["sample,force_N", *(f"{k},{f:.4f}" for k, f in enumerate(FORCE))],
    asks=1,
    readable=False,
)
add(
    "ms_int_noname.csv",
    "people and programs",
    "ms int noname",
    ["time,force_N", *(f"{5 * k},{f:.4f}" for k, f in enumerate(FORCE))],
    truth=FORCE_ALONE,
)
add(
    "time_1ms_546.csv",
    "people and programs",
    "time 1ms 546",
    [*(f"{f:.4f},{0.2:.1f},{np.floor(k / 546 * 1000) / 1000:.3f}" for k, f in enumerate(FORCE))],
    truth=(Truth(duration_s=(N - 1) / 546, travel_mm=None),),
    asks=1,
)
add(
    "quoted_semicolon.csv",
    "people and programs",
    "quoted semicolon",
    [
        '"Zeit [s]";"Kraft [N]";"Weg [mm]"',
        *(";".join(f'"{c}"' for c in r.split(";")) for r in table([T, F, X], ";", ",")),
    ],
)
add(
    "ft_temp.csv",
    "people and programs",
    "ft temp",
    [
        "Time (s),Force (N),Temperature (C),Humidity (%),Position (mm)",
        *table([T, F, (0 * TIME + 22, "%.1f"), (0 * TIME + 40, "%.1f"), X]),
    ],
)
add(
    "depth_too.csv",
    "people and programs",
    "depth too",
    [
        "Time (s),Force (N),Position (mm),Depth (mm),Angle (deg)",
        *table([T, F, X, (0 * TIME + 20, "%.1f"), (0 * TIME + 90, "%.1f")]),
    ],
)
add(
    "iso_tz_named.csv",
    "people and programs",
    "iso tz named",
    [
        "time,F [N]",
        *(f"{at(t).isoformat(timespec='milliseconds')}+00:00[UTC],{f:.4f}" for t, f in zip(TIME, FORCE, strict=True)),
    ],
    truth=FORCE_ALONE,
)
add(
    "am_pm_space.csv",
    "people and programs",
    "am pm space",
    ["time,F [N]", *(f"{at(t).strftime('%I:%M:%S.%f')[:-3]} a.m.,{f:.4f}" for t, f in zip(TIME, FORCE, strict=True))],
    truth=FORCE_ALONE,
)
add(
    "ctime.csv",
    "people and programs",
    "ctime",
    [
        "time,F [N]",
        *(f"Mon Mar  2 {at(t).strftime('%H:%M:%S.%f')} 2026,{f:.4f}" for t, f in zip(TIME, FORCE, strict=True)),
    ],
    truth=FORCE_ALONE,
)
add(
    "dash_missing.csv",
    "people and programs",
    "dash missing",
    ["t [s],F [N],x [mm]", *(r if k % 200 else f"{TIME[k]:.4f},---,{WAY[k]:.4f}" for k, r in enumerate(STANDARD))],
    left_out=7,
)
add(
    "lvm_clock.txt",
    "people and programs",
    "lvm clock",
    [
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
        *(f"{3855291072 + t:.6f}\t{f:.5f}" for t, f in zip(TIME, FORCE, strict=True)),
    ],
    truth=FORCE_ALONE,
)
add("tdms_excel.csv", "people and programs", "tdms excel", ["Time,Untitled 1,Untitled 2", *table([T, F, X])], asks=1)
