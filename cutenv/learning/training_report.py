"""Report of a training run: its agent and every baseline on held-out specimens, as tables, picture and page."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cutenv.learning.evaluation import Contestant, contestant, evaluate
from cutenv.learning.result_tables import SHOWN, print_differences, print_table, read_rows, write_csv
from cutenv.learning.run_page import chosen_at, cut_picture, shown_facts, typical
from cutenv.learning.seeds import TEST_SEEDS
from cutenv.learning.statistics import best_script, differences, summarise
from cutenv.learning.task_report import compare_task
from cutenv.policy import BASELINES, CONSTANT_FEEDS, NULL_POLICIES, ORACLE, SCRIPTS, RandomAction
from cutenv.report import TrainingResult, draw_cut, training_headline, write_training_page

_TEXTS = ("policy", "specimen_class", "end")
_MORE = 20  # times as many specimens for agent and best scripts, so that chance does not hide their differences


def compare(
    run: Path, facts: Mapping[str, Any], *, processes: int | None = None, baselines_of: Path | None = None
) -> None:
    """Evaluate the agent of a run and all baselines; write and print the scores, draw a cut, write the page.

    The report of a run on another task is that of :func:`~cutenv.learning.task_report.compare_task`.

    Parameters
    ----------
    run : Path
        Folder of the run, into which everything is written.
    facts : mapping
        Content of its ``run.json``.
    processes : int, optional
        Number of processes; default one per core.
    baselines_of : Path, optional
        Another run on the same specimens, whose scores of the baselines are reused: they would be the same.

    Raises
    ------
    ValueError
        If the other run is on other specimens, or the task has other baselines.
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
    shared = {"specimen_class": arguments["specimen_class"], "angle_mode": arguments["angle_mode"]}
    if arguments["angle_mode"] == "fixed":
        shared["fixed_angle_deg"] = arguments.get("fixed_angle_deg", 90.0)
    rate = {"control_hz": arguments["control_hz"]}
    if facts.get("simulated_rig"):  # on a slow rig scripts decide no faster than the agent
        shared |= {**facts["simulated_rig"], **rate}
    contestants = {
        **{name: contestant(str(folder)) for name, folder in learned.items()},
        **{name: Contestant(make()) for name, make in BASELINES.items()},
        "random": Contestant(RandomAction(), rate),  # at the agent's rate: rarer changes move the blade further
    }
    own = {name: one for name, one in contestants.items() if baselines_of is None or name in learned}
    rows = evaluate(own, seeds, shared, processes=processes)
    if baselines_of is not None:
        rows += known_rows(baselines_of / "scores.csv", [name for name in contestants if name not in own], seeds)
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
        subtitle=f"{agent} on simulated slices of measured liver, class {arguments['specimen_class']}",
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
    print(f"\n{len(seeds)} held-out specimens of class {arguments['specimen_class']}, mean [95 % interval]\n")
    print_table([row for row in summary if row["policy"] in shown], SHOWN[:4] + SHOWN[5:])
    print_differences([row for row in paired if row["baseline"] in (script, rival, feed, ORACLE)])
    print(f"({' and '.join(name for name in closer if name != agent)}: on {len(seeds) + len(more)} specimens)")
    print(f"\nWritten to {run}/: report.html (open it in a browser), policy/ (safetensors and card, needs no torch),")
    print(
        "scores.csv and comparison.csv (every cut), summary.csv, differences.csv, learning_curve.csv, run.json, cut.png"
    )


def known_rows(path: Path, policies: Sequence[str], seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Read the rows of these policies from another comparison; ValueError unless it is on the same specimens."""
    with path.open(encoding="utf-8") as file:
        rows = [row for row in csv.DictReader(file) if row["policy"] in policies]
    result: list[dict[str, Any]] = [
        {name: value if name in _TEXTS else float(value) for name, value in row.items()} | {"seed": int(row["seed"])}
        for row in rows
    ]
    for policy in policies:
        if [row["seed"] for row in result if row["policy"] == policy] != list(seeds):
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
