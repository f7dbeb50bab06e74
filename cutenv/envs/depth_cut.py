"""``cutenv/DepthCut-v1``: cut along a wanted depth, above a lower layer."""

from __future__ import annotations

from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.gymnasium_facts import described
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.task.depth import DepthOptions, to_depth_action

__all__ = ["DepthCutEnv", "DepthCutVectorEnv", "to_depth_action"]


@described
class DepthCutEnv(GentleCutEnv):
    """Cut gently along a wanted depth, without opening the layer below.

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

    {actions}

    Speed and descent have a dead zone: -0.1 to 0.1 is rest.  ``cutenv.envs.depth_cut.to_depth_action`` gives the action
    for two speeds and an angle.

    Observation
    -----------
    ``{space}``: (value - offset) / scale, clipped; only what a rig can know.  The first 12
    are those of ``cutenv/GentleCut-v1``; ``depth`` is that of a blade at level 0.

    {components}

    The surface of each slice differs, by 2 mm from that of the mean liver, and was measured beforehand with an error of
    0.5 mm.  Tip, toughness and the layer below are hidden.

    Reward
    ------
    That of ``cutenv/GentleCut-v1``, less four costs of a map of the cut, which has the depth of its floor wherever the
    tip has passed.  They are charged as they grow; what is left uncut is refunded when it is cut later.

    {terms}

    Ends
    ----
    Those of ``cutenv/GentleCut-v1``, and

    {ends}

    The limit is 3 mm.  A blade that is pressed on the floor, or hangs on it, is not unloaded; a floor that an end
    leaves pressed is charged as stored energy.

    Success is that of ``cutenv/GentleCut-v1`` with a mean error of the depth of at most 1.5 mm along the length that is
    cut, and the layer below not opened deeper than 0.5 mm.

    Arguments
    ---------
    ========= ======= =================================================================================
    Keyword   Default Meaning
    ========= ======= =================================================================================
    wanted    "mixed" "constant", "ramp", "step", "mixed" (one of these) or "profile" (level 0)
    layer     None    True: another layer below; None: unless ``wanted`` is "profile"
    ========= ======= =================================================================================

    The others are those of ``cutenv/GentleCut-v1``, and
    {keywords}.
    ``surface_spread`` is 0 with ``wanted="profile"``.  With ``reward_from="estimate"`` the floor is that which the mean
    tissue would have under this blade, and no cut ends in the layer below, which no rig sees.

    Info
    ----
    That of ``cutenv/GentleCut-v1``; ``reward_terms`` has the four costs; ``truth`` also has

    {truth}

    and ``depth`` has the errors of the cut so far:

    {errors}

    Version history
    ---------------
    v1: the first version; may change until the first comparison of agents is published.
    """

    options_class = DepthOptions


class DepthCutVectorEnv(GentleCutVectorEnv):
    """Many ``cutenv/DepthCut-v1``, each bit for bit as alone."""

    single_class = DepthCutEnv
