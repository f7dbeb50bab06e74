"""Emulated firmware on a serial line that can fail.

The sketch of the board, or GRBL 1.1.

It is not GRBL's own code: planner and parser are as small as the driver needs them.
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import math
import os
import random
import re
import shutil
import subprocess
import tempfile
import threading
import time
from collections import deque
from pathlib import Path

from cutenv._base import resources
from cutenv._base.validation import one_of
from cutenv.drivers.grbl_axis import JOG_CANCEL, MARK, SOFT_RESET, STATUS
from cutenv.rig.errors import RigError


class EmulatedLine:
    """Pseudo-terminal whose other end is opened as a serial port.

    ``lost_share``, ``damaged_share``: faults: shares of the lines from the board that are lost, and of which a byte is
    changed; ``delay``: fault: time that lines from the board take longer [s]; ``doubled``: fault: each line from the
    board comes twice; ``deaf``, ``mute``: faults: nothing gets to the board; nothing comes from it; ``noise``: fault:
    random bytes come from the board, as with another baud rate.
    """

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="cutenv-port-")
        self.port = str(Path(self._folder.name) / "board")  # name of the port, a link that leads to the terminal
        self._master = self._slave = -1
        self._late: deque[tuple[float, bytes]] = deque()
        self._rest = b""
        self._random = random.Random(0)
        self.lost_share = self.damaged_share = self.delay = 0.0
        self.doubled = self.deaf = self.mute = self.noise = False
        self.plug()

    @property
    def plugged(self) -> bool:
        """True while the cable is in."""
        return self._master >= 0

    def plug(self) -> None:
        """Plug the cable in: a new terminal under the same name."""
        if self.plugged:
            return
        import tty  # here: there is none on Windows, where this module is imported too

        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        link = Path(self.port)
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        """Unplug the cable: terminal and name vanish."""
        if not self.plugged:
            return
        Path(self.port).unlink(missing_ok=True)
        ends, self._master, self._slave = (self._master, self._slave), -1, -1
        for end in ends:
            os.close(end)
        self._late.clear()

    def heard(self) -> bytes:
        """Return the bytes that the computer has sent to the board."""
        if not self.plugged:
            return b""
        try:
            read = os.read(self._master, 4096)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO, errno.EBADF):  # nothing, or unplugged at this moment
                raise
            return b""
        return b"" if self.deaf else read

    def say(self, sent: bytes, now: float) -> list[bytes]:
        """Send the board's bytes; return its whole lines, lost ones too."""
        *lines, self._rest = (self._rest + sent).split(b"\n")
        for line in lines:
            for _ in range(1 + self.doubled):
                if not self.mute and self._random.random() >= self.lost_share:
                    self._late.append((now + self.delay, self._on_the_way(line + b"\n")))
        while self._late and self._late[0][0] <= now:
            self._write(self._late.popleft()[1])
        return lines

    def _on_the_way(self, line: bytes) -> bytes:
        if self.noise:
            return self._random.randbytes(len(line))
        if self._random.random() < self.damaged_share:
            place = self._random.randrange(len(line))
            return line[:place] + bytes([line[place] ^ 1 << self._random.randrange(8)]) + line[place + 1 :]
        return line

    def _write(self, line: bytes) -> None:
        if self.plugged:
            try:
                os.write(self._master, line)
            except OSError as error:
                if error.errno not in (errno.EAGAIN, errno.EIO):  # nobody reads: the line is lost
                    raise

    def close(self) -> None:
        """Remove the port; may be called twice."""
        self.unplug()
        self._folder.cleanup()


CONVERTERS = {"hx711": 80, "ads1220": 330, "nau7802": 320}  # converters that the sketch knows, with their rates [Hz]
STOP_PIN, LOW_PIN, HIGH_PIN = 6, 7, 8  # pins of the stop button's contact and of the limit switches, as in the sketch
LOOP_TIME = 20  # time that a turn of the sketch's loop takes [us], assumed
_FLAGS = ("-O2", "-shared", "-fPIC", "-x", "c++")
_DRAINED = 4096  # bytes at a time


class Firmware:
    """Board that runs the sketch.

    Each object is a board of its own, just switched on. ``converter`` is of :data:`CONVERTERS`. Raise RigError if the
    sketch cannot be compiled here; ValueError if there is no such converter.
    """

    def __init__(self, converter: str = "hx711") -> None:
        self._board = _loaded(compiled(converter))
        self.converting(CONVERTERS[converter])

    def advance(self, microseconds: int = 1000) -> None:
        """Let so much time pass."""
        self._board.board_advance(microseconds, LOOP_TIME)

    def feed(self, line: bytes) -> None:
        """Give the board bytes on its serial line."""
        self._board.board_feed(line, len(line))

    def drain(self) -> bytes:
        """Return the board's bytes since the last call."""
        buffer = ctypes.create_string_buffer(_DRAINED)
        size = self._board.board_drain(buffer, _DRAINED)
        return buffer.raw[:size]

    def weigh(self, counts: int) -> None:
        """Let the next conversions read so many counts."""
        self._board.board_weigh(max(min(counts, 8388607), -8388608))

    def converting(self, rate: float, *, silent: bool = False) -> None:
        """Let the converter make ``rate`` readings a second [Hz], or none."""
        self._board.board_converter(round(1e6 / rate), int(silent))

    def open_pin(self, pin: int, is_open: bool = True) -> None:
        """Open or close a contact to ground."""
        self._board.board_set_pin(pin, int(is_open))

    def block(self, blocked: bool) -> None:
        """Block the motor against pulses, or let it follow again."""
        self._board.board_block(int(blocked))

    @property
    def powered(self) -> bool:
        """True if the stepper's driver is enabled."""
        return not self._board.board_pin(5)

    @property
    def steps(self) -> int:
        """Steps that the motor has made, forward less backward."""
        return int(self._board.board_steps())


