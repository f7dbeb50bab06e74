"""Attacks on the rig's own process, on the emulator's, and on the machine: signals, clocks, threads, load, memory."""

from __future__ import annotations

import ctypes
import gc
import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from cutenv.rig.errors import RigError
from scripts.validation.rig.attack_scene import Attack, Scene, named

_FORK_ENDS = 0.5  # [s] for a child that may do nothing


def paused(pid: int, seconds: float) -> None:
    """Stop a process, and let another one continue it after ``seconds``."""
    helper = f"kill -STOP {pid}; sleep {seconds}; kill -CONT {pid}"
    subprocess.run(["sh", "-c", helper], check=True)


def pauses(milliseconds: int) -> Attack:
    """Stop this process for so long."""
    return named(
        f"program_paused_{milliseconds}_ms",
        f"SIGSTOP to this program for {milliseconds} ms.",
        lambda scene: paused(os.getpid(), 1e-3 * milliseconds),
    )


def emulator_paused(scene: Scene) -> None:
    """Send SIGSTOP to the emulator for 300 ms while the blade moves: bus and sensor fall silent together."""
    paused(scene.emulator.pid, 0.3)


def emulator_killed(scene: Scene) -> None:
    """Kill the emulator while the blade moves."""
    os.kill(scene.emulator.pid, signal.SIGKILL)


def interpreter_held(scene: Scene) -> None:
    """Hold the interpreter for 200 ms in a library."""
    ctypes.PyDLL(None).usleep(200_000)


def switches_withheld(scene: Scene) -> None:
    """Let threads switch once a second only, while one counts."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1.0)
    try:
        ends = time.monotonic() + 0.5
        while time.monotonic() < ends:
            sum(range(1000))
    finally:
        sys.setswitchinterval(before)


def garbage_collected(scene: Scene) -> None:
    """Search three million objects for garbage."""
    kept = [[i] for i in range(1_000_000)]
    gc.unfreeze()
    gc.collect()
    del kept


def many_threads(scene: Scene) -> None:
    """Let two hundred threads count for 0.3 s."""
    ends = time.monotonic() + 0.3

    def count() -> None:
        while time.monotonic() < ends:
            sum(range(100))

    threads = [threading.Thread(target=count, daemon=True) for _ in range(200)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def busy_processes(scene: Scene) -> None:
    """Let twice as many processes as there are cores count for half a second."""
    code = "import time; e = time.monotonic() + 0.5\nwhile time.monotonic() < e: sum(range(1000))"
    others = [subprocess.Popen(["nice", sys.executable, "-c", code]) for _ in range(2 * (os.cpu_count() or 1))]
    for other in others:
        other.wait(30.0)


def memory_filled(scene: Scene) -> None:
    """Allocate half a gigabyte and write to it."""
    taken = bytearray(512 << 20)
    taken[::4096] = b"x" * len(taken[::4096])
    del taken


def memory_refused(scene: Scene) -> None:
    """Let the system refuse more memory for half a second."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    with open("/proc/self/statm", encoding="ascii") as file:
        taken = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (taken + (1 << 20), before[1]))
    try:
        time.sleep(0.5)
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


def files_refused(scene: Scene) -> None:
    """Let the system refuse to open files for half a second."""
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, before[1]))
    try:
        time.sleep(0.5)
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)


@contextmanager
def replaced(holder: Any, name: str, value: Any) -> Iterator[None]:
    """Replace an attribute in the block."""
    before = getattr(holder, name)
    setattr(holder, name, value)
    try:
        yield
    finally:
        setattr(holder, name, before)


def wall_clock_set(scene: Scene) -> None:
    """Set the wall clock back by a year."""
    true = time.time
    with replaced(time, "time", lambda: true() - 3.15e7):
        time.sleep(0.4)


def forked_child(scene: Scene) -> None:
    """Fork in a policy, and let its child close session and rig, and command the blade."""
    plant, session = scene.rig.plant, scene.rig.session
    actions: tuple[Callable[[], object], ...] = (session.close, plant.close, lambda: plant.advance(0.0, 1.5, 20))
    child = os.fork()
    if not child:
        for action in actions:
            with suppress(RigError):
                action()
        os._exit(0)
    ends = time.monotonic() + _FORK_ENDS
    while os.waitpid(child, os.WNOHANG) == (0, 0):
        if time.monotonic() > ends:
            os.kill(child, signal.SIGKILL)
            scene.note(f"! the child had not ended after {_FORK_ENDS:g} s")
        time.sleep(0.01)


def closed_by_another_thread(scene: Scene) -> None:
    """Close the session from this thread while the other one cuts."""
    begun = time.monotonic()
    scene.rig.session.close()
    scene.note(f"closed in {1e3 * (time.monotonic() - begun):.0f} ms")


STOPPED = (
    pauses(100), pauses(300), emulator_paused, emulator_killed, interpreter_held,
    closed_by_another_thread,
)  # fmt: skip
IGNORED = (wall_clock_set, forked_child)
EITHER = (
    pauses(10), pauses(30), switches_withheld, garbage_collected, many_threads, busy_processes, memory_filled,
    memory_refused, files_refused,
)  # fmt: skip
