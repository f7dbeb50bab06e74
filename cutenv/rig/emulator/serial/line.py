"""Serial line of the emulated board: a pseudo-terminal under a name that stays, with what can happen to a cable."""

from __future__ import annotations

import errno
import os
import random
import tempfile
from collections import deque
from pathlib import Path


class EmulatedLine:
    """Pseudo-terminal whose other end is opened as a serial port.

    Attributes
    ----------
    port : str
        Name of the port, a link that leads to the terminal.
    lost_share, damaged_share : float
        Faults: shares of the lines from the board that are lost, and of which a byte is changed.
    delay : float
        Fault: time that lines from the board take longer [s].
    doubled : bool
        Fault: each line from the board comes twice.
    deaf, mute : bool
        Faults: nothing gets to the board; nothing comes from it.
    noise : bool
        Fault: random bytes come from the board, as with another baud rate.
    """

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="cutenv-port-")
        self.port = str(Path(self._folder.name) / "board")
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
        """Put the cable in: a new terminal, under the same name."""
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
        """Pull the cable out: the terminal is gone, and so is its name."""
        if not self.plugged:
            return
        Path(self.port).unlink(missing_ok=True)
        for end in (self._master, self._slave):
            os.close(end)
        self._master = self._slave = -1
        self._late.clear()

    def heard(self) -> bytes:
        """Return the bytes that the computer has sent to the board."""
        if not self.plugged:
            return b""
        try:
            read = os.read(self._master, 4096)
        except OSError as error:
            if error.errno not in (errno.EAGAIN, errno.EIO):
                raise
            return b""
        return b"" if self.deaf else read

    def say(self, sent: bytes, now: float) -> list[bytes]:
        """Send the board's bytes to the computer; return its whole lines, whatever becomes of them on the way."""
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
