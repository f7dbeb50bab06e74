"""The board's sketch, compiled for this computer: it moves as told, and stops by itself at all that it watches."""

from __future__ import annotations

import random
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from cutenv.emulation.firmware import CONVERTERS, HIGH_PIN, LOW_PIN, STOP_PIN, Firmware, compiled
from cutenv.rig.devices.serial.board import (
    BoardFlag,
    BoardIdentity,
    BoardState,
    ForceReport,
    LineError,
    MotionReport,
    Report,
    StepperSetup,
    board_line,
    board_report,
)
from cutenv.rig.errors import RigError

SETUP = StepperSetup(acceleration=40_000, quick_stop=200_000, fastest=2_400, low=-800, high=59_600)
SPEED = 2_000  # steps/s, 5 mm/s
SILENCE = 0.100  # s
QUICK = SPEED / SETUP.quick_stop  # s


class Board:
    """Board that a test speaks with, line by line."""

    def __init__(self, converter: str = "hx711") -> None:
        self.firmware = Firmware(converter)
        self.rest = b""
        self.reports: list[Report] = []

    def say(self, *texts: str) -> None:
        for text in texts:
            self.firmware.feed(board_line(text))
        self.run(0.001)

    def run(self, seconds: float, *, alive: bool = False) -> list[Report]:
        """Let time pass, with signs of life if ``alive``; return the reports."""
        new: list[Report] = []
        for tick in range(round(1e3 * seconds)):
            if alive and tick % 25 == 0:
                self.firmware.feed(board_line("H"))
            self.firmware.advance()
            *lines, self.rest = (self.rest + self.firmware.drain()).split(b"\n")
            new += [board_report(line) for line in lines]
        self.reports += new
        return new

    def ready(self) -> Board:
        self.say("P {} {} {} {} {}".format(*SETUP), "Z", "N")
        return self

    def driving(self, speed: int = SPEED) -> Board:
        self.ready().say(f"V {speed}")
        self.run(0.2, alive=True)
        return self

    @property
    def motion(self) -> MotionReport:
        return next(each for each in reversed(self.reports) if isinstance(each, MotionReport))

    def rested(self, within: float) -> bool:
        """Return True if the motor stands within so many seconds, and then stays."""
        self.run(within)
        steps = self.firmware.steps
        self.run(0.3, alive=True)
        return self.firmware.steps == steps


def test_it_says_who_it_is_and_keeps_its_set_up() -> None:
    board = Board()
    board.say("I")
    board.say("P {} {} {} {} {}".format(*SETUP))
    board.run(0.02)
    assert BoardIdentity(1, "hx711", 80) in board.reports
    assert SETUP in board.reports


@pytest.mark.parametrize("bad", ["P 1 2 3 4 5", "P 40000 20000 2400 -800 59600", "P 40000 200000 90000 -800 59600",
                                 "P 40000 200000 2400 9 9", "P", "P x"])  # fmt: skip
def test_a_set_up_that_it_cannot_drive_is_not_kept(bad: str) -> None:
    board = Board()
    board.say(bad, "Z", "N")
    board.run(0.05)
    assert BoardFlag.UNSET in board.motion.flags
    assert board.motion.state is BoardState.OFF


@pytest.mark.parametrize("missing", ["P", "Z"])
def test_without_set_up_or_zero_the_motor_gets_no_power(missing: str) -> None:
    board = Board()
    lines = ["P {} {} {} {} {}".format(*SETUP), "Z", "N", "V 2000"]
    board.say(*(line for line in lines if line[0] != missing))
    board.run(0.2, alive=True)
    assert not board.firmware.powered
    assert board.firmware.steps == 0


@pytest.mark.parametrize("speed", [SPEED, -100, 7])
def test_it_makes_the_steps_that_it_is_told(speed: int) -> None:
    board = Board().driving(speed)
    before = board.firmware.steps
    board.run(0.2, alive=True)
    assert board.firmware.steps - before == pytest.approx(0.2 * speed, abs=1.5)
    assert board.motion.rate == speed
    assert board.motion.steps == pytest.approx(board.firmware.steps, abs=0.01 * abs(speed) + 1)


def test_a_speed_beyond_its_limit_is_limited() -> None:
    assert Board().driving(10**6).motion.rate == SETUP.fastest


@pytest.mark.promise("S13")
def test_what_is_no_command_is_no_sign_of_life() -> None:
    """An echo of the board's own lines, and valid lines that say nothing, keep no motor going."""
    board = Board().driving()
    before = board.firmware.steps
    for tick in range(100):
        echo = board_line(
            ("M 7 1 1 0 2000 0", "F 9 0 1234", "A cutenv-board 1 hx711 80", "P 1 2 3 4 5", "Hello", "V")[tick % 6]
        )
        board.firmware.feed(echo)
        board.run(0.010)
    assert board.motion.state is BoardState.STOPPED
    assert board.firmware.steps - before <= SPEED * (SILENCE + QUICK) + 5


@pytest.mark.promise("S13")
def test_it_stops_by_itself_when_the_computer_is_silent_and_stays_so() -> None:
    board = Board().driving()
    before = board.firmware.steps
    assert board.rested(SILENCE + QUICK + 0.005)
    assert board.firmware.steps - before <= SPEED * (SILENCE + QUICK) + 5
    assert board.motion.state is BoardState.STOPPED
    assert BoardFlag.SILENT in board.motion.flags
    board.say("V 2000", "N")
    assert board.rested(0.05)
    board.say("C", "N", "V 2000")
    board.run(0.1, alive=True)
    assert board.motion.state is BoardState.ENABLED


