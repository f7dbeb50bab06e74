"""Camera beside an emulated rig, in real time: frames a second by the wall clock, and the rig's timing with it.

    python -m scripts.validation.vision.camera_beside_rig  2 minutes of cutting each; some 15 in all
    python -m scripts.validation.vision.camera_beside_rig --minutes 1 --json runs/camera-beside-rig.json
    python -m scripts.update_docs live-camera

A rendered film is played at 30 frames a second into the camera's process, as a camera would send it, while the rig cuts
as in scripts/validation/rig/rig_soak.py: three processes, of rig, emulated rig and camera. First there is no camera,
then one camera with a known plane, then two. The film is no film of these cuts: every record keeps the profile's depth,
and says so. Processor time contains the decoding of the film (H.264). Linux alone tells it.
"""

from __future__ import annotations

import argparse
import functools
import math
import os
import tempfile
import threading
import time
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np

from cutenv.rig.config.settings import CameraSettings
from cutenv.rig.devices.camera import RigCamera
from cutenv.vision.cameras import calibrate_cameras, halves
from scripts.tables import keep_json, markdown_table
from scripts.validation.rig import rig_soak
from scripts.validation.vision.depth_accuracy import BOARD, BOARDS
from scripts.validation.vision.rendering.filmed_cut import film_cut

DEFAULT = Path("runs") / "camera-beside-rig.json"
CAMERAS = {"none": None, "one camera": 1, "two cameras": 2}
RATE = 30  # of the film [Hz]
RENDERED = 5.0  # of the film, played forth and back [s]
LEAST = 15.0  # frames that are to be measured in a second [Hz]
_CLOCK = 90000  # ticks of the film [1/s]
_STARTS = 60.0  # time for the camera's process to measure its first frame [s]


def played_films(folder: Path, seconds: float, seed: int) -> dict[int, CameraSettings]:
    """Render a film, write it as long as wanted, for one camera and for two; return the settings of both."""
    clock = np.arange(0.0, RENDERED + 0.5, 1e-3)
    depth = np.full(301, 0.012)
    film = film_cut(
        clock, 0.006 * clock, depth, angle=math.pi / 2, seed=seed, noise=6.0, spoilt=0.0, rate=float(RATE), lag=0.0
    )
    images, (boards, plane) = list(film.frames()), film.boards(BOARDS)
    there_and_back = images + images[-2:0:-1]
    settings = {}
    for count in (1, 2):
        named = [(f"board {n}", each if count == 2 else halves(each)[0]) for n, each in enumerate(boards)]
        standing = ("plane", halves(plane)[0]) if count == 1 else None
        calibrate_cameras(named, BOARD, stereo=count == 2, plane=standing).save(folder / f"{count}.json")
        path = folder / f"{count}.mp4"
        with av.open(str(path), "w") as file:
            stream = file.add_stream("libx264", rate=RATE, options={"crf": "14", "preset": "ultrafast"})
            stream.height, stream.width = images[0].shape[0], images[0].shape[1] * count // 2
            stream.pix_fmt, stream.time_base = "yuv420p", Fraction(1, _CLOCK)
            for number in range(round(seconds * RATE)):
                image = np.ascontiguousarray(there_and_back[number % len(there_and_back)][:, : stream.width])
                frame = av.VideoFrame.from_ndarray(image, format="gray").reformat(format="yuv420p")
                frame.pts, frame.time_base = number * (_CLOCK // RATE), Fraction(1, _CLOCK)
                file.mux(stream.encode(frame))
            file.mux(stream.encode(None))
        blade = film.blade
        settings[count] = CameraSettings(
            source=str(path), calibration=str(folder / f"{count}.json"), total=blade.total, strip=blade.strip,
            width=blade.width,
        )  # fmt: skip
    return settings


class WatchedCamera(RigCamera):
    """Camera beside the rig that keeps the times of all frames, and tells the processor time of its process.

    ``earlier`` are the times of the frames of earlier cuts, on the machine's clock [s]; ``spent`` is the processor time
    of the process, when it was closed [s].
    """

    def __init__(self, settings: CameraSettings) -> None:
        self.earlier: list[float] = []
        self.spent = math.nan
        super().__init__(settings)

    def begin(self) -> None:
        """Keep the frames so far: a cut begins."""
        self.earlier += self.moments
        super().begin()

    def close(self) -> None:
        """End the process, and keep its processor time."""
        if self._process.poll() is None:
            self.spent = self.processor_time()
        super().close()

    def processor_time(self) -> float:
        """Return the processor time of the camera's process so far [s]."""
        return rig_soak.processor_time(self._process.pid)


class LoadWatch:
    """Load of the machine (processes that run or want to, over the last minute), every second."""

    def __init__(self) -> None:
        self.loads: list[float] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)
        self._thread.start()

    def _watch(self) -> None:
        while not self._done.wait(1.0):
            self.loads.append(os.getloadavg()[0])

    def mean(self) -> float:
        """End the watch and return the mean load."""
        self._done.set()
        self._thread.join()
        return float(np.mean(self.loads)) if self.loads else os.getloadavg()[0]


