"""RigCut-v1 is GentleCut on a rig: same spaces, rewards from estimates, ends when the rig's safety stops it."""

from __future__ import annotations

import math
import tomllib
from datetime import datetime

import gymnasium
import numpy as np
import pytest
from scripted_operator import ScriptedOperator

from cutenv.agents.policy import BASELINES
from cutenv.emulation.fake_rig import Faults
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.records import load_one
from cutenv.records.appending import AppendingRecord, RecordingFailed
from cutenv.records.scoring import score
from cutenv.rig.config.settings import fake_settings
from cutenv.rig.devices.protocols import DriveState
from cutenv.rig.errors import RigError
from cutenv.rig.safety.stop_causes import Cause
from cutenv.rig.toml_file import to_toml
from cutenv.task.observation import to_action


def cut(env, name="probe and creep", seed=5, episode=0, until=math.inf):
    """One cut: return, last info, number of decisions."""
    policy = BASELINES[name]()
    observation, info = env.reset(seed=seed, options={"episode": episode})
    policy.reset(np.random.default_rng(0))
    total, decisions, ended = 0.0, 0, False
    while not ended and decisions < until:
        observation, reward, ended, _, info = env.step(policy(observation))
        assert env.observation_space.contains(observation)
        assert sum(info["reward_terms"].values()) == pytest.approx(reward, abs=1e-12)
        total, decisions = total + reward, decisions + 1
    return total, info, decisions


@pytest.fixture
def env():
    env = RigCutEnv(rig="fake")
    yield env
    env.close()


def fake_of(env: RigCutEnv):
    return env.session.plant.spine.sensor._rig


def test_it_has_the_simulators_spaces(env):
    simulated = gymnasium.make("cutenv/GentleCut-v1")
    assert env.observation_space == simulated.observation_space
    assert env.action_space == simulated.action_space


def test_its_arguments_are_flat_and_json_able():
    env = gymnasium.make("cutenv/RigCut-v1", rig="fake", control_hz=10, force_noise=0.0)
    again = gymnasium.make(gymnasium.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.constants.sensor.force_noise == 0.0
    assert again.unwrapped.ticks == 100


SHORT = 0.05
"""Length of the cuts that are compared [m]."""


def check_scores(env, name, monkeypatch, episodes=8):
    """Most of them closely; a reading of noise moves a decision, and now and then a decision a run of the crack."""
    simulated = gymnasium.make("cutenv/GentleCut-v1", reward_from="estimate", target_length=SHORT)
    monkeypatch.setattr("cutenv.rig.operation.session.RETURN_SPEED", 0.025)  # at its own pace longer than the cut
    differences, ends = [], []
    for episode in range(episodes):
        ours, our_info, _ = cut(env, name, episode=episode)
        theirs, their_info, _ = cut(simulated, name, episode=episode)
        ends.append(our_info["end"] == their_info["end"])
        differences.append(abs(ours - theirs))
    assert np.mean(ends) > 0.8
    assert np.median(differences) < 0.05  # a run more or less costs as much
    env.close()


@pytest.mark.parametrize("name", ["probe and creep", "fast then slow"])
def test_the_same_cut_scores_as_in_the_simulator(name, monkeypatch):
    check_scores(RigCutEnv(rig="fake", target_length=SHORT), name, monkeypatch)


def test_a_rig_that_is_slow_and_noisy_does_not(monkeypatch):
    env = RigCutEnv(rig="fake", force_noise=0.3, force_delay=0.06, motor_lag=0.12, target_length=SHORT)
    with pytest.raises(AssertionError):
        check_scores(env, "probe and creep", monkeypatch, episodes=4)


def test_everything_it_tells_is_an_estimate(env):
    _, info, _ = cut(env)
    assert info["estimated"] is True
    assert "truth" not in info
    assert "energy" not in info
    assert info["rig"]["overruns"] == 0
    assert info["rig"]["period_s"] == pytest.approx(0.02)


def test_a_rig_is_commanded_the_speed_of_the_action_and_none_in_its_dead_zone(env, monkeypatch):
    env.reset(seed=0)
    plant, commanded = env.unwrapped.cutting.plant, []
    advance = plant.advance
    monkeypatch.setattr(
        plant, "advance", lambda speed, angle, ticks: commanded.append(speed) or advance(speed, angle, ticks)
    )
    for action in (to_action(0.02, 1.5), to_action(-0.005, 1.5), np.float32([-0.1, 1.0]), np.float32([0.08, 1.0])):
        env.step(action)
    assert commanded == pytest.approx([0.02, -0.005, 0.0, 0.0], abs=1e-8)


def test_a_stop_ends_the_cut_dearly_and_says_why(env):
    cut(env, until=50)
    fake_of(env).faults.extra_force = 30.0
    _, reward, terminated, truncated, info = env.step(np.array([0.625, 1.0], np.float32))
    assert terminated
    assert not truncated
    assert info["end"] == "stopped"
    assert info["is_success"] is False
    assert info["stop"]["cause"] == "force limit"
    assert 0.0 < info["stop"]["time_to_standstill_s"] < 0.1
    assert reward < -0.7  # more than stopping in order could have cost
    assert sum(info["reward_terms"].values()) == pytest.approx(reward, abs=1e-12)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(2, np.float32))


