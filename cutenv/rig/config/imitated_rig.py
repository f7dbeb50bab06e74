"""Settings of a rig that needs no hardware."""

from __future__ import annotations

import dataclasses
import math
from datetime import date

from cutenv.rig.config.axes import Axis, CrossAxis, HeightAxis, SideAxis
from cutenv.rig.config.settings import RigSettings, SensorCalibration

FAKE = "fake"
"""Name of a rig in memory, on its own clock."""
EMULATOR, SERIAL, GRBL = EMULATED = "emulator", "serial", "grbl"
"""Names of emulated rigs in a process of their own."""
RIG_NAMES = (FAKE, *EMULATED)
"""Names that are not files."""
HEIGHT = HeightAxis()
"""Height axis of a fake and of an emulated rig."""
SIDE = SideAxis()
"""Axis to the side of a fake and of an emulated rig."""


def across(*names: str) -> dict[str, CrossAxis]:
    """Return the axes across the cut with these names, "height" and "side", as arguments of settings."""
    return {name: axis for name, axis in (("height", HEIGHT), ("side", SIDE)) if name in names}


def fake_settings(**changes: object) -> RigSettings:
    """Return settings of a rig that needs no hardware: angle free, calibrated today, armed; across(...) adds axes."""
    hinge = Axis(
        node=2, gear=100.0, lead=2.0 * math.pi, low=math.radians(44.0), high=math.radians(91.0),
        speed=math.radians(90.0), acceleration=100.0, quick_stop=100.0, following_error=0.1,
    )  # fmt: skip
    plain = RigSettings(
        name="fake", armed_by="nobody: it is a fake", angle_mode="free", angle=hinge, emulated=True,
        calibration=SensorCalibration(date=date.today().isoformat()),
    )  # fmt: skip
    return dataclasses.replace(plain, **changes)  # type: ignore[arg-type]
