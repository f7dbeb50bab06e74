"""What was measured of a rig is what the simulator is made with."""

from __future__ import annotations

import gymnasium

import cutenv  # noqa: F401  registers the environment
from cutenv.rig.config.identified import SIMULATED, environment_arguments
from cutenv.rig.config.settings import Identified


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