def test_after_a_stop_the_operator_is_asked_before_the_next_cut():
    no = ScriptedOperator([("will move", "fake"), ("was stopped", False)])
    env = RigCutEnv(rig="fake", operator=no)
    cut(env, until=20)
    fake_of(env).faults.force_status = 0x80000000
    assert env.step(np.zeros(2, np.float32))[4]["end"] == "stopped"
    fake_of(env).faults.__dict__.update(vars(Faults()))
    with pytest.raises(RigError, match="not agreed"):
        env.reset(seed=1)
    no.unasked += [("was stopped", True), ("will move", "fake")]
    env.reset(seed=1)
    assert not env.step(np.zeros(2, np.float32))[2]
    env.close()


def test_a_specimen_that_holds_the_blade_at_the_force_limit_is_taken_off_before_the_next_cut():
    env = RigCutEnv(rig="fake", lower_limits={"force": 4.0})
    asked, ready = [], env.session.operator.ask_ready
    env.session.operator.ask_ready = lambda what: asked.append((what, fake_of(env).blade.state)) or ready(what)
    _, info, _ = cut(env, "constant 2.54 cm/s 90 deg", seed=2)
    assert info["stop"]["cause"] == "force limit"
    assert abs(fake_of(env).felt()) > 3.5
    env.reset(seed=3)
    powers = [state for what, state in asked if "Take the specimen off the blade" in what]
    assert powers == [DriveState.DISABLED]  # hands are in the travel
    assert abs(fake_of(env).felt()) < 0.5
    assert not env.step(np.array([0.5, 1.0], np.float32))[2]
    env.close()


def test_while_a_specimen_holds_the_blade_nothing_moves_and_it_is_asked_for_again():
    operator = ScriptedOperator([("will move", "fake"), ("was stopped", True), ("Take the specimen off", False)])
    env = RigCutEnv(rig="fake", operator=operator, lower_limits={"force": 4.0})
    _, info, _ = cut(env, "constant 2.54 cm/s 90 deg", seed=2)
    assert info["stop"]["cause"] == "force limit"
    for again in (False, True):
        operator.unasked = operator.unasked or [("Take the specimen off", False)] * again
        with pytest.raises(RigError, match="the specimen still holds the blade: nothing moves"):
            env.reset(seed=3)
        assert fake_of(env).blade.state is DriveState.DISABLED
        fake_of(env).clock.sleep_until(fake_of(env).clock.now() + 0.05)  # until the samples say so
    operator.unasked = [("Take the specimen off", True), ("will move", "fake")]
    env.reset(seed=3)
    assert not env.step(np.array([0.5, 1.0], np.float32))[2]
    env.close()


