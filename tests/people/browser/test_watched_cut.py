"""Movements are kept in runs, and the way of the planner or an agent is that of its cut."""

from __future__ import annotations

import numpy as np
import pytest

from cutenv.agents.policy import ORACLE, experts
from cutenv.people.browser import HandCut
from cutenv.people.browser.page_alone import page_alone
from cutenv.people.browser.watched_cut import expert_way, from_runs, in_runs, way_of


def test_runs_hold_every_movement_to_the_last_bit() -> None:
    rows = np.random.default_rng(0).uniform(0.0, 0.1, (60, 3)).repeat(16, axis=0)
    runs = in_runs(rows)
    assert len(runs) == 60
    assert from_runs(runs).tobytes() == rows.tobytes()
    assert in_runs(rows[:0]) == []


@pytest.mark.parametrize("damaged", [[], [[1.0]], [[0, 0.1, 1.5]], [[2, float("nan"), 1.5]]])
def test_damaged_runs_are_refused(damaged: list[list[float]]) -> None:
    with pytest.raises(ValueError, match="damaged"):
        from_runs(damaged)


def test_a_way_has_fifty_moments_a_second_and_the_end() -> None:
    readings = HandCut().follow(np.stack([np.linspace(0.0, 0.02, 1510), np.full(1510, 1.5)], axis=-1))
    way = way_of(readings, {"height": np.arange(1510.0), "vertical_force": np.zeros(1510)})
    assert set(way) == {"time", "position", "angle", "force", "tip", "height"}
    assert np.diff(way["time"][:-1]) == pytest.approx(0.02)
    assert way["force"][-1] == pytest.approx(readings["force"][-1], abs=1e-3)


def test_the_planner_ends_at_the_target_of_the_hands_specimen() -> None:
    way = expert_way("liver", 3, 0, 0.07)
    assert way["tip"][-1] == pytest.approx(0.07, abs=0.003)
    assert max(way["time"]) < 30.0


def test_the_excisions_agent_cuts_the_side_that_a_person_cuts() -> None:
    planner, agent = (
        expert_way("liver", 3, 0, task="path", line="fusiform", expert=expert) for expert in (ORACLE, "ppo-excision")
    )
    assert agent["tip"][-1] == pytest.approx(planner["tip"][-1], abs=0.005)  # the same target
    middle = [np.interp(0.04, way["blade_x"], way["blade_y"]) for way in (planner, agent)]
    assert middle[1] == pytest.approx(middle[0], abs=0.006)  # on the same side
    assert agent["force"] != planner["force"]


def test_experts_of_a_task_have_its_actions() -> None:
    assert experts("path") == (ORACLE, "ppo-excision", "ppo-path")
    assert "ppo-free" in experts("gentle")
    assert "ppo-path" not in experts("gentle")
    with pytest.raises(ValueError, match="expert must be"):
        page_alone(tasks=("gentle",), expert="ppo-excision")
