"""What stands on the bus, byte for byte as CiA 301 and CiA 402 print it; and what garbage does: nothing."""

from __future__ import annotations

import random
import time
from collections.abc import Iterator

import pytest
from made_up_drive import Ear, MadeUpDrive
from waiting import until

from cutenv.rig.config.settings import Axis, Bus
from cutenv.rig.devices.canopen.axis import CanopenAxis
from cutenv.rig.devices.canopen.configuration import SdoChannel
from cutenv.rig.devices.canopen.network import CanNetwork
from cutenv.rig.devices.canopen.objects import CONTROLWORD, STATUSWORD, drive_state, error_meaning
from cutenv.rig.devices.loop import FakeClock, SystemClock
from cutenv.rig.devices.protocols import DriveState, Latch
from cutenv.rig.errors import RigError


@pytest.fixture
def ear() -> Ear:
    return Ear()


@pytest.fixture
def network(drive: MadeUpDrive) -> CanNetwork:
    return CanNetwork(Bus(interface="virtual", channel=drive.channel), SystemClock())


@pytest.fixture
def axis(network: CanNetwork, ear: Ear) -> Iterator[CanopenAxis]:
    axis = CanopenAxis(network, Axis(low=0.0), SystemClock())
    axis.open(ear)
    yield axis
    axis.close()


class Nobody:
    name, latch = "blade", Latch()

    def lost(self, why: str, time: float) -> None:
        raise AssertionError(why)

    def overheard(self, number: int, data: bytes, time: float) -> None:
        pass


def test_sync_and_heartbeat_are_sent_as_often_as_the_settings_say(drive):
    clock = FakeClock()
    network = CanNetwork(Bus(interface="virtual", channel=drive.channel, sync=0.005, heartbeat=0.030), clock)
    network.join(member := Nobody())
    clock.sleep_until(clock.now() + 0.0601)
    network.leave(member)
    frames = drive.frames()
    assert frames.count((0x080, b"")) == 12
    assert frames.count((0x77F, b"\x05")) == 2
    assert len(frames) == 14


def test_an_sdo_download_is_the_standards(drive, network):
    network.join(member := Nobody())
    dictionary = SdoChannel(network, 1, "blade")
    dictionary.put(CONTROLWORD, 0x06)
    frames = drive.frames()
    assert (0x601, bytes.fromhex("2B 40 60 00 06 00 00 00")) in frames
    assert (0x581, bytes.fromhex("60 40 60 00 00 00 00 00")) in frames
    dictionary.close()
    network.leave(member)


SET_UP = """
    40 00 10 00 00 00 00 00    40 18 10 01 00 00 00 00    2B 40 60 00 00 00 00 00    23 A9 60 00 00 47 B4 FD
    2B 17 10 00 32 00 00 00    2B 07 60 00 03 00 00 00    2B 5A 60 00 06 00 00 00
    2B 5E 60 00 02 00 00 00    2F 60 60 00 03 00 00 00    23 01 30 02 D0 07 00 00    23 65 60 00 66 46 00 00
    23 7D 60 01 00 00 00 00    23 7D 60 02 CD 7C 14 00    23 80 60 00 A6 13 00 00    23 7F 60 00 50 BD 4C 00
    23 83 60 00 90 33 00 00    23 84 60 00 90 33 00 00    23 85 60 00 A0 03 02 00
    23 00 14 01 01 02 00 80    2F 00 14 02 FF 00 00 00    2F 00 16 00 00 00 00 00    23 00 16 01 10 00 40 60
    23 00 16 02 20 00 FF 60    23 00 16 03 08 00 60 60    2F 00 16 00 03 00 00 00    23 00 14 01 01 02 00 00
    23 00 18 01 81 01 00 C0    2F 00 18 02 01 00 00 00    2F 00 1A 00 00 00 00 00    23 00 1A 01 10 00 41 60
    23 00 1A 02 20 00 6C 60    23 00 1A 03 08 00 61 60    2F 00 1A 00 03 00 00 00    23 00 18 01 81 01 00 40
    23 01 18 01 81 02 00 C0    2F 01 18 02 01 00 00 00    2F 01 1A 00 00 00 00 00    23 01 1A 01 20 00 64 60
    23 01 1A 02 10 00 77 60    2F 01 1A 00 02 00 00 00    23 01 18 01 81 02 00 40
    23 16 10 01 64 00 7F 00
"""


def test_the_set_up_is_written_in_order_read_back_and_framed_by_network_management(drive, axis):
    frames = [frame for frame in drive.frames() if frame[0] in (0x000, 0x601)]
    assert frames[0] == (0x000, bytes.fromhex("80 01")), "not set up in PRE-OPERATIONAL"
    assert frames[-1] == (0x000, bytes.fromhex("01 01"))
    requests = [data for _, data in frames[1:-1]]
    expected = [bytes.fromhex(line) for row in SET_UP.split("\n") for line in row.strip().split("    ") if line]
    written = [data for data in requests if data[0] != 0x40]
    assert written == [data for data in expected if data[0] != 0x40]
    for write in written[2:]:  # all but controlword and velocity unit, which are read another way
        after = requests[requests.index(write) + 1]
        assert after == b"\x40" + write[1:4] + bytes(4), f"{write.hex(' ')} is not read back"


