"""Plain Python, compiled for one cut, compiled for many: the same law.

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
from cutenv._engine.work_queue import make_queue
from cutenv.cutting.abreast import hold_some
from cutenv.cutting.drive import Hand, Rig, lag_gain
from cutenv.cutting.dtypes import DRIVE, LAW, PROFILE, READING, STATE, TICK, new_state
from cutenv.cutting.law import LONGEST_ADVANCE
from cutenv.cutting.parameters import law_records, profile_records
from cutenv.cutting.row import ABREAST
from cutenv.cutting.sensor import SENSOR, SensorParameters, sensor_records
from cutenv.cutting.simulate import follow, simulate, simulate_some, update
from cutenv.tissue.specimen import Specimen

Cases = dict[str, Any]
DTYPES = {
    "states": STATE,
    "profiles": PROFILE,
    "laws": LAW,
    "drives": DRIVE,
    "sensors": SENSOR,
    "readings": READING,
}
CUTS, COMMANDS, TICKS = 24, 60, 2400


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
    }


def copied(cases: Cases) -> Cases:
    return {name: values.copy() for name, values in cases.items()}


def one_by_one(cases: Cases) -> Cases:
    c = copied(cases)
    for n in range(len(c["states"])):
        simulate(*(c[name][n] for name in ORDER), TICK, c["readings"][n])
    return c


ORDER = ("states", "profiles", "laws", "drives", "sensors", "speeds", "angles")


def instants(cases: Cases) -> Cases:
    """One update from each of many states along the cuts: random ones, and those before every tenth run."""
    rng = np.random.default_rng(3)
    picked: dict[str, list[Any]] = {name: [] for name in (*ORDER, "readings")}
    for n in range(len(cases["states"])):
        c = copied({name: values[n : n + 1] for name, values in cases.items()})
        chosen = set(rng.choice(TICKS, 8, replace=False).tolist())
        chosen |= set(np.flatnonzero(one_by_one(c)["readings"]["jump"][0] > 0.0)[::10].tolist())
        for tick in range(TICKS):
            k = tick // (TICKS // COMMANDS)
            command = {"speeds": c["speeds"][:, k : k + 1], "angles": c["angles"][:, k : k + 1]}
            now = {name: c[name] for name in ORDER} | command
            if tick in chosen:
                for name, values in now.items():
                    picked[name].append(values.copy())
                picked["readings"].append(np.zeros((1, 1), READING))
            record = [now[name][0] for name in ORDER[:5]]
            update(
                *record,
                lag_gain(record[3], TICK),
                float(command["speeds"][0, 0]),
                float(command["angles"][0, 0]),
                TICK,
                c["readings"][0, 0],
            )
    return {name: np.concatenate(values) for name, values in picked.items()}


def plain_python(cases: Cases, folder: Path, way: str = "one_by_one") -> Cases:
    """What the same functions answer without Numba's compiler, in a process of their own."""
    np.savez(folder / "cases.npz", **cases)
    command = [sys.executable, __file__, way, str(folder / "cases.npz"), str(folder / "answers.npz")]
    places = [str(Path(cutenv.__file__).parents[1]), str(Path(__file__).parents[1])]
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


def abreast(cases: Cases, ticks: int) -> Cases:
    """The same by rows of cuts, each of the commands for so many updates; ``felt`` are the forces at their ends."""
    c = copied(cases)
    felt = np.zeros(c["speeds"].shape)
    for k in range(felt.shape[1]):
        commands, last = np.stack((c["speeds"][:, k], c["angles"][:, k]), axis=1), np.zeros(len(felt))
        hold_some(make_queue(len(felt)), 0, *(c[name] for name in ORDER[:5]), commands, ticks, last)
        felt[:, k] = last
    return c | {"felt": felt}


def check_abreast(rows: Cases, single: Cases) -> None:
    assert rows["states"].tobytes() == single["states"].tobytes()
    for name in ("line", "offset"):
        assert np.array_equal(rows["sensors"][name], single["sensors"][name])
    every = single["readings"].shape[1] // rows["felt"].shape[1]
    assert np.array_equal(rows["felt"], single["readings"]["force"][:, every - 1 :: every])


def check_one_update(ours: Cases, theirs: Cases) -> None:
    for name in ("states", "readings", "sensors"):
        a, b = numbers(ours[name]), numbers(theirs[name])
        assert np.array_equal(np.isinf(a), np.isinf(b))
        assert np.abs(np.where(np.isinf(a), 0.0, a) - np.where(np.isinf(b), 0.0, b)).max() <= 1e-9


def check_whole_cut(ours: Cases, theirs: Cases) -> None:
    """Thresholds amplify rounding: over a cut compare the number of units and the length of the crack."""
    assert np.array_equal(ours["states"]["units"], theirs["states"]["units"])
    assert ours["states"]["tip"] == pytest.approx(theirs["states"]["tip"], abs=1e-6)


def check_bit_for_bit(ours: Cases, theirs: Cases) -> None:
    for name in ("states", "readings", "sensors"):
        assert ours[name].tobytes() == theirs[name].tobytes()


