"""Learners from scratch: each trains on what it is said to see, its curve is kept, and no run is made twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3", reason="the learners are an extra: pip install 'cutenv[rl]'")

from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.policy import Features
from cutenv.task.privileged import PRIVILEGED_FEATURES
from scripts.benchmarks.policies import from_scratch

DECISIONS = 600


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Runs of all learners on gentle cutting, much smaller than published ones."""
    out = tmp_path_factory.mktemp("runs")
    with pytest.MonkeyPatch.context() as smaller:
        for name, value in {"ENVIRONMENTS": 8, "MEMORY_ENVIRONMENTS": 8, "SPECIMENS": 3, "HELD_OUT": 5}.items():
            smaller.setattr(from_scratch, name, value)
        smaller.setattr(from_scratch, "PPO_SETTINGS", from_scratch.PPO_SETTINGS | {"n_steps": 40, "batch_size": 64})
        smaller.setitem(from_scratch.SAC_SETTINGS, "learning_starts", 500)
        run(out, "--tasks", "gentle", "--seeds", "0", "--decisions", f"{DECISIONS}")
        written = {path: path.stat().st_mtime_ns for path in out.iterdir()}
        run(out, "--tasks", "gentle", "--seeds", "0", "--decisions", f"{DECISIONS}")
        assert {path: path.stat().st_mtime_ns for path in out.iterdir()} == written
    return out


def run(folder: Path, *options: str) -> None:
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("sys.argv", ["from_scratch.py", "--out", str(folder), *options])
        from_scratch.main()


def test_every_learner_has_a_curve_that_ends_on_held_out_specimens(folder):
    runs = from_scratch.kept(folder)
    assert {(run.learner, run.shown) for run in runs} == set(from_scratch.cells(from_scratch.LEARNERS))
    for rows in runs.values():
        decisions = [row["decisions"] for row in rows]
        assert len(rows) > 1
        assert decisions[-1] > 0.8 * DECISIONS  # whole rollouts
        assert decisions == sorted(decisions)
        assert [row["specimens"] for row in rows] == [3.0] * (len(rows) - 1) + [5.0]
        assert all(-1.5 < row["return"] < 1.0 for row in rows)


def test_the_table_has_them_beside_the_best_script_and_the_picture_is_drawn(folder, tmp_path):
    table = from_scratch.report(folder).splitlines()[2:]
    assert len(table) == 2 + 1 + 8
    assert table[2].startswith("| gentle | script: return stroke |")
    (row,) = [line for line in table if "| PPO with a memory | features |" in line]
    last = from_scratch.kept(folder)[from_scratch.Run("gentle", "memory", "features", 0)][-1]
    means = [f"{last[prefix + 'return']:.3f} | {100.0 * last[prefix + 'success']:.0f}" for prefix in ("", "drawn_")]
    assert row.endswith(f"| {' | '.join(means)} |")
    from_scratch.draw(folder, tmp_path / "curves.png")
    assert (tmp_path / "curves.png").stat().st_size > 10_000


def test_learners_see_what_they_are_said_to_see():
    sizes = {
        shown: from_scratch.Run("gentle", "ppo", shown, 0).environments(range(2)).observation_space.shape
        for shown in from_scratch.SHOWN
    }
    features = Features(1).size
    assert sizes == {"raw": (12,), "features": (features,), "truth": (12 + len(PRIVILEGED_FEATURES),)}


def test_a_curve_counts_the_first_cut_of_each_specimen():
    run = from_scratch.Run("gentle", "ppo", "raw", 0)
    ahead = np.tile(np.array([0.6, 0.0], np.float32), (4, 1))
    together, success = from_scratch.cut_with(
        lambda seen, memory, begun: (ahead, memory), run.environments(TEST_SEEDS[:4])
    )
    for number, seed in enumerate(TEST_SEEDS[:4]):
        alone = from_scratch.cut_with(lambda seen, memory, begun: (ahead[:1], memory), run.environments([seed]))
        assert (together[number], success[number]) == (alone[0][0], alone[1][0])
    assert len(set(together)) == 4
