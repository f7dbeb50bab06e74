"""Control port of the emulated rig: one line of JSON in, one out."""

from __future__ import annotations

import dataclasses
import json
import math
import socket
import socketserver
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base.validation import in_range, one_of
from cutenv.emulation.emulated_bench import EmulatedBench
from cutenv.rig.config.mounted_specimen import MountedSpecimen
from cutenv.rig.errors import RigError
from cutenv.sim.tissue.description import load_description
from cutenv.sim.tissue.layers import Layers
from cutenv.sim.tissue.lines import CutLine
from cutenv.sim.tissue.specimen import Specimen

_MAX_REQUEST_BYTES = 1 << 16  # bytes of a request
_PATIENCE = 30.0  # [s] for a silent client
_MAX_CLIENTS = 16  # clients

Request = dict[str, Any]


def _specimen(rig: EmulatedBench, request: Request) -> Request:
    tissue = request.get("tissue")
    cure = "Give a whole number from 0."
    mounted = MountedSpecimen(
        seed=int(in_range("seed", request.get("seed", 0), 0, 2**63, "1", cure)),
        episode=int(in_range("episode", request.get("episode", 0), 0, 2**63, "1", cure)),
        specimen_class=str(request.get("class", "liver")),
        tissue=None if tissue is None else load_description(Path(str(tissue))),
        specimen=Specimen.from_json(str(request["json"])) if "json" in request else None,
        layers=None if request.get("layers") is None else Layers(**request["layers"]),
        line=None if request.get("line") is None else CutLine(*np.array(request["line"])),
    )
    for name, given, axis in (("layers", mounted.layers, "height"), ("line", mounted.line, "side")):
        if given is not None and axis not in rig.cross_axes:
            raise ValueError(f"{name}: this rig has no {axis} axis. Start the emulator with --{axis}.")
    rig.mount(mounted)
    return {"seed": mounted.seed, "episode": mounted.episode, "class": mounted.specimen_class}


def _inject(rig: EmulatedBench, request: Request) -> Request:
    given = {key: value for key, value in request.items() if key not in ("do", "fault")}
    return {"parameters": rig.inject(str(request.get("fault")), given)}


def _clear(rig: EmulatedBench, request: Request) -> Request:
    fault = request.get("fault")
    return {"cleared": rig.clear(None if fault is None else str(fault))}


def _events(rig: EmulatedBench, request: Request) -> Request:
    since = int(in_range("since", request.get("since", 0), 0, 2**53, "1", "The index of an event."))
    return {"events": rig.events(since), "now_s": rig.now()}


def _state(rig: EmulatedBench, request: Request) -> Request:
    with rig.lock:
        return {
            **rig.state(),
            "faults": [{"fault": key[0], **given} for key, given in rig.active.items()],
            "stalls": rig.stalls,
            "worst_stall_s": rig.worst_stall,
            "real_time": rig.real_time,
            "force_limit_N": rig.force_limit,
            "now_s": rig.now(),
        }


def _truth(rig: EmulatedBench, request: Request) -> Request:
    with rig.lock:
        mounted = rig.bench.mounted
        return {
            "time_s": rig.now(),
            "position_m": rig.position,
            "speed_m_s": rig.speed,
            "angle_deg": math.degrees(rig.angle),
            "force_N": rig.bench.true_force,
            **rig.truth(),
            "tip_m": None if mounted is None else rig.bench.tip,
            "specimen": None
            if mounted is None
            else {"seed": mounted.seed, "episode": mounted.episode, "class": mounted.specimen_class},
        }


def _free_air(rig: EmulatedBench, request: Request) -> Request:
    with rig.lock:
        rig.bench.take_away()
    return {}


def _watch(rig: EmulatedBench, request: Request) -> Request:
    rig.force_limit = in_range("force_N", request.get("force_N"), 0.01, 1000.0, "N", "What the rig's own limit is.")  # type: ignore[arg-type]
    return {}


def _shutdown(rig: EmulatedBench, request: Request) -> Request:
    rig.stopped.set()
    return {}


REQUESTS: dict[str, tuple[Callable[[EmulatedBench, Request], Request], tuple[str, ...] | None]] = {
    "specimen": (_specimen, ("seed", "episode", "class", "tissue", "json", "layers", "line")),
    "inject": (_inject, None),
    "clear": (_clear, ("fault",)),
    "events": (_events, ("since",)),
    "state": (_state, ()),
    "truth": (_truth, ()),
    "free_air": (_free_air, ()),
    "watch": (_watch, ("force_N",)),
    "shutdown": (_shutdown, ()),
}
"""Requests by the value of "do", with the names of their other fields; None: those of the fault."""


def answered(rig: EmulatedBench, request: Any) -> Request:
    """Return a request's answer: "ok" with result, or "error" with cure."""
    try:
        if not isinstance(request, dict):
            raise ValueError('a request is an object such as {"do": "state"}.')
        do, fields = REQUESTS[one_of("do", str(request.get("do")), REQUESTS)]
        if fields is not None and (unknown := [key for key in request if key not in ("do", *fields)]):
            listed = ", ".join(fields) or "none"
            raise ValueError(f"{request['do']!r} takes no field {unknown[0]!r}; it takes: {listed}.")
        return {"ok": True, **do(rig, request)}
    except (RigError, ValueError, TypeError, OSError) as error:
        return {"ok": False, "error": str(error)}


