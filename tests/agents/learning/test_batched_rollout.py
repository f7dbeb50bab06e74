"""Cuts of a policy side by side are those that it makes one after the other, readings and all."""

from __future__ import annotations

import numpy as np
import pytest
from whole_cut import go_on, make

from cutenv.agents.learning import evaluation
from cutenv.agents.learning.evaluation import (
    METRIC_PREFIX,
    Contestant,
    batched_rollout,
    evaluate,
    metric_column,
    workers,
)
from cutenv.agents.learning.seeds import ENVIRONMENT, TEST_SEEDS
from cutenv.agents.policy import (
    BASELINES,
    ORACLE,
    ConstantFeed,
    Features,
    Network,
    NoAction,
    PlannerWithTruth,
    TrainedPolicy,
    save_policy,
)
from cutenv.records.scoring import METRICS

pytest.importorskip("safetensors", reason="policies are kept with an extra: pip install 'cutenv[rl]'")

FEATURES = {"history": 2}
SIZE = Features(**FEATURES).size


@pytest.fixture(scope="module")
def policy(tmp_path_factory: pytest.TempPathFactory) -> TrainedPolicy:
    """An untrained one that goes on, so that its cuts end."""
    rng = np.random.default_rng(0)
    weights = [rng.normal(scale=0.05, size=shape).astype(np.float32) for shape in ((8, SIZE), (2, 8))]
    biases = [np.zeros(8, np.float32), np.array([0.8, 0.2], np.float32)]
    folder = tmp_path_factory.mktemp("policy")
    save_policy(
        folder,
        Network(tuple(zip(weights, biases, strict=True))),
        environment=ENVIRONMENT,
        environment_arguments={"control_hz": 10},
        features=FEATURES,
        training={},
    )
    return TrainedPolicy.load(folder)


@pytest.mark.parametrize("keywords", [{}, {"angle_mode": "fixed", "fixed_angle_deg": 60.0}], ids=["free", "fixed"])
@pytest.mark.parametrize("name", ["trained", "probe and creep", "planner with truth", "random", "of a user"])
def test_they_are_bit_for_bit_those_one_after_the_other(policy, name, keywords):
    arguments = {"specimen_class": "mixed", "deadline_s": 12.0, "control_hz": 10, **keywords}
    one = {"trained": policy, "of a user": Slowing(), ORACLE: PlannerWithTruth(rounds=1)}.get(name) or BASELINES[name]()
    together = batched_rollout(one, TEST_SEEDS[:4], arguments, readings=True)
    env = make(**arguments)
    for seed, found in zip(TEST_SEEDS[:4], together, strict=True):
        observation, _ = env.reset(seed=seed)
        one.reset(np.random.default_rng(seed))
        if name == ORACLE:
            one.set_state(env.unwrapped.cutting)
        alone = go_on(env, one, observation)
        assert (found.end, found.success) == (alone.end, alone.infos[-1]["is_success"])
        assert found.truth == alone.infos[-1]["truth"]
        assert found.reward_totals == env.unwrapped.cutting.reward_totals
        assert np.array_equal(found.readings, alone.readings)
        assert found.time_s == alone.readings["time"][-1]
        assert found.cost_totals == {
            name: sum(info["cost_terms"][name] for info in alone.infos) for name in ("overshoot_mm", "long_runs_mm")
        }
        assert np.array_equal(found.depth, env.unwrapped.specimen.depth)
        assert np.array_equal(found.measured_depth, env.unwrapped.plant.depth)
        assert np.array_equal(found.resistance, env.unwrapped.specimen.fracture_resistance)
    if name not in ("random", "of a user"):
        assert {cut.end for cut in together} - {"deadline"}, "cuts that all end at the deadline prove less"


class Slowing:
    """A policy as its user writes one: for a single cut, slower from decision to decision."""

    def reset(self, rng):
        self.speed = rng.uniform(0.5, 1.0)

    def __call__(self, observation):
        self.speed *= 0.99
        return np.float32([self.speed, 1.0])


def test_the_scores_are_those_of_all_readings_and_any_chunks_give_the_same_rows(policy, monkeypatch):
    contestants = {
        "trained": Contestant(policy, policy.environment_arguments),
        "feed": Contestant(ConstantFeed(speed=0.02)),
    }
    shared = {"specimen_class": "mixed", "deadline_s": 5.0}
    rows = evaluate(contestants, TEST_SEEDS[:12], shared)
    assert [row["policy"] for row in rows] == ["trained"] * 12 + ["feed"] * 12
    assert [row["seed"] for row in rows[:12]] == list(TEST_SEEDS[:12])
    monkeypatch.setattr(evaluation, "_BATCH", 5)
    assert evaluate(contestants, TEST_SEEDS[:12], shared) == rows
    with workers(1) as pool:
        measured = evaluate(contestants, TEST_SEEDS[:12], shared, metrics=True, pool=pool)
    assert [{name: row[name] for name in rows[0]} for row in measured] == rows
    cuts = batched_rollout(policy, TEST_SEEDS[:12], shared | policy.environment_arguments, readings=True)
    assert measured[:12] == [{"policy": "trained", **cut.scores(), **cut.metrics()} for cut in cuts]


def test_every_metric_of_the_score_card_has_a_column_with_its_unit():
    (cut,) = batched_rollout(BASELINES["probe and creep"](), TEST_SEEDS[:1], {}, readings=True)
    metrics = cut.metrics()
    assert list(metrics) == [metric_column(name) for name in METRICS]
    assert metric_column("peak_force") == f"{METRIC_PREFIX}peak_force_N"
    assert metric_column("force_rate").endswith("_per_s")
    assert all(isinstance(value, float) for value in metrics.values())


def test_the_metrics_agree_with_what_the_simulator_says():
    (cut,) = batched_rollout(BASELINES["constant 1.27 cm/s 60 deg"](), [TEST_SEEDS[1]], {}, readings=True)
    scores, metrics = cut.scores(), cut.metrics()
    assert 1e3 * metrics[metric_column("tip_error")] == pytest.approx(scores["tip_error_mm"], abs=0.02)
    assert metrics[metric_column("uncontrolled_share")] == pytest.approx(scores["uncontrolled_share"], abs=0.02)


def test_a_metric_that_cannot_be_had_is_an_empty_cell():
    (cut,) = batched_rollout(NoAction(), TEST_SEEDS[:1], {"deadline_s": 2.0}, readings=True)
    assert "" in cut.metrics().values()
