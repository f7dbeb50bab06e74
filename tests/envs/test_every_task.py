"""Every environment keeps Gymnasium's promises: checkers, seeds, copies, batches, sums, limits, infos and refusals."""

from __future__ import annotations

import copy
import inspect
import itertools
import math
import pickle

import gymnasium
import numpy as np
import pytest
from batches import SHORT, N, both, run_both
from gymnasium.utils.env_checker import check_env as gymnasium_check
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.env_checker import check_env as sb3_check

import cutenv  # noqa: F401  registers the environments
from cutenv.envs import gentle_cut, vector
from cutenv.envs.gymnasium_facts import flat_info
from cutenv.sim.tissue.lines import half_ellipse
from cutenv.sim.tissue.specimen import CLASSES
from cutenv.task.observation import COMPONENTS
from cutenv.task.registry import TASKS

TRACKS = ("cutenv/SafeCut-v1", "cutenv/GentleCutRaw-v1")
IDS = [*(task.id for task in TASKS.values()), "cutenv/FreeCut-v1", *TRACKS]
REGISTERED = sorted(name for name in gymnasium.registry if name.startswith("cutenv/"))
MODES = itertools.product(CLASSES, ("free", "fixed"), ("truth", "estimate"), ("rig", "hand"))
NAMES = ("specimen_class", "angle_mode", "reward_from", "drive")
every = pytest.mark.parametrize("environment", IDS)
adds = pytest.mark.parametrize("task", ["depth", "path"])


def made(environment, **keywords):
    """Make an environment whose cuts last 3 s at 20 Hz; a track has its own rate and time."""
    short = {} if environment in TRACKS else {"deadline_s": 3.0, "control_hz": 20}
    return gymnasium.make(environment, **short, **keywords)


def actions(env, count, seed=0):
    """Return random commands that mostly cut."""
    low, high = (-0.3, -1.0, -0.3), (1.0, 1.0, 0.3)
    size = env.action_space.shape[0]
    return np.random.default_rng(seed).uniform(low[:size], high[:size], (count, size)).astype(np.float32)


@pytest.mark.parametrize(
    ("environment", "keywords"),
    [
        *((environment, {}) for environment in IDS),
        ("cutenv/GentleCutRaw-v1", {"hidden_state": True}),
        *((IDS[0], dict(zip(NAMES, mode, strict=True))) for mode in MODES),
    ],
)
@pytest.mark.filterwarnings("error")
def test_both_checkers_pass_without_a_warning(environment, keywords):
    env = gymnasium.make(environment, **keywords).unwrapped
    gymnasium_check(env, skip_render_check=True)
    sb3_check(env)


@every
def test_a_cut_is_the_same_again_its_terms_are_its_return_and_its_account_closes(environment):
    env, again = made(environment), made(environment)
    (seen, _), (same, _) = env.reset(seed=3), again.reset(seed=3)
    total, ended, steps = 0.0, False, iter(actions(env, 300))
    while not ended:
        np.testing.assert_array_equal(seen, same)
        action = next(steps)
        (seen, reward, ended, truncated, info), (same, *rest) = env.step(action), again.step(action)
        assert [reward, ended, truncated, info] == rest
        total += reward
        energy = info["energy"]
        assert sum(info["reward_terms"].values()) == pytest.approx(reward, abs=1e-12)
        assert abs(energy["residual"]) <= 1e-12 * max(energy["work"], 1e-3)
        assert min(energy["work"] - energy["friction"] - energy["stored"], energy["loss"]) > -1e-12
        assert min(energy["fracture"], energy["stored"]) >= -1e-15
    cutting = env.unwrapped.cutting
    assert tuple(info["reward_terms"]) == env.unwrapped.task.all_terms
    assert sum(cutting.reward_totals.values()) == pytest.approx(total, abs=1e-9)


