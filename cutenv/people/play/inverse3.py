"""Haply Inverse3 by the WebSocket of its service.

JSON, one answer for each message.

Protocol: Haply's public documentation of the Inverse Service, simulation channel, versions 3.0 to 3.5. On connection
the service sends an inventory. From then on it answers every message with the state of all devices; a command holds
until the next message and lapses when they end. Forces are in newtons, positions in metres; x points to the right. A
service from 3.5 on has a ``session_id`` and takes a force as ``vector``, those before as ``values``.
"""

from __future__ import annotations

import json
from contextlib import ExitStack
from typing import Any

from cutenv._base.imports import optional_import
from cutenv.people.play.haptics import VirtualCoupling
from cutenv.people.play.polled_handle import HandleSample, checked_sample

INVERSE3_URL = "ws://localhost:10001"
"""Address of the service on its own machine."""
INVERSE3_COUPLING = VirtualCoupling(stiffness=150.0, damping=0.1, device_damping=0.5, device_mass=0.3, period=0.005)
"""Coupling for a force that a program in Python holds for 5 ms at most.

The device's damping is assumed: measure it.
"""
_PROFILE = "cutenv:play"
_BUTTONS = {"a": "next", "b": "repeat", "button_0": "next", "button_1": "repeat"}
_OPEN_WITHIN, _ANSWER_WITHIN = 3.0, 0.010  # [s]
_MOST_PENDING = 3  # messages without an answer, beyond which no other is sent
_MAX_MESSAGE_BYTES = 1 << 20  # bytes of a message


class Inverse3Link:
    """Link to one Inverse3, the first unless an id is given."""

    def __init__(self, url: str = INVERSE3_URL, *, device_id: str | None = None) -> None:
        self._url, self._wanted_id = url, device_id
        self._stack = ExitStack()
        self._socket: Any = None
        self._id, self._force_key = "", "vector"
        self._first = self._pending = 0

    def open(self) -> None:
        """Connect to the service and choose the device; OSError without a ready one."""
        client = optional_import("websockets.sync.client", "websockets", "A Haply Inverse3", extra="play")
        try:
            self._socket = self._stack.enter_context(
                client.connect(
                    self._url, open_timeout=_OPEN_WITHIN, max_size=_MAX_MESSAGE_BYTES, compression=None, proxy=None
                )
            )
            inventory = self._socket.recv(timeout=_OPEN_WITHIN)
        except (OSError, TimeoutError, EOFError) as error:
            raise OSError(f"no Inverse Service answers at {self._url} ({error}). Start Haply's first.") from None
        except Exception as error:  # the library's own: no address, or another protocol
            raise OSError(f"{self._url} is no Inverse Service ({error}). The usual one is {INVERSE3_URL}.") from None
        try:
            message = _message(inventory)
            device = _device(message, self._wanted_id)
        except ValueError as error:
            self.close()
            raise OSError(f"the Inverse Service at {self._url} has no Inverse3 to use: {error}") from None
        self._id, self._force_key = device["device_id"], "vector" if "session_id" in message else "values"
        self._first = 1
        self._pending = 0

    def exchange(self, force: tuple[float, float, float]) -> HandleSample:
        """Send a force [N], return the state answered: :class:`~cutenv.people.play.polled_handle.HandleLink`."""
        closed = optional_import("websockets.exceptions", "websockets", "A Haply Inverse3", extra="play")
        try:
            if self._pending <= _MOST_PENDING:
                self._socket.send(json.dumps(self._command(force)))
                self._pending += 1
            newest = self._socket.recv(timeout=_ANSWER_WITHIN)
            self._pending -= 1
            while self._pending:  # answers that had come late
                newest = self._socket.recv(timeout=_ANSWER_WITHIN)
                self._pending -= 1
        except closed.ConnectionClosed as error:
            raise OSError(f"the Inverse Service ended the connection ({error}).") from None
        return inverse3_sample(newest, self._id)

    def close(self) -> None:
        """End the connection: without messages the service lets the device go."""
        self._stack.close()

    def _command(self, force: tuple[float, float, float]) -> dict[str, Any]:
        values = dict(zip("xyz", force, strict=True))
        command = {"device_id": self._id, "commands": {"set_cursor_force": {self._force_key: values}}}
        message: dict[str, Any] = {"inverse3": [command]}
        if self._first:  # the service shows this name for the session
            self._first = 0
            message["session"] = {"configure": {"profile": {"name": _PROFILE}}}
        return message


def inverse3_sample(text: str | bytes, device_id: str) -> HandleSample:
    """Return the sample in a state message; ValueError if it holds none."""
    message = _message(text)
    state = _device(message, device_id).get("state")
    position = state.get("cursor_position") if isinstance(state, dict) else None
    if not isinstance(position, dict):
        raise ValueError(f"device {device_id} has no cursor_position.")
    values = [position.get(axis) for axis in "xyz"]
    if not all(isinstance(value, int | float) and not isinstance(value, bool) for value in values):
        raise ValueError(f"cursor_position {str(position)[:80]} holds no three numbers.")
    try:
        x, y, z = (float(value) for value in values)  # type: ignore[arg-type]
    except OverflowError:
        raise ValueError("cursor_position holds a number that is none.") from None
    return checked_sample((x, y, z), _buttons(message))


def _message(text: str | bytes) -> dict[str, Any]:
    try:
        message = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"a message of the service is no JSON ({str(error)[:80]}).") from None
    if not isinstance(message, dict):
        raise ValueError("a message of the service is no JSON object.")
    return message


def _device(message: dict[str, Any], device_id: str | None) -> dict[str, Any]:
    """Return the device of that id, or the first; ValueError without."""
    devices = message.get("inverse3")
    found = [each for each in devices if isinstance(each, dict)] if isinstance(devices, list) else []
    ids = [each["device_id"] for each in found if isinstance(each.get("device_id"), str)]
    chosen = next((each for each in found if each.get("device_id") in ([device_id] if device_id else ids)), None)
    if chosen is None:
        raise ValueError(
            f"it reports {', '.join(ids) or 'none'}. Connect the device{f' {device_id}' * bool(device_id)}."
        )
    status = chosen.get("status")
    if isinstance(status, dict):
        for name, cure in (("power_supply", "plug in its power supply"), ("ready", "calibrate it and wait")):
            if status.get(name) is False:
                raise ValueError(f"device {chosen['device_id']} says {name}: false; {cure}.")
    return chosen


def _buttons(message: dict[str, Any]) -> frozenset[str]:
    """Return the buttons of the first grip, by cable or without."""
    pressed: set[str] = set()
    for kind in ("verse_grip", "wireless_verse_grip"):
        grips = message.get(kind)
        for grip in grips if isinstance(grips, list) else []:
            state = grip.get("state") if isinstance(grip, dict) else None
            if not isinstance(state, dict):
                continue
            buttons = state.get("buttons")
            held = buttons if isinstance(buttons, dict) else {"a": state.get("button")}
            pressed |= {_BUTTONS[name] for name, down in held.items() if down is True and name in _BUTTONS}
    return frozenset(pressed)
