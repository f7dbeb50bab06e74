"""Reports of training runs on any task.

Agent, scripts and planner on held-out specimens, as tables, picture, page.
"""

from __future__ import annotations

import csv
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.agents.learning.evaluation import Contestant, batched_rollout, contestant, evaluate
from cutenv.agents.learning.option_fields import class_in_words, drawn_as
from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.learning.statistics import best_script, differences, read_rows, summarise, write_csv
from cutenv.agents.policy import CONSTANT_FEEDS, NULL_POLICIES, ORACLE, SCRIPTS, RandomAction
from cutenv.display.report import CutPicture, TrainingResult, draw_cut, training_headline, write_training_page
from cutenv.display.report.training_result import COLUMNS, Score, columns_of, comparison_table, differences_table
from cutenv.task.registry import TASKS, task_of


def typical(rows: Sequence[Mapping[str, Any]], seeds: Sequence[int], agent: str) -> int:
    """Return the specimen on which the agent's return is its median."""
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


def _tissue(arguments: Mapping[str, Any]) -> str:
    return arguments.get("tissue") or "measured liver"


def shown_facts(facts: Mapping[str, Any]) -> dict[str, str]:
    """Return the facts about a run that its page shows."""
    arguments = facts["arguments"]
    result = {
        "tissue": _tissue(arguments),
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
    """Return the decisions before the checkpoint best in validation, or None."""
    validated = [point for point in curve if "validation_return" in point]
    chosen = max(validated, key=lambda point: point["validation_return"], default=None)
    return None if chosen is None else int(chosen["decisions"])


def task_headline(agent: str, paired: Sequence[Mapping[str, Any]], scripts: Collection[str]) -> str:
    """Return sentences on whether an agent beats every script."""
    returns = [row for row in paired if row["baseline"] in scripts and row["score"] == "return"]
    nearest = min(returns, key=lambda row: float(row["low_95"]))
    interval = f"{nearest['mean']:+.3f} [{nearest['low_95']:+.3f}, {nearest['high_95']:+.3f}]"
    lost = [row["baseline"] for row in returns if row["high_95"] < 0.0]
    if lost:
        claim = f"{agent} does not beat every script: {' and '.join(lost)} {'is' if len(lost) == 1 else 'are'} better."
    elif nearest["low_95"] > 0.0:
        claim = f"{agent} beats every script."
    else:
        claim = f"Whether {agent} beats every script is open."
    return (
        f"{claim} On the same {nearest['cuts']} held-out specimens, its return less that of {nearest['baseline']} is "
        f"{interval}."
    )


def print_compared(
    summary: Sequence[Mapping[str, Any]], paired: Sequence[Mapping[str, Any]], columns: Sequence[Score]
) -> None:
    """Print scores of policies, and any paired differences of the first."""
    print("\n".join(comparison_table(summary, columns).lines(right=True)))
    if paired:
        print(f"\n{paired[0]['policy']} minus each other on the same specimens, mean [95 % interval]\n")
        print("\n".join(differences_table(paired).lines(right=True)))


_TEXTS = ("policy", "specimen_class", "end")
_FEWER = 4  # times fewer specimens for the planner, of which a cut takes as long as hundreds of others
# times as many specimens for the agent and the scripts that it is compared with, so that chance does not hide their
# differences: the best ones of gentle cutting, all of another task
_MORE_OF_BEST, _MORE_OF_ALL = 20, 5


def _shared(facts: Mapping[str, Any]) -> dict[str, Any]:
    """Return the environment's arguments that agent and scripts share."""
    arguments = facts["arguments"]
    shared = {"task": arguments.get("task", "gentle"), "angle_mode": arguments["angle_mode"], **drawn_as(arguments)}
    if arguments["angle_mode"] == "fixed":
        shared["fixed_angle_deg"] = arguments.get("fixed_angle_deg", 90.0)
    if facts.get("simulated_rig"):  # on a slow rig scripts decide no faster than the agent
        shared |= {**facts["simulated_rig"], "control_hz": arguments["control_hz"]}
    return shared


def compare(
    run: Path, facts: Mapping[str, Any], *, processes: int | None = None, baselines_of: Path | None = None
) -> None:
    """Evaluate the agent of a run and all baselines of its task.

    Write and print the scores, draw a cut, write the page; ``facts`` are those of its ``run.json``.  ``baselines_of``
    is another run of gentle cutting on the same specimens, whose scores of the baselines are reused: they would be the
    same.

    Raises ValueError if the other run is on other specimens, or the task has other baselines.
    """
    arguments, agent, shared = facts["arguments"], facts["agent"], _shared(facts)
    task, _ = task_of(shared)
    is_gentle = task is TASKS["gentle"]
    if baselines_of is not None and not is_gentle:
        raise ValueError(f"{run} is of task {task.name}, whose baselines are not reused; leave out --baselines-of.")
    names = {agent: run / "policy", f"{agent} untrained": run / "untrained"}
    learned = {name: contestant(str(folder)) for name, folder in names.items() if (folder / "card.json").is_file()}
    seeds = TEST_SEEDS[: arguments["specimens"]]
    contestants = {**learned, **{name: Contestant(make()) for name, make in (task.policies or task.scripts).items()}}
    if task.planner:
        contestants[ORACLE] = Contestant(task.planner(), specimens=max(len(seeds) // _FEWER, 2))
    if is_gentle:  # at the agent's rate: rarer changes move the blade further
        contestants["random"] = Contestant(RandomAction(), {"control_hz": arguments["control_hz"]})
    own = {name: one for name, one in contestants.items() if baselines_of is None or name in learned}
    rows = evaluate(own, seeds, shared, processes=processes)
    if baselines_of is not None:
        known = {name: seeds[: one.specimens] for name, one in contestants.items() if name not in own}
        rows += known_rows(baselines_of / "scores.csv", known)
    write_csv(run / "scores.csv", rows)
    summary = summarise(rows)
    write_csv(run / "summary.csv", summary)
    if is_gentle:
        script = best_script(summary, [*CONSTANT_FEEDS, *SCRIPTS])
        teacher = arguments.get("script") if arguments.get("demonstrations") else None
        others = [name for name in (*CONSTANT_FEEDS, *SCRIPTS) if name != teacher]
        rival = best_script(summary, others) if script == teacher else None
        feed = best_script(summary, CONSTANT_FEEDS)
        shown = [*learned, feed, *SCRIPTS, ORACLE, *NULL_POLICIES]
        near, times = [name for name in (script, rival) if name is not None], _MORE_OF_BEST
    else:
        script, rival, shown = best_script(summary, task.scripts), None, list(contestants)
        near, times = list(task.scripts), _MORE_OF_ALL
    closer = {name: contestants[name] for name in (agent, *near)}
    more = TEST_SEEDS[len(seeds) : times * len(seeds)]
    further = evaluate(closer, more, shared, processes=processes, description="comparing")
    write_csv(run / "comparison.csv", further)
    paired = differences([row for row in rows if row["policy"] in shown and row["policy"] not in near], agent)
    paired += differences([row for row in rows + further if row["policy"] in closer], agent)
    write_csv(run / "differences.csv", paired)

    seed = typical(rows, seeds, agent)
    cuts = [cut_picture(name, contestants[name], seed, shared) for name in (agent, script)]
    if is_gentle:
        draw_cut(run / "cut.png", cuts[0], f"{agent} on held-out specimen {seed}: {cuts[0].caption}")
    curve = read_rows(run / "learning_curve.csv")
    result = TrainingResult(
        title=f"Learning to cut {task.along or 'gently'}: {run.name}",
        subtitle=f"{agent} on simulated slices of {_tissue(arguments)}, class {arguments['specimen_class']}",
        facts=shown_facts(facts),
        summary=[row for row in summary if row["policy"] in shown],
        differences=paired,
        agent=agent,
        best_script=script,
        rival_script=rival,
        bound=ORACLE if task.planner else None,
        grid=grid_rows(summary) if is_gentle else (),
        cuts=cuts,
        curve=curve,
        chosen_at=chosen_at(curve),
        columns=COLUMNS if is_gentle else columns_of(task),
    )
    write_training_page(run / "report.html", result)
    print(f"\n{training_headline(result)[2] if is_gentle else task_headline(agent, paired, task.scripts)}")
    print(f"\n{len(seeds)} held-out specimens of {class_in_words(arguments)}, mean [95 % interval]\n")
    if is_gentle:
        print_compared(result.summary, [row for row in paired if row["baseline"] in (*near, feed, ORACLE)], COLUMNS[:5])
    else:
        print_compared(summary, paired, result.columns)
    planned = f"; {ORACLE}: on {contestants[ORACLE].specimens}" if task.planner else ""
    print(f"({(' and ' if is_gentle else ', ').join(near)}: on {len(seeds) + len(more)} specimens{planned})")
    print(f"\nWritten to {run}/: report.html (open it in a browser), policy/ (safetensors and card, needs no torch),")
    files = "scores.csv and comparison.csv (every cut), summary.csv, differences.csv, learning_curve.csv, run.json"
    print(f"{files}, cut.png" if is_gentle else files)


def known_rows(path: Path, seeds: Mapping[str, Sequence[int]]) -> list[dict[str, Any]]:
    """Read policies' rows, for seeds by name, from another comparison; ValueError if specimens differ."""
    with path.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["policy"] in seeds]
    result: list[dict[str, Any]] = [
        {name: value if name in _TEXTS else float(value) for name, value in row.items()} | {"seed": int(row["seed"])}
        for row in rows
    ]
    for policy, own in seeds.items():
        if [row["seed"] for row in result if row["policy"] == policy] != list(own):
            raise ValueError(f"{path} contains other specimens of {policy!r} than this run; compare without it.")
    return result


def grid_rows(summary: Sequence[Mapping[str, Any]]) -> list[dict[str, float]]:
    """Return the table of return and success of every constant feed."""
    values = {(row["policy"], row["score"]): row for row in summary}
    return [
        {
            "speed_cm_s": speed,
            "angle_deg": float(angle),
            **{key: values[name, "return"][key] for key in ("mean", "low_95", "high_95")},
            "success": values[name, "success"]["mean"],
        }
        for name, (speed, angle) in CONSTANT_FEEDS.items()
    ]
