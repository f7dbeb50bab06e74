"""The driver against the emulated sensor: order, loss, zero, and whatever else comes along the wire."""

from __future__ import annotations

import random
import socket
import threading
import time

import numpy as np
import pytest
from sensor_stream import LOADS, Feed, Kept, settings_of, settle, streaming, wait_for

from cutenv.emulation.sensor_server import SensorPage, SensorServer
from cutenv.rig.config.settings import SensorSettings
from cutenv.rig.devices.loop import SystemClock
from cutenv.rig.devices.netft_sensor import NetftSensor, SensorPacket, SensorStatus, packet_bytes
from cutenv.rig.devices.reading_stream import STEADY_FORCE
from cutenv.rig.errors import RigError

COUNTS = (1_500_000, -2_250_000, 3_000_000, 100_000, -200_000, 300_000)


def send(server, *sequences, counts=COUNTS):
    """Records as no healthy sensor would number them."""
    for sequence in sequences:
        server.send_bytes(packet_bytes(SensorPacket(sequence % 2**32, 0, 0, counts)))


def sequences(kept, since=0):
    return [sample.sequence for sample in kept.samples[since:]]


@pytest.fixture
def server():
    with SensorServer() as server:
        yield server


def test_readings_come_in_newtons_with_counts_status_and_sequence():
    shown = SensorPage(counts_per_newton=2000, rate=500.0)
    with SensorServer(configuration=shown) as server, streaming(server) as (sensor, kept):
        sample = kept.samples[0]
        assert sample.sequence == 1
        assert sample.force == pytest.approx(LOADS[:3])
        assert sample.torque == pytest.approx(LOADS[3:])
        assert sample.counts == (3000, -4500, 6000, 100_000, -200_000, 300_000)
        assert (sample.status, sample.lost) == (0, 0)
        assert sensor.rate == 500.0  # by its page, not by the settings
        assert sensor.page.newtons_per_count == 1 / 2000
        assert abs(sample.time - time.monotonic()) < 60.0  # of the rig's clock


def fed(server, kept, count):
    """Let so many readings come, and nothing more."""
    feed = Feed(server)
    wait_for(lambda: len(kept.samples) > count)
    feed.close()
    settle(kept)


@pytest.mark.parametrize("first", [1, 2**32 - 50])
def test_every_reading_arrives_once_and_in_order_also_where_the_sequence_wraps_around(server, first):
    server.first_sequence = first
    with streaming(server) as (sensor, kept):
        fed(server, kept, 300)
        assert sequences(kept) == [(first + i) % 2**32 for i in range(len(kept.samples))]
        assert sensor.counters == (len(kept.samples), 0, 0, 0, 0)


def test_a_way_that_swaps_never_turns_the_order(server):
    server.faults.reorder = True
    with streaming(server) as (sensor, kept):
        fed(server, kept, 300)
        assert sequences(kept) == sorted(set(sequences(kept)))
        assert sensor.counters.reordered > 20


@pytest.mark.parametrize(
    ("sent", "passed", "lost", "counted"),
    [
        ((1, 4, 5), (1, 4, 5), (0, 2, 0), {"lost": 2}),
        ((2, 1, 2, 3, 0), (2, 3), (1, 0), {"reordered": 3}),  # older and repeated ones are dropped
        ((1, 4_000_000_000, 2, 2_000_000_000, 3), (1, 2, 3), (0, 0, 0), {"garbled": 2, "lost": 0}),  # from nowhere
    ],
)
def test_what_is_lost_late_or_from_nowhere_is_counted_and_upsets_nothing(server, sent, passed, lost, counted):
    with streaming(server) as (sensor, kept):
        last, before = kept.samples[-1].sequence, len(kept.samples)
        send(server, *(last + each for each in sent))
        settle(kept)
        assert sequences(kept, before) == [last + each for each in passed]
        assert tuple(sample.lost for sample in kept.samples[before:]) == lost
        assert sensor.counters._asdict().items() >= counted.items()
        assert bool(kept.complaints) is ("garbled" in counted)


@pytest.mark.parametrize("restarted", [1, 3_000_000_000])
def test_a_restarted_sensor_is_reported_and_taken_as_a_new_beginning(server, restarted):
    server.first_sequence = 100_000
    with streaming(server) as (_, kept):
        before, last = len(kept.samples), kept.samples[-1].sequence
        send(server, restarted, restarted + 1, restarted + 2)
        wait_for(lambda: len(kept.samples) == before + 2)
        assert sequences(kept, before) == [restarted + 1, restarted + 2]
        assert [sample.lost for sample in kept.samples[before:]] == [0, 0]
        assert kept.complaints == [f"sequence {restarted} does not follow {last}: a restart?"]


