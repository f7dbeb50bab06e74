"""Print every generated number of the documentation: rewrite the blocks of its pages, or check them.

    python -m scripts.update_docs parameters agreement specimens calibration field pass-marks speed baselines
    python -m scripts.update_docs training results --runs runs/NAME ...  one run for each training seed
    python -m scripts.update_docs ladder learned-stop stock safe-cut memory check-score depth-cut  left in runs/
    python -m scripts.update_docs doubts                    what scripts/check_score.py --doubts left in runs/
    python -m scripts.update_docs depth-ladder depth-agents path-ladder path-agents                likewise
    python -m scripts.update_docs benchmark                 what scripts/leaderboard.py --publish has kept
    python -m scripts.update_docs rig-faults rig-faults-height rig-faults-side rig-soak class-load    likewise, in runs/
    python -m scripts.update_docs rig-attacks               what scripts/rig_attacks.py left in runs/ (--json)
    python -m scripts.update_docs depth seen-runs           what measure_depth_accuracy.py and measure_seen_runs.py left
    python -m scripts.update_docs wear                      what scripts/wear_series.py left in runs/ (--json)
    python -m scripts.update_docs twins                     what scripts/twin_trials.py left in runs/ (--json)
    python -m scripts.update_docs live-camera               what scripts/camera_beside_rig.py left in runs/ (--json)
    python -m scripts.update_docs bead-tracking             what scripts/measure_bead_tracking.py left in runs/
    python -m scripts.update_docs browser-page              what scripts/measure_page.py left in runs/ (--json)
    python -m scripts.update_docs rig-faults-serial         what scripts/rig_faults.py --serial left in runs/ (--json)
    python -m scripts.update_docs rig-faults-grbl           what scripts/rig_faults.py --grbl left in runs/ (--json)
    python -m scripts.update_docs exploit-kinds exploits    what scripts/find_exploits.py left in runs/exploits
    python -m scripts.update_docs slow-rig-agents           what scripts/slow_rig_agents.py left in runs/slow-rig
    python -m scripts.update_docs test-times                what a whole run of the tests left (--times tests/times.csv)
    python -m scripts.update_docs calibration-studies partial-depth     some minutes: thirty calibrations; fine bricks
    python -m scripts.update_docs lab-formats               every format of a laboratory, read as it is
    python -m scripts.update_docs record-faults             three minutes: a thousand faulty records, 500 clean ones
    python -m scripts.update_docs expert-ratings            half a minute: published cuts beside their ratings
    python -m scripts.update_docs errata tissue-file rig-file slow-rig metrics weights ends class-attacks licences
    python -m scripts.update_docs --check parameters        fails if a block is not what it would print
    python -m scripts.update_docs --picture                 draws assets/pictures/cut.png

A block stands between ``<!-- NAME -->`` and ``<!-- /NAME -->`` on its page (``PAGES``).
"""

from __future__ import annotations

import argparse
import json
import math
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import gymnasium
import numpy as np

