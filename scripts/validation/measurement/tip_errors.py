"""Errors of the estimated tip at the end of cuts: by a rig while it cuts, and by the score of the record.

    python -m scripts.validation.measurement.tip_errors                      200 held-out specimens, some two minutes

Scripts cut mixed specimens; the record holds what a rig measures, with noise, delay, and a depth known to 0.5 mm.  The
tip is estimated up to the deepest point, and from the whole record: every script draws back at the end, until the
tissue is unloaded.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from cutenv.agents.learning.demonstration import recorded
from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.policy import BASELINES, Policy
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.records.scoring.scored_cut import ScoredCut
from cutenv.sim.plant import to_trace
from cutenv.sim.trace import Trace

POLICIES = {  # scripts by what they do before the end
    "constant feed": "constant 1.65 cm/s 45 deg",
    "one return stroke": "return stroke",
    "probe and creep": "probe and creep",
}
CONTROL_HZ = 50
FAR = 2.0  # error from which a tip counts as far off [mm]


class Record(NamedTuple):
    """A record with the hidden tip at each of its instants [m], and the target length [m]."""

    trace: Trace
    tip: np.ndarray
    target: float

    def up_to(self, count: int) -> Record:
        """Return the first ``count`` instants."""
        return Record(self.trace.select(slice(count)), self.tip[:count], self.target)


def cut(env: GentleCutEnv, policy: Policy, seed: int) -> Record:
    """Cut the specimen of a seed."""
    observation, _ = env.reset(seed=seed)
    policy.reset(np.random.default_rng(seed))
    parts, ended = [], False
    while not ended:
        observation, _, ended, _, _ = env.step(policy(observation))
        parts.append(env.cutting.readings.copy())
    readings = np.concatenate(parts)
    return Record(to_trace(env.plant, readings), readings["tip"], env.cutting.target_length)


def errors_of(record: Record) -> tuple[float, ...]:
    """Return errors [mm] of a rig's tip while it cuts, and of the score's, at the end; then their means on the way."""
    found = recorded(record.trace, control_hz=CONTROL_HZ, target_length=record.target).infos["tip_estimate_m"][1:]
    felt = np.abs(found - record.tip[1000 // CONTROL_HZ - 1 :: 1000 // CONTROL_HZ][: len(found)])
    scored = np.abs(ScoredCut(trace=record.trace).tip - record.tip)
    return tuple(1e3 * float(error) for error in (felt[-1], scored[-1], felt.mean(), scored.mean()))


def measure(policy: str, seeds: Sequence[int]) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the errors [mm], shape (specimens, 4), of the records of a script up to the deepest point, and whole."""
    env, script = GentleCutEnv(specimen_class="mixed", control_hz=CONTROL_HZ), BASELINES[policy]()
    forward, whole = [], []
    for seed in tqdm(seeds, desc=policy, unit="cut", leave=False):
        record = cut(env, script, seed)
        forward.append(errors_of(record.up_to(int(np.argmax(record.trace.position)) + 1)))
        whole.append(errors_of(record))
    yield "up to its deepest point", np.array(forward)
    yield "whole", np.array(whole)


def report(specimens: int = 200) -> str:
    """Return the errors as a Markdown table."""
    lines = [
        f"Class mixed, {specimens} held-out specimens. Error of the tip at the record's end: median, 90 %, share "
        f"beyond {FAR:g} mm; and its mean on the way, median over the cuts.",
        "",
        "| script | record | while cutting [mm] | by the score [mm] | on the way [mm] | by the score [mm] |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for name, policy in POLICIES.items():
        for part, errors in measure(policy, TEST_SEEDS[:specimens]):
            ends = (
                f"{np.median(own):.2f}, {np.percentile(own, 90.0):.2f}, {100.0 * np.mean(own > FAR):.0f} %"
                for own in errors.T[:2]
            )
            on_the_way = (f"{np.median(own):.2f}" for own in errors.T[2:])
            lines.append(f"| {name} | {part} | {' | '.join((*ends, *on_the_way))} |")
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--specimens", type=int, default=200, metavar="N", help="held-out specimens; default 200")
    arguments = parser.parse_args()
    print(report(arguments.specimens), flush=True)
