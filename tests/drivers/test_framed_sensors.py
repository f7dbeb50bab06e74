"""Robotiq FT 300 and Bota sensor on a serial line: true forces, damaged frames, a cable that is pulled, their files."""

from __future__ import annotations

import dataclasses
import math
import random
from collections.abc import Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from framed_device import LOADS, EmulatedBota, EmulatedRobotiq, serving
from waiting import until

from cutenv.commands import cli
from cutenv.commands.rig.init import SENSORS
from cutenv.drivers.bota_sensor import bota_frame
from cutenv.drivers.conformance import Listening
from cutenv.drivers.framed_sensor import FrameError, FrameFormat, FrameReader
from cutenv.drivers.robotiq_sensor import robotiq_frame
from cutenv.drivers.slow_profile import slow_limits
from cutenv.emulation.process import RunningEmulator, start
from cutenv.rig.config.settings import RigSettings, SafetyLimits, SensorCalibration
from cutenv.rig.contradictions import refuse_contradictions
from cutenv.rig.devices import Mounting, RigError, SystemClock
from cutenv.rig.devices.driver_registry import mounted
from cutenv.rig.operation.operator import AutomaticOperator
from cutenv.rig.operation.preflight import prepare
from cutenv.rig.plant import rig_plant
from cutenv.rig.safety.stop_causes import Cause
from cutenv.rig.toml_file import template, to_toml

DEVICES: dict[str, Any] = {"robotiq": EmulatedRobotiq, "bota": EmulatedBota}
FORMS = {"robotiq": FrameFormat(b"\x20\x4e", 16, robotiq_frame), "bota": FrameFormat(b"\xaa", 37, bota_frame)}
DAMAGED = 100_000


def settings_of(name: str, device: Any, **sensor: Any) -> RigSettings:
    usual = SENSORS[name]
    part = dataclasses.replace(usual, options=dataclasses.replace(usual.options, port=device.line.port), **sensor)
    limits = slow_limits(part.rate) if part.rate < 200.0 else SafetyLimits()
    return RigSettings(name="bench", sensor=part, limits=limits, emulated=True)


def driver_at(name: str, device: Any, **sensor: Any) -> Any:
    return mounted(Mounting(role="sensor", rig=settings_of(name, device, **sensor), clock=SystemClock()))


@pytest.fixture(params=sorted(DEVICES))
def sensor(request: pytest.FixtureRequest) -> Iterator[tuple[Any, Any, Listening]]:
    """A device, its open driver, and what that has reported."""
    with serving(DEVICES[request.param]()) as device:
        driver, listening = driver_at(request.param, device), Listening()
        driver.open(listening)
        yield device, driver, listening
        driver.close()


def test_readings_are_the_six_loads_and_none_is_lost(sensor: tuple[Any, Any, Listening]) -> None:
    listening = sensor[2]
    until(lambda: len(listening.forces) > 100)
    loads = np.array([(*each.force, *each.torque) for each in listening.forces]).mean(axis=0)
    assert loads == pytest.approx(LOADS, abs=0.01)
    assert sum(each.lost for each in listening.forces) == 0
    numbers = [each.sequence for each in listening.forces]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert {each.status for each in listening.forces} == {0}
    assert listening.troubles == []


def test_a_tare_takes_forces_and_torques_off(sensor: tuple[Any, Any, Listening]) -> None:
    _, driver, listening = sensor
    assert driver.tare(50) == pytest.approx(LOADS[:3], abs=0.02)
    begun = len(listening.forces)
    until(lambda: len(listening.forces) > begun + 50)
    late = np.array([(*each.force, *each.torque) for each in listening.forces[begun:]]).mean(axis=0)
    assert late == pytest.approx(0.0, abs=0.02)
    assert driver.tare(50) == pytest.approx(LOADS[:3], abs=0.02)  # the whole zero, not what is added to it


def test_a_pulled_cable_is_told_and_ends_the_readings(sensor: tuple[Any, Any, Listening]) -> None:
    device, driver, listening = sensor
    device.unplug()
    until(lambda: listening.troubles)
    assert "cannot be read any more" in listening.troubles[-1]
    driver.close()
    with pytest.raises(RigError, match="there is no such device"):
        driver.open(Listening())
    device.line.plug()
    driver.open(again := Listening())
    until(lambda: len(again.forces) > 3)


