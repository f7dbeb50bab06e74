"""Make the reference set that comes with the package: scores of scripts (and agents) on sampled livers.

    python -m scripts.derivations.reference_set                             prints medians by script
    python -m scripts.derivations.reference_set --write                     also writes assets/reference/baselines.csv
    python -m scripts.derivations.reference_set --policy runs/NAME/policy   includes trained policies, too

Every cut is scored from what a rig can measure, with an estimated tip, as a person's cut would be.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from tqdm import tqdm

from cutenv.agents.learning.evaluation import batched_rollout, contestant
from cutenv.agents.policy import BASELINES, SCRIPTS
from cutenv.records.scoring import METRICS, ReferenceSet, score
from cutenv.sim.plant.protocol import recorded_trace
from scripts import ROOT

TARGET = ROOT / "assets" / "reference" / "baselines.csv"
FEEDS = [f"constant {speed} cm/s {angle} deg" for speed in ("0.38", "0.89", "1.65", "2.54") for angle in (45, 90)]
FIRST_SEED = 7_000_000  # far from those of training, validation and test


def reference(names: list[str], cuts: int) -> ReferenceSet:
    """Score ``cuts`` cuts of every policy."""
    rows = []
    for name in tqdm(names, desc="cutting", unit="policy"):
        chosen = contestant(name)
        label = name if name in BASELINES else f"PPO ({Path(name).parent.name})"
        for cut in batched_rollout(
            chosen.policy, range(FIRST_SEED, FIRST_SEED + cuts), {"specimen_class": "mixed", **chosen.arguments},
            readings=True,
        ):  # fmt: skip
            trace = recorded_trace(cut.readings, cut.measured_depth, end=cut.end)
            card = score(trace, target_length=cut.scores()["target_length_mm"] / 1e3)
            rows.append((label, {metric: scored.value for metric, scored in card.metrics.items()}))
    about = f"{len(names)} scripts and agents, {cuts} mixed specimens each, tip estimated"
    return ReferenceSet.of(rows, name="baselines", about=about, force_unit="N")


def medians(found: ReferenceSet) -> str:
    """Return the median of every metric as text, a column per policy."""
    names = list(dict.fromkeys(found.groups))
    lines = [" " * 24 + "  ".join(f"{name[-12:]:>12s}" for name in names)]
    groups = np.array(found.groups)
    for metric in METRICS:
        if metric in found.values:
            cells = [f"{np.nanmedian(found.values[metric][groups == name]):12.4g}" for name in names]
            lines.append(f"{metric:24s}" + "  ".join(cells))
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cuts", type=int, default=60, help="of every policy")
    parser.add_argument("--policy", action="append", default=[], help="a trained policy; may be repeated")
    parser.add_argument("--write", action="store_true", help=f"write {TARGET.relative_to(ROOT)}")
    arguments = parser.parse_args()
    names = [name for name in (*FEEDS, *SCRIPTS) if name in BASELINES]
    found = reference([*names, *arguments.policy], arguments.cuts)
    print(medians(found))
    if arguments.write:
        found.save(TARGET)
        print(f"{len(found)} cuts: {TARGET.relative_to(ROOT)}")
