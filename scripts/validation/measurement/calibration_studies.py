"""Calibration repeated: studies of three virtual livers each, and how often the 95 % intervals hold what was put in.

    python -m scripts.validation.measurement.calibration_studies                 ten studies of 42 cuts, four minutes

Each study is one of ``calibrate_virtual_rig.py``. Its records are calibrated as they are, then every tenth reading of
them with white noise added, then with a depth that is known as the environment's lab knows it.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable

import numpy as np
from tqdm import tqdm

from cutenv._engine.randomness import generator
from cutenv.envs.constants import Knowledge
from cutenv.records.measurement import calibrate
from cutenv.sim.tissue import Specimen, TissueDescription, measured_liver
from cutenv.sim.tissue.specimen import N_POINTS, SPACING
from cutenv.sim.trace import Trace
from scripts.tables import markdown_table
from scripts.validation.measurement.calibrate_virtual_rig import session, truth

STUDIES, SEED, LIVERS = 10, 200, 3
RESAMPLES = 200
STRIDE, NOISE = 10, 0.1  # readings of 1 kHz for one of 100 Hz; [N]
PLACES = np.arange(N_POINTS) * SPACING
NAMES = (
    "modulus", "modulus_within_cut_cv", "fracture_resistance", "fracture_within_cut_cv", "friction_share", "eta90",
)  # fmt: skip


def slow_and_noisy(trace: Trace, rng: np.random.Generator) -> Trace:
    """Return every tenth reading, with 0.1 N of white noise on its force."""
    slow = trace.select(slice(None, None, STRIDE))
    return dataclasses.replace(slow, force=slow.force + NOISE * rng.standard_normal(len(slow)))


def roughly_deep(trace: Trace, specimen: Specimen, seed: int, number: int) -> Trace:
    """Return the record with the depth that a lab measured, to 0.5 mm over 1 cm."""
    (position,) = trace.require("position", by="roughly_deep")
    measured = Knowledge().measure_depth(specimen.depth, seed, number)
    return dataclasses.replace(trace, depth=np.interp(position, PLACES, measured))


CONDITIONS: dict[str, Callable[[Trace, Specimen, int, int], Trace]] = {
    "1 kHz": lambda trace, _specimen, _seed, _number: trace,
    "100 Hz, 0.1 N of noise": lambda trace, _, seed, number: slow_and_noisy(trace, generator(seed, 1000 + number)),
    "1 kHz, depth known to 0.5 mm": roughly_deep,
}
"""Records that are calibrated, made of the virtual rig's, their specimens, and a study's seed and the cut's number."""

Outcome = tuple[float, bool]  # a number found over that put in [1], and whether its interval holds that


def outcome(tissue: TissueDescription, name: str, put_in: float) -> Outcome:
    """Compare one number of a calibrated tissue with what was put in."""
    assert tissue.calibration is not None, "made by calibrate"
    (told,) = (each for each in tissue.calibration.evidence if each.name == name)
    holds = told.low is not None and told.high is not None and told.low <= put_in <= told.high
    return getattr(tissue, name) / put_in, holds


def outcomes(studies: int, seed: int) -> dict[tuple[str, str], list[Outcome]]:
    """Cut and calibrate; return what each study found, by condition and number."""
    found: dict[tuple[str, str], list[Outcome]] = {(c, name): [] for c in CONDITIONS for name in NAMES}
    for study in tqdm(range(seed + 1, seed + studies + 1), desc="studies", leave=False):
        cuts = session(measured_liver(), LIVERS, study)
        put_in = truth(measured_liver(), [specimen for _, specimen in cuts])
        for condition, changed in CONDITIONS.items():
            records = [changed(trace, specimen, study, n) for n, (trace, specimen) in enumerate(cuts)]
            tissue = calibrate(records, resamples=RESAMPLES)
            for name in NAMES:
                found[condition, name].append(outcome(tissue, name, put_in[name]))
    return found


def report(studies: int = STUDIES, seed: int = SEED) -> str:
    """Return the table of all studies as Markdown."""
    rows = []
    for (condition, name), each in outcomes(studies, seed).items():
        shares = np.array([share for share, _ in each])
        rows.append(
            (
                condition,
                f"`{name}`",
                f"{np.median(shares):.2f}",
                f"{shares.min():.2f} to {shares.max():.2f}",
                f"{sum(holds for _, holds in each)} of {len(each)}",
            )
        )
    header = ("records", "number", "found over put in, median", "least to greatest", "95 % interval holds it")
    return f"{markdown_table(header, rows)}\n\n{studies} studies of {LIVERS} livers, {LIVERS * 14} cuts each."


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", type=int, default=STUDIES)
    parser.add_argument("--seed", type=int, default=SEED, help="one less than that of the first study")
    arguments = parser.parse_args()
    print(report(arguments.studies, arguments.seed))
