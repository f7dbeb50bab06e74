"""A damaged file loads or ends in a clear error; what the script does 20,000 times, 800 times by hypothesis."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import record_trials
from hypothesis import given, settings
from hypothesis import strategies as st
from record_trials import KINDS, damaged, sound

from cutenv.recording import RecordError, load

SUFFIXES = (".csv", ".parquet", ".h5", ".mcap")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("damaged")


@given(number=st.integers(0, 2**32 - 1))
@settings(max_examples=800)
def test_damage_of_any_kind_ends_in_clear_errors_only(folder, number):
    suffix, _, content, file = record_trials.case(number)
    assert record_trials.ending(folder / f"damaged{suffix}", content, file) in record_trials.CLEAR


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(file=st.integers(0, 2), share=st.floats(0.0, 1.0, exclude_max=True))
@settings(max_examples=60)
def test_a_file_that_lost_its_end_never_loads(folder, suffix, file, share):
    content = sound(suffix)[file].content
    path = folder / f"part{suffix}"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(RecordError):
        load(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_last_bytes_count_too(folder, suffix):
    content, traces, _ = sound(suffix)[0]
    path = folder / f"last{suffix}"
    for lost in range(1, 12):
        path.write_bytes(content[:-lost])
        with pytest.raises(RecordError):
            load(path)
    path.write_bytes(content)
    assert load(path) == traces


def test_every_kind_of_damage_changes_the_file():
    for suffix, kinds in KINDS.items():
        for kind in kinds:
            content = sound(suffix)[1].content
            changed = [damaged(content, kind, np.random.default_rng(seed)) != content for seed in range(20)]
            needs_comments = kind in ("comments lost", "JSON damaged")
            assert sum(changed) >= 10 or (suffix == ".txt" and needs_comments), (suffix, kind)


def test_an_unclear_ending_is_noticed(folder):
    file = sound(".csv")[0]

    def ends(error: Exception) -> str:
        def fail(path: Path) -> None:
            raise error

        return record_trials.ending(folder / "damaged.csv", file.content, file._replace(read=fail))

    assert ends(KeyError("x")) == "KeyError: 'x'"
    assert ends(RecordError("elsewhere", "a reason of some length")).startswith("unclear")
    assert ends(RecordError(folder / "damaged.csv", "bad")).startswith("unclear")
    assert ends(RecordError(folder / "damaged.csv", "a reason of some length")) == "refused"


def test_the_script_prints_its_tables(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["record_trials.py", "--files", "60", "--flawed", "2", "--valid", "4"])
    assert record_trials.main() == 0
    said = capsys.readouterr().out
    (counted,) = [line.split() for line in said.splitlines() if line.startswith("all")]
    assert sum(map(int, counted[1:])) == 60
    assert counted[-1] == "0"
    for part in ("injected flaw", "4 valid records", "false alarms"):
        assert part in said