def test_the_way_back_is_slow_and_the_specimen_new(env):
    cut(env, episode=0)
    fake = fake_of(env)
    speeds, began = [], fake.bench
    fake.clock.every(0.001, lambda now: speeds.append(fake.bench.motion[1]) if fake.bench is began else None, "look")
    env.reset(options={"episode": 1})
    assert min(speeds) == pytest.approx(-0.005, rel=0.05)
    assert fake.bench is not began
    assert fake.bench.motion[0] == 0.0


def test_the_way_back_is_without_a_turn_and_the_turn_at_the_clamp_slow(env):
    for _ in range(2):  # the first time with the self-test
        cut(env, "constant 1.27 cm/s 45 deg", until=150)
        rig, seen = fake_of(env), []
        assert env.session.plant.angle < math.radians(50.0)
        rig.heard = lambda time, axis, speed, rig=rig, seen=seen: seen.append((axis, speed, rig.bench.motion[0]))
        env.reset(seed=2)
        rates = [(abs(speed), position) for axis, speed, position in seen if axis == "angle" and abs(speed) > 1e-3]
        assert rates
        assert max(rate for rate, _ in rates) <= math.radians(10.0) + 1e-9
        assert max(position for _, position in rates) < 1e-4
        assert env.session.plant.angle == pytest.approx(math.pi / 2, abs=math.radians(0.3))


def test_hands_are_asked_into_the_travel_of_powerless_drives_only(env):
    states, laid = [], env.session._supply.mount

    def lay(key):
        states.append((fake_of(env).blade.state, fake_of(env).angle.state))
        return laid(key)

    env.session._supply.mount = lay
    cut(env, until=30)
    env.reset()
    assert states == [(DriveState.DISABLED, DriveState.DISABLED)] * 2
    assert fake_of(env).blade.state is DriveState.ENABLED


@pytest.mark.parametrize(("force", "known"), [(-3.0, False), (1.5, False), (0.5, True)])
def test_a_blade_that_touches_something_is_found_out_by_its_zero(env, force, known):
    laid = env.session._supply.mount

    def lay(key):
        depth = laid(key)
        fake_of(env).faults.extra_force = force  # whatever it is, a tare takes it for nothing
        return depth

    cut(env, until=30)
    env.session._supply.mount = lay
    if known:
        env.reset()  # a sensor drifts by so much
        return
    with pytest.raises(RigError, match=rf"has changed by {abs(force)}\d* N since the blade was in air"):
        env.reset()
    assert fake_of(env).blade.state is DriveState.DISABLED


def test_after_a_stop_in_tissue_force_counts_from_the_zero_in_air(env):
    cut(env, until=100)
    rig = fake_of(env)
    env.session.plant.supervisor.trip(Cause.OPERATOR, "as told")
    rig.clock.sleep_until(rig.clock.now() + 0.5)
    pulls, zero, asked = env.session.plant.supervisor.newest_force.force[0], rig.sensor.zero, []
    assert abs(pulls) > 0.5
    confirm = env.session.operator.confirm

    def look(question, *, expected=None):
        asked.append((question, rig.sensor.zero))
        return confirm(question, expected=expected)

    env.session.operator.confirm = look
    env.reset()
    ((question, kept),) = [(question, kept) for question, kept in asked if "will move" in question]
    assert kept == zero
    assert f"reads ({pulls:.1f}, 0.0, 0.0) N relative to its zero in air" in question


