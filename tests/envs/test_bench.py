"""The benchmarks measure what they say, whatever the machine; a run can be kept, and a later one held against it."""

from __future__ import annotations

import gc
import json
import math
import re
import subprocess
import sys
from datetime import datetime

import numpy as np
import pytest

import cutenv
from cutenv.sim.plant import SimulatedPlant
from cutenv.sim.tissue import Specimen
from cutenv.sim.tissue.lines import half_ellipse
from scripts.benchmarks.speed import (
    BENCHMARKS,
    batch,
    bench,
    calibration,
    environment,
    factorisation,
    field,
    first_use,
    freehand,
    gymnasium_vectors,
    limits,
    machine,
    measurement,
    models,
    picture,
    ppo,
    reading,
    record,
    steering,
    third_action,
    tick,
    vertical_motion,
)
from scripts.benchmarks.speed.comparison import compared
from scripts.benchmarks.speed.measured import Measured, Number
from scripts.benchmarks.speed.record import Record

WHOLE_BATCHES = {
    "gentle": lambda: batch.rates(64, rounds=1),
    **{
        f"descent, {name}": lambda motion=motion: vertical_motion.descending_rates(motion, 64, rounds=1)
        for name, motion in vertical_motion.MOTIONS.items()
    },
    **{
        f"steering, {name}": lambda motion=motion: steering.steered_rates(half_ellipse(), motion, 64, rounds=1)
        for name, motion in steering.MOTIONS.items()
    },
    **{
        f"{task}, {name}": lambda task=task, motion=motion: third_action.rates_beside(
            task, motion, 64, steps=3, rounds=1
        )
        for task, motions in third_action.MOTIONS.items()
        for name, motion in motions.items()
    },
}


@pytest.mark.parametrize("name", WHOLE_BATCHES)
def test_rates_are_of_whole_batches(name):
    assert min(WHOLE_BATCHES[name]()) > 0.0


def test_loops_of_a_plant_are_timed_beside_an_empty_one():
    found = freehand.loops(updates=40)
    assert [len(each) for each in found.values()] == [40, 40, 40]
    assert all(each.min() > 0.0 for each in found.values())
    assert sys.getswitchinterval() > freehand.SWITCH_INTERVAL
    assert freehand.node_times((8, 15)).min() > 0.0


@pytest.mark.parametrize("other", [gymnasium_vectors.SYNC, gymnasium_vectors.ASYNC, gymnasium_vectors.NATIVE])
def test_gymnasiums_vectors_are_stepped_whole(other, monkeypatch):
    monkeypatch.setattr(gymnasium_vectors, "_STRETCH_S", 0.005)
    assert 0.0 < gymnasium_vectors.step_rate(other, 2)


def test_operations_are_counted_in_the_law_itself():
    counted = limits.operations_per_update()
    assert {"additions", "multiplications", "divisions", "comparisons"} <= set(counted)
    assert 3.0 <= counted["divisions"] <= 12.0
    assert 50.0 < sum(counted.values()) < 500.0


def test_an_update_leaves_no_memory_behind():
    plant = SimulatedPlant(Specimen.mean())
    for _ in range(100):
        plant.advance(0.005, 1.0, 1)
    gc.collect()
    before = sys.getallocatedblocks()
    for _ in range(5000):
        plant.advance(0.005, 1.0, 1)
    assert sys.getallocatedblocks() - before < 50


def test_the_first_use_is_timed_in_a_process_that_keeps_what_it_compiles(tmp_path):
    program = "import os; print('said by others'); print(len(os.environ['NUMBA_CACHE_DIR']))"
    assert first_use.seconds(program, tmp_path) == len(str(tmp_path))
    assert 0.0 < first_use.trifle()
    with pytest.raises(subprocess.CalledProcessError):
        first_use.seconds("raise SystemExit(2)", tmp_path)


def test_resets_are_timed_beside_gymnasiums():
    times = environment.reset_times(resets=2, rounds=2)
    assert set(times) == {"cutenv/GentleCut-v1", "Pendulum-v1", "CartPole-v1"}
    assert all(microseconds > 0.0 for microseconds in times.values())


def test_pictures_of_the_environment_and_of_play_are_timed(monkeypatch):
    monkeypatch.setattr(picture, "_ROUNDS", 3)  # the fastest of one may have waited for another program
    times = picture.picture_times()
    assert set(times) == {"render", "play", "copy"}
    assert min(times["render"], times["play"]) > times["copy"] > 0.0