from cutenv._base.validation import parameter_table
from cutenv.cutting.descent import DescentParameters
from cutenv.cutting.drive import PDRig, Rig
from cutenv.cutting.parameters import LawParameters
from cutenv.cutting.sensor import SensorParameters
from cutenv.cutting.steering import SteeringParameters
from cutenv.envs.constants import Knowledge
from cutenv.learning.statistics import mean_with_interval, rows_of
from cutenv.policy import CONSTANT_FEEDS, ORACLE, SCRIPTS, ConstantFeed
from cutenv.report import CutPicture, draw_cut
from cutenv.rig.operation.suitability import suitability_lines
from cutenv.rig.toml_file import template
from cutenv.rig_drivers.slow_profile import RATES, grbl_settings, slow_settings
from cutenv.scoring import INVARIANCES, MAP_METRICS, METRICS, Metric
from cutenv.task.depth import DepthConstants
from cutenv.task.path import PathConstants
from cutenv.task.reward import CUT_ENDS, REWARD
from cutenv.task.weights import Limits
from cutenv.tissue import Layers, measured_liver
from cutenv.tissue import tables as thesis_tables
from cutenv.tissue.blade_wear import BladeWear
from cutenv.tissue.description import TissueDescription
from cutenv.tissue.specimen import CLASSES, SurfaceSpread
from scripts import (
    ROOT,
    baseline_table,
    calibration_studies,
    camera_beside_rig,
    changed_laws,
    check_descent,
    check_score,
    check_sequential,
    check_steering,
    class_attacks,
    class_load,
    curved_cuts,
    derive_partial_depth,
    expert_ratings,
    find_exploits,
    fit_layers,
    free_cut,
    knowledge_ladder,
    lab_format_table,
    ladder,
    leaderboard,
    learned_stop,
    licence_table,
    measure_codebase,
    measure_depth_accuracy,
    measure_page,
    measure_seen_runs,
    memory_gap,
    promises,
    record_faults,
    recover_layers,
    return_strokes,
    rig_attacks,
    rig_faults,
    rig_soak,
    safe_cut,
    slow_rig_agents,
    stock_learners,
    suite_times,
    task_table,
    tip_errors,
    try_wheel,
    tune_scripts,
    twin_trials,
    wear_series,
)
from scripts import measure_bead_tracking as bead_tracking
from scripts.benchmark.table import markdown_table
from scripts.kept_rows import kept_json, kept_rows

SCORES = ("return", "success", "tip_error_mm", "peak_force_N", "time_s")


def parameters(_: argparse.Namespace) -> str:
    """Return every constant of tissue, law, drive, sensor and task, with provenance."""
    liver = measured_liver()
    rows: list[tuple[str, ...]] = []
    for row in parameter_table(
        TissueDescription,
        LawParameters,
        Rig,
        PDRig,
        BladeWear,
        SensorParameters,
        Knowledge,
        Limits,
        Layers,
        DescentParameters,
        SteeringParameters,
        DepthConstants,
        PathConstants,
        SurfaceSpread,
    ):
        if any(known[0] == f"`{row['name']}`" for known in rows):
            continue  # both drives of a rig have it, with the same default
        value = getattr(liver, row["name"], row["default"])
        sweep = "" if row["sensitivity"] is None else f"{row['sensitivity'][0]:.4g} to {row['sensitivity'][1]:.4g}"
        rows.append((f"`{row['name']}`", f"{value:.4g}", row["unit"], row["provenance"], row["source"], sweep))
    return markdown_table(("constant", "default", "unit", "provenance", "source or reason", "sweep"), rows)


def agreement(_: argparse.Namespace) -> str:
    """Return the thesis's numbers and those of independent calculations next to ours."""
    with tempfile.TemporaryDirectory() as folder:
        table = Path(folder) / "agreement.md"
        program = [sys.executable, str(ROOT / "scripts" / "reproduce_thesis.py"), "--out", folder]
        subprocess.run([*program, "--markdown", str(table)], check=True, stdout=subprocess.DEVNULL)
        return table.read_text().strip()


def other_tissues(_: argparse.Namespace) -> str:
    """Return Table 6.2: fracture resistance of other tissues."""
    data, rows = thesis_tables.table("6.2"), []
    columns = data["fracture_resistance_J_m2"], data["sd_fracture_resistance_J_m2"]
    for note, mean, sd in zip(data.notes[1:], *columns, strict=True):
        of, _, remark = note.partition(": ")[2].rstrip(".").partition("; ")
        tissue, _, measured = of.partition(", ")
        rows.append((tissue, measured, remark if np.isnan(mean) else f"{mean:.0f} ± {sd:.0f}"))
    return markdown_table(("tissue", "source, test, criterion, material", "fracture resistance [J/m²]"), rows)


def speed_of(*parts: str) -> str:
    """Return the output of ``scripts/bench.py`` on this machine; without ``parts``, all of it."""
    # a fresh process: no threads yet, nothing loaded
    program = [sys.executable, str(ROOT / "scripts" / "bench.py"), *parts]
    done = subprocess.run(program, check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT)
    return "```\n" + done.stdout.rstrip() + "\n```"


