"""Plain Python, compiled for one cut, compiled for rows of cuts: the same law.

Run as a program, with Numba switched off, this file is the plain Python: it reads cases and answers.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from led_cut import UPRIGHT, changed_law, constant_feed, homogeneous, lead, lead_by, liver

import cutenv
from cutenv._engine.parallel import parallel_for
from cutenv._engine.randomness import generator
from cutenv.sim.cutting.drive import Hand, Rig
from cutenv.sim.cutting.dtypes import DRIVE, LAW, PROFILE, READING, STATE, TICK, law_records, new_state, profile_records
from cutenv.sim.cutting.law import LONGEST_ADVANCE
from cutenv.sim.cutting.motion import NOTHING, STRAIGHT
from cutenv.sim.cutting.row import LANES
from cutenv.sim.cutting.sensor import SENSOR, SensorParameters, sensor_records
from cutenv.sim.cutting.simulate import CUT, Physics, hold, hold_some
from cutenv.sim.plant import SimulatedPlant
from cutenv.sim.tissue.specimen import Specimen

Cases = dict[str, Any]
DTYPES = {
    "states": STATE,
    "profiles": PROFILE,
    "laws": LAW,
    "drives": DRIVE,
    "sensors": SENSOR,
    "readings": READING,
    "motions": NOTHING,
    "shared": NOTHING,
}
HOLD, NOT_SHARED, NO_FORCES = hold(STRAIGHT), np.zeros(1, NOTHING), np.zeros(0)
CUTS, COMMANDS, TICKS = 24, 60, 2400
EVERY = TICKS // COMMANDS


def driven_cuts() -> Cases:
    """Cuts of drawn specimens by rigs and hands under random commands, at rest at the clamp."""
    rng = generator(21)
    kinds = ["liver", "vascular", "uniform"]
    specimens = [Specimen.draw(rng, specimen_class=kinds[i % 3], tissue=liver()) for i in range(CUTS)]
    noisy = SensorParameters(force_drift=0.01)
    return {
        "states": new_state(CUTS, UPRIGHT),
        "profiles": profile_records(specimens),
        "laws": law_records(specimens),
        "drives": np.concatenate([(Hand() if i % 4 == 3 else Rig()).records(0.1495) for i in range(CUTS)]),
        "sensors": sensor_records([noisy] * CUTS, list(range(CUTS)), [5] * CUTS),
        "speeds": rng.uniform(-0.008, 0.0254, (CUTS, COMMANDS)) + 0.0,
        "angles": UPRIGHT * rng.uniform(0.5, 1.0, (CUTS, COMMANDS)),
        "readings": np.zeros((CUTS, TICKS), READING),
        "motions": np.zeros(CUTS, NOTHING),
        "shared": np.zeros(CUTS, NOTHING),
    }


def copied(cases: Cases) -> Cases:
    return {name: values.copy() for name, values in cases.items()}


def single(cases: Cases, n: int) -> Any:
    """Cut ``n`` of the cases as one record."""
    cut = np.zeros(1, CUT)
    for name in Physics._fields[:-1]:
        cut[name] = cases[name][n]
    return cut


def one_by_one(cases: Cases, pieces: int = 1) -> Cases:
    """Each cut by :func:`hold`, every command in so many calls."""
    c = copied(cases)
    for n in range(len(c["states"])):
        cut = single(c, n)
        for speed, angle, readings in zip(
            c["speeds"][n], c["angles"][n], np.split(c["readings"][n], c["speeds"].shape[1]), strict=True
        ):
            for piece in np.array_split(readings, pieces):
                HOLD(cut, NOT_SHARED, (float(speed), float(angle), 0.0), piece, NO_FORCES)
        for name in ("states", "sensors"):
            c[name][n] = cut[name][0, 0]
    return c


def instants(cases: Cases) -> Cases:
    """One update from each of many states along the cuts: random ones, and those before every tenth run."""
    rng = np.random.default_rng(3)
    picked: dict[str, list[Any]] = {name: [] for name in cases}
    jumps = one_by_one(cases)["readings"]["jump"]
    for n in range(len(cases["states"])):
        chosen = set(rng.choice(TICKS, 8, replace=False).tolist()) | set(np.flatnonzero(jumps[n] > 0.0)[::10].tolist())
        cut, reading = single(cases, n), np.zeros(1, READING)
        for tick in range(TICKS):
            speed, angle = (float(cases[name][n, tick // EVERY]) for name in ("speeds", "angles"))
            if tick in chosen:
                now = {name: cut[name][0].copy() for name in Physics._fields[:-1]} | {"shared": NOT_SHARED}
                now |= {"speeds": [[speed]], "angles": [[angle]], "readings": np.zeros((1, 1), READING)}
                for name, values in now.items():
                    picked[name].append(values)
            HOLD(cut, NOT_SHARED, (speed, angle, 0.0), reading, NO_FORCES)
    return {name: np.concatenate(values) for name, values in picked.items()}


def plain_python(cases: Cases, folder: Path) -> Cases:
    """What the same functions answer without Numba's compiler, in a process of their own."""
    np.savez(folder / "cases.npz", **cases)
    command = [sys.executable, __file__, str(folder / "cases.npz"), str(folder / "answers.npz")]
    places = [str(Path(cutenv.__file__).parents[1]), str(Path(__file__).parents[2])]
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(places)}
    subprocess.run(command, check=True, env=environment)
    return load(folder / "answers.npz")


def load(file: Path) -> Cases:
    with np.load(file) as stored:
        return {name: stored[name].astype(DTYPES.get(name, stored[name].dtype)) for name in stored.files}


def numbers(records: Any) -> np.ndarray:
    """Every field of records that is one number as float64, shape (n_fields, ...)."""
    fields = [name for name in records.dtype.names if not records.dtype[name].shape]
    return np.stack([np.asarray(records[name], dtype=float) for name in fields])