def test_displacements_are_timed_from_clamp_to_end_on_the_meshes_of_the_thesis():
    found = field.field_times(field.MESHES[0], updates=20)
    assert found.n_equations == 876
    assert found.nodes.shape == found.product.shape == found.lattice.shape == (20,)
    assert np.median(found.product) < np.median(found.nodes) < np.median(found.lattice)


def test_each_model_is_timed_beside_the_size_printed_in_table_4_3(monkeypatch):
    monkeypatch.setattr(models, "LEVELS", {name: models.LEVELS[name] for name in ("quad4", "quad8")})
    found = models.level_times(rounds=1)
    assert [times.n_equations for times in found.values()] == [320, 876]
    assert all(min(times.analysis, times.whole) > 0.0 for times in found.values())


def test_a_session_is_read_from_files_and_calibrated():
    records = calibration.session(livers=2, speeds=(0.0038, 0.0254))
    assert [record.metadata["specimen"] for record in records] == ["liver 1"] * 4 + ["liver 2"] * 4
    found = calibration.session_times(records)
    assert (found.cuts, found.readings) == (8, sum(len(record) for record in records))
    assert min(found.reading, found.measuring, found.together) > 0.0


def factorising(divisions: tuple[int, int], repeats: int) -> factorisation.FactorisationSpeedup:
    return {
        "divisions": divisions, "n_tips": 15, "n_equations": 876, "per_tip_s": 0.1, "one_factorisation_s": 0.01,
        "one_factorisation_with_slips_s": 0.02, "speedup": 10.0, "speedup_with_slips": 5.0,
        "largest_difference": 1e-14, "largest_difference_with_slips": 1e-14,
    }  # fmt: skip


@pytest.fixture
def made_up(monkeypatch):
    """Nothing is measured: every benchmark gets numbers that were made up."""
    names = ("cutenv/GentleCut-v1", "Pendulum-v1", "CartPole-v1")
    uses = {"one environment": first_use.FirstUse(4.0, 1.0), "a batch of 64": first_use.FirstUse(8.0, 1.5)}
    monkeypatch.setattr(first_use, "first_uses", lambda: uses)
    monkeypatch.setattr(first_use, "trifle", lambda: 0.2)
    monkeypatch.setattr(environment, "step_times", lambda: dict(zip(names, (3.0, 2.0, 1.0), strict=True)))
    monkeypatch.setattr(environment, "reset_times", lambda: dict.fromkeys(names, 50.0))
    monkeypatch.setattr(batch, "rates", lambda count: batch.Rates(1.0e6, 2.0e6, 0.5e6, 1.0e5))
    monkeypatch.setattr(batch, "step_rate", lambda other, count: 1.0e4)
    monkeypatch.setattr(batch, "limits", lambda native, bare: Measured({"bytes": Number(2816, "byte")}, ["limits"]))
    bare = vertical_motion.BareRates(5.0e7, 8.0e7)
    monkeypatch.setattr(vertical_motion, "descending_rates", lambda motion: bare)
    monkeypatch.setattr(steering, "steered_rates", lambda line, motion: bare)
    monkeypatch.setattr(freehand, "node_times", lambda divisions: np.full(9, 0.005))
    late = {freehand.EMPTY: 2e-6, "stiffness from a table": 2e-5, freehand.THREADED: 9e-5}
    monkeypatch.setattr(freehand, "loops", lambda: {name: np.full(100, value) for name, value in late.items()})
    whole = third_action.RatesBeside(4.0e5, 1.0e6)
    monkeypatch.setattr(third_action, "rates_beside", lambda task, motion: whole)
    monkeypatch.setattr(tick, "durations", lambda: (np.full(1000, 50_000), np.full(1000, 100), 0))
    monkeypatch.setattr(picture, "picture_times", lambda: {"render": 0.01, "play": 0.02, "copy": 0.001})
    slow = np.full(100, 3000.0)
    monkeypatch.setattr(field, "field_times", lambda divisions: field.FieldTimes(876, 30.0, slow, slow / 9, slow * 2))
    levels = {name: models.LevelTimes(100 * n, 3.0 * n, 1.0 * n) for n, name in enumerate(models.LEVELS, 1)}
    monkeypatch.setattr(models, "level_times", lambda: levels)
    monkeypatch.setattr(factorisation, "factorisation_speedup", factorising)
    monkeypatch.setattr(calibration, "session", lambda: [])
    monkeypatch.setattr(
        calibration, "session_times", lambda records: calibration.SessionTimes(84, 2_680_000, 4.0, 5.0, 1.0)
    )
    monkeypatch.setattr(ppo, "missing", lambda: None)
    read = {"numpy.loadtxt": 0.1, ".csv": 0.31, ".parquet": 0.01, ".h5": 0.25}
    monkeypatch.setattr(reading, "reading_times", lambda traces: read)
    speed = {"decisions": 65536.0, "decisions_per_s": 12345.0, "environments_share": 0.25}
    monkeypatch.setattr(ppo, "training_speed", lambda program: speed)


