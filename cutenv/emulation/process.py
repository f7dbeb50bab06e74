"""Process of the emulated rig: its server, and the client that starts it."""

from __future__ import annotations

import datetime
import gc
import json
import math
import os
import select
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from cutenv._base.output import atomic_write
from cutenv._base.validation import one_of
from cutenv._engine.jit import warn_before_first_compile
from cutenv.drivers.analogue_sensor import AnalogueOptions
from cutenv.drivers.slow_profile import grbl_settings, slow_settings
from cutenv.emulation.canopen_rig import RANGES, EmulatedRig, Options
from cutenv.emulation.control_port import ControlServer, EmulatorControl
from cutenv.emulation.emulated_bench import STALL, EmulatedBench
from cutenv.emulation.mechanics import position_control, turn_motor
from cutenv.emulation.serial_rig import EmulatedGrblRig, EmulatedSerialRig, SerialOptions
from cutenv.rig.config.mounted_specimen import MountedSpecimen
from cutenv.rig.config.settings import (
    EMULATED,
    EMULATOR,
    Bus,
    PositionControl,
    RigSettings,
    SensorCalibration,
    SensorSettings,
)
from cutenv.rig.config.settings import across as cross_axes
from cutenv.rig.devices.loop import prefer
from cutenv.rig.errors import RigError
from cutenv.rig.toml_file import to_toml
from cutenv.sim.cutting.descent import DESCENDING
from cutenv.sim.cutting.motion import STRAIGHT
from cutenv.sim.cutting.sensor import measure
from cutenv.sim.cutting.simulate import follow
from cutenv.sim.cutting.steering import STEERED
from cutenv.sim.tissue.grid import N_POINTS, SPACING
from cutenv.sim.tissue.lines import straight

STARTS_WITHIN = 180.0  # time allowed for a start [s]; the first one on a machine compiles
_ENDS_WITHIN = 5.0  # [s]
_SWITCH = 0.0005  # [s] after which a thread lets another one run: a millisecond holds several


def warm_up(*, across: Sequence[str] = (), serial: bool = False) -> None:
    """Compile or load the kernels of a millisecond beforehand."""
    in_plane: list[Any] = [follow(STEERED)] if "side" in across else []
    upright = DESCENDING if "height" in across else STRAIGHT
    motors: list[Any] = [] if serial else [turn_motor]  # a serial rig turns its own
    warn_before_first_compile(follow(upright), *in_plane, measure, *motors)
    for line in (None, straight())[: 1 + len(in_plane)]:
        mounted = MountedSpecimen(specimen_class="liver", line=line)
        rig: EmulatedBench
        if serial:
            rig = EmulatedSerialRig(SerialOptions(mounted=mounted))  # GRBL's has no kernels of its own
        else:
            rig = driven = EmulatedRig(Options(mounted=mounted, cross_axes=cross_axes(*across)))
            for axis in driven.axes.values():
                axis.motor["mode"] = 1
        try:
            for _ in range(10):
                rig.step(rig.now())
        finally:
            rig.close()


def serve(
    options: Options | SerialOptions,
    *,
    faults: Sequence[tuple[str, dict[str, Any], float]] = (),
    parent: int | None = None,
    real_time: bool = False,
    file: Path | None = None,
) -> None:
    """Run an emulated rig until signal, control request or parent's end.

    Prints one line of JSON when it is ready: the ports "can", "sensor" and "control", the URL "page", and "pid"; of a
    serial rig "port", "converter", "control" and "pid", with GRBL also "sensor_port". ``options``: construction of the
    rig; ``faults``: faults, each with its time after the start [s]; ``parent``: process whose end also ends this one;
    ``real_time``: take priority over other processes, if the system allows; "state" on the control port reports whether
    it did; ``file``: path at which a rig file for it is written, for ``cutenv rig run --rig FILE`` and other commands.
    Raise OSError if a port is taken; ValueError, TypeError for an unknown fault or parameter.
    """
    sys.setswitchinterval(_SWITCH)
    serial = isinstance(options, SerialOptions)
    warm_up(across=() if isinstance(options, SerialOptions) else tuple(options.cross_axes), serial=serial)
    first = real_time and prefer()  # only now: compiling takes seconds; before there are threads: they inherit it
    rig = _made(options)
    rig.real_time = first
    control = None
    try:
        for name, given, seconds in faults:
            rig.inject_later(name, given, seconds)
        control = ControlServer(rig, host=options.host, port=options.control_port)
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: rig.stopped.set())
        if parent is not None:
            threading.Thread(target=_watch_parent, args=(rig, parent), name="parent", daemon=True).start()
        gc.freeze()  # present objects are not searched for garbage again
        ready = _told(rig) | {"control": control.port, "pid": os.getpid()}
        if file is not None:
            mounted = options.mounted or MountedSpecimen()
            depth = mounted.drawn().depth
            profile = tuple((k * SPACING, round(float(depth[k]), 6)) for k in range(0, N_POINTS, 20))
            settings = _settings_of(options, ready)
            with atomic_write(file) as part:
                part.write_text(to_toml(replace(settings, depth_profile=profile)), encoding="utf-8")
        print(json.dumps(ready), flush=True)
        rig.run()
    finally:
        if control is not None:
            control.close()
        rig.close()


