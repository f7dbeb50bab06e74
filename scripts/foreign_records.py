"""Test the reading of foreign record files: valid ones, ones with a flaw, malformed ones.

    python scripts/foreign_records.py                 1000 valid records, 100 of each flaw, 10,000 malformed files
    python scripts/foreign_records.py --valid 50 --flawed 10 --malformed 200

Valid records are cuts of sampled specimens in the simulator, measured by a sensor with mild noise, written as other
programs write them (separator, decimal comma, preamble, units), and read back. Printed are the share that is
accepted, the false alarms of each kind of flaw, the errors of tare and start of the cuts, the injected flaws that
are found, and how malformed files end.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from record_damage import DAMAGES, damaged

from cutenv._base.arrays import StructArray
from cutenv._engine.randomness import generator
from cutenv.cutting.drive import Hand
from cutenv.cutting.sensor import SensorParameters
from cutenv.measurement import quality_issues
from cutenv.plant.protocol import Leg, depth_along, run
from cutenv.plant.simulator import SimulatedPlant
from cutenv.recording import RecordError
from cutenv.recording.column_map import ColumnMap
from cutenv.recording.columns import UNITS
from cutenv.recording.importers import load_foreign
from cutenv.tissue.specimen import Specimen
from cutenv.trace import Trace


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """Format in which a program writes a table."""

    separator: str = ","
    decimal: str = "."
    encoding: str = "utf-8"
    newline: str = "\n"
    preamble: tuple[str, ...] = ()
    names: tuple[str, ...] = ("time", "force", "position", "speed", "angle", "depth")
    units: tuple[str, ...] = ("s", "N", "m", "m/s", "rad", "m")
    header: str = "{name} [{unit}]"
    units_row: bool = False
    digits: str = ".17g"

    def name(self, field: str) -> str:
        """Return the program's name for a field of a trace."""
        return self.names[list(UNITS).index(field)]

    def unit(self, field: str) -> str:
        """Return the program's unit for a field of a trace."""
        return self.units[list(UNITS).index(field)]

    def write(self, trace: Trace) -> bytes:
        """Return the trace as this program would have written it."""
        fields = trace.known
        known = {"°": "deg"}
        factors = [UNITS[f][known.get(self.unit(f), self.unit(f))] for f in fields]
        columns = [getattr(trace, f) / factor for f, factor in zip(fields, factors, strict=True)]
        lines = [
            *self.preamble,
            self.separator.join(self.header.format(name=self.name(f), unit=self.unit(f)) for f in fields),
        ]
        if self.units_row:
            lines.append(self.separator.join(self.unit(f) for f in fields))
        for row in zip(*(column.tolist() for column in columns), strict=True):
            cells = (format(value, self.digits) for value in row)
            lines.append(
                self.separator.join(cells).replace(".", self.decimal)
                if self.decimal == ","
                else self.separator.join(cells)
            )
        return self.newline.join([*lines, ""]).encode(self.encoding)

    def mapping(self, trace: Trace) -> ColumnMap:
        """Return the column map that its user gives on the command line."""
        says = "{unit}" in self.header or self.units_row
        items = [f"{f}={self.name(f)}" + ("" if says or f == "force" else f"[{self.unit(f)}]") for f in trace.known]
        return ColumnMap.parse(items, unit=None if says else self.unit("force"))


