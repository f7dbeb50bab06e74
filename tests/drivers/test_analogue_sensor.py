"""Analogue six-axis sensor: its calibration, the converter, an emulated board over TCP, and a board of NI."""

from __future__ import annotations

import dataclasses
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nidaqmx
import numpy as np
import pytest
from nidaqmx.errors import DaqNotFoundError
from waiting import until

from cutenv._base import resources
from cutenv.drivers.analogue_sensor import (
    CHANNEL_AT_END,
    SHIPPED_CALIBRATION,
    AnalogueCalibration,
    AnalogueOptions,
    AnalogueSensor,
    EmulatedBoard,
    NidaqmxBoard,
)
from cutenv.emulation.sensor_server import BoardServer
from cutenv.rig.config.settings import SensorSettings, fake_settings
from cutenv.rig.devices.driver_registry import Mounting
from cutenv.rig.devices.loop import SystemClock
from cutenv.rig.errors import RigError
from cutenv.rig.toml_file import read_rig_file, to_toml

JR3 = AnalogueCalibration.read(SHIPPED_CALIBRATION)
TEXT = resources.path(f"sensors/{SHIPPED_CALIBRATION}.toml").read_text(encoding="utf-8")
LOADS = (3.0, -1.0, 2.0, 0.1, -0.05, 0.2)


class Heard:
    """Listener that keeps what it is told."""

    def __init__(self) -> None:
        self.samples: list[Any] = []
        self.said: list[str] = []

    def force(self, sample: Any) -> None:
        self.samples.append(sample)

    def garbled(self, why: str, time: float) -> None:
        self.said.append(why)


@pytest.fixture
def board() -> Iterator[BoardServer]:
    """A board whose stream another thread keeps at about 1 kHz, under changeable loads."""
    server, ended = BoardServer(JR3), threading.Event()
    server.loads = (0.0,) * 6  # type: ignore[attr-defined]

    def feed() -> None:
        while not ended.wait(0.001):
            server.send(server.loads)  # type: ignore[attr-defined]

    thread = threading.Thread(target=feed, daemon=True)
    thread.start()
    yield server
    ended.set()
    thread.join()
    server.close()


def sensor_at(port: int, **options: Any) -> AnalogueSensor:
    own = AnalogueOptions(calibration=SHIPPED_CALIBRATION, board="emulated", port=port, **options)
    rig = fake_settings(sensor=SensorSettings(driver="analogue", options=own))
    return AnalogueSensor(Mounting(role="sensor", rig=rig, clock=SystemClock()))


def test_the_shipped_sensor_has_the_thesis_resolution():
    assert JR3.resolution == pytest.approx([0.05, 0.05, 0.1, 0.00315, 0.00315, 0.00315])


def test_loads_come_back_within_a_count_of_every_channel():
    loads = np.random.default_rng(0).uniform(-0.5, 0.5, (500, 6)) * JR3.full_scale * 0.3
    back = JR3.loads(JR3.counts(loads))
    assert np.all(np.abs(back - loads) <= 0.5 * JR3.count * np.abs(JR3.matrix).sum(axis=1))
    assert np.abs(back - loads).max(axis=0) == pytest.approx(0.5 * JR3.resolution, rel=0.6)


def check_no_cross_talk(calibration: AnalogueCalibration) -> None:
    """A load on one axis shows on no other by more than rounding."""
    for axis in range(6):
        load = np.zeros(6)
        load[axis] = 0.5 * JR3.full_scale[axis]
        others = np.delete(calibration.loads(JR3.counts(load)), axis)
        rounding = np.delete(0.5 * JR3.count * np.abs(JR3.matrix).sum(axis=1), axis)
        assert np.all(np.abs(others) <= rounding)


def test_the_matrix_removes_the_cross_talk():
    check_no_cross_talk(JR3)


def test_a_matrix_without_its_cross_talk_fails_the_check():
    with pytest.raises(AssertionError):
        check_no_cross_talk(dataclasses.replace(JR3, matrix=np.diag(np.diag(JR3.matrix))))


