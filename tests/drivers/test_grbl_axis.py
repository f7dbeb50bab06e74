"""A machine with GRBL as it is: it moves by jogs, stops, and what it cannot promise is bounded."""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Iterator
from datetime import date
from typing import Any

import pytest
from waiting import until

from cutenv.drivers.conformance import Listening, conform_motion
from cutenv.drivers.grbl_axis import PIECE, SENT_AHEAD, GrblAxis, GrblStatus, grbl_status, jog_line
from cutenv.drivers.slow_profile import grbl_settings
from cutenv.emulation.firmware import EmulatedGrbl
from cutenv.emulation.serial_rig import EmulatedSerialRig, SerialOptions
from cutenv.rig.config.settings import RigSettings, SensorCalibration
from cutenv.rig.contradictions import refuse_contradictions
from cutenv.rig.devices import DriveState, Mounting, RigError, SystemClock
from cutenv.rig.operation.operator import AutomaticOperator
from cutenv.rig.operation.preflight import prepare
from cutenv.rig.plant import rig_plant
from cutenv.rig.safety.stop_causes import Cause
from cutenv.rig.toml_file import template

SPEED = 0.004  # [m/s]


@pytest.fixture
def machine() -> Iterator[EmulatedGrbl]:
    emulated = EmulatedGrbl()
    thread = threading.Thread(target=emulated.run, daemon=True)
    thread.start()
    yield emulated
    emulated.stopped.set()
    thread.join()
    emulated.close()


def axis_of(settings: RigSettings) -> GrblAxis:
    return GrblAxis(Mounting(role="blade", rig=settings, clock=SystemClock()))


@pytest.fixture
def axis(machine: EmulatedGrbl) -> Iterator[tuple[GrblAxis, Listening]]:
    driver, listening = axis_of(grbl_settings(machine.line.port, "")), Listening()
    driver.open(listening)
    driver.set_zero()
    yield driver, listening
    driver.close()


def moving(driver: GrblAxis, machine: EmulatedGrbl) -> None:
    driver.enable()
    driver.command(SPEED)
    until(lambda: machine.speed > 0.95e3 * SPEED)
    time.sleep(0.3)


def test_it_keeps_what_every_driver_promises(machine: EmulatedGrbl) -> None:
    settings = grbl_settings(machine.line.port, "")
    driver = axis_of(settings)
    driver.open(Listening())
    driver.set_zero()
    driver.close()
    missed: list[Any] = []
    for _ in range(3):  # on a busy machine once more
        try:
            findings = conform_motion(axis_of(settings), settings, SystemClock())
            missed = [each for each in findings if not each.kept]
        except RigError as error:
            missed = [error]
        if not missed:
            break
        driver.open(Listening())
        driver.set_zero()
        driver.close()
    assert missed == []


def test_when_the_computer_is_silent_it_goes_on_no_farther_than_stated(
    machine: EmulatedGrbl, axis: tuple[GrblAxis, Listening]
) -> None:
    driver, _ = axis
    moving(driver, machine)
    for turn in driver._turns:  # as if the program were killed
        turn.stop()
    before = machine.position
    until(lambda: machine.speed == 0.0)
    way = 1e-3 * (machine.position - before)
    assert 0.0 < way <= SPEED * (SENT_AHEAD + PIECE + 0.02)
    assert machine.state == "Idle"


def test_a_machine_that_ignores_the_cancel_is_reset_and_loses_its_zero(
    machine: EmulatedGrbl, axis: tuple[GrblAxis, Listening]
) -> None:
    driver, listening = axis
    moving(driver, machine)
    machine.deaf_to_cancel = True
    driver._feed = lambda now: None  # type: ignore[method-assign]
    for _ in range(20):  # a long jog that is under way
        machine._blocks.append([0.5, 4.0])
    driver.quick_stop()
    driver.withhold_heartbeat("it ignores the quick stop")
    until(lambda: machine.speed == 0.0)
    until(lambda: listening.motions[-1].state is DriveState.FAULT)
    assert any("ALARM:3" in trouble for trouble in listening.troubles)
    with driver.latch.resetting():
        driver.clear()
    with pytest.raises(RigError, match="cutenv rig zero"):
        driver.enable()


@pytest.mark.parametrize("state", ["Run", "Hold:0", "Door:1", "Home", "Check"])
def test_a_machine_that_does_anything_but_our_jogs_is_a_fault_and_is_held_and_reset(
    machine: EmulatedGrbl, axis: tuple[GrblAxis, Listening], state: str
) -> None:
    driver, listening = axis
    moving(driver, machine)
    driver._handle(f"<{state}|MPos:1.000,0.000,0.000|FS:360,0>".encode(), 0.0)
    assert any("not in a jog" in trouble for trouble in listening.troubles)
    until(lambda: machine.speed == 0.0)
    until(lambda: any("ALARM:3" in trouble or "restarted" in trouble for trouble in listening.troubles))
    assert listening.motions[-1].state is DriveState.FAULT
    with pytest.raises(RigError):
        driver.command(SPEED)


def test_an_alarm_of_its_limit_switch_is_reported_and_needs_clearing(
    machine: EmulatedGrbl, axis: tuple[GrblAxis, Listening]
) -> None:
    driver, listening = axis
    moving(driver, machine)
    machine.alarm(1)
    until(lambda: any("ALARM:1" in trouble for trouble in listening.troubles))
    with pytest.raises(RigError):
        driver.command(SPEED)


