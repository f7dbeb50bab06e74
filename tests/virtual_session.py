"""Sessions on the virtual rig of ``calibrate_virtual_rig``: small, of tissue that is known, cut once."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Sequence
from typing import Any

import numpy as np

from cutenv.records.measurement import MeasuredCut, measure_cuts
from cutenv.sim.tissue import CutModel, Specimen, TissueDescription, measured_liver
from cutenv.sim.trace import Trace
from scripts.validation.measurement import calibrate_virtual_rig as rig

MODEL = CutModel()
SPEEDS = (0.0064, 0.0127, 0.0254)
"""Of the small sessions [m/s]: the slow ones take most of the readings."""
EVEN = {
    "modulus_between_liver_cv": 0.0, "modulus_between_cut_cv": 0.0, "modulus_within_cut_cv": 0.0,
    "fracture_between_cut_cv": 0.0, "fracture_within_cut_cv": 0.0, "inclined_between_cut_cv": 0.0,
}  # fmt: skip
"""Changes to a tissue that leave it no spread: what comes out then owes nothing to chance."""


def tissue_with(**changes: Any) -> TissueDescription:
    """Pig liver with some fields replaced."""
    return dataclasses.replace(measured_liver(), **changes)


def session(
    livers: int = 3, seed: int = 5, speeds: Sequence[float] = SPEEDS, **changes: Any
) -> list[tuple[Trace, Specimen]]:
    """Records of ``livers`` at both angles and some speeds, with the way back, and what was cut."""
    return list(_session(livers, seed, tuple(speeds), tuple(sorted(changes.items()))))


def measured(
    livers: int = 3, seed: int = 5, speeds: Sequence[float] = SPEEDS, **changes: Any
) -> list[tuple[MeasuredCut, Specimen]]:
    """The same, measured together; a cut keeps its specimen."""
    return list(_measured(livers, seed, tuple(speeds), tuple(sorted(changes.items()))))


def cuts(**options: Any) -> list[MeasuredCut]:
    """Only what was measured."""
    return [cut for cut, _ in measured(**options)]


def silent(cut: MeasuredCut) -> MeasuredCut:
    """The same cut, as if none of its loading segments had been steady."""
    none = np.empty(0)
    return dataclasses.replace(cut, moduli=dataclasses.replace(cut.moduli, position=none, modulus=none, segments=[]))


def traces(**options: Any) -> list[Trace]:
    """Only the records."""
    return [trace for trace, _ in session(**options)]


@functools.cache
def _session(
    livers: int, seed: int, speeds: tuple[float, ...], changes: tuple[tuple[str, Any], ...]
) -> tuple[tuple[Trace, Specimen], ...]:
    return tuple(rig.session(tissue_with(**dict(changes)), livers, seed, speeds))


@functools.cache
def _measured(
    livers: int, seed: int, speeds: tuple[float, ...], changes: tuple[tuple[str, Any], ...]
) -> tuple[tuple[MeasuredCut, Specimen], ...]:
    made = _session(livers, seed, speeds, changes)
    found, refused = measure_cuts([trace for trace, _ in made], MODEL)
    assert refused == []
    return tuple(zip(found, (specimen for _, specimen in made), strict=True))