def test_a_blade_that_was_pushed_while_the_specimen_was_laid_is_found_out(env):
    laid = env.session._supply.mount

    def push(key):
        depth = laid(key)
        fake_of(env).bench.step(0.02, 0.0, False)
        for _ in range(100):
            fake_of(env).bench.step(0.02, 0.0, False)
        return depth

    env.session._supply.mount = push
    with pytest.raises(RigError, match="was moved to"):
        env.reset(seed=1)
    env.session._supply.mount = laid
    before = len(env.session.operator.asked)
    env.reset()
    assert any("will move" in asked for asked in env.session.operator.asked[before:])  # hands may still be there


def test_a_specimen_that_is_cut_twice_within_a_second_has_two_records(tmp_path, monkeypatch):
    class Stopped(datetime):
        @classmethod
        def now(cls, tz=None):
            return cls(2026, 1, 2, 3, 4, 5)

    monkeypatch.setattr("cutenv.envs.rig_source.datetime", Stopped)
    env = RigCutEnv(rig="fake", target_length=0.06, records=tmp_path)
    for _ in range(2):
        env.reset(seed=1, options={"episode": 0})
        env.step([0.625, 1.0])
    env.close()
    assert len(set(env.records)) == 2
    assert sorted(each.name for each in tmp_path.glob("*.csv")) == [
        "20260102T030405_fake_1-0.csv",
        "20260102T030405_fake_1-0_2.csv",
    ]


def test_a_cut_that_is_given_up_comes_to_rest_and_its_record_is_finished(tmp_path):
    env = RigCutEnv(rig="fake", records=tmp_path)
    cut(env, until=40)
    env.reset()
    (record,) = env.records
    trace = load_one(record)
    assert trace.metadata["end"] == "given up"
    assert "truncated" not in trace.metadata
    assert abs(trace.position[-1]) > 0.001
    env.close()


class Unspeakable:
    """What no array can be made of, and no message."""

    def __array__(self, *_: object, **__: object) -> np.ndarray:
        raise RuntimeError("the policy's own")

    def __repr__(self) -> str:
        raise RuntimeError("the policy's own")


def test_an_action_of_another_kind_stops_the_blade_before_anything_is_said(env):
    kinds = ["forward", {}, [1, "x"], [[0.1], [0.2, 0.3]], object(), Unspeakable(), 1j, None, [math.inf, 0.0]]
    for action in [*kinds, [0.1] * 10**5]:
        cut(env, until=10)
        supervisor = env.session.plant.supervisor
        assert supervisor.phase == "ready"
        with pytest.raises(ValueError, match="must hold 2 numbers") as caught:
            env.step(action)
        assert supervisor.phase == "stopped"
        assert supervisor.report.cause is Cause.NOT_A_NUMBER
        assert supervisor.standing
        assert len(str(caught.value)) < 300


def test_the_record_of_a_cut_that_was_stopped_from_here_says_why_and_how_it_came_to_rest(tmp_path):
    env = RigCutEnv(rig="fake", records=tmp_path)
    cut(env, "constant 1.65 cm/s 90 deg", until=50)
    with pytest.raises(ValueError, match="NaN"):
        env.step(np.array([math.nan, 0.0], np.float32))
    (record,) = env.records
    trace = load_one(record)
    assert trace.metadata["end"] == "stopped"
    assert trace.metadata["stop"]["cause"] == "not a number"
    assert trace.metadata["stop"]["time_to_standstill_s"] > 0.0
    assert trace.speed[-1] == 0.0
    env.close()


def test_a_free_angle_is_refused_on_a_rig_whose_angle_is_set_by_hand(tmp_path):
    file = tmp_path / "rig.toml"
    settings = fake_settings(
        angle_mode="fixed",
        angle=None,
        fixed_angle=math.radians(60.0),
        emulated=False,
        depth_profile=((0.0, 0.02), (0.15, 0.02)),
    )
    file.write_text(to_toml(settings))
    assert tomllib.loads(file.read_text())
    operator = ScriptedOperator()
    with pytest.raises(ValueError, match=r"set by hand, at 60 degrees.*angle_mode=\"fixed\""):
        RigCutEnv(rig=file, angle_mode="free", operator=operator)
    with pytest.raises(ValueError, match=r"fixed_angle_deg = 75.*set to 60"):
        RigCutEnv(rig=file, fixed_angle_deg=75.0, operator=operator)
    env = RigCutEnv(rig=file, operator=operator)
    assert env.start_angle == pytest.approx(math.radians(60.0))


