"""``cutenv/Excision-v1``: cut one side of a fusiform excision gently, from end to end, by a blade that is steered."""

from __future__ import annotations

from cutenv.envs.described import described
from cutenv.envs.path_cut import PathCutEnv
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.task.path import PathOptions

__all__ = ["ExcisionEnv", "ExcisionVectorEnv"]


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

    Two versions are compared: a rig that leads the blade, and with ``drive="hand"`` a hand that yields to the force
    along the cut, so that the blade lurches where the crack runs.

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