def in_rows(cases: Cases) -> Cases:
    """The same by rows of cuts on all cores; ``felt`` are the forces at the ends of the commands."""
    c = copied(cases)
    felt, last = np.zeros(c["speeds"].shape), np.zeros((len(c["speeds"]), 2))
    physics = Physics(*(c[name] for name in Physics._fields))
    for k in range(COMMANDS):
        commands = np.stack((c["speeds"][:, k], c["angles"][:, k], 0.0 * c["angles"][:, k]), axis=1)
        parallel_for(hold_some(STRAIGHT), len(last), physics, commands, EVERY, last, fewest=1)
        felt[:, k] = last[:, 0]
    return c | {"felt": felt}


def check_one_update(ours: Cases, theirs: Cases) -> None:
    for name in ("states", "readings", "sensors"):
        a, b = numbers(ours[name]), numbers(theirs[name])
        assert np.array_equal(np.isinf(a), np.isinf(b))
        assert np.abs(np.where(np.isinf(a), 0.0, a) - np.where(np.isinf(b), 0.0, b)).max() <= 1e-9


def check_whole_cut(ours: Cases, theirs: Cases) -> None:
    """Thresholds amplify rounding: over a cut compare the number of units and the length of the crack."""
    assert np.array_equal(ours["states"]["units"], theirs["states"]["units"])
    assert ours["states"]["tip"] == pytest.approx(theirs["states"]["tip"], abs=1e-6)


def check_bit_for_bit(rows: Cases, one: Cases) -> None:
    """State, memory of the sensor and the force at the end of every command."""
    felt = one["felt"] if "felt" in one else one["readings"]["force"][:, EVERY - 1 :: EVERY]
    assert rows["states"].tobytes() == one["states"].tobytes()
    assert rows["sensors"].tobytes() == one["sensors"].tobytes()
    assert rows["felt"].tobytes() == felt.tobytes()


@pytest.fixture(scope="module")
def cases() -> Cases:
    return driven_cuts()


@pytest.fixture(scope="module")
def many(cases: Cases) -> Cases:
    """More cuts than a row holds, not a whole number of rows, among them all that is special."""
    many = {name: np.concatenate((values, values[::-1])) for name, values in cases.items()}
    many["drives"]["dead_ticks"][::5] = 7
    many["drives"]["backlash"][many["drives"]["mass"] == 0.0] = 1e-4
    many["laws"]["relaxing_share"][2::6] = 0.4
    many["drives"]["acceleration"][1::7] = 1e3  # [m/s2]: their blades leap, and the growth of their cracks is divided
    many["drives"]["lag"][1::7] = TICK
    many["speeds"][1::7] *= 20.0
    assert LANES < len(many["states"]) < 2 * LANES
    return many


def test_from_equal_state_one_update_agrees_in_plain_python_and_compiled(cases, tmp_path):
    moments = instants(cases)
    assert len(moments["states"]) > 200
    compiled, plain = one_by_one(moments), plain_python(moments, tmp_path)
    assert (compiled["readings"]["jump"] > 0.0).sum() >= 10
    check_one_update(compiled, plain)
    tougher = copied(moments)
    tougher["profiles"]["toughness"] *= 1.0 + 1e-6
    with pytest.raises(AssertionError):
        check_one_update(one_by_one(tougher), plain)


def test_over_a_cut_plain_python_and_compiled_agree_on_units_and_crack(cases, tmp_path):
    few = {name: values[2:4] for name, values in cases.items()}
    plain = plain_python(few, tmp_path)
    assert plain["states"]["units"].sum() >= 2 * 3
    check_whole_cut(one_by_one(few), plain)
    tougher = copied(few)
    tougher["profiles"]["toughness"] *= 1.01
    with pytest.raises(AssertionError):
        check_whole_cut(one_by_one(tougher), plain)


@pytest.mark.parametrize("pieces", [1, 3], ids=["a call for each command", "three calls, of 14, 13 and 13 ms"])
def test_rows_of_cuts_are_equal_to_single_ones_bit_for_bit(many, pieces):
    one = one_by_one(many, pieces)
    advances = np.diff(one["readings"]["tip"][1::7], axis=1) - one["readings"]["jump"][1::7, 1:]
    assert (advances > LONGEST_ADVANCE).sum() > 100
    assert one["states"]["units"].max() >= 3
    check_bit_for_bit(in_rows(many), one)
    nearly = copied(many)
    nearly["laws"]["eta90"][0] *= 1.0 + 1e-15
    with pytest.raises(AssertionError):
        check_bit_for_bit(in_rows(nearly), one)


def test_the_order_in_a_batch_and_repetition_change_nothing(many):
    once = in_rows(many)
    check_bit_for_bit(in_rows(many), once)
    backwards = in_rows({name: values[::-1].copy() for name, values in many.items()})
    check_bit_for_bit({name: values[::-1] for name, values in backwards.items()}, once)


def test_following_a_path_is_the_law_that_the_other_checks_use():
    """Led instant by instant, led by one call, and in plain Python."""
    path = constant_feed(0.0254, to=0.05)
    led, plain = lead(homogeneous(), path), lead_by(changed_law(), homogeneous(), path)
    plant = SimulatedPlant(homogeneous())
    assert plant.lead(path, UPRIGHT).tobytes() == led.readings.tobytes()
    assert plant.states.tobytes() == led.states[-1:].tobytes()
    assert numbers(plain.states[1:]) == pytest.approx(numbers(led.states[1:]), abs=1e-9)


if __name__ == "__main__":
    np.savez(sys.argv[2], **one_by_one(load(Path(sys.argv[1]))))
