"""Derive eta90, the excess of the force that starts a crack run, from the spacing of the segments of Table 4.1.

    python -m scripts.derivations.eta90            prints the derivation
    python -m scripts.derivations.eta90 --write    also writes assets/derived/eta90.json

A homogeneous specimen as stiff as that very cut is cut at its speed; eta90 is the value for which the mean length of
a unit is that between the table's segments. The table's moduli assume that the cut is 1 cm deep, so they give K
whatever its depth was; the force that starts a run is proportional to the depth, which is not printed. It is assumed
to be that 1 cm, and swept. Biased upward: the table lists only significant segments. The interval is a bootstrap
over the table's segments (spacing and modulus).
"""

from __future__ import annotations

import argparse
import dataclasses
import math

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from cutenv.sim.cutting.dtypes import TICK
from cutenv.sim.plant import SimulatedPlant
from cutenv.sim.tissue.description import TissueDescription, following_means, tables_only
from cutenv.sim.tissue.specimen import Specimen
from cutenv.sim.tissue.tables import DerivedConstant, table, write_derived

SPEED = 0.0038  # of the cut of Table 4.1, thesis 4.4 [m/s]
THICKNESS = 0.01  # assumed by the table's moduli, thesis 4.2 [m]
DEPTH = 0.01  # of that cut: assumed [m]
DEPTHS = (0.007, 0.0143)  # at which that modulus is the mean liver's, and the mean of all cuts: the sweep [m]
ETAS = np.linspace(0.10, 0.70, 25)
STIFFNESSES = np.array([0.5, 0.7, 0.85, 1.0, 1.15, 1.3, 1.6])  # of the cut's mean modulus


def cut_along(specimen: Specimen, end: float, speed: float) -> NDArray[np.void]:
    """Return the readings of a blade moved from the clamp to ``end`` [m] at ``speed`` [m/s], upright."""
    positions = np.arange(1, math.ceil(end / (speed * TICK)) + 1) * speed * TICK
    return SimulatedPlant(specimen).lead(positions, math.pi / 2)


def apparent_over_true(tissue: TissueDescription) -> float:
    """Return the mean of W / (B x) over R at the cut lengths of Table 6.1, for the mean tissue cut slowly [1]."""
    resistance = tissue.fracture_resistance
    specimen = Specimen.homogeneous(
        modulus=tissue.intercept_90, fracture_resistance=resistance, depth=DEPTH, tissue=tissue
    )
    lengths = table("6.1")["cut_length_m"]
    readings = cut_along(specimen, float(lengths.max()), 0.001)
    work = np.cumsum(readings["true_force"]) * 0.001 * TICK
    apparent = np.interp(lengths, readings["position"], work) / (DEPTH * lengths)
    return float(apparent.mean() / resistance)


def unit_length(eta90: float, modulus: float, start: float, end: float, depth: float = DEPTH) -> float:
    """Return the mean spacing of crack runs [m] between ``start`` and ``end`` [m] in a cut ``depth`` [m] deep.

    ``modulus`` [Pa] is the quasi-static one for a cut 1 cm deep.
    """
    tissue = tables_only(**following_means(), eta90=eta90)
    corrected = tissue.fracture_resistance / apparent_over_true(tissue)
    specimen = Specimen.homogeneous(
        modulus=modulus * THICKNESS / depth, fracture_resistance=corrected, depth=depth, tissue=tissue
    )
    readings = cut_along(specimen, end + 0.02, SPEED)
    runs = readings["position"][readings["jump"] > 0.0]
    # The last run before the range and the first after it give a whole number of units that spans it.
    first = max(int(np.searchsorted(runs, start)) - 1, 0)
    last = min(int(np.searchsorted(runs, end)), len(runs) - 1)
    return float((runs[last] - runs[first]) / (last - first))


def main() -> None:
    """Derive and print; write if requested."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--write", action="store_true", help="write assets/derived/eta90.json")
    parser.add_argument("--resamples", type=int, default=10_000, help="bootstrap resamples")
    arguments = parser.parse_args()

    data = table("4.1")
    places = data["distance_cm"] / 100.0
    spacing = np.diff(places)
    lem = data["lem_quad8_plane_stress_Pa"]
    tissue = tables_only(**following_means())
    ratio = tissue.local_effective_modulus(SPEED, math.pi / 2) / tissue.intercept_90
    modulus = float(lem.mean()) / ratio  # the table's slope is that at 0.38 cm/s
    print(f"Table 4.1: {len(spacing)} units of {1e3 * spacing.mean():.2f} mm on average, mean LEM {lem.mean():.0f} Pa")

    lengths = np.array(
        [
            [unit_length(eta, modulus * factor, float(places[0]), float(places[-1])) for eta in ETAS]
            for factor in tqdm(STIFFNESSES, desc="unit length by stiffness")
        ]
    )

    def solve(target: float, factor: float) -> float:
        at_factor = np.array([np.interp(factor, STIFFNESSES, lengths[:, k]) for k in range(len(ETAS))])
        return float(np.interp(target, np.maximum.accumulate(at_factor), ETAS))

    value = solve(float(spacing.mean()), 1.0)
    rng = np.random.default_rng(0)
    resampled = [
        solve(float(rng.choice(spacing, len(spacing)).mean()), float(rng.choice(lem, len(lem)).mean() / lem.mean()))
        for _ in range(arguments.resamples)
    ]
    low, high = np.quantile(resampled, [0.025, 0.975])
    print(f"eta90 = {value:.3f}, 95 % bootstrap interval {low:.3f} to {high:.3f} ({arguments.resamples} resamples)")
    for eta in (0.2, 0.25, 0.3, 0.35, 0.4, 0.45):
        print(f"  unit length at eta90 = {eta:.2f}: {1e3 * np.interp(eta, ETAS, lengths[3]):.2f} mm")
    for depth in DEPTHS:
        swept = [unit_length(eta, modulus, float(places[0]), float(places[-1]), depth) for eta in ETAS]
        at_depth = float(np.interp(spacing.mean(), np.maximum.accumulate(swept), ETAS))
        reached = "" if swept[0] < spacing.mean() < max(swept) else " (an end of what was tried)"
        print(f"  if that cut was {100 * depth:.2f} cm deep: eta90 = {at_depth:.3f}{reached}")
    correction = apparent_over_true(dataclasses.replace(tissue, eta90=value))
    print(f"apparent over true fracture resistance, mean of Table 6.1's lengths: {correction:.3f}")
    if arguments.write:
        constant = DerivedConstant(
            value=round(value, 3),
            unit="1",
            interval_95=(round(float(low), 3), round(float(high), 3)),
            source="spacing of the loading segments of Table 4.1, with that cut's mean LEM",
            script="scripts/derivations/eta90.py",
        )
        write_derived("eta90", constant)


if __name__ == "__main__":
    main()
