"""Fit the specimens' spread to the thesis's tables by virtual measurement, and print the fit.

    python -m scripts.derivations.specimens            prints measured tables beside virtual ones
    python -m scripts.derivations.specimens --fit      fits first, and writes assets/derived/*.json

Virtual livers are sampled, four cuts each, and cut over 12 cm at 0.1, 1.27 and 2.54 cm/s, 90 degrees, by the simulated
rig with its sensor. Their records are evaluated as in the thesis: for Tables 5.2 to 5.4 without depth, friction or the
lag of the tip, for Table 5.6 by the force per depth of cut, for Table 6.1 as the blade's work over depth and travel.

Fitted are: mean of the material's modulus (to Table 5.6), its spread between cuts (to Tables 5.2 to 5.4), the length
over which the bulge rises (to Table 5.5 over Table 5.6, the depth that affects the moduli, less its standard error:
where the depth rises more gently, fewer cuts are stopped by tissue that stiffens ahead of the tip), mean of the
fracture resistance and its spread between cuts (to Table 6.1). The spread within a cut is not: the bulge alone
reproduces that of Table 5.2.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from cutenv._engine.randomness import generator
from cutenv.records.measurement import estimate_fracture_resistance, estimate_local_effective_moduli
from cutenv.sim.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.sim.tissue import Specimen, draw_liver, measured_liver
from cutenv.sim.tissue.description import (
    CUTS_PER_LIVER,
    FITTED,
    TissueDescription,
    depth_standard_error,
    mean_depth_of_cut,
    modulus_spread,
    variance_components,
)
from cutenv.sim.tissue.tables import DerivedConstant, measured_fracture_resistance, table, write_derived

SPEEDS = {"5.2": 0.001, "5.3": 0.0127, "5.4": 0.0254}  # of each table [m/s]
TRAVEL = 0.12  # thesis 3.3.2 [m]
SIGNIFICANT_DROP = 0.2  # smallest drop of a segment that the thesis would list: four times its sensor's resolution [N]
FEWEST_SEGMENTS = 3
CUTS_OF_TABLE_6_1 = 40 / 7  # number of cuts of each of its seven lengths; the thesis gives only the total
UPRIGHT = math.pi / 2
UNITS = {"modulus": "Pa", "fracture_resistance": "J/m2", "rise_length": "m"}
DEPTH_POWER = 1.3  # exponent of the rise length's correction for a missed depth


class Cut(NamedTuple):
    """Results of one virtual cut."""

    table: str
    moduli: np.ndarray  # as measured in the thesis: no depth, blade taken as tip [Pa]
    corrected: float  # mean of the moduli by force per depth, over that of Table 5.6 at this speed [1]
    length: float  # of the cut to which the apparent resistance belongs [m]
    apparent: float  # [J/m2]
    depth: float  # that affects the moduli: mean without depth over mean with depth, of a model 1 cm thick [m]


def virtual_cuts(tissue: TissueDescription, livers: int, seed: int) -> Iterator[Cut]:
    """Sample and cut ``livers`` livers, four cuts each; every table gets every third liver."""
    lengths = table("6.1")["cut_length_m"]
    number = 0
    for liver in range(livers):
        factor = draw_liver(generator(seed, liver), tissue)
        name = list(SPEEDS)[liver % len(SPEEDS)]
        speed = SPEEDS[name]
        for cut in range(CUTS_PER_LIVER):
            rng = generator(seed, livers + liver * CUTS_PER_LIVER + cut)
            specimen = Specimen.draw(rng, tissue=tissue, liver_factor=factor)
            plant = SimulatedPlant(specimen, seed=seed, episode=number)
            trace = to_trace(plant, run(plant, [Leg(position=TRAVEL, speed=speed)]))
            model = tissue.cut_model()
            as_thesis, with_depth = (
                estimate_local_effective_moduli(
                    trace,
                    model,
                    depth_normalised=depth_normalised,
                    friction_per_depth=0.0,
                    loading_ratio=0.0,
                    smallest_drop=SIGNIFICANT_DROP,
                )
                for depth_normalised in (False, True)
            )
            length = float(lengths[number % len(lengths)])
            short = trace.select(slice(0, int(np.searchsorted(trace.position, length)) + 1))
            number += 1
            moduli = as_thesis.modulus
            shown = min(len(moduli), len(with_depth)) >= FEWEST_SEGMENTS
            yield Cut(
                table=name,
                moduli=moduli if shown else np.array([math.nan]),
                corrected=with_depth.modulus.mean() / tissue.local_effective_modulus(speed, UPRIGHT)
                if shown
                else math.nan,
                length=length,
                apparent=estimate_fracture_resistance(short).apparent,
                depth=moduli.mean() / with_depth.modulus.mean() * model.thickness if shown else math.nan,
            )


class Statistics(NamedTuple):
    """Statistics of many virtual cuts, to compare with their measured counterparts.

    Every cut contributes its apparent resistance, those with three segments their modulus as well.
    """

    modulus_ratio: float  # mean depth-normalised modulus over the fit [1]
    between_cv: float  # of cuts' mean moduli, livers and cuts together [1]
    within_cv: float  # mean of SD over mean within a cut [1]
    resistance: float  # mean apparent [J/m2]
    resistance_cv: float  # [1]
    depth: float  # that affects the moduli [m]


def statistics(cuts: list[Cut]) -> Statistics:
    """Compute the virtual counterpart of the tables' statistics."""
    relative = []
    for name in SPEEDS:
        means = np.array([cut.moduli.mean() for cut in cuts if cut.table == name])
        relative.append(means / np.nanmean(means))
    apparent = np.array([cut.apparent for cut in cuts])
    return Statistics(
        modulus_ratio=float(np.nanmean([cut.corrected for cut in cuts])),
        between_cv=float(np.nanstd(np.concatenate(relative))),
        within_cv=float(np.nanmean([cut.moduli.std() / cut.moduli.mean() for cut in cuts])),
        resistance=float(apparent.mean()),
        resistance_cv=float(apparent.std() / apparent.mean()),
        depth=float(np.exp(np.nanmean(np.log([cut.depth for cut in cuts])))),  # the same as in mean_depth_of_cut
    )


