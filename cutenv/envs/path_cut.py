"""``cutenv/PathCut-v1``: cut gently to a target length along a drawn line, by a blade that is steered."""

from __future__ import annotations

from cutenv.envs.described import described
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.vector import GentleCutVectorEnv
from cutenv.task.path import PathOptions, to_path_action

__all__ = ["PathCutEnv", "PathCutVectorEnv", "to_path_action"]


@described
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
    :class:`~cutenv.tissue.lines.CutLine`, or places [m] from the clamp (0, 0) on, shape (n, 2), through which it is
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
    """Many ``cutenv/PathCut-v1``, bit for bit equal to single ones with the same seeds and actions."""

    single_class = PathCutEnv
