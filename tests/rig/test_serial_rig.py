"""Drivers of the serial rig against the board's own sketch behind a pseudo-terminal, and what its file may say."""

from __future__ import annotations

import dataclasses
import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import date
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from waiting import until

from cutenv.commands import cli
from cutenv.commands.rig.run import paced
from cutenv.commands.rig.weigh import mass_of, measured_values
from cutenv.drivers.conformance import Listening
from cutenv.drivers.slow_profile import RATES, slow_settings
from cutenv.emulation import process
from cutenv.emulation.process import RunningEmulator
from cutenv.emulation.serial_rig import (
    GRBL_FAULTS,
    SERIAL_FAULTS,
    EmulatedGrblRig,
    EmulatedSerialRig,
    SerialOptions,
)
from cutenv.rig.config.settings import SIDE, RigSettings, SafetyLimits, SensorCalibration
from cutenv.rig.contradictions import refuse_contradictions
from cutenv.rig.devices import DriveState, ForceSample, Mounting, RigError, SystemClock
from cutenv.rig.devices.driver_registry import mounted
from cutenv.rig.devices.serial.board import board_line
from cutenv.rig.operation.suitability import decisions, fits, stopping_ways, suitability_lines
from cutenv.rig.operation.weighing import GRAVITY, Weighing, weigh
from cutenv.rig.plant import rig_plant
from cutenv.rig.safety.monitors import ForceMonitor, ForceReadings
from cutenv.rig.safety.stop_causes import Cause
from cutenv.rig.toml_file import read_rig_file, template, to_toml
from scripts.validation.rig import rig_faults, rig_trials


@pytest.fixture
def rig() -> Iterator[EmulatedSerialRig]:
    """An emulated serial rig in a thread of this process, in air."""
    emulated = EmulatedSerialRig(SerialOptions(mounted=None))
    emulated.step(emulated.now())  # compiles
    thread = threading.Thread(target=emulated.run, daemon=True)
    thread.start()
    yield emulated
    emulated.stopped.set()
    thread.join()
    emulated.close()


def settings_for(rig: EmulatedSerialRig, **changes: Any) -> RigSettings:
    return dataclasses.replace(slow_settings(rig.line.port), emulated=True, **changes)


def drivers_of(settings: RigSettings) -> tuple[Any, Any]:
    shared: dict[Any, Any] = {}
    blade, sensor = (
        mounted(Mounting(role=role, rig=settings, clock=SystemClock(), shared=shared)) for role in ("blade", "sensor")
    )
    return blade, sensor


@pytest.fixture
def blade(rig: EmulatedSerialRig) -> Iterator[tuple[Any, Listening]]:
    driver, listening = drivers_of(settings_for(rig))[0], Listening()
    driver.open(listening)
    yield driver, listening
    driver.close()


