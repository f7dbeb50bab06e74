"""Options of an axis on a machine with GRBL, its periods, and what GRBL cannot drive."""

from __future__ import annotations

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
