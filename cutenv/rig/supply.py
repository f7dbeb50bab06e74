"""Where the next specimen comes from: a person's hands, an emulator, or memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cutenv.rig.depth_profile import depth_along
from cutenv.rig.drivers import RigError
from cutenv.rig.operator import Operator
from cutenv.rig.settings import RigSettings
from cutenv.tissue.specimen import Specimen


@dataclass(frozen=True, kw_only=True)
class SpecimenKey:
    """What tells drawn specimens apart; hardware cuts what it is given, and keeps it as a label."""

    seed: int
    episode: int
    target: float | None = None
    """Length to which it is to be cut [m], which its depth has to be known for."""
    specimen: Specimen | None = None
    """As drawn or given; None for what no program has drawn."""


class Supply(Protocol):
    """Lays the next specimen, with the blade at the clamp, at rest and without power."""

    def lay(self, key: SpecimenKey) -> NDArray[np.float64] | None:
        """Lay it; the depth of cut as measured, shape (301,) [m], or None where the one who asks knows it."""
        ...


class HandSupply:
    """A person lays specimens, and has measured their depth with a caliper into the rig's file.

    Parameters
    ----------
    profile : callable
        Reads the rig's file anew: each specimen has a depth of its own.
    operator : Operator
        Who lays it.
    """

    def __init__(self, profile: Callable[[], RigSettings], operator: Operator) -> None:
        self._profile, self._operator = profile, operator

    def lay(self, key: SpecimenKey) -> NDArray[np.float64] | None:
        """Ask for a new specimen.

        Raises
        ------
        RigError
            If the operator does not say that it is there.
        """
        what = (
            f"The drives are without power. Lay specimen {key.episode + 1}: edge at the clamp, depth_profile in the "
            "rig's file as measured on it; leave the blade where it is. Then take your hands away: the power comes back"
        )
        if not self._operator.ask_ready(what):
            raise RigError("no new specimen was laid: nothing is cut.")
        try:
            return depth_along(self._profile(), key.target)
        except (OSError, ValueError) as error:
            raise RigError(f"the depth of the specimen is not known: {error}") from error
