"""Cuts of a trained policy side by side are those that it makes one after the other, readings and all."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

from cutenv.learning.batched_rollout import batched_rollout, replayed
from cutenv.learning.evaluation import Contestant, evaluate, finished_cut
from cutenv.learning.finished_cut import METRIC_PREFIX, metric_column
from cutenv.learning.seeds import ENVIRONMENT, TEST_SEEDS
from cutenv.policy import BASELINES, ConstantFeed, Features, Network, NoAction, TrainedPolicy, save_policy
from cutenv.scoring import METRICS

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
        dead_zone=0.25,
        training={},
    )
    return TrainedPolicy.load(folder)


@pytest.mark.parametrize("keywords", [{}, {"angle_mode": "fixed", "fixed_angle_deg": 60.0}], ids=["free", "fixed"])
def test_they_are_bit_for_bit_those_one_after_the_other(policy, keywords):
    arguments = {"specimen_class": "mixed", "deadline_s": 12.0, **policy.environment_arguments, **keywords}
    together = batched_rollout(policy, TEST_SEEDS[:5], arguments)
    env = gymnasium.make(ENVIRONMENT, **arguments)
    for seed, cut in zip(TEST_SEEDS[:5], together, strict=True):
        alone = finished_cut(env, policy, seed)
        assert cut.scores() == alone.scores()
        assert np.array_equal(cut.readings, alone.readings)
        assert cut.metrics() == alone.metrics()
    assert len({cut.end for cut in together} - {"deadline"}) > 0, "cuts that all end at the deadline prove less"


def test_a_command_changed_on_the_way_would_be_noticed(policy, monkeypatch):
    from cutenv.learning import batched_rollout as module

    def other(start, n, commands, ticks, updates):
        return replayed(start, n, commands * 0.9, ticks, updates)

    monkeypatch.setattr(module, "replayed", other)
    with pytest.raises(AssertionError, match="a repeated cut gives the same tip"):
        batched_rollout(policy, TEST_SEEDS[:2], {"deadline_s": 12.0, "control_hz": 10})


def test_one_and_two_processes_and_any_chunks_give_the_same_rows(policy):
    contestants = {
        "trained": Contestant(policy, policy.environment_arguments),
        "feed": Contestant(ConstantFeed(speed=0.02)),
    }
    shared = {"specimen_class": "mixed", "deadline_s": 5.0}
    one = evaluate(contestants, TEST_SEEDS[:12], shared, processes=1, metrics=True)
    assert evaluate(contestants, TEST_SEEDS[:12], shared, processes=2, metrics=True) == one
    assert [row["policy"] for row in one] == ["trained"] * 12 + ["feed"] * 12
    assert [row["seed"] for row in one[:12]] == list(TEST_SEEDS[:12])


def test_every_metric_of_the_score_card_has_a_column_with_its_unit():
    env = gymnasium.make(ENVIRONMENT)
    metrics = finished_cut(env, BASELINES["probe and creep"](), TEST_SEEDS[0]).metrics()
    assert list(metrics) == [metric_column(name) for name in METRICS]
    assert metric_column("peak_force") == f"{METRIC_PREFIX}peak_force_N"
    assert metric_column("force_rate").endswith("_per_s")
    assert all(isinstance(value, float) for value in metrics.values())


def test_the_metrics_agree_with_what_the_simulator_says():
    env = gymnasium.make(ENVIRONMENT)
    cut = finished_cut(env, BASELINES["constant 1.27 cm/s 60 deg"](), TEST_SEEDS[1])
    scores, metrics = cut.scores(), cut.metrics()
    assert 1e3 * metrics[metric_column("tip_error")] == pytest.approx(scores["tip_error_mm"], abs=0.02)
    assert metrics[metric_column("uncontrolled_share")] == pytest.approx(scores["uncontrolled_share"], abs=0.02)


def test_a_metric_that_cannot_be_had_is_an_empty_cell():
    cut = finished_cut(gymnasium.make(ENVIRONMENT, deadline_s=2.0), NoAction(), TEST_SEEDS[0])
    assert "" in cut.metrics().values()
