"""Reading a record takes little longer than turning its text into numbers does."""

from __future__ import annotations

from cutenv.bench import main, reading


def test_reading_takes_at_most_three_times_as_long_as_loadtxt():
    seconds = reading.reading_times(reading.cuts(readings=10_000, count=2), rounds=3)
    for suffix in (".csv", ".parquet", ".h5"):
        assert seconds[suffix] <= reading.TIMES_LOADTXT * seconds["numpy.loadtxt"], (suffix, seconds)


def test_the_benchmark_prints_a_verdict_by_its_own_numbers(capsys, monkeypatch):
    found = {"numpy.loadtxt": 0.1, ".csv": 0.31, ".parquet": 0.01, ".h5": 0.25}
    monkeypatch.setattr(reading, "reading_times", lambda traces: found)
    assert main(["reading"]) == 0
    said = capsys.readouterr().out
    assert "reading 4 cuts of 30000 readings" in said
    assert said.count("MISSED") == 1
    assert ".csv: 310 ms, 3.10 of it; MISSED: the 3 allowed" in said
    assert ".h5: 250 ms, 2.50 of it; within the 3 allowed" in said
