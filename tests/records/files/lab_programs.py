"""Exports of laboratories' programs and machines, each after its maker's description or public examples."""

from __future__ import annotations

import json

import numpy as np
from lab_cut import (
    COUNT,
    EPOCH,
    FORCE,
    FORCE_ALONE,
    GRAMS,
    MICRO_X,
    MILLINEWTONS,
    OTHER_F,
    OTHER_FORCE,
    OTHER_X,
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
    at,
    clock_time,
    each,
    table,
)

# Units beside, above and below their columns; axes by number; messages as text: exports with facts in odd places.

_NOUGHT = (np.zeros(N), "%.3f")
_SIDE = (1e-4 * np.sin(TIME), "%.7f")
_POUNDS = FORCE / 4.4482216

add(
    "units_column.csv",
    "Futek: the unit in a column of its own, behind greatest and least value",
    "Units:,lb",
    "Sample,Time,Tracking Value,Peak,Valley,Units",
    *each(
        lambda k, t, f, top, low: f"{k + 1},{at(t).strftime('%I:%M:%S.%f %p')},{f:.5f},{top:.5f},{low:.5f},lb",
        COUNT,
        TIME,
        _POUNDS,
        np.maximum.accumulate(_POUNDS),
        np.minimum.accumulate(_POUNDS),
    ),
    truth=FORCE_ALONE,
)
add(
    "value_and_unit.jsonl",
    "people and programs: objects of value and unit",
    *each(
        lambda t, f, x: json.dumps(
            {"ts": at(t).isoformat(), "force": {"value": 1e3 * f, "unit": "mN"}, "way": {"value": x, "unit": "mm"}}
        ),
        TIME,
        FORCE.round(5).tolist(),
        WAY.round(4).tolist(),
    ),
)
add(
    "group_units.csv",
    "ATI: the unit above a group of axes",
    "Force (lbf),,,Torque (lbf-in),,,",
    "Fx,Fy,Fz,Tx,Ty,Tz,Time",
    *each(lambda t, f: f"0.001,0.002,{-f:.6f},0.1,0.2,0.3,{at(t).strftime('%m/%d/%Y %H:%M:%S.%f')}", TIME, _POUNDS),
    truth=FORCE_ALONE,
)
add(
    "rate_under_names.asc",
    "HBM: the same words below every name",
    "Zeit [s]\tKraft S2M [N]\tWeg WA50 [mm]",
    "\t".join(["Abtastrate 200Hz"] * 3),
    *table([T, F, X], "\t", ","),
    encoding="cp1252",
)
add(
    "numbered_axes.csv",
    "Franka: components by a number in brackets",
    "time,O_T_EE[12],O_T_EE[13],O_T_EE[14],O_F_ext_hat_K[0],O_F_ext_hat_K[1],O_F_ext_hat_K[2]",
    *table([(1e3 * TIME, "%.0f"), _SIDE, _NOUGHT, (0.3 - WAY / 1e3, "%.7f"), _NOUGHT, _SIDE, (-FORCE, "%.5f")]),
    asks=1,
)
add(
    "places_without_unit.log",
    "Force Dimension: a place of three axes without a unit",
    "# time px py pz fx fy fz",
    *table([T, _NOUGHT, _SIDE, (-WAY / 1e3, "%.7f"), _NOUGHT, _SIDE, F], " "),
    asks=1,
)
add(
    "listed_channels.txt",
    "people and programs: a numbered list of the channels above counted rows",
    "% Sampling frequency: 200 Hz",
    "% Channel 1: Force [N]",
    "% Channel 2: Displacement [mm]",
    *table([(np.arange(N), "%d"), F, X], " "),
)
add(
    "depth_alone.csv",
    "people and programs: a depth that moves, and no other way",
    "elapsed_us,force_cN,depth_mm",
    *table([(1e6 * TIME, "%.0f"), (1e2 * FORCE, "%.3f"), X]),
    asks=1,
)
add(
    "messages.yaml",
    "ROS: messages as they are printed",
    *[
        line
        for t, f in zip(TIME, FORCE, strict=True)
        for line in (
            "header: ",
            "  stamp: ",
            f"    secs: {EPOCH + int(t)}",
            f"    nsecs: {round((t % 1.0) * 1e9)}",
            '  frame_id: "ft"',
            "wrench: ",
            "  force: ",
            "    x: 0.001",
            f"    z: {f:.6f}",
            "  torque: ",
            "    x: 0.2",
            "---",
        )
    ],
    truth=FORCE_ALONE,
    asks=1,
)
add(
    "tags_and_quality.csv",
    "OPC: a row for each value, with its quality and unit",
    "Tag;Timestamp;Value;Quality;Unit",
    *(
        f"{tag};{at(t).strftime('%d.%m.%Y %H:%M:%S.%f')};{value:.5f};Good;{unit}"
        for t, f, x in zip(TIME, FORCE, WAY, strict=True)
        for tag, value, unit in (("Rig.Force", f, "N"), ("Rig.Position", x, "mm"))
    ),
)
add(
    "facts_beside.json",
    "people and programs: rate and units beside the lists",
    json.dumps(
        {
            "sampling_rate_hz": RATE,
            "units": {"force": "mN", "displacement": "um"},
            "data": {"force": (1e3 * FORCE).round(2).tolist(), "displacement": (1e3 * WAY).round(1).tolist()},
        }
    ),
    ended=False,
)
add(
    "round_brackets.txt",
    "Robotiq: rows in round brackets",
    "time, force [N], way [mm]",
    *each(lambda row: f"( {row} )", table([T, F, X], " , ")),
)
add(
    "data_per_second.csv",
    "Imada: unit and rate in lines above",
    "FORCE GAUGE,ZTA-50N",
    "UNIT,N",
    "SAMPLING,200 data/sec",
    "",
    "No.,Force,Displacement(mm)",
    *table([(np.arange(N) + 1, "%d"), F, X]),
)
add(
    "sub_frames.csv",
    "Vicon: parts of frames, the rate in a line of its own, another table below",
    "Devices",
    "200",
    ",,Force Plate 1 - Force,,,Force Plate 1 - CoP,,",
    "Frame,Sub Frame,Fx,Fy,Fz,Cx,Cy,Cz",
    ",,N,N,N,mm,mm,mm",
    *each(lambda k, f: f"{k // 10 + 1},{k % 10},0.01,0.02,{-f:.5f},100.{k % 7},50,0", COUNT, FORCE),
    "",
    "Trajectories",
    "20",
    ",,knife:tip,,",
    "Frame,Sub Frame,X,Y,Z",
    ",,mm,mm,mm",
    *each(lambda k, x: f"{k + 1},0,{x:.4f},3,1", COUNT, WAY[::10]),
    truth=FORCE_ALONE,
    left_out=5 + len(WAY[::10]),
)
add(
    "counts_by_header.csv",
    "ATI: counts a unit in cells of the header",
    '"RDT Sample Rate:","200"',
    '"Force Units:","N","Counts per Unit Force:","1000000.0"',
    '"Torque Units:","Nm","Counts per Unit Torque:","1000000.0"',
    '"Status (hex)","RDT Sequence","Fx","Fy","Fz","Tx","Ty","Tz","Time"',
    *each(
        lambda k, t, f: f'"0x00000000","{k + 1}","10","20","{1e6 * f:.0f}","1","2","3","{clock_time(t)}"',
        COUNT,
        TIME,
        FORCE,
    ),
    truth=FORCE_ALONE,
)
add(
    "seconds_and_millis.log",
    "KUKA: seconds and milliseconds in two columns, axes in the middle of words",
    "ZeitInSec ZeitInMillis axisX axisY axisZ cartForce1_X cartForce1_Y cartForce1_Z",
    *each(lambda t, f, x: f"{EPOCH + int(t)} {round((t % 1.0) * 1e3)} 400.0 5.0 {600.0 - x:.4f} 0.2 0.1 {f:.5f}"),
    asks=1,
)
add(
    "acceleration_too.csv",
    "people and programs: an acceleration of three axes, and no way",
    "time_ms,force_g,accel_x,accel_y,accel_z",
    *table([(1e3 * TIME, "%.0f"), GRAMS, _SIDE, _NOUGHT, _SIDE]),
    truth=FORCE_ALONE,
)
add(
    "annotated.csv",
    "InfluxDB: a row for each value, the number of its table in front",
    "#datatype,string,long,dateTime:RFC3339,double,string,string",
    "#group,false,false,false,false,true,true",
    "#default,_result,,,,,",
    ",result,table,_time,_value,_field,_measurement",
    *(
        f",,{k},{at(t).isoformat(timespec='milliseconds')}Z,{value:.5f},{name},rig"
        for k, (name, values) in enumerate((("force_N", FORCE), ("position_mm", WAY)))
        for t, value in zip(TIME, values, strict=True)
    ),
)
add(
    "in_volts.ddf",
    "Aurora Scientific: units and scales of channels whose data are in volts",
    "Sample Frequency (Hz): 200",
    "Channel\tAI0\tAI1",
    "Units\tC\tmN",
    "Scale (units/V)\t4.0\t100.0",
    "Test Data in Volts:",
    "Sample\tAI0\tAI1",
    *table([(np.arange(N), "%d"), _NOUGHT, (10.0 * FORCE, "%.5f")], "\t"),
    asks=1,
    readable=False,
)
_FRAME = {"t_ms": 1e3 * TIME, "Fz_N": FORCE.round(5), "z_mm": WAY.round(4)}
add(
    "split.json",
    "pandas: names, and rows as lists",
    json.dumps(
        {"columns": list(_FRAME), "index": list(range(N)), "data": np.column_stack(list(_FRAME.values())).tolist()}
    ),
    ended=False,
)
add(
    "columns.json",
    "pandas: an object for each column",
    json.dumps({name: {str(k): value for k, value in enumerate(values)} for name, values in _FRAME.items()}),
    ended=False,
)

# Loggers, robots and programs of numbers: serial monitors, ROS, JSON, pandas, Excel, MATLAB, R.

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

# Test machines, texture analysers and recorders of physiology: each after its maker's description of the export.


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
    *table([T, OTHER_X, OTHER_F], quote='"'),
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
    *table([GRAMS, X, T, (1e3 * OTHER_FORCE / 9.80665, "%.3f"), OTHER_X, T]),
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
        [*table([OTHER_F, OTHER_X, (TIME / 60, "%.7f"), (0 * TIME, "%d")])[:-60], *[",,,"] * 60],
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
    *table([T, F, X, T, OTHER_F, OTHER_X]),
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
    *table([T, F, X, T, OTHER_F, OTHER_X]),
    truth=TWO,
)
add(
    "data_sets.csv",
    "Vernier Graphical Analysis: data set in front of each name, no blank before the unit",
    "Data Set 1:Time(s),Data Set 1:Force(N),Data Set 1:Position(cm)",
    *table([T, F, (WAY / 10, "%.5f")]),
)

# Recorders, oscilloscopes, data tables and robots' logs, each after its maker's description or public examples.

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
    *table([T, F, X, T, OTHER_F, OTHER_X]),
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