@every
@pytest.mark.parametrize(
    "duplicate", [lambda env: pickle.loads(pickle.dumps(env)), copy.deepcopy], ids=["pickle", "copy"]
)
def test_a_copy_in_the_middle_of_a_cut_goes_on_as_the_cut_does(environment, duplicate):
    """A copy of the declaration would have its kernels made again, and its formulas cannot be pickled."""
    env = made(environment)
    env.reset(seed=2)
    commands = actions(env, 50)
    for action in commands[:30]:
        env.step(action)
    twin = duplicate(env)
    own, other = env.unwrapped, twin.unwrapped
    assert other.task is own.task
    assert other.cutting.task is own.cutting.task
    assert other.plant.motion is own.plant.motion
    for action in commands[30:]:
        (seen, *rest), (again, *same) = env.step(action), twin.step(action)
        np.testing.assert_array_equal(seen, again)
        assert rest == same
    assert other.cutting.record.tobytes() == own.cutting.record.tobytes()


VECTORS = [
    *({}, {"specimen_class": "uniform"}, {"reward_from": "estimate"}, {"force_limit_per_depth": 300.0}),
    {"specimen_class": "vascular", "angle_mode": "fixed", "fixed_angle_deg": 60.0},
    {"specimen_class": "liver", "drive": "hand", "target_length": 0.07},
    {"force_drift": 0.02, "force_delay": 0.003, "weight_jump": 0.7, "depth_noise": 0.002},
    {"start_before_target": 0.02},
    {"start_before_target": 0.005, "reward_from": "estimate", "drive": "hand", "specimen_class": "uniform"},
]
OF_TASKS = [
    *(("depth", {"wanted": kind}) for kind in ("mixed", "profile")),
    *(("path", line) for line in ({}, {"line": "excision", "start_before_target": 0.03}, {"line": half_ellipse()})),
    ("hand-excision", {}),
]
EITHER = itertools.cycle(("NextStep", "SameStep"))
BATCHES = [
    *((IDS[0], mode, SHORT | {"flat_info": True}) for mode in ("NextStep", "SameStep", "Disabled")),
    *((IDS[0], next(EITHER), SHORT | keywords) for keywords in VECTORS),
    *((TASKS[task].id, next(EITHER), SHORT | keywords) for task, keywords in OF_TASKS),
    *((TASKS[task].id, "NextStep", SHORT | {"flat_info": True}) for task in ("depth", "path")),
    (TRACKS[0], "NextStep", {}),
    (TRACKS[1], "SameStep", {}),
    (TRACKS[1], "Disabled", {"hidden_state": True}),
]


@pytest.mark.parametrize(("environment", "mode", "keywords"), BATCHES)
def test_a_batch_is_bit_for_bit_single_environments_over_whole_episodes(environment, mode, keywords):
    ended, _ = run_both(*both(AutoresetMode(mode), id=environment, **keywords), steps=160 if keywords else 250)
    assert ended >= N


@every
@pytest.mark.parametrize("kind", ["too few", "nan", "nested"])
def test_a_bad_action_is_refused_with_the_names_of_its_numbers_and_changes_nothing(environment, kind):
    env, untouched = made(environment), made(environment)
    env.reset(seed=0)
    untouched.reset(seed=0)
    good = actions(env, 1)[0]
    bad = {"too few": good[:-1], "nan": np.append(good[:-1], np.float32(math.nan)), "nested": good[np.newaxis]}[kind]
    with pytest.raises(ValueError, match=f"must hold .* numbers.*{', '.join(env.unwrapped.task.action_names)}"):
        env.unwrapped.step(bad)
    np.testing.assert_array_equal(env.step(good)[0], untouched.step(good)[0])
    if environment != "cutenv/FreeCut-v1":  # which has no batch of its own
        batch = gymnasium.make_vec(environment, num_envs=1)
        batch.reset(seed=0)
        with pytest.raises(ValueError, match=r"speed(, | and )angle"):
            batch.step(bad[np.newaxis])