@pytest.mark.usefixtures("made_up")
@pytest.mark.parametrize(
    ("name", "missed", "said"),
    [
        ("first", 1, "one environment: 4.0 s, 20 x a function of one line; next 1.0 s; within the 5 s allowed"),
        ("first", 1, "a batch of 64: 8.0 s, 40 x a function of one line; next 1.5 s; MISSED: the 5 s allowed"),
        ("step", 1, "1.50 x Pendulum-v1   reset   50.0"),
        (
            "batch",
            2,
            "100 times SyncVectorEnv of Pendulum-v1 at 1024 (10 thousand/s; the bare loop alone 200 times): at",
        ),
        ("batch", 2, "as much as 10.0 steps of the batch; within the 100 allowed"),
        ("batch", 2, "  65536    1000.0         -         -      10.0      0.50            2.00"),
        ("batch", 2, "     16    1000.0      10.0      10.0      10.0      0.50            2.00"),
        ("descent", 0, "  pressing down                             20             12     1.6"),
        (
            "depth",
            3,
            "pressing down: 400 thousand decisions a second, 2.5 times GentleCut-v1's time; MISSED: the 2 allowed",
        ),
        ("freehand", 1, "  88 us later than an empty loop at p99.9; MISSED: the 20 us allowed"),
        ("freehand", 1, "  elements of 5 mm: 5.0 ms, at most 5.0 ms"),
        ("tick", 1, "99.9 % are within 49.9 us of the empty loop's; MISSED: the 20 us allowed"),
        ("picture", 1, "play: 20.0 ms, 20 times a copy of the picture; MISSED: the 16.7 ms allowed"),
        ("field", 2, "99 % in 3000 us, 18.0 % of a picture's time; MISSED: the 10 % allowed"),
        ("models", 0, "quad8          200        0.667      0.1          6.0 ms  0.667"),
        ("factorisation", 1, "10.0 times faster (MISSED: required 15)"),
        ("factorisation", 1, "10.0 times faster (required 8)"),
        ("reading", 1, ".csv: 310 ms, 3.10 of it; MISSED: the 3 allowed"),
        ("calibration", 1, "84 cuts of 2.7 million readings, 400 resamples: reading their CSV files 4.0 s"),
        ("calibration", 1, "calibrating takes 1.50 times as long as reading; MISSED: the time of reading allowed"),
        ("ppo", 1, "12345 decisions a second over 65536"),
        ("ppo", 1, "the environments take 25 % of the time; MISSED: the 10 % allowed"),
    ],
)
def test_each_prints_a_verdict_by_its_own_numbers(name, missed, said, capsys):
    assert bench.main([name]) == 0
    printed = capsys.readouterr().out
    assert printed.count("MISSED") == missed
    assert said in printed


@pytest.mark.usefixtures("made_up")
@pytest.mark.parametrize("name", BENCHMARKS)
def test_each_has_finite_numbers_with_units_beside_its_lines(name):
    measured = measurement(name)()
    assert measured.numbers
    assert all(math.isfinite(number.value) and number.unit for number in measured.numbers.values())


def test_without_the_learner_ppo_names_the_pip_command(monkeypatch):
    monkeypatch.setattr(ppo, "find_spec", lambda name: None if name == "torch" else object())
    assert ppo.missing() == "torch not installed: pip install 'cutenv[rl]'"


def test_a_program_that_fails_is_quoted(tmp_path, monkeypatch):
    program = tmp_path / "broken.py"
    program.write_text("raise SystemExit('no more memory')\n")
    monkeypatch.setattr(ppo, "PROGRAM", (str(program),))
    monkeypatch.setattr(ppo, "LEARNERS", ())
    measured = ppo.measure()
    assert measured.numbers == {}
    assert measured.lines == [f"PPO is not measured: {program} failed with status 1: no more memory"]


NAMES = ("cutenv/GentleCut-v1", "Pendulum-v1", "CartPole-v1")


@pytest.fixture
def step_takes(monkeypatch):
    """A function that says how long a step takes from now on [us]."""

    def settle(microseconds: float) -> None:
        monkeypatch.setattr(environment, "step_times", lambda: dict.fromkeys(NAMES, microseconds))
        monkeypatch.setattr(environment, "reset_times", lambda: dict.fromkeys(NAMES, 50.0))

    return settle