def specimens(_: argparse.Namespace) -> str:
    """Return the output of ``scripts/fit_specimens.py``: virtual measurement of drawn specimens next to the tables."""
    program = [sys.executable, str(ROOT / "scripts" / "fit_specimens.py"), "--livers", "150"]
    done = subprocess.run(program, check=True, stdout=subprocess.PIPE, text=True)
    return "```\n" + done.stdout.strip() + "\n```"


def calibration(_: argparse.Namespace) -> str:
    """Return the comparison that ``scripts/calibrate_virtual_rig.py`` prints: calibrated values and true values."""
    program = [sys.executable, str(ROOT / "scripts" / "calibrate_virtual_rig.py")]
    done = subprocess.run(program, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    return "```\n" + done.stdout.partition("4. Compared with the true values:\n")[2].strip("\n") + "\n```"


def pass_marks(_: argparse.Namespace) -> str:
    """Return the output of ``scripts/pass_mark_coverage.py``: pass marks beside published ones, and their intervals."""
    program = [sys.executable, str(ROOT / "scripts" / "pass_mark_coverage.py")]
    return subprocess.run(program, check=True, stdout=subprocess.PIPE, text=True, cwd=ROOT).stdout.strip()


def field(_: argparse.Namespace) -> str:
    """Return the output of ``scripts/measure_field.py``: beads and force give back what was put in."""
    program = [sys.executable, str(ROOT / "scripts" / "measure_field.py")]
    done = subprocess.run(program, check=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    return done.stdout.strip()


def read_csv(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file; SystemExit with the cure where there is none."""
    if not path.is_file():
        raise SystemExit(f"{path} is missing; give the folder of a finished run with --runs, or make it first.")
    return rows_of(path)


def interval(row: dict[str, str], digits: int = 2) -> str:
    """Return a mean and its interval as text."""
    mean, low, high = (f"{float(row[name]):.{digits}f}" for name in ("mean", "low_95", "high_95"))
    return f"{mean} [{low}, {high}]"


def training(arguments: argparse.Namespace) -> str:
    """Return the evaluation of training runs, one for each seed, from their summary.csv and differences.csv."""
    if not arguments.runs:
        raise SystemExit("training needs --runs runs/NAME ..., the folders of finished training runs.")
    return "\n\n".join((compared(arguments.runs[0]), each_seed(arguments.runs)))


def compared(run: Path) -> str:
    """Return the table of one run: the agent and the baselines."""
    values = {(row["policy"], row["score"]): row for row in read_csv(run / "summary.csv")}
    paired = read_csv(run / "differences.csv")
    shown = [paired[0]["policy"], *dict.fromkeys(row["baseline"] for row in paired)]
    shown.sort(key=lambda policy: -float(values[policy, "return"]["mean"]))
    rows = [(policy, *(interval(values[policy, score]) for score in SCORES)) for policy in shown]
    return markdown_table(("policy", "return", "success", "tip error [mm]", "peak force [N]", "time [s]"), rows)


def each_seed(runs: list[Path]) -> str:
    """Return the table of training seeds: each agent against the best script and the oracle."""
    rows = []
    for run in runs:
        facts = json.loads((run / "run.json").read_text())
        values = {(row["policy"], row["score"]): row for row in read_csv(run / "summary.csv")}
        paired = {(row["baseline"], row["score"]): row for row in read_csv(run / "differences.csv")}
        agent = next(iter(paired.values()))["policy"]
        script = max(
            {name for name, _ in paired} & {*CONSTANT_FEEDS, *SCRIPTS},
            key=lambda name: float(values[name, "return"]["mean"]),
        )
        rows.append(
            (
                str(facts["arguments"]["seed"]),
                interval(values[agent, "return"], 3),
                interval(values[agent, "success"]),
                script,
                interval(paired[script, "return"], 3),
                interval(paired[script, "success"]),
                interval(paired[ORACLE, "return"], 3),
                level(facts),
            )
        )
    if len(runs) > 1:
        rows.append(("all", "", "", script, interval(together(runs, agent, script), 3), "", "", ""))
    differences = ("agent minus script: return", "success", "agent minus bound")
    return markdown_table(("seed", "return", "success", "best script", *differences, "level after [min], of"), rows)


def level(facts: dict[str, Any]) -> str:
    """Return when the agent was level with its teacher on validation specimens, and how long it was trained [min]."""
    seconds = facts.get("level_with_script_after_s", "not measured")
    known = "never" if seconds is None else seconds if isinstance(seconds, str) else f"{seconds / 60.0:.1f}"
    return f"{known}, {facts.get('training_minutes', 'unknown')}"


def together(runs: list[Path], agent: str, script: str) -> dict[str, str]:
    """Return the paired difference of the return, averaged over runs before the interval over specimens is taken."""
    by_seed: dict[str, list[float]] = {}
    for run in runs:
        scores = {(row["policy"], row["seed"]): float(row["return"]) for row in read_csv(run / "scores.csv")}
        for policy, seed in scores:
            if policy == agent:
                by_seed.setdefault(seed, []).append(scores[agent, seed] - scores[script, seed])
    assert all(len(values) == len(runs) for values in by_seed.values()), "runs of different specimens"
    pooled = mean_with_interval(np.mean(values) for values in by_seed.values())
    return {name: str(value) for name, value in pooled.items()}


def baselines(_: argparse.Namespace) -> str:
    """Return the tables that ``scripts/baseline_table.py`` has measured."""
    printed = []
    measured = [name for name in reversed(CLASSES) if (ROOT / baseline_table.FOLDER / f"{name}.csv").is_file()]
    for specimen_class in measured or CLASSES:
        rows = baseline_table.kept(ROOT / baseline_table.FOLDER, specimen_class)
        printed.append(baseline_table.report(rows, specimen_class))
    return "```\n" + "\n\n".join(printed) + "\n```"


def benchmark(_: argparse.Namespace) -> str:
    """Return the published comparison of all agents."""
    return leaderboard.markdown(leaderboard.PUBLISHED)


def left_by(script: ModuleType, file: Path | None = None) -> dict[str, Any]:
    """Return what a script has kept in its ``--json`` file; SystemExit with the cure where there is none."""
    name, kept_in = Path(str(script.__file__)).name, script.DEFAULT if file is None else file
    kept: dict[str, Any] = kept_json(ROOT / kept_in, f"{name} --json {kept_in}")
    return kept


def results(_: argparse.Namespace) -> str:
    """Return the short table of the README, taken from the blocks of the page on training."""
    block = block_of((ROOT / PAGES["training"]).read_text(encoding="utf-8"), "training")
    policies, seeds = (table_of(lines) for lines in re.findall(r"(?:^\|.*\n)+", block, re.MULTILINE))
    rows = {row["policy"]: row for row in policies}
    *_, script = (seed["best script"] for seed in seeds)
    constant = next(name for name in rows if name in CONSTANT_FEEDS)
    shown = {
        ORACLE: "planner with truth, which sees the hidden state",
        "PPO": "PPO",
        script: f"best script ({script})",
        constant: f"best constant feed ({constant.removeprefix('constant ')})",
        "random": "random",
    }
    columns = ("return", "success", "tip error [mm]", "peak force [N]")
    table = markdown_table(
        ("policy", *columns), [(label, *(rows[name][column] for column in columns)) for name, label in shown.items()]
    )
    return f"{table}\n\n{verdict(seeds)}"


def verdict(seeds: list[dict[str, str]]) -> str:
    """Return the sentence about agent and script, from the table of training seeds."""
    count = len([row for row in seeds if row["seed"] != "all"])
    mean, low, high = map(float, re.findall(r"-?\d+\.\d+", seeds[-1]["agent minus script: return"]))
    about = f"{abs(mean):.2f} of return (95 % interval of the paired difference [{low:.2f}, {high:.2f}]"
    runs = "one training seed" if count == 1 else f"{count} training seeds"
    if low > 0.0:
        return f"PPO beats the best script by {about}, {runs})."
    if high < 0.0:
        return f"PPO is worse than the best script by {about}, {runs})."
    return f"PPO against the best script is undecided: they differ by {about}, {runs})."


def table_of(text: str) -> list[dict[str, str]]:
    """Return the rows of a Markdown table by column."""
    header, _, *rows = ([cell.strip() for cell in line.strip("| ").split(" | ")] for line in text.strip().splitlines())
    return [dict(zip(header, row, strict=True)) for row in rows]


def errata(_: argparse.Namespace) -> str:
    """Return the errata of the thesis that are kept with its tables."""
    return markdown_table(("table", "erratum"), [(number, text) for number, text in thesis_tables.errata()])


def map_score(task: str) -> str:
    """Return how the score of cuts along a wanted depth or a line agrees with the task."""
    path, command = ROOT / check_score.FOLDER / f"{task}.csv", f"scripts.check_score --task {task}"
    return check_score.map_report(check_score.MAP_TASKS[task], kept_rows(path, command, check_score.TEXTS))


def metrics(_: argparse.Namespace) -> str:
    """Return every metric of a score card, and what each invariance means."""
    promises = "\n".join(f"- `{name}`: {meaning}" for name, meaning in INVARIANCES.items())
    return f"{metric_table(METRICS)}\n\n{promises}"


def metric_table(among: Mapping[str, Metric]) -> str:
    """Return metrics as a table: meaning, formula, unit, source and promised invariances."""
    rows = []
    for each in among.values():
        cells = (each.meaning, each.formula, each.unit, each.direction, each.validity, each.source)
        promised = ", ".join(f"`{name}`" for name in each.invariances)
        rows.append((f"`{each.name}`", *(cell.replace("|", r"\|") for cell in cells), promised))
    header = ("metric", "meaning", "formula", "unit", "better", "valid for", "source", "unchanged by")
    return markdown_table(header, rows)


def weights(_: argparse.Namespace) -> str:
    """Return the keyword of every weight of the reward."""
    changeable = [term for term in REWARD if term.weight is not None]
    rows = [(f"`weight_{term.name}`", f"{term.weight:g}", term.text) for term in changeable]
    return markdown_table(("keyword", "default", "charged for"), rows)


def ends(_: argparse.Namespace) -> str:
    """Return the ends of a cut in order of precedence."""
    return markdown_table(("end", "when"), [(f"`{end.name}`", end.text.replace("``", "`")) for end in CUT_ENDS])


def tissue_file(_: argparse.Namespace) -> str:
    """Return the tissue file of measured liver."""
    return f"```json\n{measured_liver().to_json()}\n```"


def rig_file(_: argparse.Namespace) -> str:
    """Return the file that ``cutenv rig init my_rig.toml`` writes."""
    return f"```toml\n{template('my_rig').rstrip()}\n```"


def slow_rig(_: argparse.Namespace) -> str:
    """Return what a serial rig with each converter can do, as ``cutenv rig check`` says."""
    lines = [
        f"{converter}, {rate:g} readings a second\n"
        + "\n".join(f"  {line}" for line in suitability_lines(slow_settings("", converter=converter)))
        for converter, rate in RATES.items()
    ]
    lines.append("GRBL, with hx711\n" + "\n".join(f"  {line}" for line in suitability_lines(grbl_settings("", ""))))
    return "```text\n" + "\n\n".join(lines) + "\n```"


ON_PAGES: dict[str, dict[str, Callable[[argparse.Namespace], str]]] = {
    "docs/reference/constants.md": {"parameters": parameters},
    "docs/validation/agreement.md": {"agreement": agreement},
    "docs/validation/specimens.md": {"specimens": specimens},
    "docs/validation/calibration.md": {
        "calibration": calibration,
        "calibration-studies": lambda _: calibration_studies.report(),
        "layers-recovered": lambda _: recover_layers.tables(recover_layers.left()),
    },
    "docs/validation/pass-marks.md": {"pass-marks": pass_marks},
    "docs/validation/field.md": {"field": field},
    "docs/results/speed.md": {"wheel": lambda _: try_wheel.kept(), "speed": lambda _: speed_of()},
    "docs/results/training.md": {"training": training},
    "README.md": {"results": results, "excision-short": lambda _: task_table.TABLES["excision"].short_report()},
    "docs/results/baselines.md": {"baselines": baselines},
    "docs/results/information.md": {
        "ladder": lambda _: ladder.report(kept_rows(ROOT / ladder.FOLDER / "ladder.csv", "scripts.ladder")),
        "return-strokes": lambda _: return_strokes.report(
            kept_rows(ROOT / return_strokes.FILE, "scripts.return_strokes POLICY ...")
        ),
        "slab-memory": lambda _: ladder.memory_report(
            kept_rows(ROOT / ladder.FOLDER / "liver.csv", "scripts.ladder --specimen-class liver")
        ),
        "learned-stop": lambda _: learned_stop.report(
            kept_rows(ROOT / ladder.FOLDER / learned_stop.FILE, "scripts.learned_stop")
        ),
    },
    "docs/results/stock-learners.md": {
        "stock": lambda _: stock_learners.report(*stock_learners.kept(ROOT / stock_learners.FOLDER))
    },
    "docs/results/safe-cut.md": {
        "safe-cut": lambda _: safe_cut.report(kept_rows(ROOT / safe_cut.FOLDER / safe_cut.FILE, "scripts.safe_cut"))
    },
    "docs/results/memory-gap.md": {"memory": lambda _: memory_gap.report(memory_gap.kept(ROOT / memory_gap.FOLDER))},
    "docs/results/leaderboard.md": {"benchmark": benchmark},
    "docs/results/depth-cut.md": {
        "depth-cut": lambda _: task_table.TABLES["depth"].kept_report(),
        "depth-ladder": lambda _: knowledge_ladder.LADDERS["depth"].kept_report(),
        "depth-agents": lambda _: task_table.TABLES["depth"].kept_agents_report(),
    },
    "docs/results/path-cut.md": {
        "path-agents": lambda _: task_table.TABLES["path"].kept_agents_report(),
        "path-cut": lambda _: task_table.TABLES["path"].kept_report(),
        "path-ladder": lambda _: knowledge_ladder.LADDERS["path"].kept_report(),
        "path-speed": lambda _: speed_of("path"),
    },
    "docs/results/excision.md": {
        "excision-tuned": lambda _: tune_scripts.kept_report("excision"),
        "excision": lambda _: task_table.TABLES["excision"].kept_report(),
        "excision-ladder": lambda _: knowledge_ladder.LADDERS["excision"].kept_report(),
        "excision-agents": lambda _: task_table.TABLES["excision"].kept_agents_report(),
        "from-nothing": lambda _: task_table.from_nothing_report(),
        "hand-excision-tuned": lambda _: tune_scripts.kept_report("hand-excision"),
        "hand-excision-agents": lambda _: task_table.TABLES["hand-excision"].kept_agents_report(),
    },
    "docs/development/testing.md": {"test-times": lambda _: suite_times.tables(suite_times.read())},
    "docs/development/measures.md": {"measures": lambda _: measure_codebase.comparison()},
    "docs/validation/descent.md": {
        "descent": lambda _: promises.markdown(check_descent.CHECKS, 4),
        "slice-push": lambda _: check_descent.slice_push(),
        "descent-speed": lambda _: speed_of("descent"),
        "layers-fit": lambda _: fit_layers.markdown(),
    },
    "docs/validation/steering.md": {
        "steering": lambda _: promises.markdown(check_steering.CHECKS, 2),
        "free-cut": lambda _: free_cut.table(),
        "steering-speed": lambda _: speed_of("steering"),
        "freehand-speed": lambda _: speed_of("freehand"),
    },
    "docs/validation/sequential.md": {
        "sequential": lambda _: check_sequential.decision_table(),
        "sequential-twins": lambda _: check_sequential.twin_table(),
    },
    "docs/validation/laws.md": {
        "laws": lambda _: changed_laws.markdown(),
        "laws-results": lambda _: changed_laws.results(),
    },
    "docs/validation/curved-benchmark.md": {"curved-benchmark": lambda _: curved_cuts.table()},
    "docs/validation/score.md": {
        "check-score": lambda _: check_score.report(check_score.kept_classes(ROOT / check_score.FOLDER)),
        "doubts": lambda _: check_score.doubts_report(
            kept_rows(
                ROOT / check_score.FOLDER / check_score.DOUBTS_FILE, "scripts.check_score --doubts", check_score.TEXTS
            )
        ),
        "check-depth-score": lambda _: map_score("depth"),
        "check-path-score": lambda _: map_score("path"),
    },
    "docs/validation/exploits.md": {
        "exploit-kinds": lambda _: find_exploits.kinds(),
        "exploits": lambda _: find_exploits.tables(find_exploits.kept()),
    },
    "docs/validation/depth.md": {
        "depth": lambda _: measure_depth_accuracy.report(
            kept_json(ROOT / measure_depth_accuracy.KEPT, "scripts.measure_depth_accuracy")
        ),
        "seen-runs": lambda _: measure_seen_runs.report(
            kept_json(ROOT / measure_seen_runs.KEPT, "scripts.measure_seen_runs")
        ),
        "live-camera": lambda _: camera_beside_rig.markdown(left_by(camera_beside_rig)),
    },
    "docs/validation/errata.md": {"errata": errata},
    "docs/validation/real-cuts.md": {"expert-ratings": lambda _: expert_ratings.report()},
    "docs/validation/record-faults.md": {"record-faults": lambda _: record_faults.table()},
    "docs/reference/metrics.md": {
        "metrics": metrics,
        "depth-metrics": lambda _: metric_table(MAP_METRICS["depth"]),
        "path-metrics": lambda _: metric_table(MAP_METRICS["path"]),
    },
    "docs/how-to/train.md": {"weights": weights},
    "docs/concepts/tissue.md": {
        "partial-depth": lambda _: derive_partial_depth.elements_matter(),
        "other-tissues": other_tissues,
    },
    "docs/concepts/task.md": {
        "ends": ends,
        "tip-errors": lambda _: tip_errors.report(),
    },
    "docs/reference/files/tissue.md": {"tissue-file": tissue_file},
    "docs/reference/files/rig.md": {"rig-file": rig_file},
    "docs/reference/licences.md": {"licences": lambda _: licence_table.table()},
    "docs/rig/run.md": {"twins": lambda _: twin_trials.table(left_by(twin_trials)["rows"])},
    "docs/rig/thesis-rig.md": {"wear": lambda _: "\n".join(wear_series.table(left_by(wear_series)["rows"]))},
    "docs/validation/beads.md": {
        "bead-tracking": lambda _: bead_tracking.markdown(*bead_tracking.kept(ROOT / bead_tracking.FOLDER))
    },
    "docs/rig/what-stops-it.md": {
        "rig-faults": lambda _: rig_faults.markdown(left_by(rig_faults)),
        "rig-faults-height": lambda _: rig_faults.markdown(left_by(rig_faults, rig_faults.DEFAULTS["height"])),
        "rig-faults-side": lambda _: rig_faults.markdown(left_by(rig_faults, rig_faults.DEFAULTS["side"])),
        "rig-attacks": lambda _: rig_attacks.markdown(left_by(rig_attacks)),
        "rig-soak": lambda _: "```\n" + rig_soak.text(left_by(rig_soak)) + "\n```",
    },
    "docs/rig/serial-rig.md": {
        "rig-faults-serial": lambda _: rig_faults.markdown(left_by(rig_faults, rig_faults.DEFAULTS["serial"])),
        "rig-faults-grbl": lambda _: rig_faults.markdown(left_by(rig_faults, rig_faults.DEFAULTS["grbl"])),
        "slow-rig": slow_rig,
    },
    "docs/results/slow-rig.md": {
        "slow-rig-agents": lambda _: slow_rig_agents.markdown(
            kept_json(ROOT / slow_rig_agents.DEFAULT, "scripts.slow_rig_agents --train")
        )
    },
    "docs/reference/files/formats.md": {"lab-formats": lambda _: lab_format_table.markdown()},
    "docs/how-to/browser.md": {"browser-page": lambda _: measure_page.markdown(left_by(measure_page))},
    "docs/validation/class-server.md": {
        "class-load": lambda _: class_load.markdown(left_by(class_load)),
        "class-attacks": lambda _: class_attacks.markdown(),
    },
}
"""Functions that make blocks, by page and name."""
PAGES = {name: page for page, made in ON_PAGES.items() for name in made}
"""Page of each block."""
BLOCKS = {name: make for made in ON_PAGES.values() for name, make in made.items()}
"""Function that makes each block."""


def pattern_of(name: str) -> re.Pattern[str]:
    """Return the pattern of a block with its markers."""
    return re.compile(rf"(<!-- {name} -->\n)(.*?)(<!-- /{name} -->)", re.DOTALL)


def block_of(text: str, name: str) -> str:
    """Return what stands between a block's markers; SystemExit where they are not there once."""
    found = pattern_of(name).findall(text)
    if len(found) != 1:
        raise SystemExit(f"{PAGES[name]} has block {name} {len(found)} times: <!-- {name} --> to <!-- /{name} -->")
    return str(found[0][1])


def replaced(text: str, name: str, block: str) -> str:
    """Return the text of a page with one block replaced."""
    block_of(text, name)
    return pattern_of(name).sub(lambda match: f"{match[1]}\n{block}\n\n{match[3]}", text)


def update(page: Path, change: Callable[[str], str], option: str, *, check: bool) -> None:
    """Write the changed text of a page; with ``check``, SystemExit where it differs from the present one."""
    text = page.read_text(encoding="utf-8")
    new = change(text)
    if not check:
        page.write_text(new, encoding="utf-8")
    elif new != text:
        raise SystemExit(f"{page.relative_to(ROOT)}: not what scripts/update_docs.py {option} prints")


def draw_picture(path: Path) -> None:
    """Draw one cut by a script on measured liver, above its force trace."""
    env = gymnasium.make("cutenv/GentleCut-v1", specimen_class="liver", target_length=0.08)
    observation, _ = env.reset(seed=7)
    policy = ConstantFeed(speed=0.0127, angle=math.radians(75.0))
    policy.reset(np.random.default_rng(0))
    parts, ended = [], False
    while not ended:
        observation, _, ended, _, _ = env.step(policy(observation))
        parts.append(env.unwrapped.cutting.readings.copy())  # type: ignore[attr-defined]
    specimen = env.unwrapped.specimen  # type: ignore[attr-defined]
    cut = CutPicture(
        policy="constant feed",
        caption="",
        readings=np.concatenate(parts),
        depth=specimen.depth,
        target_length=0.08,
        force_limit_per_depth=1000.0,
    )
    draw_cut(path, cut, "1.27 cm/s and 75 degrees through a slice of liver, then stop and unload")


def main() -> None:
    """Rewrite or check blocks."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("blocks", nargs="*", choices=[*BLOCKS, []], metavar="BLOCK", help=", ".join(BLOCKS))
    parser.add_argument("--runs", type=Path, nargs="+", help="folders of the runs to quote, for training one a seed")
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    parser.add_argument("--picture", action="store_true", help="draw the picture")
    arguments = parser.parse_args()
    if arguments.picture:
        draw_picture(ROOT / "assets" / "pictures" / "cut.png")
    for name in arguments.blocks:
        block = BLOCKS[name](arguments)
        update(ROOT / PAGES[name], partial(replaced, name=name, block=block), name, check=arguments.check)


if __name__ == "__main__":
    main()
