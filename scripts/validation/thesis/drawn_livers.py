"""Sampled livers, cut and measured as in the thesis: counterparts of Tables 5.1 to 5.7 and 6.1.

A liver takes four parallel cuts; every cut is in a new place, so that no liver is cut twice.  The rig moves the blade
over 12 cm, and its sensor has noise, resolution and delay.  From the record alone follow loading segments and, for
each segment, moduli: from the increment of the force as measured (Tables 5.1 to 5.5), and from that increment per
depth of cut ("depth-of-cut normalized cutting force increment", section 5.4; Tables 5.6 and 5.7).  The blade counts as
the tip, and friction is left in: what the thesis neglected is neglected here.
"""

from __future__ import annotations

import functools
import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from cutenv._engine.randomness import generator
from cutenv.records.measurement import ModulusEstimate, estimate_fracture_resistance, estimate_local_effective_moduli
from cutenv.records.measurement.segments import SMALLEST_DROP
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import CutModel, Specimen, draw_liver, measured_liver
from cutenv.sim.tissue.description import CUTS_PER_LIVER
from cutenv.sim.tissue.tables import table
from cutenv.sim.trace import Trace
from scripts.derivations.specimens import FEWEST_SEGMENTS, SIGNIFICANT_DROP, TRAVEL

SPEEDS_CM_S = tuple(float(v) for v in table("5.6")["speed_cm_s"])
QUICK_SPEEDS_CM_S = (0.1, 1.27, 2.54)
LIVERS, QUICK_LIVERS = 6, 1  # for each speed and angle
LENGTHS = table("6.1")["cut_length_m"]
QUICK_LENGTHS = LENGTHS[::3]
SEED = 5  # scripts/derivations/specimens.py uses another: none of these livers was fitted
MODELS = {
    (formulation, poisson): CutModel(formulation=formulation, poisson=poisson)
    for formulation in ("plane_stress", "plane_strain")
    for poisson in (0.3, 0.499)
}

BASE = MODELS["plane_stress", 0.3]

Array = NDArray[np.float64]


class DrawnCut(NamedTuple):
    """Results of one record."""

    segments: int
    as_measured: dict[tuple[str, float], Array]  # LEM of each segment by formulation and Poisson's ratio [Pa]
    per_depth: dict[tuple[str, float], Array]  # the same, from the increment of force per depth of cut [Pa]
    of_force_per_depth: Array  # another reading, 8 nodes, plane stress, 0.3: increment of the force per depth [Pa]
    with_small_drops: Array  # `as_measured`, likewise, where smaller drops count too [Pa]
    length: float  # of the first part of the cut to which `apparent` belongs [m]
    apparent: float | None  # W/(B x), of upright cuts [J/m2]


def speeds(quick: bool) -> tuple[float, ...]:
    """Return the speeds of the protocol [cm/s]."""
    return QUICK_SPEEDS_CM_S if quick else SPEEDS_CM_S


def livers(quick: bool) -> int:
    """Return the number of livers for each speed and angle."""
    return QUICK_LIVERS if quick else LIVERS


@functools.cache
def cuts(speed_cm_s: float, angle_deg: float, quick: bool) -> list[DrawnCut]:
    """Cut separate livers at one speed and angle, four times each; cuts of too few segments are left out."""
    tissue, angle = measured_liver(), math.radians(angle_deg)
    row = round(1000 * speed_cm_s + angle_deg)
    lengths = QUICK_LENGTHS if quick else LENGTHS
    cases = list(itertools.product(range(livers(quick)), range(CUTS_PER_LIVER)))
    found = []
    for liver, cut in tqdm(
        cases, desc=f"drawn livers, {speed_cm_s:g} cm/s, {angle_deg:g} deg", unit="cut", leave=False
    ):
        key = 100 * (100 * row + liver)
        factor = draw_liver(generator(SEED, key), tissue)
        specimen = Specimen.draw(generator(SEED, key + cut + 1), tissue=tissue, liver_factor=factor)
        plant = SimulatedPlant(specimen, seed=SEED, episode=key + cut, angle=angle)
        trace = to_trace(plant, run(plant, [Leg(position=TRAVEL, speed=speed_cm_s / 100, angle=angle)]))
        length = float(lengths[(row + CUTS_PER_LIVER * liver + cut) % len(lengths)])
        measured = measure(trace, length, upright=angle_deg == 90)
        if measured.segments >= FEWEST_SEGMENTS:
            found.append(measured)
    return found


def measure_as_the_thesis(
    trace: Trace, model: CutModel = BASE, smallest_drop: float = SIGNIFICANT_DROP
) -> ModulusEstimate:
    """Measure moduli by the force as it is: without depth, with friction, and with the blade for the tip."""
    return estimate_local_effective_moduli(
        trace, model, depth_normalised=False, friction_per_depth=0.0, loading_ratio=0.0, smallest_drop=smallest_drop
    )


def measure(trace: Trace, length: float, *, upright: bool) -> DrawnCut:
    """Measure as in the thesis; the resistance from the first ``length`` [m] of an upright cut."""
    estimate, with_small_drops = (
        measure_as_the_thesis(trace, smallest_drop=x) for x in (SIGNIFICANT_DROP, SMALLEST_DROP)
    )
    position, depth = trace.require("position", "depth", by="measure")
    x, segments = estimate.position, estimate.segments
    slopes = np.array([s.slope for s in segments])
    depths = np.array([s.depth for s in segments])
    lines = [np.polyfit(position[s.samples], trace.force[s.samples] / depth[s.samples], 1) for s in segments]
    begun = trace.select(slice(0, int(np.searchsorted(position, length)) + 1))
    return DrawnCut(
        segments=len(estimate),
        as_measured={name: slopes / (model.stiffness(x) * model.thickness) for name, model in MODELS.items()},
        per_depth={name: slopes / (model.stiffness(x) * depths) for name, model in MODELS.items()},
        of_force_per_depth=np.array([slope for slope, _ in lines]) / BASE.stiffness(x),
        with_small_drops=with_small_drops.modulus,
        length=length,
        apparent=estimate_fracture_resistance(begun).apparent if upright else None,
    )
