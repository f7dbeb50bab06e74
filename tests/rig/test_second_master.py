"""Somebody else commands our drive: found by the first frame, stopped before it moves, and not given up."""

from __future__ import annotations

import struct

import pytest
from hand_moved_drive import MILLI_RPM_PER_M_S
from hand_moved_rig import HandMovedRig

from cutenv.rig.devices.canopen.objects import command_of_another
from cutenv.rig.devices.protocols import DriveState, Phase
from cutenv.rig.errors import RigError
from cutenv.rig.safety.stop_causes import Cause, RigStopped

ALLOWED = 0.001  # [m]
STILL = 1e-4  # [m/s]
SPEED = 0.03  # [m/s] that the other one wants


@pytest.fixture
def rig() -> HandMovedRig:
    return HandMovedRig().ready()


def intrusion(controlword: int = 0x0F, speed: float = SPEED) -> bytes:
    return struct.pack("<Hib", controlword, round(speed * MILLI_RPM_PER_M_S), 3)


class Intruder:
    """Puts an enabling sequence and a target on the bus, over and over, for a while."""

    def __init__(
        self, rig: HandMovedRig, *, every: float = 0.001, lasts: float = 1.0, words: tuple[int, ...] = (0x0F,)
    ):
        self.rig, self.words, self.sent = rig, words, 0
        self.ends = rig.clock.now() + lasts
        self.begun = self.start = 0.0  # when its first frame was sent, and where the blade was
        rig.clock.every(every, self._send, "intruder")

    def _send(self, now: float) -> None:
        if now < self.ends:
            if self.sent == 0:
                self.begun, self.start = now, self.rig.position
            self.rig.network.put(0x201, intrusion(self.words[self.sent % len(self.words)]))
            self.sent += 1


def cut_into(rig: HandMovedRig) -> RigStopped:
    with pytest.raises(RigStopped) as stopped:
        rig.cut(0.015, 1.0)
    return stopped.value


WAYS, PERIODS, MOMENTS = (0.0005, 0.001, 0.002), (0.001, 0.005, 0.020), (0.503, 0.511, 0.519)
SQUARE = [(way, every, MOMENTS[(i + j) % 3]) for i, way in enumerate(WAYS) for j, every in enumerate(PERIODS)]
"""Nine of the 27, in which every two values meet."""


@pytest.mark.parametrize(("way", "every", "moment"), SQUARE)
@pytest.mark.parametrize(
    ("words", "allowed"), [((0x0F,), 0.00025), ((0x06, 0x07, 0x0F), ALLOWED)], ids=["0f", "06 07 0f"]
)
def test_a_master_that_goes_on_enabling_moves_a_cutting_blade_by_less_than_a_millimetre(
    rig, way, every, moment, words, allowed
):
    """One that enables alone, which brakes by the quick stop; one that first takes the power, so that it coasts."""
    rig.network.way = way
    rig.cut(0.015, 0.5)
    rig.supervisor.drive(0.015, 1.57, 0.02)
    rig.wait(moment - 0.5)
    intruder = Intruder(rig, every=every, lasts=1.0, words=words)
    stop = cut_into(rig)
    assert stop.report.cause is Cause.FOREIGN
    assert stop.report.detected - intruder.begun <= way + 0.001
    rig.wait(1.5)
    assert abs(rig.position - intruder.start) < allowed
    assert abs(rig.speed) < STILL
    assert rig.node.state is not DriveState.ENABLED


def test_each_of_its_frames_is_answered_by_a_quick_stop_even_at_rest_and_with_nobody_who_repeats(rig):
    """Repeated quick stops would hide a frame that is not answered."""
    rig.cut(0.015, 0.5)
    rig.plant.spine.timers[1].stop()  # the repeated quick stops
    came: list[float] = []
    put = rig.network.put

    def noted(number: int, data: bytes) -> None:
        came.append(rig.clock.now() + rig.network.way)
        put(number, data)

    rig.network.put = noted  # type: ignore[method-assign]
    Intruder(rig, every=0.003, lasts=0.1)
    start = rig.position
    cut_into(rig)
    rig.wait(0.5)
    rig.network.put(0x201, intrusion())  # once more, long after the blade has come to rest
    rig.wait(0.1)
    stops = [time for time, number, data in rig.network.sent if number == 0x201 and data[0] == 0x0B]
    assert len(came) > 20
    for moment in came:
        assert any(0.0 <= time - moment <= 0.001 for time in stops), f"a frame that came at {moment:.4f} s"
    assert abs(rig.position - start) < ALLOWED
    assert rig.node.state is not DriveState.ENABLED


def test_frames_that_come_at_once_have_one_answer(rig):
    """Answers are no greater load on the bus than what they answer."""
    rig.cut(0.015, 0.5)
    rig.network.sent.clear()
    for _ in range(20):
        rig.network.put(0x201, intrusion())
    cut_into(rig)
    stops = [time for time, number, data in rig.network.sent if number == 0x201 and data[0] == 0x0B]
    assert len(stops) == 2  # the stop, and the answer


