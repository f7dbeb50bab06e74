"""Accuracy of the depth of cut from video, on rendered films of cuts whose depth is known.

    python -m scripts.validation.vision.depth_accuracy            2 films at 90 and at 45 degrees; some ten minutes

Each film has cameras, lenses, light, tissue and noise (2 to 10 grey values) of its own, 5 % of its frames are spoilt,
and it is written and read as H.264. Half of the films show a depth from 1 to 20 mm; the others show livers cut 11 cm
long by the simulator, whose fracture resistance R is then measured with the depth from the film. The result is kept in
runs/depth_accuracy.json; ``scripts/update_docs.py depth`` prints it into docs/validation/depth.md.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from cutenv.records.measurement import estimate_fracture_resistance
from cutenv.sim.trace import Trace
from cutenv.vision.blade_mark import MarkedBlade
from cutenv.vision.cameras import CalibratedCameras, CalibrationBoard, calibrate_cameras, halves
from cutenv.vision.depth_record import FilmedDepth, filmed_depth
from cutenv.vision.film_source import video_frames
from cutenv.vision.marked_blade import BladeCameras
from scripts.tables import keep_json, markdown_table
from scripts.validation.measurement.recovery import KnownCut, cut_specimens
from scripts.validation.vision.rendering.filmed_cut import FilmedCut, film_cut

KEPT = Path("runs") / "depth_accuracy.json"
ANGLES_DEG = (90, 45)
MODES = ("two cameras", "one camera, known plane")
BOARD = CalibrationBoard(columns=10, rows=7, spacing=0.053 * 0.17)
BOARDS = 16
SPEED = 0.0254  # [m/s]
RATE = 10.0  # of the films [Hz]
MARKS = {"RMS": 0.3, "bias": 0.1, "sync": 10.0, "R": 5.0, "rate": 15.0, "within": 0.9}
"""Marks: depth [mm], [mm]; time [ms]; fracture resistance [%]; frames a second [Hz]; share of frames within 2 sd."""


def steady_cut() -> tuple[Trace, NDArray[np.float64]]:
    """Return the motion of a cut of 11 cm and back, and a depth that grows from 1 to 20 mm along it."""
    leg = 0.11 / SPEED
    knots = np.cumsum([0.0, 0.8, leg, 0.6, leg, 0.8])
    clock = np.arange(0.0, knots[-1], 1e-3)
    position = np.interp(clock, knots, [0.0, 0.0, 0.11, 0.11, 0.0, 0.0])
    depth = 0.001 + 0.019 * 0.5 * (1.0 - np.cos(np.pi * np.clip(5e-4 * np.arange(301) / 0.11, 0.0, 1.0)))
    return Trace(time=clock, force=np.zeros_like(clock), position=position), depth


def measured(film: FilmedCut, cameras: CalibratedCameras, path: Path, trace: Trace) -> tuple[FilmedDepth, float]:
    """Measure a film; return the depth, and frames a second of processor time without reading the file [Hz]."""
    blade = MarkedBlade(total=film.blade.total, strip=film.blade.strip, width=film.blade.width)
    frames = list(video_frames(path, size=cameras.frame_size))
    begun = time.process_time()
    measured_frames = list(BladeCameras(cameras, blade).measure_all(frames))
    rate = len(frames) / (time.process_time() - begun)
    return filmed_depth(measured_frames, trace, blade), rate


def result_of(film: FilmedCut, depth: FilmedDepth, rate: float) -> dict[str, Any]:
    """Compare with the truth: errors of single frames [mm], of the time [ms], and what was left out."""
    used = np.array([frame.number for frame in depth.frames if frame.blade is not None])
    spoilt = np.array([bool(kind) for kind in film.spoilt])
    error = depth.vertical - film.vertical[used]
    return {
        "error_mm": (1e3 * error).tolist(),
        "within_2_sd": float(np.mean(np.abs(error) <= 2.0 * depth.vertical_sd)),
        "along_error_mm": (1e3 * (depth.along - film.along[used])).tolist(),
        "sd_mm": 1e3 * depth.sd,
        "sync_ms": 1e3 * (depth.alignment.lag - film.lag),
        "angle_error_deg": math.degrees(depth.alignment.angle - film.blade.angle),
        "frames": len(film.spoilt),
        "spoilt": int(spoilt.sum()),
        "spoilt_used": int(spoilt[used].sum()),
        "good_left_out": int((~spoilt).sum() - (~spoilt[used]).sum()),
        "reasons": depth.left_out,
        "rate_Hz": rate,
    }


def measure_film(
    trace: Trace, depth: NDArray[np.float64], angle_deg: int, seed: int, folder: Path, truth: KnownCut | None
) -> list[dict[str, Any]]:
    """Film a cut, measure it with two cameras and with one, and compare."""
    (position,) = trace.require("position", by="film")
    angled = dataclasses.replace(trace, angle=np.full(len(trace), math.radians(angle_deg)))
    noise = float(np.random.default_rng([seed, 9]).uniform(2.0, 10.0))
    film = film_cut(trace.time, position, depth, angle=math.radians(angle_deg), seed=seed, noise=noise, rate=RATE)
    boards, plane = film.boards(BOARDS)
    paths = [folder / "pair.mp4", folder / "left.mp4"]
    film.write(*paths)
    found = []
    for k, mode in enumerate(MODES):
        named = [(f"board {i}", image if k == 0 else halves(image)[0]) for i, image in enumerate(boards)]
        standing = None if k == 0 else ("plane", halves(plane)[0])
        result: dict[str, Any] = {"angle_deg": angle_deg, "mode": mode, "seed": seed, "noise": noise}
        try:
            cameras = calibrate_cameras(named, BOARD, stereo=k == 0, plane=standing)
            filmed, rate = measured(film, cameras, paths[k], angled)
            result |= result_of(film, filmed, rate)
            if truth is not None:
                R = estimate_fracture_resistance(filmed.onto(angled)).corrected
                exact = estimate_fracture_resistance(truth.trace).corrected
                result |= {"R_percent": 100 * (R / truth.resistance - 1), "exact": 100 * (exact / truth.resistance - 1)}
        except ValueError as error:
            result["refused"] = str(error)
        found.append(result)
    return found


def report(results: Sequence[dict[str, Any]]) -> str:
    """Return the tables, with each mark and whether it is kept."""
    rows, cuts = [], []
    for mode in MODES:
        for angle in ANGLES_DEG:
            films = [r for r in results if (r["mode"], r["angle_deg"]) == (mode, angle)]
            good = [r for r in films if "refused" not in r]
            if not good:
                continue
            errors = np.concatenate([r["error_mm"] for r in good])
            biases = [float(np.mean(r["error_mm"])) for r in good]
            rms, worst = float(np.sqrt(np.mean(errors**2))), max(biases, key=abs)
            sync, rate = max((r["sync_ms"] for r in good), key=abs), min(r["rate_Hz"] for r in good)
            count = {name: sum(r[name] for r in good) for name in ("frames", "spoilt", "spoilt_used", "good_left_out")}
            within = float(np.average([r["within_2_sd"] for r in good], weights=[len(r["error_mm"]) for r in good]))
            claimed = float(np.sqrt(np.mean([r["sd_mm"] ** 2 for r in good])))
            rows.append((
                mode, f"{angle}", f"{len(good)} of {len(films)}", _kept(f"{rms:.3f}", rms <= MARKS["RMS"]),
                _kept(f"{float(errors.mean()):+.3f}; {worst:+.3f}", abs(worst) <= MARKS["bias"]), f"{claimed:.3f}",
                _kept(f"{100.0 * within:.0f}", within >= MARKS["within"]),
                f"{float(np.abs(errors).max()):.2f}", _kept(f"{sync:+.2f}", abs(sync) <= MARKS["sync"]),
                f"{count['spoilt'] - count['spoilt_used']} of {count['spoilt']}",
                f"{100.0 * count['good_left_out'] / (count['frames'] - count['spoilt']):.1f}",
                _kept(f"{rate:.0f}", rate >= MARKS["rate"]),
            ))  # fmt: skip
            cuts += [
                (mode, f"{angle}", str(r["seed"]), _kept(f"{r['R_percent']:+.2f}", abs(r["R_percent"]) <= MARKS["R"]),
                 f"{r['exact']:+.2f}")
                for r in good if "R_percent" in r
            ]  # fmt: skip
    heads = (
        "measured with", "angle [deg]", "films", "RMS [mm]", "bias: all; worst film [mm]", "sd told [mm]",
        "within 2 sd [%]",
        "largest error [mm]", "worst time [ms]", "spoilt frames left out", "good frames left out [%]",
        "slowest [frames/s]",
    )  # fmt: skip
    reasons = sum((Counter(r.get("reasons", {})) for r in results), Counter())
    left_out = "; ".join(f"{reason}: {count}" for reason, count in reasons.most_common())
    refused = [
        f"- film {r['seed']}, {r['mode']}, {r['angle_deg']} degrees: {r['refused']}" for r in results if "refused" in r
    ]
    heads_of_cuts = ("measured with", "angle [deg]", "film", "error of R [%]", "with the exact depth [%]")
    lines = [markdown_table(heads, rows), ""]
    if cuts:
        lines += ["Fracture resistance of livers cut 11 cm long:", "", markdown_table(heads_of_cuts, cuts), ""]
    lines += [f"Frames left out, by reason: {left_out}."]
    if refused:
        lines += ["", "Films refused as a whole:", "", *refused]
    return "\n".join(lines)


def _kept(text: str, kept: bool) -> str:
    return text if kept else f"**{text} (miss)**"


def main() -> None:
    """Film, measure, print; every film's result is kept at once."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--films", type=int, default=2, help="of each angle")
    parser.add_argument("--seed", type=int, default=1, help="of all that is drawn")
    arguments = parser.parse_args()
    livers = cut_specimens(0.11, arguments.films, arguments.seed, speeds=(SPEED,))
    jobs: list[tuple[Trace, NDArray[np.float64], int, KnownCut | None]] = []
    for n in range(arguments.films):
        steady = n % 2 == 0
        jobs += [(*steady_cut(), angle, None) for angle in ANGLES_DEG if steady]
        jobs += [
            (livers[k].trace, livers[k].specimen.depth, ANGLES_DEG[k % 2], livers[k]) for k in (n - 1, n) if not steady
        ]
    results: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for n, (trace, depth, angle, liver) in enumerate(tqdm(jobs, desc="filming", unit="film")):
            results += measure_film(trace, depth, angle, 1000 * arguments.seed + n, Path(folder), liver)
            keep_json(KEPT, results)
    print(report(results))


if __name__ == "__main__":
    main()
