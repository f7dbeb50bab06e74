"""``cutenv/DepthCut-v1``: cut to a target length along a wanted depth, without opening the layer below."""

from __future__ import annotations

from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.task.depth import DepthOptions, to_depth_action

__all__ = ["DepthCutEnv", "DepthCutVectorEnv", "to_depth_action"]


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

    The others are those of ``cutenv/GentleCut-v1``, and ``edge_length``, ``bedding``, ``vertical_lag``,
    ``vertical_acceleration``, ``response_time``, ``layer_limit``, ``vertical_noise``, ``vertical_resolution``,
    ``weight_too_deep``, ``weight_uncut``, ``weight_layer_area``, ``weight_layer_depth``, ``surface_spread`` (0 with
    ``wanted="profile"``), ``surface_length``.  With ``reward_from="estimate"`` the floor is that which the mean tissue
    would have under this blade, and no cut ends in the layer below, which no rig sees.

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

    options_class = DepthOptions


class DepthCutVectorEnv(GentleCutVectorEnv):
    """Many ``cutenv/DepthCut-v1``, bit for bit equal to single ones with the same seeds and actions."""

    single_class = DepthCutEnv
