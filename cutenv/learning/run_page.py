"""Parts of the page of a training run that are the same on every task: a typical cut, its picture, facts of the run."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from cutenv.learning.batched_rollout import batched_rollout
from cutenv.learning.evaluation import Contestant
from cutenv.report import CutPicture
from cutenv.task.registry import task_of


def typical(rows: Sequence[Mapping[str, Any]], seeds: Sequence[int], agent: str) -> int:
    """Return the specimen on which the agent's return is its median: neither a good nor a bad example."""
    own = sorted((row["return"], row["seed"]) for row in rows if row["policy"] == agent)
    assert len(own) == len(seeds)
    return int(own[len(own) // 2][1])


def cut_picture(name: str, one: Contestant, seed: int, shared: Mapping[str, Any]) -> CutPicture:
    """Let a policy cut a specimen, for a picture."""
    arguments = {**shared, **one.arguments}
    task, own = task_of(arguments)
    (cut,) = batched_rollout(one.policy, [seed], arguments, readings=True)
    scores, shown = cut.scores(), cut.shown_depth
    return CutPicture(
        policy=name,
        caption=f"{scores['end']}, return {scores['return']:.2f}, tip error {scores['tip_error_mm']:.1f} mm",
        readings=cut.readings,
        depth=cut.depth if shown is None else np.clip(shown.surface - shown.wanted, 0.0, None),
        target_length=cut.truth["target_length_m"],
        force_limit_per_depth=task.single(**own).force_limit_per_depth,
        shown_depth=shown,
    )


def shown_facts(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return the facts about a run that its page shows."""
    arguments = facts["arguments"]
    result = {
        "specimen class": arguments["specimen_class"],
        "held-out specimens": str(arguments["specimens"]),
        "seed": str(arguments["seed"]),
        "decisions": f"{arguments['timesteps' if 'timesteps' in arguments else 'demonstrations']:,}".replace(",", " "),
        "environment": facts["environment"],
        "commit": facts["commit"] or "unknown",
    }
    if "dataset" in facts.get("taught_by", {}):
        data = facts["taught_by"]
        result["taught by"] = f"data set {data['dataset']}: {data['cuts']} cuts by {data['source']}"
    if "training_minutes" in facts:
        result["training took"] = f"{facts['training_minutes']} minutes"
    if facts.get("level_with_script_after_s") is not None:
        result["level with its teacher after"] = f"{facts['level_with_script_after_s']:.0f} s"
    if "environments_share" in facts:
        result["of that, the environments"] = f"{100.0 * facts['environments_share']:.0f} %"
    result |= {f"seeds of {name}": f"{first} to {last}" for name, (first, last) in facts["seeds"].items()}
    return result | {f"{name} version": version for name, version in facts["versions"].items()}


def chosen_at(curve: Sequence[Mapping[str, float]]) -> int | None:
    """Return the number of decisions before the checkpoint that did best on validation specimens; None without one."""
    validated = [point for point in curve if "validation_return" in point]
    chosen = max(validated, key=lambda point: point["validation_return"], default=None)
    return None if chosen is None else int(chosen["decisions"])
