"""Emulated rig whose blade a machine with GRBL moves, with a load cell on a board of its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from cutenv.rig.emulator.faults import InjectedFault
from cutenv.rig.emulator.serial.emulated_grbl import EmulatedGrbl
from cutenv.rig.emulator.serial.serial_faults import GRBL_FAULTS
from cutenv.rig.emulator.serial.serial_rig import SWITCHES, EmulatedSerialRig, SerialOptions


class EmulatedGrblRig(EmulatedSerialRig):
    """Emulated rig on two serial lines: a machine with GRBL, and the board, whose motor pins are open.

    Attributes
    ----------
    machine : EmulatedGrbl
        The machine; ``machine.line.port`` is its port, ``line.port`` the board's.
    """

    faults: ClassVar[Mapping[str, InjectedFault]] = GRBL_FAULTS

    def __init__(self, options: SerialOptions | None = None) -> None:
        self.machine = EmulatedGrbl()
        self._seen = 0, 0  # cancels, and ends of its jogs
        super().__init__(options or SerialOptions(motion="grbl"))
        if self.options.zeroed:
            self.machine.set_zero()

    @property
    def position(self) -> float:
        """Position of the carriage from the clamp [m]."""
        return 1e-3 * self.machine.carriage

    def ready(self) -> dict[str, Any]:
        """Return what drivers have to know to reach it."""
        return {**super().ready(), "port": self.machine.line.port, "sensor_port": self.line.port}

    def state(self) -> dict[str, Any]:
        """Return whether it has jogs to make, and whether both cables are in."""
        state = "operation enabled" if self.machine.state == "Jog" else "not enabled"
        cables = {"port": int(self.machine.line.plugged), "sensor_port": int(self.line.plugged)}
        return {"nodes": [{"axis": "blade", "state": state}], "clients": cables}

    def truth(self) -> dict[str, Any]:
        """Return the jogs that the machine has taken."""
        return {"jogs": self.machine.jogs_read}

    def _move(self, due: float) -> None:
        machine = self.machine
        machine.step(due)
        cancels, ends = self._seen
        self._seen = machine.cancels, machine.runs_out
        if machine.cancels > cancels:
            self.happened("quick stop received", time=due, axis="blade")
        if machine.runs_out > ends:
            self.happened("jogs made", time=due, axis="blade")
        outside = not self._axis.low - SWITCHES <= self.position <= self._axis.high + SWITCHES
        if outside and machine.state == "Jog":
            machine.alarm(1)

    def close(self) -> None:
        """Remove the ports; may be called twice."""
        super().close()
        self.machine.close()
