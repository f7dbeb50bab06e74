"""Report of a run on a task that adds to gentle cutting: agent, scripts and planner, as tables and a page."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cutenv.learning.evaluation import Contestant, contestant, evaluate
from cutenv.learning.result_tables import print_differences, print_table, read_rows, write_csv
from cutenv.learning.run_page import chosen_at, cut_picture, shown_facts, typical
from cutenv.learning.seeds import TEST_SEEDS
from cutenv.learning.statistics import best_script, differences, summarise
from cutenv.policy import ORACLE
from cutenv.report import TrainingResult, write_training_page
from cutenv.report.training_result import columns_of
from cutenv.task.registry import task_of

_MORE = 5  # times as many specimens for agent and scripts, so that chance does not hide their differences


def compare_task(run: Path, facts: Mapping[str, Any], *, processes: int | None = None) -> None:
    """Evaluate the agent of a run, every script and the planner; write and print scores and paired differences.

    Parameters
    ----------
    run : Path
        Folder of the run, into which the tables are written.
    facts : mapping
        Content of its ``run.json``.
    processes : int, optional
        Number of processes; default one per core.
    """
    arguments, agent = facts["arguments"], facts["agent"]
    task, _ = task_of({"task": arguments["task"]})
    learned = {agent: contestant(str(run / "policy"))}
    if (run / "untrained" / "card.json").is_file():
        learned[f"{agent} untrained"] = contestant(str(run / "untrained"))
    shared = {name: arguments[name] for name in ("task", "specimen_class", "angle_mode")}
    if arguments["angle_mode"] == "fixed":
        shared["fixed_angle_deg"] = arguments["fixed_angle_deg"]
    if facts.get("simulated_rig"):
        shared |= {**facts["simulated_rig"], "control_hz": arguments["control_hz"]}
    scripts = {name: Contestant(task.scripts[name]()) for name in task.scripts}
    few = TEST_SEEDS[: arguments["specimens"]]
    planner = {ORACLE: Contestant(task.planner())} if task.planner else {}
    rows = evaluate({**learned, **scripts, **planner}, few, shared, processes=processes)
    write_csv(run / "scores.csv", rows)
    summary = summarise(rows)
    write_csv(run / "summary.csv", summary)
    more = TEST_SEEDS[len(few) : _MORE * len(few)]
    closer = {agent: learned[agent], **scripts}
    further = evaluate(closer, more, shared, processes=processes, description="comparing")
    write_csv(run / "comparison.csv", further)
    paired = differences([*rows, *further], agent)
    write_csv(run / "differences.csv", paired)
    write_run_page(run, facts, ComparedCuts(rows, paired), {**learned, **scripts}, shared)

    print(f"\n{task_headline(agent, paired, task.scripts)}")
    print(f"\n{len(few)} held-out specimens of class {arguments['specimen_class']}, mean [95 % interval]\n")
    print_table(summary, task.shown)
    print_differences(paired)
    print(f"({', '.join(scripts)}: on {len(few) + len(more)} specimens)")
    print(f"\nWritten to {run}/: report.html (open it in a browser), policy/ (safetensors and card, needs no torch),")
    print("scores.csv and comparison.csv (every cut), summary.csv, differences.csv, learning_curve.csv, run.json")


class ComparedCuts(NamedTuple):
    """Every cut that all policies made, and the paired differences of the agent."""

    rows: Sequence[Mapping[str, Any]]
    paired: Sequence[Mapping[str, Any]]


def write_run_page(
    run: Path,
    facts: Mapping[str, Any],
    compared: ComparedCuts,
    contestants: Mapping[str, Contestant],
    shared: Mapping[str, Any],
) -> None:
    """Write the page of a run, ``report.html``.

    Parameters
    ----------
    run, facts
        Those of :func:`compare_task`.
    compared : ComparedCuts
    contestants : mapping of str to Contestant
        Agent and scripts by name.
    shared : mapping
        Arguments of the environment.
    """
    arguments, agent, summary = facts["arguments"], facts["agent"], summarise(compared.rows)
    task, _ = task_of(shared)
    script = best_script(summary, task.scripts)
    seed = typical(compared.rows, TEST_SEEDS[: arguments["specimens"]], agent)
    curve = read_rows(run / "learning_curve.csv")
    write_training_page(
        run / "report.html",
        TrainingResult(
            title=f"Learning to cut {task.along}: {run.name}",
            subtitle=f"{agent} on simulated slices of measured liver, class {arguments['specimen_class']}",
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
    """Return whether an agent beats every script, in a sentence or two.

    Parameters
    ----------
    agent : str
        Name of the agent.
    paired : sequence of mapping
        Paired differences of its return from those of the scripts, by :func:`~cutenv.learning.statistics.differences`.
    scripts : collection of str
        Names of the scripts.
    """
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
