"""What is computed is what was committed, to the last bit; ``scripts/digests.py`` compares far more."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest

from scripts import digests


@pytest.mark.parametrize("group", digests.PORTABLE)
def test_the_bits_are_the_committed_ones(group: str) -> None:
    kept = digests.read()["quick"]["portable"]
    own = {name: value for name, value in kept.items() if name.startswith(f"{group}/")}
    assert own
    assert digests.differences(digests.computed(group, quick=True), own) == []


def test_one_other_bit_is_another_digest_and_another_order_of_keys_is_not() -> None:
    info = {"truth": {"tip_m": 0.1, "end": None}, "cost": np.float64(0.0)}
    again = {"cost": 0.0, "truth": {"end": None, "tip_m": np.float64(0.1)}}
    assert digests.digest(info) == digests.digest(again)
    again["truth"]["tip_m"] = np.nextafter(0.1, 1.0)
    assert digests.digest(info) != digests.digest(again)
    with pytest.raises(TypeError, match="object, which has no canonical bytes"):
        digests.digest(object())


def test_what_moved_is_named_and_so_is_what_is_missing_or_new() -> None:
    lines = digests.differences({"a": "1", "b": "2", "c": "3"}, {"a": "1", "b": "0", "d": "4"})
    assert [line.split()[:2] for line in lines] == [["moved", "b:"], ["new", "c:"], ["missing", "d"]]


def test_a_row_that_differs_from_its_single_cut_is_found() -> None:
    task, policy = digests.TASKS["gentle"], digests.HeldRandomActions(2)
    env = gymnasium.make(task.entry.id, control_hz=10)
    envs = gymnasium.make_vec(task.entry.id, num_envs=2, control_hz=10)
    cuts = [digests.single_cut(env, policy, seed, 20) for seed in range(2)]
    many = digests.many_cuts(envs, policy, 20, {n: len(cut.rewards) for n, cut in enumerate(cuts)})
    assert digests.differing_row(many, cuts) == "rows equal single cuts"
    cuts[1].infos[-1]["truth"]["tip_m"] += 1e-15
    assert digests.differing_row(many, cuts) == "last info of seed 1 differs"
    cuts[1].rewards[3] += 1e-15
    assert digests.differing_row(many, cuts) == "rewards of seed 1 differ"
