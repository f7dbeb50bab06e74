"""A cut along a curve on an emulated rig with an axis to the side, in real time: prepared, cut, led back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cutenv.envs.path_cut import to_path_action
from cutenv.envs.rig_path_cut import RigPathCutEnv
from cutenv.rig.errors import RigError
from cutenv.rig.safety.stop_causes import RigStopped

ATTEMPTS = 3  # at a session in which the host stalls


def cut_along_a_bend() -> None:
    env = RigPathCutEnv(rig="emulator", target_length=0.06, line="arc", records=None)
    try:
        env.reset(seed=3)
        assert "side encoder" in [check.name for check in env.session.checks]
        for _ in range(100):
            *_, ended, _, info = env.step(to_path_action(0.012, math.pi / 2, 0.3))
            if ended:
                raise RigError(str(info))
        heading, plant = env.session.plant.heading.now, env.session.plant
        assert heading == pytest.approx(env.cutting.line.angle[0] + 0.6)
        beside, truth = plant.beside, env._source.emulator.control.truth()
        assert (beside["blade_x"][-1], beside["blade_y"][-1]) == pytest.approx(
            (truth["position_m"], truth["side_m"]), abs=5e-4
        )
        assert np.hypot(beside["blade_x"][-1], beside["blade_y"][-1]) > 0.02
        assert env.cutting.tip == pytest.approx(truth["tip_m"], abs=4e-3)
        env.reset(seed=4)  # back, the way that it came
        truth = env._source.emulator.control.truth()
        assert math.hypot(truth["position_m"], truth["side_m"]) < 3e-4
    finally:
        env.close()


def test_a_cut_along_a_bend_on_the_emulator():
    for attempts_left in reversed(range(ATTEMPTS)):
        try:
            return cut_along_a_bend()
        except (RigStopped, RigError):
            if not attempts_left:
                raise