def test_twenty_thousand_garbled_packets_are_told_and_reading_goes_on(server):
    draw = random.Random(4)
    with streaming(server) as (sensor, kept):
        for turn in range(400):  # few at a time: nobody promises that a socket holds more
            for _ in range(50):
                server.send_bytes(draw.randbytes(draw.choice([0, 1, 8, 35, 36, 37, 1400])))
            wait_for(lambda told=50 * (turn + 1): len(kept.complaints) == told)
        assert sensor.counters.garbled == 20_000
        before = len(kept.samples)
        server.send(LOADS)
        server.send(LOADS)
        wait_for(lambda: len(kept.samples) == before + 2)
        assert kept.samples[-1].force == pytest.approx(LOADS[:3])
        assert all(sample.force == pytest.approx(LOADS[:3]) for sample in kept.samples)


def test_packets_from_another_address_are_told_and_never_read(server):
    with streaming(server) as (sensor, kept):
        before, (host, port) = len(kept.samples), sensor._socket.getsockname()
        assert host == "127.0.0.1", "it listens on another network than the sensor's"
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.sendto(packet_bytes(SensorPacket(kept.samples[-1].sequence + 1, 0, 0, (0,) * 6)), (host, port))
            wait_for(lambda: kept.complaints)
            assert f"from 127.0.0.1:{stranger.getsockname()[1]}" in kept.complaints[0]
        assert len(kept.samples) == before
        assert sensor.counters.foreign == 1


def test_a_bad_status_and_saturation_are_passed_on(server):
    with streaming(server) as (_, kept):
        server.faults.status = SensorStatus.MONITOR_CONDITION
        server.send(LOADS)
        server.faults.status, server.faults.saturated = 0, True
        server.send(LOADS)
        settle(kept)
        latched, saturated = kept.samples[-2:]
        assert latched.status == 1 << 16
        assert saturated.status == 1 << 31 | 1 << 30 | 1 << 27
        assert saturated.force[0] == pytest.approx(200.0)


def test_a_silence_is_silent_and_its_length_counted_as_lost(server):
    with streaming(server) as (_, kept):
        server.faults.silent = True
        before = len(kept.samples)
        for _ in range(30):
            server.send(LOADS)
        settle(kept)
        assert len(kept.samples) == before
        server.faults.silent = False
        server.send(LOADS)
        wait_for(lambda: len(kept.samples) == before + 1)
        assert kept.samples[-1].lost == 30


def test_a_tare_is_subtracted_from_then_on_and_told(server):
    with streaming(server) as (sensor, kept):
        feed = Feed(server)
        zero = sensor.tare(100)
        assert zero == pytest.approx(LOADS[:3])
        before = len(kept.samples)
        wait_for(lambda: len(kept.samples) > before + 1)
        assert kept.samples[-1].force == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
        assert kept.samples[-1].torque == pytest.approx((0.0, 0.0, 0.0), abs=1e-9)
        assert kept.samples[-1].counts == COUNTS  # what the sensor sent stays as it was
        assert sensor.tare(100) == pytest.approx(LOADS[:3])  # since the start, not since the last
        feed.close()


def test_the_sensors_own_bias_is_never_asked_for(server, monkeypatch):
    asked = []
    obey = server._obey
    monkeypatch.setattr(server, "_obey", lambda *request: (asked.append(int(request[0])), obey(*request)))
    with streaming(server) as (sensor, _):
        feed = Feed(server)
        sensor.tare(50)
        feed.close()
    wait_for(lambda: server.clients == 0)
    assert set(asked) == {0x0002, 0x0000}


def test_two_tares_tell_how_far_the_sensor_has_drifted(server):
    with streaming(server) as (sensor, _):
        feed = Feed(server)
        first = sensor.tare(100)
        feed.loads = (1.75, -2.25, 2.9, 0.0, 0.0, 0.0)
        time.sleep(0.05)
        again = sensor.tare(100)
        assert np.subtract(again, first) == pytest.approx((0.25, 0.0, -0.1))
        feed.close()


