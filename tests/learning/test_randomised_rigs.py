"""Rigs drawn at random: their constants stay in the ranges of the parameter table, and they step like single ones."""

import numpy as np
import pytest

from cutenv._base.validation import parameter_table
from cutenv.learning.arguments import BadArguments, PPOArguments
from cutenv.learning.randomised_rigs import RANDOM_GROUPS, RandomisedRigs, random_rigs
from cutenv.sb3 import FeatureVecEnv

ARGUMENTS = PPOArguments(environments=7, rigs=3, demonstrations=0)


def test_the_first_rig_is_the_default_one_and_the_others_are_drawn_within_the_ranges():
    rigs = random_rigs(40, seed=5)
    assert rigs[0] == {}
    assert rigs == random_rigs(40, seed=5)
    assert rigs != random_rigs(40, seed=6)
    swept = [row for row in parameter_table(*RANDOM_GROUPS) if row["sensitivity"]]
    assert {"force_noise", "force_delay", "depth_noise", "motor_lag"} <= {row["name"] for row in swept}
    for row in swept:
        values = [rig[row["name"]] for rig in rigs[1:]]
        ends = sorted((row["default"], *row["sensitivity"]))
        assert ends[0] <= min(values) < max(values) <= ends[-1]
        assert max(values) - min(values) > 0.5 * (ends[-1] - ends[0])


def test_rigs_that_step_together_are_bit_for_bit_those_that_step_alone():
    together = ARGUMENTS.training_environments()
    assert isinstance(together, RandomisedRigs)
    rigs = random_rigs(3, ARGUMENTS.seed)
    alone = [
        FeatureVecEnv(seeds, hidden_state=True, history=0, **{**ARGUMENTS.environment, **rig})
        for seeds, rig in zip(([0, 1, 2], [3, 4], [5, 6]), rigs, strict=True)
    ]
    for environments in (together, *alone):
        environments.first_episode = 2
    assert (together.reset() == np.concatenate([one.reset() for one in alone])).all()
    rng = np.random.default_rng(0)
    for _ in range(120):
        actions = rng.uniform(-0.2, 1.0, (7, 2)).astype(np.float32)
        shown, rewards, ended, _ = together.step(actions)
        single = [one.step(own) for one, own in zip(alone, np.split(actions, [3, 5]), strict=True)]
        assert (shown == np.concatenate([one[0] for one in single])).all()
        assert (rewards == np.concatenate([one[1] for one in single])).all()
        assert (ended == np.concatenate([one[2] for one in single])).all()
    assert together.cuts == sum(one.cuts for one in alone) > 7
    assert together.observations.shape == (7, 12)


def test_more_rigs_than_environments_are_refused():
    with pytest.raises(BadArguments, match="--rigs 9 needs as many --environments; 7 are too few"):
        PPOArguments(environments=7, rigs=9)


def test_options_and_seeds_reach_every_rig():
    together = ARGUMENTS.training_environments()
    assert together.seed(40) == list(range(7))
    together.set_options([{"target_length": 0.06 + 0.005 * n} for n in range(7)])
    together.reset()
    lengths = np.concatenate([part.native.cuts.tasks["target"] for part in together.parts])
    np.testing.assert_allclose(lengths, 0.06 + 0.005 * np.arange(7))
    together.set_options({"target_length": 0.09})
    together.reset()
    assert all((part.native.cuts.tasks["target"] == 0.09).all() for part in together.parts)
