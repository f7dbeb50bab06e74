"""Table of a task: scripts, planner with truth and agents on the same held-out specimens.

    python -m scripts.benchmarks.policies.task_table depth         500 specimens; writes runs/depth/depth.csv
    python -m scripts.benchmarks.policies.task_table path --agents runs/NAME/policy ...
                                                                 2000 specimens; writes runs/path/agents.csv
    python -m scripts.benchmarks.policies.task_table path --agents --print
                                                                 the table of what is in there
    python -m scripts.benchmarks.policies.task_table path --from-nothing runs/NAME/policy ...
                                                                 1000; writes runs/path/from-nothing.csv
    python -m scripts.benchmarks.policies.task_table depth --picture FILE
                                                                 two cuts, as a PNG: floor, wanted depth and layer below
    python -m scripts.benchmarks.policies.task_table path --picture FILE
                                                                 line, way of the blade and cut from above

An agent is one training run, compared with every script by paired differences: the folders of several seeds show how
much chance in the training does.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.agents.learning.evaluation import Contestant, contestant, evaluate
from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.learning.statistics import by_policy, differences, summarise
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.envs.path_cut import ExcisionEnv, PathCutEnv
from cutenv.sim.tissue.grid import SPACING
from cutenv.task.registry import TASKS
from scripts.tables import interval_text, keep, kept_rows, mean_text

ORACLE = "planner with truth"
TEXTS = ("policy", "specimen_class", "end")


@dataclass(frozen=True, kw_only=True)
class TaskTable:
    """One task's tables."""

    task: str
    errors: tuple[tuple[str, str, str], ...]  # scores that the task adds: name, heading, format with unit
    ends: tuple[tuple[str, str], ...]  # ends for safety that are counted: name, and what it is
    draw: Callable[[Path], None] | None = None  # draws a picture of two cuts

    @property
    def file(self) -> Path:
        """File with one row for each cut of a script or the planner."""
        return Path("runs") / self.task / f"{self.task}.csv"

    @property
    def agents_file(self) -> Path:
        """File with one row for each cut of an agent or a script."""
        return self.file.with_name("agents.csv")

    @property
    def from_nothing_file(self) -> Path:
        """File with one row for each cut of an agent that learned from nothing, or of a script."""
        return self.file.with_name("from-nothing.csv")

    def measure(self, specimens: int, processes: int | None) -> list[dict[str, Any]]:
        """Return one row for each cut of every script and of the planner."""
        return self._evaluated({ORACLE: Contestant(TASKS[self.task].planner())}, specimens, processes)

    def _evaluated(
        self, others: Mapping[str, Contestant], specimens: int, processes: int | None
    ) -> list[dict[str, Any]]:
        scripts = {name: contestant(name) for name in TASKS[self.task].scripts}
        keywords = {"task": self.task, "specimen_class": "mixed"}
        several = {**others, **scripts}
        return evaluate(several, TEST_SEEDS[:specimens], keywords, processes=processes, description=self.task)

    def report(self, rows: Sequence[Mapping[str, Any]]) -> str:
        """Return the table as Markdown, and below it what there is to gain."""
        values = {(row["policy"], row["score"]): row for row in summarise(rows)}
        names = sorted(dict.fromkeys(row["policy"] for row in rows), key=lambda name: -values[name, "return"]["mean"])
        headings = " | ".join(heading for _, heading, _ in self.errors)
        lines = [
            f"| policy | return | success | {headings} | peak force | time |",
            f"| --- | --- | --- |{' --- |' * len(self.errors)} --- | --- |",
        ]
        for name in names:
            errors = " | ".join(shown.format(values[name, score]["mean"]) for score, _, shown in self.errors)
            lines.append(
                f"| {name} | {interval_text(values[name, 'return'])} "
                f"| {100 * values[name, 'success']['mean']:.0f} % | {errors} "
                f"| {values[name, 'peak_force_N']['mean']:.1f} N | {values[name, 'time_s']['mean']:.1f} s |"
            )
        best = next(name for name in names if name != ORACLE)
        paired = differences(rows, ORACLE, ("return",))
        lead = next(row for row in paired if row["baseline"] == best and row["score"] == "return")
        specimens = len({row["seed"] for row in rows})
        ends = [
            f"{what} in {sum(row['end'] == end and row['policy'] == best for row in rows)} cuts"
            for end, what in self.ends
        ]
        return "\n".join(
            [
                *lines,
                "",
                f"{specimens} held-out specimens of class mixed; mean [95 % interval]. The planner with truth leads "
                f"the best script, *{best}*, by {interval_text(lead)}. The best script meets {' and '.join(ends)}.",
            ]
        )

    def measure_agents(self, folders: Sequence[Path], specimens: int, processes: int | None) -> list[dict[str, Any]]:
        """Return one row for each cut of every agent and script."""
        agents = {f"PPO, run {number}": contestant(str(folder)) for number, folder in enumerate(folders, 1)}
        rows = self._evaluated(agents, specimens, processes)
        scores = ("policy", "seed", "return", "success", *(name for name, _, _ in self.errors))
        limits = [end for end, _ in self.ends]
        return [{name: row[name] for name in scores} | {"beyond": float(row["end"] in limits)} for row in rows]

    def agents_report(self, rows: Sequence[Mapping[str, Any]]) -> str:
        """Return the comparison as a Markdown table, with the script that comes nearest to each agent."""
        scripts, (error, heading, shown) = TASKS[self.task].scripts, self.errors[0]
        lines = [
            f"| policy | return | success | {heading} | ended beyond a limit | minus the script that comes nearest "
            "| success, points |",
            "| --- | --- | --- | --- | --- | --- | --- |",
        ]
        leads = []
        for name, own in by_policy(rows).items():
            nearest = points = "–"
            if name not in scripts:
                least, of_success = self.lead(rows, name)
                script = least["baseline"]
                nearest = f"{interval_text(least, sign='+')} ({script})"
                points = interval_text(of_success, digits=1, sign="+", factor=100.0)
                leads.append((least, of_success))
            lines.append(
                f"| {name} | {mean_text(row['return'] for row in own)} "
                f"| {100.0 * np.mean([row['success'] for row in own]):.1f} % "
                f"| {shown.format(np.mean([row[error] for row in own]))} "
                f"| {100.0 * np.mean([row['beyond'] for row in own]):.1f} % | {nearest} | {points} |"
            )
        count, ends = len({row["seed"] for row in rows}), " or ".join(what for _, what in self.ends)
        told = [
            f"{count} held-out specimens of class mixed; mean and paired difference with 95 % interval. The limits are "
            f"{ends}."
        ]
        if len(leads) > 1:
            least = min((each for each, _ in leads), key=lambda row: float(row["mean"]))
            fewest = min((each for _, each in leads), key=lambda row: float(row["mean"]))
            told.append(
                f"The least of {len(leads)} training runs leads by {interval_text(least, sign='+')} of return, and by "
                f"{interval_text(fewest, digits=1, sign='+', factor=100.0)} points of success."
            )
        return "\n".join([*lines, "", *told])

    def lead(self, rows: Sequence[Mapping[str, Any]], name: str) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Return an agent's differences of return and of success from the script that comes nearest to it."""
        scripts = TASKS[self.task].scripts
        compared = [row for row in rows if row["policy"] == name or row["policy"] in scripts]
        paired = differences(compared, name, ("return", "success"))
        least = min((row for row in paired if row["score"] == "return"), key=lambda row: float(row["low_95"]))
        nearest = (row for row in paired if row["score"] == "success" and row["baseline"] == least["baseline"])
        return least, next(nearest)

    def from_nothing_row(self) -> str:
        """Return a row of Markdown of the runs from nothing: their means, and the least of their leads."""
        rows = kept_rows(
            self.from_nothing_file,
            f"scripts.benchmarks.policies.task_table {self.task} --from-nothing runs/NAME/policy",
        )
        each, scripts = by_policy(rows), TASKS[self.task].scripts
        runs = [name for name in each if name not in scripts]
        least, points = min((self.lead(rows, name) for name in runs), key=lambda lead: float(lead[0]["mean"]))
        script = each[least["baseline"]]

        def mean(score: str, *several: Sequence[Mapping[str, Any]]) -> float:
            return float(np.mean([row[score] for own in several for row in own]))

        learned = [each[name] for name in runs]
        return (
            f"| {self.task} | {len(runs)} | {mean('return', *learned):.3f} | {100.0 * mean('success', *learned):.1f} % "
            f"| {least['baseline']}: {mean('return', script):.3f}, {100.0 * mean('success', script):.1f} % "
            f"| {interval_text(least, sign='+')} | {interval_text(points, digits=1, sign='+', factor=100.0)} |"
        )

    def short_report(self) -> str:
        """Return the planner, the training runs together, and the best script, as a Markdown table of what is kept."""
        agents = kept_rows(
            self.agents_file, f"scripts.benchmarks.policies.task_table {self.task} --agents runs/NAME/policy"
        )
        of_planner = kept_rows(self.file, f"scripts.benchmarks.policies.task_table {self.task}", TEXTS)
        scripts, (error, heading, shown) = TASKS[self.task].scripts, self.errors[0]
        runs = {row["policy"] for row in agents} - set(scripts)
        several = {
            "planner with truth, which sees the hidden state": [r for r in of_planner if r["policy"] == ORACLE],
            f"PPO that corrects the script, {len(runs)} runs": [r for r in agents if r["policy"] in runs],
            f"best script ({TASKS[self.task].script})": [r for r in agents if r["policy"] == TASKS[self.task].script],
        }
        lines = [f"| {self.task} | return | success [%] | {heading} |", "| --- | --- | --- | --- |"]
        for name, rows in several.items():
            means = [float(np.mean([row[score] for row in rows])) for score in ("return", "success", error)]
            lines.append(f"| {name} | {means[0]:.2f} | {100.0 * means[1]:.0f} | {shown.format(means[2])} |")
        return "\n".join(lines)

    def kept_report(self) -> str:
        """Return the table of the last measurement; SystemExit if there is none."""
        return self.report(kept_rows(self.file, f"scripts.benchmarks.policies.task_table {self.task}", TEXTS))

    def kept_agents_report(self) -> str:
        """Return the table of the last measurement of agents; SystemExit if there is none."""
        return self.agents_report(
            kept_rows(self.agents_file, f"scripts.benchmarks.policies.task_table {self.task} --agents runs/NAME/policy")
        )


