"""Runs of the crack as one camera sees them, against the sudden drops of the force and against the truth.

    python -m scripts.validation.vision.seen_runs  4 rendered cuts of drawn livers; some minutes
    python -m scripts.update_docs seen-runs        puts the table into docs/validation/depth.md

The simulator cuts livers 7 cm long at two speeds and two angles. The tissue in the film moves as a finite-element model
says whose tip is that of the cut. The result is kept in runs/seen_runs.json.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import CutModel, Specimen
from cutenv.sim.trace import Trace
from cutenv.vision.blade_mark import MarkedBlade
from cutenv.vision.cameras import calibrate_cameras
from cutenv.vision.depth_record import RunsAndDrops, filmed_depth, runs_and_drops, seen_runs
from cutenv.vision.film_source import VideoFrame
from cutenv.vision.marked_blade import BladeCameras
from scripts.tables import keep_json, markdown_table
from scripts.validation.vision.depth_accuracy import BOARD, BOARDS
from scripts.validation.vision.rendering.filmed_cut import FilmedCut, film_cut
from scripts.validation.vision.rendering.moved_tissue import MovedTissue

KEPT = Path("runs") / "seen_runs.json"
CUTS = ((90, 0.0038, 15.0), (45, 0.0038, 15.0), (90, 0.0127, 15.0), (45, 0.0127, 30.0))
"""Angle [deg], speed [m/s] and frames a second of each film."""
SIZE, FIELD = (400, 300), 0.14  # of an image [px], and what it shows [m]
TRAVEL, WAY_BACK, REST, NOISE = 0.07, 0.0254, 0.5, 6.0  # [m], [m/s], [s], [grey values]
MARK = 0.9  # least F1
SEED = 2600  # the thresholds were chosen on the films of 2500
_TRUE_RUN = 0.5e-3  # least advance of the tip within a reading that is a run [m]


def filmed_liver(angle_deg: int, speed: float, rate: float, seed: int) -> tuple[FilmedCut, Trace, NDArray[np.float64]]:
    """Film a cut of a drawn liver; return film, record, and the times at which the crack really ran [s]."""
    specimen = Specimen.draw(np.random.default_rng([seed, 5]), specimen_class="liver")
    angle = math.radians(angle_deg)
    plant = SimulatedPlant(specimen, seed=seed, angle=angle)
    legs = ((0.0, speed), (TRAVEL, speed), (0.0, WAY_BACK))
    readings = run(plant, [Leg(position=x, speed=v, angle=angle, dwell=REST) for x, v in legs])
    trace = dataclasses.replace(to_trace(plant, readings, specimen="liver"), depth=None)
    position, tip = (readings[name].astype(float) for name in ("position", "tip"))
    tissue = MovedTissue(model=CutModel(), time=trace.time, tip=tip, lead=np.maximum(position - tip, 0.0))
    film = film_cut(
        trace.time, position, specimen.depth, angle=angle, seed=seed, rate=rate, noise=NOISE, size=SIZE, field=FIELD,
        tissue=tissue,
    )  # fmt: skip
    film = dataclasses.replace(film, cameras=film.cameras[:1], scenes=film.scenes[:1])
    return film, trace, trace.time[1:][np.diff(tip) >= _TRUE_RUN]


def watched_runs(film: FilmedCut, trace: Trace) -> RunsAndDrops:
    """Measure a film with one camera as ``cutenv depth`` does, and match what it shows with the record."""
    boards, plane = film.boards(BOARDS)
    board = dataclasses.replace(BOARD, spacing=0.053 * film.field)
    named = [(f"board {k}", image) for k, image in enumerate(boards)]
    cameras = calibrate_cameras(named, board, plane=("plane", plane))
    images = tqdm(film.frames(), desc="filming", total=len(film.time))
    frames = [VideoFrame(k, time, image) for k, (time, image) in enumerate(zip(film.time, images, strict=True))]
    blade = MarkedBlade(total=film.blade.total, strip=film.blade.strip, width=film.blade.width)
    filmed = filmed_depth(list(BladeCameras(cameras, blade).measure_all(frames)), trace, blade)
    return runs_and_drops(seen_runs(frames, filmed, trace, cameras.frame_size[0]), trace)


def result_of(found: RunsAndDrops, truth: NDArray[np.float64]) -> dict[str, Any]:
    """Return the counts, and the errors of the time [s]."""
    inside = [bool((np.abs(truth - run.time) <= 0.5 * run.interval + 0.005).any()) for run in found.runs]
    return {
        "runs": len(found.runs), "drops": len(found.drops), "pairs": len(found.pairs), "f1": found.f1,
        "true_runs": len(truth), "runs_that_are_true": sum(inside),
        "late_s": [found.runs[i].time - found.drops[k] for i, k in found.pairs],
    }  # fmt: skip


def report(results: list[dict[str, Any]]) -> str:
    """Return the table, misses in bold."""
    rows = []
    for r in results:
        late = 1e3 * np.array(r["late_s"])
        f1 = f"{r['f1']:.2f}" if r["f1"] >= MARK else f"**{r['f1']:.2f} (miss)**"
        rows.append((
            f"{r['angle_deg']}", f"{100 * r['speed']:g}", f"{r['rate']:g}", f"{r['drops']}", f"{r['runs']}",
            f"{100 * r['pairs'] / r['drops']:.0f}", f"{100 * r['pairs'] / r['runs']:.0f}", f1,
            f"{late.mean():+.0f}; {np.abs(late).max():.0f}", f"{r['runs_that_are_true']} of {r['true_runs']}",
        ))  # fmt: skip
    heads = (
        "angle [deg]", "speed [cm/s]", "frames a second", "drops of the force", "runs seen", "recall [%]",
        "precision [%]", "F1", "time, run less drop [ms]: mean; largest", "true runs seen",
    )  # fmt: skip
    return markdown_table(heads, rows)


def main() -> None:
    """Film, measure, print, keep."""
    results: list[dict[str, Any]] = []
    for number, (angle_deg, speed, rate) in enumerate(CUTS):
        film, trace, truth = filmed_liver(angle_deg, speed, rate, SEED + number)
        found = result_of(watched_runs(film, trace), truth)
        results.append({"angle_deg": angle_deg, "speed": speed, "rate": rate, **found})
        keep_json(KEPT, results)
    print(report(results))


if __name__ == "__main__":
    main()
