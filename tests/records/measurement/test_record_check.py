"""``cutenv check`` names what is wrong with a record of force, and leaves sound ones alone."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from recorded_cut import recorded_cut

from cutenv.commands import cli
from cutenv.records import save
from cutenv.records.importers import readings_in
from cutenv.records.measurement.signal_faults import Readings
from cutenv.records.scoring.record_check import FAULT_NAMES, record_faults
from cutenv.sim.trace import Trace
from scripts.validation.records import real_records
from scripts.validation.records import record_faults as made

RATE = 200.0


def sound(**changed) -> Readings:
    """A clean record of a simulated cut at 200 readings a second."""
    return dataclasses.replace(made.clean_record(3, rate=RATE), **changed)


def kinds(readings: Readings) -> list[str]:
    return [fault.kind for fault in record_faults(readings)]


def test_of_the_published_draw_nearly_all_faults_are_named_and_hardly_a_clean_record_is_doubted() -> None:
    found, doubted = made.counted("published", each=3, clean=60)
    assert len(found) == 20
    assert set(found) < set(FAULT_NAMES)
    named = [name in names for name, records in found.items() for names in records]
    assert np.mean(named) >= 0.95
    assert sum(doubted.values()) <= 1


def test_the_published_draw_has_no_record_of_that_with_which_thresholds_were_set() -> None:
    tuning, published = (
        {first + n for n in range(made.CLEAN)}
        | {first + 10_000 * (k + 1) + n for k in range(len(made.FAULTS)) for n in range(made.EACH)}
        for first in (made.DRAWS["tuning"], made.DRAWS["published"])
    )
    assert not tuning & published


@pytest.mark.needs("records")
def test_no_published_cut_by_hand_is_doubted() -> None:
    doubted = [
        (cut.metadata["trial"], kinds(Readings(time=cut.time, force=cut.force, force_unit="1")))
        for cut in real_records.read_cuts(real_records.DATA)
    ]
    assert [each for each in doubted if each[1]] == []


def test_a_spike_is_named_with_row_and_height() -> None:
    readings = sound()
    force = readings.force.copy()
    force[700] = 250.0
    (fault,) = record_faults(sound(force=force))
    assert (fault.kind, fault.rows, fault.sure) == ("spike", (700, 700), "likely")
    assert fault.seen.startswith("250 for 1 reading among")


@pytest.mark.parametrize("lasting", [3, 6])
def test_what_lasts_longer_is_no_spike(lasting: int) -> None:
    force = sound().force.copy()
    force[700 : 700 + lasting] += 3.0
    assert "spike" not in kinds(sound(force=force))


def test_a_clock_that_goes_back_is_certain_and_one_that_jumps_while_the_blade_moves_is_no_gap() -> None:
    readings = sound()
    amid = int(np.argmax(readings.position > 0.5 * readings.position.max()))
    for jump, sure in ((-2.0, "certain"), (2.0, "likely")):
        time = readings.time.copy()
        time[amid:] += jump
        (fault,) = record_faults(sound(time=time))
        assert (fault.kind, fault.rows, fault.sure) == ("clock jump", (amid - 1, amid), sure)


def test_readings_lost_while_the_blade_moves_are_a_gap_and_no_jump() -> None:
    readings = sound()
    amid = int(np.argmax(readings.position > 0.5 * readings.position.max()))
    kept = np.r_[0:amid, amid + 60 : len(readings)]
    lost = Readings(time=readings.time[kept], force=readings.force[kept], position=readings.position[kept])
    assert kinds(lost) == ["gap"]


def test_an_offset_is_told_in_newtons_and_hides_no_reversed_sign() -> None:
    readings = sound()
    (fault,) = record_faults(sound(force=readings.force - 3.0))
    assert fault.kind == "offset"
    assert "the force is -3" in fault.seen
    assert set(kinds(sound(force=3.0 - readings.force))) == {"offset", "sign"}


def test_columns_that_are_no_newtons_over_seconds_are_named_alone() -> None:
    readings = sound()
    assert kinds(sound(force=np.round(1e4 * readings.force))) == ["counts"]
    assert kinds(sound(time=1e3 * readings.time, speed=None)) == ["rate"]
    swapped = sound(force=1e3 * readings.position, position=1e-3 * readings.force, speed=None)
    assert kinds(swapped) == ["swapped"]


def test_rows_that_are_there_twice_are_doubled() -> None:
    readings, rows = sound(), np.sort(np.r_[0:400, 100:130, 400:1000])
    twice = Readings(time=readings.time[rows], force=readings.force[rows], position=readings.position[rows])
    (fault,) = [fault for fault in record_faults(twice) if fault.kind == "doubled"]
    assert "30 rows have the time of the row before, and its force" in fault.seen


def test_a_cut_that_is_known_to_be_whole_is_not_cut_off() -> None:
    cut = recorded_cut("2 cm", speed=0.01, turns=(0.06,)).trace.select(slice(0, 4000))
    readings = Readings(time=cut.time, force=cut.force, position=cut.position)
    assert kinds(readings) == ["cut off"]
    assert kinds(dataclasses.replace(readings, metadata={"end": "finished"})) == []


def written(readings: Readings, path: Path) -> Path:
    """A CSV file of a record."""
    rows = np.column_stack([readings.time, readings.force, readings.position])
    np.savetxt(path, rows, delimiter=",", header="time_s,force_N,position_m", comments="", fmt="%.9g")
    return path


def test_the_command_prints_one_line_for_each_fault_and_tells_by_its_status(tmp_path, capsys) -> None:
    good, readings = written(sound(), tmp_path / "good.csv"), sound()
    assert cli.main(["check", str(good)]) == 0
    assert capsys.readouterr().out == f"{good}: sound, {len(readings)} readings\n"
    force = readings.force - 2.0
    force[700] = 250.0
    bad = written(sound(force=force), tmp_path / "bad.csv")
    assert cli.main(["check", str(good), str(bad)]) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith(f"{bad}: offset (likely), rows 1 to ")
    assert lines[2].startswith(f"{bad}: spike (likely), row 701, from 3.5 s: 250 for 1 reading among")
    assert lines[2].endswith("Leave these readings out, and look at cable and connector.")
    assert len(lines) == 3


def test_its_json_has_kind_sureness_rows_times_and_cure(tmp_path, capsys) -> None:
    force = sound().force.copy()
    force[700] = 250.0
    bad = written(sound(force=force), tmp_path / "bad.csv")
    assert cli.main(["check", str(bad), "--json"]) == 1
    (record,) = json.loads(capsys.readouterr().out)["records"]
    assert (record["file"], record["cut"]) == (str(bad), 1)
    (fault,) = record["faults"]
    assert (fault["kind"], fault["sure"], fault["rows"], fault["time_s"]) == ("spike", "likely", [701, 701], [3.5, 3.5])
    assert fault["cure"]


def test_a_file_that_no_other_command_reads_is_checked(tmp_path, capsys) -> None:
    readings = sound()
    time = readings.time.copy()
    time[800:] -= 3.0
    assert cli.main(["check", str(written(sound(time=time), tmp_path / "back.csv"))]) == 1
    assert "clock jump (certain), rows 800 to 801" in capsys.readouterr().out
    assert cli.main(["check", str(written(sound(force=np.round(1e5 * readings.force)), tmp_path / "counts.csv"))]) == 1
    assert "counts (certain), throughout" in capsys.readouterr().out
    (tmp_path / "prose.csv").write_text("no record at all\n")
    assert cli.main(["check", str(tmp_path / "prose.csv")]) == 1
    assert "prose.csv: unreadable: " in capsys.readouterr().out


def test_a_file_of_another_program_is_checked_by_its_map_as_it_states_it(tmp_path, capsys) -> None:
    readings = sound()
    path = tmp_path / "trial.txt"
    rows = np.column_stack([readings.time, readings.force - 2.0, 1e3 * readings.position])
    np.savetxt(path, rows, delimiter="\t", header="t\tF\tx", comments="", fmt="%.9g")
    mapped = ["--map", "time=t", "force=F", "position=x[mm]", "--unit", "N"]
    assert cli.main(["check", str(path), *mapped]) == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert f"{path}: offset (likely)" in line
    assert cli.main(["check", str(path), "--unit", "N"]) == 2
    assert "--unit goes with --map" in capsys.readouterr().err


def test_every_cut_of_a_file_is_checked(tmp_path, capsys) -> None:
    readings = sound()
    good = Trace(time=readings.time, force=readings.force, position=readings.position)
    save([good, dataclasses.replace(good, force=good.force + 2.0)], tmp_path / "two.csv")
    assert len(readings_in(tmp_path / "two.csv")) == 2
    assert cli.main(["check", str(tmp_path / "two.csv")]) == 1
    first, second = capsys.readouterr().out.splitlines()
    assert "cut 1: sound" in first
    assert "cut 2: offset" in second