def from_nothing_report() -> str:
    """Return what was learned from nothing on every task, as a Markdown table of what is kept."""
    lines = [
        "| task | runs | return | success | best script | least lead of the runs | success, points |",
        "| --- | --- | --- | --- | --- | --- | --- |",
        *(table.from_nothing_row() for table in TABLES.values() if table.from_nothing_file.is_file()),
    ]
    return "\n".join(
        [*lines, "", "1000 held-out specimens of class mixed; means, and paired differences [95 % interval]."]
    )


def cut_drawn(env: GentleCutEnv, name: str, seed: int = TEST_SEEDS[0]) -> tuple[Any, list[dict[str, Any]]]:
    """Let a policy cut a held-out specimen; return the last info and the truth of every decision."""
    policy: Any = contestant(name).policy
    observation, info = env.reset(seed=seed, options={"episode": 0})
    policy.reset(np.random.default_rng(0))
    ended, truths = False, []
    while not ended:
        observation, _, ended, _, info = env.step(policy(observation))
        truths.append(info["truth"])
    return info, truths


def draw_depth(path: Path) -> None:
    """Draw the floor of two cuts, a ramp and a step, by the best script and by one depth held."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 1, figsize=(8.0, 6.0), sharex=True, layout="constrained")
    for axis, wanted in zip(axes, ("ramp", "step"), strict=True):
        env = DepthCutEnv(wanted=wanted, target_length=0.08)
        for name, colour in (("depth by two forces", "tab:blue"), ("hold one depth", "tab:gray")):
            info, _ = cut_drawn(env, name)
            x = np.arange(env.cutting.motion["cell"][0] + 1) * 0.5
            axis.plot(x, 1e3 * env.cutting.floor[: len(x)], color=colour, label=f"floor of the cut, {name}")
        along = np.arange(len(env.cutting.floor)) * 0.5
        axis.plot(along, 1e3 * env.cutting.whole["wanted"][0], "k--", lw=1.0, label="wanted depth")
        axis.axhspan(1e3 * info["truth"]["layer_m"], 25.0, color="tab:red", alpha=0.2, label="layer below, not seen")
        axis.set(ylim=(20.0, 0.0), xlim=(0.0, 100.0), ylabel="depth below the surface [mm]", title=wanted)
        axis.axvline(80.0, color="tab:green", lw=1.0, label="target")
    axes[0].legend(loc="lower left", fontsize=8)
    axes[1].set_xlabel("along the cut [mm]")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def draw_path(path: Path) -> None:
    """Draw the cuts of two lines, by the best script and by a blade that follows the line."""
    cuts = [(f"a line of kind {kind}", PathCutEnv(line=kind, target_length=0.09), 0) for kind in ("excision", "s")]
    _draw_lines(path, cuts, ("steer by force", "blade on the line"))


def draw_excision(path: Path) -> None:
    """Draw two cuts along sides of excisions, by the agent and by the best script."""
    cuts = [(f"excision {number}", ExcisionEnv(control_hz=10), number) for number in (1, 2)]
    _draw_lines(path, cuts, ("ppo-excision", "excision by force"))


def _draw_lines(path: Path, cuts: Sequence[tuple[str, PathCutEnv, int]], names: tuple[str, str]) -> None:
    """Draw cuts by two policies, each from its title, environment and number of the held-out specimen."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 1, figsize=(9.5, 5.2), sharex=True, layout="constrained")
    for axis, (title, env, number) in zip(axes, cuts, strict=True):
        for name, colour in zip(names, ("tab:blue", "tab:orange"), strict=True):
            info, truths = cut_drawn(env, name, TEST_SEEDS[number])
            places = [(truth["blade_x_m"], truth["blade_y_m"]) for truth in truths]
            line, aside = env.cutting.line, env.cutting.cut_distance
            n = len(aside)
            x, y = line.x[:n] - aside * np.sin(line.angle[:n]), line.y[:n] + aside * np.cos(line.angle[:n])
            area = info["path"]["area_mm2"]
            axis.plot(1e3 * x, 1e3 * y, color=colour, lw=1.5, label=f"cut, {name}: {area:.0f} mm² from the line")
            axis.plot(*(1e3 * np.array(places).T), color=colour, lw=0.7, ls=":", label=f"blade, {name}")
        whole = slice(0, round(env.cutting.target_length / SPACING) + 1)
        axis.plot(1e3 * line.x[whole], 1e3 * line.y[whole], "k--", lw=0.8, label="line")
        axis.set(ylabel="across the slab [mm]", title=title, aspect="equal")
        axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7)
    axes[1].set_xlabel("along the slab, from the clamp [mm]")
    figure.savefig(path, dpi=110)
    plt.close(figure)


