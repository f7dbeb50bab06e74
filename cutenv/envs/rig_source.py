"""Which rig an environment cuts on: hardware by its file, an emulator of its own, or a fake in memory."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv.cutting.drive import Rig
from cutenv.envs.constants import Constants
from cutenv.rig.drivers import RigError
from cutenv.rig.fake import CutBench, FakeRig, fake_settings
from cutenv.rig.operator import AutomaticOperator, Operator
from cutenv.rig.plant import RigPlant
from cutenv.rig.session import RigSession
from cutenv.rig.settings import RigSettings
from cutenv.rig.supply import SpecimenKey

FAKE, EMULATOR = "fake", "emulator"


class FakeSupply:
    """Lays drawn specimens on a fake rig."""

    def __init__(self, rig: FakeRig, constants: Constants) -> None:
        self._rig, self._constants = rig, constants

    def lay(self, key: SpecimenKey) -> NDArray[np.float64] | None:
        """Lay it; its depth is known to the one who has drawn it."""
        specimen, constants = key.specimen, self._constants
        if specimen is None:
            raise RigError("a fake rig cuts drawn specimens only.")
        drive = constants.drive
        self._rig.lay(
            lambda settings: CutBench(
                specimen,
                settings,
                drive=drive if isinstance(drive, Rig) else None,
                sensor=constants.sensor,
                law=constants.law,
                seed=key.seed,
                episode=key.episode,
            )
        )
        return None
