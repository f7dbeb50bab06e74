"""``cutenv/RigPathCut-v1``: cutting along a line on a rig with an axis to the side, real or emulated."""

from __future__ import annotations

from typing import Any

from cutenv.envs.described import described
from cutenv.envs.path_cut import PathCutEnv
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.rig.contradictions import AHEAD
from cutenv.rig.errors import RigError
from cutenv.rig.operation.session import SpecimenKey
from cutenv.task.beginning import LONGEST
from cutenv.task.path import PathEpisode, PathOptions
from cutenv.tissue.description import measured_liver
from cutenv.tissue.grid import POINTS_PER_METRE
from cutenv.tissue.lines import CutLine

_ROOM = 1e-3  # [m] between the line and an end of the rig's travel


@described
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

    The others are those of ``cutenv/RigCut-v1``, and
    {keywords}.

    Info
    ----
    That of ``cutenv/RigCut-v1``; ``reward_terms`` has the costs of the path, and ``path``, of the estimated cut,

    {errors on a rig}

    Version history
    ---------------
    v1: the first version; may change until the first comparison of agents is published.
    """

    options_class = PathOptions
    option_names = ("line", "line_limit", "weight_off_line", "weight_farthest", "crack_curvature")
    simulated = PathCutEnv
    needs_axis = "side"
    task_name = "cutenv/RigPathCut-v1"
    options: PathOptions
    cutting: PathEpisode

    def __init__(self, **keywords: Any) -> None:
        super().__init__(**keywords)
        self.options.check_length(LONGEST if self.target_length is None else self.target_length)

    def _lay(self, key: SpecimenKey) -> None:
        assert key.target is not None  # a cut has one
        tissue = self.tissue.tissue or measured_liver() if key.specimen is None else key.specimen.tissue
        self.options.check_length(key.target)
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
