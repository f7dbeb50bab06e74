"""Changes of a measurement's results when its record is disturbed, or refusal of the record.

    python scripts/record_robustness.py                     about three minutes
    python scripts/record_robustness.py --records 200       fewer for the share that is accepted

Virtual cuts of known tissue are disturbed as rigs, programs and people disturb records. For every disturbance the table
gives its effect on fracture resistance, local effective modulus, friction and initiation, the worst of several cuts.
The bounds that are allowed are defined here, and the property tests use the same ones.
"""

from __future__ import annotations

import argparse
import dataclasses
import functools
import math
import re
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from cutenv._engine.randomness import generator
from cutenv.cutting.sensor import SensorParameters
from cutenv.measurement import MeasuredCut, initiation_excess, measure_cut, quality_issues
from cutenv.measurement.zero import TAKEN_OFF
from cutenv.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.recording.files import load_one
from cutenv.tissue import CutModel, Specimen, measured_liver
from cutenv.tissue.specimen import N_POINTS, SPACING
from cutenv.trace import Trace

INCH = 0.0254
MODEL = CutModel()
SPEEDS = (0.001, 0.0254)
"""Range in which the modulus was measured [m/s]."""
FEWEST = 3
"""Smallest number of segments or units at which their results are used."""
RESOLUTION = 0.05
"""Resolution of the thesis's sensor (section 3.1) [N]: a disturbed force is quantised with it again."""

ACCEPTED = 0.95
"""Smallest share of valid records with mild noise that must be accepted."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Bounds:
    """Largest allowed changes of one record's results."""

    resistance: float
    """Relative change."""
    modulus: float
    """Relative change of the median over the segments, normalised by the exact slopes at their positions."""
    friction_share: float
    """Absolute change."""
    eta90: float
    """Absolute change."""


BOUNDS = {
    # The same numbers, except for rounding.
    "other units": Bounds(resistance=1e-9, modulus=1e-9, friction_share=1e-9, eta90=1e-9),
    "other clock": Bounds(resistance=1e-6, modulus=1e-6, friction_share=1e-6, eta90=1e-6),
    # Energy is a sum over all readings, a slope one over a ramp; that at a hilltop depends on the last few readings.
    "noise": Bounds(resistance=0.005, modulus=0.05, friction_share=0.005, eta90=0.12),
    "sample rate": Bounds(resistance=0.01, modulus=0.05, friction_share=0.005, eta90=0.06),
    "jitter": Bounds(resistance=0.005, modulus=0.02, friction_share=0.005, eta90=0.02),
    "encoder": Bounds(resistance=0.005, modulus=0.02, friction_share=0.005, eta90=0.03),
    "gap": Bounds(resistance=0.01, modulus=0.03, friction_share=0.005, eta90=0.03),
    # The cut stops and starts elsewhere, so that other ramps and fewer units represent an uneven tissue.
    "strokes": Bounds(resistance=0.03, modulus=0.03, friction_share=0.01, eta90=0.12),
    # The blade rests before these cuts, so that the sensor's zero is measured and subtracted.
    "offset": Bounds(resistance=1e-9, modulus=1e-9, friction_share=1e-9, eta90=1e-9),
    # Left in, a zero that is off by f counts as friction on the way back: R moves by f/B, which is f/(R B) of it,
    # and friction by as much the other way. With B 1.5 cm and R 200 J/m2, 0.2 N are 7 %.
    "offset left in": Bounds(resistance=0.15, modulus=0.15, friction_share=0.15, eta90=0.15),
}
"""Bounds by kind of disturbance, over its whole range; ``tests/properties/test_record_robustness.py`` checks them."""

RATES = (100.0, 10_000.0)
"""Sampling rates of the slowest and the fastest sensor [Hz]."""
NOISE = 0.1
"""Largest noise that is added [N]: four times that of the virtual sensor."""
OFFSET = 0.2
"""Largest offset of the sensor's zero [N]."""
JITTER = 2.0
"""Largest error of a reading's time stamp, in time steps."""
ENCODER = 50e-6
"""Coarsest encoder resolution [m]."""


class Numbers(NamedTuple):
    """Results from one record; NaN where it gives none."""

    resistance: float
    """Fracture resistance [J/m2]."""
    modulus: float
    """Median over the segments of the modulus over that of an exact slope [1]; NaN if none is steady."""
    friction_share: float
    """Share of friction; NaN without a return stroke."""
    eta90: float
    """Initiation excess; NaN without two steady ramps in a row."""

    def moved(self, before: Numbers) -> Numbers:
        """Return the change of each result, relative for the resistance; NaN where one of the two is missing."""
        return Numbers(
            self.resistance / before.resistance - 1.0,
            self.modulus - before.modulus,
            self.friction_share - before.friction_share,
            self.eta90 - before.eta90,
        )

    def within(self, bounds: Bounds) -> bool:
        """Return True if all changes are within bounds; missing results are not wrong."""
        return not any(abs(moved) > bound for moved, bound in zip(self, dataclasses.astuple(bounds), strict=True))


