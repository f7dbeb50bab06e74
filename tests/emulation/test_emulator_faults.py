"""Every fault of the emulated rig does what it says, and is over when it is cleared."""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterator
from contextlib import closing

import pytest
from hand_moved_drive import INCREMENT, SYNC, HandMovedDrive

from cutenv.emulation.canopen_rig import EmulatedRig, Options
from cutenv.emulation.emulated_bench import FAULTS, parsed_fault
from cutenv.emulation.mechanics import EmulatedTissue
from cutenv.rig.config.settings import across
from cutenv.rig.errors import RigError


class HandMovedRig(HandMovedDrive):
    """The whole rig, its time moved by hand; readings of the sensor are ``counts`` per 1e-6 N."""

    def __init__(self, **options) -> None:
        self.rig = EmulatedRig(Options(**options))
        self.frames, self.now = [], 1000.0
        self.rig.hub.send = self.frames.append
        self.node, self.axis = self.rig.nodes["blade"], self.rig.axes["blade"]
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.settimeout(1.0)
        self.socket.connect(("127.0.0.1", self.rig.sensor.port))
        self.socket.send(struct.pack("!HHI", 0x1234, 2, 0))
        deadline = time.monotonic() + 5.0
        while not self.rig.sensor.clients:
            assert time.monotonic() < deadline
            time.sleep(0.002)

    def wait(self, seconds, *, heartbeats=True):
        for tick in range(round(1000 * seconds)):
            self.now += 0.001
            if heartbeats and tick % 30 == 0:
                self.put(0x77F, b"\x05")
            self.rig.step(self.now)

    def drain(self):
        """All readings that have arrived: sequence, status, force along the cut [N]."""
        self.socket.settimeout(0.05)
        readings = []
        while True:
            try:
                sequence, _, status, fx, *_ = struct.unpack("!IIIiiiiii", self.socket.recv(64))
            except TimeoutError:
                return readings
            readings.append((sequence, status, fx * 1e-6))

    def readings(self, seconds=0.05):
        """Of the next so many seconds."""
        self.drain()
        self.wait(seconds)
        return self.drain()

    def close(self):
        self.socket.close()
        self.rig.close()


@pytest.fixture
def rig(request) -> Iterator[HandMovedRig]:
    named = getattr(request.node, "callspec", None)
    axis = OF_AN_AXIS.get(named.params.get("name", ""), "") if named is not None else ""
    made = HandMovedRig(mounted=None, cross_axes=across(axis))
    yield made
    made.close()


def speed(rig):
    return float(rig.axis.motor["speed"])


def heartbeat_lost(rig):
    rig.moving()
    rig.rig.inject("heartbeat_lost", {})
    rig.frames.clear()
    rig.wait(0.3)
    assert rig.status() == 0x27
    assert not rig.sent(0x701)
    rig.rig.clear()
    rig.wait(0.06)
    assert rig.sent(0x701)


def bus_off(rig):
    rig.moving()
    rig.rig.inject("bus_off", {})
    rig.frames.clear()
    rig.put(SYNC, b"")
    rig.wait(0.05)
    assert not rig.sent(0x181)
    assert speed(rig) == pytest.approx(0.0254, rel=0.01)
    rig.wait(0.2)
    assert rig.axis.rests()  # it has heard no heartbeat of the master
    rig.rig.clear()
    assert rig.status() == 0x07


def stuck_encoder(rig):
    rig.moving()
    position = rig.position()
    rig.rig.inject("stuck_encoder", {})
    rig.wait(0.05)
    assert rig.position() == pytest.approx(position, abs=2 * INCREMENT)
    assert rig.read(0x606C) == 0
    assert speed(rig) == pytest.approx(0.0254, rel=0.01)
    rig.wait(0.1)
    assert rig.sent(0x081)[-1][:2] == b"\x11\x86"
    rig.rig.clear()
    rig.wait(0.002)
    assert rig.position() > position + 1e-3


