"""Trials of faults that end the rig's own process or its parent: the rig cuts in a separate process."""

from __future__ import annotations

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from typing import Any

from cutenv.emulation.control_port import EmulatorControl
from cutenv.emulation.process import RunningEmulator, emulated_settings
from cutenv.rig.devices.canopen.network import DRIVE_PATIENCE
from cutenv.rig.errors import RigError
from cutenv.rig.safety.stop_causes import Cause, StopReport
from scripts.validation.rig.cutting_rig import LATCHED_FOR, CuttingRig
from scripts.validation.rig.rig_trials import Trial, moved_since, put_together, stalls_around

_PATIENCE = 60.0  # [s] to wait for a child process


class CutProcess:
    """A rig that cuts in a separate process; see :func:`cut_until_stopped`.

    ``kept`` puts a process between this one and it, which can then be killed; ``errors`` is the descriptor of its
    standard error, and of its spine's.
    """

    def __init__(self, emulator: RunningEmulator, *, seed: int, kept: bool = False, errors: int | None = None) -> None:
        command = [
            sys.executable,
            "-m",
            "scripts.validation.rig.rig_cut_process",
            json.dumps(emulator.ready),
            str(seed),
        ]
        keeper = [sys.executable, "-c", "import subprocess, sys; subprocess.run(sys.argv[1:])"]
        self.process = subprocess.Popen(
            keeper + command if kept else command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors
        )
        self._read = b""

    def line(self) -> dict[str, Any]:
        """Return the next line of JSON from the process; RigError if none arrives in time."""
        output = self.process.stdout
        assert output is not None
        deadline = time.monotonic() + _PATIENCE
        while b"\n" not in self._read:
            ready, _, _ = select.select([output], [], [], max(deadline - time.monotonic(), 0.0))
            read = os.read(output.fileno(), 4096) if ready else b""
            if not read:
                raise RigError("the process that cuts prints nothing any more; the reason is printed above.")
            self._read += read
        line, _, self._read = self._read.partition(b"\n")
        return json.loads(line)

    def end(self) -> None:
        """End the process, whatever it is doing."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(_PATIENCE)
        assert self.process.stdout is not None
        self.process.stdout.close()


_SIGNALS = {
    "sigterm": signal.SIGTERM,
    "ctrl_c": signal.SIGINT,
    "parent_death": signal.SIGKILL,
    "kill_9": signal.SIGKILL,
}


def trial_in_child(emulator: RunningEmulator, fault: str, *, seed: int, after: float) -> Trial:
    """Run one trial of a fault in :data:`IN_CHILD`: the rig cuts in a separate process, none in this one."""
    child = CutProcess(emulator, seed=seed, kept=fault == "parent_death")
    control = emulator.control
    try:
        begun = child.line()
        since = begun["since"]
        time.sleep(after)
        truth, injected = control.truth(), time.monotonic()
        try:
            os.kill(begun["spine"] if fault == "kill_9" else child.process.pid, _SIGNALS[fault])
        except ProcessLookupError:  # a busy host has stopped the cut, and the rig was closed
            raise RigError("the cut had ended before the fault came") from None
        if fault == "kill_9":
            time.sleep(DRIVE_PATIENCE + 0.1 + LATCHED_FOR)
            told: dict[str, Any] = {"refused": not _enabled(control), "stalls": [], "report": None}
        else:
            told = child.line()
    finally:
        child.end()
    events = control.events(since)
    report = told["report"]
    if report is not None:
        way = report.pop("way")
        report = StopReport(**{**report, "cause": Cause(report["cause"])})
        report.position, report.rest_position = 0.0, way
    result = put_together(fault, seed, truth, injected, report, events, emulator.settings)
    result.refused = told["refused"]
    result.moved = moved_since(control, events)
    result.stalls = stalls_around(result, events, [(ended, late) for ended, late in told["stalls"]])
    return result


def _enabled(control: EmulatorControl) -> bool:
    """Return True if a drive is powered and follows its target."""
    return any(node["state"] == "operation enabled" for node in control.state()["nodes"])


def cut_until_stopped(ready: dict[str, Any], seed: int, tell: Callable[[dict[str, Any]], None]) -> None:
    """Run in the child: cut until stopped, check that it stays stopped, and report.

    It ends by itself once its parent is gone: the process above then reads what it prints.
    """
    control = EmulatorControl(ready["control"])
    rig = CuttingRig(emulated_settings(ready), control)
    try:
        rig.begin(seed)
        rig.cut(rig.period)
        tell({"since": len(control.events()), "spine": rig.plant.spine.pid})
        report = rig.cut(20.0)
        refused = report is not None and rig.refuses()
        told = None
        if report is not None:
            told = {
                "cause": report.cause,
                "detail": report.detail,
                "detected": report.detected,
                "way": report.distance_to_standstill,
            }
        tell({"report": told, "refused": refused, "stalls": rig.host.stalls})
    finally:
        rig.close()


if __name__ == "__main__":
    ready, seed = sys.argv[1:]
    cut_until_stopped(json.loads(ready), int(seed), lambda told: print(json.dumps(told), flush=True))
