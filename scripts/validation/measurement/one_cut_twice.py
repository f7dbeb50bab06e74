"""Render one cut, film and X-ray it, and measure the modulus of its tissue twice: by force and by image.

    python -m scripts.validation.measurement.one_cut_twice  some minutes on two cores; ends with the page twice.html

The simulator cuts a slice whose modulus is drawn. Two cameras film the blade, and two C-arms the beads in the slice,
which bricks of finite elements move under the force of the blade. From film, X-ray videos and record alone follow the
depth of cut, the tracks of the beads, and the modulus of the tissue: by force and blade, and by force and beads. All
files are kept, and what is there is not made again: the same command goes on where it was stopped.
"""

from __future__ import annotations

import argparse
import json
import math
import multiprocessing
import shlex
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from cutenv._base.output import atomic_write
from cutenv.commands import depth, field
from cutenv.records import read_record, save
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import CutModel, Specimen, quasi_static_modulus
from cutenv.sim.tissue.grid import LENGTH, N_POINTS
from cutenv.vision.beads import track_beads
from cutenv.vision.film_source import video_frames
from scripts.validation.vision.carm_measurement import BEAD_PX, Array, calibrated, swept
from scripts.validation.vision.rendering.filmed_cut import FilmedCut, film_cut
from scripts.validation.vision.rendering.moved_tissue import MovedTissue
from scripts.validation.vision.rendering.xray_session import THICKNESS, CutHistory, Session

OUT = Path("runs") / "one_cut_twice"
SPEED, WAY_BACK, TRAVEL = 0.0038, 0.0127, 0.07  # of the blade [m/s], [m]
BEGIN = 0.2  # time of the first X-ray frame on the record's clock: one trigger starts both C-arms [s]
FILMED, XRAYED = 6.0, Fraction(15000, 1001)  # frames a second [1/s]; the latter is every second one of NTSC
BRICKS: dict[str, Any] = {"element": "hex20", "formulation": "solid", "thickness": THICKNESS, "divisions": (16, 30, 2)}
BOARDS, FIELD = 16, 0.17  # images of the board; width of what a camera sees [m]
MARK = 0.1  # largest relative error of a modulus


@dataclass(frozen=True)
class RenderedCut:
    """The cut that a seed draws, and its pictures."""

    seed: int

    @property
    def modulus(self) -> float:
        """Modulus that is put in: 30 to 60 kPa [Pa]."""
        return float(np.random.default_rng([self.seed, 81]).uniform(30e3, 60e3))

    @cached_property
    def specimen(self) -> Specimen:
        """Slice of 2.5 cm that is cut through."""
        return Specimen.homogeneous(modulus=self.modulus, fracture_resistance=211.0, depth=THICKNESS)

    @cached_property
    def _cut(self) -> tuple[SimulatedPlant, NDArray[np.void]]:
        plant = SimulatedPlant(self.specimen, seed=self.seed)
        legs = ((0.0, SPEED, 1.0), (TRAVEL, SPEED, 0.5), (0.0, WAY_BACK, 0.5))
        return plant, run(plant, [Leg(position=x, speed=speed, dwell=rest) for x, speed, rest in legs])

    def record(self, path: Path) -> None:
        """Write what a rig records: it does not know the depth of cut."""
        plant, readings = self._cut
        save(replace(to_trace(plant, readings, specimen="slice"), depth=None), path)

    @cached_property
    def _scene(self) -> FilmedCut:
        position, tip = (self._cut[1][name].astype(float) for name in ("position", "tip"))
        clock = 1e-3 * np.arange(len(position))
        B, angle = self.specimen.depth, math.pi / 2
        tissue = MovedTissue(model=CutModel(), time=clock, tip=tip, lead=np.maximum(position - tip, 0.0))
        return film_cut(clock, position, B, angle=angle, seed=self.seed, rate=FILMED, field=FIELD, tissue=tissue)

    def boards(self, path: Path) -> None:
        """Write the images of the board that stand before the one of this name, and that one last."""
        for number, image in enumerate(self._scene.boards(BOARDS)[0], 1):
            cv2.imwrite(str(path if number == BOARDS else path.parent / f"board_{number:02d}.png"), image)

    def film(self, path: Path) -> None:
        """Write the film of the blade."""
        self._scene.write(
            path, watched=partial(tqdm, desc="film of the blade", total=len(self._scene.time), position=0)
        )

    @cached_property
    def session(self) -> Session:
        """The C-arms, and the beads that bricks move under the force of the blade."""
        blade, tip = (self._cut[1][name].astype(float) for name in ("position", "tip"))
        stiffness = np.interp(tip, np.linspace(0.0, LENGTH, N_POINTS), self.specimen.stiffness())
        force, bricks = stiffness * np.maximum(blade - tip, 0.0), CutModel(**BRICKS)
        lead = force / (np.asarray(bricks.stiffness(tip)) * self.modulus * THICKNESS)
        cut = CutHistory(time=1e-3 * np.arange(len(blade)), blade=blade, tip=tip, lead=lead, force=force)
        return replace(Session.drawn(self.seed, cut=cut), model=bricks)

    def xray(self, name: str, path: Path) -> None:
        """Write the X-ray video of one view, from rest until the blade turns; nothing is lost in the file."""
        session = self.session
        end = float(session.cut.time[np.argmax(session.cut.blade)])
        times = np.arange(BEGIN, end, float(1 / XRAYED))
        rng = np.random.default_rng([self.seed, name == "top"])
        bar = tqdm(times, desc=f"X-ray, {name}", position=1 + (name == "side"))
        with av.open(str(path), "w") as file:
            stream = file.add_stream("ffv1", rate=XRAYED)
            stream.height, stream.width = session.image(name, BEGIN, rng).shape
            stream.pix_fmt = "gray"
            for time in bar:
                file.mux(stream.encode(av.VideoFrame.from_ndarray(session.image(name, time, rng), format="gray")))
            file.mux(stream.encode(None))

    def tracks(self, path: Path, record: Path) -> None:
        """Calibrate the C-arms, find the beads at rest by a rotation of one arm, and follow them through the videos."""
        print("C-arms: images of the plate, of the phantom, and of the beads while the top arm turns", flush=True)
        rng = np.random.default_rng([self.seed, 27])
        arms = calibrated(self.session, rng)
        arms.save(path.parent / "arms.json")
        rest = swept(self.session, arms.views[0], rng)
        videos = [list(video_frames(path.parent / f"{name}.mkv")) for name in ("top", "side")]
        times = np.array([BEGIN + frame.time for frame in videos[0]])
        frames = ([frame.image for frame in pair] for pair in zip(*videos, strict=True))
        bar = tqdm(frames, desc="following the beads", total=len(times))
        expected = predicted_by(record)
        with atomic_write(path) as part:
            track_beads(bar, times, arms, rest, diameter=BEAD_PX, displacement=expected).save(part)


