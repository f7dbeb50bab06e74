"""CAN bus of a rig, opened by python-can with the arguments of its interface."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from cutenv._base.validation import one_of
from cutenv.rig.config.settings import Bus
from cutenv.rig.devices.canopen.socketcand import GatewayError, Socketcand
from cutenv.rig.errors import RigError

INTERFACES = ("socketcan", "pcan", "kvaser", "slcan", "socketcand", "virtual")
"""Interfaces that are known to work, in python-can's names."""
_CURES = {
    "socketcan": "Bring the interface up: ip link set {channel} up type can bitrate {bitrate}.",
    "pcan": "Is the adapter plugged in, is PCAN-Basic installed, is the channel right (PCAN_USBBUS1)?",
    "kvaser": "Is the adapter plugged in, is Kvaser's CANlib installed, is the channel right (0, 1, ...)?",
    "slcan": "Is the adapter plugged in, is the serial port right, may you open it?",
    "socketcand": "Is it (or `cutenv rig emulate`) running, are host, port and channel right?",
    "virtual": "A virtual bus lives within one process.",
}


def open_bus(settings: Bus) -> Any:
    """Open the bus; return python-can's object, or for a socketcand gateway one with the same methods.

    Raises
    ------
    RigError
        If it cannot be opened; the message says what to check.
    ValueError
        If the interface is not among :data:`INTERFACES`.
    ModuleNotFoundError
        If python-can, or pyserial for slcan, is not installed.
    """
    one_of("interface", settings.interface, INTERFACES)
    import can

    if settings.interface == "slcan":
        import_module("serial")  # python-can would hide which module is missing
    if settings.interface == "socketcand":
        try:
            return Socketcand(settings)
        except GatewayError as error:
            raise RigError(f"{error}. {_CURES['socketcand']}") from error
    try:
        return can.Bus(interface=settings.interface, ignore_config=True, **bus_arguments(settings))
    except (can.CanError, OSError, ValueError, TypeError, NameError, AttributeError) as error:
        # NameError and AttributeError come from python-can if an adapter's library is not installed.
        cure = _CURES[settings.interface].format(channel=settings.channel, bitrate=settings.bitrate)
        raise RigError(
            f"no CAN bus at interface {settings.interface!r}, channel {settings.channel!r}: {error}. {cure}"
        ) from error


def bus_arguments(settings: Bus) -> dict[str, Any]:
    """Return the arguments of python-can's class for the interface.

    Raises
    ------
    ValueError
        If the channel is not valid for the interface.
    """
    if settings.interface == "socketcand":
        return {"channel": settings.channel, "host": settings.host, "port": settings.port}
    if settings.interface == "kvaser":
        if not settings.channel.isdecimal():
            raise ValueError(f"channel {settings.channel!r} is not one of Kvaser's, which are numbers: 0, 1, ...")
        return {"channel": int(settings.channel), "bitrate": settings.bitrate}
    if settings.interface in ("pcan", "slcan"):
        return {"channel": settings.channel, "bitrate": settings.bitrate}
    return {"channel": settings.channel}  # the bit rate of socketcan is set by the system, a virtual bus has none
