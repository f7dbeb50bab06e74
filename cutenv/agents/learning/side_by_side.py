"""Training of several tasks side by side.

Each in a process of its own, one line of progress for all.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from types import FrameType

from cutenv.envs import cores

_PROGRESS = re.compile(r"(?P<step>[^:]+): +(?P<share>\d+)%\|.*?(?:, (?P<shown>return .*))?\]$")
_QUIET = 20.0  # seconds between lines of progress where no terminal shows them in place
_LOOK = 0.5  # seconds between looks at the processes


class Training:
    """One training in a process of its own.

    What it prints is kept until it ends.  Its batches use so many ``cores``, unless ``CUTENV_CORES`` is set.
    """

    def __init__(self, name: str, command: Sequence[str], cores: int) -> None:
        self.name = name
        self.progress = "begins"  # last progress that it printed, such as "training 45 %, return 0.31, success 0.42"
        self.printed: list[str] = []  # lines that it printed, without its bars of progress
        own_group = os.name != "nt"  # so that Ctrl-C reaches it once, from here
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=own_group,
            env={"CUTENV_CORES": str(cores), **os.environ, "PYTHONUNBUFFERED": "1"}, encoding="utf-8", errors="replace",
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:  # a bar ends its line by a carriage return, which is read as a line feed
            found = _PROGRESS.search(line.rstrip())
            if found:
                shown = f", {found['shown']}" if found["shown"] else ""
                self.progress = f"{found['step']} {found['share']} %{shown}"
            elif line.strip() or (self.printed and self.printed[-1]):  # bars that are gone leave empty lines
                self.printed.append(line.rstrip())

    def interrupt(self) -> None:
        """Send what Ctrl-C sends, unless it has ended."""
        if os.name != "nt" and self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)

    def end(self) -> int:
        """Wait for the end; return the exit status."""
        status = self.process.wait()
        self._reader.join()
        return status


def train_side_by_side(commands: Mapping[str, Sequence[str]]) -> int:
    """Run trainings, command lines by name, side by side.

    Each one's output is printed at its end.  Return 0 if all succeeded, 130 after Ctrl-C, or the status of the first
    that failed.
    """
    each = max(cores() // len(commands), 1)  # more threads than cores wait for each other
    began, running = time.monotonic(), [Training(name, command, each) for name, command in commands.items()]
    statuses: list[int] = []
    before = signal.signal(signal.SIGTERM, _stop)
    try:
        statuses = _watch(running, began)
    except KeyboardInterrupt:
        for one in running:
            one.interrupt()
        for one in running:
            one.end()
            _print_ended(one)
        return 130
    finally:
        signal.signal(signal.SIGTERM, before)
        for one in running:
            if one.process.poll() is None:
                one.process.terminate()
    return next((status for status in statuses if status), 0)


def _stop(signum: int, frame: FrameType | None) -> None:
    raise SystemExit(128 + signum)


def _watch(running: list[Training], began: float) -> list[int]:
    """Show progress and finished outputs; return all exit statuses."""
    here, shown, statuses = sys.stdout.isatty(), -_QUIET, []
    while running:
        for one in [one for one in running if one.process.poll() is not None]:
            statuses.append(one.end())
            running.remove(one)
            if here:
                print("\r\033[K", end="")
            _print_ended(one)
        now = time.monotonic() - began
        if running and (here or now - shown >= _QUIET):
            shown = now
            line = f"{now:4.0f} s  " + "   ".join(f"{one.name}: {one.progress}" for one in running)
            print(f"\r\033[K{line}" if here else line, end="" if here else "\n", flush=True)
        if running:
            time.sleep(_LOOK)
    return statuses


def _print_ended(one: Training) -> None:
    print(f"\n== {one.name}\n" + "\n".join(one.printed).strip("\n"), flush=True)
