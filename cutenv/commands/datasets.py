"""Record cuts with forces in newtons as a Minari or LeRobot data set.

The cuts are made by a script, an agent or a person. A policy is named as for 'cutenv evaluate'; records are those of
'cutenv play' or of a rig.  The data set is written where Minari keeps them, MINARI_DATASETS_PATH or ~/.minari/datasets,
or LeRobot, HF_LEROBOT_HOME; nothing is downloaded or sent.  'cutenv train --learner bc --dataset ID' clones the cuts of
one in Minari's format.
"""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from cutenv.agents.learning.option_fields import add_options, drawn_as, from_options, option
from cutenv.agents.learning.seeds import TRAINING_SEEDS
from cutenv.commands.options import command_parser, made_folder, reports_errors
from cutenv.records.schema import parse_length
from cutenv.sim.tissue.specimen import CLASSES

if TYPE_CHECKING:
    from cutenv.agents.learning.demonstration import Demonstration

_ID = re.compile(r"([-\w]+/)*[-\w]+-v\d+")


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Options of the command."""

    dataset: str = option("", "id of the new data set, such as cutenv/probe-and-creep-v0", metavar="ID")
    format: str = option("minari", "format: Minari's, or LeRobot's v3.0", ("minari", "lerobot"))
    policy: str = option(
        "", "baseline, shipped policy, or folder of a trained one, which makes the cuts", metavar="POLICY"
    )
    records: tuple[str, ...] = option((), "records of cuts instead: CSV, Parquet or HDF5")
    cuts: int = option(100, "number of cuts that the policy makes, each of another specimen")
    seed: int = option(TRAINING_SEEDS.stop // 2, "seed of the first specimen, below a million: no test specimen")
    specimen_class: str = option("mixed", "class of the specimens that the policy cuts", CLASSES)
    tissue: str = option("", "a tissue of your own, from 'cutenv calibrate', of which they are drawn", metavar="FILE")
    angle_mode: str = option("free", "turn the blade (free), or keep its angle (fixed)", ("free", "fixed"))
    control_hz: int = option(10, "decisions per second; a trained policy has its own")
    target_length: str = option(
        "", "length of the cut with its unit, such as 80mm, for records that have none of their own", metavar="LENGTH"
    )

    def __post_init__(self) -> None:
        if self.format == "minari" and not _ID.fullmatch(self.dataset):
            raise ValueError(f"--dataset {self.dataset!r} must be an id with a version, such as cutenv/mine-v0.")
        if bool(self.policy) == bool(self.records):
            raise ValueError("give either --policy, which cuts in the simulator, or --records of cuts that were made.")
        if not (0 < self.cuts and 0 <= self.seed and self.seed + self.cuts <= TRAINING_SEEDS.stop):
            raise ValueError(
                f"--seed {self.seed} and --cuts {self.cuts}: give one cut or more with seeds from 0 to "
                f"{TRAINING_SEEDS.stop}; from there on specimens are kept for validation and test."
            )
        if not (0 < self.control_hz <= 1000 and 1000 % self.control_hz == 0):
            raise ValueError(f"--control-hz {self.control_hz} does not divide 1000; take 10, 20 or 50.")

    @property
    def environment(self) -> dict[str, Any]:
        """Keyword arguments of the environment."""
        return {**drawn_as(vars(self)), "angle_mode": self.angle_mode, "control_hz": self.control_hz}


@reports_errors("datasets")
def main(argv: Sequence[str]) -> int:
    """Write a data set; return 0, or 2 on bad input."""
    arguments = from_options(Arguments, _parser().parse_args(argv))
    from cutenv.agents.learning.lerobot import lerobot_folder, write_lerobot
    from cutenv.agents.learning.minari_datasets import free_folder, write

    lerobot = arguments.format == "lerobot"
    folder = lerobot_folder(arguments.dataset) if lerobot else free_folder(arguments.dataset)
    made_folder("DATASET", folder.parent)
    keywords, cuts = cuts_of(arguments)
    source = arguments.policy or "recorded cuts"
    if lerobot:
        write_lerobot(folder, source, keywords, cuts)
    else:
        write(arguments.dataset, source, keywords, cuts)
    returns, ended = [cut.rewards.sum() for cut in cuts], [cut.infos["is_success"][-1] for cut in cuts]
    print(f"{len(cuts)} cuts, {sum(len(cut.rewards) for cut in cuts)} decisions in {folder}")
    print(f"mean return {np.mean(returns):.3f}, success {np.mean(ended):.2f}")
    return 0


def cuts_of(arguments: Arguments) -> tuple[dict[str, Any], list[Demonstration]]:
    """Return the environment's keyword arguments, and the cuts.

    Raise ValueError if there is no such policy, or a record lacks what is needed.
    """
    from cutenv.agents.learning.minari_datasets import recorded_cuts, simulated_cuts

    if arguments.policy:
        seeds = range(arguments.seed, arguments.seed + arguments.cuts)
        return simulated_cuts(arguments.policy, arguments.environment, seeds)
    given = arguments.target_length
    target = parse_length("--target-length", given) if given else None
    return recorded_cuts(arguments.records, arguments.environment, target)


def _parser() -> argparse.ArgumentParser:
    parser = command_parser(
        "datasets",
        __doc__,
        examples=(
            '--dataset cutenv/probe-v0 --policy "probe and creep" --cuts 100',
            "--dataset cutenv/agent-v0 --policy ppo-free",
            "--dataset cutenv/people-v0 --records cuts/*.csv",
            '--format lerobot --dataset cutenv/probe --policy "probe and creep"',
        ),
    )
    add_options(parser, Arguments)
    return parser
