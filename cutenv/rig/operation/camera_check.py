"""Check of the camera beside a rig: whether it answers, and how many frames a second are measured."""

from __future__ import annotations

import time

from cutenv.rig.config.settings import CameraSettings
from cutenv.rig.devices.camera import RigCamera
from cutenv.rig.operation.preflight import Check
from cutenv.rig.operation.self_check import LISTEN, Inspection

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
