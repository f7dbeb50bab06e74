"""Fuzz the scorer: wild records must never crash it, honest ones with mild noise must be scored.

python scripts/fuzz_scorer.py                      10,000 wild records and 1000 honest ones; prints a table
python scripts/fuzz_scorer.py --wild 500 --honest 100 --seed 3
"""

from __future__ import annotations

import argparse
import collections
import dataclasses
import json
import math
import sys
import warnings
from collections.abc import Callable

import numpy as np
from tqdm import tqdm

from cutenv._engine.randomness import generator
from cutenv.plant import Leg, SimulatedPlant, run, to_trace
from cutenv.scoring import ReferenceSet, ScoreCard, score
from cutenv.tissue import Specimen, measured_liver
from cutenv.trace import Trace

ACCEPTED = 0.95
"""Smallest share of honest records that must get an overall score."""
TARGET = 0.06  # [m]
_BASE = 24  # simulated cuts, from which all honest records are derived by noise, rate and omissions

Values = np.ndarray
Source = Callable[[np.random.Generator, int], Values]


def _walk(rng: np.random.Generator, n: int) -> Values:
    return np.cumsum(rng.normal(0.0, 1.0, n)) / math.sqrt(n)


TIMES: dict[str, Source] = {
    "even": lambda rng, n: np.arange(n) / rng.choice([10.0, 30.0, 200.0, 1000.0]),
    "jittered": lambda rng, n: np.cumsum(rng.exponential(0.01, n)),
    "with a gap": lambda rng, n: np.arange(n) / 100.0 + (np.arange(n) > n // 2) * 10.0 ** rng.uniform(-1, 9),
    "tiny steps": lambda rng, n: np.arange(n) * 1e-9,
    "a far clock": lambda rng, n: 1.7e9 + np.arange(n) / 1000.0,
    "in milliseconds": lambda rng, n: np.arange(n) * 1.0,
    "shuffled": lambda rng, n: rng.permutation(n) / 100.0,
}
FORCES: dict[str, Source] = {
    "noise": lambda rng, n: rng.normal(0.0, 1.0, n),
    "a walk": lambda rng, n: 3.0 * _walk(rng, n),
    "constant": lambda rng, n: np.full(n, rng.choice([0.0, 1.0, -2.0])),
    "saturated": lambda rng, n: np.clip(3.0 * np.abs(np.sin(np.arange(n) / 40.0)), 0.0, 2.0),
    "reversed": lambda rng, n: -2.0 - np.abs(rng.normal(0.0, 0.3, n)),
    "a spike": lambda rng, n: 900.0 * (np.arange(n) == n // 2),
    "tiny": lambda rng, n: 1e-300 * rng.normal(0.0, 1.0, n),
    "in millinewtons": lambda rng, n: 2000.0 + 100.0 * rng.normal(0.0, 1.0, n),
    "a NaN in it": lambda rng, n: np.where(np.arange(n) == n // 2, np.nan, 1.0),
    "coarse": lambda rng, n: np.round(2.0 * np.abs(_walk(rng, n))),
}
POSITIONS: dict[str, Source] = {
    "a feed": lambda rng, n: np.linspace(0.0, rng.uniform(0.001, 0.14), n),
    "back": lambda rng, n: np.linspace(0.1, 0.0, n),
    "two cuts": lambda rng, n: np.abs(np.linspace(0.0, 0.16, n) % 0.08),
    "there and back": lambda rng, n: 0.08 * np.sin(np.pi * np.arange(n) / n),
    "still": lambda rng, n: np.full(n, 0.02),
    "jumps": lambda rng, n: rng.uniform(-0.05, 0.5, n),
    "a walk": lambda rng, n: np.clip(0.05 + 0.03 * _walk(rng, n), -0.05, 0.5),
    "in centimetres": lambda rng, n: np.linspace(0.0, 8.0, n),
}
DEPTHS: dict[str, Source] = {
    "even": lambda rng, n: np.full(n, 0.015),
    "nothing": lambda rng, n: np.zeros(n),
    "random": lambda rng, n: rng.uniform(0.0, 0.1, n),
}
ANGLES: dict[str, Source] = {
    "upright": lambda rng, n: np.full(n, math.pi / 2),
    "flat": lambda rng, n: np.full(n, rng.choice([0.0, math.pi])),
    "random": lambda rng, n: rng.uniform(0.0, math.pi, n),
    "in degrees": lambda rng, n: np.full(n, 90.0),
}


REFUSED = {"in milliseconds", "shuffled", "in millinewtons", "a NaN in it", "in centimetres", "in degrees", "jumps"}
"""Flaws that a trace mostly refuses; rarer here than among people, so that enough records reach the scorer."""


def _drawn(rng: np.random.Generator, sources: dict[str, Source], n: int, missing: float) -> Values | None:
    if rng.random() < missing:
        return None
    odds = np.array([0.15 if name in REFUSED else 1.0 for name in sources])
    return sources[str(rng.choice(list(sources), p=odds / odds.sum()))](rng, n)


def wild(rng: np.random.Generator) -> Trace:
    """Return a random record; raises ValueError where a trace refuses it."""
    n = int(rng.choice([0, 1, 2, 3, 10, 49, 60, 400, 2000], p=[0.02, 0.02, *7 * [0.96 / 7]]))
    position = _drawn(rng, POSITIONS, n, 0.3)
    return Trace(
        time=_drawn(rng, TIMES, n, 0.0),
        force=_drawn(rng, FORCES, n, 0.0),
        position=position,
        speed=rng.normal(0.0, 0.01, n) if rng.random() < 0.05 else None,
        depth=_drawn(rng, DEPTHS, n, 0.3),
        angle=_drawn(rng, ANGLES, n, 0.3),
        force_unit=str(rng.choice(["N", "N", "1"])),
    )


def wild_target(rng: np.random.Generator) -> float | None:
    """Return a target length as people give it, sometimes in centimetres, sometimes None [m]."""
    return rng.choice([None, None, 0.04, 0.06, 0.06, 0.08, 0.15, 0.15, 6.0, -1.0])


def cut_livers(cuts: int = _BASE, seed: int = 1) -> list[Trace]:
    """Cut sampled livers at many speeds and angles, half of them there and back, recorded as by a rig."""
    traces = []
    for n in range(cuts):
        rng = generator(seed, n)
        specimen = Specimen.draw(rng, specimen_class="liver", tissue=measured_liver())
        angle = math.radians(rng.uniform(45.0, 90.0))
        plant = SimulatedPlant(specimen, seed=seed, episode=n, angle=angle)
        ways = [Leg(position=TARGET + 0.005, speed=rng.uniform(0.004, 0.0254), angle=angle, dwell=0.2)]
        ways += [Leg(position=0.0, speed=0.02, angle=angle, dwell=0.2)] * (n % 2)
        traces.append(to_trace(plant, run(plant, ways)))
    return traces


def honest(rng: np.random.Generator, cuts: list[Trace]) -> Trace:
    """Return one of ``cuts`` as another lab might have recorded it: more noise, another rate, fewer columns."""
    trace = cuts[int(rng.integers(len(cuts)))]
    trace = trace.select(slice(int(rng.integers(3)), None, int(rng.choice([1, 2, 5, 10, 20]))))
    n = len(trace)
    if rng.random() < 0.3:  # lost readings
        trace = trace.select(rng.random(n) > 0.01)
        n = len(trace)
    force = trace.force + rng.normal(rng.uniform(-0.03, 0.03), rng.uniform(0.0, 0.04), n)
    resolution = rng.choice([0.01, 0.05])
    force = np.round(force / resolution) * resolution
    if rng.random() < 0.25:
        return Trace(time=trace.time, force=force / rng.uniform(1.0, 10.0), force_unit="1")
    assert trace.position is not None
    encoder = rng.choice([1e-6, 1e-5, 5e-5])
    position = np.round(trace.position / encoder) * encoder + rng.normal(0.0, 5e-6, n)
    kept = {name: None for name in ("depth", "angle") if rng.random() < 0.1}
    return dataclasses.replace(trace, force=force, position=position, speed=None, **kept)  # type: ignore[arg-type]


def references(cuts: list[Trace]) -> dict[str, ReferenceSet]:
    """Make reference sets from the unmodified cuts, by force unit."""
    alone = [Trace(time=cut.time, force=cut.force, force_unit="1") for cut in cuts]
    return {unit: _reference(traces, unit) for unit, traces in (("N", cuts), ("1", alone))}


def _reference(traces: list[Trace], unit: str) -> ReferenceSet:
    cards = [score(trace, target_length=TARGET) for trace in traces]
    rows = [("rig", {name: scored.value for name, scored in card.metrics.items()}) for card in cards]
    return ReferenceSet.of(rows, name="virtual livers", about="as recorded", force_unit=unit)


def check(card: ScoreCard) -> None:
    """Check that every number is finite or has a reason, and that every form of the card can be made."""
    json.loads(card.to_json())
    assert str(card)
    assert card._repr_html_()
    for name, scored in card.metrics.items():
        assert (scored.value is None) == bool(scored.unavailable), name
        assert scored.value is None or math.isfinite(scored.value), name
    assert (card.overall_score is None) == bool(card.no_score)


def _needs_words(error: Exception, field: str) -> None:
    """Check that a refusal names the field and what is wrong with it."""
    if field not in str(error) or len(str(error)) < 20:
        raise AssertionError("a refusal without a reason") from error


def fate_of_wild(seed: int) -> str:
    """Return the result for a wild record; raises unless it is a refusal or a valid card."""
    rng = np.random.default_rng(seed)
    try:
        trace, target = wild(rng), wild_target(rng)
    except (TypeError, ValueError) as error:
        _needs_words(error, "")
        return "refused as no record of a cut (Trace)"
    try:
        card = score(trace, target_length=target)
    except ValueError as error:
        _needs_words(error, "target_length")
        return "refused for its target length"
    check(card)
    values = sum(scored.value is not None for scored in card.metrics.values())
    if "no reference set" in card.no_score:
        return "metrics, nothing doubted" if values else "nothing known, with reasons"
    return "metrics, with a reason for no score" if values else "nothing known, with reasons"


def fate_of_honest(seed: int, cuts: list[Trace], sets: dict[str, ReferenceSet]) -> str:
    """Return the result for an honest record: a score, or the reason why there is none."""
    trace = honest(np.random.default_rng(seed), cuts)
    card = score(trace, target_length=TARGET, reference=sets[trace.force_unit])
    check(card)
    return "scored" if card.overall_score is not None else f"not scored: {card.no_score[:70]}"


def table(fates: collections.Counter[str]) -> str:
    """Return counts and shares as text."""
    total = sum(fates.values())
    return "\n".join(f"  {n:6d}  {n / total:6.1%}  {fate}" for fate, n in fates.most_common())


def main() -> int:
    """Run all records and print; return 1 if too few honest records were scored."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--wild", type=int, default=10_000)
    parser.add_argument("--honest", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0, help="of the first record")
    arguments = parser.parse_args()
    warnings.simplefilter("error")  # a NumPy warning may hide a quiet NaN

    seeds = range(arguments.seed, arguments.seed + arguments.wild)
    fates = collections.Counter(fate_of_wild(seed) for seed in tqdm(seeds, desc="wild records"))
    print(f"{arguments.wild} wild records, none of which crashed the scorer:\n{table(fates)}\n")

    cuts = cut_livers()
    sets = references(cuts)
    seeds = range(arguments.seed, arguments.seed + arguments.honest)
    fates = collections.Counter(fate_of_honest(seed, cuts, sets) for seed in tqdm(seeds, desc="honest records"))
    print(f"{arguments.honest} honest records with mild noise:\n{table(fates)}")
    share = fates["scored"] / arguments.honest
    print(f"\n{share:.1%} are scored; {ACCEPTED:.0%} must be.")
    return int(share < ACCEPTED)


if __name__ == "__main__":
    sys.exit(main())
