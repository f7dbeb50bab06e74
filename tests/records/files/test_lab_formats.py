"""Files of laboratories are right at first try, or ask; and a map that is printed reads its file."""

from __future__ import annotations

import shlex
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from lab_formats import FORMATS, LabFormat

from cutenv.records import ColumnMap, RecordError
from cutenv.records.importers import Imported, OpenQuestions, load_foreign, look_at
from cutenv.sim.trace import Trace

NAMES = [each.name for each in FORMATS]
REFUSED = {each.name for k, each in enumerate(FORMATS) if each.asks or k % 6 == 0}
"""Files whose refusal is read, too, which takes as long as to read them: all that ask, and every sixth."""


def written(given: LabFormat, folder: Path) -> Path:
    path = folder / given.name
    path.write_bytes(given.content)
    return path


def is_right(imported: Imported, given: LabFormat) -> bool:
    """Return whether the records are those of the truth, within a hundredth."""
    pairs = list(zip(imported.records, given.truth, strict=False))
    return len(imported.records) == len(given.truth) and all(
        trace.duration == pytest.approx(truth.duration_s, rel=0.01)
        and trace.force.max() == pytest.approx(truth.peak_N, rel=0.01)
        and travel(trace) == (None if truth.travel_mm is None else pytest.approx(truth.travel_mm, rel=0.01))
        for trace, truth in pairs
    )


def travel(trace: Trace) -> float | None:
    return None if trace.position is None else 1e3 * float(trace.position.max() - trace.position.min())


@pytest.mark.parametrize("given", FORMATS, ids=NAMES)
def test_a_file_is_right_at_first_try_or_asks_and_the_map_of_the_message_reads_it_so(
    given: LabFormat, tmp_path: Path
) -> None:
    path = written(given, tmp_path)
    if not given.readable:
        with pytest.raises(OpenQuestions) as caught:
            look_at(path)
        assert len(caught.value.asked.questions) == given.asks
        return
    understood = look_at(path)
    assert is_right(understood, given), (str(understood.mapping), understood.notes)
    assert len(understood.questions) == given.asks
    assert sum(each.count for each in understood.left_out) == given.left_out
    assert all(any(str(each) in note for note in understood.notes) for each in understood.left_out)
    printed = str(understood.mapping)
    if given.name in REFUSED:
        with pytest.raises(RecordError) as refused:
            load_foreign(path)
        printed = refused.value.reason
    items, _, unit = printed.rpartition("--map ")[2].partition(" --unit ")
    by_message = load_foreign(path, ColumnMap.parse(shlex.split(items), unit=unit or None))
    assert is_right(by_message, given)
    assert str(understood.mapping) == str(by_message.mapping)
    assert [trace.with_metadata({}) for trace in by_message.records] == [
        trace.with_metadata({}) for trace in understood.records
    ]


@pytest.mark.parametrize(
    ("lines", "why"),
    [
        (
            ["Load cell test", "FT ground truth: [-0.79, 1.2] N", "measured 2.1 N at 3 mm after 4 s"] * 20,
            "no (rows|table) of numbers",
        ),
        (
            ["Time (s),Strain (%),Stress (MPa)", *(f"{k / 100},{k / 9:.3f},{k / 7:.3f}" for k in range(99))],
            "can be a force",
        ),
        (
            ["Time (s),Torque (Nm),Angle (deg)", *(f"{k / 100},{k / 9:.3f},{k / 7:.3f}" for k in range(99))],
            "can be a force",
        ),
        (
            ["time_s,torque_Nm,speed_rpm", *(f"{k / 100},{k / 9:.3f},{100 + k % 3}" for k in range(99))],
            "can be a force",
        ),
        (
            ["Timestamp,VoltageRatio 0", *(f"{1715000000000 + 8 * k}.000,{k / 7e6:.9f}" for k in range(99))],
            "can be a force",
        ),
        (["t;F;x", *(f"{k};{k};{k}" for k in range(50)), "x;t;F", *(f"{k};{k};{k}" for k in range(70))], "other form"),
    ],
)
def test_what_is_no_record_of_a_force_is_refused_without_a_map(lines: list[str], why: str, tmp_path: Path) -> None:
    path = tmp_path / "file.txt"
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(RecordError, match=why) as caught:
        look_at(path)
    assert "--map" not in caught.value.reason


def test_nine_of_ten_formats_are_right_with_at_most_one_question() -> None:
    readable = [each for each in FORMATS if each.readable]
    assert max(each.asks for each in FORMATS) <= 1
    assert len(readable) >= 0.9 * len(FORMATS)
    assert not [name for name, count in Counter(NAMES).items() if count > 1]


def test_a_rate_that_the_header_states_is_kept_where_a_column_only_rises(tmp_path: Path) -> None:
    path = tmp_path / "logger.txt"
    header = ["Start: 2024-05-03 10:22:33", "Interval = 10 ms", "Channel 1: load cell", "", "Ch1\tCh2"]
    way = np.clip((np.arange(600) - 100) * 0.1, 0.0, 30.0)
    force = np.where((way > 0.0) & (way < 30.0), 500.0 + 2500.0 * np.abs(np.sin(way)), 0.0)
    path.write_text("\n".join([*header, *(f"{f:.2f}\t{x:.3f}" for f, x in zip(force, way, strict=True))]) + "\n")
    understood = look_at(path)
    assert str(understood.mapping) == "--map rate=100Hz force=Ch1 'position=Ch2[mm]' --unit mN"
    assert len(understood.questions) == 1
    assert understood.records[0].time[-1] == pytest.approx(5.99)
