"""A whole session on an emulated rig with a height axis, in real time: prepared, cut up and down, ended."""

from __future__ import annotations

import dataclasses
import math

import pytest

from cutenv.envs.rig_source import EmulatedSpecimens
from cutenv.rig.emulator.process import start
from cutenv.rig.errors import RigError
from cutenv.rig.hardware import rig_plant
from cutenv.rig.operation.operator import AutomaticOperator
from cutenv.rig.operation.self_check import inspect
from cutenv.rig.operation.session import RigSession
from cutenv.rig.operation.specimen_source import SpecimenKey
from cutenv.rig.safety.stop_causes import RigStopped
from cutenv.tissue.layers import Layers
from cutenv.tissue.specimen import Specimen

UPRIGHT = math.pi / 2
ATTEMPTS = 3  # at a session in which the host stalls


def cut_up_and_down() -> None:
    specimen = Specimen.drawn(3, 0, specimen_class="liver")
    with start(free_air=True, across=("height",)) as emulator:
        settings = emulator.settings
        loose = dataclasses.replace(settings.limits, force_rise=1e5, force=100.0, force_norm=100.0)
        settings = dataclasses.replace(settings, limits=loose)
        supply, operator = EmulatedSpecimens(emulator.control), AutomaticOperator(settings)
        supply.layers = Layers(boundary=0.012, deep_toughness=2.0)
        with RigSession(rig_plant(settings), operator, supply) as session:
            session.next_cut(SpecimenKey(seed=3, episode=0, specimen=specimen), UPRIGHT)
            assert "height encoder" in [check.name for check in session.checks]
            assert any("Did it go up first" in question for question in operator.asked)
            plant = session.plant
            session.start()
            for descent, lowest, highest in ((0.002, -0.0012, -0.0006), (-0.004, 0.0005, 0.0015)):
                for _ in range(25):
                    plant.advance(0.012, UPRIGHT, 20, descent)
                assert lowest < plant.level < highest
                assert plant.level == pytest.approx(emulator.control.truth()["height_m"], abs=1e-4)
            assert plant.vertical_force.mean() < -0.01  # the tissue holds a rising blade; single readings have noise
            session.end_cut()
            session.plant.switch_off()
            inspection = inspect(plant, session._today)
            names = {check.name for check in inspection.checks}
            assert {"height drive", "height samples", "height heartbeat", "height homed"} <= names
            assert inspection.told["height"]["homed"] == "yes"
            assert inspection.told["height"]["position_mm"] == pytest.approx(1e3 * plant.level, abs=0.1)


def test_a_cut_up_and_down_on_the_emulator():
    for attempts_left in reversed(range(ATTEMPTS)):
        try:
            return cut_up_and_down()
        except (RigStopped, RigError):
            if not attempts_left:
                raise