def test_the_notice_of_compiling_looks_for_the_kernels_of_a_serial_rig_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would else be printed at every start by those who emulate no other rig."""
    asked: list[Any] = []
    monkeypatch.setattr(process, "warn_before_first_compile", lambda *kernels: asked.extend(kernels))
    process.warm_up(serial=True)
    assert [kernel.__name__ for kernel in asked] == ["follow", "measure"]


def test_axis_and_load_cell_share_one_port_and_both_report(rig: EmulatedSerialRig) -> None:
    blade, sensor = drivers_of(settings_for(rig))
    listening = Listening()
    blade.open(listening)
    sensor.open(listening)
    until(lambda: len(listening.motions) > 5 and len(listening.forces) > 5)
    assert listening.motions[-1].state is DriveState.DISABLED
    blade.close()
    seen = len(listening.forces)
    until(lambda: len(listening.forces) > seen + 3)  # the port stays open for the other
    sensor.close()
    assert listening.troubles == []


def test_a_missing_port_is_named_with_those_that_are_there() -> None:
    with pytest.raises(RigError, match=r"/dev/no-board cannot be opened: there is no such device. Present are:"):
        drivers_of(slow_settings("/dev/no-board"))[0].open(Listening())


@pytest.mark.parametrize("kind", [EmulatedSerialRig, EmulatedGrblRig])
def test_a_port_is_closed_only_between_two_steps(kind: type[EmulatedSerialRig]) -> None:
    """A step that is under way would read a terminal that is gone, or another file that got its number."""
    emulated = kind()
    with emulated.lock:  # as in the middle of a step
        closing = threading.Thread(target=emulated.close)
        closing.start()
        until(emulated.stopped.is_set)
        assert emulated.line.plugged
    closing.join(5.0)
    assert not emulated.line.plugged
    emulated.step(0.0)


def test_two_programs_on_one_port_are_refused_the_second(rig: EmulatedSerialRig, blade: tuple[Any, Listening]) -> None:
    with pytest.raises(RigError, match="another program has it"):
        drivers_of(settings_for(rig))[0].open(Listening())
    driver, listening = blade
    driver.enable()
    assert listening.troubles == []


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        ("noise", r"no cutenv board answers at .* and 500000 baud. What came was .*baud rate"),
        ("board_mute", "Nothing came. Is it powered"),
    ],
)
def test_another_baud_rate_or_a_silent_board_is_said_to_be_the_cause(
    rig: EmulatedSerialRig, monkeypatch: pytest.MonkeyPatch, fault: str, said: str
) -> None:
    monkeypatch.setattr("cutenv.rig.devices.serial.board._BOOT", 0.4)
    rig.inject(fault, {})
    with pytest.raises(RigError, match=said):
        drivers_of(settings_for(rig))[0].open(Listening())


def test_a_board_of_another_protocol_is_refused(rig: EmulatedSerialRig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.rig.devices.serial.board.BOARD_PROTOCOL", 2)
    with pytest.raises(RigError, match="speaks version 1 of the protocol, this program 2"):
        drivers_of(settings_for(rig))[0].open(Listening())


def test_after_a_restart_it_stops_says_so_and_needs_its_zero_again(
    rig: EmulatedSerialRig, blade: tuple[Any, Listening]
) -> None:
    driver, listening = blade
    driver.enable()
    driver.command(0.004)
    until(lambda: listening.motions[-1].position > 0.0005)
    rig.inject("board_restart", {})
    until(lambda: any("restarted" in trouble for trouble in listening.troubles))
    stands = rig.position
    driver.close()
    driver.open(listening)
    with pytest.raises(RigError, match=r"does not know where the blade stands.*cutenv rig zero"):
        driver.enable()
    driver.set_zero()
    driver.enable()
    assert rig.position == stands
    assert listening.motions[-1].position == 0.0


def test_a_cable_that_comes_back_under_another_name_is_found_again_when_the_rig_is_opened(
    rig: EmulatedSerialRig, blade: tuple[Any, Listening]
) -> None:
    driver, listening = blade
    driver.enable()
    driver.command(0.004)
    until(lambda: listening.motions[-1].speed > 0.003)
    rig.inject("cable_out", {})
    until(lambda: listening.troubles)
    assert len(listening.troubles) == 1
    assert "broken" in listening.troubles[0]
    with pytest.raises(RigError):
        driver.command(0.004)
    until(lambda: rig.speed == 0.0)  # by its own watch
    rig.clear("cable_out")
    driver.close()
    driver.open(listening)
    driver.enable()
    driver.close()


# What its file may say


@pytest.mark.parametrize("converter", RATES)
def test_the_slow_profile_contradicts_nothing(converter: str) -> None:
    refuse_contradictions(slow_settings("/dev/x", converter=converter))


def changed(section: str, **changes: Any) -> RigSettings:
    settings = slow_settings("/dev/x")
    return dataclasses.replace(settings, **{section: dataclasses.replace(getattr(settings, section), **changes)})


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        (lambda: changed("blade", speed=0.06), "24000 steps a second, and the board makes 20000 at most"),
        (lambda: changed("blade", acceleration=0.001, quick_stop=0.01), "the board takes 1000 at least"),
        (lambda: changed("bus", sync=0.005), "every 10 ms. Write 10"),
        (lambda: changed("blade", options=None), r"needs \[blade.options\]"),
        (lambda: changed("limits", stale_force=0.02), "time of 3 readings or more. Allow 37.5 ms"),
        (lambda: changed("limits", frozen_force=0.02), "time of 5 readings or more"),
        (
            lambda: dataclasses.replace(slow_settings("/dev/x"), side=SIDE),
            r"side.force_axis = .* a load cell .* measures the force along the cut alone.* leave \[side\] out",
        ),
        (lambda: changed("limits", stale_motion=0.015), "one may be late: allow two periods or more"),
    ],
)
def test_what_no_board_can_do_is_refused_before_it_is_connected(settings: Callable[[], RigSettings], said: str) -> None:
    with pytest.raises(ValueError, match=said):
        refuse_contradictions(settings())


def test_the_files_profile_lists_what_only_a_person_knows_and_is_read_when_filled_in(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    assert cli.main(["rig", "init", str(file), "--profile", "serial"]) == 0
    text = file.read_text()
    asked = {line[11:].partition(" =")[0] for line in text.split("\n") if line.startswith("# FILL IN: ")}
    assert asked == {"depth_profile", "lead_mm", "port", "steps", "counts_per_N", "date"}
    filled = read_rig_file(_filled(file, text))
    assert filled.blade.driver == filled.sensor.driver == "serial"
    assert filled.blade.options.steps == 3200


def _filled(file: Path, text: str) -> Path:
    file.write_text(text.replace("# FILL IN: ", "").replace("\n# # FILL", "\n# # FILL"))
    return file


def test_a_rig_at_a_real_port_cannot_be_called_emulated(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    settings = dataclasses.replace(
        slow_settings("/dev/null"), emulated=True, depth_profile=((0.0, 0.01), (0.15, 0.02)),
        calibration=SensorCalibration(date="2026-01-01"),
    )  # fmt: skip
    file.write_text(to_toml(settings))
    with pytest.raises(ValueError, match=r"emulated = true.*'serial'"):
        read_rig_file(file)


def test_only_the_template_of_canopen_speaks_of_a_can_bus() -> None:
    assert "interface" in template("rig")
    serial = template("rig", like=slow_settings(""))
    assert not [line for line in serial.split("\n") if line.startswith(("interface", "# FILL IN: interface", "pulses"))]


# What such a rig can do


def possible(settings: RigSettings) -> dict[str, bool]:
    return {each.name: each.possible for each in fits(settings)}


def test_each_decision_sees_what_the_last_one_did() -> None:
    assert [decisions(slow_settings("/dev/x", converter=each)) for each in RATES] == [10, 50, 25]
    assert decisions(RigSettings()) == 125


def test_a_slow_rig_cuts_at_a_fixed_angle_and_says_what_it_cannot() -> None:
    able = possible(slow_settings("/dev/x"))
    assert able["RigCut-v1, angle fixed"]
    assert able["records to score"]
    assert not able["RigCut-v1, angle free"]
    assert not able["RigDepthCut-v1"]
    assert not able["policies at full speed"]
    assert not able["sudden runs as they are"]
    assert possible(slow_settings("/dev/x", converter="ads1220"))["sudden runs as they are"]


def test_ten_readings_a_second_are_for_records_only() -> None:
    settings = slow_settings("/dev/x")
    cell = dataclasses.replace(settings.sensor.options, delay=0.4)
    slowest = dataclasses.replace(settings, sensor=dataclasses.replace(settings.sensor, rate=10.0, options=cell))
    assert [name for name, can in possible(slowest).items() if can] == ["records to score"]


def test_ways_of_a_stop_grow_with_the_sensors_delay_and_the_drives_patience() -> None:
    ways = {each: stopping_ways(slow_settings("/dev/x", converter=each)) for each in RATES}
    assert ways["hx711"]["force beyond its limit"] == pytest.approx(
        0.005 / 1.04 * (0.050 + 1 / 80 + 0.002) + (0.005 / 1.04) ** 2 / 1.0
    )
    assert ways["ads1220"]["force beyond its limit"] < 0.25 * ways["hx711"]["force beyond its limit"]
    assert ways["hx711"]["computer silent"] == pytest.approx(0.51e-3, abs=0.05e-3)
    assert "computer silent          0.51 mm" in "\n".join(suitability_lines(slow_settings("/dev/x")))


def test_a_script_decides_as_fast_as_the_rig_allows_and_a_trained_policy_keeps_its_rate() -> None:
    slow = slow_settings("/dev/x")
    assert paced({}, slow) == ({"control_hz": 10}, "10 decisions a second, as this rig allows")
    assert paced({"control_hz": 10}, slow) == ({"control_hz": 10}, "")
    assert paced({"control_hz": 50}, slow)[0] == {"control_hz": 50}
    assert "decides 50 times a second; on this rig 10" in paced({"control_hz": 50}, slow)[1]
    assert paced({}, RigSettings()) == ({}, "")


# Watches of a slow sensor


def monitored(rate: float, true_rate: float, *, rate_error: float, axes: str = "x") -> set[Cause]:
    limits = slow_settings("/dev/x").limits
    monitor = ForceMonitor(limits, ForceReadings(rate, rate_error, axes))
    found = set()
    for number in range(round(10.0 * true_rate)):
        counts = (number * 7919 % 1009, 0, 0, 0, 0, 0)
        sample = ForceSample(number / true_rate, (1e-4 * counts[0], 0.0, 0.0), counts, 0, number, 0)
        if (breach := monitor.check(sample, moving=True)) is not None:
            found.add(breach.cause)
    return found


def test_a_converter_with_a_clock_of_its_own_is_not_called_late() -> None:
    assert monitored(80.0, 72.0, rate_error=0.15) == set()
    assert monitored(80.0, 88.0, rate_error=0.15) == set()
    assert Cause.FORCE_LATE in monitored(80.0, 72.0, rate_error=0.001)


def test_axes_that_a_sensor_does_not_have_are_not_watched_for_life() -> None:
    assert monitored(80.0, 80.0, rate_error=0.15, axes="xyz") == {Cause.FORCE_AXIS}


@pytest.mark.parametrize("rate", [10.0, 80.0, 1000.0])
def test_a_rise_is_that_of_its_window_whatever_the_rate(rate: float) -> None:
    limits = SafetyLimits(force_rise=100.0, force=50.0, force_norm=50.0)
    for slope, stops in ((80.0, False), (130.0, True)):
        monitor = ForceMonitor(limits, ForceReadings(rate, axes="x"))
        breaches = [
            monitor.check(ForceSample(k / rate, (slope * k / rate, 0.0, 0.0), (k, 0, 0, 0, 0, 0), 0, k, 0))
            for k in range(max(round(0.1 * rate), 4))
        ]
        assert (Cause.FORCE_RISE in {each.cause for each in breaches if each}) is stops, slope


# Calibration by weights, and zero


class Weights:
    """Operator who hangs weights on an emulated rig."""

    def __init__(self, rig: EmulatedSerialRig, masses: list[float]) -> None:
        self.rig, self.masses = rig, list(masses)

    def ask_ready(self, what: str) -> bool:
        self.rig.bench.add_force(GRAVITY * self.masses.pop(0))
        time.sleep(0.1)
        return True

    def tell(self, message: str) -> None: ...

    def confirm(self, question: str, *, expected: str | None = None) -> bool:
        return True


def test_weights_find_the_counts_of_a_newton(rig: EmulatedSerialRig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cutenv.rig.operation.weighing.LISTENED", 0.4)
    settings = settings_for(rig)
    wrong = dataclasses.replace(settings.sensor.options, counts_per_N=20_000.0)
    plant = rig_plant(dataclasses.replace(settings, sensor=dataclasses.replace(settings.sensor, options=wrong)))
    plant.open()
    try:
        masses = [0.0, 0.1, 0.5]
        found = weigh(plant, masses, Weights(rig, masses))
    finally:
        plant.close()
    assert found.counts_per_newton == pytest.approx(42_800.0, rel=0.005)
    assert found.gain == pytest.approx(20_000.0 / 42_800.0, rel=0.005)
    assert found.residual < 0.01
    values = measured_values(found, plant.settings, date(2026, 3, 1))
    assert values["sensor", "options", "counts_per_N"] == pytest.approx(42_800.0, rel=0.005)
    assert values["calibration", "date"] == "2026-03-01"


def test_weights_that_change_nothing_or_are_none_are_refused(
    rig: EmulatedSerialRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("cutenv.rig.operation.weighing.LISTENED", 0.3)
    plant = rig_plant(settings_for(rig))
    plant.open()
    try:
        with pytest.raises(RigError, match="readings change by"):
            weigh(plant, [0.0, 0.2], Weights(rig, [0.0, 0.0]))
        with pytest.raises(ValueError, match="two different ones"):
            weigh(plant, [0.2, 0.2], Weights(rig, []))
        with pytest.raises(ValueError, match=r"masses = 500 kg is outside"):
            weigh(plant, [0.0, 500.0], Weights(rig, []))
    finally:
        plant.close()
    for text in ("200", "0.2 kg", "xg", "..kg", "-1g"):
        with pytest.raises(ValueError, match="mass with its unit"):
            mass_of(text)
    assert (mass_of("200g"), mass_of("0.2kg")) == (0.2, 0.2)


def test_another_sensors_calibration_is_its_gain() -> None:
    weighing = Weighing(masses=(0.0, 1.0), counts=(0.0, 9.0e6), readings=(0.0, GRAVITY / 1.1))
    assert measured_values(weighing, RigSettings(), date(2026, 3, 1)) == {
        ("calibration", "date"): "2026-03-01", ("calibration", "gain"): pytest.approx(1.1, rel=1e-5),
    }  # fmt: skip


def test_a_drive_with_a_reference_of_its_own_takes_no_zero(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["rig", "zero", "fake"]) == 1
    assert "keeps its own zero" in capsys.readouterr().err


# Faults in real time


def test_each_fault_of_the_emulator_has_its_row_in_the_table() -> None:
    assert set(rig_trials.EXPECTED_OF_SERIAL) == {*SERIAL_FAULTS, *rig_trials.OWN}
    assert set(rig_trials.EXPECTED_OF_GRBL) == {*GRBL_FAULTS, *rig_trials.OWN}


def test_faults_of_a_cut_in_real_time_stop_it_as_stated() -> None:
    with rig_faults.Trials(kind="serial") as trials:
        for fault in ("cell_silent", "stop_button", "board_deaf", "kill_9", "cable_out"):
            done = trials.one(fault, np.random.default_rng(1))
            wrong = done.wrong()
            if wrong:  # a busy machine: once more
                wrong = trials.one(fault, np.random.default_rng(2)).wrong()
            assert wrong == [], fault


def test_faults_of_a_cut_on_a_rig_with_grbl_stop_it_as_stated() -> None:
    with rig_faults.Trials(kind="grbl") as trials:
        for fault in ("cell_silent", "grbl_mute", "cancel_ignored"):
            wrong = trials.one(fault, np.random.default_rng(1)).wrong()
            if wrong:  # a busy machine: once more
                wrong = trials.one(fault, np.random.default_rng(2)).wrong()
            assert wrong == [], fault


def test_the_emulated_machine_tells_what_a_blocked_carriage_does_not_do_and_stops_at_its_switch() -> None:
    with closing(EmulatedGrblRig(SerialOptions(motion="grbl", mounted=None))) as rig:
        rig.machine.blocked = True
        rig.machine._blocks.append([2.0, 6.0])
        for _ in range(500):
            rig.step(rig.now())
        assert rig.machine.position == pytest.approx(2.0, abs=0.01)
        assert rig.position == pytest.approx(0.0, abs=1e-5)
        assert [event["what"] for event in rig.events()] == ["jogs made"]
        rig.machine.blocked, rig.machine.state = False, "Jog"
        rig.machine._way = -1.0
        rig.machine._blocks.append([9.0, 6.0])
        for _ in range(1500):
            rig.step(rig.now())
        assert rig.machine.state == "Alarm"
        assert -4.1e-3 < rig.position < -3.9e-3


def test_a_stop_of_an_emulated_rig_that_was_late_itself_says_so() -> None:
    running = RunningEmulator.__new__(RunningEmulator)
    late = {"worst_stall_s": 0.226}
    running.control = SimpleNamespace(state=lambda: late)  # type: ignore[assignment]
    assert "late by up to 226 ms, as no real rig is" in running.lateness
    late["worst_stall_s"] = 0.001
    assert running.lateness == ""


def test_a_line_that_the_board_does_not_know_is_counted_and_does_nothing(rig: EmulatedSerialRig) -> None:
    rig.board.feed(board_line("W 1 2 3") + b"V 2000*0000\n")
    blade = drivers_of(settings_for(rig))[0]
    blade.open(Listening())
    until(lambda: blade.about()["damaged_lines_to_board"] == 2)
    blade.close()
    assert math.isclose(rig.position, 0.0)
