"""The cost of a cut is the tip's overshoot and the parts of runs beyond 4 mm, in millimetres, whoever cuts."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from hacks import HACKS
from whole_cut import ENVIRONMENT, FASTEST, INCLINED, Cut, cut, make, steady

from cutenv.learning.batched_rollout import batched_rollout
from cutenv.policy import BASELINES

QUIET = {"specimen_class": "uniform", "force_noise": 0.0, "force_resolution": 0.0}
BLIND = [  # those that do not look into the hidden state, which a rollout does not show
    ("crossing the line with small force", "at full speed"),
    ("ending early", "by a low limit of force"),
    ("leaving the tissue loaded", "creeping on"),
    ("pumping speed", "every second, fast"),
    ("jitter", "large"),
]
CUTTERS = {"/".join(names): HACKS[names[0]][names[1]] for names in BLIND} | {
    name: BASELINES[name]() for name in ("probe and creep", "return stroke", "force feedback", "random")
}


def by_trace(readings: np.ndarray, target: float) -> dict[str, float]:
    """Return what the cost of a cut consists of, by its trace [mm]."""
    return {
        "overshoot_mm": 1e3 * max(readings["tip"][-1] - target, 0.0),
        "long_runs_mm": 1e3 * np.maximum(readings["jump"] - 0.004, 0.0).sum(),
    }


def summed(record: Cut) -> dict[str, float]:
    """Return the sums of the parts of the cost, of which each step's is checked to consist."""
    for info in record.infos:
        assert info["cost"] == sum(info["cost_terms"].values())
        assert min(info["cost_terms"].values()) >= 0.0
    return {name: sum(info["cost_terms"][name] for info in record.infos) for name in record.infos[0]["cost_terms"]}


@pytest.mark.parametrize("control_hz", [10, 50])
@pytest.mark.parametrize("name", CUTTERS)
def test_it_adds_up_to_the_overshoot_and_the_long_parts_of_the_runs_in_the_trace(name, control_hz):
    arguments = {"specimen_class": "mixed", "deadline_s": 15.0, "control_hz": control_hz}
    for found in batched_rollout(CUTTERS[name], range(12), arguments, readings=True):
        expected = by_trace(found.readings, found.truth["target_length_m"])
        assert found.cost_totals == pytest.approx(expected, abs=1e-9)
        row = found.scores()
        assert row["cost_mm"] == pytest.approx(row["overshoot_mm"] + row["long_runs_mm"], abs=1e-12)


def test_both_parts_occur_and_force_is_no_cost():
    assert summed(cut(make(specimen_class="vascular"), steady(0.01), seed=1))["long_runs_mm"] > 1.0
    assert summed(cut(make(**QUIET), steady(0.01)))["overshoot_mm"] > 5.0
    strong = cut(make(force_limit_per_depth=160.0, **QUIET), steady(0.01))
    assert strong.end == "force_limit"
    assert summed(strong) == {"overshoot_mm": 0.0, "long_runs_mm": 0.0}


def test_it_is_zero_at_the_start_and_by_the_estimate_where_the_reward_is():
    env = make(specimen_class="liver", reward_from="estimate")
    _, info = env.reset(seed=1)
    assert info["cost"] == 0.0
    assert info["cost_terms"] == {"overshoot_mm": 0.0, "long_runs_mm": 0.0}
    record, cutting = cut(env, steady(FASTEST, INCLINED), seed=1), env.unwrapped.cutting
    found = summed(record)["overshoot_mm"]
    assert found == pytest.approx(1e3 * max(cutting.tip - cutting.target_length, 0.0))
    assert found != pytest.approx(by_trace(record.readings, cutting.target_length)["overshoot_mm"], abs=1e-3)


def test_that_of_a_batch_is_that_of_single_environments_bit_for_bit():
    keywords, count = {"specimen_class": "mixed", "control_hz": 10}, 8
    envs = gymnasium.make_vec(ENVIRONMENT, num_envs=count, autoreset_mode="SameStep", **keywords)
    alone = [make(**keywords) for _ in range(count)]
    _, info = envs.reset(seed=0)
    assert not info["cost"].any()
    for number, env in enumerate(alone):
        env.reset(seed=number)
    going, total = np.ones(count, bool), 0.0
    action = np.array([1.0, -1.0], np.float32)
    while going.any():
        *_, info = envs.step(np.tile(action, (count, 1)))
        for number in np.flatnonzero(going):
            _, _, ended, _, single = alone[number].step(action)
            shown = info["final_info"] if ended else info
            assert shown["cost"][number] == single["cost"]
            assert shown["_cost"][number]
            for name, value in single["cost_terms"].items():
                assert shown["cost_terms"][name][number] == value
            total += single["cost"]
            going[number] = not ended
    assert total > 0.0
