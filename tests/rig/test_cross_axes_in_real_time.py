"""Cuts on emulated rigs with an axis across the cut, in real time: prepared, cut, led back or ended."""

from __future__ import annotations

import dataclasses
import math
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from cutenv.emulation.process import start
from cutenv.envs.path_cut import to_path_action
from cutenv.envs.rig_cut import RigPathCutEnv
from cutenv.envs.rig_source import EmulatedSpecimens
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import AutomaticOperator
from cutenv.rig.operation.preflight import inspect
from cutenv.rig.operation.session import RigSession, SpecimenKey
from cutenv.rig.plant import rig_plant
from cutenv.rig.safety.stop_causes import RigStopped
from cutenv.sim.tissue.layers import Layers
from cutenv.sim.tissue.specimen import Specimen

UPRIGHT = math.pi / 2
ATTEMPTS = 3  # at a session in which the host stalls
pytestmark = pytest.mark.usefixtures("quick_return")


def cut_up_and_down() -> None:
    specimen = Specimen.drawn(3, 0, specimen_class="liver")
    with start(free_air=True, across=("height",)) as emulator:
        settings = emulator.settings
        loose = dataclasses.replace(settings.limits, force_rise=5e3, force=100.0, force_norm=100.0)
        low = dataclasses.replace(settings.height, raised=0.002)  # to which it goes and back at 5 mm/s
        settings = dataclasses.replace(settings, limits=loose, height=low)
        supply, operator = EmulatedSpecimens(emulator.control), AutomaticOperator(settings)
        supply.layers = Layers(boundary=0.012, deep_toughness=2.0)
        with RigSession(rig_plant(settings), operator, supply) as session:
            session.next_cut(SpecimenKey(seed=3, episode=0, specimen=specimen), UPRIGHT)
            assert "height encoder" in [check.name for check in session.checks]
            assert any("Did it go up first" in question for question in operator.asked)
            plant = session.plant
            session.start()
            felt = []
            for descent, lowest, highest in ((0.002, -0.0012, -0.0006), (-0.004, 0.0005, 0.0015)):
                forces = []
                for _ in range(25):
                    plant.advance(0.012, UPRIGHT, 20, descent)
                    forces.append(plant.vertical_force.mean())
                assert lowest < plant.level < highest
                assert plant.level == pytest.approx(emulator.control.truth()["height_m"], abs=1e-4)
                felt.append(np.mean(forces[10:]))  # readings have noise, and differ as the crack runs
            assert felt[1] < felt[0] - 0.025  # floor and friction push up a blade that goes down
            session.end_cut()
            session.plant.switch_off()
            inspection = inspect(plant, session._today)
            names = {check.name for check in inspection.checks}
            assert {"height drive", "height samples", "height heartbeat", "height homed"} <= names
            assert inspection.devices["height"]["homed"] == "yes"
            assert inspection.devices["height"]["position_mm"] == pytest.approx(1e3 * plant.level, abs=0.1)


def patient(settings: RigSettings) -> RigSettings:
    """Settings that hold a late action for longer: here the path is tested, not the host's program."""
    return dataclasses.replace(settings, limits=dataclasses.replace(settings.limits, overrun=3.0))


def cut_along_a_bend() -> None:
    env = RigPathCutEnv(rig="emulator", target_length=0.06, line="arc", records=None)
    with closing(env), pytest.MonkeyPatch.context() as patch:
        patch.setattr(env._source, "_lowered", patient)
        env.reset(seed=3)
        assert "side encoder" in [check.name for check in env.session.checks]
        for _ in range(100):
            *_, ended, _, info = env.step(to_path_action(0.012, math.pi / 2, 0.3))
            if ended:
                raise RigError(str(info))
        threads = Path(f"/proc/{env.session.plant.spine.pid}/task")
        if threads.exists():  # the loop, the one that takes commands, and the one that writes the log
            assert len(list(threads.iterdir())) == 3
        heading, plant = env.session.plant.heading.now, env.session.plant
        assert heading == pytest.approx(env.cutting.line.angle[0] + 0.6)
        channels, truth = plant.channels, env._source.emulator.control.truth()
        assert (channels["blade_x"][-1], channels["blade_y"][-1]) == pytest.approx(
            (truth["position_m"], truth["side_m"]), abs=5e-4
        )
        assert np.hypot(channels["blade_x"][-1], channels["blade_y"][-1]) > 0.02
        assert env.cutting.tip == pytest.approx(truth["tip_m"], abs=4e-3)
        env.reset(seed=4)  # back, the way that it came
        truth = env._source.emulator.control.truth()
        assert math.hypot(truth["position_m"], truth["side_m"]) < 3e-4


@pytest.mark.parametrize("session", [cut_up_and_down, cut_along_a_bend])
def test_a_cut_on_the_emulator(session):
    for attempts_left in reversed(range(ATTEMPTS)):
        try:
            return session()
        except (RigStopped, RigError):
            if not attempts_left:
                raise