def compiled(converter: str) -> Path:
    """Return the sketch's library with this converter, compiled on first use.

    Raise RigError if there is no C++ compiler, or it fails; ValueError if there is no such converter.
    """
    one_of("converter", converter, CONVERTERS)
    folder = resources.path("firmware")
    sources = [folder / "cutenv_board" / "cutenv_board.ino", folder / "host" / "hardware.cpp"]
    read = [*sources, *sorted(folder.glob("*/*.h"))]
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in read) + converter.encode()).hexdigest()[:16]
    cache = Path(tempfile.gettempdir()) / f"cutenv-firmware-{os.getuid()}"
    cache.mkdir(mode=0o700, exist_ok=True)
    if cache.stat().st_uid != os.getuid():
        raise RigError(f"{cache} belongs to somebody else: remove it, or set TMPDIR.")
    library = cache / f"{converter}-{digest}.so"
    if library.exists():
        return library
    compiler = next((found for name in ("c++", "g++", "clang++") if (found := shutil.which(name))), None)
    if compiler is None:
        raise RigError(
            "the emulated serial rig is its board's own sketch, compiled here, and there is no C++ compiler. Install "
            "one (Debian and Ubuntu: apt-get install g++)."
        )
    part = library.with_suffix(f".{os.getpid()}")
    command = [compiler, *_FLAGS, f"-DADC_{converter.upper()}", f"-I{folder / 'host'}", *map(str, sources)]
    made = subprocess.run([*command, "-o", str(part)], capture_output=True, text=True, check=False)
    if made.returncode:
        raise RigError(f"{compiler} cannot compile the board's sketch: {made.stderr.strip()[:500]}")
    part.replace(library)
    return library


def _loaded(library: Path) -> ctypes.CDLL:
    """Load a copy of the library, so that each board has its variables."""
    with tempfile.TemporaryDirectory(prefix="cutenv-board-") as folder:
        copy = Path(folder) / library.name
        shutil.copyfile(library, copy)
        board = ctypes.CDLL(str(copy))  # stays loaded when the file is gone
    board.board_advance.argtypes = [ctypes.c_ulong, ctypes.c_ulong]
    board.board_feed.argtypes = board.board_drain.argtypes = [ctypes.c_char_p, ctypes.c_int]
    board.board_converter.argtypes = [ctypes.c_ulong, ctypes.c_int]
    board.board_weigh.argtypes = [ctypes.c_long]
    board.board_set_pin.argtypes = [ctypes.c_int, ctypes.c_int]
    board.board_pin.argtypes = board.board_block.argtypes = [ctypes.c_int]
    board.board_steps.restype = ctypes.c_long
    return board


_BLOCKS = 15  # jogs that the planner holds
_TICK = 0.001  # [s]
_JOG = re.compile(r"\$J=G91G21X(-?\d+\.\d+)F(\d+\.\d+)")
_BANNER = b"Grbl 1.1h ['$' for help]\r\n"