@pytest.fixture(scope="module")
def cases() -> Cases:
    return driven_cuts()


@pytest.fixture(scope="module")
def moments(cases: Cases) -> Cases:
    return instants(cases)


def test_from_equal_state_one_update_agrees_in_plain_python_and_compiled(moments, tmp_path):
    assert len(moments["states"]) > 200
    compiled, plain = one_by_one(moments), plain_python(moments, tmp_path)
    assert (compiled["readings"]["jump"] > 0.0).sum() >= 10
    check_one_update(compiled, plain)
    tougher = copied(moments)
    tougher["profiles"]["toughness"] *= 1.0 + 1e-6
    with pytest.raises(AssertionError):
        check_one_update(one_by_one(tougher), plain)


def test_over_a_cut_plain_python_and_compiled_agree_on_units_and_crack(cases, tmp_path):
    few = {name: values[:6] for name, values in cases.items()}
    plain = plain_python(few, tmp_path)
    assert plain["states"]["units"].sum() >= 6 * 3
    check_whole_cut(one_by_one(few), plain)
    tougher = copied(few)
    tougher["profiles"]["toughness"] *= 1.01
    with pytest.raises(AssertionError):
        check_whole_cut(one_by_one(tougher), plain)


def batch(cases: Cases) -> Cases:
    c = copied(cases)
    parallel_for(simulate_some, CUTS, *(c[name] for name in ORDER), TICK, c["readings"])
    return c


def test_one_cut_and_a_batch_of_cuts_are_equal_bit_for_bit(cases):
    single = one_by_one(cases)
    check_bit_for_bit(batch(cases), single)
    nearly = copied(cases)
    nearly["laws"]["eta90"][0] *= 1.0 + 1e-15
    with pytest.raises(AssertionError):
        check_bit_for_bit(batch(nearly), single)


def test_rows_of_cuts_are_equal_to_single_ones_bit_for_bit(cases):
    many = {name: np.concatenate((values, values[::-1])) for name, values in cases.items()}
    many["drives"]["dead_ticks"][::5] = 7
    many["drives"]["backlash"][many["drives"]["mass"] == 0.0] = 1e-4
    many["laws"]["relaxing_share"][2::6] = 0.4
    many["drives"]["acceleration"][1::7] = 1e3  # [m/s2]: their blades leap, and the growth of their cracks is divided
    many["drives"]["lag"][1::7] = TICK
    many["speeds"][1::7] *= 20.0
    assert ABREAST < len(many["states"]) < 2 * ABREAST
    single = one_by_one(many)
    advances = np.diff(single["readings"]["tip"][1::7], axis=1) - single["readings"]["jump"][1::7, 1:]
    assert (advances > LONGEST_ADVANCE).sum() > 100
    assert single["states"]["units"].max() >= 3
    # Readings of a blade behind a backlash tell of the carriage; its state, of the blade.
    check_abreast(abreast(many, TICKS // COMMANDS), single)
    nearly = copied(many)
    nearly["laws"]["eta90"][0] *= 1.0 + 1e-15
    with pytest.raises(AssertionError):
        check_abreast(abreast(nearly, TICKS // COMMANDS), single)


def test_from_equal_state_a_row_agrees_in_plain_python_and_compiled(moments, tmp_path):
    few = {name: values[: ABREAST + 8] for name, values in moments.items()}
    plain, compiled = plain_python(few, tmp_path, "abreast"), abreast(few, 1)
    assert (compiled["states"]["running"] == 1).any()
    for ours, theirs in ((compiled["states"], plain["states"]), (compiled["sensors"], plain["sensors"])):
        a, b = numbers(ours), numbers(theirs)
        finite = np.isfinite(a)
        assert np.array_equal(finite, np.isfinite(b))
        assert np.abs(a[finite] - b[finite]).max() <= 1e-9
    assert np.abs(compiled["felt"] - plain["felt"]).max() <= 1e-9


def test_the_order_in_a_batch_and_repetition_change_nothing(cases):
    once = batch(cases)
    check_bit_for_bit(batch(cases), once)
    backwards = batch({name: values[::-1].copy() for name, values in cases.items()})
    check_bit_for_bit({name: values[::-1].copy() for name, values in backwards.items()}, once)


def test_following_a_path_is_the_law_that_the_other_checks_use(cases):
    path = constant_feed(0.0254, to=0.05)
    led, plain = lead(homogeneous(), path), lead_by(changed_law(), homogeneous(), path)
    followed = {"states": new_state(1, UPRIGHT), "readings": np.zeros(len(path), READING)}
    angles = np.full(len(path), UPRIGHT)
    follow(followed["states"][0], led.profile, led.law, path, angles, TICK, followed["readings"])
    assert np.array_equal(followed["readings"]["elastic_force"], led.readings["elastic_force"])
    assert numbers(plain.states[1:]) == pytest.approx(numbers(led.states[1:]), abs=1e-9)


if __name__ == "__main__":
    given = load(Path(sys.argv[2]))
    np.savez(sys.argv[3], **(one_by_one(given) if sys.argv[1] == "one_by_one" else abreast(given, 1)))
