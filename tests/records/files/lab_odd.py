"""Files of people and programs of many kinds: odd spellings, misleading headers, clocks, damage."""

from __future__ import annotations

import datetime
import struct
from collections.abc import Callable

import numpy as np
from lab_cut import (
    COUNT,
    EPOCH,
    FORCE,
    FORCE_ALONE,
    GRAMS,
    MICRO_X,
    MILLINEWTONS,
    ONE,
    OTHER_F,
    OTHER_X,
    STANDARD,
    START,
    TIME,
    TWO,
    WAY,
    F,
    N,
    T,
    Truth,
    X,
    add,
    add_odd,
    at,
    each,
    table,
)

# Clocks of every kind, damaged files, and files that leave open what nobody can guess.


# Clocks.
def _clock(form: Callable[[datetime.datetime], str], start: datetime.datetime = START) -> list[str]:
    return [
        f"{form(start + datetime.timedelta(seconds=float(t)))},{row}"
        for t, row in zip(TIME, table([F, X]), strict=True)
    ]


add(
    "epoch_ms.csv",
    "loggers: milliseconds since 1970",
    "ts,force (N),position (mm)",
    *each(lambda t, row: f"{EPOCH * 1000 + round(1e3 * t)},{row}", TIME, table([F, X])),
)
add(
    "epoch_us.csv",
    "loggers: microseconds since 1970",
    "timestamp,force (N),position (mm)",
    *each(lambda t, row: f"{EPOCH * 10**6 + round(1e6 * t)},{row}", TIME, table([F, X])),
)
add(
    "epoch_s.csv",
    "loggers: seconds since 1970",
    "timestamp,force (N),position (mm)",
    *each(lambda t, row: f"{EPOCH + t:.4f},{row}", TIME, table([F, X])),
)
add(
    "epoch_float32.csv",
    "loggers: seconds since 1970 in 32 bits, which lose them",
    "timestamp,force (N),position (mm)",
    *each(lambda t, row: f"{struct.unpack('f', struct.pack('f', EPOCH + t))[0]:.0f},{row}", TIME, table([F, X])),
    asks=1,
    readable=False,
)
add(
    "two_columns.csv",
    "loggers: date and time in two columns",
    "Date,Time,Force (N),Position (mm)",
    *_clock(lambda at: at.strftime("%d.%m.%Y,%H:%M:%S.%f")[:-3]),
)
add(
    "half_day.csv",
    "loggers: AM and PM, past noon",
    "Time,Force (N),Position (mm)",
    *_clock(lambda at: at.strftime("%I:%M:%S.%f")[:-3] + at.strftime(" %p"), datetime.datetime(2026, 3, 2, 11, 59, 57)),
)
add(
    "midnight.csv",
    "loggers: a clock past midnight",
    "Time,Force (N),Position (mm)",
    *_clock(lambda at: at.strftime("%H:%M:%S.%f")[:-3], datetime.datetime(2026, 3, 2, 23, 59, 57)),
)
add(
    "summer_time.csv",
    "loggers: local time at the change to winter",
    "Time,Force (N),Position (mm)",
    *_clock(
        lambda at: (at - datetime.timedelta(hours=at.hour >= 3)).strftime("%Y-%m-%d %H:%M:%S.%f")[:-3],
        datetime.datetime(2026, 10, 25, 2, 59, 57),
    ),
)
add(
    "coarse.csv",
    "loggers: times in steps of 0.05 s",
    "t (s),F (N),x (mm)",
    *table([(np.floor(TIME * 20 + 1e-9) / 20, "%.2f"), F, X]),
)
add("time_last.csv", "loggers: no header, time in the last column", *table([F, T]), truth=FORCE_ALONE, asks=1)
add("hours.csv", "loggers: hours", "time [h],force [N],position [mm]", *table([(TIME / 3600, "%.9f"), F, X]))
# Damage.
add(
    "footer.csv",
    "loggers: a summary below the table",
    "t [s],F [N],x [mm]",
    *STANDARD,
    "",
    "Maximum,3.130,30.0",
    "Mean,1.107,",
    left_out=2,
)
add(
    "cut_off.csv",
    "loggers: killed in the last line",
    "t [s],F [N],x [mm]",
    *STANDARD[:-1],
    "6.800,0.0",
    left_out=1,
    truth=(Truth(duration_s=float(TIME[-2])),),
    ended=False,
)
add(
    "restarted.csv",
    "loggers: header repeated after a restart, time goes on",
    "t [s],F [N],x [mm]",
    *STANDARD[:500],
    "t [s],F [N],x [mm]",
    *STANDARD[500:],
    left_out=1,
)
add(
    "overload.csv",
    "loggers: OL and nan among the numbers",
    "t [s],F [N],x [mm]",
    *each(
        lambda k, row: row if k not in (90, 91, 1300) else f"{TIME[k]:.4f},{'nan' if k == 90 else 'OL'},{WAY[k]:.4f}",
        COUNT,
        STANDARD,
    ),
    left_out=3,
)
add(
    "reversed.csv",
    "stages: the way counts toward the clamp",
    "t [s],F [N],x [mm]",
    *table([T, F, (80.0 - WAY, "%.4f")]),
)
add(
    "absolute.csv",
    "stages: an absolute position far from its zero",
    "t [s],F [N],x [mm]",
    *table([T, F, (812.0 + WAY, "%.4f")]),
)
add(
    "two_clocks.csv",
    "loggers: two records, the clock starts again",
    "t [s],F [N],x [mm]",
    *STANDARD,
    *table([T, OTHER_F, OTHER_X]),
    truth=TWO,
)
add(
    "wrong_unit.csv",
    "loggers: the header says ms, the numbers are seconds",
    "t [ms],F [N]",
    *table([T, F]),
    asks=1,
    readable=False,
)
add("volts.csv", "loggers: volts of an amplifier", "Time (s),Force (V)", *table([T, F]), asks=1, readable=False)
add(
    "unknown_unit.csv",
    "loggers: a unit that nobody knows",
    "Time (s),Force (zork)",
    *table([T, F]),
    asks=1,
    readable=False,
)
add("no_time.csv", "loggers: neither time nor rate", "force [N],position [mm]", *table([F, X]), asks=1, readable=False)

# Headers that mislead, clocks that hide their digits, blocks and spikes: what a hurried reader gets wrong.

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
    *table([T, F, X, T, OTHER_F, OTHER_X, T, F, X]),
    truth=TWO + ONE,
)
add_odd(
    "pandas_dup.csv", "time,force,pos,time.1,force.1,pos.1", *table([T, F, X, T, OTHER_F, OTHER_X]), truth=TWO, asks=1
)
add_odd("shared_time.csv", "Time (s),Force 1 (N),Force 2 (N)", *table([T, F, OTHER_F]), truth=FORCE_ALONE, asks=1)
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
    *table([T, OTHER_F, OTHER_X], "\t"),
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
    *table([T, OTHER_F, OTHER_X], ";", ","),
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

# Spellings of headers, units, signs and times that programs and people use, one in each file.

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
    *each(lambda r: f"2,{r}", table([T, OTHER_F, OTHER_X])),
    truth=TWO,
)
add_odd(
    "hdr_repeat_time0.csv",
    "t [s],F [N],x [mm]",
    *STANDARD,
    "",
    "t [s],F [N],x [mm]",
    *table([T, OTHER_F, OTHER_X]),
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