class _Conversation(socketserver.StreamRequestHandler):
    timeout = _PATIENCE
    disable_nagle_algorithm = True
    server: ControlServer

    def handle(self) -> None:
        with self.server.places:
            try:
                while line := self.rfile.readline(_MAX_REQUEST_BYTES):
                    answer = answered(self.server.rig, json.loads(line))
                    self.wfile.write(json.dumps(answer).encode() + b"\n")
            except (ValueError, RecursionError):  # not JSON: the client speaks another protocol
                self.wfile.write(
                    b'{"ok": false, "error": "a request is one line of JSON, such as {\\"do\\": \\"state\\"}."}\n'
                )
            except OSError:
                return  # gone, or silent for too long


class ControlServer(socketserver.ThreadingTCPServer):
    """Server of the control port of ``rig``, in own threads, on ``port``."""

    allow_reuse_address = True
    daemon_threads = True
    block_on_close = False

    def __init__(self, rig: EmulatedBench, *, host: str = "127.0.0.1", port: int = 0) -> None:
        self.rig = rig
        self.places = threading.BoundedSemaphore(_MAX_CLIENTS)
        super().__init__((host, port), _Conversation)
        self.port: int = self.server_address[1]
        self._thread = threading.Thread(
            target=self.serve_forever, args=(0.05,), name="emulator's control port", daemon=True
        )
        self._thread.start()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignore a client that left before its error was sent."""

    def close(self) -> None:
        """Stop listening."""
        self.shutdown()
        self.server_close()
        self._thread.join(timeout=2.0)


class EmulatorControl:
    """Client of the control port.

    ``port`` is what the emulator printed when it was ready; ``timeout``: time allowed for each answer [s]. Raise
    RigError from every method: if no answer arrives in time, or the emulator refuses, with its reason.
    """

    def __init__(self, port: int, *, host: str = "127.0.0.1", timeout: float = 5.0) -> None:
        self.port = port
        self._address, self._timeout = (host, port), timeout
        self.ask("state")  # fails if no emulator answers

    def ask(self, do: str, **fields: Any) -> Request:
        """Send one request over a new connection, and return the answer."""
        host, port = self._address
        try:
            with socket.create_connection(self._address, timeout=self._timeout) as connected:
                connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                connected.sendall(json.dumps({"do": do, **fields}).encode() + b"\n")
                with connected.makefile("rb") as lines:
                    line = lines.readline()
        except ConnectionRefusedError as error:
            raise RigError(
                f"no emulator answers at {host}:{port} ({error}): is it still running? 'cutenv rig emulate' starts one."
            ) from error
        except OSError as error:
            raise RigError(f"the emulator does not answer {do!r} ({error}): is it still running?") from error
        if not line:
            raise RigError(f"the emulator has ended before it answered {do!r}: start it again.")
        answer: Request = json.loads(line)
        if not answer.pop("ok"):
            raise RigError(f"the emulator refuses {do!r}: {answer['error']}")
        return answer

    def specimen(
        self, *, seed: int = 0, episode: int = 0, specimen_class: str = "liver", tissue: Path | str | None = None
    ) -> Request:
        """Mount a fresh specimen, blade at the clamp; ``tissue`` is a description's file."""
        extra = {} if tissue is None else {"tissue": str(Path(tissue).absolute())}
        return self.ask("specimen", seed=seed, episode=episode, **{"class": specimen_class}, **extra)

    def mount(
        self, specimen: Specimen, *, seed: int = 0, episode: int = 0, layers: Layers | None = None,
        line: CutLine | None = None,
    ) -> Request:  # fmt: skip
        """Mount a given specimen; seed and episode select sensor noise.

        Layers are for a rig with a height axis, a line for one with an axis to the side.
        """
        more: Request = {} if layers is None else {"layers": dataclasses.asdict(layers)}
        if line is not None:
            more["line"] = np.round(line, 9).tolist()
        return self.ask(
            "specimen",
            seed=seed,
            episode=episode,
            json=specimen.to_json(),
            **{"class": specimen.specimen_class},
            **more,
        )

    def inject(self, fault: str, **parameters: Any) -> Request:
        """Start a fault, one that this rig knows; return its parameters."""
        return self.ask("inject", fault=fault, **parameters)

    def clear(self, fault: str | None = None) -> list[str]:
        """End one fault, or all; return their names."""
        cleared: list[str] = self.ask("clear", **({} if fault is None else {"fault": fault}))["cleared"]
        return cleared

    def events(self, since: int = 0) -> list[Request]:
        """Return events from index ``since``; ``time_s`` is on the monotonic clock."""
        events: list[Request] = self.ask("events", since=since)["events"]
        return events

    def state(self) -> Request:
        """Return drives, active faults, clients, and the emulator's own stalls."""
        return self.ask("state")

    def truth(self) -> Request:
        """Return values that only an emulator knows: true force, crack, carriage."""
        return self.ask("truth")

    def free_air(self) -> None:
        """Remove the specimen."""
        self.ask("free_air")

    def watch(self, force_N: float) -> None:
        """Set the true force [N] whose crossing is an event."""
        self.ask("watch", force_N=force_N)

    def shutdown(self) -> None:
        """End the emulator."""
        self.ask("shutdown")
