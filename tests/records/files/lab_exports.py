"""Units beside, above and below their columns; axes by number; messages as text: exports with facts in odd places."""

from __future__ import annotations

import json

import numpy as np
from lab_cut import (
    COUNT,
    EPOCH,
    FORCE,
    FORCE_ALONE,
    GRAMS,
    RATE,
    TIME,
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
