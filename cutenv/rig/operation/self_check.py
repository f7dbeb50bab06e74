"""Inspection of an open rig at rest and without power, and of its camera: checks, and what the devices report."""

from __future__ import annotations

import time
from dataclasses import dataclass
from datetime import date
from typing import Any

import numpy as np

from cutenv.rig.config.settings import CameraSettings, RigSettings
from cutenv.rig.devices.camera import RigCamera
from cutenv.rig.devices.drivers import DriveState
from cutenv.rig.errors import RigError
from cutenv.rig.operation.preflight import Check, may_move, still_checks
from cutenv.rig.operation.recorder import Recorder
from cutenv.rig.plant import RigPlant

LISTEN = 2.0
"""Time for which readings, samples and heartbeats are observed [s]."""
_SAME_RATE = 0.02  # relative difference allowed between measured and set rate
_LOST = 0.1  # share of the loss limit at which this check fails
_ZERO = "zero_set"  # report of a drive whose zero a person sets
_PER = {"low": "", "high": "", "speed": "_s", "acceleration": "_s2", "quick_stop": "_s2"}


@dataclass(frozen=True, kw_only=True)
class Inspection:
    """Result of an inspection.

    Attributes
    ----------
    checks : tuple of Check
        Checks, in order.
    told : dict
        Data that each device reports, and measurements of it; units are in the names.
    """

    checks: tuple[Check, ...]
    told: dict[str, dict[str, Any]]

    @property
    def passed(self) -> bool:
        """True if every check has passed."""
        return all(check.passed for check in self.checks)


def inspect(plant: RigPlant, today: date) -> Inspection:
    """Inspect an open rig for some seconds; nothing moves, and no drive is powered.

    The sensor is tared, until the connection ends: nothing may touch the blade.

    Raises
    ------
    RigError
        If a drive no longer answers.
    """
    checks = may_move(plant.settings, today)
    try:
        x, y, z = plant.tare()
        checks.append(Check("steady force", True, f"zero taken at ({x:.2f}, {y:.2f}, {z:.2f}) N"))
    except RigError as error:
        checks.append(Check("steady force", False, f"{error}"))
    recorder = Recorder("xyz".index(plant.settings.sensor.cut_axis))
    start = plant.clock.now()
    plant.witness = recorder
    try:
        plant.clock.sleep_until(start + LISTEN)
    finally:
        plant.witness = None
    checks += still_checks(plant)
    told: dict[str, dict[str, Any]] = {name: dict(about) for name, about in plant.spine.about().items()}
    checks += [
        Check(f"{name} zero", about[_ZERO] == "yes", "set by hand" if about[_ZERO] == "yes" else str(about[_ZERO]))
        for name, about in told.items()
        if _ZERO in about
    ]
    for name, limits in plant.spine.drive_limits().items():
        unit = "rad" if name == "angle" else "m"
        told[name] |= {f"limit_{what}_{unit}{_PER[what]}": value for what, value in limits.items()}
    end = start + LISTEN
    found = [_forces(plant.settings, recorder, start, end, plant.spine.rate_error)]
    found += [_motion(plant, name, recorder, start, end) for name in told if name != "sensor"]
    for name, more, about in found:
        checks += more
        told[name] |= about
    return Inspection(checks=tuple(checks), told=told)


_Found = tuple[str, list[Check], dict[str, Any]]


def _check(name: str, passed: bool, found: str, cure: str) -> Check:
    return Check(name, bool(passed), found if passed else f"{found}; {cure}")


