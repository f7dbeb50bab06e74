"""The native vector environment: bit for bit what single environments do, and Gymnasium's conventions."""

from __future__ import annotations

import os
from typing import Any

import gymnasium
import numpy as np
import pytest
from batches import ENVIRONMENT, SHORT, N, actions, both, check_same, run_both
from gymnasium.vector import AutoresetMode
from numpy.testing import assert_array_equal

import cutenv  # noqa: F401  registers the environment
from cutenv._engine import parallel
from cutenv.sim.cutting.row import LANES
from cutenv.sim.tissue import Specimen, measured_liver
from cutenv.task.observation import in_units, to_action


def test_it_stays_so_with_the_default_rate_and_deadline_to_all_ends():
    ended, ends = run_both(*both(num_envs=3, force_limit_per_depth=500.0), steps=2500)
    assert ended >= 6
    assert {"overshoot", "force_limit"} <= ends


ROWS = [
    {"drive": "hand"},
    {"force_drift": 0.02},
    {"backlash": 2e-4, "dead_time": 0.007, "control_hz": 40},
    {"reward_from": "estimate"},
    {"force_noise": 0.0, "force_resolution": 0.0, "force_delay": 0.0},
    {"force_limit_per_depth": 400.0, "control_hz": 125},
]


@pytest.mark.parametrize("keywords", ROWS, ids=lambda keywords: ", ".join(keywords))
def test_it_is_so_for_rows_of_cuts_and_for_every_drive_and_sensor(keywords):
    """More cuts than a row holds, not a whole number of rows, ending at different times."""
    count = LANES + 5
    keywords = SHORT | keywords
    steps = round(1.5 * keywords["deadline_s"] * keywords["control_hz"])
    ended, _ = run_both(*both("NextStep", count, **keywords), steps=steps)
    assert ended >= count


@pytest.mark.parametrize("keywords", [{}, {"reward_from": "estimate"}, {"drive": "hand", "target_length": 0.05}])
def test_a_cut_that_starts_before_the_target_starts_unloaded_and_at_rest(keywords):
    envs = gymnasium.make_vec(ENVIRONMENT, num_envs=3, start_before_target=0.015, **keywords)
    seen, info = envs.reset(seed=5)
    known = in_units(seen)
    np.testing.assert_allclose(known["distance"], 0.015, atol=1e-8)
    np.testing.assert_allclose(known["position"], info["truth"]["target_length_m"] - 0.015, atol=1e-7)
    assert_array_equal(info["truth"]["tip_m"], info["truth"]["blade_m"])
    assert not known["speed"].any()
    assert not known["force"].any()
    _, rewards, _, _, later = envs.step(np.zeros((3, 2), np.float32))
    assert_array_equal(later["truth"]["blade_m"], info["truth"]["blade_m"])
    assert not later["energy"]["stored"].any()
    np.testing.assert_allclose(rewards, -0.1 * 0.02 / 30.0)  # time alone


def test_progress_counts_what_is_gained_from_the_start():
    env = gymnasium.make(ENVIRONMENT, start_before_target=0.01, target_length=0.08, specimen_class="uniform")
    env.reset(seed=1)
    ended, gained = False, 0.0
    while not ended:
        _, _, ended, _, info = env.step(to_action(0.02, 0.5 * np.pi))
        gained += info["reward_terms"]["progress"]
    assert gained == pytest.approx(0.6 * 0.01 / 0.08)


def test_rest_far_from_the_target_ends_no_cut():
    native, singles = both(num_envs=2)
    for env in (native, singles):
        env.reset(seed=3)
    for step in range(400):
        speed = 0.0127 if step < 100 else (-0.005 if step < 200 else 0.0)
        action = np.tile(to_action(speed, 0.5 * np.pi), (2, 1))
        seen, *_, ended, _, info = native.step(action)
        np.testing.assert_array_equal(seen, singles.step(action)[0])
        assert not ended.any(), info
    known = in_units(seen)
    assert np.all(known["position"] > 0.01)
    assert np.all(known["distance"] > 0.02)
    assert np.all(np.abs(known["speed"]) < 0.5e-3)
    assert np.all(known["force"] < 0.1)


