"""Attacks on what lies between a program and the spine of its rig: processes, shared memory, line, numbers, times."""

from __future__ import annotations

import os
import random
import resource
import signal
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from cutenv.emulation.process import RunningEmulator, start
from cutenv.rig.remote_spine import RemoteSpine
from cutenv.rig.safety.stop_causes import Cause
from cutenv.rig.spine_process import COMMAND, GO
from scripts.validation.rig.attack_scene import FARTHEST, Attack, Found, Scene, named
from scripts.validation.rig.attacks_on_process import paused, replaced
from scripts.validation.rig.cutting_rig import SPEED, UPRIGHT
from scripts.validation.rig.rig_cut_process import CutProcess

_HOUR = 3600.0  # [s]
_STANDS = 1e-4  # [m] that a blade at rest may move in 0.4 s
_GONE_WITHIN = 5.0  # [s] of the program's end for its spine to end
_SCRIBBLED = 0.3  # [s] for which the memory is written to
_SCRIBBLE = """
import mmap, os, sys, time
file, start, end, ends = sys.argv[1], *map(int, sys.argv[2:4]), time.monotonic() + float(sys.argv[4])
with open(file, "r+b") as opened:
    memory = mmap.mmap(opened.fileno(), 0)
while True:
    memory[start:end] = os.urandom(end - start)
    if time.monotonic() > ends:
        break
    time.sleep(0.001)
"""


def _spine(scene: Scene) -> RemoteSpine:
    spine = scene.rig.plant.spine
    assert isinstance(spine, RemoteSpine)
    return spine


def pauses(milliseconds: int) -> Attack:
    """Make the attack that stops the spine for so long."""
    return named(
        f"spine_paused_{milliseconds}_ms",
        f"SIGSTOP to the spine for {milliseconds} ms.",
        lambda scene: paused(_spine(scene).pid, 1e-3 * milliseconds),
    )


def spine_paused_and_asked(scene: Scene) -> None:
    """Send SIGSTOP to the spine for good, and ask it for a stop."""
    os.kill(_spine(scene).pid, signal.SIGSTOP)
    scene.rig.plant.supervisor.trip(Cause.OPERATOR, "the attack")


def spine_terminated(scene: Scene) -> None:
    """Send SIGTERM to the spine alone."""
    os.kill(_spine(scene).pid, signal.SIGTERM)


def spine_killed(scene: Scene) -> None:
    """Send SIGKILL to the spine."""
    os.kill(_spine(scene).pid, signal.SIGKILL)


def refused(name: str, about: str, limit: int) -> Attack:
    """Make the attack that lets the system refuse something to the spine for half a second."""

    def attack(scene: Scene) -> None:
        spine = _spine(scene)
        before = resource.prlimit(spine.pid, limit)
        resource.prlimit(spine.pid, limit, (3, before[1]))
        try:
            time.sleep(0.5)
        finally:
            with suppress(ProcessLookupError):
                resource.prlimit(spine.pid, limit, before)

    return named(name, about, attack)


def scribbled(name: str, about: str, ring: str, *, asked: bool = False, once: bool = False) -> Attack:
    """Make the attack by a second program that writes noise into the memory that spine and program share.

    ``ring`` is the part that it writes to; the program asks for a stop meanwhile if ``asked``.
    """

    def attack(scene: Scene) -> None:
        spine = _spine(scene)
        files = Path(f"/proc/{spine.pid}/fd")
        memory = next(file for file in files.iterdir() if "cutenv-rig" in os.readlink(file))
        link = spine._link
        starts = {each: getattr(link, each)._start for each in ("samples", "states", "stops")}
        later = [start for start in starts.values() if start > starts[ring]]
        end = min(later, default=memory.stat().st_size)
        numbers = starts[ring], end, 0.0 if once else _SCRIBBLED
        with subprocess.Popen([sys.executable, "-c", _SCRIBBLE, str(memory), *map(str, numbers)]):
            if asked:
                time.sleep(0.15)  # until it writes
                scene.mark()
                scene.rig.plant.supervisor.trip(Cause.OPERATOR, "the attack")

    return named(name, about, attack)


