"""One entry in one table is all that a term of the reward or a component of the observation takes."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]

TERM = """    Term(
        name="tremble",
        title="trembling",
        text="integral of speed and travel, / 10 mm",
        weight=0.3,
        per="per 10 mm of way",
        each=lambda speed, moved: speed * TICK + abs(moved),
        cost=lambda weight, total: weight * total / 0.010,
    ),
"""
COMPONENT = """    Component(
        name="speed_mean",
        meaning="of the blade since the last decision, its size",
        unit="m/s",
        scale=0.1,
        offset=0.002,
        each=lambda speed: speed,
        value=lambda total, updates: total / updates,
    ),
"""
PROGRAM = """
import dataclasses, json
import gymnasium, numpy as np
import cutenv
from cutenv.report.glossary import term_meanings
from cutenv.task.weights import RewardWeights

STEPS, ACTION = 3, np.float32([0.5, -0.5])
env = gymnasium.make("cutenv/GentleCut-v1", weight_tremble=0.7)
batch = gymnasium.make_vec("cutenv/GentleCut-v1", num_envs=2, weight_tremble=0.7)
seen, _ = env.reset(seed=4)
several, _ = batch.reset(seed=[4, 5])
steps, before = [], 0.0
same = [np.array_equal(several[0], seen)]
for _ in range(STEPS):
    seen, reward, *_, info = env.step(ACTION)
    several, rewards, *_, infos = batch.step(np.tile(ACTION, (2, 1)))
    readings = env.unwrapped.cutting.readings
    moved = np.diff(readings["position"], prepend=before)
    before, speeds = readings["position"][-1], np.abs(readings["speed"])
    steps.append({
        "terms": info["reward_terms"],
        "reward": reward,
        "way": float(speeds.sum() * 0.001 + np.abs(moved).sum()),
        "speed": float(speeds.mean()),
        "seen": seen.tolist(),
    })
    terms = infos["reward_terms"]
    same += [np.array_equal(several[0], seen), rewards[0] == reward]
    same += [terms[name][0] == value for name, value in info["reward_terms"].items()]
print(json.dumps({
    "steps": steps,
    "same": [bool(one) for one in same],
    "space": env.observation_space.shape,
    "weights": dataclasses.asdict(RewardWeights()),
    "title": term_meanings().get("tremble"),
    "doc": env.unwrapped.__doc__.splitlines(),
}))
"""


def with_entry(package: Path, table: str, before: str, entry: str) -> None:
    """Insert an entry before the one line of a table's module that begins with a text."""
    path = package / table
    source = path.read_text(encoding="utf-8")
    assert source.count(before) == 1
    path.write_text(source.replace(before, entry + before), encoding="utf-8")


def started(folder: Path, program: str) -> subprocess.CompletedProcess[str]:
    """Run a program with the package of a folder, in plain Python: nothing has to be compiled."""
    paths = os.pathsep.join([str(folder), str(ROOT / "scripts")])
    return subprocess.run(
        [sys.executable, "-c", program],
        env=os.environ | {"PYTHONPATH": paths, "NUMBA_DISABLE_JIT": "1", "PYTHONDONTWRITEBYTECODE": "1"},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


def copied(folder: Path) -> Path:
    """Copy the package; what it reads from assets/ it finds there."""
    package = folder / "cutenv"
    shutil.copytree(ROOT / "cutenv", package, ignore=shutil.ignore_patterns("__pycache__"))
    (folder / "assets").symlink_to(ROOT / "assets", target_is_directory=True)
    return package


@pytest.fixture(scope="module")
def extended(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Run a copy of the package with one term and one component more; return what it printed."""
    package = copied(tmp_path_factory.mktemp("extended"))
    with_entry(package, "task/reward.py", '    Term(\n        name="safety",', TERM)
    with_entry(package, "task/observation.py", ')\n"""Components of the observation', COMPONENT)
    done = started(package.parent, PROGRAM)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_a_declared_term_is_charged_and_told(extended):
    for step in extended["steps"]:
        assert step["terms"]["tremble"] == pytest.approx(-0.7 * step["way"] / 0.010, rel=1e-12)
        assert step["reward"] == pytest.approx(sum(step["terms"].values()), abs=1e-15)
    assert extended["steps"][-1]["terms"]["tremble"] < -0.01
    assert list(extended["steps"][0]["terms"])[-2:] == ["tremble", "safety"]


def test_it_has_a_weight_a_title_and_a_row_of_the_documentation(extended):
    assert extended["weights"]["tremble"] == 0.3
    assert extended["title"] == "trembling"
    assert "tremble      0.3    integral of speed and travel, / 10 mm" in extended["doc"]


def test_a_declared_component_is_observed_and_documented(extended):
    assert extended["space"] == [13]
    for step in extended["steps"]:
        assert len(step["seen"]) == 13
        assert step["seen"][-1] == pytest.approx((step["speed"] - 0.002) / 0.1, rel=1e-6)
    assert any(row.startswith("12  speed_mean of the blade since") for row in extended["doc"])


def test_one_cut_and_a_batch_still_agree_to_the_last_bit(extended):
    assert len(extended["same"]) > 30
    assert all(extended["same"])


def test_a_term_that_asks_for_what_there_is_not_is_refused_at_import(tmp_path):
    package = copied(tmp_path)
    unknown = TERM.replace("lambda speed, moved: speed * TICK + abs(moved)", "lambda humidity: humidity")
    with_entry(package, "task/reward.py", '    Term(\n        name="safety",', unknown)
    line = (package / "task" / "reward.py").read_text(encoding="utf-8").split("lambda humidity")[0].count("\n") + 1
    done = started(tmp_path, "import cutenv.task.assessment")
    assert done.returncode == 1
    (error,) = [text for text in done.stderr.splitlines() if text.startswith("ValueError")]
    assert f"{package / 'task' / 'reward.py'}:{line}: a formula asks for 'humidity'; here there are: deadline," in error
