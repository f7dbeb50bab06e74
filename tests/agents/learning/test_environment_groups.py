"""Rigs drawn at random: their constants stay in the ranges of the parameter table, and they step like single ones."""

import dataclasses

import numpy as np
import pytest

from cutenv._base.validation import parameter_table
from cutenv.agents.learning.arguments import BadArguments, PPOArguments
from cutenv.agents.learning.environment_groups import (
    NEARER,
    RANDOM_GROUPS,
    EasierEnvironments,
    EnvironmentGroups,
    random_rigs,
)
from cutenv.agents.sb3 import FeatureVecEnv

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
    assert isinstance(together, EnvironmentGroups)
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


EASY = {"task": "path", "history": 0, "control_hz": 10}


def rolled(environments, decisions=400, seed=1):
    """Cut with random actions; return observations, rewards, ends, infos and gains of every decision."""
    rng = np.random.default_rng(seed)
    environments.reset()
    count, told = environments.num_envs, []
    for _ in range(decisions):
        action = rng.uniform((-0.3, 0.0, -0.2), (1.0, 1.0, 0.2), (count, 3)).astype(np.float32)
        told.append((*environments.step(action), np.concatenate([part.gained for part in environments.parts])))
    return told


def test_an_easier_task_charges_less_and_waits_less_at_first_and_becomes_the_task():
    easier = EasierEnvironments(0.5, range(16), **EASY)
    as_it_is = EnvironmentGroups(
        [{}] * 4 + [{"start_before_target": distance} for distance in NEARER], range(16), **EASY
    )
    own = rolled(as_it_is)
    easier.share = 0.5
    for mine, theirs in zip(rolled(easier), own, strict=True):
        np.testing.assert_array_equal(mine[1], theirs[1])
    easier.share = 0.0
    unsafe = 0
    for mine, (shown, rewards, ended, infos, gained) in zip(rolled(easier), own, strict=True):
        np.testing.assert_array_equal(mine[0], shown)  # the cut itself does not differ
        np.testing.assert_array_equal(mine[2], ended)
        waited = np.full(16, 0.1 / 30.0)
        for n in np.flatnonzero(ended):
            assert mine[3][n]["episode"]["r"] == infos[n]["episode"]["r"]
            if infos[n]["end"] not in ("finished", "deadline"):
                waited[n] += 1.0 - infos[n]["episode"]["l"] * 0.1 / 30.0
                unsafe += 1
        np.testing.assert_allclose(mine[1], gained - 0.1 * (gained - rewards) - waited, atol=1e-6)
    assert unsafe > 20


def test_half_of_the_cuts_of_an_easier_task_begin_nearer_and_none_is_over_at_once():
    easier = EasierEnvironments(1.0, range(8), task="excision", control_hz=5)
    easier.reset()
    tips = [float(part.native.batch.cuts.states["tip"][0]) for part in easier.parts]
    assert tips[:4] == [0.0] * 4
    assert min(tips[4:]) > 0.0
    for _ in range(10):
        _, _, ended, _ = easier.step(np.zeros((8, 3), np.float32))
        assert not ended.any()


def test_from_nothing_sets_what_an_actor_that_knows_nothing_needs():
    chosen = PPOArguments.completed(PPOArguments.knowing_nothing({"task": "excision"}))
    arguments = PPOArguments(**chosen)
    assert arguments.correction == {}
    assert arguments.demonstrations == 0
    assert arguments.easier == 0.5
    assert arguments.sizes["begin"] == [0.3, 0.8, 0.0]
    assert isinstance(dataclasses.replace(arguments, environments=8).training_environments(), EasierEnvironments)
    with pytest.raises(BadArguments, match=r"--easier 0\.5 is for --base none with --demonstrations 0"):
        PPOArguments(easier=0.5)
    with pytest.raises(BadArguments, match="needs at least 8 --environments"):
        dataclasses.replace(arguments, environments=7)
    with pytest.raises(BadArguments, match="leave one out"):
        dataclasses.replace(arguments, rigs=3)
