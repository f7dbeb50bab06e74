"""Time to calibrate a session of cuts (the thesis's protocol on virtual livers), compared with reading its files."""

from __future__ import annotations

import itertools
import math
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from cutenv.records import load_one, save
from cutenv.records.measurement.calibration import RESAMPLES, measure_cuts, tissue_of
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import CutModel, Specimen
from cutenv.sim.tissue.tables import table
from cutenv.sim.trace import Trace
from scripts.benchmarks.speed.measured import Measured, Number, at_most

LIVERS = 6
"""Number of livers; each is cut at seven speeds and two angles: 84 cuts."""
ALLOWED = 1.0
"""Largest acceptable time of calibrating, in times of reading the files: a user waits for the disk, not for us."""
_LENGTH = 0.1016  # four inches, and back [m]
_RETURN_SPEED = 0.0127  # at the least [m/s]


class SessionTimes(NamedTuple):
    """Times of one session [s]."""

    cuts: int
    readings: int
    reading: float
    """Time to read its CSV files."""
    measuring: float
    """Time to measure every cut, several times for the loading ratio."""
    together: float
    """Time to fit one tissue to the cuts, bootstrap and scales included."""


def session(livers: int = LIVERS, speeds: tuple[float, ...] | None = None) -> list[Trace]:
    """Simulate records of the thesis's protocol, by default at all of its speeds [m/s]."""
    chosen = speeds or tuple(float(v) / 100.0 for v in table("5.6")["speed_cm_s"])
    records = []
    for n, (liver, angle_deg, speed) in enumerate(itertools.product(range(livers), (90.0, 45.0), chosen)):
        angle = math.radians(angle_deg)
        plant = SimulatedPlant(Specimen.drawn(n), seed=0, episode=n, angle=angle)
        legs = [
            Leg(position=_LENGTH, speed=speed, angle=angle, dwell=0.2),
            Leg(position=0.0, speed=max(speed, _RETURN_SPEED), angle=angle, dwell=0.2),
        ]
        records.append(to_trace(plant, run(plant, legs), name=f"cut {n}", specimen=f"liver {liver}"))
    return records


def session_times(records: list[Trace]) -> SessionTimes:
    """Write the files, read them and calibrate from the records, once each."""
    model = CutModel()
    model.stiffness(0.05)  # factorised before the clock runs: once for any number of cuts
    with tempfile.TemporaryDirectory() as folder:
        paths = [Path(folder) / f"{n}.csv" for n in range(len(records))]
        for record, path in zip(records, paths, strict=True):
            save(record, path)
        start = time.perf_counter()
        traces = [load_one(path) for path in paths]
        read = time.perf_counter()
    begun = time.perf_counter()
    cuts, _ = measure_cuts(traces, model)
    measured = time.perf_counter()
    tissue_of(cuts, model, resamples=RESAMPLES)
    return SessionTimes(
        cuts=len(records),
        readings=sum(len(trace) for trace in traces),
        reading=read - start,
        measuring=measured - begun,
        together=time.perf_counter() - measured,
    )


def measure() -> Measured:
    """Measure the whole protocol, and the ratio to reading."""
    found = session_times(session())
    calibrating = found.measuring + found.together
    ratio = calibrating / found.reading
    numbers = {
        "cuts": Number(found.cuts, "1"),
        "reading": Number(found.reading, "s"),
        "measuring": Number(found.measuring, "s"),
        "one tissue of them": Number(found.together, "s"),
        "calibrating over reading": Number(ratio, "1"),
    }
    what = f"calibrating takes {ratio:.2f} times as long as reading"
    size = f"{found.cuts} cuts of {found.readings / 1e6:.1f} million readings, {RESAMPLES} resamples"
    lines = [
        f"calibrating {size}: reading their CSV files {found.reading:.1f} s, measuring {found.measuring:.1f} s, "
        f"one tissue of them {found.together:.1f} s",
        at_most(what, ratio, ALLOWED, "time of reading"),
    ]
    return Measured(numbers, lines)