def test_signs_of_life_that_are_damaged_count_for_nothing() -> None:
    board = Board().driving()
    for _ in range(30):
        board.firmware.feed(b"H*0000\n")
        board.run(0.01)
    assert BoardFlag.SILENT in board.motion.flags
    assert board.motion.bad == 30


@pytest.mark.parametrize(
    ("event", "flag", "state"),
    [
        (lambda board: board.say("Q"), BoardFlag(0), BoardState.STOPPED),
        (lambda board: board.firmware.open_pin(STOP_PIN), BoardFlag.STOP_OPEN, BoardState.FAULT),
        (lambda board: board.firmware.open_pin(HIGH_PIN), BoardFlag.AT_HIGH, BoardState.STOPPED),
    ],
)
def test_it_stops_within_its_ramp(event: Callable[[Board], None], flag: BoardFlag, state: BoardState) -> None:
    board = Board().driving()
    before = board.firmware.steps
    event(board)
    assert board.rested(QUICK + 0.004)
    assert board.firmware.steps - before <= SPEED * (0.5 * QUICK + 0.003) + 2
    assert flag in board.motion.flags
    assert board.motion.state is state


def test_the_stop_buttons_contact_takes_the_power_and_no_clearing_helps_while_it_is_open() -> None:
    board = Board().driving()
    board.firmware.open_pin(STOP_PIN)
    board.run(0.1, alive=True)
    assert not board.firmware.powered
    board.say("C", "N", "V 2000")
    board.run(0.1, alive=True)
    assert board.motion.state is BoardState.FAULT
    board.firmware.open_pin(STOP_PIN, False)
    board.run(0.01)
    board.say("C", "N", "V 2000")
    board.run(0.1, alive=True)
    assert board.motion.rate == SPEED


@pytest.mark.parametrize(("pin", "out"), [(LOW_PIN, -SPEED), (HIGH_PIN, SPEED)])
def test_a_limit_switch_lets_it_go_back_inside_only(pin: int, out: int) -> None:
    board = Board().ready()
    board.firmware.open_pin(pin)
    board.say(f"V {out}")
    board.run(0.1, alive=True)
    assert abs(board.firmware.steps) < 5
    board.say("C", "N", f"V {-out}")
    board.run(0.2, alive=True)
    assert abs(board.firmware.steps) > 100


@pytest.mark.parametrize(("ends", "speed"), [((-800, 600), SPEED), ((-300, 59_600), -SPEED)])
def test_it_stops_at_the_ends_of_travel_that_the_file_sets(ends: tuple[int, int], speed: int) -> None:
    board = Board()
    board.say("P 40000 200000 2400 {} {}".format(*ends), "Z", "N", f"V {speed}")
    board.run(0.6, alive=True)
    assert BoardFlag.SOFT_END in board.motion.flags
    beyond = max(board.firmware.steps - ends[1], ends[0] - board.firmware.steps)
    assert 0 <= beyond <= SPEED * (0.5 * QUICK + 0.002) + 2


@pytest.mark.parametrize("converter", CONVERTERS)
@pytest.mark.parametrize("counts", [0, 1, -1, 123_456, -123_456, 8_388_606, -8_388_607])
def test_each_converter_is_read_bit_by_bit(converter: str, counts: int) -> None:
    board = Board(converter)
    board.firmware.weigh(counts)
    board.run(0.05)  # it starts
    readings = [each for each in board.run(0.5) if isinstance(each, ForceReport)]
    assert {each.counts for each in readings} == {counts}
    assert {each.status for each in readings} == {0}
    assert len(readings) == pytest.approx(0.5 * CONVERTERS[converter], rel=0.05)
    assert [each.sequence for each in readings] == list(range(readings[0].sequence, readings[-1].sequence + 1))


def test_the_end_of_the_converters_range_is_a_bad_status() -> None:
    board = Board()
    board.firmware.weigh(10**9)
    assert all(each.status == 1 for each in board.run(0.2)[3:] if isinstance(each, ForceReport))


def test_a_line_says_what_was_put_into_it() -> None:
    line = board_line("M 7 1 1 -20 2000 0").rstrip()
    assert board_report(line) == MotionReport(7, BoardState.ENABLED, BoardFlag.ZEROED, -20, 2000, 0)


def test_a_hundred_thousand_damaged_lines_neither_pass_nor_stop_the_reader() -> None:
    draw, passed = random.Random(0), 0
    whole = [board_line(text).rstrip() for text in ("M 4711 1 1 -20123 2000 0", "F 4711 0 -123456", "P 1 2 3 4 5")]
    for _ in range(100_000):
        line = bytearray(draw.choice(whole))
        for _ in range(draw.randrange(1, 4)):
            line[draw.randrange(len(line))] ^= 1 << draw.randrange(8)
        if bytes(line) in whole:
            continue  # two of them have undone each other
        try:
            board_report(bytes(line))
            passed += 1
        except LineError:
            pass
    assert passed <= 2  # sixteen bits of a CRC


def test_random_bytes_move_no_motor_and_the_board_goes_on() -> None:
    board, draw = Board().ready(), random.Random(1)
    for _ in range(200):
        board.firmware.feed(draw.randbytes(500))
        board.run(0.002)
    assert board.firmware.steps == 0
    board.firmware.feed(b"\n")
    board.say("C", "N", "V 2000")
    board.run(0.1, alive=True)
    assert board.firmware.steps > 0


def test_without_a_compiler_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(RigError, match=r"no C\+\+ compiler. Install one"):
        compiled("hx711")
