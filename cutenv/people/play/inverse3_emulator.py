"""Emulated Inverse3 with its service.

A handle with mass and damping, in a hand that follows a script.

    python -m cutenv.people.play.inverse3_emulator --port 10001

It speaks the protocol of :mod:`cutenv.people.play.inverse3`, and lets go, as the service does, when messages stay out.
The first line that it prints is its address. Nothing about it was measured on a device: mass and damping are assumed.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from cutenv._base.validation import in_range
from cutenv.people.play.devices import simple_hand

SERVICE_FAULTS = ("freeze", "garbage", "unplugged", "hang up", "slow")
"""Faults from a moment on: no answers, answers that are no JSON, no device in them, an end of the
connection, answers after 50 ms."""
_SUBSTEP = 2.5e-4  # [s]
_LETS_GO = 0.1  # [s] without a message
_SLOW = 0.050  # [s]
_PRESSED = (0.5, 0.8)  # [s] after the connection between which the grip's button is down


@dataclass
class EmulatedHandle:
    """Handle on one axis, led by the hand's spring and damper.

    The hand aims at a place [m] by the time since the connection [s]; mass [kg] and damping [N s/m] are assumed.
    """

    target: Callable[[float], float]
    mass: float = 0.3  # [kg]
    damping: float = 0.5  # [N s/m]
    hand_stiffness: float = 400.0  # [N/m]
    hand_damping: float = 8.0  # [N s/m]
    position: float = 0.0
    speed: float = 0.0
    time: float = 0.0
    force: float = 0.0

    def advance(self, until: float) -> None:
        """Advance to a time [s] under the force that is held."""
        while self.time < until:
            step = min(_SUBSTEP, until - self.time)
            hand = self.hand_stiffness * (self.target(self.time) - self.position) - self.hand_damping * self.speed
            self.speed += step / self.mass * (hand + self.force - self.damping * self.speed)
            self.position += step * self.speed
            self.time += step


def state_message(handle: EmulatedHandle, device_id: str, *, inventory: bool, modern: bool, pressed: bool) -> str:
    """Return a service message on the handle: inventory or state."""
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    device: dict[str, Any] = {
        "device_id": device_id,
        "state": {
            "cursor_position": {"x": handle.position, "y": -0.12, "z": 0.15},
            "cursor_velocity": zero | {"x": handle.speed},
            "current_cursor_force": zero | {"x": handle.force},
            "control_mode" if modern else "mode": "force" if handle.force else "idle",
        },
        "status": {"calibrated": True, "in_use": True, "power_supply": True, "ready": True, "started": True},
    }
    if inventory:
        device["config"] = {"type": "inverse3", "handedness": "right"}
    grip = {"device_id": "61548", "state": {"buttons": {"a": pressed, "b": False, "c": False}}}
    message: dict[str, Any] = {"inverse3": [device], "wireless_verse_grip": [grip]}
    return json.dumps(({"session_id": 7} if modern else {}) | message)


def _serve(socket: Any, arguments: argparse.Namespace) -> None:
    script = simple_hand(arguments.target_mm * 1e-3)._script
    handle = EmulatedHandle(lambda now: script(max(now - arguments.wait, 0.0)).position)
    start, modern, key = time.monotonic(), arguments.service >= 3.5, "vector" if arguments.service >= 3.5 else "values"
    tell = {"device_id": "049D", "modern": modern}
    socket.send(state_message(handle, **tell, inventory=True, pressed=False))
    while True:
        try:
            received = json.loads(socket.recv(timeout=_LETS_GO))
        except TimeoutError:
            handle.advance(time.monotonic() - start)
            handle.force = 0.0
            continue
        now = time.monotonic() - start
        handle.advance(now)
        command = received["inverse3"][0]["commands"]["set_cursor_force"]
        handle.force = float(command[key]["x"])
        fault = arguments.fault if now >= arguments.after else None
        if fault == "hang up":
            return
        if fault == "freeze":
            continue
        if fault == "slow":
            time.sleep(_SLOW)
        pressed = any(begin <= now < end for begin, end in (_PRESSED, arguments.takes_over))
        answer = state_message(handle, **tell, inventory=False, pressed=pressed)
        if fault == "unplugged":
            answer = json.dumps({"inverse3": [], "wireless_verse_grip": []})
        socket.send("{" if fault == "garbage" else answer)


def main(argv: Sequence[str] | None = None) -> int:
    """Serve until Ctrl-C; return 0."""
    from websockets.exceptions import ConnectionClosed
    from websockets.sync.server import serve

    arguments = _parser().parse_args(argv)
    in_range("--target-mm", arguments.target_mm, 5.0, 150.0, "mm", "Give the cut's target.")

    def talk(socket: Any) -> None:
        try:
            _serve(socket, arguments)
        except ConnectionClosed:
            pass
        except (ValueError, KeyError, IndexError, TypeError) as error:
            print(f"not understood: {type(error).__name__}: {error}", file=sys.stderr, flush=True)

    with serve(talk, "127.0.0.1", arguments.port, compression=None) as server:
        print(f"ws://127.0.0.1:{server.socket.getsockname()[1]}", flush=True)
        with suppress(KeyboardInterrupt):
            server.serve_forever()
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m cutenv.people.play.inverse3_emulator", description=__doc__.split("\n")[0]
    )
    add = parser.add_argument
    add("--port", type=int, default=10001, metavar="PORT", help="port on this machine, 0 for any; default 10001")
    add("--target-mm", type=float, default=80.0, metavar="MM", help="target of the cut at which the hand aims [mm]")
    add("--wait", type=float, default=4.0, metavar="S", help="rest of the hand after the connection [s]; default 4")
    add(
        "--takes-over", type=float, nargs=2, default=(0.0, 0.0), metavar=("S", "S"),
        help="times after the connection between which the grip's button is down once more [s]",
    )  # fmt: skip
    add("--service", type=float, default=3.5, choices=(3.1, 3.5), help="version of the protocol; default 3.5")
    add("--fault", choices=SERVICE_FAULTS, help="what goes wrong")
    add("--after", type=float, default=0.0, metavar="S", help="time of the fault after the connection [s]")
    return parser


if __name__ == "__main__":
    sys.exit(main())
