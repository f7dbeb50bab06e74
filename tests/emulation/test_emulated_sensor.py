"""The emulated sensor: its bytes by hand, its faults, and an independent client that reads it."""

from __future__ import annotations

import contextlib
import random
import socket
import urllib.error
import urllib.request
from collections.abc import Iterator

import numpy as np
import pytest
from sensor_stream import LOADS, Feed, wait_for

from cutenv.emulation.sensor_server import SensorPage, SensorServer
from cutenv.rig.devices.loop import FakeClock
from cutenv.rig.devices.netft_sensor import SensorPacket, SensorStatus, parse_packet

START = bytes.fromhex("1234 0002 00000000")
STOP = bytes.fromhex("1234 0000 00000000")
RESET_LATCH = bytes.fromhex("1234 0041 00000000")
BIAS = bytes.fromhex("1234 0042 00000000")


class Wire:
    """A bare UDP socket beside the server, which knows nothing of the package."""

    def __init__(self, server: SensorServer) -> None:
        self._server = server
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.settimeout(5.0)

    def ask(self, request: bytes) -> None:
        self._socket.sendto(request, ("127.0.0.1", self._server.port))

    def start(self, request: bytes = START) -> None:
        clients = self._server.clients
        self.ask(request)
        wait_for(lambda: self._server.clients > clients)

    def next(self) -> bytes:
        return self._socket.recv(2048)

    def record(self) -> SensorPacket:
        return parse_packet(self.next())

    def rest(self) -> list[SensorPacket]:
        """What has arrived; on the loop-back, what was sent is there."""
        self._socket.settimeout(0.05)
        records = []
        with contextlib.suppress(TimeoutError):
            while True:
                records.append(self.record())
        self._socket.settimeout(5.0)
        return records

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def server() -> Iterator[SensorServer]:
    with SensorServer() as server:
        yield server


@pytest.fixture
def wire(server: SensorServer) -> Iterator[Wire]:
    wire = Wire(server)
    yield wire
    wire.close()


def of_independent_client(received, loss=0.0):
    """Last sample and health of a client by others, when it has so many records."""
    pynetft = pytest.importorskip("pynetft", reason="the independent client comes with the extra dev")
    with SensorServer() as server:
        server.faults.loss = loss
        page_port = int(server.page.split(":")[2].partition("/")[0])
        client = pynetft.Client(
            pynetft.Config(sensor_host="127.0.0.1", rdt_port=server.port, http_port=page_port, receive_timeout=1.0)
        )
        feed = Feed(server)
        client.start()
        try:
            assert client.wait_for_first_sample(10.0)
            wait_for(lambda: client.health().received_count > received)
            return client.latest_sample(), client.health()
        finally:
            client.stop()
            feed.close()


def test_an_independent_client_reads_what_is_sent():
    sample, health = of_independent_client(100)
    assert sample.force == pytest.approx(LOADS[:3])
    assert sample.torque == pytest.approx(LOADS[3:])
    assert (sample.force_unit.name, sample.torque_unit.name) == ("NEWTON", "NEWTON_METER")
    assert sample.status == 0
    assert (health.lost_count, health.malformed_count, health.out_of_order_count, health.duplicate_count) == (0,) * 4


def test_the_independent_client_sees_loss_as_loss():
    _, health = of_independent_client(200, loss=0.2)
    assert 0.1 < health.lost_count / (health.lost_count + health.received_count) < 0.3


def test_the_first_record_is_these_36_bytes(server, wire):
    wire.start()
    server.send((1.5, -2.25, 3.0, 0.1, -0.2, 0.3))
    assert wire.next() == bytes.fromhex(
        "00000001 00000001 00000000 0016E360 FFDDAAF0 002DC6C0 000186A0 FFFCF2C0 000493E0"
    )


def test_a_start_with_a_count_ends_after_it(server, wire):
    wire.start(bytes.fromhex("1234 0002 00000003"))
    for _ in range(5):
        server.send(LOADS)
    assert [record.sequence for record in wire.rest()] == [1, 2, 3]
    assert server.clients == 0


def test_stop_stops_and_start_begins_at_one_again(server, wire):
    wire.start()
    server.send(LOADS)
    wire.ask(STOP)
    wait_for(lambda: server.clients == 0)
    server.send(LOADS)
    wire.start()
    server.send(LOADS)
    first, second = wire.rest()
    assert (first.sequence, second.sequence) == (1, 1)
    assert second.sampled == first.sampled + 2  # the sensor's own count went on


def test_bias_makes_the_present_load_zero(server, wire):
    wire.start()
    server.send(LOADS)
    wire.ask(BIAS)
    wait_for(lambda: server.send(LOADS) or not any(wire.record().counts[:3]))
    wire.rest()
    server.send((2.5, *LOADS[1:]))
    assert wire.record().counts == (1_000_000, 0, 0, 0, 0, 0)