def _made(options: Options | SerialOptions) -> EmulatedRig | EmulatedSerialRig:
    if not isinstance(options, SerialOptions):
        return EmulatedRig(options)
    return EmulatedGrblRig(options) if options.motion == "grbl" else EmulatedSerialRig(options)


def _told(rig: EmulatedRig | EmulatedSerialRig) -> dict[str, Any]:
    """Return what a driver has to know to reach the rig."""
    if isinstance(rig, EmulatedSerialRig):
        return rig.ready()
    told = {"can": rig.hub.port, "sensor": rig.sensor.port, "page": rig.sensor.page}
    options = rig.options
    if (control := position_control(options.blade_mechanics, options.blade_axis)) is not None:
        told["position_control"] = asdict(control)
    if options.analogue is not None:
        told["calibration"] = options.analogue
    if options.range != "task":
        told["range"] = options.range
    return told


def _settings_of(options: Options | SerialOptions, ready: dict[str, Any]) -> RigSettings:
    if isinstance(options, SerialOptions):
        return emulated_settings(ready, angle=options.angle)
    return emulated_settings(
        ready, angle_mode=options.angle_mode, angle=options.angle, across=tuple(options.cross_axes),
        host=options.host,
    )  # fmt: skip


def _watch_parent(rig: EmulatedBench, parent: int) -> None:
    while not rig.stopped.wait(0.2):
        if os.getppid() != parent:
            rig.stopped.set()


def emulated_settings(
    ready: dict[str, Any],
    *,
    angle_mode: str = "free",
    angle: float = math.pi / 2,
    across: Sequence[str] = (),
    host: str = "127.0.0.1",
) -> RigSettings:
    """Return the settings of an emulated rig's drivers, calibrated today.

    The rig has printed ``ready``. ``angle`` is the angle of a fixed blade [rad]; ``across`` are the axes across the cut
    that it has. On a serial rig no drive turns the blade, and nothing raises it.
    """
    if "port" in ready:
        port, converter = ready["port"], ready["converter"]
        own = slow_settings(port, converter=converter, name="emulated serial rig")
        if "sensor_port" in ready:
            own = grbl_settings(port, ready["sensor_port"], converter=converter, name="emulated GRBL rig")
        return replace(
            own,
            armed_by="the emulator",
            fixed_angle=angle,
            calibration=SensorCalibration(date=datetime.date.today().isoformat()),
            emulated=True,
        )
    gains, mounted = ready.get("position_control"), RANGES[ready.get("range", "task")]
    return RigSettings(
        name="emulated rig",
        armed_by="the emulator",
        angle_mode="free" if angle_mode == "free" else "fixed",
        fixed_angle=angle,
        bus=Bus(interface="socketcand", channel="vcan0", host=host, port=ready["can"]),
        blade=mounted.blade,
        angle=mounted.angle if angle_mode == "free" else None,
        **cross_axes(*across),  # type: ignore[arg-type]
        position_control=None if gains is None else PositionControl(**gains),
        sensor=_sensor(ready, host),
        limits=mounted.limits,
        calibration=SensorCalibration(date=datetime.date.today().isoformat()),
        emulated=True,
    )


def _sensor(ready: dict[str, Any], host: str) -> SensorSettings:
    """Return the emulated sensor's settings: Net F/T, or analogue if calibrated."""
    if "calibration" not in ready:
        return SensorSettings(address=host, port=ready["sensor"], page=ready["page"])
    options = AnalogueOptions(calibration=ready["calibration"], board="emulated", host=host, port=ready["sensor"])
    return SensorSettings(driver="analogue", options=options, components="all")


