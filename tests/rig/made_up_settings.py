"""Rigs that might exist, drawn at random: near what is usual, or with some settings anywhere in their ranges."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from hypothesis import strategies as st

from cutenv.emulation.canopen_rig import BLADE, HINGE
from cutenv.rig.config.settings import Identified, RigSettings, SensorCalibration

PROFILE = ((0.0, 0.0081), (0.005, 0.0124), (0.15, 0.0175))
USUAL = RigSettings(
    name="bench",
    armed_by="a test",
    depth_profile=PROFILE,
    calibration=SensorCalibration(date="2026-03-01"),
    blade=BLADE,
)
FREE = dataclasses.replace(USUAL, angle_mode="free", angle=HINGE)
_WHOLE = {"node": (1, 127), "pulses": (1, 10**6), "bitrate": (10_000, 1_000_000)}
_MEASURED = {
    "motor_lag": 1.0, "dead_time": 0.1, "acceleration": 10.0, "backlash": 0.005, "friction": 50.0, "force_noise": 1.0,
    "force_resolution": 1.0, "force_drift": 1.0, "force_delay": 0.05,
}  # fmt: skip
_USUALLY = 0.1  # of that


def parts(settings: RigSettings) -> list[str]:
    """Names of the sections whose settings can be numbers."""
    return ["bus", "blade", "sensor", "limits", "calibration"] + (["angle"] if settings.angle is not None else [])


def with_value(settings: RigSettings, section: str, field: str, value: Any) -> RigSettings:
    """The same with another value of one setting."""
    part = dataclasses.replace(getattr(settings, section), **{field: value})
    return dataclasses.replace(settings, **{section: part})


@st.composite
def nearly_usual(draw: st.DrawFn) -> RigSettings:
    """A rig whose numbers are within 5 % of what is usual."""
    settings = draw(st.sampled_from([USUAL, FREE]))
    for section in parts(settings):
        part = getattr(settings, section)
        numbers = {
            field.name: getattr(part, field.name) for field in dataclasses.fields(part) if "low" in field.metadata
        }
        some = {name: value * draw(st.floats(0.95, 1.0)) for name, value in numbers.items() if "angle" not in name}
        if section in ("bus", "blade", "limits"):
            ends = ("low", "high", "stale_motion", "heartbeat", "frozen_force", "following", "following_error")
            some = {name: value for name, value in some.items() if name not in ends}
        if section != "angle":
            settings = dataclasses.replace(settings, **{section: dataclasses.replace(part, **some)})
    return settings


def _anywhere(low: float, high: float) -> st.SearchStrategy[float]:
    """Between two numbers, as often small as large."""
    if low <= 0.0:
        return st.floats(low, high)
    return st.floats(math.log(low), math.log(high)).map(lambda power: min(max(math.exp(power), low), high))


@st.composite
def with_surprises(draw: st.DrawFn) -> RigSettings:
    """A usual rig but for one to four settings, each anywhere in the range of its own."""
    settings: RigSettings = draw(st.sampled_from([USUAL, FREE]))
    for _ in range(draw(st.integers(1, 4))):
        section = draw(st.sampled_from([*parts(settings), "identified"]))
        if section == "identified":
            name = draw(st.sampled_from(sorted(_MEASURED)))
            value: Any = draw(_anywhere(1e-3 * _MEASURED[name], _MEASURED[name]))
            measured = dataclasses.replace(settings.identified, **{name: value})
            settings = dataclasses.replace(settings, identified=measured)
            continue
        part = getattr(settings, section)
        numbers = [field for field in dataclasses.fields(part) if "low" in field.metadata or field.name in _WHOLE]
        field = draw(st.sampled_from(numbers))
        if field.name in _WHOLE:
            value = draw(st.integers(*_WHOLE[field.name]))
        else:
            value = draw(_anywhere(field.metadata["low"], field.metadata["high"]))
        try:
            settings = with_value(settings, section, field.name, value)
        except ValueError:  # low above high: refused without a look at another section
            continue
    return settings


@st.composite
def measured(draw: st.DrawFn) -> Identified:
    """What identification may have found of a usual rig."""
    found = {name: draw(st.none() | st.floats(0.0, _USUALLY * high)) for name, high in _MEASURED.items()}
    found["acceleration"] = draw(st.none() | st.floats(0.06, 0.19))
    return Identified(date=draw(st.sampled_from([None, "2026-04-01"])), **found)
