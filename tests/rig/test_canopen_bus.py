"""A bus that is not there, and one that breaks."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator

import can
import pytest
from made_up_drive import Ear, MadeUpDrive
from waiting import until

from cutenv.rig.config.settings import Axis, Bus
from cutenv.rig.devices.canopen.axis import CanopenAxis
from cutenv.rig.devices.canopen.network import CanNetwork, bus_arguments, open_bus
from cutenv.rig.devices.loop import SystemClock
from cutenv.rig.devices.protocols import Latch
from cutenv.rig.errors import RigError


@pytest.fixture
def server() -> Iterator[socket.socket]:
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def gateway(server: socket.socket) -> Bus:
    return Bus(interface="socketcand", channel="can0", port=server.getsockname()[1])


@pytest.fixture
def ear() -> Ear:
    return Ear()


@pytest.fixture
def network(drive: MadeUpDrive) -> CanNetwork:
    return CanNetwork(Bus(interface="virtual", channel=drive.channel), SystemClock())


@pytest.fixture
def axis(network: CanNetwork, ear: Ear) -> Iterator[CanopenAxis]:
    axis = CanopenAxis(network, Axis(), SystemClock())
    axis.open(ear)
    axis.enable()
    yield axis
    axis.close()


@pytest.mark.parametrize(
    ("interface", "channel", "arguments"),
    [
        ("socketcan", "can0", {"channel": "can0"}),
        ("virtual", "x", {"channel": "x"}),
        ("pcan", "PCAN_USBBUS1", {"channel": "PCAN_USBBUS1", "bitrate": 500_000}),
        ("kvaser", "0", {"channel": 0, "bitrate": 500_000}),
        ("slcan", "/dev/ttyACM0", {"channel": "/dev/ttyACM0", "bitrate": 500_000, "timeout": 0.0}),
        ("socketcand", "can0", {"channel": "can0", "host": "127.0.0.1", "port": 29536}),
    ],
)
def test_an_interface_is_given_what_it_takes_and_no_more(interface, channel, arguments):
    assert bus_arguments(Bus(interface=interface, channel=channel, bitrate=500_000)) == arguments


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        (Bus(interface="socketcan", channel="nocan9"), "ip link set nocan9 up type can bitrate 1000000"),
        (Bus(interface="slcan", channel="/dev/no-such-port"), "serial port"),
        (Bus(interface="pcan", channel="PCAN_USBBUS1"), "PCAN-Basic"),
        (Bus(interface="kvaser", channel="0"), "CANlib"),
    ],
)
def test_a_bus_that_is_not_there_is_an_error_with_its_cure(settings, told):
    with pytest.raises(RigError, match=told):
        open_bus(settings)


@pytest.mark.skipif(os.name == "nt", reason="Windows has no pseudo-terminals")
def test_a_serial_adapter_is_read_without_waiting_whatever_it_has_sent():
    """The loop reads it twice a millisecond: what is not there yet, or half there, comes with the next look."""
    adapter, port = os.openpty()
    bus = open_bus(Bus(interface="slcan", channel=os.ttyname(port)))
    try:
        for sent, numbers in ((b"t1811", []), (b"05\rt7011", [0x181]), (b"7F\r\r", [0x701])):
            os.write(adapter, sent)
            time.sleep(0.02)
            found = []
            while (message := bus.recv(0.0)) is not None:
                found.append(message.arbitration_id)
            assert found == numbers
        waited = []
        for _ in range(10):
            begun = time.monotonic()
            bus.recv(0.0)
            waited.append(time.monotonic() - begun)
        assert min(waited) < 0.0005  # [s]; a busy host may hold up some
    finally:
        bus.shutdown()
        os.close(adapter)
        os.close(port)


def test_a_misspelt_interface_is_told_the_nearest():
    with pytest.raises(ValueError, match="Did you mean 'socketcan'"):
        open_bus(Bus(interface="socketcn"))


def test_a_gateway_that_is_not_there_is_told_at_once_with_its_address():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    before = time.monotonic()
    with pytest.raises(RigError, match=f"no CAN gateway at 127.0.0.1:{port}.*cutenv rig emulate"):
        open_bus(Bus(interface="socketcand", channel="can0", port=port))
    assert time.monotonic() - before < 8.0


def test_something_else_at_the_gateways_port_is_told_by_what_it_says(server):
    def serve() -> None:
        connection, _ = server.accept()
        connection.sendall(b"HTTP/1.1 400 Bad Request\r\n")
        connection.close()

    threading.Thread(target=serve, daemon=True).start()
    with pytest.raises(RigError, match="is not a socketcand gateway: it sends b'HTTP"):
        open_bus(gateway(server))


@pytest.mark.parametrize(("module", "interface"), [("can", "virtual"), ("serial", "slcan")])
def test_a_library_that_is_missing_is_named_for_the_command_line_to_cure(monkeypatch, module, interface):
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(ModuleNotFoundError) as caught:
        open_bus(Bus(interface=interface))
    assert caught.value.name == module


def test_the_package_is_imported_without_the_libraries_of_its_extra():
    code = "import sys, cutenv.rig.devices.canopen; assert not {'can', 'canopen', 'serial'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


def test_a_heartbeat_too_slow_for_the_drives_is_refused():
    with pytest.raises(ValueError, match=r"bus.heartbeat = 0.08 s"):
        CanNetwork(Bus(heartbeat=0.08), SystemClock())


def fail_to_send(*arguments: object, **keywords: object) -> None:
    raise can.CanOperationError("Transmit buffer full")


def test_a_frame_that_cannot_be_sent_is_told_once_and_the_drive_is_left_to_stop_by_itself(drive, network, axis, ear):
    network._bus.send = fail_to_send
    until(lambda: ear.breaks)
    assert ear.breaks == [("blade", network.broken)]
    assert "Transmit buffer full" in ear.breaks[0][1]
    for refused in (lambda: axis.command(0.01), axis.quick_stop, axis.limits, axis.enable):
        with pytest.raises(RigError):
            refused()
    del network._bus.send  # the way is free again, and still nothing is sent that keeps the drive going
    drive.frames()
    time.sleep(0.1)
    assert not {0x080, 0x77F} & {number for number, _ in drive.frames()}
    axis.quick_stop()
    until(lambda: drive.controlwords[-1] == 0x0B)
    axis.close()
    axis.open(ear)
    axis.close()
    assert len(ear.breaks) == 1


def test_who_meets_the_break_while_holding_a_lock_that_the_listener_needs_does_not_hang(network, axis, ear):
    lock, broken = threading.Lock(), ear.broken

    def locking(*what: object) -> None:
        if lock.acquire(timeout=2.0):  # else it would have waited for ever
            broken(*what)
            lock.release()

    ear.broken = locking
    network._bus.send = fail_to_send
    with lock, pytest.raises(RigError):
        axis.command(0.01)
    until(lambda: ear.breaks)


def test_a_bus_that_cannot_be_read_is_broken(network, axis, ear):

    def fail(timeout: float) -> None:
        raise OSError("device gone")

    network._bus.recv = fail
    until(lambda: ear.breaks)
    assert "device gone" in ear.breaks[0][1]


def test_bus_off_is_found_out_by_its_error_frame(drive, axis, ear):
    other = can.Bus(interface="virtual", channel=drive.channel)
    other.send(can.Message(arbitration_id=0x004, is_error_frame=True, data=bytes(8)))
    other.send(can.Message(arbitration_id=0x040, is_error_frame=True, data=bytes(8)))
    other.shutdown()
    until(lambda: ear.breaks)
    assert "bus-off" in ear.breaks[0][1]


def test_a_sender_that_hangs_does_not_hang_the_others(network, axis, ear):
    hanging = threading.Event()
    network._bus.send = lambda message, timeout: hanging.wait(10.0)
    until(lambda: network._sending.locked())  # SYNC
    before = time.monotonic()
    with pytest.raises(RigError, match="takes no more frames"):
        axis.quick_stop()
    assert time.monotonic() - before < 2.0
    until(lambda: ear.breaks)
    hanging.set()


def test_a_listener_that_fails_is_told_as_a_break_and_the_reader_goes_on(axis, ear):
    def fail(axis: str, sample: object) -> None:
        raise KeyError("a bug")

    ear.motion = fail
    until(lambda: ear.breaks)
    assert "KeyError('a bug')" in ear.breaks[0][1]


def test_two_axes_share_one_bus_that_the_last_one_closes(network):
    blade = CanopenAxis(network, Axis(), SystemClock())
    angle = CanopenAxis(network, Axis(node=2), SystemClock(), name="angle")
    blade.open(Ear())
    with pytest.raises(RigError, match="angle: node 2 does not answer"):
        angle.open(Ear())
    blade.enable()
    blade.close()
    with pytest.raises(RigError, match="not open"):
        network.send_message(0x080, b"")


def served(server: socket.socket, *said: bytes, hangs_up: bool = False) -> None:
    """A gateway that greets with the first of ``said``, and answers what it is told with the others, in pieces."""

    def serve() -> None:
        connection, _ = server.accept()
        with connection:
            for number, text in enumerate(said):
                if number:
                    connection.recv(256)
                for piece in text.split(b"|"):
                    connection.sendall(piece)
                    time.sleep(0.02)
            while connection.recv(256) and not hangs_up:
                pass

    threading.Thread(target=serve, daemon=True).start()


@pytest.mark.parametrize(
    ("said", "message"),
    [
        ((), "silent: no greeting within 2 s"),
        ((b"< hi >",), "silent: no answer to '< open can0 >' within 2 s"),
        ((b"< hi >", b"< ok >"), "silent: no answer to '< rawmode >' within 2 s"),
        ((b"< h",), "silent: no greeting within 2 s"),
        ((b"< hi >", b"< error could not open bus >"), "gives '< error could not open bus >' as answer"),
        ((b"220 ftp\r\n",), "not a socketcand gateway: it sends b'220 ftp"),
        ((b"x" * 4000,), "not a socketcand gateway"),
    ],
)
def test_a_gateway_that_falls_silent_or_refuses_is_told_in_time(server, said, message):
    served(server, *said)
    settings = gateway(server)
    told: list[str] = []
    opening = threading.Thread(target=lambda: told.append(refusal(settings)), daemon=True)
    opening.start()
    opening.join(30.0)  # each wait has 2 s, and a busy host some more
    assert told, "it hangs"
    assert message in told[0]
    assert f"127.0.0.1:{settings.port}" in told[0]


def refusal(settings: Bus) -> str:
    try:
        open_bus(settings).shutdown()
    except RigError as error:
        return str(error)
    return "opened"


def test_a_greeting_that_tcp_has_split_is_a_greeting(server):
    served(server, b"< h|i >", b"<| ok >", b"< o|k >< fra|me 701 1.5 05 >")
    bus = open_bus(gateway(server))
    message = bus.recv(5.0) or bus.recv(5.0)  # a piece may come alone
    assert (message.arbitration_id, bytes(message.data), message.is_extended_id) == (0x701, b"\x05", False)
    assert bus.recv(0.0) is None
    bus.shutdown()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"< frame XYZ 1.5 05 >", "sends an invalid frame: '< frame XYZ 1.5 05 >'"),
        (b"< frame 181 1.5 0G >", "sends an invalid frame"),
        (b"< frame 181 1.5 \xff >", r"sends an invalid frame: '< frame 181 1.5 \\xff >'"),
        (b"< error 1 >", "sends an invalid frame: '< error 1 >'"),
    ],
)
def test_a_frame_that_is_none_is_told_in_words(server, text, message):
    served(server, b"< hi >", b"< ok >", b"< ok >" + text)
    said = refusal_or_break(server.getsockname()[1])
    assert message in said
    for words in ("invalid literal", "codec", "Traceback", "Error("):
        assert words not in said


def refusal_or_break(port: int) -> str:
    network = CanNetwork(Bus(interface="socketcand", channel="can0", port=port), SystemClock())
    told: list[str] = []

    class Member:
        name, latch = "blade", Latch()

        def lost(self, why: str, time: float) -> None:
            told.append(why)

        def overheard(self, number: int, data: bytes, time: float) -> None:
            pass

    try:
        network.join(member := Member())
    except RigError as error:
        return str(error)
    until(lambda: told)
    network.leave(member)
    return told[0]


@pytest.mark.parametrize(
    "text", [b"garbage", b"x" * 20_000, b"< state 1 >", b"\xff\xfe", b"< frame 181 1.5 000102030405060708 >"]
)
def test_what_is_no_message_is_left_out_and_what_follows_is_read(server, text):
    served(server, b"< hi >", b"< ok >", b"< ok >" + text + b"|< frame 702 1.5 7F >")
    bus = open_bus(gateway(server))
    heard: list[int] = []

    def read() -> bool:
        if (message := bus.recv(0.1)) is not None:
            heard.append(message.arbitration_id)
        return 0x702 in heard

    until(read)
    bus.shutdown()


@pytest.mark.parametrize(
    ("number", "data", "message"),
    [
        (0x77F, b"\x05", "a heartbeat as node 127, which this computer is to be"),
        (0x080, b"", "it sends SYNC"),
        (0x000, b"\x80\x01", "commands of network management"),
        (0x601, b"\x40\x00\x10\x00\0\0\0\0", "questions to node 1"),
    ],
)
def test_another_master_is_met_before_anything_is_sent(drive, network, number, data, message):
    other = can.Bus(interface="virtual", channel=drive.channel)
    task = other.send_periodic(can.Message(arbitration_id=number, data=data, is_extended_id=False), 0.02)
    axis = CanopenAxis(network, Axis(), SystemClock())
    time.sleep(0.1)
    drive.frames()
    with pytest.raises(RigError, match=f"another master is on the CAN bus .*{message}"):
        axis.open(Ear())
    task.stop()
    other.shutdown()
    answers = {0x581, 0x181, 0x281, 0x701}  # of the drive
    assert {sent for sent, _ in drive.frames()} - answers <= {number}
    axis.open(Ear())
    axis.close()


def test_a_gateway_that_goes_away_is_found_out_by_the_next_frames(server):
    served(server, b"< hi >", b"< ok >", b"< ok >", hangs_up=True)
    said = refusal_or_break(server.getsockname()[1])
    assert "has gone" in said or "hung up" in said
