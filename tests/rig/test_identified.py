"""What was measured of a rig is what the simulator is made with."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import cutenv  # noqa: F401  registers the environment
from cutenv.envs import GentleCutEnv, GentleCutVectorEnv, RigCutEnv
from cutenv.learning.arguments import BadArguments, PPOArguments, for_rig
from cutenv.rig.config.identified import SIMULATED, environment_arguments
from cutenv.rig.config.settings import Identified, RigSettings, SensorCalibration
from cutenv.rig.devices.serial.slow_profile import grbl_settings, slow_settings
from cutenv.rig.operation.suitability import simulator_keywords, top_speed
from cutenv.rig.toml_text import to_toml
from cutenv.task.observation import COMPONENTS
from cutenv.task.weights import greatest_action

LAST_SPEED = [one.name for one in COMPONENTS].index("last_speed")
MEASURED = Identified(date="2026-03-01", motor_lag=0.007)


def test_only_what_was_measured_is_passed_on() -> None:
    assert environment_arguments(Identified()) == {}
    assert environment_arguments(Identified(date="2026-04-01", friction=3.0, backlash=0.0)) == {"backlash": 0.0}


def test_the_simulator_takes_what_was_measured() -> None:
    measured = {
        "motor_lag": 0.05, "dead_time": 0.012, "backlash": 3e-5, "acceleration": 0.2,
        "force_noise": 0.03, "force_resolution": 0.0, "force_drift": 0.01,
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
    rig = RigCutEnv(rig="fake", lower_limits={"speed": 0.005}, control_hz=10)
    try:
        rig.reset(seed=4)
        observation, *_, info = rig.step(np.array([1.0, 1.0]))
        assert observation[LAST_SPEED] == pytest.approx(most)
        assert info["rig"]["limited"] == 1
    finally:
        rig.close()


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
