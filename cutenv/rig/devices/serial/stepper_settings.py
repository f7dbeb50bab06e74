"""Settings of a stepper on a board: its options, its steps, and what no board can drive."""

from __future__ import annotations

from dataclasses import dataclass

from cutenv._base.parameter import check_parameters
from cutenv._base.validation import in_range
from cutenv.rig.config.axes import Axis
from cutenv.rig.config.setting import setting
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.serial.board_lines import StepperSetup
from cutenv.rig.devices.serial.ports import is_pseudo_terminal

FASTEST_STEPS = 20_000
"""Steps a second that the sketch takes at most; that of an 8-bit board may make fewer."""
_LEAST_ACCELERATION = 1000  # [steps/s2] of the sketch, which counts in milliseconds


@dataclass(frozen=True, kw_only=True)
class StepperOptions:
    """Options of a stepper on a board."""

    port: str = setting(
        "", "1", "Serial port of the board; a name below /dev/serial/by-id stays the same.",
        example='"/dev/serial/by-id/usb-..."',
    )  # fmt: skip
    baud: int = setting(500_000, "1", "Baud rate, that of the sketch; boards with USB of their own ignore it.")
    steps: int = setting(
        3200,
        "1",
        "Steps for one turn of the screw: 200 times the microsteps set on the motor's driver.",
        example="3200",
    )

    def __post_init__(self) -> None:
        check_parameters(self)
        in_range("baud", self.baud, 9600, 4_000_000, "baud", "That of the sketch is 500000.")
        in_range("steps", self.steps, 20, 51_200, "1", "A motor of 1.8 degrees with 16 microsteps makes 3200.")


class StepRates:
    """Conversion between metres and steps.

    Parameters
    ----------
    axis : Axis
        Lead and direction.
    steps : int
        Steps for one turn of the screw.
    """

    def __init__(self, axis: Axis, steps: int) -> None:
        self.per_metre = axis.direction * steps / axis.lead

    def steps(self, length: float) -> int:
        """Return a length, speed or acceleration [m...] in whole steps."""
        return round(length * self.per_metre)

    def metres(self, steps: float) -> float:
        """Return steps as a length, speed or acceleration [m...]."""
        return steps / self.per_metre

    def setup(self, axis: Axis) -> StepperSetup:
        """Return the set-up of the board for an axis."""
        ends = sorted((self.steps(axis.low), self.steps(axis.high)))
        return StepperSetup(
            abs(self.steps(axis.acceleration)), abs(self.steps(axis.quick_stop)), abs(self.steps(axis.speed)), *ends
        )


def check_stepper(rig: RigSettings, role: str) -> None:
    """Raise ValueError for an axis that no board can drive."""
    axis: Axis = getattr(rig, role)
    if role != "blade":
        raise ValueError(
            f'{role}.driver = "serial": a board moves the blade alone. Set the angle by hand: angle_mode = "fixed".'
        )
    if axis.options is None:
        raise ValueError(f'{role}.driver = "serial" needs [{role}.options] with port and steps.')
    rates = StepRates(axis, axis.options.steps)
    setup = rates.setup(axis)
    if setup.fastest > FASTEST_STEPS:
        raise ValueError(
            f"{role}.speed_cm_s = {100 * axis.speed:g} is {setup.fastest} steps a second, and the board makes "
            f"{FASTEST_STEPS} at most. Lower the speed, the microsteps, or take a screw of more lead."
        )
    if setup.acceleration < _LEAST_ACCELERATION:
        raise ValueError(
            f"{role}.acceleration_m_s2 = {axis.acceleration:g} is {setup.acceleration} steps/s2, and the board takes "
            f"{_LEAST_ACCELERATION} at least. Raise it, or the microsteps."
        )
    if not rig.bus.sync == BOARD_PERIOD:
        raise ValueError(f"bus.sync_ms = {1e3 * rig.bus.sync:g}: a board reports its position every 10 ms. Write 10.")


BOARD_PERIOD = 0.010
"""Period at which the board reports its position [s]; that of the sketch."""


def on_pseudo_terminal(rig: RigSettings, role: str) -> bool:
    """Return whether the port of a section's driver is a pseudo-terminal: an emulator on this computer."""
    return is_pseudo_terminal(getattr(rig, role).options.port)