def test_after_the_machine_restarts_its_zero_is_not_believed(machine: EmulatedGrbl) -> None:
    settings = grbl_settings(machine.line.port, "")
    driver = axis_of(settings)
    driver.open(Listening())
    driver.set_zero()
    driver.close()
    machine.reset()
    driver = axis_of(settings)
    driver.open(Listening())
    with pytest.raises(RigError, match="does not know where the blade stands"):
        driver.enable()
    driver.close()


def test_a_cable_that_is_out_is_reported_once(machine: EmulatedGrbl, axis: tuple[GrblAxis, Listening]) -> None:
    driver, listening = axis
    moving(driver, machine)
    machine.line.unplug()
    until(lambda: listening.troubles)
    time.sleep(0.2)
    assert len([trouble for trouble in listening.troubles if "broken" in trouble]) == 1


@pytest.mark.parametrize(("number", "value", "asked"), [(110, 1000.0, r"\$110=360.000"), (120, 10.0, r"\$120=100.000"),
                                                        (10, 0.0, r"\$10=1"), (13, 1.0, r"\$13=0")])  # fmt: skip
def test_a_machine_that_is_set_otherwise_is_refused_with_the_lines_to_send(
    machine: EmulatedGrbl, number: int, value: float, asked: str
) -> None:
    machine.settings[number] = value
    with pytest.raises(RigError, match=f"Send it {asked}"):
        axis_of(grbl_settings(machine.line.port, "")).open(Listening())


def test_a_port_without_grbl_is_named(machine: EmulatedGrbl, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.drivers.grbl_axis._BOOT", 0.2)
    monkeypatch.setattr("cutenv.drivers.grbl_axis.ANSWERED", 0.2)
    machine.line.mute = True
    with pytest.raises(RigError, match="no GRBL answers at"):
        axis_of(grbl_settings(machine.line.port, "")).open(Listening())


@pytest.mark.parametrize(
    ("line", "found"),
    [
        (b"<Idle|MPos:1.000,-2.500,0.000|FS:0,0>", GrblStatus("Idle", (1.0, -2.5, 0.0), 0.0, "")),
        (
            b"<Jog|MPos:1.000,0.000,0.000|FS:240,0|Pn:XZ|Ov:100,100,100>",
            GrblStatus("Jog", (1.0, 0.0, 0.0), 240, "XZ"),
        ),
        (b"<Hold:0|MPos:1.000,0.000,0.000|Bf:15,128|F:12.5>", GrblStatus("Hold", (1.0, 0.0, 0.0), 12.5, "")),
        (b"<Idle|WPos:1.000,0.000,0.000|FS:0,0>", None),
        (b"<Idle|MPos:1.0", None),
        (b"<Idle|MPos:1.000|FS:0,0>", None),
        (b"<Idle|MPos:1.000,0.000,0.000>", None),
        (b"ok", None),
        (b"", None),
    ],
)
def test_status_reports_are_read_whole_or_not_at_all(line: bytes, found: GrblStatus | None) -> None:
    assert grbl_status(line) == found


def test_a_jog_is_a_line_as_the_protocol_has_it() -> None:
    assert jog_line("X", -0.1, 240.0) == b"$J=G91G21X-0.1000F240.00\n"


def test_its_profile_contradicts_nothing_and_what_it_cannot_do_is_refused() -> None:
    settings = grbl_settings("/dev/x", "/dev/y")
    refuse_contradictions(settings)
    for changes, said in (
        ({"blade": dataclasses.replace(settings.blade, quick_stop=0.5)}, "one deceleration for both"),
        ({"bus": dataclasses.replace(settings.bus, sync=0.01)}, "every 100 ms. Write 100"),
    ):
        with pytest.raises(ValueError, match=said):
            refuse_contradictions(dataclasses.replace(settings, **changes))
    assert 'letter = "X"' in template("rig", like=settings)


def test_a_whole_rig_is_prepared_moves_to_and_fro_stops_and_keeps_its_zero(machine: EmulatedGrbl) -> None:
    board = EmulatedSerialRig(SerialOptions(mounted=None))
    board.step(board.now())  # compiles
    threading.Thread(target=board.run, daemon=True).start()
    settings = grbl_settings(machine.line.port, board.line.port)
    patient = dataclasses.replace(settings.limits, overrun=5.0, stale_force=0.3, late_force=0.3)  # of a busy machine
    plant = rig_plant(
        dataclasses.replace(
            settings, emulated=True, armed_by="a test", limits=patient,
            calibration=SensorCalibration(date=date.today().isoformat()),
        )
    )  # fmt: skip
    plant.open()
    try:
        plant.spine.set_zero()
        operator = AutomaticOperator(plant.settings)
        prepare(plant, operator, today=date.today())
        assert "Did the blade move so?" in operator.asked[-1]
        plant.begin()
        for speed in (0.004, 0.004, 0.004, -0.002, -0.002, 0.003, 0.003):
            plant.advance(speed, plant.settings.fixed_angle, 200)
        plant.supervisor.trip(Cause.OPERATOR, "to try it")
        until(lambda: plant.supervisor.report is not None and plant.supervisor.report.standstill)
        plant.supervisor.reset(agreed=True)
        plant.power()  # its zero is still there
        assert plant.position == pytest.approx(1e-3 * machine.position, abs=2e-5)
    finally:
        plant.close()
        board.stopped.set()
        board.close()
