"""Calibration of an analogue six-axis sensor: matrix from voltages to loads, cross-talk included, and converter.

A file, in TOML, holds what the sensor's maker or a bench of weights has found.
"""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cutenv._base import resources
from cutenv._base.arrays import Array
from cutenv._base.validation import in_range, one_of

COMPONENTS_OF_LOAD = ("force_x", "force_y", "force_z", "torque_x", "torque_y", "torque_z")
"""Components of a load, in the order of the matrix's rows: [N], [N m]."""
SHIPPED_CALIBRATION = "jr3_85m35a_i40"
"""Name of the calibration that comes with cutenv; its resolution is measured, its cross-talk assumed."""
_KEYS = ("name", "serial", "date", "range_V", "bits", "force_N_per_V", "torque_N_m_per_V")
_WORST_CONDITION = 1e4  # of the matrix with rows scaled alike: six loads that voltages hardly tell apart


@dataclass(frozen=True, eq=False)
class AnalogueCalibration:
    """Sensor with six analogue channels, and the converter that reads them.

    Attributes
    ----------
    name, serial, date : str
        Kind and number of the sensor, and the day of its calibration.
    range : float
        Greatest voltage of the converter, either way [V].
    bits : int
        Bits of the converter over the whole range.
    matrix : array, shape (6, 6)
        Loads over voltages: rows are :data:`COMPONENTS_OF_LOAD` [N/V], [N m/V], columns the channels.
    """

    name: str
    serial: str
    date: str
    range: float
    bits: int
    matrix: Array

    def __post_init__(self) -> None:
        in_range("range_V", self.range, 0.01, 100.0, "V", "Give the converter's greatest voltage.")
        in_range("bits", self.bits, 8, 24, "1", "Converters have 8 to 24 bits.")
        matrix = np.array(self.matrix, dtype=float)
        if matrix.shape != (6, 6) or not np.isfinite(matrix).all():
            raise ValueError(
                f"the matrix must be 3 rows of force_N_per_V and 3 of torque_N_m_per_V, each of 6 numbers; got an "
                f"array of shape {matrix.shape}."
            )
        largest = np.abs(matrix).max(axis=1, keepdims=True)
        if np.any(largest == 0.0) or np.linalg.cond(matrix / largest) > _WORST_CONDITION:
            raise ValueError(
                "the matrix is singular, or nearly: its six channels do not tell six loads apart. Copy it again, rows "
                "for loads and columns for channels."
            )
        object.__setattr__(self, "matrix", matrix)

    @classmethod
    def read(cls, path: str | Path) -> AnalogueCalibration:
        """Read a calibration's file, or the shipped one by its name.

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        ValueError
            If it is no TOML, or a key is unknown, missing or not valid; names file and key.
        """
        file = resources.path(f"sensors/{SHIPPED_CALIBRATION}.toml") if str(path) == SHIPPED_CALIBRATION else Path(path)
        try:
            told = tomllib.loads(file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise FileNotFoundError(
                f"{path}: no such file. Give a calibration as TOML, see the page Wiring and configuration, or the "
                f"shipped {SHIPPED_CALIBRATION!r}."
            ) from None
        except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
            raise ValueError(f"{path}: it is not TOML: {error}.") from None
        try:
            return cls._of(told)
        except (TypeError, ValueError) as error:
            raise ValueError(f"{path}: {error}") from None

    @classmethod
    def _of(cls, told: dict[str, Any]) -> AnalogueCalibration:
        for key in told:
            one_of("key", key, _KEYS)
        missing = [key for key in _KEYS if key not in told]
        if missing:
            raise ValueError(f"it lacks {', '.join(missing)}.")
        rows = [_rows(key, told[key]) for key in ("force_N_per_V", "torque_N_m_per_V")]
        texts = {key: told[key] for key in ("name", "serial", "date")}
        for key, text in texts.items():
            if not isinstance(text, str):
                raise ValueError(f"{key} must be a text in quotation marks, got {text!r}.")
        if type(told["bits"]) is not int:
            raise ValueError(f"bits must be a whole number, got {told['bits']!r}.")
        reach = in_range("range_V", told["range_V"], 0.01, 100.0, "V", "Give the converter's greatest voltage.")
        return cls(range=reach, bits=told["bits"], matrix=np.array(rows[0] + rows[1]), **texts)

    @property
    def count(self) -> float:
        """Voltage of one count [V]."""
        return 2.0 * self.range / float(2**self.bits)

    @property
    def resolution(self) -> Array:
        """Load of one count of the channel that tells most of it, shape (6,) [N], [N m]."""
        found: Array = self.count * np.abs(self.matrix).max(axis=1)
        return found

    @property
    def full_scale(self) -> Array:
        """Greatest load of each axis alone that keeps every channel within the converter, shape (6,) [N], [N m]."""
        found: Array = self.range / np.abs(np.linalg.inv(self.matrix)).max(axis=0)
        return found

    def loads(self, counts: Array) -> Array:
        """Return loads [N], [N m] from counts, shape (..., 6) both."""
        found: Array = (np.asarray(counts, dtype=float) * self.count) @ self.matrix.T
        return found

    def counts(self, loads: Array) -> Array:
        """Return the counts of whole numbers that the converter gives under loads [N], [N m], shape (..., 6) both."""
        volts = np.asarray(loads, dtype=float) @ np.linalg.inv(self.matrix).T
        return self.counts_of_volts(volts)

    def counts_of_volts(self, volts: Array) -> Array:
        """Return the counts of voltages [V], of the same shape; beyond the range, the last count."""
        most = 2 ** (self.bits - 1)
        found: Array = np.clip(np.rint(np.asarray(volts, dtype=float) / self.count), -most, most - 1)
        return found

    def saturated(self, counts: Array) -> Array:
        """Return which readings have a channel at an end of the converter, shape (n,), from counts, shape (n, 6)."""
        most = 2 ** (self.bits - 1)
        found: Array = ((counts <= -most) | (counts >= most - 1)).any(axis=-1)
        return found


def _rows(key: str, told: Any) -> list[list[float]]:
    whole = isinstance(told, list) and len(told) == 3 and all(isinstance(row, list) and len(row) == 6 for row in told)
    if not whole:
        raise ValueError(f"{key} must be three rows of six numbers, one for each channel.")
    return [
        [in_range(f"{key}[{i}][{j}]", number, -1e6, 1e6, "1/V", "Give a number.") for j, number in enumerate(row)]
        for i, row in enumerate(told)
    ]