def test_no_zero_is_taken_from_a_moving_force(server):
    with streaming(server) as (sensor, kept):
        feed = Feed(server)
        before = len(kept.samples)
        rising = threading.Thread(target=lambda: rise(feed), daemon=True)
        rising.start()
        with pytest.raises(RigError, match=rf"moved by .* more than {STEADY_FORCE:g} N"):
            sensor.tare(300)
        rising.join()
        feed.close()
        assert kept.samples[-1].force[0] > 1.5  # the old zero holds
        assert len(kept.samples) > before


def rise(feed):
    for i in range(100):
        feed.loads = (1.5 + 0.02 * i, *LOADS[1:])
        time.sleep(0.005)


def test_noise_alone_is_no_motion(server):
    draw = random.Random(6)
    with streaming(server) as (sensor, _):
        done = threading.Event()

        def tremble():
            while not done.wait(0.001):
                server.send((draw.gauss(1.0, 0.05), draw.gauss(0.0, 0.05), 0.0, 0.0, 0.0, 0.0))

        thread = threading.Thread(target=tremble, daemon=True)
        thread.start()
        assert sensor.tare(200) == pytest.approx((1.0, 0.0, 0.0), abs=0.02)
        done.set()
        thread.join()


def test_no_zero_is_taken_from_a_bad_status(server):
    with streaming(server) as (sensor, _):
        server.faults.status = SensorStatus.ERROR | SensorStatus.GAGE_OUT_OF_RANGE
        feed = Feed(server)
        with pytest.raises(RigError, match="0x88000000: error, strain gage out of range"):
            sensor.tare()
        feed.close()


def test_no_zero_is_taken_from_a_stream_that_has_ended(server):
    with streaming(server) as (sensor, _), pytest.raises(RigError, match="Only 0 of 20 readings"):
        sensor.tare(20)


def test_a_tare_needs_an_open_sensor_and_enough_readings(server):
    sensor = NetftSensor(settings_of(server), SystemClock())
    with pytest.raises(RigError, match="not open"):
        sensor.tare()
    with pytest.raises(ValueError, match="samples = 5"):
        sensor.tare(5)


def test_where_no_reading_comes_the_error_says_what_to_check(server):
    others, server.faults.silent = set(threading.enumerate()), True
    sensor = NetftSensor(settings_of(server), SystemClock())
    with pytest.raises(RigError, match=r"No reading came .* RDT is enabled .* firewall"):
        sensor.open(Kept())
    wait_for(lambda: not [each for each in threading.enumerate() if each.name == "rig loop" and each not in others])


def test_where_no_page_answers_nothing_is_opened(server):
    settings = settings_of(server)
    server.close()
    with pytest.raises(RigError, match=r"page .* cannot be read"):
        NetftSensor(settings, SystemClock()).open(Kept())


def test_an_address_that_is_none_is_a_readable_error(server):
    settings = SensorSettings(address="no.such.host.invalid", page=server.page)
    with pytest.raises(RigError, match=r"no\.such\.host\.invalid:49152 cannot be reached.*sensor\.address"):
        NetftSensor(settings, SystemClock()).open(Kept())


def test_close_stops_the_stream_and_may_be_called_twice_and_open_again(server):
    others = set(threading.enumerate())
    with streaming(server) as (sensor, _):
        with pytest.raises(RigError, match="open already"):
            sensor.open(Kept())
        sensor.close()
        sensor.close()
        wait_for(lambda: server.clients == 0)
        wait_for(lambda: not [each for each in threading.enumerate() if each.name == "rig loop" and each not in others])
        feed, again = Feed(server), Kept()
        sensor.open(again)
        feed.close()
        assert again.samples[0].sequence == 1


def test_it_can_be_closed_from_its_own_thread(server):
    class Closing(Kept):
        def force(self, sample):
            super().force(sample)
            if len(self.samples) == 20:
                sensor.close()

    sensor, kept, feed = NetftSensor(settings_of(server), SystemClock()), Closing(), Feed(server)
    sensor.open(kept)
    wait_for(lambda: server.clients == 0)
    feed.close()
    assert len(kept.samples) == 20


def test_a_tare_from_its_own_thread_fails_instead_of_waiting_for_ever(server):
    refused = []

    class Taring(Kept):
        def force(self, sample):
            super().force(sample)
            if len(self.samples) == 5:
                with pytest.raises(RigError, match="Only 0 of 200 readings"):
                    sensor.tare()
                refused.append(True)

    sensor, feed = NetftSensor(settings_of(server), SystemClock()), Feed(server)
    sensor.open(Taring())
    wait_for(lambda: refused)
    sensor.close()
    feed.close()