@contextmanager
def _line(scene: Scene) -> Iterator[Callable[[bytes], int]]:
    """Yield a function that writes bytes on the line to the spine, between two messages of the program."""
    spine = _spine(scene)
    with spine._calling:
        yield lambda data: os.write(spine._line.fileno(), data)


def half_a_message(scene: Scene) -> None:
    """Send half a message; the next ones are then taken for its end."""
    with _line(scene) as write:
        write(struct.pack("!i", COMMAND.size) + bytes(30))


def line_closed_half_way(scene: Scene) -> None:
    """Send half a message, and close the line."""
    with _line(scene) as write:
        write(struct.pack("!i", COMMAND.size) + bytes(30))
        _spine(scene)._line.close()


def message_without_end(scene: Scene) -> None:
    """Announce a message of two gigabytes."""
    with _line(scene) as write:
        write(struct.pack("!i", 2**31 - 1) + bytes(1000))


def noise_on_the_line(scene: Scene) -> None:
    """Send messages of noise, some of which begin as commands and calls do."""
    noise = random.Random(2)
    for first in (b"D", b"T", b"\x80", b"O", b""):
        with _line(scene) as write:
            data = first + noise.randbytes(50)
            write(struct.pack("!i", len(data)) + data)


def commands(
    name: str, about: str, *, number: int | None = None, ahead: float = 0.0, hold: float = 0.02, speed: float = SPEED
) -> Attack:
    """Make the attack that sends one command of another number, time, validity or speed."""

    def attack(scene: Scene) -> None:
        spine = _spine(scene)
        with _line(scene) as write:
            counted = next(spine._numbers) if number is None else number
            given = spine.clock.now() + ahead
            data = COMMAND.pack(GO, counted, os.getppid(), given, speed, UPRIGHT, hold, 0.0, 0.0)
            write(struct.pack("!i", len(data)) + data)

    return named(name, about, attack)


def clock_jumps(name: str, about: str, by: float) -> Attack:
    """Make the attack that sets the program's clock for 0.4 s."""

    def attack(scene: Scene) -> None:
        true = time.monotonic
        with replaced(time, "monotonic", lambda: true() + by):
            time.sleep(0.4)

    return named(name, about, attack)


def forked_child_beneath(scene: Scene) -> None:
    """Fork in a policy, and let its child command the spine as the program does."""
    spine = _spine(scene)
    number = next(spine._numbers) + 10**6
    child = os.fork()
    if not child:
        data = COMMAND.pack(GO, number, os.getppid(), time.monotonic(), SPEED, UPRIGHT, 0.02, 0.0, 0.0)
        os.write(spine._line.fileno(), struct.pack("!i", len(data)) + data)
        os._exit(0)
    os.waitpid(child, 0)


def _leaves_nothing(end: Callable[[RunningEmulator, CutProcess], None], errors: int | None = None) -> Found:
    """Let a program cut, and end as it does; its blade has to rest within the allowed way, and its spine to be gone."""
    with start() as emulator:
        program, control = CutProcess(emulator, seed=1, errors=errors), emulator.control
        try:
            spine = program.line()["spine"]
            time.sleep(0.5)
            begun = float(control.truth()["position_m"])
            end(emulator, program)
        finally:
            program.end()
        ends = time.monotonic() + _GONE_WITHIN
        while (left := _runs(spine)) and time.monotonic() < ends:
            time.sleep(0.01)
        rest = float(control.truth()["position_m"])
        time.sleep(0.4)
        wrong = [f"its spine {spine} runs on"] if left else []
        if abs(float(control.truth()["position_m"]) - rest) > _STANDS:
            wrong.append("the blade moves on")
        if not abs(rest - begun) < FARTHEST:
            wrong.append("the blade went too far")
        return wrong, [f"{1e3 * (rest - begun):.2f} mm"]


