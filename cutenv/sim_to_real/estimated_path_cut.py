"""``cutenv/PathCut-v1`` assessed as a rig assesses it: the simulator's side of a comparison along a line."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import Array, Array32, StructArray
from cutenv.envs.path_cut import PathCutEnv
from cutenv.plant import SteeredPlant
from cutenv.sim_to_real.measured_force import MeasuredForce
from cutenv.task.path_beginning import line_number
from cutenv.task.rig_path_cutting import RigPathCutting
from cutenv.tissue.lines import CutLine
from cutenv.tissue.specimen import Specimen
from cutenv.trace import PLACE


class PlacePlant(SteeredPlant):
    """Simulated specimen on which place and lateral force of the blade are measured as on a rig.

    Parameters
    ----------
    specimen : Specimen
        The tissue to cut.
    line : CutLine
        Line to cut along.
    depth : array, shape (301,)
        Depth along the line that the lab knows [m].
    noise, resolution, delay : float
        Of the lateral force: standard deviation [N], [N], [s].
    seed, episode : int
        Random key of the noise of both forces.
    keywords
        Those of :class:`~cutenv.plant.SteeredPlant`.

    Attributes
    ----------
    beside : mapping of str to array
        Place [m] and lateral force [N] at each reading of the last :meth:`advance`.
    """

    def __init__(
        self, specimen: Specimen, line: CutLine, *, depth: Array, noise: float, resolution: float, delay: float,
        seed: int, episode: int, **keywords: Any,
    ) -> None:  # fmt: skip
        super().__init__(specimen, line, seed=seed, episode=episode, **keywords)
        self.depth = depth
        self._felt = MeasuredForce(noise=noise, resolution=resolution, delay=delay, seed=seed, episode=episode)
        self.beside: dict[str, Array] = {name: np.zeros(0) for name in (*PLACE, "lateral_force")}

    def advance(self, speed: float, angle: float, ticks: int, turn_rate: float = 0.0) -> StructArray:
        """Command as :meth:`~cutenv.plant.SteeredPlant.advance`; between two decisions the blade's way is straight."""
        before = self.blade
        readings = super().advance(speed, angle, ticks, turn_rate)
        places = zip(PLACE, before, self.blade, strict=True)
        self.beside = {name: np.linspace(start, end, ticks + 1)[1:] for name, start, end in places}
        self.beside["lateral_force"] = self._felt(self.lateral_force)
        return readings


class EstimatedPathCutting(RigPathCutting):
    """An episode along a line, assessed by what a rig measures, on a simulated specimen."""

    def _assess(self, readings: StructArray) -> tuple[Array32, float]:
        return self.assess(readings, self.plant.beside, self.plant.heading)


class EstimatedPathCutEnv(PathCutEnv):
    """``cutenv/PathCut-v1`` whose tip and cut are the estimates of :class:`~cutenv.envs.RigPathCutEnv`.

    Reward, end and success come from what a rig measures.  The line is that of a reset's seed and episode, whatever
    noise a later :meth:`set_up` draws.
    """

    cutting: EstimatedPathCutting  # type: ignore[assignment]
    _key: tuple[int, int] | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Draw the next specimen and line, and put the blade to the clamp."""
        self._key = None
        return super().reset(seed=seed, options=options)

    def set_up(self, specimen: Specimen, length: float, *, seed: int, episode: int, depth: NDArray[np.float64]) -> None:
        """Put the blade to the start of a cut of ``length`` [m], with the ``depth`` [m] known to the lab."""
        key = self._key = self._key or (seed, episode)
        constants, own, drawn = self.constants, self.path_constants, self.line.lines_for(specimen.tissue)
        self.specimen = specimen
        plant = PlacePlant(
            specimen,
            drawn.lines[line_number(np.uint64(key[0]), np.uint64(key[1]), self.line.kind)],
            drive=constants.drive,
            sensor=constants.sensor,
            law=constants.law,
            steering=self.steering_parameters,
            seed=seed,
            episode=episode,
            angle=self.start_angle,
            depth=depth,
            noise=own.lateral_noise,
            resolution=own.lateral_resolution,
            delay=constants.sensor.force_delay,
        )
        self.plant = plant  # type: ignore[assignment]
        tissue = specimen.tissue
        self.cutting = EstimatedPathCutting(
            plant, tissue, constants.weights, constants.limits,
            friction_per_depth=tissue.nominal_friction_per_depth, target_length=length, deadline=self.deadline,
            ticks=self.ticks, drawn=drawn, kind=self.line.kind, constants=own, steering=self.steering_parameters,
            key=key,
        )  # fmt: skip

    def _info(self) -> dict[str, Any]:
        return {"reward_terms": self.cutting.reward_terms, "path": self.cutting.path_errors}
