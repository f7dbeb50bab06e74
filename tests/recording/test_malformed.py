"""A damaged file loads or ends in a clear error; what the script of 10,000 does, 500 times by hypothesis."""

from __future__ import annotations

import sys
from pathlib import Path

import malformed_records
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from record_damage import DAMAGES, SUFFIXES, damaged

from cutenv.recording import RecordError, load

KINDS = [(suffix, kind) for suffix in SUFFIXES for kind in DAMAGES[suffix]]
FILES = {suffix: malformed_records.sound(suffix) for suffix in SUFFIXES}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("damaged")


@given(kind=st.sampled_from(KINDS), file=st.integers(0, 2), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=500)
def test_damage_of_any_kind_ends_in_clear_errors_only(folder, kind, file, seed):
    suffix, how = kind
    content, traces = FILES[suffix][file]
    ending = malformed_records.ending(damaged(content, how, np.random.default_rng(seed)), suffix, traces, folder)
    assert ending in malformed_records.CLEAR


@pytest.mark.parametrize("suffix", SUFFIXES)
@given(file=st.integers(0, 2), share=st.floats(0.0, 1.0, exclude_max=True))
@settings(max_examples=60)
def test_a_file_that_lost_its_end_never_loads(folder, suffix, file, share):
    content, _ = FILES[suffix][file]
    path = folder / f"part{suffix}"
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(RecordError):
        load(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_the_last_bytes_count_too(folder, suffix):
    content, traces = FILES[suffix][0]
    path = folder / f"last{suffix}"
    for lost in range(1, 12):
        path.write_bytes(content[:-lost])
        with pytest.raises(RecordError):
            load(path)
    path.write_bytes(content)
    assert load(path) == traces


def test_every_kind_of_damage_changes_the_file():
    for suffix, kind in KINDS:
        content, _ = FILES[suffix][1]
        changed = [damaged(content, kind, np.random.default_rng(seed)) != content for seed in range(20)]
        assert sum(changed) >= 10, (suffix, kind)


def test_an_unclear_ending_is_noticed(folder, monkeypatch):
    content, traces = FILES[".csv"][0]

    def ends(error: Exception) -> str:
        def fail(path: Path) -> None:
            raise error

        monkeypatch.setattr(malformed_records, "load", fail)
        return malformed_records.ending(content, ".csv", traces, folder)

    assert ends(KeyError("x")) == "KeyError: 'x'"
    assert ends(RecordError("elsewhere", "a reason of some length")).startswith("unclear")
    assert ends(RecordError(folder / "damaged.csv", "bad")).startswith("unclear")
    assert ends(RecordError(folder / "damaged.csv", "a reason of some length")) == "refused"


def test_the_script_prints_a_table(capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["malformed_records.py", "--files", "60"])
    assert malformed_records.main() == 0
    last = capsys.readouterr().out.splitlines()[-1].split()
    assert last[0] == "all"
    assert sum(map(int, last[1:])) == 60
    assert last[-1] == "0"