def test_full_scale_is_where_the_first_channel_ends():
    for axis, most in enumerate(JR3.full_scale):
        load = np.zeros((2, 6))
        load[:, axis] = 0.999 * most, 1.001 * most
        assert JR3.saturated(JR3.counts(load)).tolist() == [False, True]


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("bits = 12", "bits = 3", "bits = 3 is outside 8 to 24"),
        ("bits = 12", 'bits = "12"', "bits must be a whole number, got '12'"),
        ("range_V = 10.0", "range_V = 0", "range_V = 0 V is outside"),
        ("bits = 12", "bit = 12", "key must be one of .* Did you mean 'bits'"),
        ("bits = 12\n", "", "it lacks bits"),
        ("20.48", "nan", r"force_N_per_V\[2\]\[2\]"),
        ("[-0.15, 10.24, 0.18, 1.1, 2.4, -1.0]", "[10.24, 0.12, -0.21, 2.1, -0.9, 1.2]", "the matrix is singular"),
        ("    [0.33, -0.28, 20.48, -1.6, 1.9, 2.2],\n", "", "force_N_per_V must be three rows of six numbers"),
        ("bits = 12", "bits = ", "it is not TOML"),
    ],
)
def test_a_calibration_that_cannot_be_is_refused_with_file_and_key(tmp_path: Path, before, after, message):
    assert before in TEXT
    path = tmp_path / "mine.toml"
    path.write_text(TEXT.replace(before, after), encoding="utf-8")
    with pytest.raises(ValueError, match=rf"mine\.toml: .*{message}"):
        AnalogueCalibration.read(path)


def test_a_missing_calibration_says_where_to_find_one(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match=f"no such file.*shipped '{SHIPPED_CALIBRATION}'"):
        AnalogueCalibration.read(tmp_path / "none.toml")


def test_readings_of_a_board_in_another_thread_are_loads_without_cross_talk(board: BoardServer):
    sensor, heard = sensor_at(board.port), Heard()
    sensor.open(heard)
    try:
        board.loads = LOADS  # type: ignore[attr-defined]
        begun = len(heard.samples) + 50
        until(lambda: len(heard.samples) > begun + 300)
        late = heard.samples[begun:]
        force = np.array([sample.force for sample in late]).mean(axis=0)
        torque = np.array([sample.torque for sample in late]).mean(axis=0)
        assert force == pytest.approx(LOADS[:3], abs=0.03)
        assert torque == pytest.approx(LOADS[3:], abs=0.002)
        assert sum(sample.lost for sample in late) == 0
        assert {sample.status for sample in late} == {0}
        assert not heard.said
    finally:
        sensor.close()


def test_a_tare_is_the_mean_load_and_is_taken_off(board: BoardServer):
    board.loads = LOADS  # type: ignore[attr-defined]
    sensor, heard = sensor_at(board.port), Heard()
    sensor.open(heard)
    try:
        assert sensor.tare(200) == pytest.approx(LOADS[:3], abs=0.03)
        begun = len(heard.samples)
        until(lambda: len(heard.samples) > begun + 200)
        assert np.array([sample.force for sample in heard.samples[begun:]]).mean(axis=0) == pytest.approx(0, abs=0.03)
    finally:
        sensor.close()


def test_a_channel_at_the_end_of_the_converter_is_a_status_and_no_tare(board: BoardServer):
    sensor, heard = sensor_at(board.port), Heard()
    sensor.open(heard)
    try:
        board.faults.saturated = True
        until(lambda: heard.samples[-1].status == CHANNEL_AT_END)
        with pytest.raises(RigError, match="a channel at the end of the converter's range"):
            sensor.tare(50)
    finally:
        sensor.close()


def test_a_board_that_ends_is_told_and_gives_no_more_readings(board: BoardServer):
    sensor, heard = sensor_at(board.port), Heard()
    sensor.open(heard)
    board.close()
    until(lambda: heard.said)
    assert "has stopped" in heard.said[0]
    sensor.close()


def test_wires_have_no_faults_of_packets(board: BoardServer):
    with pytest.raises(ValueError, match="loss: an analogue sensor sends no packets"):
        board.faults.loss = 0.5


def test_a_board_that_is_opened_again_begins_with_its_header_whatever_came_before(board: BoardServer):
    client = EmulatedBoard("127.0.0.1", board.port)
    for _ in range(2):
        client.open(JR3, 1000.0)
        assert client.read(3)
        client.close()
        client._rest = bytes(17)  # of a reading that had half arrived


