"""Record on disk that grows during the cut.

It stays readable whatever happens to the process.
"""

from __future__ import annotations

import itertools
import os
import shutil
import threading
from collections.abc import Iterable, Mapping
from operator import itemgetter
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, Protocol, Self

from cutenv._base.arrays import Array, StructArray
from cutenv._base.output import atomic_write
from cutenv._base.validation import in_range, one_of
from cutenv.records.csv_file import head_text
from cutenv.records.provenance import check_operator
from cutenv.records.schema import RecordError, header_of
from cutenv.sim.trace import CHANNELS, Reading, limits

SYNCED_EVERY = 0.8  # time between two flushes to the disk [s]: with the duration of a flush, a second
_PATIENCE = 5.0  # [s] with a disk that does not respond


class RecordingFailed(OSError):
    """Error for a disk that takes no more of a record, which stays readable."""


class AppendingRecord:
    """One cut as a growing CSV file that :func:`cutenv.records.load` reads.

    Rows are with the operating system when :meth:`append` returns, so that an end of this process loses none, and a
    thread flushes them to the disk within a second, so that a power cut loses no more; the caller never waits for the
    disk. :meth:`close` writes the number of rows and the last metadata at the top: then the file is an ordinary record.
    Until then, and if that never happens, loading gives all complete lines, with ``truncated: true`` in the metadata.

    Parameters
    ----------
    path : path
        Must end in ``.csv``, and not exist yet.
    metadata : mapping, optional
        Metadata known at the beginning, in JSON's types.
    fields : sequence of str
        Fields of a :class:`cutenv.sim.trace.Reading`, including time and force; every reading must hold them all.
    force_unit : {"N", "1"}
        Unit of the force, as in a :class:`cutenv.sim.trace.Trace`.
    channels : sequence of str
        Further fields of the trace, of :data:`cutenv.sim.trace.CHANNELS`, which :meth:`append` is given with the
        readings.

    Attributes
    ----------
    rows : int
        Number of rows appended so far.
    failed : str or None
        Reason why the disk accepts no more, or None; also set by the thread, and raised by the next :meth:`append`.

    Raises
    ------
    RecordError
        If the suffix is not ``.csv``.
    TypeError, ValueError
        If JSON cannot hold the metadata, they name an operator who is not anonymous, or fields are unknown or missing.
    FileExistsError
        If such a file exists already.
    OSError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> from cutenv.records import load_one
    >>> path = Path(tempfile.mkdtemp()) / "cut.csv"
    >>> with AppendingRecord(path, {"rig": "bench 2"}, fields=("time", "force")) as record:
    ...     record.append([Reading(0.0, 0.0), Reading(0.001, 0.05)])
    ...     trace_so_far = load_one(path)
    ...     record.close({"end": "finished"})
    >>> dict(trace_so_far.metadata)
    {'rig': 'bench 2', 'truncated': True}
    >>> dict(load_one(path).metadata)
    {'rig': 'bench 2', 'end': 'finished'}
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        metadata: Mapping[str, Any] | None = None,
        *,
        fields: Iterable[str] = Reading._fields,
        force_unit: str = "N",
        channels: Iterable[str] = (),
    ) -> None:
        self.path = Path(path)
        self.rows = 0
        self.failed: str | None = None
        if self.path.suffix != ".csv":
            raise RecordError(self.path, "a record that grows is a CSV file. Give it the suffix .csv.")
        self._fields = tuple(one_of("field", name, Reading._fields) for name in dict.fromkeys(fields))
        if missing := [name for name in ("time", "force") if name not in self._fields]:
            raise ValueError(f"fields must hold time and force; {' and '.join(missing)} is missing. Add it.")
        self._picked = itemgetter(*map(Reading._fields.index, self._fields))
        self._channels = tuple(one_of("channels", name, CHANNELS) for name in dict.fromkeys(channels))
        self._limits = tuple(limits(name, force_unit) for name in (*self._fields, *self._channels))
        self._names = [header_of(name, force_unit) for name in (*self._fields, *self._channels)]
        self._last = -float("inf")
        self._metadata = dict(metadata or {})
        self._head = self._head_with(None, self._metadata)
        self._file = self.path.open("xb", buffering=0)
        self._closed = False
        self._process = os.getpid()
        self._unsynced = True
        self._stop = threading.Event()
        self._flusher = threading.Thread(target=self._keep_synced, name=f"record {self.path.name}", daemon=True)
        self._flusher.start()
        try:
            self._write(self._head)
        except RecordingFailed:
            self.abandon()
            raise

    def append(self, readings: Iterable[Reading], channels: Iterable[tuple[float, ...]] | None = None) -> None:
        """Write readings, all or none, from one thread at a time.

        Parameters
        ----------
        readings : iterable of Reading
            In order of time.
        channels : iterable of tuple of float, optional
            For each reading the values of the fields named at the beginning as ``beside``, in that order.

        Raises
        ------
        TypeError, ValueError
            If a reading lacks a field, leaves the range of a :class:`cutenv.sim.trace.Trace`, or is not after the one
            before: the file could not be loaded any more.  The record goes on without these readings.
        RecordingFailed
            If the disk accepts no more, now or since the last call; it is not tried again.
        """
        if self._closed:
            raise ValueError(f"{self.path} is closed. Begin another record.")
        if os.getpid() != self._process:
            raise ValueError(f"{self.path} belongs to process {self._process}, of which this is a fork.")
        if self.failed is not None:
            raise RecordingFailed(self.failed)
        last, lines = self._last, []
        more = itertools.repeat(()) if channels is None else channels
        for reading, others in zip(readings, more, strict=channels is not None):
            row = self._picked(reading) + tuple(others)
            try:
                fits = all(low <= value <= high for value, (low, high) in zip(row, self._limits, strict=True))
            except TypeError:
                fits = False
            except ValueError:
                raise ValueError(
                    f"a row has {len(row)} values for {', '.join(self._names)}. Give one of each."
                ) from None
            if not (fits and last < reading.time):  # false for NaN
                self._refuse(row, reading.time, last)
            last = reading.time
            lines.append(",".join(map(repr, map(float, row))) + "\n")
        self._write("".join(lines).encode("ascii"))
        self._last = last
        self.rows += len(lines)

    def close(self, metadata: Mapping[str, Any] | None = None) -> None:
        """Finish the record, with row count and more metadata.

        Further calls do nothing, nor does a call in a fork of the process that has begun it. The file is replaced as a
        whole or not at all, so that a failed finish leaves what was appended.

        Parameters
        ----------
        metadata : mapping, optional
            Metadata that extend or replace those of the beginning, such as the cause of the end.

        Raises
        ------
        TypeError, ValueError
            If JSON cannot hold the metadata or they name an operator who is not anonymous; the record stays open.
        RecordingFailed
            If the disk did not accept all of it; the file stays as it is, truncated.
        """
        if self._closed or os.getpid() != self._process:
            return
        head = self._head_with(self.rows, {**self._metadata, **(metadata or {})})
        self.abandon()
        if self.failed is None:
            try:
                with atomic_write(self.path) as part, self.path.open("rb") as grown, part.open("xb") as finished:
                    finished.write(head)
                    grown.seek(len(self._head))
                    shutil.copyfileobj(grown, finished)
            except OSError as error:
                self._fail(error)
        if self.failed is not None:
            raise RecordingFailed(self.failed)

    def abandon(self) -> None:
        """Leave the record truncated; never raises, further calls do nothing."""
        if self._closed or os.getpid() != self._process:
            return
        self._closed = True
        self._stop.set()
        self._flusher.join(_PATIENCE)
        if self._flusher.is_alive():  # it still holds the file
            self._fail(TimeoutError(f"no answer within {_PATIENCE:g} s"))
            return
        try:
            self._file.close()
        except OSError as error:
            self._fail(error)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
        else:
            self.abandon()

    def _head_with(self, rows: int | None, metadata: Mapping[str, Any]) -> bytes:
        if "operator" in metadata:
            check_operator(metadata["operator"])
        try:
            return head_text(self._names, rows, {"metadata": metadata}).encode("ascii")
        except (TypeError, ValueError) as error:
            raise type(error)(
                f"metadata are not what JSON can hold ({error}). Give text, finite numbers, booleans, None, lists or "
                "dicts of these."
            ) from None

    def _refuse(self, row: tuple[float, ...], time: float, last: float) -> NoReturn:
        """Raise an error that describes a reading's fault."""
        for name, value, (low, high) in zip(self._names, row, self._limits, strict=True):
            in_range(name, value, low, high, "1", "The reading was not recorded.")
        raise ValueError(f"time goes from {last!r} s to {time!r} s; a reading must be after the one before.")

    def _write(self, data: bytes) -> None:
        left = memoryview(data)
        try:
            while left:  # a disk that is nearly full accepts a part
                left = left[self._file.write(left) :]
        except OSError as error:
            self._fail(error)
            raise RecordingFailed(self.failed) from None
        self._unsynced = True

    def _keep_synced(self) -> None:
        """Flush written rows to the disk, as a thread."""
        while not self._stop.wait(SYNCED_EVERY) and self.failed is None:
            if not self._unsynced:
                continue
            self._unsynced = False
            try:
                if os.fstat(self._file.fileno()).st_nlink == 0:
                    raise FileNotFoundError("the file was deleted")
                os.fsync(self._file.fileno())
            except OSError as error:
                self._fail(error)

    def _fail(self, error: OSError) -> None:
        if self.failed is None:
            why = error.strerror or error
            if self._there():
                kept = f"the {self.rows} readings before, as far as it has them, can be loaded"
            else:
                kept = f"it is not there any more, nor are the {self.rows} readings before, unless somebody moved it"
            self.failed = (
                f"{self.path}: the disk takes no more of the record ({why}); {kept}. Make room or mend it, and record "
                "the next cut."
            )

    def _there(self) -> bool:
        """Return whether the file still has its name."""
        try:
            return os.path.samestat(os.fstat(self._file.fileno()), self.path.stat())
        except (OSError, ValueError):  # ValueError: it is closed
            return self._file.closed and self.path.exists()


class CutListener(Protocol):
    """Listener to cuts in progress, which must not wait or raise."""

    def began(self, name: str) -> None:
        """Take the beginning of a cut."""
        ...

    def readings(self, readings: StructArray, depth: Array, origin: float) -> None:
        """Take new readings, depths [m], and the origin by ``time.monotonic()`` [s]."""
        ...

    def ended(self, cause: str) -> None:
        """Take the end of a cut and its cause."""
        ...
