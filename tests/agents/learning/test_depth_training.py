"""PPO learns to cut along a wanted depth as a user asks for it, small: trains, exports, compares with every script."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path

import numpy as np
import pytest
from program import rows, run

from cutenv.agents.policy import TrainedPolicy, gentle_policy
from cutenv.agents.policy.depth_policies import DEPTH_SCRIPTS, DepthByTwoForces, DepthFeatures
from cutenv.agents.policy.third_axis_planners import DepthPlanner

stable_baselines3 = pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")

from cutenv.agents.learning.arguments import (  # noqa: E402  # noqa: E402
    BadArguments,
    BCArguments,
    IQLArguments,
    PPOArguments,
    RecurrentPPOArguments,
    SACArguments,
)
from cutenv.agents.learning.evaluation import contestant  # noqa: E402
from cutenv.agents.learning.training_report import task_headline  # noqa: E402
from cutenv.envs.depth_cut import DepthCutEnv  # noqa: E402
from cutenv.task.registry import TASKS  # noqa: E402

SMALL = (
    "--task", "depth", "--name", "small", "--environments", "4", "--rollout", "32", "--batch-size", "64",
    "--timesteps", "256", "--validations", "1", "--validation-specimens", "2", "--specimens", "2",
)  # fmt: skip


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str]:
    folder = tmp_path_factory.mktemp("training")
    with pytest.MonkeyPatch.context() as patch:
        hasty = dataclasses.replace(TASKS["depth"], planner=lambda: DepthPlanner(rounds=1))  # the search takes longest
        patch.setitem(TASKS, "depth", hasty)
        done = run("train", folder, *SMALL)
    assert done.returncode == 0, done.stderr
    return folder / "runs" / "small", done.stdout, done.stderr


def test_the_run_knows_its_task_and_begins_with_a_script_of_it(finished):
    facts = json.loads((finished[0] / "run.json").read_text())
    assert facts["environment"] == "cutenv/DepthCut-v1"
    assert (facts["arguments"]["task"], facts["arguments"]["script"]) == ("depth", "depth by two forces")
    assert facts["arguments"]["control_hz"] == 10


def test_agent_scripts_and_planner_met_the_same_specimens_and_agent_and_scripts_more(finished):
    folder, printed, _ = finished
    several = {"PPO", "PPO untrained", *DEPTH_SCRIPTS, "planner with truth"}
    scores = rows(folder / "scores.csv")
    assert {row["policy"] for row in scores} == several
    assert len({tuple(r["seed"] for r in scores if r["policy"] == name) for name in several}) == 1
    counts = {row["baseline"]: int(row["cuts"]) for row in rows(folder / "differences.csv")}
    assert counts == dict.fromkeys(DEPTH_SCRIPTS, 10) | {"PPO untrained": 2, "planner with truth": 2}
    assert any(line.startswith(("PPO beats", "PPO does not", "Whether PPO")) for line in printed.splitlines())


def test_its_page_has_the_depth_of_agent_and_best_script(finished):
    page = (finished[0] / "report.html").read_text(encoding="utf-8")
    scores = rows(finished[0] / "summary.csv")
    error = next(row for row in scores if row["policy"] == "PPO" and row["score"] == "mean_error_mm")
    assert f"{float(error['mean']):.2f} [" in re.sub("<[^>]+>", "", page)
    assert "Constant feed at every speed" not in page
    assert len(re.findall(r"Floor of the cut by .*?: its depth errs by \d+\.\d\d mm on average", page)) >= 2
    for meaning in ("Error of the depth", "layer opened", "left uncut"):
        assert meaning in page


def test_the_exported_policy_acts_as_the_trained_one_with_three_numbers(finished):
    model = stable_baselines3.PPO.load(finished[0] / "policy.zip", device="cpu")
    policy = TrainedPolicy.load(finished[0] / "policy")
    assert (policy.card.environment, len(policy.card.scaling)) == ("cutenv/DepthCut-v1", 22)
    features, script = DepthFeatures(**policy.card.features), DepthByTwoForces()
    hidden = np.zeros(model.observation_space.shape[0] - features.size - 3, np.float32)  # the actor must not look at it
    env = DepthCutEnv(**policy.environment_arguments)
    observation, _ = env.reset(seed=1)
    policy.reset(np.random.default_rng(0))
    script.reset(np.random.default_rng(0))
    for number in range(20):
        seen, scripted = features(observation), script(observation)
        if number % policy.card.hold == 0:
            added, _ = model.predict(np.concatenate((seen, scripted, hidden)), deterministic=True)
        action = policy(observation)
        assert action.shape == (3,)
        assert action == pytest.approx(np.clip(scripted + added, -1.0, 1.0), abs=1e-5)
        observation = env.step(action)[0]


def test_it_is_evaluated_with_policies_of_its_task_alone(finished, tmp_path):
    folder = str(finished[0] / "policy")
    assert contestant(folder).arguments["task"] == contestant("depth by force").arguments["task"] == "depth"
    done = run("evaluate", tmp_path, folder, "hold one depth", "--specimens", "2")
    assert done.returncode == 0, done.stderr
    assert "mean error of the depth [mm]" in done.stdout
    mixed = run("evaluate", tmp_path, folder, "return stroke", "--specimens", "2")
    assert mixed.returncode == 2
    assert "'return stroke' is for 'gentle'" in mixed.stderr


def test_it_is_refused_where_the_blade_stays_at_its_level_and_its_baselines_are_not_reused(finished, tmp_path):
    with pytest.raises(ValueError, match="trained in cutenv/DepthCut-v1, which has a third action, descent"):
        gentle_policy(finished[0] / "policy")
    refused = run("evaluate", tmp_path, "--report", str(finished[0]), "--baselines-of", str(finished[0]))
    assert refused.returncode == 2
    assert "leave out --baselines-of" in refused.stderr


@pytest.mark.parametrize("kind", [RecurrentPPOArguments, SACArguments, BCArguments, IQLArguments])
def test_other_learners_refuse_the_task(kind):
    with pytest.raises(BadArguments, match="--task depth is learned by PPO alone"):
        kind(task="depth")


def test_a_script_of_the_other_task_is_refused_by_name():
    with pytest.raises(
        BadArguments, match="'return stroke' is for --task gentle; those for --task depth are 'hold one"
    ):
        PPOArguments(task="depth")
    with pytest.raises(BadArguments, match="'probe down' is for --task depth; those for --task gentle are 'fast then"):
        PPOArguments(script="probe down")
    known = PPOArguments(**PPOArguments.completed({"task": "depth"}))
    assert (known.script, known.correction) == ("depth by two forces", {"script": known.script, "hold": known.hold})
    assert PPOArguments.completed({"task": "depth", "script": "probe down"})["script"] == "probe down"
    assert PPOArguments(**PPOArguments.completed({"task": "path"})).script == "steer by force"


def test_the_first_sentence_says_whether_it_beats_every_script():
    def paired(*intervals):
        return [
            {"baseline": name, "score": "return", "cuts": 9, "mean": (low + high) / 2, "low_95": low, "high_95": high}
            for name, (low, high) in zip(DEPTH_SCRIPTS, intervals, strict=False)
        ]

    def headline(*intervals):
        return task_headline("PPO", paired(*intervals), DEPTH_SCRIPTS)

    assert headline((0.1, 0.2), (0.05, 0.3)).startswith("PPO beats every script. On the same 9")
    assert "that of follow the depth is +0.175" in headline((0.1, 0.2), (0.05, 0.3))
    assert "Whether PPO beats every script is open" in headline((0.1, 0.2), (-0.05, 0.3))
    lost = headline((0.1, 0.2), (-0.2, -0.1), (-0.1, 0.1))
    assert lost.startswith("PPO does not beat every script: follow the depth is better.")