@pytest.mark.parametrize("environment", REGISTERED)
def test_the_spec_tells_the_decisions_of_a_cut(environment):
    env = gymnasium.make(environment, **({"rig": "fake"} if "Rig" in environment else {}))
    decisions = round(30.0 * env.unwrapped.metadata["render_fps"])
    assert env.spec.max_episode_steps == env.unwrapped.spec.max_episode_steps == decisions
    env.close()


@pytest.mark.parametrize("environment", REGISTERED)
def test_an_unknown_keyword_is_the_type_error_of_python(environment):
    known = r"(help\(\w+\) lists what it takes|It takes .*render_mode)"
    said = rf"^\w+\.__init__\(\) got an unexpected keyword argument 'frameskip'\. {known}"
    with pytest.raises(TypeError, match=said):
        gymnasium.make(environment, frameskip=4)
    with pytest.raises(TypeError, match=said):
        gymnasium.make_vec(environment, num_envs=2, frameskip=4)


def leaves(info, path=()):
    """Yield the entries of nested dictionaries by path."""
    for name, value in info.items():
        yield from leaves(value, (*path, name)) if isinstance(value, dict) else [((*path, name), value)]


@every
def test_with_flat_info_every_entry_is_there_as_a_number_at_every_step(environment):
    flat, nested = made(environment, flat_info=True), made(environment)
    ends = flat.unwrapped.task.ends
    (_, info), (_, whole) = flat.reset(seed=3), nested.reset(seed=3)
    names, ended = set(info), False
    for action in np.full((60, *flat.action_space.shape), 0.3, np.float32):
        expected = {"_".join(path): value for path, value in leaves(whole)}
        expected["truth_specimen_class"] = CLASSES.index(expected["truth_specimen_class"])
        expected["end"] = ends.index(expected.get("end", ""))
        assert info == {"is_success": 0, **expected}
        assert set(info) == names
        assert {type(value) for value in info.values()} <= {np.float64, np.int64}
        if ended:
            break
        (_, _, ended, _, info), whole = flat.step(action), nested.step(action)[-1]
    assert ended or environment in TRACKS


def test_the_end_of_a_success_is_a_number_and_flat_info_is_true_or_false():
    told = flat_info({"cost": 0.0, "end": "finished", "is_success": True}, ("", "deadline", "finished"))
    assert told == {"end": 2, "is_success": 1, "cost": 0.0}
    with pytest.raises(ValueError, match="flat_info must be one of False, True, got 'yes'"):
        gymnasium.make(IDS[0], flat_info="yes")


@adds
def test_the_docstring_has_the_declared_tables(task):
    environment, declared = TASKS[task].single, TASKS[task].task
    doc = " ".join(inspect.getdoc(environment).split())
    assert "{" not in doc
    for number, one in enumerate(declared.components, start=len(COMPONENTS)):
        assert f"{number} {one.name} {one.meaning} {one.unit} {round(one.scale, 4):g} 0" in doc
    for cost in declared.costs:
        assert f"{cost.name} {cost.weight:g} {cost.text}" in doc
    for keyword in environment.options_class.names:
        assert f"``{keyword}``" in doc or f" {keyword} " in doc, keyword


@adds
def test_notice_of_compiling_looks_for_the_kernels_of_the_task(task, monkeypatch):
    """It would else be printed at every start by those who use this task alone."""
    asked = []
    for module in (gentle_cut, vector):
        note = lambda *kernels: asked.append((kernels[0].__name__, kernels[0].__module__))  # noqa: E731
        monkeypatch.setattr(module, "warn_before_first_compile", note)
    declared, alone = f"cutenv.task.{task}", TASKS[task].single()
    alone.reset(seed=0)
    assert asked == [("begin_one", declared)]  # nothing of a step: a planner is shown starts alone
    alone.step(np.zeros(len(alone.task.action_names), np.float32))
    gymnasium.make_vec(TASKS[task].id, num_envs=1)
    assert asked[1:] == [("step_one", declared), ("step_some", declared)]