def following_error(rig):
    rig.moving()
    rig.rig.inject("following_error", {})
    rig.wait(0.060)
    assert rig.status() == 0x27
    rig.wait(0.040)
    assert rig.sent(0x081)[-1] == bytes.fromhex("11 86 21 00 00 00 00 00")
    rig.wait(0.1)
    assert rig.status() == 0x08
    rig.rig.clear()
    for word in (0x00, 0x80, 0x06, 0x07, 0x0F):
        rig.command(word)
        rig.wait(0.005)
    rig.command(0x0F, 0.01)
    rig.wait(0.3)
    assert speed(rig) == pytest.approx(0.01, rel=0.01)


def slip(rig):
    rig.moving()
    carriage = float(rig.axis.motor["carriage"])
    rig.rig.inject("slip", {"share": 1.0})
    rig.wait(0.2)
    assert float(rig.axis.motor["carriage"]) == pytest.approx(carriage, abs=0.1e-3)
    assert rig.status() == 0x27  # the encoder does not see it
    assert speed(rig) == pytest.approx(0.0254, rel=0.01)
    rig.rig.clear()
    rig.wait(0.2)
    assert float(rig.axis.motor["carriage"]) == pytest.approx(carriage + 0.2 * 0.0254, abs=0.2e-3)


def runaway(rig):
    rig.moving(0.01)
    rig.rig.inject("runaway", {"speed": 0.035})
    rig.wait(0.6)
    assert speed(rig) == pytest.approx(0.035, rel=0.01)
    rig.command(0x0B)
    rig.wait(0.1)
    assert rig.axis.rests()


def second_master(rig):
    rig.enabled()
    rig.command(0x0B)
    rig.wait(0.1)
    rig.rig.inject("second_master", {"speed": 0.03})
    rig.wait(0.6)
    assert speed(rig) == pytest.approx(0.03, rel=0.01)
    assert len(rig.sent(0x201)) == 600  # and everybody on the bus hears it
    rig.rig.clear()
    rig.command(0x0B)
    rig.wait(0.1)
    assert rig.axis.rests()


def doubled_frames(rig):
    rig.enabled()
    rig.frames.clear()
    rig.rig.inject("doubled_frames", {})
    for _ in range(5):
        rig.put(SYNC, b"")
        rig.wait(0.005)
    assert len(rig.sent(0x281)) == 4 * 5  # it hears each SYNC twice, and each of its answers is heard twice
    rig.rig.clear()
    rig.put(SYNC, b"")
    assert len(rig.sent(0x281)) == 4 * 5 + 1


def drive_fault(rig):
    rig.moving()
    rig.rig.inject("drive_fault", {})
    rig.wait(0.002)
    assert rig.status() == 0x08
    assert rig.sent(0x081)[-1] == bytes.fromhex("10 23 03 00 00 00 00 00")
    rig.rig.clear("drive_fault")
    rig.command(0x00)
    rig.command(0x80)
    assert rig.status() == 0x40


def power_loss(rig):
    rig.moving()
    start = float(rig.axis.motor["position"])
    rig.rig.inject("power_loss", {})
    rig.frames.clear()
    rig.wait(0.5)
    rig.put(SYNC, b"")
    assert not rig.sent(0x181) + rig.sent(0x281) + rig.sent(0x701)
    assert speed(rig) == 0.0
    assert 0.2e-3 < float(rig.axis.motor["position"]) - start < 10e-3
    rig.rig.clear()
    rig.wait(0.002)
    assert rig.sent(0x701) == [b"\x00"]


def over_force(rig):
    rig.wait(0.1)
    rig.rig.inject("over_force", {"force_N": 30.0})
    readings = rig.readings(0.1)
    assert readings[-1][2] == pytest.approx(30.0, abs=0.2)
    assert "force limit crossed" in [event["what"] for event in rig.rig.events()]
    rig.rig.clear()
    assert rig.readings(0.1)[-1][2] == pytest.approx(0.0, abs=0.2)


