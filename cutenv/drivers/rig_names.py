"""Settings of a rig by its name: that of an emulated or fake one, or a file."""

from __future__ import annotations

from dataclasses import replace
from datetime import date

from cutenv.drivers.slow_profile import grbl_settings, slow_settings
from cutenv.rig.config.settings import EMULATOR, FAKE, GRBL, SERIAL, RigSettings, SensorCalibration, fake_settings
from cutenv.rig.toml_file import read_rig_file


def settings_of(rig: str) -> RigSettings:
    """Return the settings of a rig without connecting to it.

    ``rig`` is a rig's TOML file, or one of :data:`~cutenv.rig.config.settings.RIG_NAMES`. Raise FileNotFoundError,
    ValueError if its file is missing or not valid.
    """
    if rig in (SERIAL, GRBL):
        own = slow_settings("", name=rig) if rig == SERIAL else grbl_settings("", "", name=rig)
        today = SensorCalibration(date=date.today().isoformat())
        return replace(own, emulated=True, armed_by="the emulator", calibration=today)
    return fake_settings(name=rig) if rig in (FAKE, EMULATOR) else read_rig_file(rig)
