"""A session with two C-arms, rendered: grid, phantom, rotation, and a cut through tissue with beads; and its truth.

The beads move as a finite-element model of uneven tissue says, whose tip and force come from the simulator's own cut.
Poses, distortions and beads are drawn from a seed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from cutenv.sim.plant.protocol import Leg, run
from cutenv.sim.plant.simulator import SimulatedPlant
from cutenv.sim.tissue.cut_model import CutModel
from cutenv.sim.tissue.specimen import Specimen
from scripts.validation.vision.rendering.xray import STEEL, TISSUE, Array, Box, XRayCamera, interlaced

BEAD = 0.5e-3  # radius of the beads [m]
BALL = 0.8e-3  # radius of the phantom's balls [m]
THICKNESS = 0.025  # thickness of the slab [m]
ERRORS = {"top": (8e-5, -0.0079, 0.0), "side": (6e-4, -0.0706, 0.0)}  # the thesis's radial errors, zero at the centre


@dataclass(frozen=True, kw_only=True, eq=False)
class CutHistory:
    """Blade, tip, displacement of the tip, and force of a simulated cut at 1 kHz."""

    time: Array
    blade: Array
    tip: Array
    lead: Array
    force: Array

    @classmethod
    def simulated(cls, speed: float, length: float, seed: int) -> CutHistory:
        """Cut a drawn liver with the simulator, resting a second before."""
        specimen = Specimen.draw(np.random.default_rng(seed), specimen_class="liver")
        plant = SimulatedPlant(specimen, seed=seed, angle=math.pi / 2)
        rest = plant.advance(0.0, math.pi / 2, 1000).copy()
        cut = run(plant, [Leg(position=length, speed=speed, angle=math.pi / 2)])
        readings = np.concatenate([rest, cut])
        blade, tip, force = (readings[name].astype(float) for name in ("position", "tip", "force"))
        time = np.arange(len(readings)) * 1e-3
        return cls(time=time, blade=blade, tip=tip, lead=np.maximum(blade - tip, 0.0), force=force)

    def at(self, time: float) -> tuple[float, float, float]:
        """Return blade, tip and displacement of the tip at a time [m]."""
        blade, tip, lead = (float(np.interp(time, self.time, each)) for each in (self.blade, self.tip, self.lead))
        return blade, tip, lead


@dataclass(frozen=True, kw_only=True, eq=False)
class Session:
    """Session of two C-arms, and what is true of it."""

    cameras: dict[str, XRayCamera]  # "top" and "side"
    rest: Array  # places of the beads before the cut, shape (n, 3) [m]
    model: CutModel
    cut: CutHistory
    lag: float  # time on the record's clock at the first frame [s]
    seed: int

    @classmethod
    def drawn(
        cls, seed: int, *, beads: tuple[int, int] = (7, 14), size: tuple[int, int] = (480, 720),
        divisions: tuple[int, int, int] = (6, 12, 2), cut: CutHistory | None = None,
    ) -> Session:  # fmt: skip
        """Draw a session; a smaller image shows a smaller field, with fewer beads from the clamp on."""
        rng = np.random.default_rng([seed, 25])
        pitch = rng.uniform(0.00036, 0.00040)
        middle = np.array([(size[1] - 1) * 10 / 11, size[0] - 1]) / 2.0
        seen_from = np.array([0.0, 0.001 + 0.005 * beads[1], THICKNESS / 2])
        cameras = {}
        for name, angle, photons in (("top", 0.0, 900.0), ("side", 90.0, 5000.0)):
            cameras[name] = XRayCamera(
                angle=math.radians(angle + rng.uniform(-5, 5)), tilt=math.radians(rng.uniform(-2, 2)),
                isocentre=tuple(seen_from + rng.uniform(-0.004, 0.004, 3)),
                to_isocentre=rng.uniform(0.60, 0.66), to_detector=rng.uniform(0.95, 1.02), pitch=pitch,
                rows=size[0], columns=size[1], error=ERRORS[name],
                swirl=rng.choice([-1, 1]) * rng.uniform(0.8e-7, 2.0e-7), centre=tuple(middle + rng.uniform(-8, 8, 2)),
                photons=photons, blur=rng.uniform(0.6, 0.9),
            )  # fmt: skip
        across = (np.arange(beads[0]) - (beads[0] - 1) / 2) * 0.01
        along = 0.006 + np.arange(beads[1]) * 0.01
        rest = np.array([(x, y, THICKNESS / 2) for x in across for y in along])
        rest = rest + rng.normal(0.0, 1.0, rest.shape) * (0.0012, 0.0012, 0.0015)
        rest[np.abs(rest[:, 0]) < 0.8e-3, 0] += 1.6e-3  # none in the blade's way
        uneven = np.exp(0.25 * rng.normal(size=math.prod(divisions)))
        model = CutModel(
            element="hex20", formulation="solid", thickness=THICKNESS, divisions=divisions, relative_modulus=uneven
        )
        cut = cut or CutHistory.simulated(0.001, 0.07, seed)
        return cls(cameras=cameras, rest=rest, model=model, cut=cut, lag=float(rng.uniform(0.1, 0.6)), seed=seed)

    def places(self, time: float) -> Array:
        """Return the true places of the beads at a time of the record [s]."""
        _, tip, lead = self.cut.at(time)
        return self.rest + self.model.displacement_at(self.rest, tip, tip_displacement=lead)

    @property
    def slab(self) -> Box:
        """The tissue."""
        return Box(low=(-0.04, 0.0, 0.0), high=(0.04, 0.15, THICKNESS), attenuation=TISSUE)

    def slab_pixels(self, camera: XRayCamera, pixels: Array) -> NDArray[np.bool_]:
        """Return which pixels (n, 2) show tissue, 3 px within its border."""
        share = camera.light(np.zeros((0, 3)), BEAD, (), (self.slab,))
        within = minimum_filter(share < 0.9, 7)
        column, row = np.round(pixels).astype(int).T
        return np.asarray(within[row.clip(0, camera.rows - 1), column.clip(0, camera.columns - 1)])

    def image(self, name: str, time: float, rng: np.random.Generator) -> NDArray[np.uint8]:
        """Render one view at a time of the record."""
        camera = self.cameras[name]
        camera.prepare()
        blade, *_ = self.cut.at(time)
        knife = Box(low=(-0.001, blade - 0.008, 0.002), high=(0.001, blade, 0.07), attenuation=STEEL)
        boxes = (knife,) if blade > 1e-5 else ()
        return exposed(camera, camera.light(self.places(time), BEAD, boxes, (self.slab,)), rng)

    def frames(self, time: Array, *, first: str | None = None) -> Iterator[list[NDArray[np.uint8]]]:
        """Render frames of both views at times of the record; ``first``: interlaced, that field earlier."""
        rng = np.random.default_rng([self.seed, 26])
        half = 0.25 * float(np.median(np.diff(time)))
        for now in time:
            if first is None:
                yield [self.image(name, now, rng) for name in self.cameras]
            else:
                pairs = [[self.image(name, now + side, rng) for side in (-half, half)] for name in self.cameras]
                yield [interlaced(*pair, first) for pair in pairs]

    def phantom(self) -> Array:
        """Return the places of the phantom's balls, on a helix about the beads [m]."""
        share = float(self.rest[:, 1].max()) / 0.137
        n = np.arange(max(16, round(30 * share)))
        turn, wide = 2.4 * n, 0.027 if share > 0.6 else 0.016
        along = 0.004 + 0.133 * share * n / n[-1]
        return np.stack([wide * np.cos(turn), along, 0.0125 + 0.8 * wide * np.sin(turn)], axis=1)

    def sweep(self, count: int) -> list[XRayCamera]:
        """Return the top arm on its way to the side; the earth's field changes the swirl a little."""
        start = self.cameras["top"]
        return [
            replace(
                start,
                angle=start.angle + turn,
                swirl=start.swirl * (1.0 + 0.2 * turn),
                photons=start.photons * (1 + 2 * turn),
            )
            for turn in np.linspace(0.0, math.pi / 2, count)
        ]


def exposed(camera: XRayCamera, share: Array, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return the image with the brightness that the C-arm settles on: its middle is at 110 grey values."""
    middle = share[camera.rows // 3 : 2 * camera.rows // 3, camera.columns // 4 : 3 * camera.columns // 4]
    return camera.expose(share, rng, gain=110.0 / float(np.median(middle)))