@pytest.mark.parametrize(
    ("keywords", "named"),
    [
        ({"rig": "no_such.toml"}, "cutenv rig init"),
        ({"rig": "fake", "control_hz": 30}, "control_hz"),
        ({"rig": "fake", "angle_mode": "loose"}, "angle_mode"),
        ({"rig": "fake", "render_mode": "human"}, "render_mode"),
        ({"rig": "fake", "wieght_jump": 1.0}, "weight_jump"),
        ({"rig": "fake", "specimen_class": "lever"}, "liver"),
    ],
)
def test_bad_arguments_name_themselves_before_anything_moves(keywords, named):
    with pytest.raises((TypeError, ValueError, FileNotFoundError), match=named):
        RigCutEnv(**keywords)


def test_a_rig_in_use_is_left_at_rest_when_the_environment_closes():
    env = RigCutEnv(rig="fake")
    cut(env, until=40)
    fake = fake_of(env)
    assert fake.bench.motion[1] > 0.0
    env.close()
    fake.clock.sleep_until(fake.clock.now() + 0.2)
    assert fake.bench.motion[1] == 0.0
    env.close()


def test_every_cut_is_on_disk_and_scores_as_any_other(tmp_path):
    env = RigCutEnv(rig="fake", records=tmp_path)
    _, info, decisions = cut(env, episode=2)
    (path,) = env.records
    trace = load_one(path)
    assert len(trace) == 20 * decisions
    assert trace.metadata["end"] == info["end"] == "finished"
    assert trace.metadata["rig"] == "fake"
    assert "truncated" not in trace.metadata
    card = score(trace, target_length=trace.metadata["target_length_m"])
    assert card.metrics["peak_force"].value == pytest.approx(trace.force.max())
    cut(env, episode=3, until=30)
    assert load_one(sorted(tmp_path.iterdir())[-1]).metadata["truncated"] is True  # it can be read while it goes on
    env.close()
    assert len(env.records) == 2
    assert load_one(env.records[-1]).metadata["end"] == "closed"


def test_a_disk_that_takes_no_more_stops_the_blade(tmp_path, monkeypatch):
    env = RigCutEnv(rig="fake", records=tmp_path)
    cut(env, until=30)

    def full(self, readings):
        raise RecordingFailed("no space left")

    monkeypatch.setattr(AppendingRecord, "append", full)
    info = env.step(np.array([0.625, 1.0], np.float32))[4]
    info = info if "stop" in info else env.step(np.array([0.625, 1.0], np.float32))[4]
    assert "record cannot be kept" in info["stop"]["detail"]
    env.close()


def test_a_listener_hears_every_reading_of_the_record_and_what_ended_the_cut(tmp_path):
    env = RigCutEnv(rig="fake", records=tmp_path)
    told, parts = [], []

    class Heard:
        def began(self, name):
            told.append(f"begin {name}")

        def readings(self, readings, depth, origin):
            parts.append(np.column_stack([origin + readings["time"], readings["force"], depth]))

        def ended(self, cause):
            told.append(f"end {cause}")

    env.listen(Heard())
    cut(env, until=20)
    env.close()
    trace = load_one(env.records[-1])
    heard = np.concatenate(parts)
    assert np.array_equal(heard[:, 1], trace.force)
    assert np.array_equal(heard[:, 2], trace.depth)
    assert np.allclose(np.diff(heard[:, 0]), 1e-3)
    assert told == ["begin seed 5 episode 0", "end closed: operator"]
