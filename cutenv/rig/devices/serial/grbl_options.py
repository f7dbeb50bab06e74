"""Options of an axis on a machine with GRBL, its periods, and what GRBL cannot drive."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from cutenv._base.parameter import check_parameters
from cutenv._base.validation import in_range, one_of
from cutenv.rig.config.axes import Axis
from cutenv.rig.config.setting import setting
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.devices.serial.grbl_lines import GRBL_AXES

REPORT_PERIOD = 0.100
"""Period at which status reports are asked for [s]: GRBL is not made for much more."""
PIECE = 0.025
"""Time of one jog [s]."""
SENT_AHEAD = 0.150
"""Time of the motion that is sent ahead [s]: after a silence of the computer the blade goes on for so long."""


_SAME = 0.02  # [1] relative difference allowed between the machine's settings and the file
_MINUTE = 6e4  # mm/min of a m/s


@dataclass(frozen=True, kw_only=True)
class GrblOptions:
    """Options of an axis on a machine with GRBL."""

    port: str = setting(
        "", "1", "Serial port of the machine; a name below /dev/serial/by-id stays the same.",
        example='"/dev/serial/by-id/usb-..."',
    )  # fmt: skip
    baud: int = setting(115_200, "1", "Baud rate of GRBL.")
    letter: Literal["X", "Y", "Z"] = setting("X", "1", "Axis of the machine that moves the blade.")

    def __post_init__(self) -> None:
        check_parameters(self)
        one_of("letter", self.letter, GRBL_AXES)
        in_range("baud", self.baud, 9600, 4_000_000, "baud", "GRBL's own is 115200.")


def check_grbl(rig: RigSettings, role: str) -> None:
    """Raise ValueError for an axis that GRBL cannot drive."""
    axis: Axis = getattr(rig, role)
    if role != "blade":
        raise ValueError(f'{role}.driver = "grbl": it moves the blade alone. Set the angle by hand.')
    if axis.options is None:
        raise ValueError('blade.driver = "grbl" needs [blade.options] with port.')
    if axis.quick_stop != axis.acceleration:
        raise ValueError(
            f"blade.quick_stop_m_s2 = {axis.quick_stop:g} and blade.acceleration_m_s2 = {axis.acceleration:g}: GRBL "
            "has one deceleration for both ($120, $121, $122). Write the same."
        )
    if rig.bus.sync != REPORT_PERIOD:
        raise ValueError(f"bus.sync_ms = {1e3 * rig.bus.sync:g}: GRBL tells its position every 100 ms. Write 100.")


def lines_to_send(told: Mapping[int, float], axis: Axis, number: int) -> list[str]:
    """Return the lines that set a machine as the file says; empty if it is.

    ``told`` are its settings by number, and ``number`` is the place of the axis among its own.
    """
    wanted = {110 + number: _MINUTE * axis.speed, 120 + number: 1e3 * axis.acceleration}
    wrong = [
        f"${key}={value:.3f}" for key, value in wanted.items() if not abs(told.get(key, 0.0) / value - 1.0) <= _SAME
    ]
    if not int(told.get(10, 1)) & 1:  # reports of the machine position
        wrong.append("$10=1")
    if told.get(13, 0.0):  # in inches
        wrong.append("$13=0")
    return wrong
