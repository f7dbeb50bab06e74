"""``cutenv/RigDepthCut-v1``: cutting along a wanted depth on a rig with a height axis, real or emulated."""

from __future__ import annotations

from typing import Any, ClassVar

from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.described import described
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.plant import SimulatedPlant
from cutenv.rig.contradictions import AHEAD
from cutenv.rig.errors import RigError
from cutenv.rig.operation.session import SpecimenKey
from cutenv.task.depth import DepthConstants, DepthEpisode, DepthOptions
from cutenv.tissue.description import measured_liver
from cutenv.tissue.grid import POINTS_PER_METRE
from cutenv.tissue.layers import Layers
from cutenv.tissue.specimen import Specimen

_DEPTH_WEIGHTS = tuple(name for name in DepthConstants.__dataclass_fields__ if name.startswith("weight_"))


@described
class RigDepthCutEnv(RigCutEnv):
    """Cut along a wanted depth on a rig that a policy of ``cutenv/DepthCut-v1`` can use unchanged.

    It is :class:`~cutenv.envs.rig_cut.RigCutEnv` on a rig with a height axis; a rig's file without the section
    ``[height]`` is refused.  Action and observation are those of :class:`~cutenv.envs.depth_cut.DepthCutEnv`, and so is
    the wanted depth of a seed and episode.  Where that one uses hidden state, this one uses estimates: the tip from the
    measured force, and the floor that the mean tissue would have under this blade.  The layer below is not known, so
    that ``layer_area`` and ``layer_depth`` are always 0, and no cut ends in it.

    Each ``reset`` raises the blade out of the cut, returns to the clamp, has a specimen laid with the blade at height
    0, and moves the blade to the depth that is wanted at the start.  If the blade is stopped, it stays where it is:
    nothing is raised before the operator agrees.  A blade that cannot be raised is a fault that stops.

    Arguments
    ---------
    ========= ======= =================================================================================
    Keyword   Default Meaning
    ========= ======= =================================================================================
    wanted    "mixed" "constant", "ramp", "step", "mixed" (one of these) or "profile" (height 0)
    layer     None    another layer below, of drawn specimens; None: unless ``wanted`` is "profile"
    ========= ======= =================================================================================

    The others are those of ``cutenv/RigCut-v1``, and
    {keywords}.

    Info
    ----
    That of ``cutenv/RigCut-v1``; ``reward_terms`` has the costs of the depth, and ``depth``, by the expected floor,

    {errors on a rig}

    Version history
    ---------------
    v1: the first version; may change until the first comparison of agents is published.
    """

    options_class = DepthOptions
    option_names = ("wanted", "layer", *_DEPTH_WEIGHTS, "edge_length", "bedding")
    simulated = DepthCutEnv
    as_simulated: ClassVar[dict[str, Any]] = {"surface_spread": 0.0}  # they have the mean liver's surface
    needs_axis = "height"
    task_name = "cutenv/RigDepthCut-v1"
    options: DepthOptions
    cutting: DepthEpisode

    def _lay(self, key: SpecimenKey) -> None:
        assert key.target is not None  # a cut has one
        plant, supply = self.session.plant, self._source.supply
        if supply is not None and key.specimen is not None:
            cutting = self._cutting(plant, key.specimen.tissue, key.target, key)
            self._check_levels(cutting)
            supply.layers = cutting.layers_below() if self.options.layer else Layers()
        super()._lay(key)
        cutting = self._cutting(plant, self.tissue.tissue or measured_liver(), key.target, key)
        self._check_levels(cutting)
        self.session.operator.tell(f"The blade goes to a height of {1e3 * cutting.start_level:+.1f} mm, where it cuts.")
        self.session.start()
        plant.raise_to(cutting.start_level)
        plant.supervisor.lock()
        plant.begin()

    def _check_levels(self, cutting: DepthEpisode) -> None:
        """Raise RigError if the wanted depth is out of the reach of the height axis."""
        axis = self.settings.require_height_axis(by=self.task_name)
        last = int((cutting.target_length + AHEAD) * POINTS_PER_METRE)
        levels = (cutting.plant.depth - cutting.whole["wanted"][0])[: last + 1]
        low, high = float(levels.min()), float(levels.max())
        if low < axis.lowest or high > axis.highest:
            raise RigError(
                f"the wanted depth needs heights of {1e3 * low:.1f} to {1e3 * high:.1f} mm, and the rig's are "
                f"{1e3 * axis.lowest:g} to {1e3 * axis.highest:g} (height.lowest_mm, highest_mm). Take another wanted "
                "depth or specimen, or an axis that reaches there."
            )

    def _warm_up(self) -> None:
        super()._warm_up()
        practice = SimulatedPlant(Specimen.drawn(0, 0))
        self._cutting(practice, practice.specimen.tissue, 0.06, SpecimenKey(seed=0, episode=0)).layers_below()
