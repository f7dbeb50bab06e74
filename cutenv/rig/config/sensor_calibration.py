"""Validity of the force sensor's last check."""

from __future__ import annotations

from datetime import date, datetime

from cutenv.rig.config.settings import SensorCalibration


def day_of(text: str) -> date:
    """Return the day of an ISO 8601 text, such as ``2026-03-01`` or ``2026-03-01T14:05:00``.

    Raises
    ------
    ValueError
        If the text is not a date.
    """
    try:
        return datetime.fromisoformat(text).date()
    except ValueError:
        raise ValueError(f"{text!r} is not a date. Write it as 2026-03-01.") from None


def expired(calibration: SensorCalibration, today: date) -> str | None:
    """Return the reason why the calibration is not valid on that day (never, in the future, too old), or None."""
    cure = "Hang known weights on the sensor, and write the day as calibration.date into the rig's file."
    if not calibration.date:
        return f"the force sensor was never checked. {cure}"
    try:
        day = day_of(calibration.date)
    except ValueError as error:
        return f"calibration.date = {error}"
    age = (today - day).days
    if age < 0:
        return f"calibration.date = {day} is in the future: today is {today}. Correct it, or this computer's clock."
    if age > calibration.valid_days:
        return f"the force sensor was checked {age} days ago, on {day}, which counts {calibration.valid_days}. {cure}"
    return None