def test_a_frame_lost_on_the_way_is_counted(sensor: tuple[Any, Any, Listening]) -> None:
    device, driver, listening = sensor
    until(lambda: len(listening.forces) > 20)
    device.damage = lambda frame: frame[:-1] + bytes([frame[-1] ^ 1]) if device.sent % 20 == 0 else frame
    until(lambda: len(listening.forces) > 100)
    lost = sum(each.lost for each in listening.forces)
    assert lost == 2 * len(listening.troubles) > 0  # the damaged one, and the next, which only brings them into step
    first, last = listening.forces[0], listening.forces[-1]
    assert last.sequence - first.sequence == len(listening.forces) - 1 + lost
    assert driver.about()["damaged_frames"] == len(listening.troubles)


def damaged(frame: bytes, kind: str, rng: random.Random) -> bytes:
    """A frame that is damaged on its way: some bits, a burst of up to 16, a byte too few or too many, or all of it."""
    bits = 8 * len(frame)
    if kind == "bits":
        flips = sum(1 << bit for bit in rng.sample(range(bits), rng.randint(1, 3)))
    elif kind == "burst":
        length = rng.randint(1, 16)
        flips = (rng.getrandbits(length) | 1) << rng.randrange(bits - length + 1)
    elif kind == "short":
        place = rng.randrange(len(frame))
        return frame[:place] + frame[place + 1 :]
    elif kind == "long":
        place = rng.randrange(len(frame) + 1)
        return frame[:place] + rng.randbytes(1) + frame[place:]
    else:
        return rng.randbytes(len(frame))
    return (int.from_bytes(frame, "little") ^ flips).to_bytes(len(frame), "little")


@pytest.mark.parametrize("name", sorted(FORMS))
def test_of_100_000_damaged_frames_none_gives_a_wrong_force(name: str) -> None:
    rng, device, reader = random.Random(2), DEVICES[name](), FrameReader(FORMS[name])
    sound = [device.frame([rng.uniform(-9.0, 9.0) for _ in range(6)]) for _ in range(500)]
    true = {FORMS[name].parse(frame) for frame in sound}
    device.line.close()
    kinds = ["bits", "burst", "short", "long", "all"]
    stream, harmed = b"", 0
    wrong = believed = faults = 0
    while harmed < DAMAGED:
        for frame in rng.choices(sound, k=200):
            hurt = harmed < DAMAGED and rng.random() < 0.5
            harmed += hurt
            stream += damaged(frame, kinds[harmed % 5], rng) if hurt else frame
        for found in reader.take(stream):
            if isinstance(found, FrameError):
                faults += 1
            else:
                believed += 1
                wrong += found[0] not in true
        stream = b""
    assert wrong == 0
    assert faults > 0.2 * DAMAGED
    assert believed > 0.2 * DAMAGED


