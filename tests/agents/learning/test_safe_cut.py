"""SafeCut-v1: a budget as measured, and PPO with a Lagrange multiplier that pays for what costs too much."""

from __future__ import annotations

import re

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")

from ppo_lagrangian import LagrangianArguments, PenalisedVecEnv, train

from cutenv.agents.learning.arguments import BadArguments
from cutenv.agents.learning.statistics import by_policy, mean_with_interval
from cutenv.agents.policy import TrainedPolicy
from cutenv.agents.sb3 import FeatureVecEnv
from cutenv.envs.tracks import COST_BUDGET_MM, PROTOCOL
from scripts.benchmarks.policies import safe_cut

SMALL = {
    "environments": 8,
    "rollout": 64,
    "batch_size": 256,
    "timesteps": 2048,
    "demonstrations": 2000,
    "validations": 1,
    "validation_specimens": 2,
    "specimens": 0,
}


@pytest.fixture(scope="module")
def rows():
    return safe_cut.measure([safe_cut.BUDGET_OF, "return stroke"], 300)


def test_the_budget_is_two_thirds_of_what_probe_and_creep_costs(rows):
    found = mean_with_interval(2.0 / 3.0 * row["cost_mm"] for row in rows if row["policy"] == safe_cut.BUDGET_OF)
    assert found["low_95"] < COST_BUDGET_MM < found["high_95"]


def test_the_table_shows_paired_differences_from_the_first(rows):
    *_, first, second = safe_cut.report(rows).splitlines()
    assert first.startswith(f"| {safe_cut.BUDGET_OF} |")
    assert first.endswith("| – | – |")
    costs = {name: np.mean([row["cost_mm"] for row in own]) for name, own in by_policy(rows).items()}
    less = costs["return stroke"] - costs[safe_cut.BUDGET_OF]
    assert f"| {less:+.2f} [" in second
    assert f"| {costs[safe_cut.BUDGET_OF] - COST_BUDGET_MM:+.2f} [" in first


def test_rigs_that_the_track_does_not_have_are_refused():
    with pytest.raises(BadArguments, match="--rigs 2 has no effect here"):
        LagrangianArguments(rigs=2)


def test_a_penalised_reward_is_the_reward_less_the_price_of_the_cost():
    plain, penalised = FeatureVecEnv(16, **PROTOCOL), PenalisedVecEnv(16, **PROTOCOL)
    penalised.multiplier = 0.5
    plain.reset()
    penalised.reset()
    paid, returned = 0.0, 0.0
    for _ in range(80):
        action = np.tile(np.float32([0.8, -1.0]), (16, 1))
        _, rewards, ends, infos = plain.step(action)
        _, found, _, others = penalised.step(action)
        costs = np.array([info["cost"] for info in infos], np.float32)
        assert np.array_equal(found, (rewards - np.float32(0.5) * costs) / np.float32(1.5))
        assert [other.get("episode", {}).get("r") for other in others] == [
            info.get("episode", {}).get("r") for info in infos
        ]
        paid += costs.sum()
        returned += sum(infos[n]["episode"]["cost"] for n in np.flatnonzero(ends))
    assert paid > returned > 0.0


@pytest.mark.parametrize(("budget", "pays"), [(0.0, True), (100.0, False)])
def test_the_multiplier_rises_while_the_cost_is_above_the_budget_and_is_never_negative(budget, pays, tmp_path, capsys):
    train(LagrangianArguments(budget=budget, multiplier=0.01, multiplier_rate=0.02, **SMALL), tmp_path / "run")
    multiplier = float(re.search(r"multiplier at the end: (\S+)", capsys.readouterr().out)[1])
    assert multiplier > 0.01 if pays else multiplier == 0.0
    policy = TrainedPolicy.load(tmp_path / "run" / "policy")
    assert policy.environment_arguments["control_hz"] == PROTOCOL["control_hz"]
