"""Reading a record takes little longer than turning its text into numbers does."""

from __future__ import annotations

from speed import reading


def test_reading_takes_at_most_three_times_as_long_as_loadtxt():
    seconds = reading.reading_times(reading.cuts(readings=10_000, count=2), rounds=3)
    for suffix in (".csv", ".parquet", ".h5"):
        assert seconds[suffix] <= reading.TIMES_LOADTXT * seconds["numpy.loadtxt"], (suffix, seconds)
