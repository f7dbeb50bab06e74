"""``cutenv/Excision-v1``: cut one side of a fusiform excision gently, from end to end, by a blade that is steered."""

from __future__ import annotations

from typing import Any

from cutenv.envs.described import described
from cutenv.envs.path_cut import PathCutEnv
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.task.path import PathOptions

__all__ = ["ExcisionEnv", "ExcisionVectorEnv", "HandExcisionEnv", "HandExcisionVectorEnv"]


class ExcisionOptions(PathOptions):
    """Options of cutting one side of a fusiform excision."""

    usual = "fusiform"


@described
class ExcisionEnv(PathCutEnv):
    """Cut one side of a fusiform excision from its one end to the other, gently.

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
    """Many ``cutenv/Excision-v1``, bit for bit equal to single ones with the same seeds and actions."""

    single_class = ExcisionEnv


@described
class HandExcisionEnv(ExcisionEnv):
    """Cut one side of a fusiform excision with a hand that yields to the force along the cut.

    It is :class:`ExcisionEnv` with ``drive="hand"``: a spring and a damper join hand and blade, so that the blade stays
    behind the hand where the tissue holds it, and lurches where the crack runs.  To the side, and in its direction, the
    blade goes where the hand leads it.

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
    """Many ``cutenv/HandExcision-v1``, bit for bit equal to single ones with the same seeds and actions."""

    single_class = HandExcisionEnv