def test_powering_on_goes_by_shutdown_switch_on_enable_at_speed_zero(drive, axis):
    drive.frames()
    axis.enable()
    commands = [data.hex(" ") for number, data in drive.frames() if number == 0x201]
    assert commands == ["06 00 00 00 00 00 03", "07 00 00 00 00 00 03", "0f 00 00 00 00 00 03"]


def test_a_command_is_one_frame_of_seven_bytes_little_endian(drive, axis):
    axis.enable()
    drive.frames()
    axis.command(0.010)  # 1 320 000 milli-rpm
    axis.command(-0.010)
    axis.quick_stop()
    until(lambda: drive.controlwords[-1] == 0x0B)
    commands = [data.hex(" ") for number, data in drive.frames() if number == 0x201]
    assert commands == ["0f 00 40 24 14 00 03", "0f 00 c0 db eb ff 03", "0b 00 00 00 00 00 03"]


def test_a_fault_reset_is_a_rising_edge_of_bit_seven(drive, axis):
    drive.fail(0x8611)
    axis.clear()
    words = [int.from_bytes(data[:2], "little") for number, data in drive.frames() if number == 0x201]
    assert words == [0x00, 0x80]


def test_an_emergency_is_told_with_code_and_meaning(drive, axis, ear):
    drive.send(0x081, bytes.fromhex("82 8A 20 01 02 03 04 05"))
    drive.send(0x081, bytes.fromhex("30 81 10 00 00 00 00 00"))
    until(lambda: len(ear.emergencies) == 2)
    assert ear.emergencies == [
        ("blade", 0x8A82, "software position limit"),
        ("blade", 0x8130, "heartbeat of the computer lost"),
    ]


@pytest.mark.parametrize(
    ("code", "meaning"),
    [(0x0000, "no error"), (0x8A88, "safe torque off"), (0x2320, "current"), (0x6100, "software of the drive"),
     (0xFF01, "additional functions or the maker's own"), (0xA000, "not of the standard")],
)  # fmt: skip
def test_an_emergency_code_means_what_the_standard_says(code, meaning):
    assert error_meaning(code) == meaning


@pytest.mark.parametrize(
    ("statusword", "state"),
    [
        (0x0000, DriveState.NOT_READY), (0x0250, DriveState.DISABLED), (0x0231, DriveState.READY),
        (0x0233, DriveState.SWITCHED_ON), (0x0637, DriveState.ENABLED), (0x0017, DriveState.QUICK_STOP),
        (0x021F, DriveState.REACTING), (0x0218, DriveState.FAULT), (0x0028, DriveState.FAULT),
    ],
)  # fmt: skip
def test_a_statusword_means_the_state_of_its_masked_bits(statusword, state):
    assert drive_state(statusword) is state


def test_a_statusword_of_no_state_is_refused_by_its_number():
    with pytest.raises(ValueError, match="statusword 0x0001"):
        drive_state(0x0001)


def test_a_sample_is_made_of_the_two_frames_of_one_sync(drive, network, ear):
    network = CanNetwork(Bus(interface="virtual", channel=drive.channel), SystemClock())
    axis = CanopenAxis(network, Axis(), SystemClock())
    axis.open(ear)
    drive.mute = True
    time.sleep(0.05)
    ear.samples.clear()
    status, measured = bytes.fromhex("27 00 40 24 14 00 03"), bytes.fromhex("00 60 01 00 9C FF")
    for number, data in [(0x281, measured), (0x181, bytes(7)), (0x181, status), (0x281, measured), (0x281, measured)]:
        drive.send(number, data)
    until(lambda: ear.samples)
    time.sleep(0.02)
    (sample,) = ear.samples
    assert sample.state is DriveState.ENABLED
    assert sample.speed == pytest.approx(0.010)
    assert sample.position == pytest.approx(22 * 4096 / 4096 / 4.4 * 0.002)
    assert sample.torque == -0.1
    axis.close()


def test_20000_frames_of_garbage_harm_nothing(drive, axis, ear, network):
    axis.enable()
    drive.mute = True  # from here on the drive sends nonsense only
    draw = random.Random(1)
    own = [0x081, 0x181, 0x281, 0x581, 0x701]
    bench_marks = (len(ear.breaks), axis.garbled)
    for _ in range(20_000):
        number = draw.choice(own) if draw.random() < 0.8 else draw.randrange(0x800)
        # A heartbeat of one byte would be a true one, and tell of another state.
        length = draw.choice([0, 2, 8]) if number == 0x701 else draw.randrange(9)
        network._handle(number, draw.randbytes(length))
    assert network.broken is None
    assert len(ear.breaks) == bench_marks[0]
    assert axis.garbled > bench_marks[1] + 2_000
    assert "bytes" in axis.last_garbled or "statusword" in axis.last_garbled
    drive.mute = False
    drive.frames()
    axis.clear()
    axis.enable()


def test_an_sdo_answer_of_garbage_is_an_error_that_names_the_object(drive, network):
    network.join(member := Nobody())
    dictionary = SdoChannel(network, 1, "blade")
    dictionary._client.RESPONSE_TIMEOUT = 0.01
    drive.mute = True
    draw = random.Random(2)
    send = network.send_message

    def answered(can_id: int, data: bytes) -> None:
        send(can_id, data)
        network._handle(0x581, draw.randbytes(draw.choice([3, 8, 8])))

    network.send_message = answered
    for _ in range(200):
        with pytest.raises(RigError, match="0x6041:00"):
            dictionary.read(STATUSWORD)
    dictionary.close()
    network.leave(member)