class Refused(NamedTuple):
    """A record that is refused."""

    reason: str


class Known(NamedTuple):
    """A record with its ground truth."""

    trace: Trace
    specimen: Specimen

    def measured(self, disturbed: Trace | None = None) -> Numbers | Refused:
        """Check and measure the record, or another one of the same cut, as ``cutenv calibrate`` does."""
        trace = self.trace if disturbed is None else disturbed
        wrong = [flaw.message for flaw in quality_issues(trace) if flaw.refuse]
        if wrong:
            return Refused(" ".join(wrong))
        try:
            cut = measure_cut(trace, MODEL)
        except ValueError as error:
            return Refused(str(error))
        share = math.nan if cut.return_stroke is None else cut.fracture.friction_per_depth / cut.fracture.corrected
        units = len(cut.initiation.unit_area)
        return Numbers(
            resistance=cut.fracture.corrected,
            modulus=self._modulus_ratio(cut),
            friction_share=share,
            eta90=initiation_excess([cut.initiation]) if units >= FEWEST else math.nan,
        )

    def _modulus_ratio(self, cut: MeasuredCut) -> float:
        if len(cut.moduli) < FEWEST:
            return math.nan
        tips, places = cut.moduli.position, np.arange(N_POINTS) * SPACING
        K, B = (np.interp(tips, places, along) for along in (self.specimen.stiffness(), self.specimen.depth))
        speeds = [segment.require("speed", by="record_robustness")[0] for segment in cut.moduli.segments]
        r = np.array([self.specimen.loading_ratio(speed, cut.angle) for speed in speeds])
        return float(np.median(cut.moduli.modulus / (r * K / (MODEL.stiffness(tips) * B))))


@functools.lru_cache(maxsize=64)
def record(
    seed: int, speed: float, angle_deg: float, turns: tuple[float, ...] = (4 * INCH, 0.0), noise: float = 0.02
) -> Known:
    """Record a cut of a sampled liver through ``turns`` [m] at a speed [m/s], after half a second at rest."""
    specimen = Specimen.draw(generator(seed), specimen_class="liver", tissue=measured_liver())
    angle = math.radians(angle_deg)
    plant = SimulatedPlant(specimen, seed=seed, angle=angle, sensor=SensorParameters(force_noise=noise))
    legs = [Leg(position=0.0, speed=speed, angle=angle, dwell=0.5)]
    legs += [Leg(position=x, speed=speed, angle=angle, dwell=0.2) for x in turns]
    return Known(to_trace(plant, run(plant, legs), specimen=f"liver {seed}"), specimen)


CONDITIONS = ((3, 0.0064, 90.0), (4, 0.0127, 90.0), (5, 0.0127, 45.0), (6, 0.0254, 90.0), (9, 0.0089, 45.0))
"""Seed of the liver, speed [m/s] and angle [deg] of the cuts that are disturbed."""


def noisier(trace: Trace, rng: np.random.Generator, sd: float) -> Trace:
    """Add noise of a standard deviation [N]."""
    return _felt(trace, trace.force + rng.normal(0.0, sd, len(trace)))


def resampled(trace: Trace, rate: float) -> Trace:
    """Resample every column to another rate [Hz] by linear interpolation."""
    time = np.arange(trace.time[0], trace.time[-1], 1.0 / rate)
    columns = {name: np.interp(time, trace.time, getattr(trace, name)) for name in trace.known if name != "time"}
    return Trace(time=time, **columns, metadata=trace.metadata)


def offset(trace: Trace, force: float) -> Trace:
    """Add an offset to the sensor's zero [N]."""
    return dataclasses.replace(trace, force=trace.force + force)


def offset_left_in(trace: Trace, force: float) -> Trace:
    """Add an offset to the zero of a record whose metadata claim that the zero was subtracted [N]."""
    return dataclasses.replace(offset(trace, force), metadata={**trace.metadata, TAKEN_OFF: {"before": 0.0}})


def with_gap(trace: Trace, at: float, seconds: float) -> Trace:
    """Remove the readings of some time, beginning at a share ``at`` of the record."""
    start = trace.time[0] + at * trace.duration
    return trace.select((trace.time < start) | (trace.time >= start + seconds))


