"""Tissue on the emulated rig: the simulator's law and sensor under the motor's blade."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cutenv.commands.rig.emulate import _options, _parser
from cutenv.emulation.mechanics import EmulatedTissue
from cutenv.envs.constants import Constants
from cutenv.envs.rig_source import emulator_arguments
from cutenv.rig.config.mounted_specimen import MountedSpecimen
from cutenv.rig.errors import RigError
from cutenv.sim.cutting.dtypes import LawParameters
from cutenv.sim.cutting.sensor import Sensor, SensorParameters
from cutenv.sim.plant import SimulatedPlant
from cutenv.sim.tissue.specimen import Specimen

UPRIGHT = math.pi / 2
WAY = np.concatenate([np.linspace(0.0, 0.04, 2001)[1:], np.linspace(0.04, 0.035, 500)])


def mounted(seed=3, episode=1, sensor=None, law=None):
    bench, what = EmulatedTissue(sensor, law), MountedSpecimen(seed=seed, episode=episode)
    bench.mount(what.drawn(), what, position=0.0, angle=UPRIGHT)
    return bench


def true_forces(specimen, law=None):
    return SimulatedPlant(specimen, law=law).lead(WAY, UPRIGHT)["true_force"]


def test_the_blade_feels_what_the_law_says_of_its_way():
    bench, forces = mounted(), []
    for position in WAY:
        bench.advance(position, UPRIGHT)
        forces.append(bench.true_force)
    expected = true_forces(Specimen.drawn(3, 1))
    assert max(forces) > 1.0
    assert forces == pytest.approx(expected, abs=1e-9)


def test_the_sensor_has_the_simulators_noise_of_the_same_key():
    bench, sensor = mounted(), Sensor(SensorParameters(), seed=3, episode=1)
    read = [bench.advance(position, UPRIGHT) for position in WAY]
    assert read == [sensor.measure(force) for force in true_forces(Specimen.drawn(3, 1))]
    other = mounted(episode=2)
    assert read != [other.advance(position, UPRIGHT) for position in WAY]


def test_a_wandering_zero_coarse_steps_and_a_rubbing_blade_are_the_simulators_too():
    wanted = {"force_drift": 0.2, "force_resolution": 0.1, "friction_per_depth_speed": 2000.0, "debt_length": 1e-3}
    options = _options(_parser().parse_args(emulator_arguments(Constants.from_keywords(wanted))))
    assert (options.sensor.force_drift, options.sensor.force_resolution) == (0.2, 0.1)
    assert options.law == LawParameters(friction_per_depth_speed=2000.0, debt_length=1e-3)
    bench, sensor = mounted(sensor=options.sensor, law=options.law), Sensor(options.sensor, seed=3, episode=1)
    read = [bench.advance(position, UPRIGHT) for position in WAY]
    rubbed = true_forces(Specimen.drawn(3, 1), options.law)
    assert read == [sensor.measure(force) for force in rubbed]
    assert np.abs(rubbed - true_forces(Specimen.drawn(3, 1))).max() > 0.2


def test_an_emulated_rig_refuses_constants_that_only_the_simulator_has():
    with pytest.raises(ValueError, match=r"acceleration: an emulated rig has no such option, only motor_lag"):
        emulator_arguments(Constants.from_keywords({"acceleration": 0.2}))


def test_free_air_is_felt_as_nothing():
    bench = mounted(sensor=SensorParameters(force_noise=0.0))
    bench.take_away()
    assert {bench.advance(position, UPRIGHT) for position in WAY} == {0.0}
    assert bench.mounted is None


def test_a_specimen_is_laid_only_with_the_blade_at_the_clamp():
    bench, what = EmulatedTissue(), MountedSpecimen()
    with pytest.raises(RigError, match=r"30\.0 mm: drive it to the clamp"):
        bench.mount(what.drawn(), what, position=0.03, angle=UPRIGHT)


def test_an_added_force_is_felt_and_outlives_a_specimen():
    bench = mounted(sensor=SensorParameters(force_noise=0.0, force_delay=0.0))
    bench.add_force(25.0)
    assert bench.advance(0.0, UPRIGHT) == 25.0
    bench.mount(MountedSpecimen().drawn(), MountedSpecimen(), position=0.0, angle=UPRIGHT)
    assert bench.advance(0.0, UPRIGHT) == 25.0
    bench.add_force(0.0)
    assert bench.advance(0.0, UPRIGHT) == 0.0