class RunningEmulator:
    """Emulated rig in a process of its own.

    It ends with the ``with`` block, or with this process. ``arguments``: arguments of ``cutenv rig emulate``;
    ``timeout``: time until it is ready [s]. ``ready``: what it printed: its ports, and what drivers have to know. Raise
    RigError if it is not ready in time, or ends before that.
    """

    def __init__(
        self,
        arguments: Sequence[str],
        *,
        angle_mode: str,
        angle: float,
        across: Sequence[str] = (),
        timeout: float = STARTS_WITHIN,
    ) -> None:
        if os.name == "nt":  # a pipe cannot be read with a time limit there, nor a lost parent be seen
            raise RigError(
                'an emulated rig is a process that runs on Linux and macOS only. Use the rig in memory, rig="fake", or '
                "the Windows Subsystem for Linux."
            )
        self._process = subprocess.Popen(
            [sys.executable, "-m", "cutenv", "rig", "emulate", "--with-parent", str(os.getpid()), *arguments],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            start_new_session=True,  # Ctrl-C is for the rig's program, which ends the emulator in order
        )
        self.pid = self._process.pid  # id of the process
        try:
            self.ready = ready = self._ready(timeout)
            # settings for drivers that connect to it
            self.settings = emulated_settings(ready, angle_mode=angle_mode, angle=angle, across=across)
            self.control = EmulatorControl(ready["control"])  # client of its control port
        except BaseException:
            self.close()
            raise

    def _ready(self, timeout: float) -> dict[str, Any]:
        output = self._process.stdout
        assert output is not None
        deadline, line = time.monotonic() + timeout, b""
        while not line.endswith(b"\n"):
            if not select.select([output], [], [], max(deadline - time.monotonic(), 0.0))[0]:
                raise RigError(f"the emulator is not ready after {timeout:g} s: is this machine busy?")
            read = os.read(output.fileno(), 4096)
            if not read:
                raise RigError("the emulator has ended before it was ready; see its message above.")
            line += read
        ready: dict[str, Any] = json.loads(line)
        return ready

    def close(self) -> None:
        """End the process; may be called twice."""
        if self._process.poll() is None:
            self._process.terminate()
            try:
                self._process.wait(_ENDS_WITHIN)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait(_ENDS_WITHIN)
        if self._process.stdout is not None:
            self._process.stdout.close()

    @property
    def lateness(self) -> str:
        """Sentence on the emulator's own lateness, "" without or after its end."""
        try:
            worst = self.control.state()["worst_stall_s"]
        except (OSError, ValueError, RigError):
            return ""
        if worst < STALL:
            return ""
        return (
            f"the emulator itself was late by up to {1e3 * worst:.0f} ms, as no real rig is: this computer is too busy"
        )

    @property
    def status(self) -> int | None:
        """Exit status of the process; None while it runs."""
        return self._process.poll()

    def __enter__(self) -> RunningEmulator:
        """Return itself; it is running."""
        return self

    def __exit__(self, *error: object) -> None:
        """End the process."""
        self.close()


def start(
    *,
    seed: int = 0,
    specimen_class: str = "liver",
    free_air: bool = False,
    angle_deg: float | None = None,
    across: Sequence[str] = (),
    kind: str = EMULATOR,
    real_time: bool = True,
    arguments: Sequence[str] = (),
) -> RunningEmulator:
    """Start an emulated rig: ``with start(seed=3) as emulator: ...``.

    ``seed``, ``specimen_class``: key of the specimen at the start; ``free_air``: none; ``angle_deg``: angle at which
    the blade is fixed [degrees]; None: a second axis turns it; ``across``: axes across the cut that it has: "height",
    "side"; ``kind``: name of the rig, of :data:`~cutenv.rig.config.settings.EMULATED`; the blade of "serial" and "grbl"
    is fixed, upright by default; ``real_time``: take priority over other processes, if the system allows;
    ``arguments``: further options of ``cutenv rig emulate``. Raise RigError if it is not ready in time, or ends before
    that.
    """
    given = ["--seed", str(seed), "--specimen-class", specimen_class]
    given += ["--free-air"] if free_air else []
    given += ["--real-time"] if real_time else []
    given += [f"--{axis}" for axis in across]
    if one_of("kind", kind, EMULATED) != EMULATOR:
        given.append(f"--{kind}")
        angle_deg = 90.0 if angle_deg is None else angle_deg
    given += [] if angle_deg is None else ["--angle", "fixed", "--angle-deg", str(angle_deg)]
    return RunningEmulator(
        [*given, *arguments],
        angle_mode="free" if angle_deg is None else "fixed",
        angle=math.pi / 2 if angle_deg is None else math.radians(angle_deg),
        across=across,
    )
