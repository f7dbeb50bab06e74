"""The emulated drive: its motor as the simulated one, and frame by frame CiA 301, CiA 402 and an EPOS4."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hand_moved_drive import INCREMENT, MILLI_RPM_PER_M_S, SYNC, HandMovedDrive
from hypothesis import given
from hypothesis import strategies as st

from cutenv.emulation.can_hub import Frame
from cutenv.emulation.canopen_rig import BLADE, HINGE
from cutenv.emulation.mechanics import (
    MODE_RAMP,
    MODE_VELOCITY,
    Mechanics,
    force_per_ampere,
    hinge,
    motor_record,
    turn_motor,
)
from cutenv.sim.cutting.drive import PDRig, Rig, advance_command, advance_in_air, lag_gain
from cutenv.sim.cutting.dtypes import TICK, new_state

SPEEDS = [0.01, 0.0254, -0.01]


def emulated(mechanics=None, *, axis=BLADE, position=0.05):
    motors = motor_record(axis, mechanics or Mechanics(), position=position, margin=0.003)
    motors["mode"] = MODE_VELOCITY
    motors["acceleration"] = motors["deceleration"] = axis.acceleration
    motors["ramp"], motors["fastest"] = axis.quick_stop, axis.speed
    motors["strongest"] = axis.current_limit * force_per_ampere(axis, mechanics or Mechanics())
    return motors


def led(motors, targets, load=0.0, field="carriage"):
    """What ``field`` was after each millisecond under ``targets``."""
    found = np.empty(len(targets))
    for i, target in enumerate(targets):
        motors["target"] = target
        turn_motor(motors, load)
        found[i] = motors[field][0]
    return found


def simulated(targets, position=0.05, drive=None):
    drive, state = (drive or Rig()).records(travel=0.149)[0], new_state(1, np.pi / 2)[0]
    state.hand = state.blade = position
    positions = np.empty(len(targets))
    for i, target in enumerate(targets):
        advance_in_air(state, drive, lag_gain(drive, TICK), target, TICK)
        positions[i] = state.blade
    return positions


def step_and_stop(speed):
    return np.concatenate([np.full(1500, speed), np.zeros(1000)])


@pytest.mark.parametrize("load", [0.0, -15.0])
@pytest.mark.parametrize("speed", SPEEDS)
def test_a_step_and_a_stop_follow_the_simulated_drive_within_a_tenth_of_a_millimetre(speed, load):
    targets = step_and_stop(speed)
    assert led(emulated(), targets, load) == pytest.approx(simulated(targets), abs=0.1e-3)


def pd_mechanics(drive, **changes):
    return Mechanics(proportional_gain=drive.proportional_gain, derivative_gain=drive.derivative_gain, **changes)


@pytest.mark.parametrize("load", [0.0, -15.0])
@pytest.mark.parametrize("drive", [PDRig(), PDRig(proportional_gain=2e5, derivative_gain=5e3)])
@pytest.mark.parametrize("speed", SPEEDS)
def test_pd_control_follows_the_simulated_drive_within_what_friction_and_load_shift(speed, drive, load):
    targets = step_and_stop(speed)
    moved = led(emulated(pd_mechanics(drive)), targets, load)
    shift = (22.0 + abs(load)) / drive.proportional_gain  # friction of motor and guides
    assert np.abs(moved - simulated(targets, drive=drive)).max() < 0.05e-3 + 1.2 * shift


def test_under_pd_control_a_load_shifts_the_blade_by_its_force_over_the_gain():
    drive, still = PDRig(proportional_gain=1e5, derivative_gain=8e3), np.zeros(3000)
    mechanics = pd_mechanics(drive, friction=0.0, carriage_friction=0.0, backlash=0.0)
    moved = led(emulated(mechanics), still, -15.0, field="position")
    assert moved[-1] - 0.05 == pytest.approx(-15.0 / 1e5, rel=0.01)
    held = led(emulated(Mechanics(friction=0.0, carriage_friction=0.0, backlash=0.0)), still, -15.0, field="position")
    assert held[-1] - 0.05 == pytest.approx(0.0, abs=2e-6)  # the velocity loop's integral brings it back


def test_a_derivative_gain_alone_is_refused():
    with pytest.raises(ValueError, match="derivative_gain = 5 is of PD control, and proportional_gain is 0"):
        Mechanics(derivative_gain=5.0)


def test_another_lag_would_be_noticed():
    targets = step_and_stop(0.0254)
    off = np.abs(led(emulated(Mechanics(lag=0.060)), targets) - simulated(targets))
    assert off.max() > 0.1e-3


def test_dead_time_delays_the_motion():
    targets = step_and_stop(0.0254)
    late = led(emulated(Mechanics(dead_time=0.010)), targets)
    assert late[10:] == pytest.approx(led(emulated(), targets)[:-10], abs=1e-12)


def test_backlash_is_play_between_motor_and_carriage():
    motors = emulated(Mechanics(backlash=0.5e-3))
    led(motors, np.full(500, 0.01))
    motor, carriage = float(motors["position"][0]), float(motors["carriage"][0])
    assert motor - carriage == pytest.approx(0.25e-3, abs=0.01e-3)
    led(motors, np.full(500, -0.01))
    motor, carriage = float(motors["position"][0]), float(motors["carriage"][0])
    assert motor - carriage == pytest.approx(-0.25e-3, abs=0.01e-3)


def test_a_motor_without_power_coasts_against_friction_and_stays():
    motors = emulated()
    led(motors, np.full(800, 0.0254))
    motors["mode"] = 0
    speeds = led(motors, np.zeros(500), field="speed")
    assert np.all(np.diff(speeds) <= 0.0)
    assert speeds[-1] == 0.0
    assert led(motors, np.zeros(200), load=-10.0, field="position")[-1] == float(motors["position"][0])


def test_the_ramp_of_a_stop_knows_no_lag():
    motors = emulated()
    led(motors, np.full(800, 0.0254))
    motors["mode"] = MODE_RAMP
    demands = led(motors, np.zeros(40), field="demand")
    assert demands[9] == pytest.approx(0.0254 - 0.010, abs=2e-5)
    assert demands[-1] == 0.0


def test_the_current_limit_is_a_limit_of_force():
    motors = emulated()
    motors["strongest"] = 10.0  # less than friction
    forces = led(motors, np.full(300, 0.0254), field="force")
    assert forces.max() == 10.0
    assert float(motors["position"][0]) == 0.05


def test_a_load_beyond_the_motors_force_pushes_the_blade_back():
    motors = emulated()
    motors["strongest"] = 100.0
    positions = led(motors, np.zeros(500), load=-400.0)
    assert positions[-1] < 0.045


def test_the_mechanical_end_stops_motor_and_carriage():
    motors = emulated(position=0.148)
    led(motors, np.full(800, 0.0254))
    assert float(motors["carriage"][0]) == BLADE.high + 0.003


def test_the_hinge_turns_as_fast_as_it_is_told():
    motors = emulated(hinge(), axis=HINGE, position=1.0)
    speeds = led(motors, np.full(400, 1.0), field="carriage_speed")
    assert speeds[-1] == pytest.approx(1.0, rel=1e-3)
    assert speeds.max() < 1.01


def test_a_spring_too_stiff_for_its_steps_is_refused():
    with pytest.raises(ValueError, match="more mass"):
        Mechanics(stiffness=1e8)


@pytest.fixture
def drive() -> HandMovedDrive:
    return HandMovedDrive()


def abort(index: int, sub: int, code: int) -> bytes:
    return struct.pack("<BHBI", 0x80, index, sub, code)


def test_it_says_boot_up_once_and_is_pre_operational_until_it_is_started(drive):
    drive.wait(0.2)
    assert drive.sent(0x701) == [b"\x00"]
    drive.wrote(0x1017, 0, "H", 50)
    drive.wait(0.1)
    assert drive.sent(0x701)[-1] == b"\x7f"
    drive.put(0x000, b"\x01\x00")
    drive.wait(0.1)
    assert drive.sent(0x701)[-1] == b"\x05"
    drive.put(0x000, b"\x02\x01")
    drive.wait(0.1)
    assert drive.sent(0x701)[-1] == b"\x04"


def test_heartbeats_come_at_the_period_that_is_written(drive):
    drive.wait(0.01)
    drive.wrote(0x1017, 0, "H", 50)
    drive.wait(1.0)
    assert len(drive.sent(0x701)) == 1 + 20


def test_sdo_frames_are_those_of_the_standard(drive):
    drive.wait(0.002)
    assert drive.asked(bytes.fromhex("2B 40 60 00 06 00 00 00")) == bytes.fromhex("60 40 60 00 00 00 00 00")
    assert drive.asked(bytes.fromhex("22 40 60 00 07 00 00 00")) == bytes.fromhex("60 40 60 00 00 00 00 00")
    assert drive.asked(bytes.fromhex("40 40 60 00 00 00 00 00")) == bytes.fromhex("4B 40 60 00 07 00 00 00")
    assert drive.asked(bytes.fromhex("40 41 60 00 00 00 00 00"))[:4] == bytes.fromhex("4B 41 60 00")
    assert drive.asked(bytes.fromhex("40 00 10 00 00 00 00 00")) == bytes.fromhex("43 00 10 00 92 01 02 00")
    assert drive.asked(bytes.fromhex("40 18 10 01 00 00 00 00")) == bytes.fromhex("43 18 10 01 FB 00 00 00")
    assert drive.asked(bytes.fromhex("40 08 10 00 00 00 00 00")) == bytes.fromhex("41 08 10 00 05 00 00 00")
    assert drive.asked(bytes.fromhex("60 00 00 00 00 00 00 00")) == b"\x05EPOS4\0\0"


def test_a_segmented_download_writes_as_an_expedited_one(drive):
    drive.wait(0.002)
    assert drive.asked(bytes.fromhex("21 83 60 00 04 00 00 00"))[0] == 0x60
    assert drive.asked(bytes.fromhex("07 90 33 00 00 00 00 00"))[0] == 0x20
    assert drive.read(0x6083) == 13200


@pytest.mark.parametrize(
    ("index", "sub", "form", "value", "code"),
    [
        (0x6041, 0, "H", 1, 0x06010002),  # read only
        (0x5FFF, 0, "H", 1, 0x06020000),  # no such object
        (0x1018, 9, "I", 1, 0x06090011),  # no such sub-index
        (0x6083, 0, "H", 1, 0x06070010),  # wrong length
        (0x6060, 0, "b", 4, 0x06090030),  # not one of its values
        (0x6007, 0, "h", 4, 0x06090031),  # too high
        (0x6007, 0, "h", -1, 0x06090032),  # too low
        (0x60A9, 0, "I", 0x00B40100, 0x06090030),  # no revolutions a minute
        (0x1A00, 1, "I", 0x60640020, 0x08000022),  # the PDO is in use
    ],
)
def test_a_bad_write_is_refused_with_the_code_of_the_standard(drive, index, sub, form, value, code):
    drive.wait(0.002)
    assert drive.write(index, sub, form, value) == abort(index, sub, code)


def test_a_mapping_is_refused_where_an_object_cannot_stand_or_eight_bytes_do_not_do(drive):
    drive.wait(0.002)
    drive.wrote(0x1800, 1, "I", 0x80000181)
    drive.wrote(0x1A00, 0, "B", 0)
    assert drive.write(0x1A00, 1, "I", 0x60830020) == abort(0x1A00, 1, 0x06040041)
    for sub in (1, 2, 3):
        drive.wrote(0x1A00, sub, "I", 0x60640020)
    assert drive.write(0x1A00, 0, "B", 3) == abort(0x1A00, 0, 0x06040042)


def test_what_a_pdo_carries_is_what_the_master_has_mapped(drive):
    drive.wait(0.002)
    drive.map(0x1801, 0x1A01, 0x2AA, 2, (0x60610008, 0x10010008, 0x60410010))
    drive.put(0x000, b"\x01\x01")
    for _ in range(4):
        drive.put(SYNC, b"")
    assert drive.sent(0x2AA) == [bytes.fromhex("00 00 40 02")] * 2  # every second SYNC
    assert not drive.sent(0x281)


def test_an_empty_slot_of_a_pdo_carries_nothing(drive):
    drive.wait(0.002)
    drive.map(0x1400, 0x1600, 0x201, 255, (0x60400010, 0))
    drive.put(0x000, b"\x01\x01")
    drive.put(0x201, b"\x06\x00")
    assert drive.read(0x6041) & 0x6F == 0x21


def test_a_synchronous_rpdo_waits_for_the_sync_and_one_too_short_is_not_used():
    drive = HandMovedDrive().set_up()
    drive.put(0x000, b"\x80\x01")
    drive.map(0x1400, 0x1600, 0x201, 1, (0x60400010, 0x60FF0020, 0x60600008))
    drive.put(0x000, b"\x01\x01")
    drive.put(0x201, b"\x06\x00")
    assert drive.status() == 0x40
    drive.command(0x06)
    assert drive.read(0x6041) & 0x6F == 0x40
    assert drive.status() == 0x21


WORDS = {"shutdown": 0x06, "switch on": 0x07, "enable": 0x0F, "disable voltage": 0x00, "quick stop": 0x0B}
PATHS = [
    (["shutdown"], 0x21),
    (["switch on"], 0x40),
    (["enable"], 0x40),
    (["shutdown", "switch on"], 0x23),
    (["shutdown", "enable"], 0x27),
    (["shutdown", "disable voltage"], 0x40),
    (["shutdown", "quick stop"], 0x40),
    (["shutdown", "switch on", "shutdown"], 0x21),
    (["shutdown", "switch on", "disable voltage"], 0x40),
    (["shutdown", "switch on", "quick stop"], 0x40),
    (["shutdown", "switch on", "enable"], 0x27),
    (["shutdown", "switch on", "enable", "switch on"], 0x23),
    (["shutdown", "switch on", "enable", "shutdown"], 0x21),
    (["shutdown", "switch on", "enable", "disable voltage"], 0x40),
    (["shutdown", "switch on", "enable", "quick stop"], 0x07),
    (["shutdown", "switch on", "enable", "quick stop", "enable"], 0x27),
    (["shutdown", "switch on", "enable", "quick stop", "shutdown"], 0x07),
    (["shutdown", "switch on", "enable", "quick stop", "disable voltage"], 0x40),
]


@pytest.mark.parametrize(("path", "status"), PATHS, ids=lambda value: value if isinstance(value, int) else value[-1])
def test_controlwords_lead_where_cia_402_says(path, status):
    drive = HandMovedDrive().set_up()
    for word in path:
        drive.command(WORDS[word])
        drive.wait(0.005)
    assert drive.status() == status


def test_quick_stop_option_2_ends_without_power():
    drive = HandMovedDrive().enabled()
    drive.wrote(0x605A, 0, "h", 2)
    drive.command(0x0F, 0.01)
    drive.wait(0.3)
    drive.command(0x0B)
    assert drive.status() == 0x07
    drive.wait(0.1)
    assert drive.status() == 0x40


@given(words=st.lists(st.integers(0, 0xFFFF), max_size=40))
def test_no_controlword_moves_a_blade_whose_target_is_zero(words):
    drive = HandMovedDrive().set_up()
    for word in words:
        drive.command(word)
        drive.wait(0.002)
    assert drive.position() == 0.0


@given(frames=st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=60))
def test_no_frame_brings_it_down(frames):
    drive = HandMovedDrive().set_up()
    for identifier, data in frames:
        drive.put(identifier, data)
        drive.wait(0.001)
    drive.put(0x000, b"\x81\x01")
    drive.wait(0.002)
    assert drive.read(0x1000) == 0x00020192


def test_extended_frames_are_not_for_it(drive):
    drive.wait(0.002)
    before = len(drive.frames)
    drive.node.receive(Frame(0x601, bytes.fromhex("4000100000000000"), extended=True), drive.now)
    assert len(drive.frames) == before


def test_speed_and_position_are_told_in_the_drives_units():
    drive = HandMovedDrive().moving(0.01)
    drive.put(SYNC, b"")
    _, velocity, mode = struct.unpack("<Hib", drive.sent(0x181)[-1])
    assert velocity == pytest.approx(0.01 * MILLI_RPM_PER_M_S, rel=0.002)
    assert mode == 3
    assert drive.position() == pytest.approx(float(drive.axis.motor["position"]), abs=INCREMENT)


@pytest.mark.parametrize("speed", [0.01, 0.0254])
def test_a_commanded_step_and_stop_is_the_simulated_drives_within_a_tenth_of_a_millimetre(speed):
    drive, positions = HandMovedDrive().enabled(), []
    for target in (speed, 0.0):
        drive.command(0x0F, target)
        for _ in range(1000):
            drive.wait(0.001)
            positions.append(float(drive.axis.motor["carriage"]))
    simulated, state = Rig().records(travel=0.149)[0], new_state(1, 1.5)[0]
    for i, position in enumerate(positions):
        target = speed if i < 1000 else 0.0
        advance_command(state, simulated, lag_gain(simulated, TICK), target, TICK)
        assert position == pytest.approx(float(state.hand), abs=0.1e-3)


def test_whole_rpm_and_milli_rpm_mean_the_same_speed():
    for unit, velocity in ((0x00B44700, 1320), (0xFDB44700, 1_320_000)):
        drive = HandMovedDrive().enabled()
        drive.command(0x00)
        drive.wait(0.002)
        drive.wrote(0x60A9, 0, "I", unit)
        drive.wrote(0x607F, 0, "I", 4 * velocity)
        for word in (0x06, 0x07, 0x0F):
            drive.put(0x201, struct.pack("<Hib", word, velocity, 3))
        drive.wait(0.5)
        assert float(drive.axis.motor["speed"]) == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize("deceleration", [0.5, 1.0, 2.0])
def test_a_quick_stop_takes_v2_over_2a(deceleration):
    drive = HandMovedDrive().enabled()
    drive.wrote(0x6085, 0, "I", round(deceleration * MILLI_RPM_PER_M_S / 1000))
    drive.command(0x0F, 0.0254)
    drive.wait(0.6)
    start = float(drive.axis.motor["position"])
    drive.command(0x0B)
    drive.wait(0.2)
    assert drive.status() == 0x07
    distance = float(drive.axis.motor["position"]) - start
    assert distance == pytest.approx(0.0254**2 / (2 * deceleration), abs=0.02e-3)


def test_a_lost_heartbeat_of_the_master_stops_the_blade():
    drive = HandMovedDrive().moving()
    drive.frames.clear()
    drive.wait(0.060, heartbeats=False)
    assert not drive.sent(0x081)
    drive.wait(0.100, heartbeats=False)
    assert drive.sent(0x081) == [bytes.fromhex("30 81 11 00 00 00 00 00")]
    assert drive.status() == 0x07
    drive.wait(0.1)
    assert drive.axis.rests()
    assert "heartbeat of the master lost" in drive.happened


def test_a_heartbeat_that_never_came_is_not_missed(drive):
    drive.wait(0.002)
    drive.wrote(0x1016, 1, "I", 0x007F0064)
    drive.wait(0.5, heartbeats=False)
    assert not drive.sent(0x081)


@pytest.mark.parametrize(("option", "status"), [(0, 0x27), (1, 0x08), (2, 0x40), (3, 0x07)])
def test_the_abort_option_says_what_a_lost_heartbeat_does(option, status):
    drive = HandMovedDrive().enabled()
    drive.wrote(0x6007, 0, "h", option)
    drive.wait(0.05)
    drive.wait(0.15, heartbeats=False)
    assert drive.status() == status


def test_beyond_the_software_limit_it_faults_and_comes_back_inward():
    drive = HandMovedDrive().enabled()
    drive.wrote(0x607D, 2, "i", round(0.005 / INCREMENT))
    drive.command(0x0F, 0.0254)
    drive.wait(0.6)
    assert drive.sent(0x081)[-1][:3] == bytes.fromhex("82 8A 21")
    assert drive.status() == 0x08
    assert 0.005 < drive.position() < 0.006
    for word in (0x00, 0x80, 0x06, 0x07, 0x0F):
        drive.command(word)
        drive.wait(0.002)
    drive.command(0x0F, -0.01)
    drive.wait(0.3)
    assert drive.status() == 0x27
    assert drive.position() < 0.005


def test_a_fault_is_reset_by_the_rising_edge_alone():
    drive = HandMovedDrive().enabled()
    drive.node.failure = 0x3210
    drive.wait(0.005)
    assert drive.status() == 0x08
    assert drive.sent(0x081)[-1][:3] == bytes.fromhex("10 32 05")
    drive.command(0x80)
    assert drive.status() == 0x08  # what is wrong is still wrong
    drive.node.failure = 0
    drive.command(0x80)
    assert drive.status() == 0x08  # no edge
    drive.command(0x00)
    drive.command(0x80)
    assert drive.status() == 0x40
    assert drive.sent(0x081)[-1] == bytes(8)


def test_leaving_operational_stops_a_moving_blade():
    drive = HandMovedDrive().moving()
    drive.put(0x000, b"\x80\x01")
    drive.wait(0.2)
    assert drive.read(0x6041) & 0x6F == 0x07
    assert drive.axis.rests()


def test_power_on_again_is_a_boot_with_the_objects_as_they_were_stored():
    drive = HandMovedDrive().moving()
    drive.node.power(False, drive.now)
    drive.frames.clear()
    drive.wait(0.5)
    drive.put(0x601, bytes.fromhex("4000100000000000"))
    assert not drive.frames
    drive.node.power(True, drive.now)
    drive.wait(0.002)
    assert drive.sent(0x701) == [b"\x00"]
    assert drive.read(0x6083) == 10_000
    drive.wrote(0x6083, 0, "I", 13_200)
    assert drive.write(0x1010, 1, "I", 1)[0] == 0x80
    drive.wrote(0x1010, 1, "I", 0x65766173)
    drive.put(0x000, b"\x81\x01")
    drive.wait(0.002)
    assert drive.read(0x6083) == 13_200


def test_homing_takes_the_present_place_for_the_home_offset():
    drive = HandMovedDrive().moving(0.01)
    drive.command(0x0F, 0.0)
    drive.wait(0.5)
    drive.wrote(0x607C, 0, "i", 7)
    drive.wrote(0x6060, 0, "b", 6)
    drive.wrote(0x6040, 0, "H", 0x1F)
    drive.wait(0.002)
    assert drive.read(0x6064) == 7
    assert drive.read(0x6041) & 0x1400 == 0x1400