def _forces(settings: RigSettings, recorder: Recorder, start: float, end: float, rate_error: float) -> _Found:
    readings, limits = recorder.forces(start, end), settings.limits
    if len(readings) < 2:
        cure = "switch the sensor on, and close other programs that read it"
        return "sensor", [_check("force rate", False, "no readings", cure)], {}
    times = np.array([each.time for each in readings])
    lost = sum(each.lost for each in readings[1:])
    sent = (len(readings) - 1 + lost) / (times[-1] - times[0])
    share, gap = lost / (lost + len(readings)), float(np.diff(times).max())
    noise = np.std([each.force for each in readings], axis=0)
    checks = [
        _check(
            "force rate",
            abs(sent / settings.sensor.rate - 1.0) <= max(_SAME_RATE, rate_error),
            f"{sent:.0f} packets a second, file {settings.sensor.rate:g}",
            "set the rate in the sensor, or sensor.rate_Hz in the file",
        ),
        _check(
            "force packets lost",
            share <= _LOST * limits.lost_force,
            f"{lost} of {lost + len(readings)}",
            "give the sensor a cable and a network port of its own",
        ),
        _check(
            "force packets late",
            gap <= limits.stale_force,
            f"longest gap {1e3 * gap:.1f} ms, the blade stops at {1e3 * limits.stale_force:g} ms",
            "close other programs, or give this one real-time priority",
        ),
        _check(
            "force changes",
            len({each.counts for each in readings}) > 1,
            f"SD ({', '.join(f'{sd:.4f}' for sd in noise)}) N in x, y, z",
            "readings that never change are not real: switch the sensor off and on",
        ),
    ]
    measured = {"measured_rate_Hz": float(sent), "lost_share": share, "longest_gap_ms": 1e3 * gap}
    return "sensor", checks, measured | {f"noise_{axis}_N": float(sd) for axis, sd in zip("xyz", noise, strict=True)}


def _motion(plant: RigPlant, name: str, recorder: Recorder, start: float, end: float) -> _Found:
    settings, sample = plant.settings, plant.supervisor.axis(name)
    times = recorder.motion_times(name, start, end)
    beats = recorder.heartbeats(name, start, end)
    checks, about = [], {}
    if sample is not None:
        well = sample.state is not DriveState.FAULT
        cure = "remove the cause and switch the drive off and on; a stop is cleared by the operator"
        checks.append(_check(f"{name} drive", well, f'"{sample.state.value}"', cure))
        about["position_deg" if name == "angle" else "position_mm"] = (
            float(np.degrees(sample.position)) if name == "angle" else 1e3 * sample.position
        )
    for what, moments, limit, cure in (
        ("samples", times, settings.limits.stale_motion, "does another master send SYNC, is this computer busy?"),
        ("heartbeat", beats, settings.limits.heartbeat, "is the bus disturbed or overloaded, is this computer busy?"),
    ):
        if len(moments) < 2:
            checks.append(_check(f"{name} {what}", False, f"{len(moments)} in {LISTEN:g} s", cure))
            continue
        period, gap = float(np.median(np.diff(moments))), float(np.diff(moments).max())
        found = f"every {1e3 * period:.1f} ms, longest gap {1e3 * gap:.1f} ms, the blade stops at {1e3 * limit:g} ms"
        checks.append(_check(f"{name} {what}", gap <= limit, found, cure))
        about[f"{what}_period_ms"] = 1e3 * period
    return name, checks, about


CAMERA_RATE = 14.0
"""Least rate of measured frames [Hz]: 15 a second, less what counting for so short a time may miss."""
_STARTING = 20.0  # time for the camera's process to measure the first frame [s]
_STEP = 0.05  # [s]


def inspect_camera(settings: CameraSettings) -> Inspection:
    """Start the camera, count its frames for some seconds of the machine's clock, and end it."""
    camera, deadline = RigCamera(settings), time.monotonic() + _STARTING
    try:
        while not camera.moments and not camera.ended and time.monotonic() < deadline:
            time.sleep(_STEP)
        time.sleep(LISTEN)
        times, ended = list(camera.moments), camera.ended
    finally:
        camera.close()
    if ended or len(times) < 2:
        found = (
            f"{ended or 'no frames'}; is it plugged in and free, are source and calibration right, and is "
            "cutenv[vision] installed?"
        )
        return Inspection(checks=(Check("camera", False, found),), told={})
    rate = (len(times) - 1) / (times[-1] - times[0])
    found = f"{rate:.1f} frames a second are measured, {CAMERA_RATE:g} needed"
    if rate < CAMERA_RATE:
        found += "; take a smaller image, or a faster computer"
    return Inspection(
        checks=(Check("camera", rate >= CAMERA_RATE, found),), told={"camera": {"measured_rate_Hz": rate}}
    )
