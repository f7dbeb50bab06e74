"""The hub speaks socketcand: with python-can's client, with plain sockets, and with those who speak garbage."""

from __future__ import annotations

import random
import socket
import threading
from collections.abc import Iterator

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st
from waiting import until

from cutenv.emulation.can_hub import BadMessage, Frame, Hub, frame_text, parsed_send

PATIENCE = 5.0  # [s], far beyond what is needed


class Ears:
    """A hub that keeps what it receives."""

    def __init__(self) -> None:
        self.heard: list[Frame] = []
        self.hub = Hub(self.heard.append)

    def client(self) -> can.BusABC:
        return can.Bus(interface="socketcand", channel="vcan0", host="127.0.0.1", port=self.hub.port)

    def plain(self) -> socket.socket:
        connection = socket.create_connection(("127.0.0.1", self.hub.port), timeout=PATIENCE)
        assert connection.recv(64) == b"< hi >"
        return connection


@pytest.fixture
def ears() -> Iterator[Ears]:
    made = Ears()
    yield made
    made.hub.close()
    assert "CAN hub" not in [thread.name for thread in threading.enumerate()]


def test_the_handshake_is_socketcands_byte_for_byte(ears):
    with ears.plain() as connection:
        connection.sendall(b"< open vcan0 >")
        assert connection.recv(64) == b"< ok >"
        connection.sendall(b"< rawmode >")
        assert connection.recv(64) == b"< ok >"
        connection.sendall(b"< send 601 8 2b 40 60 0 6 0 0 0 >< send 080 0  >< send 18DAF110 2 1 FF >")
        until(lambda: len(ears.heard) == 3)
        assert ears.heard == [
            Frame(0x601, bytes.fromhex("2B40600006000000")),
            Frame(0x080, b""),
            Frame(0x18DAF110, b"\x01\xff", extended=True),
        ]
        ears.hub.send(Frame(0x181, b"\x40\x02"))
        assert connection.recv(64).startswith(b"< frame 181 ")


def test_frames_go_to_all_others_and_not_back(ears):
    with ears.client() as first, ears.client() as second, ears.client() as third:
        for bus in (second, third):  # whoever sends is certainly listening
            bus.send(can.Message(arbitration_id=1, is_extended_id=False))
        until(lambda: len(ears.heard) == 2)
        first.send(can.Message(arbitration_id=0x18DAF110, data=b"\x0a\xb0", is_extended_id=True))
        for bus in (second, third):
            while (message := bus.recv(PATIENCE)).arbitration_id == 1:
                pass
            assert (message.arbitration_id, bytes(message.data), message.is_extended_id) == (
                0x18DAF110,
                b"\x0a\xb0",
                True,
            )
        ears.hub.send(Frame(0x701, b""))
        while (message := first.recv(PATIENCE)).arbitration_id == 1:
            pass
        assert (message.arbitration_id, bytes(message.data)) == (0x701, b"")


def test_a_client_that_does_not_read_holds_nobody_and_is_dropped(ears):
    with ears.plain() as deaf, ears.client() as bus:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.sendall(b"< open vcan0 >< rawmode >< send 001 0 >")
        bus.send(can.Message(arbitration_id=2, is_extended_id=False))
        until(lambda: len(ears.heard) == 2)
        sent = 0
        while ears.hub.clients == 2 and sent < 500_000:
            for _ in range(100):
                ears.hub.send(Frame(0x181, bytes(8)))
                sent += 1
                assert bus.recv(PATIENCE) is not None
        assert ears.hub.clients == 1


def test_a_client_that_has_gone_holds_nobody(ears):
    gone = ears.plain()
    gone.sendall(b"< open vcan0 >< rawmode >< send 001 0 >")
    until(lambda: ears.heard)
    gone.close()
    until(lambda: ears.hub.clients == 0)
    ears.hub.send(Frame(0x181, bytes(8)))


def test_garbage_gets_its_sender_closed_and_nobody_else(ears):
    generator = random.Random(0)
    with ears.client() as bus:
        connection, lines = ears.plain(), 0
        while lines < 20_000:
            try:
                for _ in range(100):
                    connection.sendall(generator.randbytes(generator.randrange(1, 300)) + b" >\n")
                    lines += 1
                closed = connection.recv(64) == b""
            except OSError:
                closed = True
            assert closed
            connection.close()
            connection = ears.plain()
        connection.close()
        assert ears.heard == []
        bus.send(can.Message(arbitration_id=0x123, data=b"\x01", is_extended_id=False))
        until(lambda: ears.heard == [Frame(0x123, b"\x01")])


@pytest.mark.parametrize(
    "message",
    [b"< send 601 9 0 0 0 0 0 0 0 0 0 >", b"< send 601 2 0 >", b"< send 8FF 0 >", b"< send 6G1 0 >", b"< send 6010 0 >",
     b"< send 601 1 100 >", b"< send 3FFFFFFF 0 >", b"< open other >", b"<send 601 0>", b"x" * 500],
)  # fmt: skip
def test_what_is_no_frame_is_not_passed_on(ears, message):
    with ears.plain() as connection:
        connection.sendall(b"< open vcan0 >< rawmode >" + message)
        until(lambda: ears.hub.clients == 0)
    assert ears.heard == []


@given(identifier=st.integers(0, 2**29 - 1), data=st.binary(max_size=8), extended=st.booleans())
def test_every_frame_survives_the_way_there_and_back(identifier, data, extended):
    from can.interfaces.socketcand import socketcand

    frame = Frame(identifier if extended else identifier & 0x7FF, data, extended)
    message = can.Message(arbitration_id=frame.identifier, data=data, is_extended_id=extended)
    assert parsed_send(socketcand.convert_can_message_to_ascii_message(message)[2:-2]) == frame
    back = socketcand.convert_ascii_message_to_can_message(frame_text(frame, 1.5).decode())
    assert (back.arbitration_id, bytes(back.data), back.is_extended_id) == (frame.identifier, data, extended)


@given(st.text(max_size=60))
def test_a_message_is_a_frame_or_refused(content):
    try:
        frame = parsed_send(content)
    except BadMessage:
        return
    assert len(frame.data) <= 8


def test_close_may_be_called_twice_and_the_port_is_free_again(ears):
    ears.hub.close()
    ears.hub.close()
    with pytest.raises(OSError, match="refused"):
        socket.create_connection(("127.0.0.1", ears.hub.port), timeout=1.0)
