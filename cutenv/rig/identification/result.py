"""Result of an identification: each constant with standard error and method, or the reason why it is missing."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import date

import numpy as np

from cutenv._base.arrays import Array
from cutenv._base.parameter import parameter_table
from cutenv.cutting.drive import Rig
from cutenv.cutting.sensor import SensorParameters
from cutenv.rig.config.file_schema import IDENTIFIED, FileKey
from cutenv.rig.config.settings import Identified
from cutenv.rig.identification.motion_plan import Plan
from cutenv.rig.identification.recording import Stretch
from cutenv.rig.identification.response import Response, SineCheck

_DIGITS = 2  # of a standard error, to which a value is rounded


@dataclass(frozen=True, kw_only=True)
class IdentifiedValue:
    """Estimate of one constant, under its name in :class:`~cutenv.rig.config.settings.Identified`; SI.

    Attributes
    ----------
    name : str
        Name of the constant.
    value : float or None
        Estimated value; None if it cannot be measured.
    error : float or None
        Standard error.
    how : str
        Method, or the reason why it cannot be measured.
    """

    name: str
    value: float | None
    error: float | None
    how: str

    @property
    def rounded(self) -> float | None:
        """Value rounded to the digits that its standard error justifies."""
        if self.value is None or self.value == 0.0 or not self.error:
            return self.value
        return round(self.value, _DIGITS - 1 - math.floor(math.log10(self.error)))


@dataclass(frozen=True, kw_only=True)
class Identification:
    """Result of one experiment.

    Attributes
    ----------
    plan : Plan
        Moves of the experiment.
    estimates : tuple of Estimate
        Estimates, in the order of the rig's file.
    response : Response
        Response of the axis.
    checks : tuple of SineCheck
        Comparisons with sines that were not used for the fit.
    steps, sines : tuple of Stretch
        Recorded steps and sines, for a figure.
    """

    plan: Plan
    estimates: tuple[IdentifiedValue, ...]
    response: Response
    checks: tuple[SineCheck, ...]
    steps: tuple[Stretch, ...]
    sines: tuple[Stretch, ...]

    def __getitem__(self, name: str) -> IdentifiedValue:
        """Return the estimate of that name."""
        return next(each for each in self.estimates if each.name == name)

    def identified(self, before: Identified, today: date) -> Identified:
        """Return the section for the rig's file: measured values, rounded, and for the rest those known ``before``."""
        found = {each.name: each.rounded for each in self.estimates if each.value is not None}
        return replace(before, date=today.isoformat(), **found)

    def table(self, before: Identified) -> list[str]:
        """Return a table as lines: measured values with standard errors, beside the file's and the simulator's."""
        simulated = {row["name"]: row["default"] for row in parameter_table(Rig, SensorParameters)}
        rows = [("constant", "measured", "std error", "file", "simulator", "how")]
        for key in IDENTIFIED.keys:
            if key.field == "date":
                continue
            each = self[key.field]
            rows.append(
                (
                    f"{key.field} [{key.unit.sign}]",
                    _shown(key, each.rounded) if each.value is not None else "-",
                    "-" if each.error is None else f"{key.from_si(each.error):.2g}",
                    _shown(key, getattr(before, key.field)),
                    _shown(key, simulated.get(key.field)),
                    each.how if each.value is not None else f"not measurable: {each.how}",
                )
            )
        return aligned(rows)

    def drawn_steps(self) -> list[tuple[str, Array, Array, Array]]:
        """Return name, time [s], measured and modelled position [m] of each step, both from 0 on, for a figure."""
        names = [f"{1e3 * each.command[np.abs(each.command).argmax()]:+.3g} mm/s" for each in self.steps]
        return self._drawn(names, self.steps)

    def drawn_sines(self) -> list[tuple[str, Array, Array, Array]]:
        """Return name, time [s], measured and modelled position [m] of each sine, for a figure."""
        return self._drawn([f"{sine.frequency:g} Hz" for sine in self.plan.sines], self.sines)

    def _drawn(self, names: Iterable[str], stretches: Iterable[Stretch]) -> list[tuple[str, Array, Array, Array]]:
        drawn = []
        for name, stretch in zip(names, stretches, strict=True):
            model = self.response.positions(stretch)
            measured = stretch.position - stretch.position[0]
            moved = stretch.command_time[np.flatnonzero(stretch.command)[0]]
            drawn.append((name, stretch.time - moved, measured, model + float(np.mean(measured - model))))
        return drawn

    def sine_table(self) -> list[str]:
        """Return a table as lines: gain and phase of each sine, and the fitted model's errors."""
        rows = [("sine [Hz]", "gain", "phase [deg]", "gain error [%]", "phase error [deg]")]
        for each in self.checks:
            phases = [f"{math.degrees(each.phase):.1f}", f"{math.degrees(each.phase_error):+.1f}"]
            gains = [f"{each.gain:.3f}", f"{100 * each.gain_error:+.1f}"]
            rows.append((f"{each.frequency:g}", gains[0], phases[0], gains[1], phases[1]))
        return aligned(rows)


def _shown(key: FileKey, value: float | None) -> str:
    return "-" if value is None else f"{key.from_si(value):.4g}"


def aligned(rows: Iterable[tuple[str, ...]]) -> list[str]:
    """Return rows of text as lines with aligned columns."""
    rows = list(rows)
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
