"""Filmed cuts: virtual records with tracks of beads that an independent, finer model moves, and the truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import CutModel, Specimen
from cutenv.sim.tissue.grid import LENGTH, N_POINTS
from cutenv.sim.tissue.slab import zoned_model
from cutenv.sim.trace import Trace
from cutenv.vision import BeadTracks

Array = NDArray[np.float64]
PLACES = np.linspace(0.0, LENGTH, N_POINTS)
FRAMES = 29.97  # a second, of the thesis's video (section 7.1)


class FilmedCut(NamedTuple):
    """Record of a cut, tracks of the beads, and the truth."""

    trace: Trace
    tracks: BeadTracks
    specimen: Specimen
    places: Array  # beads before the cut, shape (n, 3) [m]


def slice_of_zones(borders: Sequence[float], moduli: Sequence[float], depth: float) -> Specimen:
    """Make a slice that is cut through, with a modulus for each zone [Pa]."""
    uniform = Specimen.homogeneous(modulus=4e4, fracture_resistance=211.0, depth=depth)
    along = np.asarray(moduli)[np.searchsorted(borders, PLACES + 1e-9)]
    return Specimen(**{**vars(uniform), "modulus": along})


def grid_of_beads(depth: float) -> Array:
    """Return the thesis's 7 x 14 beads, about 1 cm apart, inside a slab, shape (98, 3) [m]."""
    x, y = np.meshgrid(np.linspace(-0.03, 0.03, 7), np.arange(14) * 0.01 + 0.01)
    places = np.stack([x.ravel(), y.ravel(), np.full(x.size, 0.5 * depth)], axis=1)
    places[:, :2] += np.random.default_rng(7).uniform(-0.002, 0.002, (len(places), 2))  # set by hand
    return places


def filmed_cut(
    specimen: Specimen,
    *,
    length: float = 0.1,
    speed: float = 0.001,
    divisions: tuple[int, ...] = (32, 60),
    noise: float = 1e-4,
    frames: float = FRAMES,
    seed: int = 1,
    **model: Any,
) -> FilmedCut:
    """Cut a slice forward and back through a sensor, and move beads by a finer model than any that measures them.

    The blade goes ``length`` [m] at ``speed`` [m/s], and returns at 1.27 cm/s. The mesh of ``divisions`` and further
    arguments of `CutModel` moves the beads, driven by the force; ``noise`` is the standard deviation of a bead's place
    along each axis [m], and ``frames`` are those a second.
    """
    plant = SimulatedPlant(specimen, seed=seed)
    readings = run(plant, [Leg(position=0.0, speed=speed, dwell=0.5), Leg(position=length, speed=speed, dwell=0.2)])
    trace = to_trace(plant, readings, specimen="slice")
    beads = grid_of_beads(specimen.thickness)
    at = np.arange(trace.time[0], trace.time[-1], 1.0 / frames)
    tip, blade = (np.interp(at, readings["time"], readings[name]) for name in ("tip", "position"))
    force = np.interp(tip, PLACES, specimen.stiffness()) * np.maximum(blade - tip, 0.0)
    changes = np.flatnonzero(np.diff(specimen.modulus)) + 1
    borders = 0.5 * (PLACES[changes] + PLACES[changes - 1])
    truth = zoned_model(CutModel(divisions=divisions, **model), borders, specimen.modulus[[0, *changes]])
    beads = beads[(np.abs(beads[:, 0] + truth.offset) < 0.5 * truth.width) & (beads[:, 1] < truth.length)]
    rng = np.random.default_rng(seed)
    here, number = np.unique(np.round(tip, 5), return_inverse=True)  # the crack rests while the blade loads it
    per_force = np.array(
        [
            truth.displacement_at(beads[:, : truth.dim], a, force=1.0, modulus=1.0, thickness=specimen.thickness)
            for a in here
        ]
    )
    moved = per_force[number] * force[:, np.newaxis, np.newaxis]
    place = np.repeat(beads[np.newaxis], len(at), axis=0)
    place[..., : truth.dim] += moved
    place += noise * rng.standard_normal(place.shape)
    n = place[..., 0].size
    return FilmedCut(
        trace=trace,
        tracks=BeadTracks(
            bead=np.tile(np.arange(1, len(beads) + 1), len(at)),
            time=np.repeat(at, len(beads)),
            place=place.reshape(-1, 3),
            covariance=np.tile(max(noise, 1e-6) ** 2 * np.eye(3), (n, 1, 1)),
            metadata={"modulus_put_in_Pa": float(specimen.modulus[0])} if len(changes) == 0 else {},
        ),
        specimen=specimen,
        places=beads,
    )