def test_a_board_that_is_not_there_is_an_error():
    server = BoardServer(JR3)
    server.close()
    with pytest.raises(RigError, match="cannot be reached"):
        sensor_at(server.port).open(Heard())


def test_a_rig_file_holds_the_sensor(tmp_path: Path):
    options = AnalogueOptions(calibration=SHIPPED_CALIBRATION, board="emulated", port=1234)
    rig = fake_settings(sensor=SensorSettings(driver="analogue", options=options), emulated=False)
    rig = dataclasses.replace(rig, depth_profile=((0.0, 0.02), (0.149, 0.02)))
    path = tmp_path / "rig.toml"
    path.write_text(to_toml(rig), encoding="utf-8")
    assert read_rig_file(path).sensor.options == options
    path.write_text(path.read_text().replace('board = "emulated"', 'board = "nidaqmx"'), encoding="utf-8")
    with pytest.raises(ValueError, match="has an assumed cross-talk, for emulated rigs"):
        read_rig_file(path)
    weak = tmp_path / "weak.toml"
    shipped = resources.path(f"sensors/{SHIPPED_CALIBRATION}.toml").read_text(encoding="utf-8")
    weak.write_text(shipped.replace("range_V = 10.0", "range_V = 5.0"), encoding="utf-8")
    half = dataclasses.replace(rig.sensor, options=dataclasses.replace(options, calibration=str(weak)))
    text = to_toml(dataclasses.replace(rig, sensor=half))
    path.write_text(text.replace("force_N = 15.0", "force_N = 80.0").replace("norm_N = 20", "norm_N = 100"))
    with pytest.raises(ValueError, match=r"limits\.force_N = 80 is beyond what the sensor reads"):
        read_rig_file(path)


def test_without_ni_daqmx_the_error_names_it():
    board = NidaqmxBoard("Dev1", "ai0:5", differential=True)
    try:
        nidaqmx.system.System.local().driver_version  # noqa: B018
    except DaqNotFoundError:
        with pytest.raises(RigError, match="NI-DAQmx, the driver of National Instruments' boards, is not on this"):
            board.open(JR3, 1000.0)


class StandInTask:
    """NI's task as far as the board uses it: keeps its settings, and has channels, a clock and a stream."""

    def __init__(self) -> None:
        self.asked: dict[str, Any] = {}
        self.ai_channels = self.timing = self
        self.in_stream = self

    def __len__(self) -> int:
        return 6

    def add_ai_voltage_chan(self, channels: str, **settings: Any) -> None:
        self.asked |= {"channels": channels, **settings}

    def cfg_samp_clk_timing(self, rate: float, **settings: Any) -> None:
        self.asked |= {"rate": rate, **settings}

    def start(self) -> None:
        self.asked["started"] = True

    def close(self) -> None:
        self.asked["closed"] = True


def test_a_board_of_ni_samples_six_differential_channels_by_its_own_clock(monkeypatch: pytest.MonkeyPatch):
    task = StandInTask()
    volts = np.linalg.inv(JR3.matrix) @ np.array(LOADS)

    class Reader:
        def __init__(self, stream: Any) -> None:
            assert stream is task

        def read_many_sample(self, data: Any, count: int, timeout: float) -> None:
            data[:] = volts[:, None]

    monkeypatch.setattr(nidaqmx, "Task", lambda: task)
    monkeypatch.setattr("nidaqmx.stream_readers.AnalogMultiChannelReader", Reader)
    board = NidaqmxBoard("Dev2", "ai8:13", differential=True)
    board.open(JR3, 500.0)
    first, second = board.read(3)[0], board.read(3)[0]
    board.close()
    assert (first.number, second.number) == (0, 3)
    assert JR3.loads(first.counts)[0] == pytest.approx(LOADS, abs=0.1)
    assert task.asked["channels"] == "Dev2/ai8:13"
    assert task.asked["terminal_config"] is nidaqmx.constants.TerminalConfiguration.DIFF
    assert (task.asked["min_val"], task.asked["max_val"], task.asked["rate"]) == (-10.0, 10.0, 500.0)
    assert task.asked["sample_mode"] is nidaqmx.constants.AcquisitionType.CONTINUOUS
    assert task.asked["closed"]
