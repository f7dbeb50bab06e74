"""Reports of training runs on any task.

Agent, scripts and planner on held-out specimens, as tables, picture, page.
"""

from __future__ import annotations

import csv
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from cutenv.agents.learning.evaluation import Contestant, batched_rollout, contestant, evaluate
from cutenv.agents.learning.option_fields import class_in_words, drawn_as
from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.learning.statistics import best_script, differences, read_rows, summarise, write_csv
from cutenv.agents.policy import BASELINES, CONSTANT_FEEDS, NULL_POLICIES, ORACLE, SCRIPTS, RandomAction
from cutenv.display.report import CutPicture, TrainingResult, draw_cut, training_headline, write_training_page
from cutenv.display.report.training_result import COLUMNS, Score, columns_of, comparison_table, differences_table
from cutenv.task.registry import task_of


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


_FEWER = 4  # times fewer specimens for the planner, of which a cut takes as long as hundreds of others
_MORE_SPECIMENS = 5  # times as many specimens for agent and scripts, so that chance does not hide their differences


def compare_task(run: Path, facts: Mapping[str, Any], *, processes: int | None = None) -> None:
    """Evaluate the agent of a run, every script and the planner.

    Write scores and paired differences into its folder, and print them; ``facts`` are those of its ``run.json``.
    """
    arguments, agent = facts["arguments"], facts["agent"]
    task, _ = task_of({"task": arguments["task"]})
    learned = {agent: contestant(str(run / "policy"))}
    if (run / "untrained" / "card.json").is_file():
        learned[f"{agent} untrained"] = contestant(str(run / "untrained"))
    shared = {"task": arguments["task"], "angle_mode": arguments["angle_mode"], **drawn_as(arguments)}
    if arguments["angle_mode"] == "fixed":
        shared["fixed_angle_deg"] = arguments["fixed_angle_deg"]
    if facts.get("simulated_rig"):
        shared |= {**facts["simulated_rig"], "control_hz": arguments["control_hz"]}
    scripts = {name: Contestant(task.scripts[name]()) for name in task.scripts}
    few = TEST_SEEDS[: arguments["specimens"]]
    planner = {ORACLE: Contestant(task.planner(), specimens=max(len(few) // _FEWER, 2))} if task.planner else {}
    rows = evaluate({**learned, **scripts, **planner}, few, shared, processes=processes)
    write_csv(run / "scores.csv", rows)
    summary = summarise(rows)
    write_csv(run / "summary.csv", summary)
    more = TEST_SEEDS[len(few) : _MORE_SPECIMENS * len(few)]
    closer = {agent: learned[agent], **scripts}
    further = evaluate(closer, more, shared, processes=processes, description="comparing")
    write_csv(run / "comparison.csv", further)
    paired = differences([*rows, *further], agent)
    write_csv(run / "differences.csv", paired)
    write_run_page(run, facts, ComparedCuts(rows, paired), {**learned, **scripts}, shared)

    print(f"\n{task_headline(agent, paired, task.scripts)}")
    print(f"\n{len(few)} held-out specimens of {class_in_words(arguments)}, mean [95 % interval]\n")
    print_compared(summary, paired, columns_of(task))
    fewer = "".join(f"; {name}: on {one.specimens}" for name, one in planner.items())
    print(f"({', '.join(scripts)}: on {len(few) + len(more)} specimens{fewer})")
    print(f"\nWritten to {run}/: report.html (open it in a browser), policy/ (safetensors and card, needs no torch),")
    print("scores.csv and comparison.csv (every cut), summary.csv, differences.csv, learning_curve.csv, run.json")


class ComparedCuts(NamedTuple):
    """All policies' cuts, with paired differences of the agent."""

    rows: Sequence[Mapping[str, Any]]
    paired: Sequence[Mapping[str, Any]]


def write_run_page(
    run: Path,
    facts: Mapping[str, Any],
    compared: ComparedCuts,
    contestants: Mapping[str, Contestant],
    shared: Mapping[str, Any],
) -> None:
    """Write the page of a run, ``report.html``, for its agent and scripts."""
    arguments, agent, summary = facts["arguments"], facts["agent"], summarise(compared.rows)
    task, _ = task_of(shared)
    script = best_script(summary, task.scripts)
    seed = typical(compared.rows, TEST_SEEDS[: arguments["specimens"]], agent)
    curve = read_rows(run / "learning_curve.csv")
    write_training_page(
        run / "report.html",
        TrainingResult(
            title=f"Learning to cut {task.along}: {run.name}",
            subtitle=f"{agent} on simulated slices of {_tissue(arguments)}, class {arguments['specimen_class']}",
            facts=shown_facts(facts),
            summary=summary,
            differences=compared.paired,
            agent=agent,
            best_script=script,
            rival_script=None,
            bound=ORACLE if task.planner else None,
            grid=(),
            cuts=[cut_picture(name, contestants[name], seed, shared) for name in (agent, script)],
            curve=curve,
            chosen_at=chosen_at(curve),
            columns=columns_of(task),
        ),
    )


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
_MORE = 20  # times as many specimens for agent and best scripts, so that chance does not hide their differences


def compare(
    run: Path, facts: Mapping[str, Any], *, processes: int | None = None, baselines_of: Path | None = None
) -> None:
    """Evaluate the agent of a run and all baselines.

    Write and print the scores, draw a cut, write the page; ``facts`` are those of its ``run.json``.  ``baselines_of``
    is another run on the same specimens, whose scores of the baselines are reused: they would be the same.  The report
    of a run on another task is that of :func:`compare_task`.

    Raises ValueError if the other run is on other specimens, or the task has other baselines.
    """
    arguments, agent = facts["arguments"], facts["agent"]
    task = arguments.get("task", "gentle")
    if task != "gentle":
        if baselines_of is not None:
            raise ValueError(f"{run} is of task {task}, whose baselines are not reused; leave out --baselines-of.")
        compare_task(run, facts, processes=processes)
        return
    learned = {agent: run / "policy"}
    if (run / "untrained" / "card.json").is_file():
        learned[f"{agent} untrained"] = run / "untrained"
    seeds = TEST_SEEDS[: arguments["specimens"]]
    shared = {"angle_mode": arguments["angle_mode"], **drawn_as(arguments)}
    if arguments["angle_mode"] == "fixed":
        shared["fixed_angle_deg"] = arguments.get("fixed_angle_deg", 90.0)
    rate = {"control_hz": arguments["control_hz"]}
    if facts.get("simulated_rig"):  # on a slow rig scripts decide no faster than the agent
        shared |= {**facts["simulated_rig"], **rate}
    contestants = {
        **{name: contestant(str(folder)) for name, folder in learned.items()},
        **{name: Contestant(make()) for name, make in BASELINES.items()},
        ORACLE: Contestant(BASELINES[ORACLE](), specimens=max(len(seeds) // _FEWER, 2)),
        "random": Contestant(RandomAction(), rate),  # at the agent's rate: rarer changes move the blade further
    }
    own = {name: one for name, one in contestants.items() if baselines_of is None or name in learned}
    rows = evaluate(own, seeds, shared, processes=processes)
    if baselines_of is not None:
        known = {name: seeds[: one.specimens] for name, one in contestants.items() if name not in own}
        rows += known_rows(baselines_of / "scores.csv", known)
    write_csv(run / "scores.csv", rows)
    summary = summarise(rows)
    write_csv(run / "summary.csv", summary)
    script = best_script(summary, [*CONSTANT_FEEDS, *SCRIPTS])
    teacher = arguments.get("script") if arguments.get("demonstrations") else None
    others = [name for name in (*CONSTANT_FEEDS, *SCRIPTS) if name != teacher]
    rival = best_script(summary, others) if script == teacher else None
    feed = best_script(summary, CONSTANT_FEEDS)
    shown = [*learned, feed, *SCRIPTS, ORACLE, *NULL_POLICIES]
    more = TEST_SEEDS[len(seeds) : _MORE * len(seeds)]
    closer = {name: contestants[name] for name in (agent, script, rival) if name is not None}
    further = evaluate(closer, more, shared, processes=processes, description="comparing")
    write_csv(run / "comparison.csv", further)
    paired = differences(
        [row for row in rows if row["policy"] in shown and row["policy"] not in (script, rival)], agent
    )
    paired += differences([row for row in rows + further if row["policy"] in closer], agent)
    write_csv(run / "differences.csv", paired)

    seed = typical(rows, seeds, agent)
    cuts = [cut_picture(name, contestants[name], seed, shared) for name in (agent, script)]
    draw_cut(run / "cut.png", cuts[0], f"{agent} on held-out specimen {seed}: {cuts[0].caption}")
    curve = read_rows(run / "learning_curve.csv")
    result = TrainingResult(
        title=f"Learning to cut gently: {run.name}",
        subtitle=f"{agent} on simulated slices of {_tissue(arguments)}, class {arguments['specimen_class']}",
        facts=shown_facts(facts),
        summary=[row for row in summary if row["policy"] in shown],
        differences=paired,
        agent=agent,
        best_script=script,
        rival_script=rival,
        bound=ORACLE,
        grid=grid_rows(summary),
        cuts=cuts,
        curve=curve,
        chosen_at=chosen_at(curve),
    )
    write_training_page(run / "report.html", result)
    print(f"\n{training_headline(result)[2]}")
    print(f"\n{len(seeds)} held-out specimens of {class_in_words(arguments)}, mean [95 % interval]\n")
    near = [row for row in paired if row["baseline"] in (script, rival, feed, ORACLE)]
    print_compared(result.summary, near, COLUMNS[:5])
    nearest = " and ".join(name for name in closer if name != agent)
    print(f"({nearest}: on {len(seeds) + len(more)} specimens; {ORACLE}: on {contestants[ORACLE].specimens})")
    print(f"\nWritten to {run}/: report.html (open it in a browser), policy/ (safetensors and card, needs no torch),")
    print(
        "scores.csv and comparison.csv (every cut), summary.csv, differences.csv, learning_curve.csv, run.json, cut.png"
    )


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
