"""What was put into a made-up axis and sensor comes out of the experiment, and the simulator is made with it."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable
from contextlib import closing
from datetime import date
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from made_up_axis import MadeUpAxis, identified, made_up_force

import cutenv  # noqa: F401  registers the environment
from cutenv.agents.learning.arguments import BadArguments, PPOArguments, for_rig
from cutenv.agents.sim_to_real import axis_response
from cutenv.agents.sim_to_real.identification import Identification, IdentifiedValue, Plan
from cutenv.drivers.slow_profile import grbl_settings, slow_settings
from cutenv.envs import GentleCutEnv, GentleCutVectorEnv, RigCutEnv
from cutenv.records.measurement import sensor_noise
from cutenv.records.measurement.sensor_noise import longest_still, sensor_at_rest
from cutenv.rig.config.identified import SIMULATED, environment_arguments
from cutenv.rig.config.settings import Identified, RigSettings, SafetyLimits, SensorCalibration
from cutenv.rig.errors import RigError
from cutenv.rig.operation.suitability import simulator_keywords, top_speed
from cutenv.rig.toml_file import to_toml
from cutenv.sim.cutting.drive import Rig
from cutenv.task.observation import COMPONENTS
from cutenv.task.reward import greatest_action

AXES = {
    "plain": Rig(),
    "slow and loose": Rig(motor_lag=0.080, dead_time=0.012, backlash=200e-6),
    "fast": Rig(motor_lag=0.015, dead_time=0.004, acceleration=0.3, backlash=50e-6),
    "lazy": Rig(motor_lag=0.030, dead_time=0.008, acceleration=0.05, backlash=100e-6),
}


def value(found: Identification, name: str) -> float:
    told = found[name].value
    assert told is not None, found[name].how
    return told


WITHIN = {
    "motor_lag": {"rel": 0.05, "abs": 0.002},
    "dead_time": {"abs": 0.002},
    "acceleration": {"rel": 0.05},
    "backlash": {"rel": 0.1, "abs": 20e-6},
}
"""Tolerance of each constant that is found."""


def check(found: Identification, truth: Rig, name: str) -> None:
    if name == "sines":
        return check_sines(found)
    assert value(found, name) == pytest.approx(getattr(truth, name), **WITHIN[name])


def check_sines(found: Identification) -> None:
    for each in found.checks:
        assert each.gain_error == pytest.approx(0.0, abs=0.02)
        assert each.phase_error == pytest.approx(0.0, abs=0.02)
        assert each.verdict == "as the model"


def check_noise(noise: float, resolution: float) -> None:
    found = sensor_at_rest(made_up_force(noise=noise, resolution=resolution), 1000.0)
    assert found is not None
    assert found.noise == pytest.approx(noise, rel=0.1)


@functools.cache
def rightly_identified(name: str) -> Any:
    return identified(MadeUpAxis(drive=AXES[name]))


@pytest.mark.parametrize("name", AXES)
def test_an_axis_is_found_as_it_was_made(name: str) -> None:
    truth = AXES[name]
    found = rightly_identified(name)
    for what in ("motor_lag", "dead_time", "acceleration", "sines", *["backlash"] * bool(truth.backlash)):
        check(found, truth, what)
    for constant, true in (
        ("motor_lag", truth.motor_lag), ("acceleration", truth.acceleration), ("friction", 22.0),
        ("backlash", truth.backlash or None),
    ):  # fmt: skip
        if true is not None:
            assert abs(value(found, constant) - true) < 2.5 * (found[constant].error or 0.0), constant


def test_the_delay_of_the_force_is_that_of_the_inertia_that_it_feels() -> None:
    found = identified(MadeUpAxis(carried=0.3, force_delay=0.012))["force_delay"]
    assert found.value is not None
    assert found.error is not None
    assert abs(found.value - 0.012) < 2.5 * found.error < 0.006
    backward = identified(MadeUpAxis(carried=-0.3))["force_delay"]
    assert (backward.value, backward.how.partition(":")[0]) == (None, "the force has the wrong sign")
    light = identified(MadeUpAxis(carried=0.001))["force_delay"]
    assert light.value is None
    assert "clamp some 200 g to it" in light.how


Estimate = Callable[..., Any]
MISTAKES: dict[str, tuple[str, Callable[[Estimate], Estimate], tuple[str, ...]]] = {
    "late commands": (
        "modelled", lambda right: lambda stretch, lag, limit, dead: right(stretch, lag, limit, dead + 0.005),
        ("dead_time",),
    ),
    "without limit": (
        "modelled", lambda right: lambda stretch, lag, limit, dead: right(stretch, lag, 1e3, dead), ("motor_lag",)
    ),
    "without lag": (
        "modelled", lambda right: lambda stretch, lag, limit, dead: right(stretch, 1e-3, limit, dead),
        ("motor_lag", "sines"),
    ),
    "play from the end of a leg": (
        "_leg", lambda right: lambda *which: (lambda leg: (0.5 * leg[0], leg[1]))(right(*which)), ("backlash",)
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_wrong_estimator_would_be_noticed(mistake: str, monkeypatch: pytest.MonkeyPatch) -> None:
    truth, right = AXES["slow and loose"], rightly_identified("slow and loose")
    name, wrongly, checks = MISTAKES[mistake]
    monkeypatch.setattr(axis_response, name, wrongly(getattr(axis_response, name)))
    wrong = identified(MadeUpAxis(drive=truth))
    for what in checks:
        check(right, truth, what)
        with pytest.raises(AssertionError):
            check(wrong, truth, what)


@pytest.mark.parametrize(("noise", "resolution"), [(0.02, 0.05), (0.012, 0.05), (0.1, 0.05), (0.02, 1e-6)])
def test_noise_is_found_as_it_was_before_rounding(noise: float, resolution: float) -> None:
    check_noise(noise, resolution)


def test_what_is_written_has_no_digits_of_a_conversion() -> None:
    for value, error, written in (
        (0.0499999999999999, None, 0.05),
        (0.116997416, None, 0.117),
        (0.0400312, 1e-3, 0.04),
    ):
        assert IdentifiedValue(name="force_still_x", value=value, error=error, how="").rounded == written


def test_noise_taken_from_rounded_readings_would_be_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sensor_noise, "_unrounded", lambda by_block, step, spread: (spread, by_block.mean(axis=1)))
    with pytest.raises(AssertionError):
        check_noise(0.02, 0.05)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**31), drift=st.floats(0.005, 0.05), noise=st.floats(0.01, 0.05))
def test_a_walking_zero_is_found_within_its_own_error(seed: int, drift: float, noise: float) -> None:
    found = sensor_at_rest(made_up_force(noise=noise, drift=drift, seed=seed, duration=40.0), 1000.0)
    assert found is not None
    assert found.drift > 0.0
    assert abs(found.drift - drift) < 5.0 * found.drift_error


def test_a_standing_zero_does_not_walk() -> None:
    walking = 0
    for seed in range(20):
        found = sensor_at_rest(made_up_force(seed=seed), 1000.0)
        assert found is not None
        walking += found.drift > 0.0
    assert walking <= 3


def test_the_least_step_of_readings_is_found() -> None:
    found = sensor_at_rest(made_up_force(noise=0.02, resolution=0.025), 1000.0)
    assert found is not None
    assert found.resolution == pytest.approx(0.025)


def test_equal_readings_tell_nothing() -> None:
    assert sensor_at_rest(np.full(20000, 0.35), 1000.0) is None


def test_too_few_readings_are_refused() -> None:
    with pytest.raises(ValueError, match=r"1\.0 s of readings are too few: give 5 s"):
        sensor_at_rest(made_up_force(duration=1.0), 1000.0)


def test_without_torque_friction_and_play_cannot_be_told() -> None:
    found = identified(MadeUpAxis(drive=AXES["slow and loose"], reports_torque=False))
    for name in ("friction", "backlash"):
        assert found[name].value is None
        assert "reports no torque" in found[name].how


def test_a_carriage_that_is_pushed_for_nothing_hides_its_play() -> None:
    found = identified(MadeUpAxis(drive=AXES["slow and loose"], carriage_friction=0.0))
    assert found["backlash"].value is None
    assert "no step after a reversal" in found["backlash"].how


def test_a_limit_that_no_step_meets_is_not_made_up() -> None:
    found = identified(MadeUpAxis(drive=Rig(motor_lag=0.060, acceleration=5.0)))
    assert found["acceleration"].value is None
    assert "no step met a limit" in found["acceleration"].how
    check(found, Rig(motor_lag=0.060), "motor_lag")


def test_standard_errors_cover_what_jitter_does() -> None:
    truth = Rig(motor_lag=0.030)
    lags = [identified(MadeUpAxis(drive=truth, seed=seed, jitter=1e-3))["motor_lag"] for seed in range(4)]
    spread = np.std([each.value for each in lags], ddof=1)
    assert spread < 3.0 * np.mean([each.error for each in lags])


def test_what_was_found_replaces_what_was_known_and_nothing_else() -> None:
    found = identified(MadeUpAxis(reports_torque=False))
    before = Identified(date="2020-01-01", friction=3.0, motor_lag=0.1)
    after = found.identified(before, date(2026, 3, 1))
    assert after.date == "2026-03-01"
    assert after.friction == 3.0
    assert after.motor_lag == pytest.approx(0.040, rel=0.05)
    assert after.motor_lag == found["motor_lag"].rounded


def test_the_table_names_unit_error_present_and_simulated_value() -> None:
    lines = identified(MadeUpAxis()).table(Identified(motor_lag=0.055))
    lag = next(line for line in lines if line.startswith("motor_lag"))
    assert lag.split()[:2] == ["motor_lag", "[ms]"]
    assert lag.split()[4:6] == ["55", "40"]


@pytest.mark.parametrize("position", [-0.001, 0.0, 0.07, 0.148])
def test_a_plan_stays_where_commands_are_not_made_smaller(position: float) -> None:
    rig = RigSettings()
    plan = Plan.within(rig, position)
    low, high = plan.path
    assert rig.limits.low < low < high < rig.limits.high
    assert abs(plan.start - position) <= 0.03
    assert max(plan.speeds) < rig.limits.speed
    for sine in plan.sines:
        assert 2.0 * np.pi * sine.frequency * sine.amplitude < rig.blade.acceleration


def test_a_travel_that_is_too_short_is_refused() -> None:
    with pytest.raises(RigError, match="too short for this"):
        Plan.within(RigSettings(limits=SafetyLimits(low=0.0, high=0.02)), 0.01)


@pytest.mark.parametrize(("noise", "resolution"), [(0.02, 0.05), (0.02, 0.0), (0.05, 0.05), (0.01, 0.03)])
def test_no_axis_stands_for_longer_by_its_own_noise(noise: float, resolution: float) -> None:
    still = longest_still(made_up_force(noise=noise, resolution=resolution, seed=1), 1000.0)
    hour = np.random.default_rng(2).standard_normal(3_600_000) * noise  # a zero in the middle of a step, the worst
    if resolution:
        hour = resolution * np.round(hour / resolution)
    changes = np.flatnonzero(np.diff(hour))
    assert np.diff(changes).max() < 1000 * still
    assert still < 5.0  # and it is no licence to be dead: five seconds of a cut


def test_an_axis_that_never_changes_is_known_to_stand() -> None:
    assert longest_still(np.zeros(20_000), 1000.0) > 20.0


LAST_SPEED = [one.name for one in COMPONENTS].index("last_speed")
MEASURED = Identified(date="2026-03-01", motor_lag=0.007)


def test_only_what_was_measured_is_passed_on() -> None:
    assert environment_arguments(Identified()) == {}
    assert environment_arguments(Identified(date="2026-04-01", friction=3.0, backlash=0.0)) == {"backlash": 0.0}


def test_the_simulator_takes_what_was_measured() -> None:
    measured = {
        "motor_lag": 0.05, "dead_time": 0.012, "backlash": 3e-5, "acceleration": 0.2,
        "force_noise": 0.03, "force_resolution": 0.0, "force_drift": 0.01, "force_delay": 0.02,
    }  # fmt: skip
    arguments = environment_arguments(Identified(**measured))
    assert arguments == measured
    assert set(SIMULATED) == measured.keys()
    env = gymnasium.make("cutenv/GentleCut-v1", **arguments)
    assert env.spec is not None
    assert measured.items() <= env.spec.kwargs.items()
    env.close()


def slow_file(folder: Path, rig: RigSettings, identified: Identified = MEASURED) -> str:
    path = folder / "slow.toml"
    told = dataclasses.replace(
        rig, identified=identified, calibration=SensorCalibration(date="2026-03-01"),
        depth_profile=((0.0, 0.0175), (0.15, 0.0175)),
    )  # fmt: skip
    path.write_text(to_toml(told), encoding="utf-8")
    return str(path)


def test_the_simulator_of_a_slow_rig_has_its_top_speed_and_its_mean_delay_and_that_of_a_fast_one_neither() -> None:
    slow = slow_settings("/dev/x")
    assert simulator_keywords(slow) == {
        "top_speed": pytest.approx(0.005 / 1.04), "force_delay": pytest.approx(0.5 * 0.050 + 0.5 / 80.0),
    }  # fmt: skip
    assert simulator_keywords(RigSettings()) == {}


def test_an_action_beyond_the_top_speed_is_reduced_alike_in_one_cut_in_many_and_on_a_rig(tmp_path: Path) -> None:
    file = slow_file(tmp_path, slow_settings("/dev/x"))
    one = GentleCutEnv(rig=file, control_hz=10)
    many = GentleCutVectorEnv(2, rig=file, control_hz=10)
    observation, _ = one.reset(seed=4)
    many.reset(seed=[4, 5])
    for speed in (1.0, -0.05, 1.0, -1.0):
        observation = one.step(np.array([speed, 1.0]))[0]
        every = many.step(np.array([[speed, 1.0]] * 2))[0]
        assert np.array_equal(observation, every[0])
        most = greatest_action(top_speed(slow_settings("/dev/x")))
        assert observation[LAST_SPEED] == pytest.approx(np.clip(speed, -most, most))
    with closing(RigCutEnv(rig="fake", lower_limits={"speed": 0.005}, control_hz=10)) as rig:
        rig.reset(seed=4)
        observation, *_, info = rig.step(np.array([1.0, 1.0]))
        assert observation[LAST_SPEED] == pytest.approx(most)
        assert info["rig"]["limited"] == 1


def test_training_for_a_rig_takes_its_angle_its_decisions_and_its_constants(tmp_path: Path) -> None:
    file = slow_file(tmp_path, grbl_settings("/dev/x", "/dev/y"))
    chosen = for_rig({"rig": file})
    assert chosen == {"rig": file, "angle_mode": "fixed", "fixed_angle_deg": 90.0, "control_hz": 5}
    arguments = PPOArguments(**chosen)
    assert arguments.environment["motor_lag"] == 0.007
    assert arguments.environment["top_speed"] < 0.005
    GentleCutEnv(**arguments.environment).close()
    assert for_rig({"rig": file, "control_hz": 10})["control_hz"] == 10


def test_what_contradicts_the_rig_to_train_for_is_refused(tmp_path: Path) -> None:
    file = slow_file(tmp_path, slow_settings("/dev/x"))
    with pytest.raises(BadArguments, match=r"--angle-mode free contradicts .* set by hand at 90 degrees"):
        for_rig({"rig": file, "angle_mode": "free"})
    with pytest.raises(BadArguments, match="--rigs 3 draws rigs at random, and --rig is one"):
        PPOArguments(**for_rig({"rig": file, "rigs": 3}))
    with pytest.raises(BadArguments, match="no such file"):
        for_rig({"rig": str(tmp_path / "none.toml")})
    with pytest.raises(BadArguments, match="nothing in it was identified yet"):
        for_rig({"rig": slow_file(tmp_path, slow_settings("/dev/x"), Identified())})
