"""Virtual records of cuts in steps of depth, as a rig with a height axis would have made them, and what was put in.

    python -m scripts.validation.measurement.stepped_cuts --out stepped --cuts 6 --layer-mm 10 --toughness 3 --modulus 2

The blade cuts some centimetres at one depth below the surface, is raised by half a millimetre, and goes back past the
tip.  Then it cuts on, and is lowered or raised on the way.  So each step ends unloaded, by which ``cutenv calibrate``
finds layers.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.records import save
from cutenv.sim.cutting.sensor import SensorParameters
from cutenv.sim.plant import DescendingPlant
from cutenv.sim.plant.protocol import to_trace
from cutenv.sim.tissue import Layers, Specimen
from cutenv.sim.tissue.grid import depth_below
from cutenv.sim.trace import Trace

STEP, BACK = 0.026, 0.013  # length of the cut at one depth, and of the way back from it [m]
CLEAR = 0.0005
"""Height by which the blade is raised before it goes back, so that its edge does not rub on the floor [m]."""
SLOPE = 0.6  # change of the depth over the way along the cut, from one depth to the next [1]
DEPTHS = (0.006, 0.012, 0.008, 0.014)  # depths below the surface, one after the other [m]
VERTICAL_NOISE, VERTICAL_STEP = 0.02, 0.1
"""Noise and resolution of the vertical force [N]: the thesis's sensor has 0.1 N along its own axis."""
_DESCENT = 0.010  # [m/s], fastest
_AHEAD = 0.1  # [s], lag of the height
_REST = 0.3  # [s], of the blade at the start, in air as far as the force can tell
_TICKS = 10


class SteppedCut:
    """A blade that is led through a simulated specimen; every reading is kept."""

    def __init__(
        self,
        specimen: Specimen,
        layers: Layers,
        *,
        depth: Any,
        level: float,
        seed: int,
        episode: int,
        noisy: bool = True,
    ) -> None:
        sensor = SensorParameters() if noisy else SensorParameters(
            force_noise=0.0, force_resolution=0.0, force_delay=0.0, force_drift=0.0
        )  # fmt: skip
        self.plant = DescendingPlant(
            specimen, layers=layers, sensor=sensor, seed=seed, episode=episode, depth=depth, level=level
        )
        self._rng = np.random.default_rng([seed, episode]) if noisy else None
        self._parts: list[Any] = []
        self._heights: list[Any] = []
        self._vertical: list[Any] = []

    @property
    def position(self) -> float:
        """Position of the blade [m]."""
        return float(self.plant.states["blade"][0])

    def rest(self, time: float) -> None:
        """Let the blade stand for a time [s]."""
        for _ in range(max(round(time * 1000.0 / _TICKS), 1)):
            self._advance(0.0, 0.0)

    def cut_to(self, place: float, speed: float, depth: Callable[[float], float]) -> None:
        """Cut on to a place [m] at a speed [m/s], at a depth below the measured surface [m] of the place."""
        while (left := place - self.position) > 2e-5:
            x = min(self.position + speed * _AHEAD, place)  # at its end no blade is on its way down
            fall = self.plant.level - (float(depth_below(self.plant.depth, x)) - depth(x))
            self._advance(min(speed, 8.0 * left + 2e-4), min(max(10.0 * fall, -_DESCENT), _DESCENT))
        self.rest(0.15)

    def go_back(self, way: float, speed: float) -> None:
        """Raise the blade off the floor, and go back along the cut [m] at a speed [m/s], at one height."""
        level = self.plant.level + CLEAR
        while (rise := level - self.plant.level) > 2e-5:
            self._advance(0.0, -min(10.0 * rise + 1e-4, _DESCENT))
        self.rest(0.15)
        place = self.position - way
        while (left := self.position - place) > 2e-5:
            self._advance(-min(speed, 8.0 * left + 2e-4), 0.0)
        self.rest(0.05)

    def trace(self, **metadata: object) -> Trace:
        """Return the record: force, position, speed, angle, depth at height 0, height and vertical force."""
        trace = to_trace(self.plant, np.concatenate(self._parts), **metadata)
        columns = {name: getattr(trace, name) for name in trace.known}
        vertical = np.concatenate(self._vertical)
        if self._rng is not None:
            felt = vertical + VERTICAL_NOISE * self._rng.standard_normal(len(vertical))
            vertical = VERTICAL_STEP * np.round(felt / VERTICAL_STEP)
        return Trace(**columns, height=np.concatenate(self._heights), vertical_force=vertical, metadata=trace.metadata)

    def _advance(self, speed: float, descent: float) -> None:
        before = self.plant.level
        readings = self.plant.advance(speed, math.pi / 2, _TICKS, descent)
        self._parts.append(readings.copy())
        self._heights.append(np.linspace(before, self.plant.level, _TICKS + 1)[1:])
        self._vertical.append(self.plant.vertical_force.copy())


def stepped_cut(
    specimen: Specimen,
    layers: Layers,
    /,
    *,
    depths: Sequence[float] = DEPTHS,
    speed: float = 0.0089,
    depth: Any = None,
    seed: int = 0,
    episode: int = 0,
    noisy: bool = True,
    **metadata: object,
) -> tuple[Trace, SteppedCut]:
    """Cut in steps of ``depths`` below the surface [m]; return the record, and the cut with its hidden truth.

    ``depth`` is the surface as a lab has measured it beforehand, shape (301,) [m]; default the true one.
    """
    known = specimen.depth if depth is None else depth
    cut = SteppedCut(
        specimen, layers, depth=known, level=float(known[0]) - depths[0], seed=seed, episode=episode, noisy=noisy
    )
    cut.rest(_REST)
    begins = np.arange(len(depths)) * STEP
    places = np.ravel([begins, begins + np.abs(np.diff(depths, prepend=depths[0])) / SLOPE + 1e-6], order="F")
    wanted = np.ravel([[depths[0], *depths[:-1]], depths], order="F")
    for begin in begins:
        cut.cut_to(begin + STEP, speed, lambda x: float(np.interp(x, places, wanted)))
        cut.go_back(BACK, speed)
    cut.rest(_REST)
    return cut.trace(**metadata), cut


def main() -> None:
    """Write the records of some cuts, each of another drawn liver."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, metavar="FOLDER", help="folder of the records")
    parser.add_argument("--cuts", type=int, default=6, metavar="N", help="number of cuts; default 6")
    parser.add_argument("--layer-mm", type=float, metavar="MM", help="depth of a layer below; default none")
    parser.add_argument("--toughness", type=float, default=3.0, help="its toughness over the tissue's; default 3")
    parser.add_argument("--modulus", type=float, default=2.0, help="its modulus over the tissue's; default 2")
    parser.add_argument("--seed", type=int, default=0, help="seed of the livers; default 0")
    arguments = parser.parse_args()
    layers = Layers()
    if arguments.layer_mm is not None:
        layers = Layers(
            boundary=1e-3 * arguments.layer_mm, deep_toughness=arguments.toughness, deep_modulus=arguments.modulus
        )
    arguments.out.mkdir(parents=True, exist_ok=True)
    for number in range(arguments.cuts):
        trace, _ = stepped_cut(
            Specimen.drawn(arguments.seed, number),
            layers,
            depths=DEPTHS if number % 2 else DEPTHS[::-1],
            seed=arguments.seed,
            episode=number,
            name=f"liver {number}",
            specimen=f"liver {number}",
            end="finished",
        )
        save(trace, arguments.out / f"liver{number}.csv")
    print(f"{arguments.cuts} records: {arguments.out}")


if __name__ == "__main__":
    main()