def test_noise_alone_is_no_reading_and_ends_in_an_error_with_the_cure(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.rig.devices.driver_bases.FIRST_READING", 0.3)
    with serving(EmulatedBota()) as device:
        device.damage = lambda frame: random.Random(device.sent).randbytes(len(frame))
        with pytest.raises(RigError, match="does not read: no reading came within"):
            driver_at("bota", device).open(Listening())


@pytest.mark.parametrize("name", sorted(DEVICES))
def test_a_device_that_does_not_answer_is_named_with_what_to_look_at(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module in ("robotiq_sensor", "bota_sensor"):
        monkeypatch.setattr(f"cutenv.drivers.{module}._ANSWER", 0.05)
    monkeypatch.setattr("cutenv.drivers.bota_sensor._BOOT", 0.1)
    with serving(DEVICES[name]()) as device:
        device.line.deaf, device.streaming = True, False
        with pytest.raises(RigError, match=r"answers at .* baud. Has it (its 24 V|power)"):
            driver_at(name, device).open(Listening())


def test_a_gripper_on_the_port_is_no_sensor() -> None:
    with serving(EmulatedRobotiq()) as device:
        device.firmware = b"GCC\x01\x02\x03"
        with pytest.raises(RigError, match="is no FT 300: it calls its firmware b'GCC"):
            driver_at("robotiq", device).open(Listening())


def test_a_bota_sensor_is_set_up_for_the_rate_of_its_file_even_while_it_starts() -> None:
    with serving(EmulatedBota(starts=0.7)) as device:
        driver, listening = driver_at("bota", device, rate=400.0), Listening()
        driver.open(listening)
        until(lambda: len(listening.forces) > 50)
        driver.close()
        assert device.set_up[-4:] == [b"C", b"c,0,1,0,4", b"f,128,0,0,1", b"R"]
        assert listening.forces[-1].sequence - listening.forces[0].sequence == len(listening.forces) - 1


def test_a_load_beyond_the_range_and_a_sick_sensor_have_a_status() -> None:
    with serving(EmulatedRobotiq()) as device:
        device.loads[2] = 301.0
        driver, listening = driver_at("robotiq", device), Listening()
        driver.open(listening)
        assert listening.forces[-1].status == 1
        with pytest.raises(RigError, match="at the end of the range"):
            driver.tare(20)
        driver.close()
    with serving(EmulatedBota()) as device:
        device.status = 2
        driver = driver_at("bota", device)
        driver.open(Listening())
        with pytest.raises(RigError, match="force or torque out of range"):
            driver.tare(20)
        driver.close()


@pytest.mark.parametrize("change", [{"temperature": math.nan}, {"temperature": 900.0}, {"status": 16}])
def test_a_bota_frame_that_says_what_cannot_be_is_refused_though_its_crc_is_right(change: dict[str, Any]) -> None:
    device = EmulatedBota()
    device.line.close()
    assert bota_frame(device.frame([0.0] * 6)).status == 0
    vars(device).update(change)
    with pytest.raises(FrameError, match="says what cannot be"):
        bota_frame(device.frame([0.0] * 6))
    with pytest.raises(FrameError, match="says what cannot be"):
        bota_frame(EmulatedBota.frame(device, [math.inf] + [0.0] * 5))


def test_frames_and_requests_are_those_of_the_makers() -> None:
    # Modbus: CRC of "123456789" is 0x4B37; X-25: 0x906E (catalogue of CRCs).
    from cutenv.drivers.bota_sensor import x25_crc
    from cutenv.drivers.robotiq_sensor import modbus_crc

    assert modbus_crc(b"123456789") == 0x4B37
    assert x25_crc(b"123456789") == 0x906E


@pytest.mark.parametrize("name", sorted(DEVICES))
def test_its_file_conforms_by_the_command_and_what_it_cannot_do_is_refused(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with serving(DEVICES[name]()) as device:
        path = tmp_path / "bench.toml"
        filled = dataclasses.replace(
            settings_of(name, device), emulated=False, armed_by="a test",
            depth_profile=((0.0, 0.02), (0.149, 0.02)), calibration=SensorCalibration(date=date.today().isoformat()),
        )  # fmt: skip
        patient = dataclasses.replace(
            filled.limits, stale_force=0.15, late_force=0.15, frozen_force=0.15
        )  # if it is busy
        path.write_text(to_toml(dataclasses.replace(filled, limits=patient)), encoding="utf-8")
        for _ in range(3):
            if cli.main(["rig", "conform", str(path), "--section", "sensor"]) == 0:
                break
        told = capsys.readouterr()
        assert "promises are kept" in told.out, told
    refuse_contradictions(filled)
    with pytest.raises(ValueError, match=r"sensor\.rate_Hz = 500"):
        refuse_contradictions(dataclasses.replace(filled, sensor=dataclasses.replace(filled.sensor, rate=500.0)))


def test_a_new_file_with_such_a_sensor_asks_for_its_port(tmp_path: Path) -> None:
    for name in DEVICES:
        path = tmp_path / f"{name}.toml"
        assert cli.main(["rig", "init", str(path), "--sensor", name]) == 0
        text = path.read_text(encoding="utf-8")
        assert f'driver = "{name}"' in text
        assert "# FILL IN:" in text.partition("[sensor.options]")[2].partition("[limits]")[0]
    assert "stale_force_ms = 40" in (tmp_path / "robotiq.toml").read_text(encoding="utf-8")
    assert template("rig")


@pytest.fixture(scope="module")
def board() -> Iterator[RunningEmulator]:
    """A board in a process of its own: in this one, sensor, drivers and board would wait for each other."""
    with start(kind="serial", free_air=True) as running:
        yield running


@pytest.mark.parametrize("name", sorted(DEVICES))
def test_a_moving_blade_stops_when_the_sensors_cable_is_pulled(name: str, board: RunningEmulator) -> None:
    with serving(DEVICES[name]()) as device:
        rig = board.settings
        limits = dataclasses.replace(rig.limits, stale_force=0.08, late_force=0.3, overrun=5.0)  # of a busy machine
        plant = rig_plant(
            dataclasses.replace(rig, sensor=settings_of(name, device, rate=100.0).sensor, limits=limits)
        )  # fmt: skip
        plant.open()
        try:
            plant.spine.set_zero()
            prepare(plant, AutomaticOperator(plant.settings), today=date.today())
            plant.begin()
            plant.advance(0.004, plant.settings.fixed_angle, 300)
            before = plant.position
            assert before > 5e-4
            device.unplug()
            with pytest.raises(RigError):
                plant.advance(0.004, plant.settings.fixed_angle, 1000)
            report = until(lambda: plant.supervisor.report)
            assert report.cause is Cause.FORCE_STALE
            until(lambda: plant.supervisor.report.standstill)
            assert plant.position - before < 0.004 * 0.5
        finally:
            plant.close()
