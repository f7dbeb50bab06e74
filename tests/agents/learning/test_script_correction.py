"""A network that adds to a script's actions: in training, as an exported policy, and what its card refuses."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from program import run

from cutenv.agents.policy import Network, TrainedPolicy, save_policy
from cutenv.agents.policy.path_policies import SteerByForce

stable_baselines3 = pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")

from cutenv.agents.learning.arguments import BadArguments, PPOArguments, RecurrentPPOArguments  # noqa: E402
from cutenv.agents.learning.evaluation import Contestant, evaluate  # noqa: E402
from cutenv.agents.policy.third_axis_planners import PathPlanner  # noqa: E402
from cutenv.agents.sb3 import FeatureVecEnv  # noqa: E402
from cutenv.envs.path_cut import PathCutEnv  # noqa: E402
from cutenv.task.registry import TASKS  # noqa: E402

SCRIPT, HOLD, SEEDS = "steer by force", 3, (5, 6, 8)
TASK = {"task": "path", "specimen_class": "mixed", "control_hz": 25}
SMALL = (
    "--task", "path", "--name", "small", "--environments", "4", "--rollout", "32", "--batch-size", "64",
    "--timesteps", "256", "--validations", "1", "--validation-specimens", "2", "--specimens", "2",
)  # fmt: skip


def environments() -> FeatureVecEnv:
    return FeatureVecEnv(SEEDS, script=SCRIPT, hold=HOLD, **TASK)


def saved(folder: Path, size: float) -> TrainedPolicy:
    """A policy whose network adds some ``size`` to the script's actions."""
    rng, inputs = np.random.default_rng(0), environments().features
    layers = [(0.3, (16, inputs)), (size, (3, 16))]
    drawn = tuple(
        (rng.normal(0.0, scale, shape).astype(np.float32), np.zeros(shape[0], np.float32)) for scale, shape in layers
    )
    save_policy(
        folder, Network(drawn), environment="cutenv/PathCut-v1", environment_arguments={"control_hz": 25},
        features={"history": 0}, training={}, script=SCRIPT, hold=HOLD,
    )  # fmt: skip
    return TrainedPolicy.load(folder)


def returns_of(policy: Any) -> list[float]:
    return [row["return"] for row in evaluate({"it": Contestant(policy)}, SEEDS, TASK)]


def test_the_environments_of_training_cut_as_the_exported_policy_does_alone_and_with_others(tmp_path: Path) -> None:
    policy, several = saved(tmp_path / "policy", 0.05), environments()
    shown, earned, found = several.reset(), np.zeros(len(SEEDS)), dict[int, float]()
    while len(found) < len(SEEDS):
        several.step_async(np.clip(policy.network(shown), -1.0, 1.0))
        shown, rewards, ended, infos = several.step_wait()
        earned += rewards
        for n in np.flatnonzero(ended).tolist():
            assert earned[n] == pytest.approx(infos[n]["episode"]["r"], abs=1e-5)
            found.setdefault(n, infos[n]["episode"]["r"])
            earned[n] = 0.0
    assert list(dict(sorted(found.items())).values()) == pytest.approx(returns_of(policy), abs=1e-12)
    single, total = PathCutEnv(specimen_class="mixed", control_hz=25), 0.0
    observation, over = single.reset(seed=SEEDS[0])[0], False
    policy.reset(np.random.default_rng(0))
    while not over:
        observation, reward, over, late, _ = single.step(policy(observation))
        total, over = total + reward, over or late
    assert total == pytest.approx(found[0], abs=1e-12)
    assert returns_of(policy) != returns_of(SteerByForce())


def test_a_network_that_adds_nothing_is_the_script(tmp_path: Path) -> None:
    assert returns_of(saved(tmp_path / "policy", 0.0)) == returns_of(SteerByForce())


