"""Loggers, robots and programs of numbers: serial monitors, ROS, JSON, pandas, Excel, MATLAB, R."""

from __future__ import annotations

import json

from lab_cut import (
    COUNT,
    EPOCH,
    FORCE,
    FORCE_ALONE,
    GRAMS,
    MICRO_X,
    MILLINEWTONS,
    STANDARD,
    TIME,
    WAY,
    F,
    T,
    X,
    add,
    at,
    clock_time,
    each,
    table,
)

# Arduino: serial monitor and loggers.
add(
    "serial_monitor.txt",
    "Arduino serial monitor: clock and arrow in front of the numbers",
    *each(lambda t, row: f"{clock_time(t)} -> {row}", TIME, table([F, X])),
    asks=1,
)
add(
    "serial_pairs.txt",
    "Arduino serial monitor: clock, arrow, keys and values",
    *each(lambda t, f, x: f"{clock_time(t)} -> Force:{f:.4f} Position:{x:.3f}"),
    asks=1,
)
add(
    "key_value.txt",
    "Arduino serial plotter: keys and values",
    *each(lambda t, f, x: f"t:{t:.3f},F:{f:.4f},x:{x:.3f}"),
    asks=1,
)
add(
    "key_unit.log",
    "loggers: keys, values and units in every line",
    *each(lambda t, f, x: f"time={1e3 * t:.0f} ms; force={1e3 * f:.2f} mN; position={x:.3f} mm"),
)
add(
    "lines.jsonl",
    "loggers: JSON, an object a line",
    *each(
        lambda t, f, x: json.dumps({"t": round(t, 4), "data": {"force_N": round(f, 5), "position_mm": round(x, 4)}}),
        TIME.tolist(),
        FORCE.tolist(),
        WAY.tolist(),
    ),
)
add(
    "lists.json",
    "loggers: JSON, a list for each column",
    json.dumps(
        {
            "meta": {"rig": 2},
            "time_s": TIME.round(4).tolist(),
            "force_N": FORCE.round(5).tolist(),
            "position_mm": WAY.round(4).tolist(),
        }
    ),
    ended=False,
)
add(
    "objects.json",
    "loggers: JSON, a list of objects",
    json.dumps(
        [{"time (s)": round(t, 4), "force (N)": round(f, 5)} for t, f in zip(TIME, FORCE, strict=True)], indent=1
    ),
    truth=FORCE_ALONE,
    ended=False,
)
# HX711 loggers.
add(
    "hx711.csv",
    "HX711 loggers: grams of a load cell, milliseconds",
    "time (ms),load (g)",
    *table([(1e3 * TIME, "%d"), GRAMS]),
    truth=FORCE_ALONE,
)
add(
    "hx711_kg.csv",
    "HX711 loggers: kilograms in the name",
    "millis,weight_kg",
    *table([(1e3 * TIME, "%d"), (FORCE / 9.80665, "%.6f")]),
    truth=FORCE_ALONE,
)
add(
    "hx711_spike.csv",
    "HX711 loggers: one reading of 2^23 - 1 among good ones",
    "t [s],F [N],x [mm]",
    *each(lambda k, row: row if k != 700 else f"{TIME[700]:.4f},250.00000,{WAY[700]:.4f}", COUNT, STANDARD),
    left_out=1,
)
add(
    "hx711_counts.csv",
    "HX711 loggers: counts of the converter",
    "time (ms),load (counts)",
    *table([(1e3 * TIME, "%d"), (1e5 * FORCE + 8e6, "%d")]),
    asks=1,
    readable=False,
)
# ROS.
NS = [str(EPOCH * 10**9 + round(t * 1e9)) for t in TIME]
add(
    "rostopic.csv",
    "rostopic echo -p: nanoseconds since 1970, every field a column",
    "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.wrench.force.x,field.wrench.force.y,field.wrench.force.z",
    *each(lambda k, ns, f: f"{ns},{k},{ns},ft,{f:.6f},0.01,0.02", COUNT, NS, FORCE),
    truth=FORCE_ALONE,
    asks=1,
)
add(
    "bag_export.csv",
    "rosbag exporters: seconds and nanoseconds in two columns",
    "secs,nsecs,force.x,position",
    *each(lambda ns, f, x: f"{ns[:-9]},{int(ns[-9:])},{f:.6f},{x / 1e3:.6f}", NS, FORCE, WAY),
    asks=1,
)
add(
    "net_ft.csv",
    "Net F/T loggers: nanoseconds of a monotonic clock, six components",
    "t_monotonic_ns,Fx_N,Fy_N,Fz_N,Tx_Nm,Ty_Nm,Tz_Nm",
    *each(
        lambda k, t, f: f"{8123456789012 + round(t * 1e9)},{0.001 * k % 0.01:.4f},0.0100,{f:.5f},0.0001,0.0002,0.0003",
        COUNT,
        TIME,
        FORCE,
    ),
    truth=FORCE_ALONE,
)


def _sparse() -> list[str]:
    rows = [(t, f"{EPOCH + t:.6f},{f:.6f},") for t, f in zip(TIME, FORCE, strict=True)]
    rows += [(t + 0.001, f"{EPOCH + t + 0.001:.6f},,{x / 1e3:.6f}") for t, x in zip(TIME[::4], WAY[::4], strict=True)]
    return [row for _, row in sorted(rows)]


