"""From beyond an end of its travel the blade creeps back, if the operator agrees, and does nothing else."""

from __future__ import annotations

from datetime import date

import pytest
from hand_moved_rig import HandMovedRig
from scripted_operator import ScriptedOperator

from cutenv.rig.devices.protocols import DriveState, Phase
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import AutomaticOperator
from cutenv.rig.operation.preflight import prepare, return_inside
from cutenv.rig.safety.monitors import CREEP
from cutenv.rig.safety.stop_causes import Cause, RigStopped

HIGH, LOW = 0.148, -0.001  # [m]
BEYOND = [0.14802, 0.1485, 0.1489, 0.1495, -0.0015, -0.0025]
"""Between the limit and the drive's own end, and beyond that: 149 and -2 mm."""


def beyond(position: float) -> HandMovedRig:
    """Open, without power, the blade at rest out there."""
    rig = HandMovedRig()
    for name in ("position", "carriage", "demand_position"):
        rig.motor.motor[name] = position
    rig.wait(0.01)
    rig.plant.open()
    rig.wait(0.15)
    return rig


def powered(position: float) -> HandMovedRig:
    rig = beyond(position)
    rig.plant.power()
    rig.wait(0.15)
    return rig


@pytest.mark.parametrize("position", BEYOND)
def test_it_creeps_back_with_the_operators_word_and_the_rig_is_ready(position):
    rig = beyond(position)
    operator = AutomaticOperator(rig.settings)
    speeds, places = [], []
    rig.clock.every(0.001, lambda now: (speeds.append(rig.speed), places.append(rig.position)), "look")
    prepare(rig.plant, operator, today=date.today())
    assert LOW < rig.position < HIGH
    assert rig.supervisor.phase is Phase.READY
    outward = 1.0 if position > HIGH else -1.0
    returned = next(n for n, place in enumerate(places) if LOW <= place <= HIGH)
    assert max(abs(speed) for speed in speeds[:returned]) < 1.2 * CREEP
    assert max(outward * (place - position) for place in places) < 1e-4
    asked = [question for question in operator.asked if "creep back inside at 2 mm/s" in question]
    assert len(asked) == 1
    assert f"blade at {1e3 * position:.2f} mm" in asked[0]
    rig.cut(-outward * 0.01, 0.2)


def test_without_the_word_nothing_moves():
    rig = beyond(0.1485)
    operator = ScriptedOperator([("will move", "fake"), ("creep back", False)])
    with pytest.raises(RigError, match="has not agreed to its return: nothing moves"):
        prepare(rig.plant, operator, today=date.today())
    assert rig.position == pytest.approx(0.1485, abs=1e-5)
    assert rig.node.state is DriveState.DISABLED


def test_a_release_without_it_is_refused_in_words():
    rig = powered(0.1485)
    with pytest.raises(RigError, match=r"blade at 148.50 mm, outside -1 to 148 mm: it may creep back"):
        rig.supervisor.release()


@pytest.mark.parametrize("position", BEYOND[1:])
def test_released_to_return_a_policy_goes_no_faster_and_no_further_out(position):
    rig = powered(position)
    rig.supervisor.release(returning=True)
    rig.plant.begin()
    outward = 1.0 if position > HIGH else -1.0
    rig.cut(outward * 0.02, 0.2)
    assert abs(rig.position - position) < 1e-5
    rig.cut(-outward * 0.02, 0.2)
    assert 1e-5 < outward * (position - rig.position) < 0.2 * CREEP * 1.05


@pytest.mark.parametrize(("runaway", "cause"), [(0.003, Cause.TRAVEL), (-0.03, Cause.SPEED)])
def test_a_drive_that_does_otherwise_is_stopped_at_once(runaway, cause):
    rig = powered(0.1482)
    rig.supervisor.release(returning=True)
    rig.motor.motor["runaway"] = runaway
    rig.plant.begin()
    with pytest.raises(RigStopped) as stopped:
        rig.cut(-0.001, 1.0)
    assert stopped.value.report.cause is cause
    assert abs(rig.position - 0.1482) < 0.0006


def test_once_inside_the_usual_limits_hold_again():
    rig = powered(0.1481)
    return_inside(rig.plant)
    assert rig.supervisor.beyond is None
    rig.motor.motor["runaway"] = 0.004
    rig.plant.begin()
    with pytest.raises(RigStopped) as stopped:
        rig.cut(0.004, 1.0)
    assert stopped.value.report.cause in (Cause.TRAVEL, Cause.FOLLOWING)
    assert rig.position < HIGH + 0.0002
    rig.motor.motor["runaway"] = float("nan")
    rig.supervisor.reset(agreed=True)
    rig.plant.power()
    rig.wait(0.15)
    if rig.supervisor.beyond is not None:
        with pytest.raises(RigError, match="it may creep back"):
            rig.supervisor.release()
        return_inside(rig.plant)
    assert rig.supervisor.beyond is None
