"""The main job as a user runs it, small: trains, evaluates, writes, and survives an interruption."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from program import SMALL, assert_training_goes_on, interrupted_at, rows, run, run_afresh

from cutenv.agents.policy import BASELINES, ORACLE
from cutenv.agents.policy.features import feature_count

stable_baselines3 = pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")
torch = pytest.importorskip("torch", reason="the learner is an extra: pip install 'cutenv[rl]'")

from cutenv.agents.learning.arguments import PPOArguments  # noqa: E402
from cutenv.agents.learning.on_policy import time_to_threshold  # noqa: E402

FILES = (
    "policy/policy.safetensors", "policy/card.json", "policy.zip", "checkpoint.zip", "scores.csv", "comparison.csv",
    "summary.csv",
    "differences.csv", "learning_curve.csv", "run.json", "cut.png", "report.html",
)  # fmt: skip


@pytest.fixture(scope="module")
def finished(trained: Callable[[str], tuple[Path, str]]) -> tuple[Path, str]:
    return trained("ppo")


def test_a_run_leaves_everything_it_names(finished):
    run, printed = finished
    assert [name for name in FILES if not (run / name).is_file()] == []
    assert str(Path("runs") / "small") in printed


def test_every_policy_met_the_same_specimens(finished):
    scores = rows(finished[0] / "scores.csv")
    seeds = {row["policy"]: [] for row in scores}
    for row in scores:
        seeds[row["policy"]].append(row["seed"])
    assert set(seeds) == {"PPO", "PPO untrained", *BASELINES}
    planned = seeds.pop(ORACLE)  # its cuts take long
    assert len({tuple(own) for own in seeds.values()}) == 1
    assert planned == seeds["PPO"][: max(len(seeds["PPO"]) // 4, 2)]


def test_agent_and_best_scripts_met_twenty_times_as_many(finished):
    run, printed = finished
    few = {row["seed"] for row in rows(run / "scores.csv")}
    further = rows(run / "comparison.csv")
    agent, *scripts = dict.fromkeys(row["policy"] for row in further)
    assert agent == "PPO"
    assert len(scripts) == 1 + ("return stroke" in scripts)  # the best one, and if it is the teacher, the best other
    assert len(further) == (1 + len(scripts)) * 19 * len(few)
    assert not few & {row["seed"] for row in further}
    cuts = {(row["baseline"], row["score"]): float(row["cuts"]) for row in rows(run / "differences.csv")}
    assert {cuts[script, score] for script in scripts for score in ("return", "success")} == {20 * len(few)}
    assert {count for (baseline, _), count in cuts.items() if baseline not in (*scripts, ORACLE)} == {len(few)}
    planned = max(len(few) // 4, 2)
    assert cuts[ORACLE, "return"] == planned
    assert f"({' and '.join(scripts)}: on {20 * len(few)} specimens; {ORACLE}: on {planned})" in printed


def test_it_is_told_when_the_agent_was_level_with_its_teacher_if_it_was(finished):
    run, printed = finished
    told = json.loads((run / "run.json").read_text())["level_with_script_after_s"]
    assert told is None or told > 0.0
    assert ("as good as 'return stroke' on the validation specimens after " in printed) is (told is not None)


def test_level_is_when_validation_first_reaches_what_the_script_gets():
    easy = PPOArguments(validation_specimens=4, script="force feedback")
    curve = [{"seconds": 1.0, "return": 9.0}] + [
        {"seconds": 10.0 * n, "return": 0.0, "validation_return": value} for n, value in enumerate((-2.0, 0.99, 1.0), 1)
    ]
    assert time_to_threshold(easy, curve) == 20.0
    assert time_to_threshold(easy, curve[:2]) is None


def test_the_actor_never_sees_what_the_critic_sees(finished):
    model = stable_baselines3.PPO.load(finished[0] / "policy.zip", device="cpu")
    size = model.observation_space.shape[0]
    shown, other = np.zeros((2, size), np.float32)
    other[feature_count(PPOArguments().history) :] = 3.0
    assert other.any(), "nothing hidden is shown"
    assert (model.predict(shown, deterministic=True)[0] == model.predict(other, deterministic=True)[0]).all()
    with torch.no_grad():
        values = model.policy.predict_values(torch.as_tensor(np.stack((shown, other))))
    assert values[0] != values[1]


@pytest.mark.parametrize("learner", SMALL)
def test_the_program_that_is_written_out_makes_the_same_policy(trained, tmp_path, learner):
    start = run_afresh if learner == "bc" else run  # one of them as a user starts it
    done = start(f"agents/{learner.replace('-', '_')}.py", tmp_path, *SMALL[learner])
    assert done.returncode == 0, done.stderr
    one, two = (
        folder / "policy" / "policy.safetensors" for folder in (trained(learner)[0], tmp_path / "runs" / "small")
    )
    assert one.read_bytes() == two.read_bytes()


def test_the_report_of_a_finished_run_can_be_made_again(finished, tmp_path):
    again = shutil.copytree(finished[0], tmp_path / "again")
    (again / "report.html").unlink()
    done = run("evaluate", tmp_path, "--report", str(again), "--baselines-of", str(finished[0]))
    assert done.returncode == 0, done.stderr
    assert (again / "report.html").is_file()
    one, two = (
        {(row["policy"], row["seed"]): float(row["return"]) for row in rows(folder / "scores.csv")}
        for folder in (again, finished[0])
    )
    assert one == two
    nothing = run("evaluate", tmp_path, "--report", "runs/none")
    assert nothing.returncode == 2
    assert "runs/none contains no policy/card.json" in nothing.stderr


def test_runs_that_are_there_or_not_there_and_bad_numbers_are_refused(finished, tmp_path):
    for folder, given, said in (
        (finished[0].parents[1], SMALL["ppo"], "--resume"),  # a run is never overwritten
        (tmp_path, ("--name", "bad", "--gamma", "1.5"), "--gamma 1.5 is outside 0.0 to 1.0"),
        (tmp_path, ("--resume", "runs/none"), "contains no checkpoint.zip"),
    ):
        done = run("train", folder, *given)
        assert done.returncode != 0
        assert said in done.stderr
        assert "Traceback" not in done.stderr
    assert not (tmp_path / "runs").exists()


def test_an_interrupted_run_goes_on_training_from_its_checkpoint(tmp_path):
    status, printed, _ = interrupted_at(
        "train", tmp_path, "return", *SMALL["ppo"], "--timesteps", "100000000", "--specimens", "0"
    )  # the bar shows a return after the first rollout in which a cut ended
    assert status == 130
    assert "checkpoint.zip is usable" in printed
    assert "--resume runs/small" in printed
    assert_training_goes_on("train", tmp_path, stable_baselines3.PPO, rollout=4 * 64)
    assert (tmp_path / "runs" / "small" / "policy.zip").is_file()
    share = json.loads((tmp_path / "runs" / "small" / "run.json").read_text())["environments_share"]
    done = run("train", tmp_path, "--resume", "runs/small")  # of which nothing is left
    assert done.returncode == 0, done.stderr
    assert "the training is complete\n" in done.stdout
    assert json.loads((tmp_path / "runs" / "small" / "run.json").read_text())["environments_share"] == share > 0.0
