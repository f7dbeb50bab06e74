"""The environment keeps Gymnasium's promises: checkers, seeds, copies, bad actions and the end of an episode."""

from __future__ import annotations

import math

import gymnasium
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env as gymnasium_check
from stable_baselines3.common.env_checker import check_env as sb3_check
from whole_cut import cut, make, steady

from cutenv.agents.policy import ConstantFeed
from cutenv.agents.policy.interface import to_actions
from cutenv.task.observation import DEAD_ZONE, commanded_speed, in_units, to_action


def actions(count: int, seed: int = 0) -> np.ndarray:
    """Random commands that mostly cut: an episode of 6 s cuts several units."""
    rng = np.random.default_rng(seed)
    return rng.uniform((-0.3, -1.0), (1.0, 1.0), size=(count, 2)).astype(np.float32)


def identical(a, b) -> bool:
    """Exact equality, through dictionaries and arrays."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(identical(a[key], b[key]) for key in a)
    if isinstance(a, (tuple, list)):
        return len(a) == len(b) and all(identical(x, y) for x, y in zip(a, b, strict=True))
    return np.array_equal(a, b)


def play(env, commands):
    """Step through ``commands``, resetting without a seed at every end; everything that came back."""
    record = []
    for command in commands:
        record.append(env.step(command))
        if record[-1][2]:
            record.append(env.reset())
    return record


@pytest.mark.parametrize("render_mode", ["rgb_array", None])
@pytest.mark.filterwarnings("error")
def test_the_checkers_pass_with_pictures_too(render_mode):
    pytest.importorskip("pygame")
    env = make(render_mode=render_mode)
    sb3_check(env.unwrapped, skip_render_check=False)
    gymnasium_check(env.unwrapped)
    env.close()


@pytest.mark.parametrize("drive", ["rig", "hand"])
@pytest.mark.parametrize("reward_from", ["truth", "estimate"])
def test_two_seeded_copies_agree_exactly_within_and_across_episodes(reward_from, drive):
    keywords = {"reward_from": reward_from, "drive": drive, "deadline_s": 6.0}
    one, other = make(**keywords), make(**keywords)
    commands = actions(700)
    assert identical(one.reset(seed=3), other.reset(seed=3))
    mine, theirs = play(one, commands), play(other, commands)
    assert sum(len(entry) == 2 for entry in mine) >= 2, "the commands must span several episodes"
    assert mine[-1][4]["truth"]["units"] > 0, "the commands must cut"
    assert identical(mine, theirs)


def test_a_seed_gives_the_same_cut_again_after_other_cuts():
    env = make(deadline_s=6.0)
    commands = actions(700)
    first = [env.reset(seed=11), *play(env, commands)]
    env.reset(seed=4)
    play(env, commands[::-1])
    again = [env.reset(seed=11), *play(env, commands)]
    assert identical(first, again)


def test_other_seeds_and_other_episodes_are_other_specimens():
    env = make(specimen_class="liver")
    met = []
    for seed in (0, 1, 2, None, None):
        env.reset(seed=seed)
        met.append((env.unwrapped.specimen.modulus[100], env.unwrapped.cutting.target_length))
    assert len(set(met)) == len(met)


def test_an_environment_without_a_seed_takes_a_fresh_one():
    lengths = {make().reset()[1]["truth"]["target_length_m"] for _ in range(3)}
    assert len(lengths) == 3


def test_any_episode_of_a_seed_can_be_met_again_by_its_number():
    env, other = make(), make()
    env.reset(seed=5)
    env.reset()
    third = env.reset()
    other.reset(seed=5, options={"episode": 2})
    assert identical(third, other.reset(seed=5, options={"episode": 2}))
    commands = actions(60)
    assert identical(play(env, commands), play(other, commands))


def test_noise_differs_between_episodes_of_the_same_specimen():
    env = make(tissue=None, specimen_class="uniform", target_length=0.08)
    env.reset(seed=0)
    first = [step[0] for step in play(env, np.zeros((5, 2), np.float32))]
    env.reset()
    second = [step[0] for step in play(env, np.zeros((5, 2), np.float32))]
    assert not identical(first, second)


def test_the_spec_goes_through_json_and_makes_the_same_environment():
    keywords = {"specimen_class": "liver", "control_hz": 100, "weight_jump": 0.2, "acceleration": 0.2}
    env = make(**keywords)
    spec = EnvSpec.from_json(env.spec.to_json())
    twin = gymnasium.make(spec)
    assert spec.kwargs == keywords
    commands = actions(100)
    assert identical([env.reset(seed=1), *play(env, commands)], [twin.reset(seed=1), *play(twin, commands)])


@pytest.mark.parametrize(
    ("action", "clipped"),
    [
        ([2.0, 0.5], [1.0, 0.5]),
        ([-7.0, -3.0], [-1.0, -1.0]),
        ([np.inf, -np.inf], [1.0, -1.0]),
        ([0.3, 90.0], [0.3, 1.0]),
    ],
)
def test_an_action_out_of_range_is_its_clipped_self(action, clipped):
    env, twin = make(), make()
    env.reset(seed=0)
    twin.reset(seed=0)
    for _ in range(20):
        assert identical(env.step(np.array(action, np.float32)), twin.step(np.array(clipped, np.float32)))


@pytest.mark.parametrize("speed", [-0.1, -0.05, 1e-6, 0.08, 0.1])
def test_an_action_in_the_dead_zone_holds_the_blade_still_and_the_next_one_beyond_moves_it(speed):
    env, batch = make().unwrapped, gymnasium.make_vec("cutenv/GentleCut-v1", num_envs=2)
    env.reset(seed=0)
    batch.reset(seed=0)
    for action in (to_action(0.02, 1.0), np.float32([speed, 1.0]), np.float32([math.copysign(0.11, speed), 1.0])):
        for _ in range(60):
            seen = env.step(action)[0]
            assert np.array_equal(batch.step(np.tile(action, (2, 1)))[0][0], seen)
        assert in_units(seen)["last_speed"] == action[0]
        assert (abs(env.cutting.readings["speed"][-1]) < 1e-9) == (abs(action[0]) <= np.float32(0.1))


@pytest.mark.parametrize("speed", [-0.0254, -0.01, -0.001, -1e-5, 0.0, 1e-5, 0.001, 0.0127, 0.0254])
def test_to_action_gives_the_action_that_commands_a_speed(speed):
    action = to_action(speed, 1.0)
    assert commanded_speed(float(action[0])) == pytest.approx(speed, abs=2e-9)
    assert np.array_equal(to_actions(np.array([speed]), 1.0)[0], action)
    assert action[0] == 0.0 if speed == 0.0 else abs(action[0]) > DEAD_ZONE
    env, batch = make(force_limit_per_depth=1e5), gymnasium.make_vec("cutenv/GentleCut-v1", num_envs=1)
    env.reset(seed=0)
    batch.reset(seed=0)
    for command in 75 * [to_action(0.02, 1.0)] + 60 * [action]:
        env.step(command)
        batch.step(command[None])
    assert env.unwrapped.cutting.readings["speed"][-1] == pytest.approx(speed, abs=1e-6)
    assert batch.unwrapped.cuts.states["speed"][0] == pytest.approx(speed, abs=1e-6)


def test_no_step_before_a_reset_nor_after_the_end():
    bare = make().unwrapped
    with pytest.raises(ResetNeeded, match="reset"):
        bare.step(np.zeros(2, np.float32))
    for env in (make(deadline_s=1.0), make(deadline_s=1.0).unwrapped):
        env.reset(seed=0)
        for _ in range(50):
            ended = env.step(np.zeros(2, np.float32))[2]
        assert ended
        with pytest.raises(ResetNeeded, match="reset"):
            env.step(np.zeros(2, np.float32))
        env.reset()
        env.step(np.zeros(2, np.float32))


@pytest.mark.parametrize("control_hz", [1, 20, 1000])
def test_observations_are_finite_new_and_inside_their_space(control_hz):
    env = make(control_hz=control_hz, deadline_s=3600.0, force_noise=1.0, force_limit_per_depth=1e5)
    seen = [env.reset(seed=0)[0]]
    seen += [entry[0] for entry in play(env, actions(200))]
    kept = [observation.copy() for observation in seen]
    env.step(actions(1)[0])
    for observation, copied in zip(seen, kept, strict=True):
        assert env.observation_space.contains(observation)
        assert np.isfinite(observation).all()
        assert np.array_equal(observation, copied), "an observation must not change after it was returned"


def test_most_of_what_is_seen_lies_within_one_so_that_default_networks_learn():
    seen = np.concatenate([cut(make(), ConstantFeed(speed=0.0127), seed).observations for seed in range(10)])
    assert np.percentile(np.abs(seen), 95) < 1.1
    assert np.abs(seen).max() < 10.0, "nothing of a usual cut is clipped"


def test_decisions_come_at_control_hz_and_force_at_1_kHz():
    for control_hz, ticks in ((50, 20), (10, 100), (1000, 1)):
        env = make(control_hz=control_hz)
        env.reset(seed=0)
        env.step(steady_action())
        readings = env.unwrapped.cutting.readings
        assert len(readings) == ticks
        assert readings["time"][-1] == pytest.approx(1.0 / control_hz)


def steady_action() -> np.ndarray:
    policy = steady(0.01)
    policy.reset(np.random.default_rng(0))
    return policy(np.zeros(12, np.float32))