def reversed_sign(trace: Trace) -> Trace:
    """Reverse the sign of the force."""
    return dataclasses.replace(trace, force=-trace.force)


def jittered(trace: Trace, rng: np.random.Generator, steps: float) -> Trace:
    """Give every reading a wrong time stamp, off by up to so many time steps; the stamps stay in order."""
    step = trace.duration / (len(trace) - 1)
    time = np.sort(trace.time + rng.uniform(-steps, steps, len(trace)) * step)
    return dataclasses.replace(trace, time=np.maximum.accumulate(time + 1e-9 * np.arange(len(trace))))


def by_encoder(trace: Trace, step: float) -> Trace:
    """Quantise the position with an encoder's resolution [m]; the speed is then unknown."""
    assert trace.position is not None
    return dataclasses.replace(trace, position=np.round(trace.position / step) * step, speed=None)


def shifted_in_time(trace: Trace, seconds: float) -> Trace:
    """Start the clock elsewhere."""
    return dataclasses.replace(trace, time=trace.time + seconds)


_OTHER_UNITS = {
    "time": ("time_ms", 1e3), "force": ("force_mN", 1e3), "position": ("position_mm", 1e3),
    "speed": ("speed_cm_s", 1e2), "angle": ("angle_deg", 180.0 / math.pi), "depth": ("depth_um", 1e6),
}  # fmt: skip