def predicted_by(record: Path) -> Callable[[Array, float], Array]:
    """Return where a mean liver under the recorded force moves the beads: there they are looked for.

    Nothing of what was put in is known to it.
    """
    (trace,), model, modulus = read_record(record).traces, CutModel(), quasi_static_modulus()
    position, cut_depth = trace.require("position", "depth", by="prediction")
    thickness = float(np.median(cut_depth))
    force = np.maximum(trace.force, 0.0)
    tip = np.clip(position - force / (np.asarray(model.stiffness(position)) * modulus * thickness), 0.0, LENGTH)

    def displacement(rest: Array, time: float) -> Array:
        f, a = (float(np.interp(time, trace.time, values)) for values in (force, tip))
        moved = model.displacement_at(rest[:, :2], a, force=f, modulus=modulus, thickness=thickness)
        return np.pad(moved, ((0, 0), (0, 1)))

    return displacement


def made(path: Path, make: Callable[[Path], None]) -> None:
    """Make a file that is not there."""
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_write(path) as part:
            make(part)


def as_a_helper() -> None:
    """Leave Ctrl-C to the process that began this one, and ends it; keep no lock of the bars that would outlive it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    tqdm.set_lock(threading.RLock())


def rendered(job: tuple[int, str, Path]) -> None:
    """Render one of the videos."""
    seed, name, path = job
    cut = RenderedCut(seed)
    made(path, cut.film if name == "film" else partial(cut.xray, name))


def command(main: Callable[[Sequence[str]], int], name: str, *arguments: object) -> None:
    """Show a command of the package and run it; SystemExit if it fails."""
    words = [str(each) for each in arguments]
    print(f"$ cutenv {name} {shlex.join(words)}", flush=True)
    if main(words):
        raise SystemExit(1)


def measure(seed: int, out: Path) -> int:
    """Render and measure; return 1 if a modulus is off by more than 10 %."""
    cut, record, cameras = RenderedCut(seed), out / "cut.csv", out / "cameras.json"
    for part in out.glob("*.part.*"):  # of a run that was stopped
        part.unlink()
    made(record, cut.record)
    boards = [out / "boards" / f"board_{number:02d}.png" for number in range(1, BOARDS + 1)]
    made(boards[-1], cut.boards)
    videos = {"film": out / "film.mp4", "top": out / "top.mkv", "side": out / "side.mkv"}
    jobs = [(seed, name, path) for name, path in videos.items() if not path.exists()]
    if jobs:
        with multiprocessing.get_context("spawn").Pool(2, as_a_helper) as pool:
            pool.map(rendered, jobs, chunksize=1)
    if not cameras.exists():
        spacing = f"{53 * FIELD:g}mm"
        command(
            depth.main, "depth", "--calibrate", *boards, "--board", "10x7", "--spacing", spacing, "--stereo",
            "--out", cameras,
        )  # fmt: skip
    with_depth, tracks = out / "cut_depth.csv", out / "tracks.parquet"
    if not with_depth.exists():
        command(depth.main, "depth", videos["film"], "--calibration", cameras, "--record", record, "--out", out)
    if not tracks.exists():
        cut.tracks(tracks, with_depth)
    page = out / "twice.html"
    command(field.main, "field", tracks, "--record", with_depth, "--truth", f"{cut.modulus:.0f}", "--out", page)
    found = json.loads(page.with_suffix(".json").read_text())
    means = [found[f"modulus_by_{data}_Pa"]["mean"] for data in ("force", "image")]
    return int(max(abs(mean / cut.modulus - 1.0) for mean in means) > MARK)


def main() -> int:
    """Measure one cut twice."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1, help="draws the tissue, the cameras and the C-arms; default 1")
    parser.add_argument("--out", type=Path, metavar="FOLDER", help=f"where all files are kept; default {OUT}/SEED")
    arguments = parser.parse_args()
    out = arguments.out or OUT / str(arguments.seed)
    try:
        return measure(arguments.seed, out)
    except KeyboardInterrupt:
        print(f"\nstopped; what is done is in {out}, and the same command goes on", file=sys.stderr)
        return 130


if __name__ == "__main__":
    sys.exit(main())
