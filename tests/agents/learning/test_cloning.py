"""A clone does what it was taught."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="the learner is an extra: pip install 'cutenv[rl]'")

from cutenv.agents.learning.cloning import (  # noqa: E402
    Cloning,
    CutDataset,
    DecisionDataset,
    Demonstrations,
    demonstrations,
)
from cutenv.agents.policy import ConstantFeed  # noqa: E402
from cutenv.agents.sb3 import FeatureVecEnv  # noqa: E402
from cutenv.task.observation import commanded_speed  # noqa: E402


def test_demonstrations_are_what_the_script_does_whatever_noise_is_added():
    environments = FeatureVecEnv(range(4), history=0, control_hz=10)
    taught = demonstrations(environments, lambda: ConstantFeed(speed=0.0127), decisions=40, noise=0.3, seed=1).actions
    speed, angle = taught.reshape(-1, 2).T
    assert taught.shape == (10, 4, 2)
    assert commanded_speed(speed) == pytest.approx(0.0127, abs=1e-8)
    assert angle == pytest.approx(1.0)


def test_transitions_hold_what_was_done_and_what_came_of_it():
    environments = FeatureVecEnv(range(4), history=0, control_hz=10)
    shown = demonstrations(environments, lambda: ConstantFeed(speed=0.0254), decisions=1200, noise=0.3, seed=1)
    assert (shown.taken[:, ::2] == shown.actions[:, ::2]).all()
    assert abs(shown.taken[:, 1::2] - shown.actions[:, 1::2]).max() > 0.1
    assert abs(shown.taken).max() <= 1.0
    found = shown.transitions()
    assert len(found.rewards) == 1200 - 4
    n = 4 * int(np.flatnonzero(shown.starts[1:, 0])[0])  # the first cut's last decision in the first environment
    assert found.ends[n]
    assert not found.ends[:n:4].any()
    assert found.rewards[: n + 1 : 4].sum() == pytest.approx(shown.rewards[: n // 4 + 1, 0].sum())
    assert (found.next_observations[: n - 3 : 4] == found.observations[4 : n + 1 : 4]).all()


def test_a_clone_comes_near_its_teacher_and_without_lessons_it_does_not():
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    shown = rng.uniform(-1.0, 1.0, (2000, 5)).astype(np.float32)
    taught = np.stack((np.sin(2.0 * shown[:, 0]), shown[:, 1] * shown[:, 2]), axis=1)
    network = torch.nn.Sequential(torch.nn.Linear(5, 32), torch.nn.Tanh(), torch.nn.Linear(32, 2))
    lessons, parameters = DecisionDataset(shown, taught.astype(np.float32)), list(network.parameters())
    untaught = Cloning(network, parameters, lessons, epochs=1, learning_rate=0.0).run()
    assert Cloning(network, parameters, lessons, batch_size=64).run() < 0.4 * untaught


def test_demonstrations_are_parted_where_cuts_begin_and_none_is_lost():
    shown = np.arange(24, dtype=np.float32).reshape(6, 2, 2)
    begun = np.zeros((6, 2), bool)
    begun[0] = begun[2, 1] = begun[5, 0] = True
    lessons = Demonstrations(shown, -shown, begun, shown, shown[..., 0]).by_cut()
    assert [len(cut) for cut in lessons.observations] == [5, 1, 2, 4]
    assert lessons.observations[2].tolist() == shown[:2, 1].tolist()
    assert sorted(torch.cat(lessons.observations).flatten().tolist()) == list(range(24))
    assert all(torch.equal(one, -other) for one, other in zip(lessons.observations, lessons.actions, strict=True))


def test_what_pads_a_batch_of_cuts_counts_for_nothing():
    cuts = [torch.full((length, 1), float(length)) for length in (2, 5, 9)]
    lessons = CutDataset(cuts, [torch.cat((cut, cut), dim=1) for cut in cuts])
    assert lessons.count(batch_size=1000) == 1
    (shown, taught, counts) = next(lessons.batches(1000, torch.Generator()))
    assert shown.shape == (9, 3, 1)
    assert counts.sum() == 16
    assert ((taught - 7.0) ** 2).mean(-1)[counts == 0].min() == 49.0  # padded by zeros
    network = torch.nn.Linear(1, 2)  # the error of a bias alone is that of the 16 decisions
    with torch.no_grad():
        network.weight.zero_()
        network.bias.fill_(7.0)
    expected = np.sqrt((2 * 25.0 + 5 * 4.0 + 9 * 4.0) / 16)
    assert Cloning(network, [network.bias], lessons, epochs=1, learning_rate=0.0).run() == pytest.approx(expected)