def test_a_cut_that_has_finished_is_told_so():
    native, singles = both(num_envs=2, deadline_s=20.0, target_length=0.06)
    for env in (native, singles):
        env.reset(seed=3)
    for step in range(600):
        speed = 0.0127 if step < 210 else (-0.0127 if step < 290 else 0.0)
        action = np.tile(to_action(speed, 0.5 * np.pi), (2, 1))
        ours, theirs = native.step(action), singles.step(action)
        check_same(ours[4], theirs[4])
        if "end" in ours[4]:
            assert "finished" in ours[4]["end"]
            return
    pytest.fail("no cut was finished")


def test_the_order_and_size_of_a_batch_do_not_matter():
    small, large = (gymnasium.make_vec(ENVIRONMENT, num_envs=n, **SHORT) for n in (3, 200))
    small.reset(seed=10)
    large.reset(seed=0)
    rng = np.random.default_rng(2)
    for _ in range(100):
        action = actions(rng, 200)
        ours, theirs = large.step(action), small.step(action[10:13])
        for one, other in zip(ours[:4], theirs[:4], strict=True):
            assert_array_equal(one[10:13], other)


@pytest.fixture
def _own_cores():
    before = parallel.cores()
    yield
    parallel.set_cores(before)


@pytest.mark.usefixtures("_own_cores")
def test_the_number_of_cores_does_not_matter():
    answers = []
    for count in (1, 3):
        parallel.set_cores(count)
        env = gymnasium.make_vec(ENVIRONMENT, num_envs=100, **SHORT)
        rng = np.random.default_rng(4)
        seen = [env.reset(seed=0)[0]]
        for _ in range(60):
            observations, rewards, *_ = env.step(actions(rng, 100))
            seen += [observations, rewards]
        answers.append(seen)
    for one, other in zip(*answers, strict=True):
        assert_array_equal(one, other)


