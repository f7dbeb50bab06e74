"""Identified properties of a rig, as the simulator uses them."""

from __future__ import annotations

import dataclasses

from cutenv.rig.config.settings import Identified, PositionControl, RigSettings
from cutenv.sim.cutting.drive import PDRig, Rig

SIMULATED = (
    "motor_lag", "dead_time", "acceleration", "backlash", "force_noise", "force_resolution", "force_drift",
    "force_delay",
)  # fmt: skip
"""Fields that are constants of the simulated rig too, under the same names.

The axis's friction is not one: a stiff drive does not yield to it, and the sensor sits behind it.
"""

_OF_A_VELOCITY_LOOP = ("motor_lag", "backlash")


def environment_arguments(identified: Identified, control: PositionControl | None = None) -> dict[str, float]:
    """Return measured values as keyword arguments for ``gymnasium.make``, in SI.

    They are those of ``"cutenv/GentleCut-v1"``. With the ``control`` of a rig under PD position control, which has
    neither a velocity loop's lag nor backlash in the simulator, its gains are among them; they are for ``drive="pd"``.

    Examples
    --------
    >>> environment_arguments(Identified(motor_lag=0.052, friction=3.0))
    {'motor_lag': 0.052}
    """
    measured = {name: getattr(identified, name) for name in SIMULATED}
    if control is not None:
        measured |= dict.fromkeys(_OF_A_VELOCITY_LOOP) | dataclasses.asdict(control)
    return {name: float(value) for name, value in measured.items() if value is not None}


def drive_of(settings: RigSettings) -> Rig | PDRig:
    """Return the simulated drive with a rig's settings and measured properties."""
    ranges = {field.name: (field.metadata["low"], field.metadata["high"]) for field in dataclasses.fields(Rig)}

    def within(name: str, value: float) -> float:
        low, high = ranges[name]
        return float(min(max(value, low), high))

    measured, told = settings.identified, settings.blade.acceleration
    if (control := settings.position_control) is not None:
        return PDRig(**dataclasses.asdict(control), acceleration=within("acceleration", measured.acceleration or told))
    return Rig(
        motor_lag=within("motor_lag", measured.motor_lag or Rig().motor_lag),
        acceleration=within("acceleration", min(measured.acceleration or told, told)),
    )
