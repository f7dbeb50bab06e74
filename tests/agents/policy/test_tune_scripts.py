"""Tuning of scripts: its scores are those of an evaluation, and its numbers stay within their ranges."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.agents.learning.evaluation import Contestant, evaluate
from cutenv.agents.learning.seeds import VALIDATION_SEEDS
from cutenv.agents.policy.path_policies import EXCISION_NUMBERS, PATH_SCRIPTS, SteerByForce, with_numbers
from scripts.benchmarks.policies import tune_scripts

SEEDS = VALIDATION_SEEDS[:4]
FORCE = tune_scripts.FAMILIES["steer by force"]


def test_a_place_in_the_ranges_scores_as_the_script_with_its_numbers_does():
    tuning = tune_scripts.Tuning("excision", FORCE, seed=0)
    tuned = np.array([EXCISION_NUMBERS[name] for name in FORCE.all_numbers])
    places = [tuning.start, (tuned - tuning.low) / (tuning.high - tuning.low)]
    returns, successes = tuning.scores(places, SEEDS)
    for k, place in enumerate(places):
        script = with_numbers(SteerByForce, tuning.named(place))
        keywords = {"task": "excision", "specimen_class": "mixed", "control_hz": 10}
        rows = evaluate({"it": Contestant(script)}, SEEDS, keywords, processes=1)
        assert returns[k] == pytest.approx([row["return"] for row in rows], abs=1e-12)
        assert successes[k].tolist() == [bool(row["success"]) for row in rows]
    assert not np.array_equal(returns[0], returns[1])


def test_a_search_moves_every_number_within_its_range(monkeypatch):
    monkeypatch.setattr(tune_scripts, "SPECIMENS", 3)
    monkeypatch.setattr(tune_scripts, "JUDGED", 3)
    found = tune_scripts.Tuning("excision", FORCE, seed=0).run(2, print)
    for name, number in FORCE.all_numbers.items():
        assert number.low <= found["numbers"][name] <= number.high
    table = tune_scripts.report({"steer by force": found})
    assert f"| {found['start']['return']:.3f} | {found['tuned']['return']:.3f} |" in table


def test_every_family_is_a_script_of_the_task():
    kinds = {type(make()) for make in PATH_SCRIPTS.values()}
    assert {family.kind for family in tune_scripts.FAMILIES.values()} < kinds
