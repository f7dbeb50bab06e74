"""``cutenv/PathCut-v1``: cut gently to a target length along a drawn line, by a blade that is steered."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cutenv._base.arrays import StructArray
from cutenv._engine.parallel import parallel_for
from cutenv.cutting.parameters import profile_records
from cutenv.cutting.steering import STEERING, SteeringParameters
from cutenv.envs.constants import taken_from
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.line_choice import LineChoice
from cutenv.envs.map_batch import MapBatch
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.task.beginning import LONGEST
from cutenv.task.cuts import Cuts
from cutenv.task.observation import SPEED_SCALE, speed_action, to_action
from cutenv.task.path_beginning import begin_path_some
from cutenv.task.path_cuts import path_errors, step_path_one, step_path_some
from cutenv.task.path_cutting import PathCutting, path_record, steering_record
from cutenv.task.path_privileged import append_path_privileged
from cutenv.task.path_terms import ALL_PATH_COMPONENTS, PATH_ENDS, PATH_MAP, TURN_SCALE, PathConstants
from cutenv.task_quantities import PATH_COSTS
from cutenv.tissue.grid import LENGTH, SPACING
from cutenv.tissue.lines import CutLine


class PathCutEnv(GentleCutEnv):
    """Cut from the clamp to a target length along a drawn line, gently.

    It is :class:`~cutenv.envs.gentle_cut.GentleCutEnv` with a blade that is also turned to the left and right.  The
    crack tip trails the blade and turns after the force, so that a blade that follows the line does not cut along it;
    cut and line are compared where the tip has passed.  Lengths, positions and distances are told along the line.  On
    the straight line, and with a blade that is not turned, it is ``cutenv/GentleCut-v1`` to the last bit.

    The law is described on the page "Cuts along a curve"; no measurement of a curved cut in liver is known to us.

    Action
    ------
    ``Box(-1, 1, (3,), float32)``; values outside are clipped, NaN is refused with a ValueError.

    === =============== ====================== ======
    Num Action          -1 to 1 is             Unit
    === =============== ====================== ======
    0   target speed    -2.54 to 2.54          cm/s
    1   target angle    45 to 90 (upright)     deg
    2   rate of turn    -1.5 to 1.5 (left)     rad/s
    === =============== ====================== ======

    Speed and turn have a dead zone: -0.1 to 0.1 is rest.  ``cutenv.envs.path_cut.to_path_action`` gives the action for
    a speed, an angle and a rate of turn.  The blade moves where it points; the rate of turn has no lag.

    Observation
    -----------
    ``Box(-10, 10, (28,), float32)``: (value - offset) / scale, clipped; only what a rig can know.  The first 12
    are those of ``cutenv/GentleCut-v1``.

    === ================= ========================================================== ==== ===== ======
    Num Name              Meaning                                                    Unit Scale Offset
    === ================= ========================================================== ==== ===== ======
    12  lateral           force on the blade to its right, now                       N    5     0
    13  lateral_mean      its mean since the last decision                           N    5     0
    14  lateral_peak      largest size of it since the last decision                 N    5     0
    15  aside             line to the left of the blade, at the blade                m    0.005 0
    16  direction         sine of the turn from blade to line there, to the left     1    0.5   0
    17  bend              curvature of the line there, to the left                   1/m  25    0
    18  aside_near        line to the left of the blade's course, 5 mm further       m    0.005 0
    19  direction_near    direction there                                            1    0.5   0
    20  bend_near         curvature there                                            1/m  25    0
    21  aside_further     line to the left of the blade's course, 10 mm further      m    0.005 0
    22  direction_further direction there                                            1    0.5   0
    23  bend_further      curvature there                                            1/m  25    0
    24  aside_far         line to the left of the blade's course, 20 mm further      m    0.005 0
    25  direction_far     direction there                                            1    0.5   0
    26  bend_far          curvature there                                            1/m  25    0
    27  last_turn         last action: turn                                          1    1     0
    === ================= ========================================================== ==== ===== ======

    Tip, tissue and the cut are hidden.

    Reward
    ------
    That of ``cutenv/GentleCut-v1``, less two costs of a map of the cut, which has its distance to the line wherever the
    tip has passed.  Cost and limit of force are of the force in the plane, whose part to the side counts too; so does
    tissue that is left loaded to the side.

    ======== ====== ==========================================
    Term     Weight Charged for
    ======== ====== ==========================================
    off_line 0.2    area between cut and line / (L x 1 mm)
    farthest 0.05   largest distance between cut and line / 1 mm
    ======== ====== ==========================================

    Ends
    ----
    Those of ``cutenv/GentleCut-v1``, and "off_line", an end for safety: the cut is farther than ``line_limit``, 8 mm,
    from the line.

    Success is that of ``cutenv/GentleCut-v1`` with a mean distance between cut and line of at most 1 mm along the
    target length, and a largest one of at most 3 mm.

    Arguments
    ---------
    ========= ======= =================================================================================
    Keyword   Default Meaning
    ========= ======= =================================================================================
    line      "mixed" "straight", "arc", "s", "excision", "random", "mixed" (one of these), or a line
    ========= ======= =================================================================================

    There are 64 lines of each kind, the same for everybody, of which the seed draws one.  A given line is a
    :class:`~cutenv.tissue.lines.CutLine`, or places [m] from the clamp (0, 0) on, shape (n, 2), through which it is
    drawn; one that turns back, bends too far or leaves the slab less than 30 mm beyond the target is refused with the
    place.

    The others are those of ``cutenv/GentleCut-v1``, of which ``reward_from`` and ``relaxing_share`` cannot be changed,
    and ``crack_curvature``, ``response_time``, ``line_limit``, ``lateral_noise``, ``lateral_resolution``,
    ``weight_off_line``, ``weight_farthest``.

    Info
    ----
    That of ``cutenv/GentleCut-v1``; ``reward_terms`` has the two costs; ``truth`` has places of blade and tip
    (``blade_x_m``, ``blade_y_m``, ``tip_x_m``, ``tip_y_m``) and ``aside_m`` (distance of the tip to the left of the
    line); ``path`` has the area between cut and line (``area_mm2``), mean and largest distance
    (``mean_distance_mm``, ``largest_distance_mm``), of the cut so far.

    Version history
    ---------------
    v1: the first version; may change until the first comparison of agents is published.
    """

    action_names = ("speed", "angle", "turn")
    component_count = len(ALL_PATH_COMPONENTS)
    step_one = step_path_one
    other_keywords = (
        "line", *PathConstants.__dataclass_fields__, *SteeringParameters.__dataclass_fields__,
    )  # fmt: skip
    cutting: PathCutting

    def __init__(self, *, line: str | CutLine | ArrayLike = "mixed", **keywords: Any) -> None:
        self.line = LineChoice(line)
        for name, only in (("reward_from", "truth"), ("relaxing_share", 0.0)):
            if keywords.get(name, only) != only:
                raise ValueError(
                    f"{name} = {keywords[name]!r}: cutenv/PathCut-v1 has only {name}={only!r}. Leave it out."
                )
        self.path_constants = taken_from(keywords, PathConstants)
        self.steering_parameters = taken_from(keywords, SteeringParameters)
        super().__init__(**keywords)
        self.line.check(LONGEST if self.target_length is None else self.target_length)

    def check_start(self, length: float) -> None:
        """Raise ValueError if a cut of a target length [m] cannot begin where it is to, or does not fit its line."""
        super().check_start(length)
        self.line.check(length)

    def new_cutting(self, *arguments: Any, key: tuple[int, int], **keywords: Any) -> PathCutting:
        """Return a new cut of this task with the arguments of its class; ``key`` is seed and episode."""
        keywords.pop("from_truth")
        tissue = self.specimen.tissue
        return PathCutting(
            *arguments, drawn=self.line.lines_for(tissue), kind=self.line.kind,
            constants=self.path_constants, steering=self.steering_parameters, key=key, **keywords,
        )  # fmt: skip

    def _info(self) -> dict[str, Any]:
        info, cutting = super()._info(), self.cutting
        truth = path_truth(cutting.plant.states, cutting.steerings)
        info["truth"] |= {name: float(value[0]) for name, value in truth.items()}
        info["reward_terms"] |= cutting.map_terms
        info["path"] = cutting.path_errors
        return info


def path_truth(states: StructArray, steerings: StructArray) -> dict[str, Any]:
    """Return the hidden state of n cuts that the path adds, each of shape (n,) [m]."""
    grown = states["tip"] - steerings["settled"]
    way = grown * steerings["stretch"]
    return {
        "blade_x_m": states["blade"] + steerings["east"],
        "blade_y_m": steerings["north"].copy(),
        "tip_x_m": steerings["settled"] + steerings["tip_east"] + steerings["tip_ahead"] * way,
        "tip_y_m": steerings["tip_north"] + steerings["tip_across"] * way,
        "aside_m": steerings["tip_aside"].copy(),
    }


def to_path_action(speed: float, angle: float, turn_rate: float) -> NDArray[np.float32]:
    """Return the action, shape (3,), for a speed [m/s], an angle [rad] and a turn to the left [rad/s]; clipped."""
    turn = speed_action(turn_rate * (SPEED_SCALE / TURN_SCALE))
    return np.append(to_action(speed, angle), np.float32(np.clip(turn, -1.0, 1.0))).astype(np.float32)


class PathBatch(MapBatch):
    """``count`` cuts of ``cutenv/PathCut-v1``, bit for bit equal to those of single environments.

    Attributes
    ----------
    steerings, paths : Records, shape (count,)
        Places in the plane and maps of the path, :data:`~cutenv.cutting.steering.STEERING` and
        :data:`~cutenv.task.path_terms.PATH_MAP`.
    """

    single: PathCutEnv
    end_names: ClassVar[NDArray[Any]] = np.array(PATH_ENDS, dtype=object)
    step_some = step_path_some
    append = append_path_privileged
    map_costs = PATH_COSTS
    shown_as = "path"

    def __init__(self, count: int, single: GentleCutEnv) -> None:
        super().__init__(count, single)
        self.steerings, self.paths = np.zeros(count, STEERING), np.zeros(count, PATH_MAP)
        self._path_start = steering_record(self.single.steering_parameters), path_record(self.single.path_constants)

    def _begin_rest(self, which: NDArray[np.int64], given: str | None) -> None:
        single = self.single
        tissue = single.specimen.tissue
        lines, kind = single.line.lines_for(tissue).records, single.line.kind
        parallel_for(
            begin_path_some, len(which), self.cuts, self.steerings, self.paths, self._path_start, lines, kind,
            which, self.seeds, self.episodes, self.observations,
        )  # fmt: skip

    def _shared_start(self, options: dict[str, Any]) -> tuple[Cuts, StructArray, str | None]:
        start, expected, given = super()._shared_start(options)
        # Those of the single cut are along its line, and its drive reaches as far as that.
        profiles = profile_records([self.single.specimen])
        drives = self.single.constants.drive.records(travel=LENGTH - SPACING)
        return start._replace(profiles=profiles, drives=drives), expected, given

    @property
    def beside(self) -> tuple[StructArray, ...]:
        """Places in the plane and paths, each of shape (count,)."""
        return self.steerings, self.paths

    def truth(self) -> dict[str, Any]:
        """Return the hidden state that the path adds to the info, by name; each of shape (count,)."""
        return path_truth(self.cuts.states, self.steerings)

    def further_scores(self) -> dict[str, NDArray[np.float64]]:
        """Return the path of each cut in numbers: area [mm2], mean and largest distance to the line [mm]."""
        return path_errors(self.paths, self.cuts.states["tip"])


class PathCutVectorEnv(GentleCutVectorEnv):
    """Many ``cutenv/PathCut-v1``, bit for bit equal to single ones with the same seeds and actions."""

    single_class = PathCutEnv
    batch_class = PathBatch
    batch: PathBatch
