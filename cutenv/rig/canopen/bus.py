"""The CAN bus of a rig, opened by python-can with what its interface takes."""

from __future__ import annotations

import logging
import socket
from importlib import import_module
from typing import Any

from cutenv.rig.drivers import RigError
from cutenv.rig.settings import Bus
from cutenv.validation import one_of

_GREETING_LIMIT = 2.0  # [s] for a gateway to take the connection, and to greet

INTERFACES = ("socketcan", "pcan", "kvaser", "slcan", "socketcand", "virtual")
"""Those that are known to work, as python-can names them."""
_CURES = {
    "socketcan": "Bring the interface up: ip link set {channel} up type can bitrate {bitrate}.",
    "pcan": "Is the adapter plugged in, is PCAN-Basic installed, is the channel right (PCAN_USBBUS1)?",
    "kvaser": "Is the adapter plugged in, is Kvaser's CANlib installed, is the channel right (0, 1, ...)?",
    "slcan": "Is the adapter plugged in, is the serial port right, may you open it?",
    "socketcand": "Does the gateway or emulator serve a bus of that name?",
    "virtual": "A virtual bus lives within one process.",
}


def open_bus(settings: Bus) -> Any:
    """Open the bus and return python-can's object.

    Raises
    ------
    RigError
        If it cannot be opened; says what to look at.
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
        # It warns of every frame that TCP has split in two, and then reads it rightly.
        logging.getLogger("can.interfaces.socketcand").setLevel(logging.ERROR)
        _meet_gateway(settings)
    try:
        return can.Bus(interface=settings.interface, ignore_config=True, **bus_arguments(settings))
    except (can.CanError, OSError, ValueError, TypeError, NameError, AttributeError) as error:
        # NameError and AttributeError: what an adapter's library that is not installed looks like to python-can.
        cure = _CURES[settings.interface].format(channel=settings.channel, bitrate=settings.bitrate)
        raise RigError(
            f"no CAN bus at interface {settings.interface!r}, channel {settings.channel!r}: {error}. {cure}"
        ) from error


def bus_arguments(settings: Bus) -> dict[str, Any]:
    """Return what python-can's class for the interface takes.

    Raises
    ------
    ValueError
        If the channel is not what the interface calls its channels.
    """
    if settings.interface == "socketcand":
        # Without tcp_tune a frame of some ten bytes waits for the acknowledgement of the one before.
        return {"channel": settings.channel, "host": settings.host, "port": settings.port, "tcp_tune": True}
    if settings.interface == "kvaser":
        if not settings.channel.isdecimal():
            raise ValueError(f"channel {settings.channel!r} is none of Kvaser's, which are numbers: 0, 1, ...")
        return {"channel": int(settings.channel), "bitrate": settings.bitrate}
    if settings.interface in ("pcan", "slcan"):
        return {"channel": settings.channel, "bitrate": settings.bitrate}
    return {"channel": settings.channel}  # the bit rate of socketcan is set by the system, a virtual bus has none


def _meet_gateway(settings: Bus) -> None:
    """See that a gateway is there: python-can would try for ten seconds, and wait for its greeting for ever."""
    where = f"{settings.host}:{settings.port}"
    try:
        with socket.create_connection((settings.host, settings.port), timeout=_GREETING_LIMIT) as gateway:
            greeting = gateway.recv(64)
    except OSError as error:
        raise RigError(
            f"no CAN gateway at {where}: {error}. Is it (or `cutenv rig emulate`) running, are host and port right?"
        ) from error
    if not greeting.startswith(b"< hi"):
        raise RigError(f"what answers at {where} is no socketcand gateway: it says {greeting!r}. Is the port right?")
