"""Virtual records as people bring them: long ones of several cuts, in the dialects of other programs, with flaws."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cutenv._base.arrays import StructArray
from cutenv._engine.randomness import generator
from cutenv.records.foreign.column_map import ColumnMap
from cutenv.records.schema import UNITS
from cutenv.sim.cutting.drive import Hand
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.plant.protocol import Leg, run
from cutenv.sim.plant.simulator import SimulatedPlant
from cutenv.sim.tissue.grid import depth_below
from cutenv.sim.tissue.specimen import Specimen
from cutenv.sim.trace import Trace

Flawed = tuple[Trace, tuple[int, int]]  # trace with a flaw, and the first and the last row that have it


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
        units = {field: self.unit(field) for field in trace.known}
        above = [[self.header.format(name=self.name(field), unit=unit) for field, unit in units.items()]]
        above += [list(units.values())] * self.units_row
        columns = [getattr(trace, f) / UNITS[f]["deg" if unit == "°" else unit] for f, unit in units.items()]
        rows = [
            [format(value, self.digits).replace(".", self.decimal) for value in row]
            for row in zip(*(column.tolist() for column in columns), strict=True)
        ]
        lines = [*self.preamble, *map(self.separator.join, above + rows), ""]
        return self.newline.join(lines).encode(self.encoding)

    def mapping(self, trace: Trace) -> ColumnMap:
        """Return the column map that its user gives on the command line."""
        says = "{unit}" in self.header or self.units_row
        items = [f"{f}={self.name(f)}" + ("" if says or f == "force" else f"[{self.unit(f)}]") for f in trace.known]
        return ColumnMap.parse(items, unit=None if says else self.unit("force"))


_GERMAN = ("Zeit", "Kraft", "Weg", "Vorschub", "Winkel", "Tiefe")
DIALECTS = {
    "plain": Dialect(),
    "German Excel": Dialect(
        separator=";", decimal=",", encoding="cp1252", newline="\r\n",
        preamble=("Prüfprotokoll Nr. 12", "Datum;14.03.2026", "Prüfer;07", ""),
        names=_GERMAN, units=("ms", "mN", "mm", "mm/s", "°", "mm"),
    ),
    "tab with a row of units": Dialect(separator="\t", header="{name}", units_row=True, names=_GERMAN),
    "LabVIEW": Dialect(
        separator="\t", newline="\r\n",
        preamble=(
            "LabVIEW Measurement\t", "Writer_Version\t2", "Separator\tTab", "Decimal_Separator\t.", "Date\t2026/03/14",
            "***End_of_Header***\t", "\t", "Channels\t2", "Samples\t1\t1", "X_Dimension\tTime\tTime",
            "X0\t0.0000000000000000E+0\t0.0E+0", "Delta_X\t0.001000\t0.001", "***End_of_Header***\t\t",
        ),
        names=("X_Value", "Untitled", "Untitled 1", "Untitled 2", "Untitled 3", "Untitled 4"),
        header="{name}", digits=".17e",
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
    """A long record of one to three cuts, with the sensor's offset [N] and the times at which the cuts start [s]."""

    trace: Trace
    offset: float
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
        plant = SimulatedPlant(specimen, drive=Hand() if by_hand else None, sensor=sensor, seed=seed + k, angle=angle)
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
        parts[-1]["depth"] = depth_below(plant.depth, readings["position"])
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    stride = int(rng.choice([1, 1, 2, 5, 10]))
    kept = np.arange(len(columns["force"])) % stride == 0
    kept &= rng.random(len(kept)) > 0.001  # lost readings
    offset = round(float(rng.uniform(-2.0, 2.0)), 2)
    if with_position:
        columns["position"] = columns["position"] + float(rng.choice([0.0, 1e-5])) * rng.standard_normal(len(kept))
        if rng.random() < 0.3:
            columns = {name: columns[name] for name in ("force", "position")}
    else:
        columns = {"force": columns["force"]}
    columns |= {"time": np.arange(len(kept)) * 1e-3, "force": columns["force"] + offset}
    trace = Trace(**{name: values[kept] for name, values in columns.items()})
    return ValidRecord(trace=trace, offset=offset, starts=tuple(starts))


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
    return Trace(**fields, depth=depth_below(plant.depth, readings["position"]))


def stuck(trace: Trace, rng: np.random.Generator) -> Flawed:
    """Let the sensor hang for a quarter of the record, from the middle of the cut on."""
    n = len(trace)
    first = int(np.argmax(trace.force > 0.5 * trace.force.max())) + int(rng.integers(n // 20))
    last = min(first + n // 4, n - 2)
    force = trace.force.copy()
    force[first : last + 1] = force[first]
    return replace(trace, force=force), (first, last)


def clipping(trace: Trace, rng: np.random.Generator) -> Flawed:
    """Let the amplifier clip at 60 to 80 % of the largest force."""
    limit = float(rng.uniform(0.6, 0.8)) * float(trace.force.max())
    where = np.flatnonzero(trace.force >= limit)
    return replace(trace, force=np.minimum(trace.force, limit)), (int(where[0]), int(where[-1]))


def gap(trace: Trace, rng: np.random.Generator) -> Flawed:
    """Remove a part of the cut."""
    n = len(trace)
    first = int(rng.integers(n // 4, n // 2))
    kept = np.ones(n, bool)
    kept[first : first + max(n // 20, round(0.3 * trace.sample_rate))] = False
    return trace.select(kept), (first - 1, first)


def clock(trace: Trace, rng: np.random.Generator) -> Flawed:
    """Let the program stamp the readings when it finds the time."""
    step = np.diff(trace.time) * rng.choice([0.1, 1.0, 1.9], size=len(trace) - 1)
    return _throughout(replace(trace, time=np.concatenate(([0.0], np.cumsum(step)))))


def _throughout(trace: Trace) -> Flawed:
    return trace, (0, len(trace) - 1)


FLAWS: dict[str, Callable[[Trace, np.random.Generator], Flawed]] = {
    "stuck": stuck,
    "clipping": clipping,
    "gap": gap,
    "reversed": lambda trace, _: _throughout(replace(trace, force=-trace.force)),
    "constant": lambda trace, rng: _throughout(
        replace(trace, force=np.full(len(trace), float(rng.uniform(-1.0, 1.0))))
    ),
    "short": lambda trace, rng: _throughout(trace.select(slice(int(rng.integers(10, 49))))),
    "clock": clock,
    "speed": lambda trace, rng: _throughout(replace(trace, speed=float(rng.choice([0.5, 2.0, -1.0])) * trace.speed)),
}
"""By kind of flaw (:func:`cutenv.records.measurement.quality_issues`): a sensor mounted the other way round, an
unplugged cable, a program that was stopped, a speed that was commanded to another rig, and those above."""
