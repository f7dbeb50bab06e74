"""``scripts/bench.py --json`` and ``--compare``: what was measured can be kept, and a later run held against it."""

from __future__ import annotations

import json
import re
from datetime import UTC, datetime
from pathlib import Path

import bench
import pytest
from speed import environment, machine, record
from speed.comparison import compared
from speed.measured import Number
from speed.record import Record

import cutenv

NAMES = ("cutenv/GentleCut-v1", "Pendulum-v1", "CartPole-v1")
DATE = datetime(2026, 1, 2, 3, 4, 5, tzinfo=UTC)


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


def test_a_record_comes_back_as_it_was_written(tmp_path):
    written = record.record_of({"step": {"a": Number(0.1, "us")}, "ppo": {}}, DATE)
    record.write(tmp_path / "a.json", written)
    assert record.read(tmp_path / "a.json") == written
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


def test_an_interrupted_write_leaves_the_earlier_record(tmp_path, monkeypatch):
    path = tmp_path / "a.json"
    record.write(path, a_record(a=Number(1.0, "us")))

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        record.write(path, a_record(a=Number(2.0, "us")))
    assert record.read(path).numbers["step"]["a"].value == 1.0


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


def test_a_record_can_be_compared_with_and_replaced_in_one_run(step_takes, tmp_path, capsys):
    path = str(tmp_path / "last.json")
    step_takes(8.0)
    bench.main(["step", "--json", path])
    step_takes(4.0)
    bench.main(["step", "--json", path, "--compare", path])
    assert "0.500 (8 -> 4 us)" in capsys.readouterr().out
    assert record.read(Path(path)).numbers["step"]["step of CartPole-v1"].value == 4.0


def test_what_only_one_run_has_is_named_and_other_units_are_not_divided():
    old = a_record(gone=Number(1.0, "us"), other=Number(1.0, "us"), none=Number(0.0, "1"))
    new = a_record(come=Number(1.0, "us"), other=Number(1.0, "ms"), none=Number(3.0, "1"))
    said = "\n".join(compared(old, new))
    assert re.search(r"gone +only in the old run", said)
    assert re.search(r"come +only in the new run", said)
    assert re.search(r"other +was in us, is in ms", said)
    assert re.search(r"none +- +\(0 -> 3\)", said)


def test_a_benchmark_that_was_not_asked_for_is_not_compared():
    assert not any("tick" in line for line in compared(a_record("tick", a=Number(1.0, "us")), a_record("step")))


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
    assert "Make one with: python scripts/bench.py --json FILE" in said


@pytest.mark.parametrize(("name", "why"), [("", "is a folder"), ("none/a.json", "there is no folder")])
def test_a_place_that_cannot_be_written_is_refused_before_anything_is_measured(
    name, why, tmp_path, capsys, monkeypatch
):
    monkeypatch.setattr(environment, "measure", lambda: pytest.fail("measured"))
    with pytest.raises(SystemExit, match="2"):
        bench.main(["step", "--json", str(tmp_path / name)])
    assert why in capsys.readouterr().err


def test_the_processor_is_named_as_linux_does(tmp_path):
    (tmp_path / "cpuinfo").write_text("processor\t: 0\nmodel name\t: Some Processor @ 2 GHz\n")
    assert machine.cpu(tmp_path / "cpuinfo") == "Some Processor @ 2 GHz"
    assert machine.cpu(tmp_path / "none")


@pytest.mark.parametrize(("given", "used"), [(None, "1"), ("2", "2")])
def test_linear_algebra_has_one_thread_unless_the_user_says_otherwise(given, used, step_takes, tmp_path, monkeypatch):
    monkeypatch.delenv(machine.BLAS_THREADS, raising=False)
    if given:
        monkeypatch.setenv(machine.BLAS_THREADS, given)
    step_takes(8.0)
    bench.main(["step", "--json", str(tmp_path / "a.json")])
    assert record.read(tmp_path / "a.json").machine[machine.BLAS_THREADS] == used
