"""cutenv/Excision-v1: one side of a fusiform excision, from end to end."""

from __future__ import annotations

import math

import gymnasium
import numpy as np
import pytest

import cutenv  # noqa: F401
from cutenv.envs.path_cut import ExcisionEnv, PathCutEnv
from cutenv.envs.vector import CutBatch
from cutenv.sim.tissue.drawn_lines import STORED, drawn_lines, kind_of
from cutenv.sim.tissue.lines import half_ellipse, length_within

FULL_SPEED = np.array([0.5, 1.0, 0.0], np.float32)


def test_sides_have_the_proportions_that_surgeons_plan():
    lines, records = drawn_lines(*STORED.values())
    sides = [n for n in range(len(lines)) if kind_of(n) == "fusiform"]
    assert len(sides) == 64
    ratios, angles = [], []
    for n in sides:
        line, end = lines[n], round(records["length"][n] * 2000)
        assert 0.06 <= records["length"][n] <= 0.1
        assert abs(line.y[end]) < 5e-4  # on the axis of the slab, where it began
        assert length_within(line) >= records["length"][n] + 0.04  # room for the blade that leads its tip
        np.testing.assert_allclose(line.angle[: end + 1], -line.angle[end::-1], atol=0.03)  # the same from either end
        ratios.append(line.x[end] / (2.0 * abs(line.y).max() if end == 300 else 2.0 * abs(line.y[: end + 1]).max()))
        angles.append(math.degrees(abs(line.angle[0])))
    assert 2.5 <= min(ratios) < 2.9 < 3.6 < max(ratios) <= 4.05
    assert 25.0 <= min(angles) < 31.0 < 42.0 < max(angles) <= 45.0
    sides_of_first = {np.sign(lines[n].angle[0]) for n in sides}
    assert sides_of_first == {-1.0, 1.0}


@pytest.mark.parametrize("start", [None, 0.02])
def test_the_cut_ends_where_the_line_does_alone_and_in_a_batch(start):
    batch = CutBatch(6, ExcisionEnv(start_before_target=start))
    everyone = np.arange(6)
    batch.give_seeds(list(range(6)), everyone, np.random.default_rng(0))
    batch.begin(everyone)
    batch.decide(np.tile(FULL_SPEED, (6, 1)))
    for seed in range(6):
        env = ExcisionEnv(start_before_target=start)
        env.reset(seed=seed)
        seen, *_ = env.step(FULL_SPEED)
        number = int(env.cutting.whole["line"][0])
        assert kind_of(number) == "fusiform"
        assert env.cutting.target_length == drawn_lines(*STORED.values()).records["length"][number]
        assert batch.cuts.tasks["target"][seed] == env.cutting.settings["target"][0] == env.cutting.target_length
        np.testing.assert_array_equal(batch.observations[seed], seen)


def test_it_is_a_path_cut_along_such_a_line():
    excision, path = gymnasium.make("cutenv/Excision-v1"), PathCutEnv(line="fusiform")
    np.testing.assert_array_equal(excision.reset(seed=3)[0], path.reset(seed=3)[0])
    for _ in range(40):
        mine, other = excision.step(FULL_SPEED), path.step(FULL_SPEED)
        np.testing.assert_array_equal(mine[0], other[0])
        assert mine[1] == other[1]


def test_a_given_target_is_cut_and_one_beyond_every_side_is_refused():
    env = ExcisionEnv(target_length=0.05)
    env.reset(seed=0)
    assert env.cutting.target_length == 0.05
    with pytest.raises(ValueError, match=r"target_length = 0\.12 m: a half of a fusiform excision"):
        ExcisionEnv(target_length=0.12)
    with pytest.raises(ValueError, match=r"end_angle = 0\.4 rad.*ends at more than 36\.9 degrees"):
        half_ellipse(0.08, 0.015, 0.4)