def test_reset_clears_the_latch_and_no_other_status(server, wire):
    server.faults.status = SensorStatus.MONITOR_CONDITION | SensorStatus.ERROR
    wire.ask(RESET_LATCH)
    wait_for(lambda: server.faults.status == SensorStatus.ERROR)


def test_garbage_is_counted_and_everything_goes_on(server, wire):
    draw = random.Random(3)
    for turn in range(200):  # few at a time: nobody promises that a socket holds more
        for _ in range(10):
            wire.ask(draw.randbytes(draw.choice([0, 1, 7, 9, 36, 1400])))
            wire.ask(b"\x12\x34\x77\x77" + draw.randbytes(4))
        wait_for(lambda sent=20 * (turn + 1): server.garbage == sent)
    wire.start()
    server.send(LOADS)
    assert wire.record().counts[0] == 1_500_000


def test_reordered_records_are_all_there(server, wire):
    server.faults.reorder = True
    wire.start()
    for _ in range(100):
        server.send(LOADS)
    server.faults.reorder = False
    server.send(LOADS)
    received = [record.sequence for record in wire.rest()]
    assert sorted(received) == list(range(1, 102))
    assert received != sorted(received)


@pytest.mark.parametrize("by", ["load", "fault"])
def test_beyond_its_range_a_reading_is_cut_off_and_the_status_says_so(server, wire, by):
    server.faults.saturated = by == "fault"
    wire.start()
    server.send((-1.0 if by == "fault" else -250.0, 1.0, 1.0, 0.0, 0.0, 0.0))
    record = wire.record()
    assert record.counts[0] == -200_000_000
    assert record.status == 1 << 31 | 1 << 30 | 1 << 27


def test_a_silent_sensor_sends_nothing_and_counts_on(server, wire):
    wire.start()
    server.send(LOADS)
    server.faults.silent = True
    for _ in range(9):
        server.send(LOADS)
    server.faults.silent = False
    server.send(LOADS)
    assert [record.sequence for record in wire.rest()] == [1, 11]


def test_what_is_on_its_way_when_the_cable_is_pulled_never_arrives():
    clock = FakeClock()
    with SensorServer(clock=clock) as server:
        wire = Wire(server)
        wire.start()
        server.faults.latency = 0.005
        server.send(LOADS)
        server.faults.silent = True
        server.send(LOADS)
        server.faults.silent = False
        clock.sleep_until(clock.now() + 1.0)
        server.faults.latency = 0.0
        server.send(LOADS)
        received = [record.sequence for record in wire.rest()]
        wire.close()
    assert received == [3]


def test_latency_delays_in_order_and_is_caught_up_when_it_falls():
    clock = FakeClock()
    with SensorServer(clock=clock) as server:
        wire = Wire(server)
        wire.start()
        server.faults.latency = 0.005
        arrived = []
        for _ in range(10):
            server.send(LOADS)
            arrived.append([record.sequence for record in wire.rest()])
            clock.sleep_until(clock.now() + 0.001001)
        server.faults.latency = 0.0
        server.send(LOADS)
        caught_up = [record.sequence for record in wire.rest()]
        wire.close()
    assert arrived == [[], [], [], [], [], [1], [2], [3], [4], [5]]
    assert caught_up == [6, 7, 8, 9, 10, 11]


def test_the_same_seed_loses_the_same_records():
    def received(seed: int) -> list[int]:
        with SensorServer() as server:
            server.generator = np.random.default_rng(seed)
            server.faults.loss = 0.5
            wire = Wire(server)
            wire.start()
            for _ in range(60):
                server.send(LOADS)
            found = [record.sequence for record in wire.rest()]
            wire.close()
            return found

    assert received(1) == received(1) != received(2)


def test_it_listens_on_this_computer_alone_and_leaves_its_ports_when_closed():
    server = SensorServer()
    assert server.host == "127.0.0.1"
    assert server.page.startswith("http://127.0.0.1:")
    server.close()
    server.close()
    with SensorServer(port=server.port) as again:
        assert again.port == server.port


def test_its_page_is_the_only_one(server):
    with urllib.request.urlopen(server.page) as answer:
        assert b"<cfgcpf>1000000</cfgcpf>" in answer.read()
    with pytest.raises(urllib.error.HTTPError, match="404"):
        urllib.request.urlopen(server.page.replace("netftapi2", "index"))


def test_counts_that_no_record_can_hold_are_refused():
    with pytest.raises(ValueError, match="counts_per_newton = 2e"):
        SensorPage(counts_per_newton=20_000_000)