def sensor_freeze(rig):
    rig.rig.inject("sensor_freeze", {})
    rig.rig.inject("over_force", {"force_N": 10.0})
    readings = rig.readings()
    assert len(readings) == 50
    assert len({reading[2] for reading in readings}) == 1
    rig.rig.clear()
    assert [reading[0] for reading in rig.readings()] == list(range(readings[-1][0] + 1, readings[-1][0] + 51))


def axis_freeze(rig):
    rig.rig.inject("axis_freeze", {})
    frozen = rig.readings()
    assert len({force for _, _, force in frozen[1:]}) == 1
    rig.rig.inject("axis_freeze", {"number": 1})
    assert len({force for _, _, force in rig.readings()}) > 1
    rig.rig.clear()
    assert len({force for _, _, force in rig.readings()}) > 1


def sensor_silent(rig):
    rig.rig.inject("sensor_silent", {})
    assert not rig.readings()
    rig.rig.clear()
    assert len(rig.readings()) == 50


def bad_status(rig):
    rig.rig.inject("bad_status", {})
    assert {reading[1] for reading in rig.readings()} == {0x80010000}
    rig.rig.clear()
    assert {reading[1] for reading in rig.readings()} == {0}


def packet_loss(rig):
    rig.rig.inject("packet_loss", {"share": 0.5})
    sequences = [reading[0] for reading in rig.readings(0.2)]
    assert 50 < len(sequences) < 150
    assert sequences == sorted(sequences)
    rig.rig.clear()
    assert len(rig.readings()) == 50


def reordering(rig):
    rig.rig.inject("reordering", {})
    sequences = [reading[0] for reading in rig.readings(0.2)]
    assert sequences != sorted(sequences)
    assert len(set(sequences)) == len(sequences)


def latency(rig):
    rig.rig.inject("latency", {"delay_s": 2.0})
    assert not rig.readings()
    rig.rig.clear()
    assert len(rig.readings()) == 100  # what was on its way as well


def saturation(rig):
    rig.rig.inject("saturation", {})
    reading = rig.readings()[-1]
    assert abs(reading[2]) == pytest.approx(200.0)
    assert reading[1] & 0xC0000000


def cannot_be_raised(rig):
    rig.moving()
    rig.rig.inject("cannot_be_raised", {})
    rig.wait(0.1)
    assert speed(rig) == 0.0
    rig.rig.clear()
    rig.rig.inject("cannot_be_raised", {"axis": "height"})
    lift = rig.rig.axes["height"].motor
    lift["mode"], lift["strongest"], lift["fastest"], lift["acceleration"] = 1, 1e3, 1.0, 1.0
    for target, moved in ((0.005, 0.0), (-0.005, -0.001)):
        rig.rig.nodes["height"].axis.drive = lambda *_, target=target, **__: lift.__setitem__("target", target)
        rig.wait(0.4)
        assert (lift["position"] < -0.001) == (moved < 0.0)
        assert lift["position"] <= 1e-9


def wrong_position(rig):
    rig.moving()
    before = rig.position()
    rig.rig.inject("wrong_position", {"shift": 0.002})
    rig.wait(0.001)
    assert rig.position() - before == pytest.approx(0.002, abs=1e-4)
    assert rig.status() == 0x27  # the drive sees no following error
    rig.rig.clear()
    rig.wait(0.001)
    assert rig.position() - before == pytest.approx(0.0, abs=2e-4)


def deaf(rig):
    rig.moving()
    rig.rig.inject("deaf", {})
    rig.command(0x0B)
    rig.wait(0.05)
    assert rig.status() == 0x27
    assert speed(rig) > 0.02
    rig.wait(0.2, heartbeats=False)
    assert rig.axis.rests()  # its watch for our heartbeat stops it nevertheless


