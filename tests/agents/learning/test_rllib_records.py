"""What agents/rllib.py writes beside the agent, with no Ray: facts, curve and clock of a run that goes on."""

from __future__ import annotations

import csv
import json
import math
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from cutenv.agents.learning import run_folder

pytest.importorskip("tqdm", reason="learners need an extra: pip install 'cutenv[distributed]'")

from rllib import Arguments, connect, record_run, train, uncut_episode

HERE = ("cutenv", "numpy")  # Ray is not where the other tests run


class Rounds:
    """An algorithm of RLlib's that counts rounds."""

    def __init__(self, iteration: int) -> None:
        self.iteration = iteration

    def train(self) -> dict[str, object]:
        self.iteration += 1
        sampled = {"episode_return_mean": 0.5, "success": 1.0} if self.iteration != 3 else {"success": math.nan}
        decisions = 100 * self.iteration
        return {
            "training_iteration": self.iteration, "num_env_steps_sampled_lifetime": decisions, "env_runners": sampled,
        }  # fmt: skip

    def save_to_path(self, path: Path) -> None:
        path.mkdir(exist_ok=True)


def test_the_clock_of_a_run_that_goes_on_goes_on(tmp_path):
    train(Rounds(0), Arguments(iterations=2), tmp_path)
    with (tmp_path / "learning_curve.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    rows[-1]["seconds"] = "50.0"
    curve = train(Rounds(2), Arguments(iterations=4), tmp_path, rows)
    assert [int(point["iteration"]) for point in curve] == [1, 2, 3, 4]
    assert all(50.0 <= float(point["seconds"]) < 60.0 for point in curve[1:])
    assert ["return" in point for point in curve] == [True, True, False, True]  # none ended in the third round


def test_a_run_keeps_commit_versions_and_seeds_and_where_it_began(tmp_path, monkeypatch):
    for commit in ("a" * 40, "b" * 40):
        monkeypatch.setattr(run_folder, "git", lambda *given, commit=commit: commit if given[0] == "rev-parse" else "")
        record_run(Arguments(seed=2, workers=3, environments=10), tmp_path, HERE)
    facts = json.loads((tmp_path / "run.json").read_text())
    assert facts["commit"] == "a" * 40
    assert facts["resumed_at_commits"] == ["b" * 40]
    assert facts["seeds"] == {"training": [200_000, 200_039]}
    assert facts["versions"].keys() == {*HERE, "python"}
    assert facts["arguments"]["seed"] == 2


def test_without_an_address_no_cluster_that_was_begun_before_is_joined(monkeypatch):
    given: dict[str, object] = {}
    loopback = [{"NodeManagerAddress": "127.0.0.1"}]
    monkeypatch.setitem(sys.modules, "ray", SimpleNamespace(init=given.update, nodes=lambda: loopback))
    for name in ("RAY_USAGE_STATS_ENABLED", "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER"):
        monkeypatch.setenv(name, "")  # set by connect(), and put back
    connect(Arguments())
    assert given["address"] == "local"  # none at all would join one that lies in /tmp/ray


@pytest.mark.parametrize(
    ("name", "value"), [("rollout", 0), ("batch_size", 1), ("epochs", 0), ("learning_rate", 0.0), ("hidden", 0)]
)
def test_a_number_beyond_its_limits_is_refused(name, value):
    with pytest.raises(SystemExit, match=f"--{name.replace('_', '-')} {value} is outside "):
        Arguments(**{name: value})


def test_a_run_that_goes_on_begins_beyond_every_episode_that_can_have_begun():
    arguments = Arguments(workers=2, environments=8)
    assert uncut_episode(arguments, []) == 0
    rows = [{"iteration": "1", "decisions": "1600.0"}, {"iteration": "2", "decisions": "3205.0"}]
    every_decision_a_cut = 3205 / 16
    assert every_decision_a_cut + 1 < uncut_episode(arguments, rows) < every_decision_a_cut + 3
