"""What a comparison picks out to show."""

from __future__ import annotations

import pytest

pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")
pytest.importorskip("stable_baselines3", reason="the learner is an extra: pip install 'cutenv[rl]'")

from cutenv.agents.learning.statistics import read_rows
from cutenv.agents.learning.training_report import grid_rows, shown_facts, typical
from cutenv.agents.policy import CONSTANT_FEEDS, GRID_ANGLES, GRID_SPEEDS


def test_the_cut_that_is_drawn_is_the_agents_median_one():
    returns = {5: 0.9, 6: -1.0, 7: 0.4, 8: 0.5, 9: 0.1}
    rows = [{"policy": "PPO", "seed": seed, "return": value} for seed, value in returns.items()]
    rows += [{"policy": "other", "seed": seed, "return": 0.0} for seed in returns]
    assert typical(rows, list(returns), "PPO") == 7


def test_the_grid_has_a_cell_for_every_speed_and_angle():
    summary = [
        {"policy": name, "score": score, "mean": speed * angle, "low_95": 0.0, "high_95": 1.0}
        for name, (speed, angle) in CONSTANT_FEEDS.items()
        for score in ("return", "success")
    ]
    rows = grid_rows(summary)
    assert {(row["speed_cm_s"], row["angle_deg"]) for row in rows} == {(v, a) for v in GRID_SPEEDS for a in GRID_ANGLES}
    assert all(row["mean"] == row["success"] == row["speed_cm_s"] * row["angle_deg"] for row in rows)


def test_an_empty_cell_of_a_learning_curve_is_an_absent_number(tmp_path):
    (tmp_path / "curve.csv").write_text("decisions,return,validation_return\n10,0.5,\n20,0.6,0.7\n")
    first, second = read_rows(tmp_path / "curve.csv")
    assert first == {"decisions": 10.0, "return": 0.5}
    assert second["validation_return"] == 0.7
    assert read_rows(tmp_path / "none.csv") == []


def test_facts_name_class_seeds_and_versions():
    facts = shown_facts(
        {
            "arguments": {"specimen_class": "mixed", "specimens": 200, "seed": 2, "timesteps": 5_000_000},
            "environment": "cutenv/GentleCut-v1",
            "commit": None,
            "seeds": {"training": [2000, 2063]},
            "versions": {"numpy": "2.0"},
        }
    )
    assert facts["specimen class"] == "mixed"
    assert facts["decisions"] == "5 000 000"
    assert facts["commit"] == "unknown"
    assert facts["seeds of training"] == "2000 to 2063"
    assert facts["numpy version"] == "2.0"
