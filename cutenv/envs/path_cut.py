"""``cutenv/PathCut-v1`` and ``Excision-v1``: cut gently along a drawn line.

The blade is steered. An excision is one side of a fusiform one, cut from end to end.
"""

from __future__ import annotations

from typing import Any

from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.gymnasium_facts import described
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.task.path import PathOptions, to_path_action

__all__ = [
    "ExcisionEnv",
    "ExcisionVectorEnv",
    "HandExcisionEnv",
    "HandExcisionVectorEnv",
    "PathCutEnv",
    "PathCutVectorEnv",
    "to_path_action",
]


@described
class PathCutEnv(GentleCutEnv):
    """Cut gently from the clamp along a line to a target length.

    It is :class:`~cutenv.envs.gentle_cut.GentleCutEnv` with a blade that is also turned to the left and right.  The
    crack tip trails the blade and turns after the force, so that a blade that follows the line does not cut along it;
    cut and line are compared where the tip has passed.  Lengths, positions and distances are told along the line.  On
    the straight line, and with a blade that is not turned, it is ``cutenv/GentleCut-v1`` to the last bit.

    The law is described on the page "Cuts along a curve"; no measurement of a curved cut in liver is known to us.

    Action
    ------
    ``Box(-1, 1, (3,), float32)``; values outside are clipped, NaN is refused with a ValueError.

    {actions}

    Speed and turn have a dead zone: -0.1 to 0.1 is rest.  ``cutenv.envs.path_cut.to_path_action`` gives the action for
    a speed, an angle and a rate of turn.  The blade moves where it points; the rate of turn has no lag.

    Observation
    -----------
    ``{space}``: (value - offset) / scale, clipped; only what a rig can know.  The first 12
    are those of ``cutenv/GentleCut-v1``.

    {components}

    Tip, tissue and the cut are hidden.

    Reward
    ------
    That of ``cutenv/GentleCut-v1``, less two costs of a map of the cut, which has its distance to the line wherever the
    tip has passed.  Cost and limit of force are of the force in the plane, whose part to the side counts too; so does
    tissue that is left loaded to the side.

    {terms}

    Ends
    ----
    Those of ``cutenv/GentleCut-v1``, and

    {ends}

    The limit is 8 mm.  A blade is unloaded if neither the part of its force along the line nor that across it holds it:
    turned across its way, a loaded blade feels little along itself.

    Success is that of ``cutenv/GentleCut-v1`` with a mean distance between cut and line of at most 1 mm along the
    length that is cut, and a largest one of at most 3 mm.

    Arguments
    ---------
    ========= ======= =================================================================================
    Keyword   Default Meaning
    ========= ======= =================================================================================
    line      "mixed" "straight", "arc", "s", "excision", "random", "mixed" (one of these), or a line
    ========= ======= =================================================================================

    "fusiform" is one side of an excision, whose end is the target, as in ``cutenv/Excision-v1``; "mixed" draws none.
    There are 64 lines of each kind, the same for everybody, of which the seed draws one.  A given line is a
    :class:`~cutenv.sim.tissue.lines.CutLine`, or places [m] from the clamp (0, 0) on, shape (n, 2), through which it is
    drawn; one that turns back, bends too far or leaves the slab less than 30 mm beyond the target is refused with the
    place.

    The others are those of ``cutenv/GentleCut-v1``, of which ``relaxing_share`` cannot be changed, and
    {keywords}.

    Info
    ----
    That of ``cutenv/GentleCut-v1``; ``reward_terms`` has the two costs; ``truth`` also has

    {truth}

    and ``path`` has the errors of the cut so far:

    {errors}

    Version history
    ---------------
    v1: the first version; may change until the first comparison of agents is published.
    """

    options_class = PathOptions


class PathCutVectorEnv(GentleCutVectorEnv):
    """Many ``cutenv/PathCut-v1``, each bit for bit as alone."""

    single_class = PathCutEnv


class ExcisionOptions(PathOptions):
    """Options of cutting one side of a fusiform excision."""

    usual = "fusiform"


@described
class ExcisionEnv(PathCutEnv):
    """Cut one side of a fusiform excision, end to end, gently.

    To take out a piece of tissue surgeons cut around it along two arcs that meet at both ends, in the shape of a
    spindle: a fusiform, or elliptical, excision.  Each cut here is one of the two arcs.  Its ends lie on the axis of
    the slab, the first one at the clamp.

    Action, observation, reward, ends and info are those of :class:`~cutenv.envs.path_cut.PathCutEnv`, and so is the
    law.  What differs is the line, and the target, which is the end of the line:

    ============================== ===========================
    Quantity                       Range
    ============================== ===========================
    length over width of the whole 2.5 to 4
    angle of a side to the axis    25 to 45 degrees, at the ends
    length of one side             60 to 100 mm
    side                           left or right
    ============================== ===========================

    A side is symmetrical, so that it is the same cut from either end.  There are 64 of them, the same for everybody, of
    which the seed draws one.

    Here a rig leads the blade.  In ``cutenv/HandExcision-v1`` a hand does, which yields to the force along the cut.

    Arguments
    ---------
    Those of ``cutenv/PathCut-v1``, of which ``line`` is "fusiform" unless it is given, among them {keywords}.

    Version history
    ---------------
    v1: the first version; may change until the first comparison of agents is published.
    """

    options_class = ExcisionOptions


class ExcisionVectorEnv(GentleCutVectorEnv):
    """Many ``cutenv/Excision-v1``, each bit for bit as alone."""

    single_class = ExcisionEnv


@described
class HandExcisionEnv(ExcisionEnv):
    """Cut one side of a fusiform excision with a yielding hand.

    The hand yields along the cut.  It is :class:`ExcisionEnv` with ``drive="hand"``: a spring and a damper join hand
    and blade, so that the blade stays behind the hand where the tissue holds it, and lurches where the crack runs.  To
    the side, and in its direction, the blade goes where the hand leads it.

    Arguments
    ---------
    Those of ``cutenv/Excision-v1``, among them {keywords}.

    Version history
    ---------------
    v1: the first version; may change until the first comparison of agents is published.
    """

    def __init__(self, *, drive: str = "hand", **keywords: Any) -> None:
        super().__init__(drive=drive, **keywords)


class HandExcisionVectorEnv(GentleCutVectorEnv):
    """Many ``cutenv/HandExcision-v1``, each bit for bit as alone."""

    single_class = HandExcisionEnv
