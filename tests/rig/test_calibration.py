"""A check of the force sensor counts from its day on, for so many days."""

from __future__ import annotations

from datetime import date

import pytest

from cutenv.rig.config.settings import SensorCalibration, expired


@pytest.mark.parametrize("day", ["2026-03-01", "2026-03-01T23:59:00+01:00", "20260301"])
def test_a_check_counts_from_its_day_to_the_last(day: str) -> None:
    calibration = SensorCalibration(date=day, valid_days=30)
    assert expired(calibration, date(2026, 3, 1)) is None
    assert expired(calibration, date(2026, 3, 31)) is None
    assert "31 days ago, on 2026-03-01, which counts 30" in str(expired(calibration, date(2026, 4, 1)))


def test_never_in_the_future_and_nonsense_do_not_count() -> None:
    today = date(2026, 3, 1)
    assert "never checked" in str(expired(SensorCalibration(), today))
    assert "2026-03-02 is in the future: today is 2026-03-01" in str(
        expired(SensorCalibration(date="2026-03-02"), today)
    )
    assert "'soon' is not a date" in str(expired(SensorCalibration(date="soon"), today))


@pytest.mark.parametrize("days", [0, -1, 100_000])
def test_a_check_that_counts_forever_is_refused(days: int) -> None:
    with pytest.raises(ValueError, match="valid_days"):
        SensorCalibration(valid_days=days)
