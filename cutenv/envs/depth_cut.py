"""``cutenv/DepthCut-v1``: cut to a target length along a wanted depth, without opening the layer below."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from cutenv._base.arrays import StructArray
from cutenv._base.validation import one_of
from cutenv._engine.parallel import parallel_for
from cutenv.cutting.descent import DESCENT, DescentParameters, descent_records
from cutenv.cutting.parameters import profile_records
from cutenv.envs.constants import taken_from
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.map_batch import MapBatch
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.task.cuts import Cuts
from cutenv.task.depth_beginning import begin_depth_some
from cutenv.task.depth_cuts import depth_errors, step_depth_one, step_depth_some
from cutenv.task.depth_cutting import DepthCutting, depth_record, depth_shown
from cutenv.task.depth_privileged import append_depth_privileged
from cutenv.task.depth_terms import ALL_COMPONENTS, DEPTH, DEPTH_ENDS, DESCENT_SCALE, DepthConstants
from cutenv.task.gentle_cutting import ShownDepth
from cutenv.task.observation import SPEED_SCALE as _SPEED_SCALE
from cutenv.task.observation import speed_action, to_action
from cutenv.task.wanted_depth import WANTED_KINDS
from cutenv.task_quantities import DEPTH_COSTS
from cutenv.tissue.surface import SurfaceSpread


class DepthCutEnv(GentleCutEnv):
    """Cut from the clamp to a target length along a wanted depth, gently, and do not open the layer below.

    It is :class:`~cutenv.envs.gentle_cut.GentleCutEnv` with a blade that also moves up and down.  A depth below the
    surface is wanted at each place, 6 to 14 mm: constant, a ramp or a step.  Another layer, which nobody sees, lies 1
    to 4 mm below the deepest wanted place; its toughness and stiffness differ.  The floor of the cut yields to the
    blade's edge under force, so that the depth of the cut follows that of the blade, which the tissue pushes up with a
    vertical force.  With ``wanted="profile"`` and a blade that stays at its level, it is ``cutenv/GentleCut-v1`` to the
    last bit.

    Edge, floor, capsule and layers are assumed, not measured: see the page "A blade that moves up and down".

    Action
    ------
    ``Box(-1, 1, (3,), float32)``; values outside are clipped, NaN is refused with a ValueError.

    === =============== ====================== ======
    Num Action          -1 to 1 is             Unit
    === =============== ====================== ======
    0   target speed    -2.54 to 2.54          cm/s
    1   target angle    45 to 90 (upright)     deg
    2   descent speed   -10 to 10 (down)       mm/s
    === =============== ====================== ======

    Speed and descent have a dead zone: -0.1 to 0.1 is rest.  ``cutenv.envs.depth_cut.to_depth_action`` gives the action
    for two speeds and an angle.

    Observation
    -----------
    ``Box(-10, 10, (22,), float32)``: (value - offset) / scale, clipped; only what a rig can know.  The first 12
    are those of ``cutenv/GentleCut-v1``; ``depth`` is that of a blade at level 0.

    === ============== =========================================================== ==== ===== ======
    Num Name           Meaning                                                     Unit Scale Offset
    === ============== =========================================================== ==== ===== ======
    12  vertical       vertical force now, upwards                                 N    5     0
    13  vertical_mean  its mean since the last decision                            N    5     0
    14  vertical_max   its maximum since the last decision                         N    5     0
    15  blade_depth    blade's lower end below the surface, as measured beforehand m    0.02  0
    16  descent_speed  of the blade, downwards                                     m/s  0.01  0
    17  wanted         wanted depth at the blade                                   m    0.02  0
    18  wanted_near    5 mm further                                                m    0.02  0
    19  wanted_further 10 mm further                                               m    0.02  0
    20  wanted_far     20 mm further                                               m    0.02  0
    21  last_descent   last action: descent                                        1    1     0
    === ============== =========================================================== ==== ===== ======

    The surface of each slice differs, by 2 mm from that of the mean liver, and was measured beforehand with an error of
    0.5 mm.  Tip, toughness and the layer below are hidden.

    Reward
    ------
    That of ``cutenv/GentleCut-v1``, less four costs of a map of the cut, which has the depth of its floor wherever the
    tip has passed.  They are charged as they grow; what is left uncut is refunded when it is cut later.

    =========== ====== ===================================================
    Term        Weight Charged for
    =========== ====== ===================================================
    too_deep    0.1    area below the wanted depth / (L x 1 mm)
    uncut       0.1    area above the wanted depth, behind the tip, / (L x 1 mm)
    layer_area  0.2    area opened in the layer below / (L x 1 mm)
    layer_depth 0.05   largest depth into the layer below / 1 mm
    =========== ====== ===================================================

    Ends
    ----
    Those of ``cutenv/GentleCut-v1``, and "layer", an end for safety: the layer below is opened deeper than
    ``layer_limit``, 3 mm.

    Success is that of ``cutenv/GentleCut-v1`` with a mean error of the depth of at most 1.5 mm along the target length,
    and the layer below not opened deeper than 0.5 mm.

    Arguments
    ---------
    ========= ======= =================================================================================
    Keyword   Default Meaning
    ========= ======= =================================================================================
    wanted    "mixed" "constant", "ramp", "step", "mixed" (one of these) or "profile" (level 0)
    layer     None    True: another layer below; None: unless ``wanted`` is "profile"
    ========= ======= =================================================================================

    The others are those of ``cutenv/GentleCut-v1``, of which ``reward_from`` cannot be changed, and
    ``edge_length``, ``bedding``, ``vertical_lag``, ``vertical_acceleration``, ``response_time``, ``layer_limit``,
    ``vertical_noise``, ``vertical_resolution``, ``weight_too_deep``, ``weight_uncut``, ``weight_layer_area``,
    ``weight_layer_depth``, ``surface_spread`` (0 with ``wanted="profile"``), ``surface_length``.

    Info
    ----
    That of ``cutenv/GentleCut-v1``; ``reward_terms`` has the four costs; ``truth`` has ``level_m``, ``floor_depth_m``
    (depth of the cut at the tip) and ``layer_m`` (depth of the layer below); ``depth`` has the areas cut too deep, left
    uncut and opened in the layer (``too_deep_mm2``, ``uncut_mm2``, ``layer_mm2``), the depth into it (``layer_mm``) and
    the mean error (``mean_error_mm``), of the cut so far.

    Version history
    ---------------
    v1: the first version; may change until the first comparison of agents is published.
    """

    action_names = ("speed", "angle", "descent")
    component_count = len(ALL_COMPONENTS)
    step_one = step_depth_one
    other_keywords = (
        "wanted", "layer", *DepthConstants.__dataclass_fields__, *DescentParameters.__dataclass_fields__,
        *SurfaceSpread.__dataclass_fields__,
    )  # fmt: skip
    cutting: DepthCutting

    def __init__(self, *, wanted: str = "mixed", layer: bool | None = None, **keywords: Any) -> None:
        self.wanted = WANTED_KINDS[one_of("wanted", wanted, tuple(WANTED_KINDS))]
        one_of("layer", layer, (None, True, False))
        self.layer = wanted != "profile" if layer is None else layer
        if keywords.get("reward_from", "truth") != "truth":
            raise ValueError(
                f'reward_from = {keywords["reward_from"]!r}: cutenv/DepthCut-v1 has only reward_from="truth". '
                "Leave it out."
            )
        if wanted == "profile":  # of the mean liver, as in cutenv/GentleCut-v1
            keywords.setdefault("surface_spread", 0.0)
        self.depth_constants = taken_from(keywords, DepthConstants)
        self.descent_parameters = taken_from(keywords, DescentParameters)
        self.surface = taken_from(keywords, SurfaceSpread)
        super().__init__(**keywords)

    def new_cutting(self, *arguments: Any, key: tuple[int, int], **keywords: Any) -> DepthCutting:
        """Return a new cut of this task with the arguments of its class; ``key`` is seed and episode."""
        keywords.pop("from_truth")
        return DepthCutting(
            *arguments, wanted=self.wanted, layer=self.layer, constants=self.depth_constants,
            descent=self.descent_parameters, key=key, **keywords,
        )  # fmt: skip

    def _info(self) -> dict[str, Any]:
        info, descents = super()._info(), self.cutting.descents
        info["truth"] |= {name: float(value[0]) for name, value in depth_truth(descents).items()}
        info["reward_terms"] |= self.cutting.map_terms
        info["depth"] = self.cutting.depth_errors
        return info


def depth_truth(descents: StructArray) -> dict[str, Any]:
    """Return the hidden state of n cuts that depth adds, each of shape (n,) [m]."""
    at_tip = np.arange(len(descents)), descents["cell"]
    return {
        "level_m": descents["level"],
        "floor_depth_m": descents["surface"][at_tip] - descents["floor"][at_tip],
        "layer_m": descents["boundary"],
    }


def to_depth_action(speed: float, angle: float, descent_speed: float) -> NDArray[np.float32]:
    """Return the action, shape (3,), for a speed [m/s], an angle [rad] and a speed downwards [m/s]; clipped."""
    descent = speed_action(descent_speed * (_SPEED_SCALE / DESCENT_SCALE))
    return np.append(to_action(speed, angle), np.float32(np.clip(descent, -1.0, 1.0))).astype(np.float32)


class DepthBatch(MapBatch):
    """``count`` cuts of ``cutenv/DepthCut-v1``, bit for bit equal to those of single environments.

    Attributes
    ----------
    descents, depths : Records, shape (count,)
        Vertical motions and maps of the depth, :data:`~cutenv.cutting.descent.DESCENT` and
        :data:`~cutenv.task.depth_terms.DEPTH`.
    """

    single: DepthCutEnv
    end_names: ClassVar[NDArray[Any]] = np.array(DEPTH_ENDS, dtype=object)
    step_some = step_depth_some
    append = append_depth_privileged
    map_costs = DEPTH_COSTS
    shown_as = "depth"

    def __init__(self, count: int, single: GentleCutEnv) -> None:
        super().__init__(count, single)
        self.descents, self.depths = np.zeros(count, DESCENT), np.zeros(count, DEPTH)
        self._depth_start: tuple[StructArray, StructArray, StructArray] | None = None

    def _begin_rest(self, which: NDArray[np.int64], given: str | None) -> None:
        single = self.single
        start = self._depth_start
        if given is not None or start is None:
            specimen = single.specimen
            descents = descent_records(
                [specimen], specimen.tissue.layers if single.layer else None, single.descent_parameters
            )
            start = descents, depth_record(single.depth_constants), specimen.tissue.slab()
        if given is None:
            self._depth_start = start
        shared = 1.0 - single.specimen.tissue.friction_share, single.descent_parameters.bedding
        parallel_for(
            begin_depth_some, len(which), self.cuts, self.descents, self.depths, start, shared,
            (single.wanted, int(single.layer)), which, self.seeds, self.episodes, self.observations,
        )  # fmt: skip

    def _shared_start(self, options: dict[str, Any]) -> tuple[Cuts, StructArray, str | None]:
        start, expected, given = super()._shared_start(options)
        whole = profile_records([self.single.specimen])  # that of the single cut is as deep as wanted
        return start._replace(profiles=whole), expected, given

    @property
    def beside(self) -> tuple[StructArray, ...]:
        """Vertical motions and depths, each of shape (count,), and the slab of them all."""
        return self.descents, self.depths, self.single.cutting.slabs

    def truth(self) -> dict[str, Any]:
        """Return the hidden state that depth adds to the info, by name; each of shape (count,)."""
        return depth_truth(self.descents)

    def further_scores(self) -> dict[str, NDArray[np.float64]]:
        """Return the depth of each cut in numbers: areas [mm2], depth into the layer and mean error [mm]."""
        return depth_errors(self.depths, self.cuts.tasks["target"])

    def shown_depth(self, cut: int) -> ShownDepth:
        """Return a copy of the depth of a cut as a picture shows it."""
        return depth_shown(self.descents[cut].copy(), self.depths[cut].copy())


class DepthCutVectorEnv(GentleCutVectorEnv):
    """Many ``cutenv/DepthCut-v1``, bit for bit equal to single ones with the same seeds and actions."""

    single_class = DepthCutEnv
    batch_class = DepthBatch
    batch: DepthBatch
