"""A clone does what it was taught."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the learner is an extra: pip install 'cutenv[rl]'")

from cloning import before_dead_zone, clone, demonstrations  # noqa: E402
from vectorised import CutVecEnv  # noqa: E402

from cutenv.policy import ConstantFeed, past_dead_zone  # noqa: E402


def test_what_stands_before_the_dead_zone_comes_out_of_it_again():
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 2)).astype(np.float32)
    actions[0, 0] = 0.0
    assert past_dead_zone(before_dead_zone(actions, 0.25), 0.25) == pytest.approx(actions, abs=1e-6)
    assert before_dead_zone(actions, 0.25)[0, 0] == 0.0


def test_demonstrations_are_what_the_script_does_whatever_noise_is_added():
    environments = CutVecEnv(range(4), history=0, dead_zone=0.25, control_hz=10)
    _, taught = demonstrations(environments, lambda: ConstantFeed(speed=0.0127), decisions=40, noise=0.3, seed=1)
    speed, angle = past_dead_zone(taught, 0.25).T
    assert taught.shape == (40, 2)
    assert speed == pytest.approx(0.5, abs=1e-6)
    assert angle == pytest.approx(1.0)


def test_a_clone_comes_near_its_teacher_and_without_lessons_it_does_not():
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    shown = rng.uniform(-1.0, 1.0, (2000, 5)).astype(np.float32)
    taught = np.stack((np.sin(2.0 * shown[:, 0]), shown[:, 1] * shown[:, 2]), axis=1)
    network = torch.nn.Sequential(torch.nn.Linear(5, 32), torch.nn.Tanh(), torch.nn.Linear(32, 2))
    untaught = clone(network, list(network.parameters()), shown, taught, epochs=1, learning_rate=0.0)
    assert clone(network, list(network.parameters()), shown, taught, batch_size=64) < 0.4 * untaught
