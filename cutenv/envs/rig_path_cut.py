"""``cutenv/RigPathCut-v1``: cutting along a line on a rig with an axis to the side, real or emulated."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cutenv._engine.jit import warn_before_first_compile
from cutenv.cutting.dtypes import READING
from cutenv.cutting.steering import SteeringParameters
from cutenv.envs.line_choice import LineChoice
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.plant import Plant, SimulatedPlant
from cutenv.rig.contradictions import AHEAD
from cutenv.rig.errors import RigError
from cutenv.rig.operation.specimen_source import SpecimenKey
from cutenv.task.beginning import LONGEST
from cutenv.task.path_readings import assess_path_readings
from cutenv.task.path_terms import ALL_PATH_COMPONENTS, PathConstants
from cutenv.task.rig_path_cutting import RigPathCutting
from cutenv.tissue.description import TissueDescription, measured_liver
from cutenv.tissue.grid import POINTS_PER_METRE
from cutenv.tissue.lines import CutLine
from cutenv.tissue.specimen import Specimen
from cutenv.trace import PLACE

_OF_PATH = ("line_limit", "weight_off_line", "weight_farthest")
_EXPECTED = ("crack_curvature",)
_ROOM = 1e-3  # [m] between the line and an end of the rig's travel


class RigPathCutEnv(RigCutEnv):
    """Cut along a line on a rig that a policy of ``cutenv/PathCut-v1`` can use unchanged.

    It is :class:`~cutenv.envs.rig_cut.RigCutEnv` on a rig with an axis to the side; a rig's file without the section
    ``[side]`` is refused.  Action and observation are those of :class:`~cutenv.envs.path_cut.PathCutEnv`, and so is the
    line of a seed and episode.  Where that one uses hidden state, this one uses estimates: the tip from the measured
    force, and beside the line the cut that mean tissue would have behind this blade.

    The two axes lead the blade: speed and turn become speeds along the slab and to its left, anew with every sample of
    the axes, and force and lateral force are the sensor's two, turned into the direction in which the blade goes.  **No
    axis turns the blade about its upright axis.**  The law holds for a blade that points where it goes: mount one that
    trails by itself behind a pivot, with the pivot above the force sensor, or expect other lateral forces.

    Each ``reset`` leads the blade back through the cut, the way that it came, or raises it first where the rig has a
    height axis.

    Arguments
    ---------
    ========= ======= =================================================================================
    Keyword   Default Meaning
    ========= ======= =================================================================================
    line      "mixed" as for ``cutenv/PathCut-v1``
    ========= ======= =================================================================================

    The others are those of ``cutenv/RigCut-v1``, and ``crack_curvature``, ``line_limit``, ``weight_off_line``,
    ``weight_farthest``.

    Info
    ----
    That of ``cutenv/RigCut-v1``; ``reward_terms`` has the costs of the path, and ``path`` the area between the
    estimated cut and the line (``area_mm2``), mean and largest distance (``mean_distance_mm``,
    ``largest_distance_mm``).

    Version history
    ---------------
    v1: the first version; may change until the first comparison of agents is published.
    """

    action_names = ("speed", "angle", "turn")
    component_count = len(ALL_PATH_COMPONENTS)
    other_keywords = ("line", *_OF_PATH, *_EXPECTED)
    needs_axis = "side"
    task_name = "cutenv/RigPathCut-v1"
    cutting: RigPathCutting

    def __init__(self, *, line: str | CutLine | ArrayLike = "mixed", **keywords: Any) -> None:
        self.line = LineChoice(line)
        own = {name: keywords.pop(name) for name in (*_OF_PATH, *_EXPECTED) if name in keywords}
        self.path_constants = PathConstants(**{name: own[name] for name in _OF_PATH if name in own})
        self.steering_parameters = SteeringParameters(**{name: own[name] for name in _EXPECTED if name in own})
        super().__init__(**keywords)
        self.line.check(LONGEST if self.target_length is None else self.target_length)
        self.path_keywords = {"line": line, **own}
        """Keywords that this task adds to those of ``cutenv/RigCut-v1``, as they were given."""
        self._arguments |= self.path_keywords

    def _lay(self, key: SpecimenKey) -> None:
        assert key.target is not None  # a cut has one
        tissue = self.tissue.tissue or measured_liver() if key.specimen is None else key.specimen.tissue
        self.line.check(key.target)
        line = self._cutting(self.session.plant, tissue, key.target, key).line
        self._check_reach(line, key.target)
        if self._source.supply is not None:
            self._source.supply.line = line
        super()._lay(key)
        self.session.plant.begin(line)

    def _check_reach(self, line: CutLine, target: float) -> None:
        """Raise RigError if a line goes where the rig's axes cannot lead the blade."""
        axis = self.settings.require_side_axis(by=self.task_name)
        passed = slice(0, int((target + AHEAD) * POINTS_PER_METRE) + 1)
        right, left = float(line.y[passed].min()), float(line.y[passed].max())
        low, high = axis.bounds
        if right < low + _ROOM or left > high - _ROOM:
            raise RigError(
                f"the line goes from {1e3 * right:+.1f} to {1e3 * left:+.1f} mm to the left of the middle, and the "
                f"blade is stopped at {1e3 * low:g} and {1e3 * high:g} (side.rightmost_mm, leftmost_mm). Take another "
                "line, or an axis that reaches there."
            )

    def _warm_up(self) -> None:
        warn_before_first_compile(assess_path_readings)
        practice = Specimen.drawn(0, 0)
        cutting = self._cutting(SimulatedPlant(practice), practice.tissue, 0.06, SpecimenKey(seed=0, episode=0))
        cutting.rest(self.start_angle)
        beside = {name: np.zeros(self.ticks) for name in (*PLACE, "lateral_force")}
        cutting.assess(np.zeros(self.ticks, READING), beside, 0.0)

    def _cutting(self, plant: Plant, tissue: TissueDescription, length: float, key: SpecimenKey) -> RigPathCutting:
        return RigPathCutting(
            plant, tissue, self.constants.weights, self.constants.limits,
            friction_per_depth=tissue.nominal_friction_per_depth, target_length=length, deadline=self.deadline,
            ticks=self.ticks, drawn=self.line.lines_for(tissue), kind=self.line.kind, constants=self.path_constants,
            steering=self.steering_parameters, key=(key.seed, key.episode),
        )  # fmt: skip

    def _info(self) -> dict[str, Any]:
        return super()._info() | {"path": self.cutting.path_errors}
