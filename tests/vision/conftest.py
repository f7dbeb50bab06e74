"""A small rendered film of a cut at 45 degrees, with its calibrations; rendered once for all tests of the depth."""

from __future__ import annotations

import functools
import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

SPACING = 0.053 * 0.1  # of the rendered board's corners [m]


@pytest.fixture(scope="session")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """Film with its truth, its frames, both calibrations, the record, and all of it as files."""
    for name in ("cv2", "av"):
        pytest.importorskip(name, reason=f"{name} is an extra: pip install 'cutenv[vision]'")
    from cutenv.records import save
    from cutenv.sim.trace import Trace
    from cutenv.vision.cameras import CalibrationBoard, calibrate_cameras, halves
    from scripts.validation.vision.rendering.filmed_cut import film_cut

    folder: Path = tmp_path_factory.mktemp("film")
    time = np.arange(0.0, 3.6, 1e-3)
    position = np.interp(time, [0.0, 0.5, 1.7, 2.0, 3.1, 3.6], [0.0, 0.0, 0.03, 0.03, 0.0, 0.0])
    depth = 0.005 + 0.004 * (1.0 - np.cos(np.pi * np.clip(5e-4 * np.arange(301) / 0.03, 0.0, 1.0)))
    render = functools.partial(
        film_cut, time, position, depth, angle=math.pi / 4, seed=11, noise=6.0, size=(320, 240), field=0.1
    )  # by the same cameras
    film = render(rate=10.0, spoilt=0.12)
    images, plane = film.boards(10)
    board = CalibrationBoard(columns=10, rows=7, spacing=SPACING)
    boards = [(f"board_{k}.png", image) for k, image in enumerate(images)]
    lefts = [(name, halves(image)[0]) for name, image in boards]
    trace = Trace(
        time=time, force=1.0 + position, position=position, angle=np.full(len(time), math.pi / 4),
        metadata={"name": "cut"},
    )  # fmt: skip
    save(trace, folder / "cut.csv")
    frames = list(film.frames())
    film.write(folder / "pair.mp4", folder / "left.mp4", frames=frames)
    pair = calibrate_cameras(boards, board, stereo=True)
    one = calibrate_cameras(lefts, board, plane=("plane.png", halves(plane)[0]))
    pair.save(folder / "pair.json")
    one.save(folder / "one.json")
    return SimpleNamespace(
        film=film, frames=frames, boards=boards, lefts=lefts, board=board, pair=pair, one=one, trace=trace,
        folder=folder, render=render,
    )  # fmt: skip
