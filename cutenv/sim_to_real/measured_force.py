"""A force across the cut as a rig's sensor would tell it, from the simulator's true one."""

from __future__ import annotations

import numpy as np

from cutenv._base.arrays import Array
from cutenv.cutting.dtypes import TICK


class MeasuredForce:
    """Sensor of one force: late, noisy, in steps.

    Parameters
    ----------
    noise, resolution, delay : float
        Standard deviation [N], step [N], or 0 for none, and delay [s].
    seed, episode : int
        Random key of the noise.
    """

    def __init__(self, *, noise: float, resolution: float, delay: float, seed: int, episode: int) -> None:
        self._noise, self._resolution = noise, resolution
        self._late: Array = np.zeros(round(delay / TICK))
        self._rng = np.random.default_rng([seed, episode])

    def __call__(self, true: Array) -> Array:
        """Return what is read while the true force is ``true``, both at every millisecond, shape (n,) [N]."""
        felt = np.concatenate((self._late, true))
        self._late = felt[len(true) :]
        felt = felt[: len(true)] + self._noise * self._rng.standard_normal(len(true))
        return self._resolution * np.round(felt / self._resolution) if self._resolution > 0.0 else felt
