"""Time to calibrate a session of cuts (the thesis's protocol on virtual livers), compared with reading its files."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from cutenv.records import load_one, save
from cutenv.records.measurement.calibration import RESAMPLES, measure_cuts, tissue_of
from cutenv.sim.tissue import CutModel, measured_liver
from cutenv.sim.trace import Trace
from scripts.benchmarks.speed.measured import Measured, Number, at_most
from scripts.validation.measurement import calibrate_virtual_rig
from scripts.validation.measurement.calibrate_virtual_rig import SEED, SPEEDS

LIVERS = 6  # number of livers; each is cut at seven speeds and two angles: 84 cuts
ALLOWED = 1.0
"""Largest acceptable time of calibrating, in times of reading the files: a user waits for the disk, not for us."""


class SessionTimes(NamedTuple):
    """Times of one session [s]."""

    cuts: int
    readings: int
    reading: float  # time to read its CSV files
    measuring: float  # time to measure every cut, several times for the loading ratio
    together: float  # time to fit one tissue to the cuts, bootstrap and scales included


def session(livers: int = LIVERS, speeds: Sequence[float] = SPEEDS) -> list[Trace]:
    """Simulate records of the thesis's protocol, by default at all of its speeds [m/s]."""
    return [trace for trace, _ in calibrate_virtual_rig.session(measured_liver(), livers, SEED, speeds)]


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
