"""Nothing moves before calibration, self-test and the operator's word; each check has a rig that fails it."""

from __future__ import annotations

import dataclasses
import functools
from datetime import date, timedelta

import pytest
from scripted_operator import ScriptedOperator

from cutenv.emulation.fake_benches import SpecimenPlant
from cutenv.emulation.fake_rig import FakeRig, fake_rig
from cutenv.rig.config.mounted_specimen import MountedSpecimen
from cutenv.rig.config.settings import SensorCalibration, SensorSettings, fake_settings
from cutenv.rig.devices.loop import FakeClock
from cutenv.rig.devices.protocols import DriveState
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import AutomaticOperator
from cutenv.rig.operation.preflight import SETTLE, prepare
from cutenv.rig.safety.stop_causes import Cause, RigStopped
from cutenv.sim.tissue.specimen import Specimen

TODAY = date.today() + timedelta(days=1)  # settings that are made past midnight are no younger


def opened(**changes) -> FakeRig:
    rig = fake_rig(Specimen.drawn(3, 0), fake_settings(**changes))
    rig.plant.open()
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    return rig


def refused(rig: FakeRig, because: str, operator=None) -> None:
    """It is refused for that reason, nothing has moved, and the drives are without power."""
    speeds = []
    rig.clock.every(0.001, lambda now: speeds.append(abs(rig.bench.motion[1])), "look")
    with pytest.raises(RigError, match=because):
        prepare(rig.plant, operator or AutomaticOperator(rig.settings), today=TODAY)
    assert max(speeds, default=0.0) == 0.0
    assert rig.blade.state is not DriveState.ENABLED
    assert rig.plant.supervisor.phase == "unready"


@pytest.mark.promise("S1")
def test_a_sound_rig_is_ready_and_says_what_was_found():
    rig = opened()
    operator = AutomaticOperator(rig.settings)
    checks = prepare(rig.plant, operator, today=TODAY)
    assert rig.plant.supervisor.phase == "ready"
    assert {"calibration", "armed_by", "zero force", "encoder", "hinge", "blade limit high"} <= {c.name for c in checks}
    assert "of +1.00 mm" in next(check.found for check in checks if check.name == "encoder")
    assert any("Keep clear" in told for told in operator.messages)
    assert any("stop button" in asked for asked in operator.asked)
    assert any("stands 0.0 mm from the clamp, and in air the sensor reads" in asked for asked in operator.asked)


def test_a_sensor_that_sends_at_another_rate_than_the_file_says_is_refused():
    rig = fake_rig(Specimen.drawn(3, 0), fake_settings(sensor=SensorSettings(rate=7000.0)))
    with pytest.raises(RigError, match="sends 1000 readings a second, but the rig's file has 7000"):
        rig.plant.open()
    rig.plant.close()


def calibrated(date: str) -> dict[str, SensorCalibration]:
    return {"calibration": SensorCalibration(date=date)}


@pytest.mark.parametrize(
    ("settings", "because"),
    [
        (calibrated(""), "never checked"),
        (calibrated((TODAY - timedelta(days=400)).isoformat()), "400 days ago"),
        (calibrated((TODAY + timedelta(days=2)).isoformat()), "in the future"),
        (calibrated("last week"), "is not a date"),
        ({"armed_by": "  "}, "armed_by"),
    ],
)
@pytest.mark.promise("S1")
def test_without_a_valid_calibration_and_who_answers_for_it_nothing_moves(settings, because):
    refused(opened(**settings), because)


def test_the_operator_says_no_or_types_something_else():
    refused(opened(), "not confirmed", ScriptedOperator([("will move", False)]))
    refused(opened(), "not confirmed", ScriptedOperator([("will move", "fak")]))


def limited_otherwise(rig: FakeRig) -> None:
    answered = rig.blade.limits()
    rig.blade.limits = lambda: answered | {"high": 0.3}


@pytest.mark.parametrize(
    ("fault", "because"),
    [
        (lambda rig: setattr(rig.faults, "ramp", 2.0), "zero force"),  # after the tare: somebody leans on the blade
        (lambda rig: setattr(rig.faults, "force_status", 0x80000000), "force status: 0x80000000"),
        (limited_otherwise, "blade limit high: drive 0.3, file 0.149"),
        (lambda rig: setattr(rig.blade, "state", DriveState.FAULT), "clear it first"),
    ],
)
def test_a_force_a_sick_sensor_other_limits_or_a_fault_are_refused_at_rest(fault, because):
    rig = opened()
    fault(rig)
    refused(rig, because)


def test_an_encoder_that_counts_the_other_way_is_found_with_a_millimetre():
    rig = opened()
    for name in ("hand", "blade", "tip"):
        rig.bench.plant.cuts["states"][name] = 0.01
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    told = rig.blade.command
    rig.blade.command = lambda speed: told(-speed)
    with pytest.raises(RigError, match=r"travel limit|following error|does not reach"):
        prepare(rig.plant, AutomaticOperator(rig.settings), today=TODAY)
    assert 0.006 < rig.bench.motion[0] < 0.01
    assert rig.plant.supervisor.phase != "ready"