def over_lift(rig):
    rig.rig.inject("over_lift", {"force_N": 12.0})
    rig.drain()
    rig.wait(0.01)
    assert struct.unpack("!IIIiiiiii", rig.socket.recv(64))[5] * 1e-6 == pytest.approx(12.0, abs=0.1)
    rig.rig.clear()
    with pytest.raises(ValueError, match="no height axis"):
        EmulatedTissue().add_across("height", 1.0)


def side_push(rig):
    rig.rig.inject("side_push", {"force_N": 12.0})
    rig.drain()
    rig.wait(0.01)
    assert struct.unpack("!IIIiiiiii", rig.socket.recv(64))[4] * 1e-6 == pytest.approx(12.0, abs=0.1)


OF_AN_AXIS = {"cannot_be_raised": "height", "over_lift": "height", "side_push": "side"}
PROMISES = {
    promise.__name__: promise
    for promise in (
        heartbeat_lost, bus_off, doubled_frames, stuck_encoder, following_error, slip, runaway, drive_fault, power_loss,
        over_force, second_master, sensor_freeze, axis_freeze, sensor_silent, bad_status, packet_loss, reordering,
        latency, saturation, cannot_be_raised, wrong_position, deaf, over_lift, side_push,
    )
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_does_what_it_says(rig, name):
    PROMISES[name](rig)
    rig.rig.clear()
    assert not rig.rig.active
    assert {"fault injected"} <= {event["what"] for event in rig.rig.events()}


def test_a_fault_of_the_hinge_leaves_the_blade_alone(rig):
    rig.rig.inject("bus_off", {"axis": "angle"})
    assert rig.rig.nodes["angle"].bus_off
    assert not rig.node.bus_off


def test_a_rig_with_a_fixed_angle_has_no_hinge_to_fail():
    with closing(HandMovedRig(mounted=None, angle_mode="fixed", angle=1.0)) as rig:
        assert rig.rig.angle == 1.0
        with pytest.raises(ValueError, match="axis must be one of 'blade'"):
            rig.rig.inject("bus_off", {"axis": "angle"})


@pytest.mark.parametrize(
    ("name", "given", "says"),
    [
        ("bus_of", {}, "Did you mean 'bus_off'"),
        ("packet_loss", {"share": 2.0}, "outside 0 to 1"),
        ("packet_loss", {"shar": 0.5}, "it has: share"),
        ("over_force", {"force_N": float("nan")}, "outside"),
        ("over_force", {"force_N": "much"}, "must be one real number in N"),
    ],
)
def test_a_bad_fault_is_refused_and_changes_nothing(rig, name, given, says):
    with pytest.raises((ValueError, TypeError), match=says):
        rig.rig.inject(name, given)
    assert not rig.rig.active


def test_clearing_what_is_not_there_names_what_is(rig):
    rig.rig.inject("sensor_freeze", {})
    with pytest.raises(RigError, match="active: sensor_freeze"):
        rig.rig.clear("bus_off")


def test_a_fault_of_the_command_line_has_name_parameters_and_time():
    assert parsed_fault("slip:share=0.5,axis=angle@2.5") == ("slip", {"share": 0.5, "axis": "angle"}, 2.5)
    for text in ("slip", "slip@", "slip:share@1", "slip:share=x@1", "slip@-1", "slip@nan"):
        with pytest.raises(ValueError, match="write NAME@SECONDS"):
            parsed_fault(text)


def test_events_tell_of_stop_and_standstill_in_the_rigs_time(rig):
    rig.moving()
    rig.command(0x0B)
    before = rig.now
    rig.wait(0.1)
    names = [event["what"] for event in rig.rig.events()]
    assert names == ["quick stop received", "standstill"]
    standstill = rig.rig.events(since=1)[0]
    assert standstill["time_s"] - before == pytest.approx(0.0254 / 1.0, abs=0.003)
    assert rig.rig.events(since=2) == []
