"""Glossary for a page's readers who did not write the task."""

from __future__ import annotations

import math
from collections.abc import Iterable

from cutenv.task.registry import TASKS
from cutenv.task.reward import FORCE_ALLOWED, LAG_ALLOWED, REWARD
from cutenv.task.weights import RewardWeights
from cutenv.task_quantities import ANGLE_TOLERANCE, TIP_TOLERANCE

_IDLE_COST = RewardWeights().time
"""Cost of doing nothing: the whole time."""


def term_meanings() -> dict[str, str]:
    """Return the title of each term of the reward, of every task."""
    return {one.name: one.title for one in (*REWARD, *(cost for task in TASKS.values() for cost in task.task.costs))}


def further_meanings(scores: Iterable[str]) -> list[tuple[str, str]]:
    """Return titles and meanings of those of the ``scores`` that a task declares besides gentle cutting."""
    declared = {one.name: one.glossary for task in TASKS.values() for one in task.task.errors if one.glossary}
    return [declared[name] for name in scores if name in declared]


MEANINGS = (
    (
        "Return",
        "The rewards of one cut added up: what is gained by progress, accuracy and success, which comes to 1 for a "
        f"perfect cut, less what was not gentle. Doing nothing gets \u2212{_IDLE_COST:.2f}.",
    ),
    (
        "Success",
        "The share of cuts that ended unloaded, at rest or drawn back, with the crack tip within "
        f"{1e3 * TIP_TOLERANCE:g} mm of the target and the blade within {math.degrees(ANGLE_TOLERANCE):g} degrees of "
        "upright.",
    ),
    ("Tip error", "How far the crack tip is from the target at the end. The tip counts, not the blade, and is hidden."),
    (
        "Jump, uncontrolled share",
        "Tissue does not part evenly: when the force is high enough, the crack runs ahead by itself. A jump is the "
        "length of one such run; the uncontrolled share is the part of the whole cut made by them.",
    ),
    (
        "Force per depth",
        "The force on the blade divided by how deep the tissue is there. Thick tissue needs more force, so the force "
        f"alone would blame the tissue. Above {FORCE_ALLOWED:g} N/m it costs; at the force limit the cut is ended for "
        "safety.",
    ),
    ("Lag", f"How far the blade leads the crack tip, dragging tissue along; it costs above {1e3 * LAG_ALLOWED:g} mm."),
    ("Wedge", "What stays uncut below a blade that ends inclined: its edge leans ahead of its foot."),
    (
        "Held-out specimen",
        "A piece of tissue that was used neither to train nor to choose the agent. All policies cut the same ones.",
    ),
    (
        "95 % interval",
        "In brackets or as a line: from repeated evaluations on other specimens, about 95 of 100 such intervals would "
        "hold the true mean. It covers chance in the specimens, not in the training: this is one training run.",
    ),
    (
        "Paired difference",
        "Agent minus baseline on the same specimen, then averaged. Easy and hard specimens cancel, so it decides what "
        "two intervals side by side may leave open: a difference counts where its interval does not hold 0.",
    ),
    (
        "Upper bound",
        "A planner that knows the hidden tip and the tissue. No agent can know as much, so it is not a competitor: it "
        "shows how much there is to gain.",
    ),
)
"""Terms with their meanings, for a reader who did not write the task."""

LIMITS = (
    "The tissue is simulated. Its stiffness and its resistance to cutting are drawn from measured values of pig liver; "
    "friction, drive and sensor are partly assumed. Nothing here has been validated for assessing or credentialing "
    "people, for other tissue or for an operation, and one training run does not predict another."
)
"""Limits of the page's numbers."""