def test_an_answer_that_is_lost_is_repeated_as_what_it_was(rig):
    """No command undoes it, also where the other master sends no second frame that would be answered."""
    rig.cut(0.015, 0.5)
    drive, heals = rig.network.to_drive, rig.clock.now() + 0.008
    rig.network.put(0x201, intrusion())
    rig.network.to_drive = lambda frame: drive(frame) if rig.clock.now() > heals else None
    cut_into(rig)
    rig.wait(0.5)
    assert rig.node.dictionary[0x605A] == 2
    assert rig.node.state is DriveState.DISABLED
    assert abs(rig.speed) < STILL


@pytest.mark.parametrize("powered", [True, False])
def test_a_locked_rig_is_not_set_going(rig, powered):
    rig.plant.halt()
    if not powered:
        rig.plant.switch_off()
    start = rig.position
    Intruder(rig, lasts=1.0, words=(0x06, 0x07, 0x0F))
    rig.wait(1.5)
    assert rig.supervisor.phase is Phase.STOPPED
    assert rig.supervisor.report.cause is Cause.FOREIGN
    assert abs(rig.position - start) < ALLOWED
    assert abs(rig.speed) < STILL
    assert rig.node.state is not DriveState.ENABLED


def test_quick_stops_go_on_when_sync_and_samples_have_ended(rig):
    rig.cut(0.015, 0.5)
    for repeating in rig.network._repeating[:2]:  # SYNC and heartbeat
        repeating.stop()
    rig.network.lost = 40
    cut_into(rig)
    begun = rig.position
    rig.wait(0.5)
    assert rig.network.lost == 0
    assert rig.node.state is DriveState.QUICK_STOP
    assert abs(rig.speed) < STILL
    rig.node._enter(DriveState.ENABLED)  # whoever did it: it was not seen on our bus
    start = rig.position
    rig.wait(0.02)
    assert rig.node.state is DriveState.QUICK_STOP
    assert abs(rig.position - start) < ALLOWED
    assert abs(start - begun) < ALLOWED


def test_a_master_that_nobody_hears_is_stopped_by_what_the_drive_tells(rig):
    rig.cut(0.015, 0.5)
    rig.plant.halt()
    start = rig.position
    ends = rig.clock.now() + 1.0

    def intrude(now: float) -> None:
        if now < ends:
            rig.node.dictionary.set_data(0x60FF, 0, struct.pack("<i", round(SPEED * MILLI_RPM_PER_M_S)))
            rig.node.dictionary.set_data(0x6040, 0, b"\x0f\x00")

    rig.clock.every(0.020, intrude, "by another way")
    rig.wait(1.5)
    assert rig.supervisor.report.cause is Cause.FOLLOWING
    assert abs(rig.position - start) < 0.020
    assert abs(rig.speed) < STILL
    assert rig.node.state is not DriveState.ENABLED


def test_after_it_has_gone_the_operator_can_go_on_and_not_before(rig):
    Intruder(rig, lasts=0.5)
    rig.wait(0.2)
    with pytest.raises(RigError):
        rig.go_on()
    assert rig.supervisor.latched is not None
    rig.wait(1.0)
    rig.go_on()
    rig.cut(0.01, 0.2)


@pytest.mark.parametrize(
    ("number", "data", "what"),
    [
        (0x000, b"\x01\x01", "network command 01 01"),
        (0x000, b"\x80\x00", "network command 80 00"),
        (0x000, b"\x01\x02", None),
        (0x601, bytes.fromhex("40 41 60 00 00 00 00 00"), "SDO request 40 41 60"),
        (0x602, bytes(8), None),
        (0x201, intrusion(), "RPDO1 0f 00"),
        (0x301, b"", "RPDO2"),
        (0x501, bytes(8), "RPDO4"),
        (0x701, b"\x05", None),
        (0x77F, b"\x05", "heartbeat of a master"),
        (0x080, b"", None),
        (0x181, bytes(7), None),
    ],
)
def test_what_is_a_command_of_somebody_else(number, data, what):
    found = command_of_another(number, data, node=1, master=127)
    assert (found is None) == (what is None)
    assert what is None or found.startswith(what)


@pytest.mark.parametrize(
    ("number", "data"),
    [(0x000, b"\x80\x01"), (0x601, bytes.fromhex("2B 40 60 00 0F 00 00 00")), (0x201, intrusion()), (0x77F, b"\x05")],
)
def test_a_single_frame_stops_a_cut_and_is_named(rig, number, data):
    rig.cut(0.015, 0.5)
    start = rig.position
    rig.network.put(number, data)
    stop = cut_into(rig)
    assert stop.report.cause is Cause.FOREIGN
    assert "another master commands the blade drive" in stop.report.detail
    rig.wait(0.5)
    assert abs(rig.position - start) < ALLOWED
    assert abs(rig.speed) < STILL


def test_a_quick_stop_for_good_is_two_frames_and_the_reset_takes_it_back(rig):
    rig.cut(0.015, 0.2)
    rig.network.sent.clear()
    rig.network.put(0x201, intrusion())
    rig.wait(0.2)
    sent = [(number, data.hex(" ")) for _, number, data in rig.network.sent if number in (0x201, 0x601)]
    assert sent[:3] == [
        (0x201, "0b 00 00 00 00 00 03"),
        (0x601, "2b 5a 60 00 02 00 00 00"),
        (0x201, "0b 00 00 00 00 00 03"),
    ]
    assert rig.node.dictionary[0x605A] == 2
    assert rig.node.state is DriveState.DISABLED
    rig.go_on()
    assert rig.node.dictionary[0x605A] == 6
