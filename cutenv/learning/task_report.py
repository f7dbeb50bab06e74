"""Report of a run on a task that adds to gentle cutting: agent, scripts and planner, as tables and CSV."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from cutenv.envs.learned_tasks import task_of
from cutenv.learning.evaluation import Contestant, contestant, evaluate
from cutenv.learning.result_tables import print_differences, print_table, write_csv
from cutenv.learning.seeds import TEST_SEEDS
from cutenv.learning.statistics import differences, summarise
from cutenv.policy import ORACLE

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
    assert task.planner is not None
    learned = {agent: contestant(str(run / "policy"))}
    if (run / "untrained" / "card.json").is_file():
        learned[f"{agent} untrained"] = contestant(str(run / "untrained"))
    shared = {name: arguments[name] for name in ("task", "specimen_class", "angle_mode")}
    if arguments["angle_mode"] == "fixed":
        shared["fixed_angle_deg"] = arguments["fixed_angle_deg"]
    scripts = {name: Contestant(task.teachers[name]()) for name in task.scripts}
    few = TEST_SEEDS[: arguments["specimens"]]
    rows = evaluate({**learned, **scripts, ORACLE: Contestant(task.planner())}, few, shared, processes=processes)
    write_csv(run / "scores.csv", rows)
    summary = summarise(rows)
    write_csv(run / "summary.csv", summary)
    more = TEST_SEEDS[len(few) : _MORE * len(few)]
    closer = {agent: learned[agent], **scripts}
    further = evaluate(closer, more, shared, processes=processes, description="comparing")
    write_csv(run / "comparison.csv", further)
    paired = differences([*rows, *further], agent)
    write_csv(run / "differences.csv", paired)

    print(f"\n{task_headline(agent, paired, task.scripts)}")
    print(f"\n{len(few)} held-out specimens of class {arguments['specimen_class']}, mean [95 % interval]\n")
    print_table(summary, task.shown)
    print_differences(paired)
    print(f"({', '.join(scripts)}: on {len(few) + len(more)} specimens)")
    print(f"\nWritten to {run}/: policy/ (safetensors and card, needs no torch), scores.csv and comparison.csv")
    print("(every cut), summary.csv, differences.csv, learning_curve.csv, run.json")


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