def targets() -> Statistics:
    """Return the statistics of the tables."""
    spread = modulus_spread()
    resistance = measured_fracture_resistance()
    return Statistics(
        modulus_ratio=1.0,
        between_cv=math.hypot(spread.between_liver_cv, spread.between_cut_cv),
        within_cv=spread.within_cut_cv,
        resistance=resistance.mean,
        resistance_cv=resistance.sd / resistance.mean,
        depth=mean_depth_of_cut() * (1.0 - depth_standard_error()),
    )


def measure(tissue: TissueDescription, livers: int, seed: int, what: str) -> list[Cut]:
    """Make all virtual cuts, with a progress bar."""
    return list(tqdm(virtual_cuts(tissue, livers, seed), total=livers * CUTS_PER_LIVER, desc=what, unit="cut"))


def fit(livers: int, rounds: int) -> TissueDescription:
    """Correct each constant by the error of its statistic, with the same random numbers every round."""
    tissue = measured_liver()
    goal = targets()
    for number in range(rounds):
        cuts = measure(tissue, livers, seed=1, what=f"fit, round {number + 1} of {rounds}")
        found = statistics(cuts)

        def spread(old: float, missed: tuple[float, float]) -> float:
            """Return a corrected spread: independent spreads add in squares."""
            return math.sqrt(max(old**2 + missed[0] ** 2 - missed[1] ** 2, 0.02**2))

        tissue = dataclasses.replace(
            tissue,
            modulus=tissue.modulus * goal.modulus_ratio / found.modulus_ratio,
            modulus_between_cut_cv=spread(tissue.modulus_between_cut_cv, (goal.between_cv, found.between_cv)),
            rise_length=tissue.rise_length * (found.depth / goal.depth) ** DEPTH_POWER,
            fracture_resistance=tissue.fracture_resistance * goal.resistance / found.resistance,
            fracture_between_cut_cv=spread(tissue.fracture_between_cut_cv, (goal.resistance_cv, found.resistance_cv)),
        )
        print("  ".join(f"{name} {getattr(tissue, name):.4g}" for name in FITTED))
    return tissue


def outside(what: str, measured: tuple[float, float], virtual: tuple[float, float]) -> list[str]:
    """Return a line about a value, with its standard error, that a virtual one misses by over twice that of both."""
    error = math.hypot(measured[1], virtual[1])
    if abs(measured[0] - virtual[0]) <= 2.0 * error:
        return []
    return [
        f"{what}: {virtual[0]:.1f} for {measured[0]:.1f}, {abs(measured[0] - virtual[0]) / error:.1f} standard errors"
    ]


def mean_and_error(values: np.ndarray) -> tuple[float, float]:
    """Return the mean of the finite values, and its standard error."""
    known = values[np.isfinite(values)]
    return float(known.mean()), float(known.std(ddof=1) / math.sqrt(len(known)))


def sd_and_error(sd: float, count: float) -> tuple[float, float]:
    """Return a standard deviation, and its standard error if it is that of ``count`` normal values."""
    return sd, sd / math.sqrt(2.0 * (count - 1.0))


