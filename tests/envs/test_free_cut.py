"""cutenv/FreeCut-v1: PathCut in a slab whose finite elements are solved again as the cut opens."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cutenv.envs.free_cut import FreeCutEnv
from cutenv.envs.path_cut import PathCutEnv, to_path_action


def test_under_the_same_actions_it_cuts_nearly_as_the_table_does() -> None:
    envs = [kind(line="excision", target_length=0.08) for kind in (PathCutEnv, FreeCutEnv)]
    for env in envs:
        env.reset(seed=1)
    forces: list[list[Any]] = [[], []]
    for _ in range(200):  # a slow turn to the right, off the line
        for env, felt in zip(envs, forces, strict=True):
            env.step(to_path_action(0.01, 1.57, -0.12))
            felt.append(env.cutting.readings["true_force"][-1])
    path, free = np.array(forces)
    assert float(np.median(abs(free - path) / path)) < 0.04
    assert abs(envs[1].cutting.tip - envs[0].cutting.tip) < 0.0005
    steering, growing = envs[1].cutting.motion[0], envs[1].cutting.growing
    assert not steering["off_line"].any()  # which the table has, and the elements need not
    assert float(np.hypot(*(growing.model.tip - np.array(envs[1].cutting.tip_place)))) < 0.011  # less than two elements
    moved = envs[1].cutting.displaced(0.001)
    assert len(moved) >= 480
    assert all(np.isfinite(each).all() for each in moved)


def test_a_cut_may_be_made_to_before_its_target() -> None:
    env = FreeCutEnv(line="excision", target_length=0.08, start_before_target=0.02)
    _, info = env.reset(seed=0)
    assert info["truth"]["tip_m"] == pytest.approx(0.06)
    assert float(np.hypot(*(env.cutting.growing.model.tip - np.array(env.cutting.tip_place)))) < 0.011