def test_an_encoder_that_does_not_count():
    rig = opened()
    rig.faults.stuck = True
    with pytest.raises(RigError, match="encoder stuck"):
        prepare(rig.plant, AutomaticOperator(rig.settings), today=TODAY)


def test_what_is_lowered_stays_lowered():
    settings = fake_settings()
    low = dataclasses.replace(settings, limits=settings.limits.lowered(speed=0.001))
    rig = opened(limits=low.limits)
    prepare(rig.plant, AutomaticOperator(rig.settings), today=TODAY)
    rig.plant.begin()
    readings = rig.plant.advance(0.0254, 1.57, 1000)
    assert readings["speed"].max() < 0.001


def test_a_stop_before_the_first_cut_holds_no_readings_and_is_told_at_once():
    """There is no beginning yet that they could be counted from: not that of the clock, days ago."""
    specimen = Specimen.drawn(3, 0)
    rig = FakeRig(
        functools.partial(SpecimenPlant, MountedSpecimen(specimen=specimen)), fake_settings(), clock=FakeClock(1e6)
    )
    rig.plant.open()
    rig.clock.sleep_until(rig.clock.now() + SETTLE)
    prepare(rig.plant, AutomaticOperator(rig.settings), today=TODAY)
    rig.faults.extra_force = 30.0
    with pytest.raises(RigStopped) as stopped:
        rig.plant.travel(0.01, speed=0.005)
    assert len(stopped.value.readings) == 0
    assert stopped.value.report.cause is Cause.FORCE


class Beside(ScriptedOperator):
    """Person beside a rig of hardware, who does by hand what is asked for."""

    def __init__(self, rig: FakeRig, *, wired: bool = True, push: float = 2.0, away: bool = True) -> None:
        super().__init__()
        self.rig, self.wired, self.push, self.away = rig, wired, push, away

    def confirm(self, question: str, *, expected: str | None = None) -> bool:
        return self.away or "away from the clamp" not in question

    def ask_ready(self, what: str) -> bool:
        pushed = "Push the blade" in what
        self.rig.faults.extra_force = self.push if pushed else 0.0
        if pushed:
            self.rig.clock.sleep_until(self.rig.clock.now() + 0.05)
            assert self.rig.blade.state is not DriveState.ENABLED  # hands are at the blade
        if "Press the stop button" in what and self.wired:
            for drive in (self.rig.blade, self.rig.angle):
                drive.state = DriveState.FAULT
        return True


@pytest.mark.promise("S2")
def test_on_hardware_the_stop_button_and_the_sign_are_proven_once_a_day(tmp_path):
    """The day is noted beside the rig's file; a rig that differs, or another day, is proven again."""

    def prepared(today: date = TODAY, *, wired: bool, **changes) -> FakeRig:
        rig = opened(emulated=False, **changes)
        rig.plant.note = tmp_path / "rig.proven"
        assert prepare(rig.plant, Beside(rig, wired=wired), today=today)
        assert rig.plant.supervisor.phase == "ready"
        return rig

    first = prepared(wired=True)
    first.plant.note = None
    first.plant.halt()
    first.plant.switch_off()
    assert prepare(first.plant, Beside(first, wired=False), today=TODAY)  # it is not asked again
    prepared(wired=False)  # nor by the next program
    other = fake_settings().sensor
    for later in ({"today": TODAY + timedelta(days=1)}, {"sensor": dataclasses.replace(other, port=other.port + 1)}):
        with pytest.raises(RigError, match="still has power"):
            prepared(wired=False, **later)


@pytest.mark.parametrize(
    ("made", "because"),
    [
        ({"wired": False}, "the blade and the angle drive still has power.*safe torque off"),
        ({"push": -2.0}, "correct sensor.sign = 1"),
        ({"push": 0.1}, "sensor.cut_axis"),
    ],
    ids=["button", "sign", "axis"],
)
@pytest.mark.promise("S2")
def test_a_button_without_effect_and_a_force_of_the_wrong_sign_are_found(made, because):
    rig = opened(emulated=False)
    refused(rig, because, Beside(rig, **made))


@pytest.mark.promise("S2")
def test_a_blade_that_goes_toward_the_clamp_first_is_for_the_operator_to_see():
    rig = opened(emulated=False)
    with pytest.raises(RigError, match=r"toward the clamp first, correct blade\.direction"):
        prepare(rig.plant, Beside(rig, away=False), today=TODAY)


@pytest.mark.promise("S12")
def test_a_limit_that_is_lowered_between_cuts_counts_and_one_that_is_raised_does_not():
    rig = opened()
    prepare(rig.plant, AutomaticOperator(rig.settings), today=TODAY)
    usual = rig.settings.limits
    with pytest.raises(RigError, match="while the rig is locked"):
        rig.plant.lower(usual)
    rig.plant.halt()
    rig.plant.lower(dataclasses.replace(usual, force=1.0, high=0.2, speed=0.02))
    assert rig.plant.settings.limits == dataclasses.replace(usual, force=1.0, speed=0.02)
    rig.plant.supervisor.release()
    rig.faults.extra_force = 1.5
    with pytest.raises(RigStopped, match="beyond 1 N"):
        rig.plant.advance(0.01, 1.57, 20)