def misses(cuts: list[Cut]) -> tuple[int, list[str]]:
    """Return the number of values of Tables 5.2 to 5.4 and 6.1 compared, and those outside two standard errors."""
    compared, found = 0, []
    for name in SPEEDS:
        data = table(name)
        own = [cut.moduli / 1e3 for cut in cuts if cut.table == name]
        means, within = np.array([m.mean() for m in own]), np.array([m.std() for m in own])
        lem, sd = data["lem_plane_stress_Pa"] / 1e3, data["sd_plane_stress_Pa"] / 1e3
        told = int(np.isfinite(means).sum())
        found += outside(f"Table {name}, mean [kPa]", mean_and_error(lem), mean_and_error(means))
        found += outside(
            f"Table {name}, SD between cuts [kPa]",
            sd_and_error(lem.std(ddof=1), len(lem)),
            sd_and_error(float(np.nanstd(means, ddof=1)), told),
        )
        found += outside(f"Table {name}, SD within a cut [kPa]", mean_and_error(sd), mean_and_error(within))
        compared += 3
    data = table("6.1")
    sds = data["sd_fracture_resistance_J_m2"]
    pooled = math.sqrt(float(np.mean(sds**2)))
    for length, mean in zip(data["cut_length_m"], data["fracture_resistance_J_m2"], strict=True):
        own = np.array([cut.apparent for cut in cuts if abs(cut.length - length) < 1e-6])
        error = pooled / math.sqrt(CUTS_OF_TABLE_6_1)
        found += outside(f"Table 6.1, {100 * length:.2f} cm, mean [J/m2]", (float(mean), error), mean_and_error(own))
        compared += 1
    apparent = np.array([cut.apparent for cut in cuts])
    all_sd = sd_and_error(float(apparent.std(ddof=1)), len(apparent))
    found += outside("Table 6.1, pooled SD [J/m2]", sd_and_error(pooled, 40 - len(sds) + 1), all_sd)
    return compared + 1, found


def show(tissue: TissueDescription, livers: int) -> None:
    """Print the tables beside virtual ones, from random numbers that the fit has not used."""
    cuts = measure(tissue, livers, seed=2, what="checking on new specimens")
    print(f"\n{len(cuts)} virtual cuts of {livers} livers; measured | virtual\n")
    print("LEM as the thesis measured (no depth), kPa, by table")
    for name in SPEEDS:
        data = table(name)
        own = [cut for cut in cuts if cut.table == name]
        means = np.array([cut.moduli.mean() for cut in own])
        sds = np.array([cut.moduli.std() for cut in own])
        told = int(np.isfinite(means).sum())
        lem, sd = data["lem_plane_stress_Pa"], data["sd_plane_stress_Pa"]
        print(
            f"  Table {name}: mean {lem.mean() / 1e3:5.1f} | {np.nanmean(means) / 1e3:5.1f}"
            f"   SD between cuts {lem.std() / 1e3:5.1f} | {np.nanstd(means) / 1e3:5.1f}"
            f"   mean SD within a cut {sd.mean() / 1e3:5.1f} | {np.nanmean(sds) / 1e3:5.1f}"
            f"   ({told} of {len(own)} cuts show one)"
        )
    relative = np.concatenate(
        [
            [
                cut.moduli.mean() / np.nanmean([c.moduli.mean() for c in cuts if c.table == name])
                for cut in cuts
                if cut.table == name
            ]
            for name in SPEEDS
        ]
    )
    if np.isfinite(relative).all():
        liver, cut = variance_components(relative.reshape(1, -1, CUTS_PER_LIVER))
        spread = modulus_spread()
        print(
            f"  CV between livers {spread.between_liver_cv:.3f} | {math.sqrt(max(liver, 0.0)):.3f}, "
            f"between cuts of a liver {spread.between_cut_cv:.3f} | {math.sqrt(cut):.3f}"
        )
    print("\nApparent fracture resistance W/(B x), J/m2, by length of cut (Table 6.1)")
    data = table("6.1")
    for length, mean, sd in zip(
        data["cut_length_m"], data["fracture_resistance_J_m2"], data["sd_fracture_resistance_J_m2"], strict=True
    ):
        own = np.array([cut.apparent for cut in cuts if abs(cut.length - length) < 1e-6])
        print(
            f"  {100 * length:5.2f} cm: {mean:6.1f} +- {sd:5.1f}"
            f" | {own.mean():6.1f} +- {own.std():5.1f}  (n = {len(own)})"
        )
    print("\nStatistic                     measured  virtual")
    for name, goal, found in zip(Statistics._fields, targets(), statistics(cuts), strict=True):
        print(f"  {name:26s} {goal:9.4g} {found:8.4g}")
    compared, outside_two = misses(cuts)
    print(
        f"\n{len(FITTED)} numbers fitted: {', '.join(FITTED)}"
        f"\n{compared} values of Tables 5.2-5.4 and 6.1, {compared - len(FITTED)} degrees of freedom; "
        f"{len(outside_two)} outside two standard errors of both:"
    )
    print("\n".join(f"  {line}" for line in outside_two))


def main() -> None:
    """Fit if requested, then print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fit", action="store_true", help="fit and write assets/derived/*.json")
    parser.add_argument("--livers", type=int, default=120, help="virtual livers, four cuts each")
    parser.add_argument("--rounds", type=int, default=4, help="of the fit")
    arguments = parser.parse_args()
    if arguments.fit:
        tissue = fit(arguments.livers, arguments.rounds)
        for name in FITTED:
            constant = DerivedConstant(
                value=float(f"{getattr(tissue, name):.4g}"),
                unit=UNITS.get(name, "1"),
                interval_95=None,
                source="virtual measurement against Tables 5.2 to 5.6 and 6.1",
                script="scripts/derivations/specimens.py --fit",
            )
            write_derived(name, constant)
        measured_liver.cache_clear()
    show(measured_liver(), arguments.livers)


if __name__ == "__main__":
    main()
