"""Supply of specimens: a person's hands, an emulator, or memory."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cutenv.rig.config.depth_profile import measured_depth
from cutenv.rig.config.settings import RigSettings
from cutenv.rig.errors import RigError
from cutenv.rig.operation.operator import Operator
from cutenv.tissue.specimen import Specimen


@dataclass(frozen=True, kw_only=True)
class SpecimenKey:
    """Key of a drawn specimen; hardware cuts whatever is laid, and stores the key as a label."""

    seed: int
    episode: int
    target: float | None = None
    """Length of the cut [m], along which the depth has to be known."""
    specimen: Specimen | None = None
    """Specimen as drawn or given; None if no program has drawn it."""


class SpecimenSource(Protocol):
    """Supply that lays the next specimen, with the blade at the clamp, at rest and without power."""

    def mount(self, key: SpecimenKey) -> NDArray[np.float64] | None:
        """Lay a specimen; return its measured depth of cut, shape (301,) [m], or None if the caller knows it."""
        ...


class SpecimensByHand:
    """Supply by a person, who has measured each specimen's depth by caliper and written it into the rig's file.

    Parameters
    ----------
    profile : callable
        Reads the rig's file again: each specimen has its own depth.
    operator : Operator
        Person who lays the specimen.
    """

    def __init__(self, profile: Callable[[], RigSettings], operator: Operator) -> None:
        self._profile, self._operator = profile, operator

    def mount(self, key: SpecimenKey) -> NDArray[np.float64] | None:
        """Ask for a new specimen; return its depth along the cut, shape (301,) [m].

        Raises
        ------
        RigError
            If the operator does not confirm that it is there, or its depth is not known.
        """
        what = (
            f"The drives are without power. Lay specimen {key.episode + 1}: edge at the clamp, depth_profile in the "
            "rig's file as measured on it; leave the blade where it is. Then take your hands away: the power comes back"
        )
        if not self._operator.ask_ready(what):
            raise RigError("no new specimen was laid: nothing is cut.")
        try:
            return measured_depth(self._profile(), key.target)
        except (OSError, ValueError) as error:
            raise RigError(f"the depth of the specimen is not known: {error}") from error
