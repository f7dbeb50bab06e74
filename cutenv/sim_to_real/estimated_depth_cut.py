"""``cutenv/DepthCut-v1`` assessed as a rig assesses it: the simulator's side of a comparison along a wanted depth."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, StructArray
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.plant import DescendingPlant
from cutenv.sim_to_real.measured_force import MeasuredForce
from cutenv.task.rig_depth_cutting import RigDepthCutting
from cutenv.tissue.layers import Layers
from cutenv.tissue.specimen import Specimen


class HeightPlant(DescendingPlant):
    """Simulated specimen whose height and vertical force are measured as on a rig.

    Parameters
    ----------
    specimen : Specimen
        The tissue to cut.
    noise, resolution, delay : float
        Of the vertical force: standard deviation [N], [N], [s].
    seed, episode : int
        Random key of the noise of both forces.
    keywords
        Those of :class:`~cutenv.plant.DescendingPlant`.

    Attributes
    ----------
    beside : mapping of str to array
        Height [m] and vertical force [N] at each reading of the last :meth:`advance`.
    """

    def __init__(
        self, specimen: Specimen, *, noise: float, resolution: float, delay: float, seed: int, episode: int,
        **keywords: Any,
    ) -> None:  # fmt: skip
        super().__init__(specimen, seed=seed, episode=episode, **keywords)
        self._felt = MeasuredForce(noise=noise, resolution=resolution, delay=delay, seed=seed, episode=episode)
        self.beside: dict[str, Array] = {"height": np.zeros(0), "vertical_force": np.zeros(0)}

    def advance(self, speed: float, angle: float, ticks: int, descent_speed: float = 0.0) -> StructArray:
        """Command as :meth:`~cutenv.plant.DescendingPlant.advance`; height is taken as linear between two decisions."""
        before = self.level
        readings = super().advance(speed, angle, ticks, descent_speed)
        self.beside = {
            "height": np.linspace(before, self.level, ticks + 1)[1:],
            "vertical_force": self._felt(self.vertical_force),
        }
        return readings


class EstimatedDepthCutEnv(DepthCutEnv):
    """``cutenv/DepthCut-v1`` whose tip and floor are the estimates of :class:`~cutenv.envs.RigDepthCutEnv`.

    Reward, end and success come from what a rig measures, and no cut ends in the layer below, which no rig sees.  The
    wanted depth and the layer are those of a reset's seed and episode, whatever noise a later :meth:`set_up` draws.
    """

    cutting: RigDepthCutting  # type: ignore[assignment]
    _key: tuple[int, int] | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Draw the next specimen and put the blade to the clamp, at the depth that is wanted there."""
        self._key = None
        return super().reset(seed=seed, options=options)

    def set_up(self, specimen: Specimen, length: float, *, seed: int, episode: int, depth: NDArray[np.float64]) -> None:
        """Put the blade to the start of a cut of ``length`` [m], with the ``depth`` [m] known to the lab."""
        key = self._key = self._key or (seed, episode)
        constants, depths = self.constants, self.depth_constants
        self.specimen = specimen
        expected = self._assessed(_Surface(depth), length, key)
        plant = HeightPlant(
            specimen,
            layers=expected.layers_below() if self.layer else Layers(),
            drive=constants.drive,
            sensor=constants.sensor,
            law=constants.law,
            descent=self.descent_parameters,
            seed=seed,
            episode=episode,
            angle=self.start_angle,
            depth=depth,
            level=expected.start_level,
            noise=depths.vertical_noise,
            resolution=depths.vertical_resolution,
            delay=constants.sensor.force_delay,
        )
        self.plant = plant  # type: ignore[assignment]
        self.cutting = self._assessed(plant, length, key)

    def _assessed(self, plant: Any, length: float, key: tuple[int, int]) -> RigDepthCutting:
        tissue = self.specimen.tissue
        return RigDepthCutting(
            plant, tissue, self.constants.weights, self.constants.limits,
            friction_per_depth=tissue.nominal_friction_per_depth, target_length=length, deadline=self.deadline,
            ticks=self.ticks, wanted=self.wanted, constants=self.depth_constants, descent=self.descent_parameters,
            key=key,
        )  # fmt: skip

    def _info(self) -> dict[str, Any]:
        return {"reward_terms": self.cutting.reward_terms, "depth": self.cutting.depth_errors}


class _Surface:
    """Plant of which only the measured depth is known."""

    def __init__(self, depth: Array) -> None:
        self.depth = depth