def a_record(benchmark: str = "step", **numbers: Number) -> Record:
    return Record("0.1.0", "2026-01-02", {"cpu": "a"}, {benchmark: numbers})


def test_a_record_holds_numbers_units_machine_version_and_date(step_takes, tmp_path):
    step_takes(8.0)
    assert bench.main(["step", "--json", str(tmp_path / "now.json")]) == 0
    kept = json.loads((tmp_path / "now.json").read_text())
    assert kept["numbers"]["step"]["step of Pendulum-v1"] == {"value": 8.0, "unit": "us"}
    assert kept["cutenv"] == cutenv.__version__
    assert {"cpu", "cores", "python", "numpy", "numba", "gymnasium"} <= set(kept["machine"])
    assert datetime.fromisoformat(kept["date"]).tzinfo is not None


def test_a_number_that_is_none_is_not_written(tmp_path):
    with pytest.raises(ValueError, match="JSON compliant"):
        record.write(tmp_path / "a.json", a_record(a=Number(float("nan"), "us")))
    assert not (tmp_path / "a.json").exists()


def test_compare_prints_new_over_old(step_takes, tmp_path, capsys):
    step_takes(8.0)
    bench.main(["step", "--json", str(tmp_path / "old.json")])
    step_takes(2.0)
    bench.main(["step", "--compare", str(tmp_path / "old.json")])
    said = capsys.readouterr().out
    assert re.search(r"step of Pendulum-v1 +0\.250 \(8 -> 2 us\)", said)
    assert re.search(r"reset of Pendulum-v1 +1\.000 \(50 -> 50 us\)", said)


def test_what_only_one_run_has_is_named_and_other_units_are_not_divided():
    old = a_record(gone=Number(1.0, "us"), other=Number(1.0, "us"), none=Number(0.0, "1"))
    new = a_record(come=Number(1.0, "us"), other=Number(1.0, "ms"), none=Number(3.0, "1"))
    said = "\n".join(compared(old, new))
    assert re.search(r"gone +only in the old run", said)
    assert re.search(r"come +only in the new run", said)
    assert re.search(r"other +was in us, is in ms", said)
    assert re.search(r"none +- +\(0 -> 3\)", said)


def test_another_machine_is_named():
    new = a_record()._replace(machine={"cpu": "b", "numpy": "2"})
    said = compared(a_record(), new)
    assert "  not alike: cpu was a, is b" in said
    assert "  not alike: numpy was unknown, is 2" in said


WHOLE = {"format": record.FORMAT, "cutenv": "0.1.0", "date": "2026-01-02", "machine": {}}


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (None, "No such file"),
        ("{", "is not JSON"),
        ("[]", "has format None"),
        ('{"format": "cutenv bench 0"}', "has format 'cutenv bench 0'"),
        (json.dumps(WHOLE), "not a whole record.*numbers"),
        (json.dumps(WHOLE | {"numbers": {"step": {"a": 3}}}), "not a whole record"),
        (json.dumps(WHOLE | {"numbers": {"step": {"a": {"value": "fast", "unit": "us"}}}}), "not a whole record"),
        (json.dumps(WHOLE | {"numbers": {"step": {"a": {"value": float("nan"), "unit": "us"}}}}), "a = nan"),
    ],
)
def test_a_file_that_is_no_record_is_refused_before_anything_is_measured(content, why, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(environment, "measure", lambda: pytest.fail("measured"))
    path = tmp_path / "old.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(SystemExit, match="2"):
        bench.main(["step", "--compare", str(path)])
    said = capsys.readouterr().err
    assert re.search(f"argument --compare: {re.escape(str(path))} .*{why}", said)
    assert "Make one with: python -m scripts.benchmarks.speed.bench --json FILE" in said


@pytest.mark.parametrize(("name", "why"), [("", "is a folder"), ("none/a.json", "there is no folder")])
def test_a_place_that_cannot_be_written_is_refused_before_anything_is_measured(
    name, why, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(environment, "measure", lambda: pytest.fail("measured"))
    with pytest.raises(SystemExit, match="2"):
        bench.main(["step", "--json", str(tmp_path / name)])
    assert why in capsys.readouterr().err


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("2", "2")])
def test_linear_algebra_has_one_thread_unless_the_user_says_otherwise(given, used, step_takes, tmp_path, monkeypatch):
    monkeypatch.delenv(machine.BLAS_THREADS, raising=False)
    if given:
        monkeypatch.setenv(machine.BLAS_THREADS, given)
    step_takes(8.0)
    bench.main(["step", "--json", str(tmp_path / "a.json")])
    assert record.read(tmp_path / "a.json").machine[machine.BLAS_THREADS] == used