add(
    "plotjuggler.csv",
    "PlotJuggler: topics merged: the slower one has empty cells",
    "__time,/ft/wrench/force/x,/stage/position/feed",
    *_sparse(),
    asks=1,
)
add(
    "plotjuggler_iso.csv",
    "PlotJuggler: ISO 8601 with a zone",
    "timestamp,force (N),position (mm)",
    *each(lambda t, row: f"{at(t).isoformat(timespec='milliseconds')}Z,{row}", TIME, table([F, X])),
)
# pandas, Excel, MATLAB, R, Origin, Octave.
add(
    "pandas.csv",
    "pandas to_csv: an unnamed index, no units",
    ",t,F,x",
    *each(lambda k, row: f"{k},{row}", COUNT, STANDARD),
    asks=1,
)
add(
    "timedelta.csv",
    "pandas to_csv: timedelta",
    "time,force_N,position_mm",
    *each(lambda t, row: f"0 days 00:00:{t:09.6f},{row}", TIME, table([F, X])),
)
add(
    "timetable.csv",
    "MATLAB writetimetable: durations with their unit",
    "Time,Force,Position",
    *each(lambda t, f, x: f"{t:.4f} sec,{f:.5f},{x:.4f}"),
    asks=1,
)
add(
    "datetime.csv",
    "MATLAB writetable: dates by the names of months",
    "Time,Force_N,Way_mm",
    *each(lambda t, row: f"{at(t).strftime('%d-%b-%Y %H:%M:%S.%f')[:-3]},{row}", TIME, table([F, X])),
)
add(
    "excel_days.csv",
    "Excel: day numbers",
    "Date,Force [N],Position [mm]",
    *table([(46083.4244444444 + TIME / 86400, "%.12f"), F, X]),
)
add(
    "excel_german.csv",
    "Excel, German: semicolons, decimal comma, clock times with a comma",
    "sep=;",
    "Time;Force [N];Position [mm]",
    *each(lambda t, row: f"10:11:{12 + t:06.3f}".replace(".", ",") + ";" + row, TIME, table([F, X], ";", ",")),
)
add(
    "excel_thousands.csv",
    "Excel: whole numbers with thousands",
    "t [ms];F [mN]",
    *each(lambda t, f, x: f"{1e3 * t:.0f};{1e3 * f:,.0f}"),
    truth=FORCE_ALONE,
)
add(
    "unicode.txt",
    "Excel, Unicode text: UTF-16, tabs",
    "Zeit [s]\tKraft [N]\tWeg [mm]",
    *table([T, F, X], "\t", ","),
    encoding="utf-16",
)
add(
    "write_table.txt",
    "R write.table: row names without a header",
    '"time" "force" "position"',
    *each(lambda k, row: f'"{k + 1}" {row}', COUNT, table([T, F, (WAY / 1e3, "%.6f")], " ")),
    asks=1,
)
add(
    "origin.txt",
    "Origin: long names, units and comments in three rows",
    "Time\tForce\tDisplacement",
    "s\tmN\t\u00b5m",
    "\tchannel 1\tchannel 2",
    *table([T, MILLINEWTONS, MICRO_X], "\t"),
)
add(
    "fortran.dat",
    "Fortran: exponents with D, blanks",
    "# time [s]   force [N]   position [m]",
    *each(lambda t, f, x: f"  {t:.6E}  {f:.6E}  {x / 1e3:.6E}".replace("E", "D")),
)
add("gnuplot.dat", "gnuplot: names behind a comment mark", "# t(s) F(mN) x(mm)", *table([T, MILLINEWTONS, X], " "))
add(
    "diadem.csv",
    "DIAdem: micronewtons and micrometres",
    "t [s],F [\u00b5N],x [\u00b5m]",
    *table([T, (1e6 * FORCE, "%.1f"), MICRO_X]),
    encoding="cp1252",
)
add(
    "catman.asc",
    "HBM catman: the rate in the name of the time",
    "CATMAN",
    "Zeit  1 - Standardmessrate [s]\tKraft [N]\tWeg [mm]",
    *table([T, F, X], "\t", ","),
    encoding="cp1252",
)
add(
    "mesur.csv",
    "Mark-10 MESURgauge: reading and travel, lbF and in.",
    "Reading [lbF],Travel [in.],Time [sec.]",
    *table([(FORCE / 4.4482216152605, "%.5f"), (WAY / 25.4, "%.5f"), T]),
)
add(
    "sensit.csv",
    "FUTEK SENSIT: elapsed time, pounds",
    "Sampling Rate,200",
    "Elapsed Time (sec),Tracking Value (lb)",
    *table([T, (FORCE / 4.4482216152605, "%.6f")]),
    truth=FORCE_ALONE,
)
add(
    "opensignals.txt",
    "OpenSignals: a header of JSON with the rate, a counter",
    "# OpenSignals Text File Format",
    '# {"00:07": {"sampling rate": 200, "label": ["force"]}}',
    "# EndOfHeader",
    *each(lambda k, f: f"{k % 16}\t{f:.5f}\t", COUNT, FORCE),
    truth=FORCE_ALONE,
    asks=1,
)
add(
    "oscilloscope.csv",
    "Tektronix: the step above the table",
    "Sample Interval,5.0E-03,s",
    "Vertical Units,N",
    "Force [N],Position [mm]",
    *table([F, X]),
)