def through_other_units(trace: Trace) -> Trace:
    """Write a file in units that are not SI, as another program would, and read it."""
    heads, factors = zip(*(_OTHER_UNITS[name] for name in trace.known), strict=True)
    columns = [getattr(trace, name) * factor for name, factor in zip(trace.known, factors, strict=True)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "record.csv"
        rows = (",".join(f"{value:.15g}" for value in row) for row in zip(*columns, strict=True))
        path.write_text("\n".join([",".join(heads), *rows]) + "\n")
        return load_one(path)


def _felt(trace: Trace, force: np.ndarray) -> Trace:
    return dataclasses.replace(trace, force=np.round(force / RESOLUTION) * RESOLUTION)


@dataclasses.dataclass(frozen=True, kw_only=True)
class Disturbance:
    """A disturbance of a record; its kind determines the bounds, None means that it must be refused."""

    name: str
    kind: str | None
    disturb: Callable[[Trace, np.random.Generator], Trace]


def disturbances() -> list[Disturbance]:
    """Return all rows of the table except those of another protocol."""
    rows: list[Disturbance] = []

    def add(name: str, kind: str | None, disturb: Callable[[Trace, np.random.Generator], Trace]) -> None:
        rows.append(Disturbance(name=name, kind=kind, disturb=disturb))

    add("in other units, through a file", "other units", lambda trace, _: through_other_units(trace))
    add("clock started elsewhere", "other clock", lambda trace, _: shifted_in_time(trace, 1234.5))
    for sd in (0.02, 0.05, NOISE):
        add(f"noise of {sd:g} N more", "noise", lambda trace, rng, sd=sd: noisier(trace, rng, sd))
    for rate in (RATES[0], 200.0, 500.0, 2000.0, 5000.0, RATES[1]):
        add(f"read at {rate:g} Hz", "sample rate", lambda trace, _, rate=rate: resampled(trace, rate))
    for zero in (-OFFSET, -0.05, 0.05, OFFSET):
        add(f"zero off by {zero:g} N", "offset", lambda trace, _, zero=zero: offset(trace, zero))
        if abs(zero) == OFFSET:
            add("  left in", "offset left in", lambda trace, _, zero=zero: offset_left_in(trace, zero))
    for lost in (0.005, 0.03, 0.1, 1.0):
        add(
            f"{1e3 * lost:g} ms lost", "gap", lambda trace, rng, lost=lost: with_gap(trace, rng.uniform(0.1, 0.4), lost)
        )
    for steps in (0.4, JITTER):
        add(
            f"stamps wrong by up to {steps:g} steps",
            "jitter",
            lambda trace, rng, steps=steps: jittered(trace, rng, steps),
        )
    for step in (10e-6, ENCODER):
        add(f"position by steps of {1e6 * step:g} um", "encoder", lambda trace, _, step=step: by_encoder(trace, step))
    add("sign of the force reversed", None, lambda trace, _: reversed_sign(trace))
    return rows


PROTOCOLS = {
    "back to the start half-way": (2 * INCH, 0.0, 4 * INCH, 0.0),
    "back twice, part of the way": (1.5 * INCH, 0.5 * INCH, 3 * INCH, 1 * INCH, 4 * INCH, 0.0),
}
"""Turning points of the blade [m] with return strokes before the last one."""


class Outcome(NamedTuple):
    """Results of the cuts under one disturbance."""

    moves: list[Numbers]
    refused: list[str]

    @property
    def worst(self) -> list[float]:
        """Largest change of each result; NaN where no record gives one."""
        largest = [
            [abs(value) for value in column if not math.isnan(value)] for column in zip(*self.moves, strict=True)
        ]
        return [max(column, default=math.nan) for column in largest] or [math.nan] * len(Numbers._fields)


def outcome(results: Iterable[tuple[Numbers | Refused, Numbers]]) -> Outcome:
    """Compare results of disturbed records with those before."""
    pairs = list(results)
    return Outcome(
        [after.moved(before) for after, before in pairs if isinstance(after, Numbers)],
        [after.reason for after, _ in pairs if isinstance(after, Refused)],
    )


def undisturbed(known: Known) -> Numbers:
    """Return the results of the undisturbed record."""
    numbers = known.measured()
    assert isinstance(numbers, Numbers), numbers
    return numbers


def outcomes() -> Iterator[tuple[str, str | None, Outcome]]:
    """Yield name, kind and outcome of every row of the table."""
    cuts = [record(*condition) for condition in CONDITIONS]
    before = [undisturbed(cut) for cut in cuts]
    for row in disturbances():
        after = [cut.measured(row.disturb(cut.trace, np.random.default_rng(n))) for n, cut in enumerate(cuts)]
        yield row.name, row.kind, outcome(zip(after, before, strict=True))
    for name, turns in PROTOCOLS.items():
        after = [record(*condition, turns).measured() for condition in CONDITIONS]
        yield name, "strokes", outcome(zip(after, before, strict=True))


def row_of(name: str, kind: str | None, found: Outcome) -> tuple[str, bool]:
    """Return one line of the table, and whether it is within the bounds."""
    refused = f"{len(found.refused)} of {len(found.refused) + len(found.moves)}" if found.refused else ""
    if kind is None:
        kept = not found.moves
        return f"{name:34s} {'':38s} {refused:9s}{'' if kept else ' MISSED: must be refused'}", kept
    kept = all(move.within(BOUNDS[kind]) for move in found.moves)
    moves = " ".join(f"{'-' if math.isnan(value) else f'{value:.4f}':>9s}" for value in found.worst)
    return f"{name:34s} {moves} {refused:9s}{'' if kept else ' MISSED'}", kept


def random_record(n: int) -> Known:
    """Sample a valid record, mildly noisy: 1 to 4 inches, 0.3 to 2.54 cm/s, 45 to 90 degrees, 3 of 4 with way back."""
    rng = np.random.default_rng(n)
    length = float(rng.uniform(1.0, 4.0)) * INCH
    return record.__wrapped__(
        1000 + n,
        float(np.exp(rng.uniform(math.log(0.003), math.log(SPEEDS[1])))),
        float(rng.uniform(45.0, 90.0)),
        (length, 0.0) if rng.random() < 0.75 else (length,),
        float(rng.uniform(0.005, 0.04)),
    )


def refusals(count: int) -> list[str]:
    """Return the reasons for which some of ``count`` valid records are refused."""
    results = (random_record(n).measured() for n in range(count))
    return [result.reason for result in results if isinstance(result, Refused)]


def main() -> int:
    """Print both tables; return 1 if a bound is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=1000, help="valid ones, of which the accepted are counted")
    arguments = parser.parse_args()
    heads = " ".join(f"{head:>9s}" for head in ("R", "LEM", "friction", "eta"))
    print(f"Largest move of a number among {len(CONDITIONS)} cuts: R and LEM relative, friction's share, eta90.\n")
    print(f"{'':34s} {heads} refused")
    missed = 0
    for name, kind, found in outcomes():
        line, kept = row_of(name, kind, found)
        missed += not kept
        print(line, flush=True)
    print("\nallowed")
    for kind, bounds in BOUNDS.items():
        print(f"{kind:34s} " + " ".join(f"{bound:9.2g}" for bound in dataclasses.astuple(bounds)))
    reasons = refusals(arguments.records)
    share = 1.0 - len(reasons) / arguments.records
    print(f"\n{100.0 * share:.1f} % of {arguments.records} valid records with mild noise are accepted.")
    for reason, times in Counter(re.sub(r"\d+", "n", reason.split(":")[0]) for reason in reasons).most_common():
        print(f"  {times} refused: {reason}")
    return int(missed > 0 or share < ACCEPTED)


if __name__ == "__main__":
    sys.exit(main())
