"""Motions of a blade.

A motion is what a further axis, downwards or to the side, adds to the law of a straight cut.

A :class:`Motion` declares a record of each cut and the functions, its hooks, that the law calls within an update.  The
straight cut is the motion without hooks.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from cutenv._base.arrays import Struct, StructArray
from cutenv._engine.declared import Declaration
from cutenv.sim.cutting.dtypes import DRIVE, LAW, PROFILE, STATE
from cutenv.sim.cutting.row import ONE, LaneViews, count_scalars, lane_dtype
from cutenv.sim.cutting.sensor import SENSOR

NOTHING: np.dtype[Any] = np.dtype((np.record, [("nothing", "i8")]))  # record of what a motion does not need


class Moving(NamedTuple):
    """Motions of the cuts in a row."""

    lanes: Struct  # scalars of the records and scratch, for each lane
    views: LaneViews
    records: StructArray  # records of all cuts, shape (n,)
    shared: StructArray  # record that all cuts share, shape (1,)


@dataclass(frozen=True, kw_only=True, eq=False)
class Motion(Declaration):
    """Motion of the blade, declared by hooks that :func:`~cutenv._engine.jit.njit_inline` compiles.

    Unless said otherwise, a hook takes a row of cuts (:data:`~cutenv.sim.cutting.row.ROW`), its :class:`Moving`, the
    cuts' profiles and the duration of the update [s].  One that is None is not called.
    """

    place: str  # module and name of this object, "package.module:NAME"
    record: np.dtype[Any] = NOTHING  # record of each cut: scalars, which a row gathers, then arrays
    scratch: tuple[tuple[str, str], ...] = ()  # fields that live only in a row
    shared: np.dtype[Any] = NOTHING  # record that all cuts share

    # Give a lane its command of the further axis; takes lanes, number of the lane, command.
    command: Callable[..., None] | None = None
    drive: Callable[..., None] | None = None  # advance the drive of the further axis
    aim: Callable[..., None] | None = None  # reduce the motion to that along the crack, before the tissue is loaded
    move: Callable[..., None] | None = None  # move the blade by what the law has not seen, after the tissue is loaded
    renew: Callable[..., None] | None = None  # bring the profiles up to date where tip and blade come to another point
    renew_runs: Callable[..., None] | None = None  # bring the profiles up to date where cracks are about to run
    across: Callable[..., tuple[float, float]] | None = None
    """Return the bristles' deflection across the cut, and the blade's motion across it in this update [m]; takes lanes
    and number of the lane.  With None the blade has no friction across."""
    rub: Callable[..., None] | None = None
    """Take the bristles' new deflection across the cut [m], and the friction that they exert there [N]; takes lanes,
    number of the lane, deflection, force."""
    # Let the tissue respond to the motion, and change ``row.force``, that of tissue and friction along the cut.
    respond: Callable[..., None] | None = None
    # Return the force on the blade across the cut [N]; takes lanes and number of the lane.
    force: Callable[..., float] | None = None
    pull: Callable[..., float] | None = None
    """Return the part along the cut of the force on a blade that is turned from it, from lanes, number of the lane and
    the force along the blade [N]; None: that force."""
    # Return the energy that is stored besides that of the law [J]; takes the record of a cut.
    stored: Callable[..., float] | None = None
    # Lead the further axis of a row of one to a wanted place; return the blade's position [m].
    lead: Callable[..., float] | None = None
    stops_at_ends: bool = False  # True: a blade that is led beyond the specimen stops there; False: that is an error

    @property
    def scalars(self) -> Any:
        """Number of scalars in a row, a compile-time constant."""
        return np.int64(count_scalars(self.record))

    def lanes(self, count: int) -> np.dtype[Any]:
        """Return the structured dtype of ``count`` lanes."""
        return lane_dtype(self.record, self.scratch, count)

    @cached_property
    def cut(self) -> np.dtype[Any]:
        """Return the dtype of a cut as one record."""
        parts = {
            "states": STATE, "profiles": PROFILE, "laws": LAW, "drives": DRIVE, "sensors": SENSOR,
            "motions": self.record,
            "rows": ONE, "lanes": self.lanes(1),  # memory of the calls
        }  # fmt: skip
        return np.dtype((np.record, [(name, kind, (1,)) for name, kind in parts.items()]))


STRAIGHT = Motion(place=f"{__name__}:STRAIGHT")  # motion along the cut alone
