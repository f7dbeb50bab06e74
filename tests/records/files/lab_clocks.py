"""Clocks of every kind, damaged files, and files that leave open what nobody can guess."""

from __future__ import annotations

import datetime
import struct
from collections.abc import Callable

import numpy as np
from lab_cut import (
    COUNT,
    EPOCH,
    FORCE_ALONE,
    OTHER_FORCE,
    OTHER_WAY,
    STANDARD,
    START,
    TIME,
    TWO,
    WAY,
    F,
    T,
    Truth,
    X,
    add,
    each,
    table,
)


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
    *table([T, (OTHER_FORCE, "%.5f"), (OTHER_WAY, "%.4f")]),
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
