"""Tracks of beads in the tissue: the place of each over time, in three dimensions, with its uncertainty."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.atomic_file import atomic_write

TRACKS_SCHEMA = "cutenv.bead_tracks/1"
"""Name and version of the file's columns."""
TRACK_COLUMNS = ("bead", "time_s", "x_m", "y_m", "z_m", "xx_m2", "xy_m2", "xz_m2", "yy_m2", "yz_m2", "zz_m2")
"""Columns of the file: number of the bead, time, place in the specimen's frame, upper triangle of its covariance."""
_KEY, _METADATA = b"cutenv_schema", b"cutenv_metadata"
_UPPER = np.triu_indices(3)


@dataclass(frozen=True, kw_only=True, eq=False)
class BeadTracks:
    """Places of beads over time, one row for each bead in each frame in which it was located.

    Parameters
    ----------
    bead : ndarray of int64, shape (n,)
        Number of the bead.
    time : ndarray, shape (n,)
        Time on the clock of the force record [s].
    place : ndarray, shape (n, 3)
        Place in the specimen's frame [m]: across the cut line, along it from the clamp, up from the plate.
    covariance : ndarray, shape (n, 3, 3)
        Covariance of each place [m²].
    metadata : mapping
        What else is known of the tracks, as JSON: calibration, residuals.

    Raises
    ------
    ValueError
        If shapes disagree, a number is not finite, or a bead has two places at one time.
    """

    bead: NDArray[np.int64]
    time: NDArray[np.float64]
    place: NDArray[np.float64]
    covariance: NDArray[np.float64]
    metadata: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        n = len(self.bead)
        for name, shape in {"bead": (n,), "time": (n,), "place": (n, 3), "covariance": (n, 3, 3)}.items():
            kind = np.int64 if name == "bead" else np.float64
            values = np.array(getattr(self, name), kind)
            if values.shape != shape:
                raise ValueError(f"{name} has shape {values.shape}, but there are {n} rows: give {shape}.")
            if not np.isfinite(values).all():
                row = int(np.argmin(np.isfinite(values).reshape(n, -1).all(axis=1)))
                raise ValueError(f"{name} is not finite in row {row}: leave out what was not located.")
            values.setflags(write=False)
            object.__setattr__(self, name, values)
        pairs = np.stack([self.bead, self.time], axis=1)
        if len(np.unique(pairs, axis=0)) < n:
            raise ValueError("a bead has two places at the same time: give one row for each bead and time.")

    @property
    def beads(self) -> list[int]:
        """Numbers of the beads, ascending."""
        return [int(bead) for bead in np.unique(self.bead)]

    def of(self, bead: int) -> BeadTracks:
        """Return the rows of one bead in order of time.

        Raises
        ------
        KeyError
            If there is no such bead.
        """
        rows = np.flatnonzero(self.bead == bead)
        if rows.size == 0:
            raise KeyError(f"there is no bead {bead}; there are {self.beads}.")
        rows = rows[np.argsort(self.time[rows])]
        return BeadTracks(
            bead=self.bead[rows],
            time=self.time[rows],
            place=self.place[rows],
            covariance=self.covariance[rows],
            metadata=self.metadata,
        )

    def save(self, path: Path | str) -> None:
        """Write the tracks as Parquet, with :data:`TRACK_COLUMNS`."""
        import pyarrow
        from pyarrow import parquet

        upper = self.covariance[:, *_UPPER]
        values = [self.bead, self.time, *self.place.T, *upper.T]
        table = pyarrow.table(dict(zip(TRACK_COLUMNS, values, strict=True)))
        noted = {_KEY: TRACKS_SCHEMA.encode(), _METADATA: json.dumps(dict(self.metadata)).encode()}
        with atomic_write(Path(path)) as part:
            parquet.write_table(table.replace_schema_metadata(noted), part, write_page_checksum=True)

    @classmethod
    def load(cls, path: Path | str) -> BeadTracks:
        """Read tracks from a Parquet file.

        Raises
        ------
        ValueError
            If it is not such a file, or lacks a column.
        """
        import pyarrow
        from pyarrow import parquet

        try:
            table = parquet.read_table(path, page_checksum_verification=True)
        except FileNotFoundError:
            raise
        except (pyarrow.ArrowException, OSError) as error:
            raise ValueError(f"{path} is not a Parquet file, or it is damaged: {error}") from None
        missing = [name for name in TRACK_COLUMNS if name not in table.column_names]
        if missing:
            raise ValueError(f"{path} lacks the columns {', '.join(missing)}; tracks have {', '.join(TRACK_COLUMNS)}.")
        try:
            column = {name: table[name].to_numpy() for name in TRACK_COLUMNS}
            metadata = json.loads((table.schema.metadata or {}).get(_METADATA, b"{}"))
            covariance = np.empty((len(table), 3, 3))
            for row, across, name in zip(*_UPPER, TRACK_COLUMNS[5:], strict=True):
                covariance[:, row, across] = covariance[:, across, row] = column[name]
            place = np.stack([column[name] for name in TRACK_COLUMNS[2:5]], axis=1)
            return cls(
                bead=column["bead"], time=column["time_s"], place=place, covariance=covariance, metadata=metadata
            )
        except (ValueError, TypeError, pyarrow.ArrowException) as error:
            raise ValueError(f"{path}: {error}") from None
