"""Sketch of the board, compiled for this computer with a stand-in for its hardware, and run by hand-moved time."""

from __future__ import annotations

import ctypes
import hashlib
import os
import shutil
import subprocess
import tempfile
from pathlib import Path

from cutenv._base import resources
from cutenv._base.validation import one_of
from cutenv.rig.errors import RigError

CONVERTERS = {"hx711": 80, "ads1220": 330, "nau7802": 320}
"""Converters that the sketch knows, with their rates [Hz]."""
STOP_PIN, LOW_PIN, HIGH_PIN = 6, 7, 8
"""Pins of the stop button's contact and of the limit switches, as in the sketch."""
LOOP_TIME = 20
"""Time that a turn of the sketch's loop takes [us], assumed."""
_FLAGS = ("-O2", "-shared", "-fPIC", "-x", "c++")
_DRAINED = 4096  # bytes at a time


class Firmware:
    """Board that runs the sketch; each object is a board of its own, just switched on.

    Parameters
    ----------
    converter : str
        Converter of the load cell, of :data:`CONVERTERS`.

    Raises
    ------
    RigError
        If the sketch cannot be compiled here.
    ValueError
        If there is no such converter.
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
        """Return the bytes that the board has sent since the last call."""
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
        """Let the motor stand though it gets pulses, or follow them again."""
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
    """Return the library of the sketch with this converter, compiled on the first call on a machine.

    Raises
    ------
    RigError
        If there is no C++ compiler, or it fails.
    ValueError
        If there is no such converter.
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
    """Load a copy of the library: the sketch has global variables, and each board its own."""
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