TABLES = {
    table.task: table
    for table in (
        TaskTable(
            task="gentle",
            errors=(("tip_error_mm", "tip error", "{:.2f} mm"),),
            ends=(("force_limit", "the limit of force"), ("overshoot", "that beyond the target")),
        ),
        TaskTable(
            task="depth",
            errors=(
                ("mean_error_mm", "mean error of the depth", "{:.2f} mm"),
                ("layer_mm", "into the layer below", "{:.3f} mm"),
            ),
            ends=(("force_limit", "the limit of force"), ("layer", "that of the layer")),
            draw=draw_depth,
        ),
        *(
            TaskTable(
                task=task,
                errors=(
                    ("mean_distance_mm", "mean distance to the line", "{:.2f} mm"),
                    ("largest_distance_mm", "largest", "{:.2f} mm"),
                    ("area_mm2", "area between", "{:.0f} mm²"),
                ),
                ends=(("force_limit", "the limit of force"), ("off_line", "that of the distance")),
                draw=draw_path if task == "path" else draw_excision,
            )
            for task in ("path", "excision", "hand-excision")
        ),
    )
}


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("task", choices=list(TABLES), help="the task that is cut")
    parser.add_argument("--agents", nargs="*", type=Path, metavar="FOLDER", help="policies of training runs, compared")
    parser.add_argument("--from-nothing", nargs="+", type=Path, metavar="FOLDER", help="those of runs from nothing")
    parser.add_argument(
        "--specimens",
        type=int,
        metavar="N",
        help="number of specimens; default 500, of agents 2000, of those from nothing 1000",
    )
    parser.add_argument("--processes", type=int, metavar="N", help="number of processes; default one per core")
    parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="draw two cuts, and stop")
    arguments = parser.parse_args()
    table, agents, processes = TABLES[arguments.task], arguments.agents, arguments.processes
    if arguments.picture is not None:
        if table.draw is None:
            parser.error(f"{arguments.task} has no picture here; docs/pictures has its own")
        table.draw(arguments.picture)
        return
    if arguments.from_nothing:
        keep(
            table.from_nothing_file,
            table.measure_agents(arguments.from_nothing, arguments.specimens or 1000, processes),
        )
        print(table.from_nothing_row())
        return
    if agents is None:
        if not arguments.print:
            keep(table.file, table.measure(arguments.specimens or 500, processes))
        print(table.kept_report())
        return
    if not arguments.print:
        if not agents:
            parser.error("give the folder of a policy, such as runs/NAME/policy, or --print")
        keep(table.agents_file, table.measure_agents(agents, arguments.specimens or 2000, processes))
    print(table.kept_agents_report(), flush=True)


if __name__ == "__main__":
    main()