def _runs(pid: int) -> bool:
    """Return whether a process runs; one that has ended and is not waited for yet does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def program_killed() -> Found:
    """Kill the program (kill -9): its spine stops the blade, and ends itself."""
    return _leaves_nothing(lambda emulator, program: program.process.kill())


def _disobeyed(emulator: RunningEmulator, program: CutProcess) -> None:
    """Let the sensor fall silent, and the drive not obey a quick stop: the heartbeat ends, and that is logged."""
    emulator.control.inject("deaf")
    emulator.control.inject("sensor_silent")
    program.line()


def errors_closed() -> Found:
    """Close the standard error of program and spine, while the drive obeys no quick stop."""
    read, write = os.pipe()
    os.close(read)
    try:
        return _leaves_nothing(_disobeyed, write)
    finally:
        os.close(write)


def errors_unread() -> Found:
    """Read no more of the standard error of program and spine, which is full, while the drive obeys no quick stop."""
    read, write = os.pipe()
    os.set_blocking(write, False)
    with suppress(BlockingIOError):
        while True:
            os.write(write, bytes(4096))
    os.set_blocking(write, True)
    try:
        return _leaves_nothing(_disobeyed, write)
    finally:
        os.close(read)
        os.close(write)


ENDS = (program_killed, errors_closed, errors_unread)
"""Trials of a program that ends, or is no longer read: what was wrong, and other observations."""
_NAN, _EVER = float("nan"), float("inf")
STOPPED = (  # attacks that have to stop the blade
    pauses(100), pauses(300), spine_paused_and_asked, spine_terminated, spine_killed,
    scribbled("readings_overwritten", "Write noise over the readings in the shared memory for 0.3 s.", "samples"),
    scribbled(
        "states_overwritten",
        "Write noise over the states in the shared memory, while the program asks for a stop.",
        "states", asked=True,
    ),
    scribbled(
        "stops_overwritten",
        "Write noise over the stops asked for in the shared memory, while the program asks for one.",
        "stops", asked=True,
    ),
    half_a_message, line_closed_half_way, message_without_end, noise_on_the_line,
    commands("command_numbers_backwards", "Send a command whose number goes back.", number=1),
    commands("command_numbers_ahead", "Send a command whose number is far ahead of those to come.", number=2**62),
    commands("command_of_the_future", "Send a command given in an hour.", ahead=_HOUR),
    commands("command_of_the_past", "Send a command given an hour ago.", ahead=-_HOUR),
    commands("command_at_no_time", "Send a command given at a time that is no number.", ahead=_NAN),
    commands("command_for_ever", "Send a command that is valid for ever.", hold=_EVER),
    commands("command_for_an_hour", "Send a command that is valid for an hour.", hold=_HOUR),
    commands("command_valid_for_no_number", "Send a command whose validity is no number.", hold=_NAN),
    commands("command_of_no_number", "Send a command whose speed is no number.", speed=_NAN),
    clock_jumps("clock_ahead", "Set the program's clock ahead by an hour, for 0.4 s.", _HOUR),
    clock_jumps("clock_back", "Set the program's clock back by an hour, for 0.4 s.", -_HOUR),
    forked_child_beneath,
)  # fmt: skip
IGNORED: tuple[Attack, ...] = ()
EITHER = (  # attacks that may stop it
    pauses(10), pauses(30),
    scribbled(
        "readings_spoiled",
        "Write noise over the readings in the shared memory once: one that is not taken yet may be among them.",
        "samples", once=True,
    ),
    refused("spine_files_refused", "Refuse the spine to open files for half a second.", resource.RLIMIT_NOFILE),
    refused("spine_memory_refused", "Refuse the spine more memory for half a second.", resource.RLIMIT_AS),
)  # fmt: skip
