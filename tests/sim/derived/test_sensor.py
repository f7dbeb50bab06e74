"""The force sensor: resolution, delay, noise, drift, tare; one for the simulator and the rig."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from led_cut import UPRIGHT, homogeneous

from cutenv._engine.randomness import SENSOR_NOISE, normal_at
from cutenv.sim.cutting.sensor import Sensor, SensorParameters
from cutenv.sim.plant import SimulatedPlant

IDEAL = {"force_noise": 0.0, "force_resolution": 0.0, "force_delay": 0.0}


def sensor(seed: int = 0, episode: int = 0, **changes: float) -> Sensor:
    return Sensor(SensorParameters(**(IDEAL | changes)), seed=seed, episode=episode)


def readings(of: Sensor, forces: Any) -> np.ndarray:
    return np.array([of.measure(force) for force in forces])


def test_an_ideal_sensor_reads_the_force():
    forces = np.linspace(-3.0, 8.0, 200)
    assert np.array_equal(readings(sensor(), forces), forces)


def test_readings_are_the_nearest_multiple_of_the_resolution():
    forces = np.linspace(-1.0, 2.0, 1001)
    read, resolution = readings(sensor(force_resolution=0.05), forces), 0.05
    assert read / resolution == pytest.approx(np.round(read / resolution), abs=1e-9)
    assert np.abs(read - forces).max() <= 0.5 * resolution * (1.0 + 1e-9)
    assert len(np.unique(read)) == round((forces[-1] - forces[0]) / resolution) + 1


@pytest.mark.parametrize("ticks", [0, 1, 10, 63])
def test_delay_is_exact(ticks):
    forces = np.random.default_rng(1).normal(size=300)
    read = readings(sensor(force_delay=ticks * 1e-3), forces)
    assert np.all(read[:ticks] == 0.0)
    assert np.array_equal(read[ticks:], forces[: 300 - ticks])


def test_noise_has_its_standard_deviation_and_is_white():
    """Mean 0, SD as asked for, white, and normal in its fourth moment; within 4 standard errors."""
    read, deviation = readings(sensor(force_noise=0.02), np.zeros(40_000)), 0.02
    n = len(read)
    z = read / deviation
    assert abs(z.mean()) < 4.0 / math.sqrt(n)
    assert z.std() == pytest.approx(1.0, abs=4.0 / math.sqrt(2.0 * n))
    assert abs(np.mean(z[1:] * z[:-1])) < 4.0 / math.sqrt(n)
    assert np.mean(z**4) == pytest.approx(3.0, abs=4.0 * math.sqrt(96.0 / n))


def test_drift_is_a_random_walk_with_its_deviation_after_one_second():
    walks = np.array([readings(sensor(seed=s, force_drift=0.05), np.zeros(1000)) for s in range(400)])
    for milliseconds in (250, 1000):
        expected = 0.05 * math.sqrt(milliseconds / 1000.0)
        assert walks[:, milliseconds - 1].std() == pytest.approx(expected, rel=4.0 / math.sqrt(800.0))
    steps = np.diff(walks, axis=1)
    assert abs(np.mean(steps[:, 1:] * steps[:, :-1])) / steps.var() < 4.0 / math.sqrt(steps.size)


def test_tare_takes_a_reading_as_the_new_zero():
    of = sensor(force_resolution=0.05)
    of.tare(of.measure(1.23))
    assert of.measure(1.23) == pytest.approx(0.0, abs=1e-12)
    assert of.measure(2.23) == pytest.approx(1.0, abs=1e-12)
    of.tare(of.measure(1.73))
    assert of.measure(1.73) == pytest.approx(0.0, abs=1e-12)


def test_the_same_key_gives_the_same_noise_in_any_order():
    one = readings(sensor(seed=7, episode=3, force_noise=0.02), np.zeros(50))
    first, second = sensor(seed=7, episode=3, force_noise=0.02), sensor(seed=8, episode=3, force_noise=0.02)
    interleaved = np.array([(first.measure(0.0), second.measure(0.0)) for _ in range(50)])
    assert np.array_equal(interleaved[:, 0], one)
    assert not np.any(interleaved[:, 1] == one)
    backwards = [0.02 * normal_at(7, 3, SENSOR_NOISE, tick) for tick in reversed(range(50))]
    assert backwards == one[::-1].tolist()


@pytest.mark.parametrize("other", [{"seed": 8}, {"episode": 4}])
def test_another_key_gives_other_noise(other):
    one, two = (
        readings(sensor(**({"seed": 7, "episode": 3, "force_noise": 0.02} | key)), np.zeros(5000))
        for key in ({}, other)
    )
    assert abs(np.corrcoef(one, two)[0, 1]) < 4.0 / math.sqrt(5000)


def test_the_simulated_plant_reads_through_the_same_sensor():
    parameters = SensorParameters(force_drift=0.02)
    plant = SimulatedPlant(homogeneous(), sensor=parameters, seed=11, episode=5)
    record = np.concatenate([plant.advance(0.02, UPRIGHT, 20).copy() for _ in range(100)])
    assert np.array_equal(readings(Sensor(parameters, seed=11, episode=5), record["true_force"]), record["force"])
