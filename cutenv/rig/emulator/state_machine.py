"""State machine of a CiA 402 drive: effect of a controlword in each state, and the statusword of each state."""

from __future__ import annotations

from enum import IntEnum

from cutenv.rig.devices.samples import DriveState

S = DriveState

STATUSWORDS = {
    S.NOT_READY: 0x0000,
    S.DISABLED: 0x0040,
    S.READY: 0x0021,
    S.SWITCHED_ON: 0x0033,
    S.ENABLED: 0x0037,
    S.QUICK_STOP: 0x0017,
    S.REACTING: 0x001F,
    S.FAULT: 0x0008,
}
"""Bits 0 to 6 of the statusword (6041), the power stage's voltage (bit 4) among them: masked by 0x6F, CiA 402's."""

POWERED = frozenset({S.ENABLED, S.QUICK_STOP, S.REACTING})
"""States in which the motor has torque."""


class StatusBit(IntEnum):
    """Other bits of the statusword."""

    REMOTE = 0x0200
    TARGET_REACHED = 0x0400
    INTERNAL_LIMIT = 0x0800
    AT_REST = 0x1000
    """Bit set at rest in profile velocity mode, or, in homing mode, when home is found."""
    FOLLOWING_ERROR = 0x2000
    HOMED = 0x8000


class DriveCommand(IntEnum):
    """Command in the low byte of a controlword (6040), as CiA 402 masks it."""

    DISABLE_VOLTAGE = 0
    QUICK_STOP = 1
    SHUTDOWN = 2
    SWITCH_ON = 3
    ENABLE = 4


FAULT_RESET_BIT = 0x80
HALT = 0x100


def command(controlword: int) -> DriveCommand:
    """Return the command in a controlword, without its fault reset."""
    if not controlword & 0x02:
        return DriveCommand.DISABLE_VOLTAGE
    if not controlword & 0x04:
        return DriveCommand.QUICK_STOP
    if not controlword & 0x01:
        return DriveCommand.SHUTDOWN
    return DriveCommand.ENABLE if controlword & 0x08 else DriveCommand.SWITCH_ON


_NEXT = {
    (S.DISABLED, DriveCommand.SHUTDOWN): S.READY,
    (S.READY, DriveCommand.SWITCH_ON): S.SWITCHED_ON,
    (S.READY, DriveCommand.ENABLE): S.ENABLED,  # by way of switched on
    (S.READY, DriveCommand.DISABLE_VOLTAGE): S.DISABLED,
    (S.READY, DriveCommand.QUICK_STOP): S.DISABLED,
    (S.SWITCHED_ON, DriveCommand.ENABLE): S.ENABLED,
    (S.SWITCHED_ON, DriveCommand.SHUTDOWN): S.READY,
    (S.SWITCHED_ON, DriveCommand.DISABLE_VOLTAGE): S.DISABLED,
    (S.SWITCHED_ON, DriveCommand.QUICK_STOP): S.DISABLED,
    (S.ENABLED, DriveCommand.SWITCH_ON): S.SWITCHED_ON,
    (S.ENABLED, DriveCommand.SHUTDOWN): S.READY,
    (S.ENABLED, DriveCommand.DISABLE_VOLTAGE): S.DISABLED,
    (S.ENABLED, DriveCommand.QUICK_STOP): S.QUICK_STOP,
    (S.QUICK_STOP, DriveCommand.DISABLE_VOLTAGE): S.DISABLED,
}


def after(state: DriveState, controlword: int, before: int, *, quick_stop_option: int) -> DriveState:
    """Return the state after a controlword.

    Parameters
    ----------
    state : DriveState
        Present state.
    controlword, before : int
        New controlword and the one before it: a rising edge of bit 7 resets a fault.
    quick_stop_option : int
        Value of object 605A: from 5 on the drive stays in quick stop, and may be enabled again.
    """
    if state is S.FAULT:
        return S.DISABLED if controlword & FAULT_RESET_BIT and not before & FAULT_RESET_BIT else S.FAULT
    asked = command(controlword)
    if state is S.QUICK_STOP and asked is DriveCommand.ENABLE and quick_stop_option >= 5:
        return S.ENABLED
    return _NEXT.get((state, asked), state)