def beside(settings: CameraSettings | None, minutes: float, seed: int, folder: Path) -> dict[str, Any]:
    """Cut for some minutes beside a camera, or without one; return the timing of the rig and the camera's rate."""
    camera = None if settings is None else WatchedCamera(settings)
    try:
        if camera is not None:
            deadline = time.monotonic() + _STARTS
            while not camera.moments and not camera.ended and time.monotonic() < deadline:
                time.sleep(0.05)
            if not camera.moments:
                raise SystemExit(f"the camera measures nothing: {camera.ended or 'no frame came'}")
        spent, begun = 0.0 if camera is None else camera.processor_time(), time.monotonic()
        load = LoadWatch()
        soak = rig_soak.soak(minutes, seed=seed, records=folder, camera=camera)
        ended = time.monotonic()
        told: dict[str, Any] = {"soak": soak, "load": load.mean()}
        if camera is not None:
            moments = np.array([each for each in camera.earlier + camera.moments if begun <= each <= ended])
            seconds = float(moments[-1] - begun)  # the environment closes its camera
            told |= {
                "seconds": seconds,
                "frames": len(moments),
                "rate_Hz": len(moments) / seconds,
                "longest_gap_s": float(np.diff(moments).max()),
                "processor_ms_a_frame": 1e3 * (camera.spent - spent) / len(moments),
                "ended": camera.ended,
            }
    finally:
        if camera is not None:
            camera.close()
    return told


def markdown(kept: dict[str, Any]) -> str:
    """Return the table of all runs."""
    rows = []
    for name, told in kept["runs"].items():
        soak = told["soak"]
        late = soak["percentiles_ms"]
        stops = ", ".join(f"{cause} {count}" for cause, count in sorted(soak["stops"].items())) or "none"
        stalls = soak["host_stalls_ms"]["rig"]
        camera = ["-"] * 3
        if "rate_Hz" in told:
            rate = f"{told['rate_Hz']:.1f}"
            camera = [
                rate if told["rate_Hz"] >= LEAST else f"**{rate}**",
                f"{1e3 * told['longest_gap_s']:.0f}",
                f"{told['processor_ms_a_frame']:.1f}",
            ]
        readings, commands = (late[each] for each in ("between force readings", "command later than due"))
        rows.append((
            name, *camera, f"{told['load']:.1f}", str(soak["counts"]["decisions"]),
            f"{readings[2]:.2f}; {readings[3]:.1f}", f"{commands[2]:.2f}; {commands[3]:.1f}",
            str(soak["counts"].get("overruns", 0)), str(len(stalls)), stops,
        ))  # fmt: skip
    columns = (
        "camera", "frames measured a second", "longest gap [ms]", "processor time a frame [ms]", "load", "decisions",
        "between force readings, 99.9 %; largest [ms]", "command later than due, 99.9 %; largest [ms]",
        "commands over 2 ms late", "host stalls over 5 ms", "stops",
    )  # fmt: skip
    machine = next(iter(kept["runs"].values()))["soak"]["machine"]
    return (
        f"{kept['minutes']:g} minutes of cutting each, film of {RATE} frames a second and {kept['size']} pixels for "
        f"each camera, {machine['cores']} cores; load is the mean number of processes that run or want to.\n\n"
        + markdown_table(columns, rows)
    )


def main() -> None:
    """Measure, print, and keep."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--minutes", type=float, default=2.0, metavar="M", help="of cutting with each camera; default 2")
    add("--seed", type=int, default=0, help="of the specimens and the film; default 0")
    add("--json", type=Path, metavar="FILE", help=f"keep the numbers there; the documentation is made from {DEFAULT}")
    arguments = parser.parse_args()
    print_now = functools.partial(print, flush=True)
    with tempfile.TemporaryDirectory() as name:
        print_now("rendering the film")
        films = played_films(Path(name), 200.0 * arguments.minutes + 60.0, arguments.seed)
        runs = {}
        for camera, count in CAMERAS.items():
            print_now(f"cutting; camera: {camera}")
            settings = None if count is None else films[count]
            runs[camera] = beside(settings, arguments.minutes, arguments.seed, Path(name) / "records")
    kept = {"minutes": arguments.minutes, "size": "512 x 384", "runs": runs}
    if arguments.json is not None:
        keep_json(arguments.json, kept)
    print(markdown(kept))


if __name__ == "__main__":
    main()
