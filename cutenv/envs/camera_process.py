"""Process that films beside a rig.

It measures the depth in every frame, and puts it into the record of each cut.

:class:`cutenv.rig.devices.camera.RigCamera` starts it with its settings as JSON, and speaks with it in lines of JSON:
``{"begin": true}`` and ``{"record": path}`` go in, ``{"frame": time}``, ``{"ended": reason}`` and ``{"record": note}``
come out.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2

from cutenv.records import load_one, save
from cutenv.rig.config.settings import CameraSettings, RigSettings
from cutenv.rig.devices.camera import CAMERA_NOTE
from cutenv.rig.devices.driver_registry import DriverKind, Mounting, mounted, traits_of
from cutenv.rig.devices.loop import SystemClock
from cutenv.vision.blade_mark import MarkedBlade
from cutenv.vision.cameras import CalibratedCameras
from cutenv.vision.depth_record import filmed_depth
from cutenv.vision.film_source import CameraDriver, newest_frames
from cutenv.vision.marked_blade import BladeCameras, DepthFrame

_NICE = 5  # below the rig's own program
_TELLING = threading.Lock()


class FilmedCuts:
    """Frames of the current cut, and the camera's end reason."""

    def __init__(self, blade: MarkedBlade, travel: str) -> None:
        self.blade, self.travel = blade, travel
        self.frames: list[DepthFrame] = []
        self.ended = ""

    def put_depth(self, path: Path) -> str:
        """Replace a record's depth by the camera's, if of use; return a note."""
        frames, trace = self.frames.copy(), load_one(path)
        note = f"{len(frames)} frames"
        try:
            filmed = filmed_depth(frames, trace, self.blade, travel=self.travel)
            trace = filmed.onto(trace)
            note += f", {len(filmed.time)} of them used: the depth is the camera's"
        except ValueError as error:
            note += f"; the depth is the profile's, because the camera's cannot be used: {error}"
        if self.ended:
            note += f"; the camera has ended: {self.ended}"
        save(trace.with_metadata({**trace.metadata, CAMERA_NOTE: note}), path)
        return note


def main(argv: Sequence[str]) -> int:
    """Film and answer until standard input ends."""
    os.nice(_NICE)
    cv2.setNumThreads(1)
    given = json.loads(argv[0])
    tag = None if given["tag"] < 0 else given["tag"]
    try:
        blade = MarkedBlade(total=given["total"], strip=given["strip"], width=given["width"], tag=tag)
        cuts = FilmedCuts(blade, given["travel"])
        threading.Thread(target=_answer, args=(cuts,), name="requests", daemon=True).start()
        cameras, camera = CalibratedCameras.load(given["calibration"]), _camera(given)
        camera.open()
        with contextlib.closing(camera):
            for frame in BladeCameras(cameras, blade).measure_all(newest_frames(camera, cameras.frame_size)):
                cuts.frames.append(frame)
                _tell({"frame": frame.time})
    except (OSError, ValueError, cv2.error) as error:
        cuts.ended = str(error)
        _tell({"ended": str(error)})
    threading.Event().wait()  # for requests
    return 0


def _camera(given: dict[str, Any]) -> CameraDriver:
    """Return the camera of settings given as a dictionary."""
    options = traits_of(DriverKind.CAMERA, given["driver"]).options
    settings = CameraSettings(**{**given, "options": None if options is None else options(**given["options"])})
    rig = RigSettings(camera=settings)
    camera: CameraDriver = mounted(Mounting(role="camera", rig=rig, clock=SystemClock()))
    return camera


def _answer(cuts: FilmedCuts) -> None:
    for line in sys.stdin:
        request: dict[str, Any] = json.loads(line)
        if "record" not in request:
            cuts.frames.clear()
            continue
        try:
            _tell({"record": cuts.put_depth(Path(request["record"]))})
        except (OSError, ValueError) as error:
            _tell({"record": f"the record cannot be changed: {error}"})
    os._exit(0)  # the rig's program has ended


def _tell(message: dict[str, Any]) -> None:
    """Write one line that no other thread can break."""
    with _TELLING:
        print(json.dumps(message), flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
