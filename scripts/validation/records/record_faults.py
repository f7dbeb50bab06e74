"""Measure how well ``cutenv check`` names faults: 20 kinds, each put into 50 clean records of simulated cuts.

Without options it prints the table of the page, of the published draw; ``--draw tuning`` that with which the thresholds
were set.
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Callable

import numpy as np

from cutenv._engine.randomness import generator
from cutenv.records.measurement.signal_faults import MAINS, Readings
from cutenv.records.scoring.record_check import record_faults
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.plant.protocol import Leg, run
from cutenv.sim.plant.simulator import SimulatedPlant
from cutenv.sim.tissue.specimen import Specimen

EACH, CLEAN = 50, 500  # records of each fault, and clean ones
DRAWS = {"tuning": 0, "published": 1_000_000}  # first seed of each draw
_LAG = 0.015  # [m] by which the crack tip of a cut stays behind the blade, at most
Faulty = Callable[[Readings, np.random.Generator], Readings]


def clean_record(seed: int, *, rate: float | None = None, hum: tuple[float, float] | None = None) -> Readings:
    """Cut a drawn specimen: rest, cut, draw back, rest; with a sensor of some noise, at 1000 to 100 readings a second.

    A specimen that a draw of angle and way has only stretched, and not cut, is replaced by the next one.
    ``hum`` is the amplitude [N] and the frequency [Hz] of a disturbance that the sensor reads.
    """
    rng = np.random.default_rng(seed)
    sensor = SensorParameters(
        force_noise=float(rng.choice([0.005, 0.01, 0.02, 0.035])),
        force_resolution=float(rng.choice([0.0, 0.001, 0.005, 0.01])),
        force_drift=float(rng.choice([0.0, 0.0, 0.002])),
    )
    kind = str(rng.choice(["liver", "vascular", "uniform"]))
    angle = math.radians(float(rng.choice([45.0, 60.0, 90.0])))
    speed, length = float(rng.uniform(0.004, 0.0254)), float(rng.uniform(0.03, 0.09))
    turns = [length, max(length - float(rng.uniform(0.015, 0.06)), 0.0)]
    if rng.random() < 0.3:
        turns = [0.5 * length, 0.3 * length, *turns]
    rests = [round(float(rng.uniform(0.7, longest)) / 1e-3) for longest in (2.0, 1.5)]
    for number in itertools.count():
        specimen = Specimen.draw(generator(seed, number), specimen_class=kind)
        plant = SimulatedPlant(specimen, sensor=sensor, seed=seed, angle=angle)
        before = plant.advance(0.0, angle, rests[0]).copy()
        cut = run(plant, [Leg(position=x, speed=speed, angle=angle, dwell=0.2) for x in turns])
        if float(cut["tip"].max()) > length - _LAG:
            break
    after = plant.advance(0.0, angle, rests[1]).copy()
    read = np.concatenate([before, cut, after])
    force = read["force"] + float(rng.uniform(-0.04, 0.04))
    if hum is not None:
        force = force + hum[0] * np.sin(2.0 * math.pi * (hum[1] * 1e-3 * np.arange(len(force)) + rng.random()))
    position = read["position"] + float(rng.choice([0.0, 5e-6])) * rng.standard_normal(len(read))
    stride = round(1000.0 / (float(rng.choice([1000.0, 500.0, 200.0, 100.0])) if rate is None else rate))
    kept = slice(None, None, stride)
    return Readings(
        time=1e-3 * np.arange(len(read))[kept],
        force=force[kept],
        position=position[kept],
        speed=read["speed"][kept] if rng.random() < 0.5 else None,
    )


def _amid(readings: Readings, rng: np.random.Generator) -> int:
    """Return a row amid the cut."""
    assert readings.position is not None
    moving = np.flatnonzero((readings.position > 0.2 * readings.position.max()) & (readings.force > 0.3))
    return int(rng.choice(moving[: max(1, round(0.7 * len(moving)))]))


def _rows(readings: Readings, kept: np.ndarray | slice) -> Readings:
    """Return some rows."""
    columns = ("time", "force", "position", "speed")
    some = {name: None if (all_ := getattr(readings, name)) is None else all_[kept] for name in columns}
    return Readings(**some, force_unit=readings.force_unit)


def _force(readings: Readings, force: np.ndarray) -> Readings:
    return dataclasses.replace(readings, force=force)


def frozen(readings: Readings, rng: np.random.Generator) -> Readings:
    """Hold one reading for 0.5 s to 3 s, while the blade goes on."""
    first, force = _amid(readings, rng), readings.force.copy()
    force[first : first + round(float(rng.uniform(0.5, 3.0)) / readings.step)] = force[first]
    return _force(readings, force)


def saturated(readings: Readings, rng: np.random.Generator) -> Readings:
    """Cut the force off at 55 to 85 % of its peak."""
    return _force(readings, np.minimum(readings.force, float(rng.uniform(0.55, 0.85)) * readings.force.max()))


def spike(readings: Readings, rng: np.random.Generator) -> Readings:
    """Put one to five readings far out, either way, one or two at a time."""
    force, span = readings.force.copy(), float(np.ptp(readings.force))
    for _ in range(int(rng.integers(1, 6))):
        first = int(rng.integers(5, len(force) - 5))
        force[first : first + int(rng.integers(1, 3))] += float(rng.choice([-1, 1]) * rng.uniform(0.5, 30.0)) * span
    return _force(readings, force.clip(-999.0, 999.0))


def gap(readings: Readings, rng: np.random.Generator) -> Readings:
    """Lose 0.2 s to 1 s amid the cut."""
    first, kept = _amid(readings, rng), np.ones(len(readings), bool)
    kept[first : first + round(float(rng.uniform(0.2, 1.0)) / readings.step)] = False
    return _rows(readings, kept)


def doubled(readings: Readings, rng: np.random.Generator) -> Readings:
    """Store a buffer twice, or each reading two to five times, or some rows twice."""
    kind, n = rng.integers(3), len(readings)
    if kind == 0:
        size = int(rng.integers(64, 257))
        first = int(rng.integers(0, n - size))
        order = np.concatenate([np.arange(first + size), np.arange(first, n)])
        return dataclasses.replace(_rows(readings, order), time=readings.step * np.arange(len(order)))
    if kind == 1:
        times = int(rng.integers(2, 6))
        held = _rows(readings, np.repeat(np.arange(n), times))
        return dataclasses.replace(held, time=readings.step / times * np.arange(n * times))
    return _rows(readings, np.sort(np.concatenate([np.arange(n), rng.integers(0, n, size=int(rng.integers(3, 40)))])))


def drift(readings: Readings, rng: np.random.Generator) -> Readings:
    """Let the zero wander by 25 to 80 % of the peak, evenly or as a sensor that warms up."""
    along = np.linspace(0.0, 1.0, len(readings))
    along = along if rng.random() < 0.5 else (1.0 - np.exp(-3.0 * along)) / (1.0 - math.exp(-3.0))
    size = float(rng.choice([-1, 1]) * rng.uniform(0.25, 0.8)) * max(float(readings.force.max()), 1.6)
    return _force(readings, readings.force + size * along)


def offset(readings: Readings, rng: np.random.Generator) -> Readings:
    """Add 0.3 N to 5 N throughout, either way."""
    return _force(readings, readings.force + float(rng.choice([-1, 1]) * rng.uniform(0.3, 5.0)))


def sign(readings: Readings, rng: np.random.Generator) -> Readings:
    """Mount the sensor the other way round."""
    return _force(readings, -readings.force)


def filtered(readings: Readings, rng: np.random.Generator) -> Readings:
    """Average over 0.1 s to 0.4 s, or filter at 2 Hz to 6 Hz (one or two poles), and round as a file does."""
    from scipy.signal import butter, sosfilt

    if rng.random() < 0.4:
        count = max(3, round(float(rng.uniform(0.1, 0.4)) / readings.step))
        force = np.convolve(np.pad(readings.force, (count - 1, 0), mode="edge"), np.ones(count) / count, mode="valid")
    else:
        low = butter(int(rng.integers(1, 3)), float(rng.uniform(2.0, 6.0)), fs=1.0 / readings.step, output="sos")
        force = np.asarray(sosfilt(low, readings.force))
    return _force(readings, np.round(force, int(rng.choice([3, 4, 6]))))


def clock_jump(readings: Readings, rng: np.random.Generator) -> Readings:
    """Set the clock by a second to an hour, forwards or back, amid the cut."""
    at, time = _amid(readings, rng), readings.time.copy()
    time[at:] += float(rng.choice([-1, 1])) * float(rng.choice([1.0, 2.0, 60.0, 3600.0]))
    return dataclasses.replace(readings, time=time)


def uneven_clock(readings: Readings, rng: np.random.Generator) -> Readings:
    """Stamp the readings when the program finds the time: in bursts, or late at random."""
    steps = np.diff(readings.time) * rng.choice([0.1, 1.0, 1.9], size=len(readings) - 1)
    if rng.random() < 0.5:
        burst = int(rng.integers(4, 9))
        late = burst - 0.2 * (burst - 1)
        steps = readings.step * np.where(np.arange(len(steps)) % burst == 0, late, 0.2)
    return dataclasses.replace(readings, time=np.concatenate(([0.0], np.cumsum(steps))), speed=None)


def rate(readings: Readings, rng: np.random.Generator) -> Readings:
    """Take milliseconds for seconds, or seconds for milliseconds, of a time or a counter."""
    factor = 1e3 if rng.random() < 0.5 else 1e-3
    factor *= 1e-3 if factor < 1.0 and readings.step > 5e-3 else 1.0
    return dataclasses.replace(readings, time=factor * readings.time, speed=None)


def quantised(readings: Readings, rng: np.random.Generator) -> Readings:
    """Read the force by a converter with 6 to 16 steps for its range."""
    step = float(np.ptp(readings.force)) / float(rng.uniform(6.0, 16.0))
    return _force(readings, step * np.round(readings.force / step))


def counts(readings: Readings, rng: np.random.Generator) -> Readings:
    """Store what the converter counts, of 10 to 24 bits, with an offset."""
    full = 2.0 ** int(rng.choice([10, 12, 16, 24]))
    scale = float(rng.uniform(0.1, 0.5)) * full / float(np.ptp(readings.force))
    return _force(readings, np.round(float(rng.uniform(0.0, 0.4)) * full + scale * readings.force))


def swapped(readings: Readings, rng: np.random.Generator) -> Readings:
    """Exchange the columns of force and position, in metres or millimetres."""
    assert readings.position is not None
    scale = float(rng.choice([1.0, 1e3]))
    return dataclasses.replace(readings, force=scale * readings.position, position=readings.force / scale, speed=None)


def cut_off(readings: Readings, rng: np.random.Generator) -> Readings:
    """End the record amid the cut, or begin it there."""
    at = _amid(readings, rng)
    assert readings.position is not None
    moving = np.flatnonzero(np.diff(readings.position, prepend=readings.position[0]) > 0.5 * 0.004 * readings.step)
    at = int(moving[np.argmin(np.abs(moving - at))])
    if rng.random() < 0.3 and len(readings) - at > 200:
        loaded = moving[readings.force[moving] > 0.5]
        at = int(loaded[np.argmin(np.abs(loaded - at))])
        return _rows(readings, slice(at, None))
    return _rows(readings, slice(0, max(at, 200)))


def two_cuts(readings: Readings, rng: np.random.Generator) -> Readings:
    """Save the cut of the next specimen in the same file, behind a pause."""
    following = clean_record(int(rng.integers(2**31)) + 2_000_000, rate=1.0 / readings.step)
    pause = readings.time[-1] + readings.step + following.time
    both = {"time": np.append(readings.time, pause), "force": np.append(readings.force, following.force)}
    assert readings.position is not None
    assert following.position is not None
    return Readings(**both, position=np.append(readings.position, following.position))


def speed(readings: Readings, rng: np.random.Generator) -> Readings:
    """Note a speed that the blade has not: half, double, or without its sign."""
    assert readings.position is not None
    true = np.gradient(readings.position, readings.time)
    return dataclasses.replace(readings, speed=float(rng.choice([0.5, 2.0, 3.0, -1.0])) * np.clip(true, -0.5, 0.5))


def _hum(seed: int, rng: np.random.Generator) -> Readings:
    size, hertz = float(rng.uniform(0.08, 0.6)), float(rng.choice(MAINS)) + float(rng.uniform(-0.05, 0.05))
    return clean_record(seed, rate=float(rng.choice([1000.0, 500.0, 200.0])), hum=(size, hertz))


def _aliased(seed: int, rng: np.random.Generator) -> Readings:
    size, hertz = float(rng.uniform(0.08, 0.6)), float(rng.choice(MAINS)) + float(rng.uniform(-0.05, 0.05))
    rates = (90.9, 71.4, 83.3, 40.0) if hertz < 55.0 else (100.0, 90.9, 71.4, 83.3)
    return clean_record(seed, rate=float(rng.choice(rates)), hum=(size, hertz))


FAULTS: dict[str, tuple[Faulty | None, str]] = {
    "frozen": (frozen, "one reading held for 0.5 s to 3 s of the cut"),
    "saturated": (saturated, "force cut off at 55 to 85 % of its peak"),
    "spike": (spike, "one to five times, one or two readings out by 0.5 to 30 times the range"),
    "gap": (gap, "0.2 s to 1 s of the cut lost"),
    "doubled": (doubled, "a buffer of 64 to 256 stored twice, each reading stored 2 to 5 times, or rows twice"),
    "drift": (drift, "zero wandered by 25 to 80 % of the peak, at least 0.4 N"),
    "offset": (offset, "0.3 N to 5 N added throughout"),
    "sign": (sign, "sensor mounted the other way round"),
    "aliasing": (None, "0.08 N to 0.6 N of mains hum at 40 to 100 readings a second"),
    "hum": (None, "the same at 200 to 1000 readings a second"),
    "filtered": (filtered, "mean over 0.1 s to 0.4 s, or a filter of 2 Hz to 6 Hz"),
    "clock jump": (clock_jump, "clock set by 1 s to 1 h, forwards or back"),
    "uneven clock": (uneven_clock, "stamped in bursts, or late at random"),
    "rate": (rate, "time wrong by a factor of 1000"),
    "quantised": (quantised, "6 to 16 steps for the range of the force"),
    "counts": (counts, "counts of a converter of 10 to 24 bits"),
    "swapped": (swapped, "columns of force and position exchanged"),
    "cut off": (cut_off, "ended amid the cut, or begun there"),
    "two cuts": (two_cuts, "the next specimen's cut in the same file"),
    "speed": (speed, "half, double, three times the speed, or the other sign"),
}
"""By the name that must be found: what puts it into a clean record, and how in words."""


def faulty_record(name: str, seed: int) -> Readings:
    """Return a record with this fault; the clean one below it is that of the same seed."""
    rng = np.random.default_rng((seed, sorted(FAULTS).index(name)))
    made = FAULTS[name][0]
    if made is not None:
        return made(clean_record(seed), rng)
    return (_aliased if name == "aliasing" else _hum)(seed, rng)


def names_of(readings: Readings) -> tuple[str, ...]:
    """Return the names of the faults found, each once."""
    return tuple(dict.fromkeys(fault.kind for fault in record_faults(readings)))


def counted(draw: str, each: int = EACH, clean: int = CLEAN) -> tuple[dict[str, list[tuple[str, ...]]], Counter[str]]:
    """Return the names found in every record by fault, and the names by which clean records are doubted."""
    first = DRAWS[draw]
    found = {
        name: [names_of(faulty_record(name, first + 10_000 * (k + 1) + n)) for n in range(each)]
        for k, name in enumerate(FAULTS)
    }
    doubted = Counter(names for n in range(clean) if (names := ", ".join(names_of(clean_record(first + n)))))
    return found, doubted


def table(draw: str = "published", each: int = EACH, clean: int = CLEAN) -> str:
    """Return the table of the page, as Markdown."""
    found, doubted = counted(draw, each, clean)
    lines = ["| fault | made by | found by its name | and another name beside it |", "| --- | --- | ---: | ---: |"]
    right, beside = 0, 0
    for name, records in found.items():
        hits = [names for names in records if name in names]
        more = sum(len(names) > 1 for names in hits)
        right, beside = right + len(hits), beside + more
        lines.append(f"| {name} | {FAULTS[name][1]} | {len(hits)} of {each} | {more} |")
    lines.append(f"| all | | {right} of {each * len(found)} ({right / (each * len(found)):.1%}) | {beside} |")
    bad = sum(doubted.values())
    what = f" ({', '.join(f'{name} {count}' for name, count in doubted.most_common())})" if doubted else ""
    lines += ["", f"Clean records doubted: {bad} of {clean} ({bad / clean:.1%}){what}."]
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draw", choices=DRAWS, default="published")
    print(table(parser.parse_args().draw))