def test_a_batch_works_in_a_forked_process():
    """Threads are not inherited; a fork makes its own."""
    env = gymnasium.make_vec(ENVIRONMENT, num_envs=100, **SHORT)
    env.reset(seed=0)
    expected = env.step(np.full((100, 2), 0.5, np.float32))[0]
    child = os.fork()
    if child == 0:
        env.reset(seed=0)
        same = np.array_equal(env.step(np.full((100, 2), 0.5, np.float32))[0], expected)
        os._exit(0 if same else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_the_mode_is_declared():
    for mode in AutoresetMode:
        env = gymnasium.make_vec(ENVIRONMENT, num_envs=2, autoreset_mode=mode)
        assert env.metadata["autoreset_mode"] == mode
    assert gymnasium.make_vec(ENVIRONMENT, num_envs=2).metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP


def test_without_autoreset_masks_reset_the_environments_they_name():
    env = gymnasium.make_vec(ENVIRONMENT, num_envs=3, autoreset_mode="Disabled", deadline_s=1.0)
    single = gymnasium.make(ENVIRONMENT, deadline_s=1.0)
    env.reset(seed=4)
    still = np.zeros((3, 2), np.float32)
    for _ in range(50):
        observations, _, terminated, _, _ = env.step(still)
    assert terminated.all()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(still)
    mask = np.array([False, True, False])
    fresh, info = env.reset(options={"reset_mask": mask})
    assert_array_equal(fresh[~mask], observations[~mask])
    assert_array_equal(info["_truth"], mask)
    single.reset(seed=5)
    expected, expected_info = single.reset()  # the next episode of seed 5
    assert_array_equal(fresh[1], expected)
    assert info["truth"]["target_length_m"][1] == expected_info["truth"]["target_length_m"]
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(still)
    env.reset(options={"reset_mask": ~mask})
    env.step(still)


def test_options_of_reset_are_those_of_a_single_environment():
    specimen = Specimen.homogeneous(modulus=4e4, fracture_resistance=150.0, depth=0.015)
    for options in (
        {"target_length": 0.065},
        {"episode": 6},
        {"specimen": specimen},
        {"specimen": specimen.to_json(), "target_length": 0.08},
    ):
        native, singles = both()
        ours, theirs = (env.reset(seed=2, options=dict(options)) for env in (native, singles))
        assert_array_equal(ours[0], theirs[0])
        check_same(ours[1], theirs[1])
        for _ in range(5):
            action = np.full((N, 2), 0.3, np.float32)
            check_same(native.step(action)[4], singles.step(action)[4])


def test_options_of_one_reset_are_forgotten_by_the_next():
    native, singles = both(**SHORT)
    for env in (native, singles):
        env.reset(seed=2, options={"target_length": 0.065})
    rng = np.random.default_rng(3)
    for _ in range(90):
        action = actions(rng)
        assert_array_equal(native.step(action)[0], singles.step(action)[0])


def test_a_tissue_or_a_specimen_from_a_file_is_cut(tmp_path):
    tissue, specimen = tmp_path / "tissue.json", tmp_path / "specimen.json"
    tissue.write_text(measured_liver().to_json())
    specimen.write_text(Specimen.drawn(3).to_json())
    for path in (tissue, specimen):
        ended, _ = run_both(*both(tissue=str(path), **SHORT), steps=60)
        assert ended > 0


def test_seeds_can_be_given_one_by_one_and_none_goes_on():
    native, singles = both()
    for env in (native, singles):
        env.reset(seed=[5, 9, 5, 1, 0])
    ours, theirs = (env.reset(seed=[None, 9, None, None, 3]) for env in (native, singles))
    assert_array_equal(ours[0], theirs[0])
    ours, theirs = (env.reset() for env in (native, singles))
    assert_array_equal(ours[0], theirs[0])


def test_without_a_seed_environments_differ():
    env = gymnasium.make_vec(ENVIRONMENT, num_envs=50)
    observations, _ = env.reset()
    assert len(np.unique(observations[:, 8])) == 50


@pytest.mark.parametrize(
    ("ask", "error", "named"),
    [
        (lambda: gymnasium.make_vec(ENVIRONMENT, num_envs=0), ValueError, "num_envs = 0"),
        (lambda: gymnasium.make_vec(ENVIRONMENT, num_envs=2, autoreset_mode="samestep"), ValueError, "SameStep"),
        (lambda: gymnasium.make_vec(ENVIRONMENT, num_envs=2, render_mode="rgb_array"), ValueError, "render_mode"),
        (lambda: gymnasium.make_vec(ENVIRONMENT, num_envs=2, specimen_clas="liver"), TypeError, "specimen_class"),
        (
            lambda: gymnasium.make_vec(ENVIRONMENT, num_envs=2).step(np.zeros((2, 2))),
            gymnasium.error.ResetNeeded,
            "reset",
        ),
        (lambda: begun().step(np.zeros((3, 2))), ValueError, r"shape \(3, 2\)"),
        (lambda: begun().step(np.array([[0.0, 0.0], [np.nan, 0.0]])), ValueError, r"actions\[1\]"),
        (lambda: begun().reset(seed=[1, 2, 3]), ValueError, "3 numbers"),
        (lambda: begun().reset(seed=-1), (ValueError, gymnasium.error.Error), "-1"),
        (lambda: begun().reset(options={"reset_mask": [True, False]}), ValueError, "reset_mask"),
        (lambda: begun().reset(options={"reset_mask": np.zeros(2, bool)}), ValueError, "no environment"),
        (lambda: begun().reset(options={"specimn": 1}), ValueError, "specimen"),
    ],
)
def test_bad_input_is_refused_by_name(ask, error, named):
    with pytest.raises(error, match=named):
        ask()


def begun() -> Any:
    """Two environments at their start."""
    env = gymnasium.make_vec(ENVIRONMENT, num_envs=2)
    env.reset(seed=0)
    return env


def test_a_refused_action_changes_nothing():
    env, other = begun(), begun()
    with pytest.raises(ValueError, match="NaN"):
        env.step(np.array([[0.5, 0.0], [np.nan, 0.0]]))
    action = np.full((2, 2), 0.5, np.float32)
    assert_array_equal(env.step(action)[0], other.step(action)[0])


def test_the_answers_of_a_step_are_left_alone_by_the_next():
    env = begun()
    answer = env.step(np.full((2, 2), 0.5, np.float32))
    kept = [value.copy() for value in answer[:4]]
    tip, work = answer[4]["truth"]["tip_m"].copy(), answer[4]["energy"]["work"].copy()
    for _ in range(50):
        env.step(np.full((2, 2), 0.5, np.float32))
    for value, copy in zip(answer[:4], kept, strict=True):
        assert_array_equal(value, copy)
    assert_array_equal(answer[4]["truth"]["tip_m"], tip)
    assert_array_equal(answer[4]["energy"]["work"], work)
