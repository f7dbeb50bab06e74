"""Verdicts of the comparison of a rig with the simulator under a known gain of the force, where specimens are a lab's.

    python -m scripts.validation.rig.twin_trials  ten runs of twenty specimens for each row; some minutes
    python -m scripts.validation.rig.twin_trials --runs 2 --json runs/twins.json

The rig is imitated by the simulator, with other noise of the sensor; its force is multiplied by a gain, all along or in
the second half of the cut. The policy is a constant feed, which no force changes.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections import Counter
from pathlib import Path
from typing import Any

from cutenv.agents.policy import BASELINES
from cutenv.agents.sim_to_real import Agreement, ComparedCut
from cutenv.agents.sim_to_real.paired_experiment import cut_once, cut_twins, simulate_cuts
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.sim.tissue.specimen import Specimen
from scripts.tables import keep_json, markdown_table

POLICY = "constant 1.27 cm/s 90 deg"
SPECIMENS, DRAWS, RUNS = 20, 4, 10
GAINS = (1.0, 1.05, 1.2, 1.3, 1.5)  # gains of the force in the second half of a cut [1]
ALL_ALONG = 1.05  # gain of the force over the whole cut, which the twins take up [1]
UNKNOWN = "a lab's, by their twins"
_OWN_NOISE = 77  # draw of the sensor's noise on the rig


def with_gain(cut: ComparedCut, gain: float) -> ComparedCut:
    """Return a cut whose force is multiplied by ``gain``."""
    return dataclasses.replace(cut, trace=dataclasses.replace(cut.trace, force=gain * cut.trace.force))


def environment() -> GentleCutEnv:
    """Return the simulator, with rewards from what a rig sees and a blade set by hand."""
    return GentleCutEnv(
        reward_from="estimate", angle_mode="fixed", fixed_angle_deg=90.0, specimen_class="liver", target_length=0.08
    )


def trials(runs: int) -> list[dict[str, Any]]:
    """Return for each row the answers of all runs, counted."""
    env, policy = environment(), BASELINES[POLICY]()
    known = Specimen.mean()
    answers: dict[tuple[str, str, float], list[str]] = {}
    for run in range(runs):
        seed = 500 + run
        laid = [cut_once(env, policy, seed=seed, episode=k, noise=_OWN_NOISE) for k in range(SPECIMENS)]
        parts, twins, _ = cut_twins(env, policy, laid, seed=seed, draws=DRAWS)
        for gain in GAINS:  # no force before is another, so the twins are the same
            rig = [with_gain(cut, gain) for cut in parts]
            answers.setdefault((UNKNOWN, "in the second half", gain), []).append(
                Agreement(rig, twins, twins=True).verdict.answer
            )
        rig = [with_gain(cut, ALL_ALONG) for cut in laid]
        parts, twins, _ = cut_twins(env, policy, rig, seed=seed, draws=DRAWS)
        answers.setdefault((UNKNOWN, "all along", ALL_ALONG), []).append(
            Agreement(parts, twins, twins=True).verdict.answer
        )
        simulated = simulate_cuts(env, policy, seed=seed, specimens=SPECIMENS, draws=DRAWS, specimen=known)
        blocks = [
            cut_once(env, policy, seed=seed, episode=k, noise=_OWN_NOISE, specimen=known) for k in range(SPECIMENS)
        ]
        for gain in (1.0, 1.02, 1.05):
            rig = [with_gain(cut, gain) for cut in blocks]
            answers.setdefault(("known blocks", "all along", gain), []).append(Agreement(rig, simulated).verdict.answer)
    return [
        {"specimens": specimens, "force times": gain, "where": where if gain != 1.0 else "", **_counted(found)}
        for (specimens, where, gain), found in answers.items()
    ]


def _counted(answers: list[str]) -> dict[str, int]:
    counts = Counter(answers)
    return {answer: counts[answer] for answer in ("agree", "undecided", "differ")}


def table(kept: dict[str, Any]) -> str:
    """Return the rows as a table of Markdown."""
    header = ["specimens", "force times", "where", "agree", "undecided", "differ"]
    return markdown_table(header, [[str(row[name]) for name in header] for row in kept["rows"]])


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=RUNS, metavar="N", help=f"runs of each row; default {RUNS}")
    parser.add_argument("--json", type=Path, metavar="FILE", help="file for the counts")
    arguments = parser.parse_args()
    found = {"rows": trials(arguments.runs)}
    if arguments.json is not None:
        keep_json(arguments.json, found)
    print(table(found))