class EmulatedGrbl:
    """Machine whose X axis jogs.

    Run it in a thread of its own. ``rate``, ``acceleration``: settings $110 [mm/min] and $120 [mm/s2]. ``position``,
    ``speed``: machine position [mm], and speed [mm/s]; ``deaf_to_cancel``, ``blocked``: faults: jog cancel is not
    obeyed; the carriage stands though the motor gets pulses; ``state``: state as in its reports; ``cancels``,
    ``runs_out``: jog cancels received, and times [s] at which the queue of jogs ran empty.
    """

    def __init__(self, *, rate: float = 360.0, acceleration: float = 100.0) -> None:
        self.line = EmulatedLine()  # serial line; ``line.port`` is the port to open
        self.settings = {10: 1.0, 13: 0.0, 20: 0.0, 21: 1.0, 100: 400.0, 110: rate, 120: acceleration}
        self.position = self.speed = 0.0
        self.deaf_to_cancel = self.blocked = False
        self._slipped = 0.0  # [mm] of pulses that a blocked carriage did not follow
        self.cancels = self.runs_out = 0
        self.stopped = threading.Event()  # set it to end :meth:`run`
        self.jogs_read = 0  # jogs that it has taken
        self._way = 1.0
        self._blocks: deque[list[float]] = deque()  # way left [mm], feed [mm/s]
        self.state, self._cancelling = "Idle", False
        self._shift = 0.0  # G92 [mm]
        self._text = ""

    def run(self) -> None:
        """Advance by a millisecond every millisecond."""
        due = time.monotonic()
        while not self.stopped.is_set():
            due += _TICK
            self.step(due)
            if (left := due - time.monotonic()) > 0.0:
                time.sleep(left)

    def step(self, due: float) -> None:
        """Advance by one millisecond, that of time ``due`` [s]."""
        out = b"".join(self._realtime(byte) for byte in self.line.heard())
        while "\n" in self._text and len(self._blocks) < _BLOCKS:
            text, _, self._text = self._text.partition("\n")
            out += self._obey(text.strip())
        self._move()
        self.line.say(out, due)

    @property
    def carriage(self) -> float:
        """Position of the carriage [mm], without pulses missed while blocked."""
        return self.position - self._slipped

    def set_zero(self) -> None:
        """Set the clamp's coordinate here, as ``cutenv rig zero`` does."""
        self._shift = self.position - MARK

    def feed_hold(self) -> None:
        """Slow down and drop jogs, as by the feed-hold button."""
        self._cancelling = bool(self._blocks)

    def alarm(self, number: int) -> None:
        """Stop at once and lose the position, by limit (1) or reset (3)."""
        self._blocks.clear()
        self.speed, self.state, self._cancelling = 0.0, "Alarm", False
        self.line.say(b"ALARM:%d\r\n" % number, time.monotonic())

    def reset(self) -> None:
        """Restart by soft reset, without jogs or shifted coordinates."""
        moved = self.speed != 0.0
        self._blocks.clear()
        self._text, self.speed, self._shift, self._cancelling = "", 0.0, 0.0, False
        self.state = "Alarm" if moved else "Idle"
        self.line.say((b"ALARM:3\r\n" if moved else b"") + b"\r\n" + _BANNER, time.monotonic())

    def _realtime(self, byte: int) -> bytes:
        one = bytes([byte])
        if one == STATUS:
            feed = 60.0 * abs(self.speed)
            return b"<%s|MPos:%.3f,0.000,0.000|FS:%d,0>\r\n" % (self.state.encode(), self.position, round(feed))
        if one == JOG_CANCEL:
            self._cancelling = bool(self._blocks) and not self.deaf_to_cancel
            self.cancels += 1
        elif one == SOFT_RESET:
            self.reset()
        elif byte < 0x80:
            self._text += chr(byte)
        return b""

    def _obey(self, text: str) -> bytes:
        if (jog := _JOG.fullmatch(text)) is not None:
            if self.state not in ("Idle", "Jog"):
                return b"error:9\r\n"
            if self._cancelling:
                return b"ok\r\n"  # flushed
            way, feed = float(jog[1]), float(jog[2]) / 60.0
            self._blocks.append([abs(way), min(feed, self.settings[110] / 60.0)])
            self._way, self.state = math.copysign(1.0, way), "Jog"
            self.jogs_read += 1
            return b"ok\r\n"
        if text == "$I":
            return b"[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\nok\r\n"
        if text == "$$":
            return b"".join(b"$%d=%.3f\r\n" % pair for pair in self.settings.items()) + b"ok\r\n"
        if text == "$#":
            return b"[G54:0.000,0.000,0.000]\r\n[G92:%.3f,0.000,0.000]\r\nok\r\n" % self._shift
        if text.startswith("G92X"):
            self._shift = self.position - float(text[4:])
            return b"ok\r\n"
        if text == "$X":
            self.state = "Idle"
            return b"[MSG:Caution: Unlocked]\r\nok\r\n"
        return b"ok\r\n" if not text else b"error:1\r\n"

    def _move(self) -> None:
        if not self._blocks:
            return
        left, feed = sum(block[0] for block in self._blocks), self._blocks[0][1]
        acceleration = self.settings[120]
        wanted = 0.0 if self._cancelling else min(feed, math.sqrt(2.0 * acceleration * left))
        change = min(max(wanted - abs(self.speed), -acceleration * _TICK), acceleration * _TICK)
        speed = max(abs(self.speed) + change, 0.0)
        way = moved = min(speed * _TICK, left)
        self.position += self._way * way
        self.speed = self._way * speed
        while self._blocks and way >= self._blocks[0][0] - 1e-9:
            way -= self._blocks.popleft()[0]
        if self._blocks:
            self._blocks[0][0] -= max(way, 0.0)
        if self.blocked:
            self._slipped += self._way * moved
        if not self._blocks or (self._cancelling and speed == 0.0):
            self.runs_out += not self._cancelling
            self._blocks.clear()
            self.speed, self.state, self._cancelling = 0.0, "Idle", False

    def close(self) -> None:
        """Remove the port; may be called twice."""
        self.stopped.set()
        self.line.close()
