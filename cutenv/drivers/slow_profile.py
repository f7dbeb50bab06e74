"""Profile of a slow rig, with limits that fit its sensor and its speed."""

from __future__ import annotations

from dataclasses import replace

from cutenv.drivers.grbl_axis import REPORT_PERIOD, GrblOptions
from cutenv.rig.config.settings import Axis, Bus, RigSettings, SafetyLimits, SensorSettings
from cutenv.rig.devices.serial.board_drivers import BOARD_PERIOD, LoadCellOptions, StepperOptions

SCREW_STEPS = 3200  # steps for one turn of a motor of 200 steps with 16 microsteps: choice
# trapezoidal screw of 8 mm lead, as cheap printers have it: choice. Its options are to be given
SCREW = Axis(driver="serial", lead=0.008, low=-0.002, high=0.149, speed=0.006, acceleration=0.1, quick_stop=0.5)
# counts of a converter of 24 bits at gain 128 for one newton on a cell for 5 kg, 1 mV/V at 5 V: derived, [1/N]
COUNTS_PER_NEWTON = 42_800.0
# time until a force is in the readings [s]: settling times of the data sheets at 80, 330 and 320 readings a second (the
# NAU7802's assumed, four conversions)
DELAYS = {"hx711": 0.050, "ads1220": 0.003, "nau7802": 0.0125}
RATES = {"hx711": 80.0, "ads1220": 330.0, "nau7802": 320.0}  # readings a second [Hz], of the data sheets


def slow_limits(rate: float) -> SafetyLimits:
    """Return limits for a force sensor at ``rate`` [Hz]: 4.8 mm/s at most.

    Times without, or with the same, readings are as many readings as a fast rig allows, or its times if longer.
    """
    period = 1.0 / rate
    return SafetyLimits(
        speed=0.005,
        force_rise=100.0,
        stale_force=max(0.020, 4 * period),
        frozen_force=max(0.020, 10 * period),
        late_force=max(0.030, 4 * period),
        stale_motion=5 * BOARD_PERIOD,
        overrun=0.5,
    )


def slow_settings(port: str, *, converter: str = "hx711", name: str = "slow rig") -> RigSettings:
    """Return the settings of a rig on one board.

    ``port`` is its serial port.

    Counts per newton are those of a typical cell, and have to be measured.
    """
    rate = RATES[converter]
    cell = LoadCellOptions(port=port, counts_per_N=COUNTS_PER_NEWTON, delay=DELAYS[converter])
    return RigSettings(
        name=name,
        bus=Bus(sync=BOARD_PERIOD),
        blade=replace(SCREW, options=StepperOptions(port=port, steps=SCREW_STEPS)),
        sensor=SensorSettings(driver="serial", options=cell, rate=rate),
        limits=slow_limits(rate),
    )


def grbl_settings(port: str, sensor_port: str, *, converter: str = "hx711", name: str = "GRBL rig") -> RigSettings:
    """Return the settings of a GRBL-driven rig with a load cell's board.

    Its limits are those of a slow rig, with times for a position that comes ten times a second.
    """
    rig = slow_settings(sensor_port, converter=converter, name=name)
    late = 3.5 * REPORT_PERIOD
    return replace(
        rig,
        bus=Bus(sync=REPORT_PERIOD),
        blade=replace(SCREW, driver="grbl", quick_stop=SCREW.acceleration, options=GrblOptions(port=port)),
        limits=replace(rig.limits, stale_motion=late, heartbeat=late, following=0.002),
    )