_GERMAN = ("Zeit", "Kraft", "Weg", "Vorschub", "Winkel", "Tiefe")
DIALECTS = {
    "plain": Dialect(),
    "German Excel": Dialect(
        separator=";",
        decimal=",",
        encoding="cp1252",
        newline="\r\n",
        preamble=("Prüfprotokoll Nr. 12", "Datum;14.03.2026", "Prüfer;07", ""),
        names=_GERMAN,
        units=("ms", "mN", "mm", "mm/s", "°", "mm"),
    ),
    "tab with a row of units": Dialect(separator="\t", header="{name}", units_row=True, names=_GERMAN),
    "LabVIEW": Dialect(
        separator="\t",
        newline="\r\n",
        preamble=(
            "LabVIEW Measurement\t",
            "Writer_Version\t2",
            "Separator\tTab",
            "Decimal_Separator\t.",
            "Date\t2026/03/14",
            "***End_of_Header***\t",
            "\t",
            "Channels\t2",
            "Samples\t1\t1",
            "X_Dimension\tTime\tTime",
            "X0\t0.0000000000000000E+0\t0.0E+0",
            "Delta_X\t0.001000\t0.001",
            "***End_of_Header***\t\t",
        ),
        names=("X_Value", "Untitled", "Untitled 1", "Untitled 2", "Untitled 3", "Untitled 4"),
        header="{name}",
        digits=".17e",
    ),
    "blanks behind a comment": Dialect(separator="   ", header="{name}", preamble=("# run 3",), names=tuple("tFxvab")),
    "Unicode text of Excel": Dialect(
        separator="\t", decimal=",", encoding="utf-16", units=("s", "N", "cm", "cm/s", "deg", "mm")
    ),
    "unit in the name": Dialect(header="{name}_{unit}", units=("ms", "N", "mm", "mm_s", "deg", "mm")),
    "DIN": Dialect(separator=";", decimal=",", header="{name} / {unit}", units=("s", "N", "mm", "mm/s", "deg", "mm")),
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class ValidRecord:
    """A long record of one to three cuts, and the truth about it."""

    trace: Trace
    offset: float
    noise: float
    starts: tuple[float, ...]


def valid_record(seed: int) -> ValidRecord:
    """Cut one to three sampled specimens in turn by rig or hand, resting in between, with a sensor of mild noise."""
    rng = np.random.default_rng(seed)
    n_cuts = int(rng.choice([1, 1, 2, 3]))
    sensor = SensorParameters(
        force_noise=float(rng.choice([0.0, 0.005, 0.01, 0.02, 0.035, 0.05])),
        force_resolution=float(rng.choice([0.0, 0.001, 0.01, 0.05])),
        force_drift=float(rng.choice([0.0, 0.0, 0.002])),
    )
    with_position, by_hand = rng.random() < 0.75, rng.random() < 0.25
    parts: list[dict[str, Any]] = []
    starts = []
    began = 0.0
    for k in range(n_cuts):
        specimen = Specimen.draw(generator(seed, k), specimen_class=str(rng.choice(["liver", "vascular", "uniform"])))
        angle = math.radians(float(rng.choice([45.0, 60.0, 90.0])))
        speed, length = float(rng.uniform(0.004, 0.0254)), float(rng.uniform(0.02, 0.09))
        turns = [length] if n_cuts == 1 and rng.random() < 0.4 else [length, 0.0]
        if rng.random() < 0.3 and len(turns) == 2:
            turns = [0.4 * length, 0.0, length, 0.0]
        drive = Hand() if by_hand else None
        plant = SimulatedPlant(specimen, drive=drive, sensor=sensor, seed=seed + k, angle=angle)
        rest = plant.advance(0.0, angle, round(float(rng.uniform(2.0, 3.5)) / 1e-3)).copy()
        if by_hand:
            cut = _by_hand(plant, turns, speed, angle)
        else:
            cut = run(plant, [Leg(position=x, speed=speed, angle=angle, dwell=0.2) for x in turns])
        after = plant.advance(0.0, angle, round(float(rng.uniform(0.5, 1.5)) / 1e-3)).copy()
        readings = np.concatenate([rest, cut, after])
        starts.append(began + len(rest) * 1e-3)
        began += len(readings) * 1e-3
        parts.append({name: readings[name].copy() for name in ("force", "position", "speed", "angle")})
        parts[-1]["depth"] = depth_along(plant, readings["position"])
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    stride = int(rng.choice([1, 1, 2, 5, 10]))
    kept = np.arange(len(columns["force"])) % stride == 0
    kept &= rng.random(len(kept)) > 0.001  # lost readings
    offset = round(float(rng.uniform(-2.0, 2.0)), 2)
    time = np.arange(len(kept)) * 1e-3
    if with_position:
        columns["position"] = columns["position"] + float(rng.choice([0.0, 1e-5])) * rng.standard_normal(len(kept))
        if rng.random() < 0.3:
            columns = {name: columns[name] for name in ("force", "position")}
    else:
        columns = {"force": columns["force"]}
    columns["force"] = columns["force"] + offset
    trace = Trace(time=time[kept], **{name: values[kept] for name, values in columns.items()})
    return ValidRecord(trace=trace, offset=offset, noise=sensor.force_noise, starts=tuple(starts))


def _by_hand(plant: SimulatedPlant, turns: list[float], speed: float, angle: float) -> StructArray:
    """Move to and fro as a hand that is pushed back does: it does not arrive to the micrometre."""
    parts, position = [plant.advance(0.0, angle, 1).copy()], 0.0
    for turn in turns:
        way = turn - position
        for _ in range(round(1.5 * abs(way) / speed / 0.02)):
            if (turn - position) * way <= 1e-3 * abs(way):
                break
            parts.append(plant.advance(math.copysign(speed, way), angle, 20).copy())
            position = float(parts[-1]["position"][-1])
        parts.append(plant.advance(0.0, angle, 400).copy())
        position = float(parts[-1]["position"][-1])
    return np.concatenate(parts)


def stuck(trace: Trace, rng: np.random.Generator) -> tuple[Trace, tuple[int, int]]:
    """Let the sensor hang for a quarter of the record, from the middle of the cut on."""
    n = len(trace)
    first = int(np.argmax(trace.force > 0.5 * trace.force.max())) + int(rng.integers(n // 20))
    last = min(first + n // 4, n - 2)
    force = trace.force.copy()
    force[first : last + 1] = force[first]
    return _with(trace, force=force), (first, last)


def clipping(trace: Trace, rng: np.random.Generator) -> tuple[Trace, tuple[int, int]]:
    """Let the amplifier clip at 60 to 80 % of the largest force."""
    limit = float(rng.uniform(0.6, 0.8)) * float(trace.force.max())
    where = np.flatnonzero(trace.force >= limit)
    return _with(trace, force=np.minimum(trace.force, limit)), (int(where[0]), int(where[-1]))


def gap(trace: Trace, rng: np.random.Generator) -> tuple[Trace, tuple[int, int]]:
    """Remove a part of the cut."""
    n = len(trace)
    first = int(rng.integers(n // 4, n // 2))
    kept = np.ones(n, bool)
    kept[first : first + max(n // 20, round(0.3 * trace.sample_rate))] = False
    return trace.select(kept), (first - 1, first)


def reversed_sign(trace: Trace, rng: np.random.Generator) -> tuple[Trace, tuple[int, int]]:
    """Mount the sensor the other way round."""
    return _with(trace, force=-trace.force), (0, len(trace) - 1)


def constant(trace: Trace, rng: np.random.Generator) -> tuple[Trace, tuple[int, int]]:
    """Unplug the cable."""
    return _with(trace, force=np.full(len(trace), float(rng.uniform(-1.0, 1.0)))), (0, len(trace) - 1)


def short(trace: Trace, rng: np.random.Generator) -> tuple[Trace, tuple[int, int]]:
    """Stop the program after some readings."""
    n = int(rng.integers(10, 49))
    return trace.select(slice(n)), (0, n - 1)


def clock(trace: Trace, rng: np.random.Generator) -> tuple[Trace, tuple[int, int]]:
    """Let the program stamp the readings when it finds the time."""
    step = np.diff(trace.time) * rng.choice([0.1, 1.0, 1.9], size=len(trace) - 1)
    return _with(trace, time=np.concatenate(([0.0], np.cumsum(step)))), (0, len(trace) - 1)


def speed(trace: Trace, rng: np.random.Generator) -> tuple[Trace, tuple[int, int]]:
    """Record a speed that was commanded to another rig."""
    return _with(trace, speed=float(rng.choice([0.5, 2.0, -1.0])) * trace.speed), (0, len(trace) - 1)


def _with(trace: Trace, **changes: Any) -> Trace:
    columns = {name: getattr(trace, name) for name in trace.known} | changes
    return Trace(**columns, force_unit=trace.force_unit)


FLAWS: dict[str, Callable[[Trace, np.random.Generator], tuple[Trace, tuple[int, int]]]] = {
    "stuck": stuck,
    "clipping": clipping,
    "gap": gap,
    "reversed": reversed_sign,
    "constant": constant,
    "short": short,
    "clock": clock,
    "speed": speed,
}


def one_cut(seed: int) -> Trace:
    """Make a single cut without offset, all fields known, with a sensor of mild noise; half of them with a way back."""
    rng = np.random.default_rng(seed)
    specimen = Specimen.draw(generator(seed), specimen_class=str(rng.choice(["liver", "vascular", "uniform"])))
    angle = math.radians(float(rng.choice([45.0, 90.0])))
    sensor = SensorParameters(
        force_noise=float(rng.choice([0.0, 0.01, 0.02, 0.05])), force_resolution=float(rng.choice([0.0, 0.01, 0.05]))
    )
    plant = SimulatedPlant(specimen, sensor=sensor, seed=seed, angle=angle)
    velocity, length = float(rng.uniform(0.004, 0.0254)), float(rng.uniform(0.04, 0.09))
    turns = [length, 0.0] if rng.random() < 0.5 else [length]
    readings = run(plant, [Leg(position=x, speed=velocity, angle=angle, dwell=0.2) for x in turns])
    fields = {name: readings[name].copy() for name in ("time", "force", "position", "speed", "angle")}
    return Trace(**fields, depth=depth_along(plant, readings["position"]))


_ENOUGH = 0.95  # share of valid records that must be accepted


def malformed(content: bytes, rng: np.random.Generator) -> bytes:
    """Do one to three kinds of damage, every third to a cell: such files are the likeliest to be read."""
    for _ in range(int(rng.integers(1, 4))):
        kind = "cell_changed" if rng.random() < 0.3 else str(rng.choice(DAMAGES[".csv"]))
        content = damaged(content, kind, rng)
    return content


def small_record() -> Trace:
    """Return a record of few readings, so that accidents hit what matters: the header, a separator, a cell."""
    time = np.arange(80) * 0.01
    force = np.where(time < 0.3, 0.0, 1.0 + np.sin(20.0 * time)) + 0.01 * np.sin(1000.0 * time)
    return Trace(time=time, force=force, position=0.01 * time)


def end_of(path: Path, mapping: ColumnMap) -> str:
    """Return how reading a file ends: read, refused, or the name of an exception that should not occur."""
    try:
        load_foreign(path, mapping)
    except RecordError:
        return "refused"
    except Exception as error:  # its kind is the result
        traceback.print_exc()
        return type(error).__name__
    return "read"


def acceptance(n: int, folder: Path) -> tuple[list[str], bool]:
    """Return lines on how valid records are read, and whether 95 % are accepted."""
    accepted, refused, alarms, dialects = 0, Counter[str](), Counter[str](), list(DIALECTS.values())
    offsets, starts, counts, errors = [], {True: [], False: []}, Counter[str](), Counter[str]()
    n_cuts = 0
    for seed in range(n):
        record = valid_record(seed)
        dialect = dialects[seed % len(dialects)]
        path = folder / "record.csv"
        path.write_bytes(dialect.write(record.trace))
        try:
            imported = load_foreign(path, dialect.mapping(record.trace))
        except RecordError as error:
            errors[error.reason[:100]] += 1
            continue
        kinds = {flaw.kind for found in imported.flaws for flaw in found}
        refusing = {flaw.kind for found in imported.flaws for flaw in found if flaw.refuse}
        alarms.update(kinds)
        refused.update(refusing)
        accepted += not refusing
        for tared in imported.tared:
            tare = tared.metadata.get("tare_N")
            if tare is None:
                counts["without tare"] += 1
            else:
                offsets.append(abs(next(iter(tare.values())) - record.offset))
        known = record.trace.position is not None
        n_cuts += len(record.starts)
        found = np.array([trace.time[0] for trace in imported.traces])
        counts["all cuts found" if len(found) == len(record.starts) else "another number of cuts"] += 1
        if len(found) == len(record.starts):
            starts[known] += np.abs(found - record.starts).tolist()
    lines = [
        f"{n} valid records with mild noise, {n_cuts} cuts: {accepted} accepted ({accepted / n:.1%}).",
        "false alarms: " + (", ".join(f"{kind} {alarms[kind] / n:.2%}" for kind in FLAWS)),
        f"  of these refused: {dict(refused) or 'none'}; not read: {dict(errors) or 'none'}",
        f"records in which {', '.join(f'{what}: {count}' for what, count in counts.items())}",
        f"tare off by {1e3 * np.median(offsets):.1f} mN (median), {1e3 * np.max(offsets):.1f} mN at the most",
    ]
    for known, off in starts.items():
        where = "with position" if known else "force only"
        if off:
            lines.append(
                f"start of {len(off)} cuts, {where}: off by {1e3 * np.median(off):.0f} ms (median), "
                f"{1e3 * np.percentile(off, 95):.0f} ms (95 %), {1e3 * np.max(off):.0f} ms at the most"
            )
    return lines, accepted >= _ENOUGH * n


def detection(n: int) -> list[str]:
    """Return lines on how injected flaws are found, with all fields known and with the force only."""
    lines = ["injected flaw: found with all fields, with force only (of these at its rows)"]
    for kind, inject in FLAWS.items():
        shares = []
        for only_force in (False, True):
            found, placed = 0, 0
            for seed in range(n):
                whole, rows = inject(one_cut(seed), np.random.default_rng(seed))
                trace = Trace(time=whole.time, force=whole.force) if only_force else whole
                here = [flaw for flaw in quality_issues(trace) if flaw.kind == kind]
                found += bool(here)
                placed += any(flaw.rows[0] <= rows[1] and flaw.rows[1] >= rows[0] for flaw in here)
            shares.append(f"{found / n:6.0%} ({placed}/{found})")
        lines.append(f"  {kind:10s} {'  '.join(shares)}")
    return lines


def accidents(n: int, folder: Path) -> tuple[list[str], bool]:
    """Return a line on how malformed files end, and whether all end in a clear error or are read."""
    ends: Counter[str] = Counter()
    trace = small_record()
    path = folder / "record.csv"
    dialects = list(DIALECTS.values())
    for seed in range(n):
        dialect = dialects[seed % len(dialects)]
        path.write_bytes(malformed(dialect.write(trace), np.random.default_rng(seed)))
        ends[end_of(path, dialect.mapping(trace))] += 1
    line = f"{n} malformed files: {', '.join(f'{count} {end}' for end, count in sorted(ends.items()))}"
    return [line], set(ends) <= {"read", "refused"}


def main() -> int:
    """Print; return 1 if fewer than 95 % are accepted, or a malformed file ends in anything but a clear error."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--valid", type=int, default=1000)
    parser.add_argument("--flawed", type=int, default=100)
    parser.add_argument("--malformed", type=int, default=10_000)
    arguments = parser.parse_args()
    clear = enough = True
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if arguments.malformed:
            lines, clear = accidents(arguments.malformed, folder)
            print("\n".join(lines), flush=True)
        if arguments.flawed:
            print("\n".join(detection(arguments.flawed)), flush=True)
        if arguments.valid:
            lines, enough = acceptance(arguments.valid, folder)
            print("\n".join(lines))
    return 0 if clear and enough else 1


if __name__ == "__main__":
    sys.exit(main())
