"""The memory gap: every learner trains on the raw track, and a run that was finished is not made again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("sb3_contrib", reason="the learners are an extra: pip install 'cutenv[rl]'")

from cutenv.task.privileged import PRIVILEGED_FEATURES
from scripts.benchmarks.agents import memory_gap


def run(monkeypatch, folder: Path, *options: str) -> None:
    monkeypatch.setattr("sys.argv", ["memory_gap.py", "--out", str(folder), *options])
    memory_gap.main()


def test_all_learn_with_the_same_decisions_and_go_on_where_they_stopped(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(memory_gap, "ENVIRONMENTS", 4)
    run(monkeypatch, tmp_path, "--learners", "memoryless", "--decisions", "1", "--specimens", "5")
    before = (tmp_path / "memoryless-0.csv").read_text()
    run(monkeypatch, tmp_path, "--decisions", "1", "--specimens", "5")
    assert (tmp_path / "memoryless-0.csv").read_text() == before
    table = capsys.readouterr().out.splitlines()[-len(memory_gap.LEARNERS) :]
    for line, text in zip(table, memory_gap.LEARNERS.values(), strict=True):
        assert line.startswith(f"| {text} | 1 | 512 |")
    means = {
        (name, seed): np.mean([float(row["return"]) for row in rows])
        for (name, seed), rows in memory_gap.kept(tmp_path).items()
    }
    assert f"| {means['observed', 0] - means['memoryless', 0]:+.3f} [" in table[-1]


def test_they_see_what_they_are_said_to_see():
    sizes = {name: memory_gap.environments(name, range(2)).observation_space.shape for name in memory_gap.LEARNERS}
    assert sizes == {
        "memoryless": (12,),
        "stacked": (12 * memory_gap.STACKED,),
        "recurrent": (12,),
        "observed": (12 + len(PRIVILEGED_FEATURES),),
    }


def test_without_a_run_there_is_no_table(tmp_path):
    with pytest.raises(SystemExit, match=r"holds no run; run 'python -m scripts.benchmarks.agents.memory_gap' first"):
        memory_gap.kept(tmp_path)
