"""Ladder of knowledge along a drawn line: its rungs are the script, told the truth and nothing else."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cutenv.agents.learning.seeds import VALIDATION_SEEDS
from cutenv.agents.policy.path_policies import SteerByForce
from scripts.benchmarks.policies.knowledge_ladder import LADDERS, START, KnowledgeLadder, PathRung

SEEDS = VALIDATION_SEEDS[:6]
LADDER = LADDERS["path"]


class Watching(PathRung):
    """A rung that compares what it steers by with the truth."""

    def __init__(self) -> None:
        super().__init__(aside=True, crack=True)
        self.largest_aside = self.largest_angle = 0.0

    def reckon(self, seen):
        aside, crack = super().reckon(seen)
        states, steerings = self._batch.cuts.states, self._batch.cuts.motions
        for n in range(len(states)):
            point = round(states["tip"][n] / 0.0005)
            line = math.atan2(steerings["sine"][n, point], steerings["cosine"][n, point])
            angle = math.atan2(steerings["tip_across"][n], steerings["tip_ahead"][n]) - line
            assert crack[n] == pytest.approx(angle, abs=0.05)  # half a point of a bend
            assert aside[n] == steerings["tip_aside"][n]
        self.largest_aside = max(self.largest_aside, np.abs(aside).max())
        self.largest_angle = max(self.largest_angle, np.abs(crack).max())
        return aside, crack


def rows(make) -> list[dict]:
    ladder = KnowledgeLadder(task="path", rungs={START: make}, errors=LADDER.errors)
    return ladder.rows_of_rung(START, SEEDS)


def test_a_rung_that_is_told_nothing_cuts_as_the_script_does():
    assert rows(PathRung) == rows(SteerByForce)


def test_a_rung_steers_by_the_truth_that_it_is_told():
    rung = Watching()
    rows(lambda: rung)
    assert rung.largest_aside > 0.0005
    assert rung.largest_angle > 0.05


def test_the_planners_rule_keeps_the_cut_nearer_to_the_line_than_the_script_does_only_with_the_true_distance():
    def mean(name: str) -> float:
        return float(np.mean([row["mean_distance_mm"] for row in LADDER.rows_of_rung(name, SEEDS)]))

    told = mean("the planner's rule of steering, with truth")
    assert told < mean(START)
    assert told < mean("the planner's rule of steering, distance to the line estimated")