def test_what_is_added_is_held_for_some_decisions_of_each_cut(tmp_path: Path) -> None:
    policy, script = saved(tmp_path / "policy", 0.05), SteerByForce()
    rngs = [np.random.default_rng(0)] * 2
    policy.begin(rngs)
    script.begin(rngs)
    observations = np.random.default_rng(3).uniform(0.0, 0.2, (7, 2, 28)).astype(np.float32)
    added = []
    for number, seen in enumerate(observations):
        if number == 4:
            policy.forget(np.array([1]))
            script.forget(np.array([1]))
        added.append(policy.act(seen) - script.act(seen))
    changes = np.abs(np.diff(added, axis=0)).max(axis=2) > 1e-6
    assert np.flatnonzero(changes[:, 0]).tolist() == [2, 5]  # after three decisions, and three more
    assert np.flatnonzero(changes[:, 1]).tolist() == [2, 3]  # the second cut began again with the fifth


def test_a_card_says_what_does_not_go_together(tmp_path: Path) -> None:
    card = saved(tmp_path / "policy", 0.0).card
    assert (card.script, card.hold) == (SCRIPT, HOLD)
    for change, words in (
        ({"script": None}, "what a network without a script does is not held"),
        ({"memory": "lstm"}, "a network with a memory corrects no script"),
        ({"hold": 0}, "hold must be a whole number of decisions, 1 or more"),
        ({"script": "return stroke"}, "script"),
    ):
        with pytest.raises(ValueError, match=words):
            dataclasses.replace(card, **change)
    plain = json.loads(dataclasses.replace(card, script=None, hold=1).to_json())
    assert "script" not in plain  # the text of a card without one stays as it was
    with pytest.raises(ValueError, match="it must begin with 61 and end with 3"):
        TrainedPolicy(dataclasses.replace(card, layers=(58, 16, 3)), Network(_without_script()))


def _without_script() -> tuple[Any, ...]:
    shapes = ((16, 58), (3, 16))
    return tuple((np.zeros(shape, np.float32), np.zeros(shape[0], np.float32)) for shape in shapes)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"hold": 3}, "hold = 3 has no effect without a script"),
        ({"script": SCRIPT, "hold": 0}, "hold = 0"),
        ({"script": SCRIPT, "hold": 1.5}, "hold = 1.5 is not a whole number"),
        ({"script": "return stroke"}, "script"),
    ],
)
def test_environments_refuse_a_hold_or_a_script_that_cannot_be(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        FeatureVecEnv(SEEDS, **wrong, **TASK)


def test_options_that_contradict_a_corrected_script_are_refused() -> None:
    known = PPOArguments(**PPOArguments.completed({"task": "path"}))
    assert known.correction == {"script": SCRIPT, "hold": known.hold}
    assert known.demonstrations == 0
    alone = PPOArguments(**PPOArguments.completed({"task": "path", "base": "none"}))
    assert alone.correction == {}
    for wrong, words in (
        ({"base": "script", "demonstrations": 5}, "--demonstrations 5 has no use with --base script"),
        ({"base": "script", "demonstrations": 0, "force": "unfelt"}, "feels the force"),
        ({"hold": 2}, "--hold 2 has no effect without --base script"),
    ):
        with pytest.raises(BadArguments, match=words):
            PPOArguments(**wrong)
    with pytest.raises(BadArguments, match="--base script is for --learner ppo"):
        RecurrentPPOArguments(base="script", demonstrations=0)


def test_a_run_begins_as_the_script_and_its_policy_is_evaluated(tmp_path, monkeypatch):
    hasty = dataclasses.replace(TASKS["path"], planner=lambda: PathPlanner(rounds=1))  # the search takes longest
    monkeypatch.setitem(TASKS, "path", hasty)
    done = run("train", tmp_path, *SMALL)
    assert done.returncode == 0, done.stderr
    folder = tmp_path / "runs" / "small"
    policy = TrainedPolicy.load(folder / "policy")
    assert policy.card.script == SCRIPT
    assert policy.card.environment_arguments["control_hz"] == 10
    model = stable_baselines3.PPO.load(folder / "policy.zip", device="cpu")
    shown = FeatureVecEnv(SEEDS, script=SCRIPT, hidden_state=True, **TASK).reset()
    expected, _ = model.predict(shown, deterministic=True)
    assert policy.network(shown[:, : policy.network.sizes[0]]) == pytest.approx(expected, abs=1e-5)
    assert np.abs(expected).max() < 0.2
    assert "PPO" in done.stdout
    assert "demonstrating" not in done.stderr
