"""Registry of checks: what backs each number of the documentation, what it promises, how it is run, how long it takes.

``update_docs`` prints blocks of pages from it, ``long_checks`` runs what takes long, the page
``docs/validation/checks.md`` lists it all, and tests hold that nothing is missing.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from scripts import ROOT
from scripts.tables import kept_json, kept_rows


class Check(NamedTuple):
    """A program that backs numbers of a page.

    Attributes
    ----------
    name
        Subject and what of it.
    promise
        What the program shows.
    run
        Module, with its arguments: what follows ``python -m``.
    minutes
        Duration on two cores [min], about; 0 for seconds, None where nobody has measured it.
    page
        Page with its numbers, from the root of the checkout; "" where no page has any.
    block
        Generated block of the page; "" where the page tells the numbers in words.
    prints
        Function that returns the block, as ``module:name``; ``:name`` where the module is that of ``run``.
    given
        Arguments of that function.
    kept
        File of ``run`` from which the function makes the block, its first argument; "" where it computes afresh.
    long
        Whether it is to pass before a change is closed that touches what it checks: ``start.py test --long``.
    """

    name: str
    promise: str
    run: str
    minutes: float | None = None
    page: str = ""
    block: str = ""
    prints: str = ""
    given: tuple[str, ...] = ()
    kept: str = ""
    long: bool = False

    @property
    def command(self) -> str:
        """Command line, as it is typed at the root of a checkout."""
        return f"python -m {self.run}"

    @property
    def arguments(self) -> list[str]:
        """Arguments of Python."""
        return ["-m", *shlex.split(self.run)]

    @property
    def printer(self) -> tuple[str, str]:
        """Module of the function that returns the block, and the function's name there."""
        module, _, path = self.prints.partition(":")
        return module or self.run.split()[0], path

    def text(self, *more: str) -> str:
        """Return the block of the page; SystemExit with the cure where nothing is kept to print it from."""
        module, path = self.printer
        found: Any = import_module(module)
        for part in path.split("."):
            found = found[part] if isinstance(found, Mapping) else getattr(found, part)
        return str(found(*self._read(), *self.given, *more))

    def _read(self) -> Iterable[Any]:
        if self.kept:
            yield (kept_rows if self.kept.endswith(".csv") else kept_json)(ROOT / self.kept, self.run)


def updated(page: str, block: str, promise: str, prints: str, *given: str) -> Check:
    """Return the check of a block that is printed from the checkout in seconds."""
    return Check(f"pages: {block}", promise, f"scripts.update_docs {block}", 0, page, block, prints, given)


def speed(page: str, block: str, promise: str, minutes: float, *parts: str) -> Check:
    """Return the check of a block that the benchmark of speed prints."""
    run = ("scripts.benchmarks.speed.bench", *parts)
    prints = "scripts.documentation.program_blocks:fenced"
    return Check(f"speed: {block}", promise, " ".join(run), minutes, page, block, prints, run)


PAGES = (  # blocks that are printed from the package, and tests
    updated("docs/reference/constants.md", "parameters",
          "every constant of tissue, law, drive, sensor and task, with provenance",
          "scripts.documentation.reference_blocks:parameters"),
    updated("docs/validation/errata.md", "errata", "contradictions of the thesis, as its tables keep them",
          "scripts.documentation.reference_blocks:errata"),
    updated("docs/reference/metrics.md", "metrics", "metrics of a score card",
          "scripts.documentation.reference_blocks:metrics"),
    updated("docs/reference/metrics.md", "depth-metrics", "metrics of cuts along a wanted depth",
          "scripts.documentation.reference_blocks:map_metrics", "depth"),
    updated("docs/reference/metrics.md", "path-metrics", "metrics of cuts along a line",
          "scripts.documentation.reference_blocks:map_metrics", "path"),
    updated("docs/how-to/train.md", "weights", "weights of the reward",
          "scripts.documentation.reference_blocks:weights"),
    updated("docs/concepts/task.md", "ends", "ends of a cut, in order of precedence",
          "scripts.documentation.reference_blocks:ends"),
    updated("docs/concepts/tissue.md", "other-tissues", "fracture resistance of other tissues",
          "scripts.documentation.reference_blocks:other_tissues"),
    updated("docs/reference/files/tissue.md", "tissue-file", "tissue file of measured liver",
          "scripts.documentation.reference_blocks:tissue_file"),
    updated("docs/reference/files/rig.md", "rig-file", "file that 'cutenv rig init' writes",
          "scripts.documentation.reference_blocks:rig_file"),
    updated("docs/rig/serial-rig.md", "slow-rig", "what a serial rig with each converter can do",
          "scripts.documentation.reference_blocks:slow_rig"),
    updated("docs/reference/licences.md", "licences", "licences of all that pip installs",
          "scripts.documentation.licences:table"),
    updated("docs/reference/files/formats.md", "lab-formats", "formats of laboratories: read, asked, or left out",
          "scripts.documentation.lab_format_table:markdown"),
    updated("docs/development/measures.md", "measures",
          "size, structure and language of the code, beside earlier revisions",
          "scripts.documentation.measure_codebase:comparison"),
    Check("tests: duration", "seconds of each folder of tests, and the slowest tests", "pytest --times tests/times.csv",
          40, "docs/development/testing.md", "test-times", "scripts.suite_times:kept_tables"),
    Check("tests: slow", "tests that take minutes", "pytest -p no:cacheprovider -m slow", None,
          "docs/development/testing.md", long=True),
    Check("tests: new examples of every property", "properties hold on examples drawn anew",
          "pytest -p no:cacheprovider tests/sim/properties tests/sim/derived tests/records/files tests/rig "
          "tests/emulation", None, "docs/development/testing.md", long=True),
    Check("bits: of results", "results keep every bit", "scripts.digests --check", 1.5, "docs/development/testing.md"),
)  # fmt: skip

THESIS = (  # the thesis beside the model, and programs that derive its constants
    Check("thesis: agreement", "the thesis's numbers, and independent calculations, beside ours",
          "scripts.validation.thesis.reproduce_thesis", 5, "docs/validation/agreement.md", "agreement",
          "scripts.documentation.program_blocks:agreement", long=True),
    Check("thesis: wear", "what comes back of blade wear that was put into series of cuts",
          "scripts.validation.measurement.wear_series --json runs/wear.json", 5, "docs/rig/thesis-rig.md", "wear",
          ":table", kept="runs/wear.json"),
    Check("constants: specimens", "virtual measurement of drawn specimens beside the tables",
          "scripts.derivations.specimens --livers 150", 5, "docs/validation/specimens.md", "specimens",
          "scripts.documentation.program_blocks:fenced", ("scripts.derivations.specimens", "--livers", "150")),
    Check("constants: eta90", "loss of an upright cut, derived from Table 4.1", "scripts.derivations.eta90", 0,
          "docs/validation/limits.md"),
    Check("constants: lines", "drawn lines, solved, and the stiffness fitted to them", "scripts.derivations.lines", 0.5,
          "docs/validation/steering.md"),
    Check("constants: partial depth", "stiffness of a slab that is not cut through, from bricks",
          "scripts.derivations.partial_depth --elements", 5, "docs/concepts/tissue.md", "partial-depth",
          ":elements_matter"),
    Check("constants: slab", "stiffness of a slab of varying modulus, condensed", "scripts.derivations.slab", None,
          "docs/validation/limits.md"),
    Check("constants: reference set", "distribution of each metric in the reference set",
          "scripts.derivations.reference_set", None, "docs/development/metric.md"),
    Check("constants: layers", "reach of layers around a blade, fitted to slabs of bricks",
          "scripts.derivations.layers", 5, "docs/validation/descent.md", "layers-fit", ":markdown"),
)  # fmt: skip

PHYSICS = (  # the cutting law and its models
    Check("physics: up and down",
          "energy, limit cases, and layers against bricks, where the blade also moves up and down",
          "scripts.validation.physics.descent", 5, "docs/validation/descent.md", "descent", ":markdown", long=True),
    Check("physics: slice and push", "forces on an edge that is pressed and drawn, beside the closed form",
          "scripts.validation.physics.descent --slice-push", 1, "docs/validation/descent.md", "slice-push",
          ":slice_push"),
    Check("physics: along a line",
          "energy, straight lines and models of cuts along a curve, beside others and closed forms",
          "scripts.validation.physics.steering", 2, "docs/validation/steering.md", "steering", ":markdown", long=True),
    Check("physics: elements solved as the cut opens",
          "forces and way of the tip beside a model that is solved anew at every node",
          "scripts.validation.physics.free_cut", 1, "docs/validation/steering.md", "free-cut", ":table", long=True),
    Check("physics: changed laws", "laws of depth and of the line, before a change and now", "scripts.update_docs laws",
          5, "docs/validation/laws.md", "laws", "scripts.validation.physics.changed_laws:markdown"),
    Check("physics: results of changed laws", "results on the tasks, before the change and now",
          "scripts.update_docs laws-results", 0, "docs/validation/laws.md", "laws-results",
          "scripts.validation.physics.changed_laws:results"),
    Check("physics: benchmark of curved cuts", "our own entry of the benchmark for other solvers",
          "scripts.validation.physics.curved_cuts table", 0, "docs/validation/curved-benchmark.md", "curved-benchmark",
          ":table"),
    Check("bits: on other processors",
          "cuts of every task are the same to the last bit with other instructions of the processor",
          "scripts.validation.physics.same_bits", 5, "docs/development/architecture.md", long=True),
    Check("bits: in the browser", "a thousand cuts in WebAssembly are Python's to the last bit",
          "scripts.validation.physics.browser_law", 5, "docs/how-to/browser.md", long=True),
)  # fmt: skip

MEASUREMENT = (  # properties of tissue, measured from records of virtual cuts
    Check("measurement: recovery", "resistance, moduli, friction and loss come back from records, by length of cut",
          "scripts.validation.measurement.recovery", 2, "docs/validation/calibration.md", long=True),
    Check("measurement: calibration", "calibrated values of virtual livers beside the true ones",
          "scripts.validation.measurement.calibrate_virtual_rig", 1, "docs/validation/calibration.md", "calibration",
          "scripts.documentation.program_blocks:calibration"),
    Check("measurement: calibration repeated", "how often the 95 % intervals hold what was put in",
          "scripts.validation.measurement.calibration_studies", 4, "docs/validation/calibration.md",
          "calibration-studies", ":report"),
    Check("measurement: layers", "toughness and modulus of layers come back from cuts in steps of depth",
          "scripts.validation.measurement.layers", 5, "docs/validation/calibration.md", "layers-recovered", ":tables",
          kept="runs/layers/layers.json"),
    Check("measurement: stepped cuts", "virtual records of cuts in steps of depth, to try the calibration of layers",
          "scripts.validation.measurement.stepped_cuts --out stepped", 0, "docs/how-to/calibrate.md"),
    Check("measurement: beads", "beads and force give back what was put in", "scripts.validation.measurement.field", 5,
          "docs/validation/field.md", "field", "scripts.documentation.program_blocks:printed",
          ("scripts.validation.measurement.field",)),
    Check("measurement: one cut twice", "modulus of one cut by force and by images, beside the one that was put in",
          "scripts.validation.measurement.one_cut_twice", 5, "docs/validation/field.md"),
    Check("measurement: tip", "errors of the estimated tip at the end of cuts",
          "scripts.validation.measurement.tip_errors", 2, "docs/concepts/task.md", "tip-errors", ":report"),
)  # fmt: skip

RECORDS = (  # files of records, and those of real cuts
    Check("records: damaged, and of other programs",
          "a damaged file is read or refused with line and fix, never guessed",
          "scripts.validation.records.record_trials", None, "docs/reference/files/records.md", long=True),
    Check("records: faults", "how well 'cutenv check' names faults, and how seldom it doubts a clean record",
          "scripts.validation.records.record_faults", 3, "docs/validation/record-faults.md", "record-faults", ":table"),
    Check("records: real cuts", "statistics of published hand-held cuts", "scripts.validation.records.real_records",
          None, "docs/validation/real-cuts.md"),
    Check("records: score of real cuts", "score cards of published hand-held cuts",
          "scripts.validation.records.score_real_records", None, "docs/validation/real-cuts.md"),
    Check("records: ratings", "force statistics of published cuts beside their ratings by experts",
          "scripts.validation.records.expert_ratings", 0.5, "docs/validation/real-cuts.md", "expert-ratings",
          ":report"),
)  # fmt: skip

SCORE = (  # scores, and decisions by them
    Check("score: agreement with the task", "a better cut has the higher score: scripts, agents, planner and people",
          "scripts.validation.scoring.check_score --hand", 30, "docs/validation/score.md", "check-score",
          ":kept_report"),
    Check("score: wanted depth", "the same of cuts along a wanted depth",
          "scripts.validation.scoring.check_score --task depth", 60, "docs/validation/score.md", "check-depth-score",
          ":kept_map_report", ("depth",)),
    Check("score: line", "the same of cuts along a line", "scripts.validation.scoring.check_score --task path", 60,
          "docs/validation/score.md", "check-path-score", ":kept_map_report", ("path",)),
    Check("score: doubts", "how often honest and changed records are doubted by their motion",
          "scripts.validation.scoring.check_score --doubts", 2, "docs/validation/score.md", "doubts", ":kept_doubts"),
    Check("score: kinds of exploits", "ways to be paid without cutting, by kind", "scripts.update_docs exploit-kinds",
          0, "docs/validation/exploits.md", "exploit-kinds", "scripts.validation.scoring.find_exploits:kinds"),
    Check("score: exploits", "searches for a reward, or a success, without the cut that was asked",
          "scripts.validation.scoring.find_exploits", 25, "docs/validation/exploits.md", "exploits", ":kept_tables"),
    Check("statistics: pass marks", "pass marks beside published ones, and how often their intervals hold the truth",
          "scripts.validation.scoring.pass_mark_coverage", 3, "docs/validation/pass-marks.md", "pass-marks",
          "scripts.documentation.program_blocks:printed", ("scripts.validation.scoring.pass_mark_coverage",)),
    Check("statistics: decisions at any time", "errors and pairs of comparisons that stop when they are decided",
          "scripts.validation.scoring.check_sequential", 5, "docs/validation/sequential.md", "sequential",
          ":decision_table", long=True),
    Check("statistics: twins at any time", "the same of a rig beside its twin",
          "scripts.validation.scoring.check_sequential --block twins", 5, "docs/validation/sequential.md",
          "sequential-twins", ":twin_table"),
    Check("statistics: what twins explain", "how far places differ, and the share that twins of an opening explain",
          "scripts.validation.scoring.check_sequential --measure 140", 15, "docs/validation/sequential.md",
          "sequential-places", ":places_report", kept="runs/check-sequential/places.csv"),
    Check("statistics: a library of sequences", "the same studies decided by the library confseq",
          "scripts.validation.scoring.check_sequential --block library", 15, "docs/validation/sequential.md",
          "sequential-library", ":library_table", kept="runs/check-sequential/library.json"),
)  # fmt: skip

VISION = (  # measurement by images, on rendered ones
    Check("vision: depth of cut", "errors of depth on rendered films, and of R with it",
          "scripts.validation.vision.depth_accuracy", 10, "docs/validation/depth.md", "depth", ":report",
          kept="runs/depth_accuracy.json", long=True),
    Check("vision: runs of the crack", "runs of the crack that a film shows, beside those of the simulator",
          "scripts.validation.vision.seen_runs", 5, "docs/validation/depth.md", "seen-runs", ":report",
          kept="runs/seen_runs.json", long=True),
    Check("vision: camera beside a rig", "frames a second beside an emulated rig, and the rig's timing with it",
          "scripts.validation.vision.camera_beside_rig --minutes 1 --json runs/camera-beside-rig.json", 15,
          "docs/validation/depth.md", "live-camera", ":markdown", kept="runs/camera-beside-rig.json", long=True),
    Check("vision: beads in X-ray images", "how exactly C-arm images are corrected and beads followed",
          "scripts.validation.vision.bead_tracking", 15, "docs/validation/beads.md", "bead-tracking", ":kept_markdown",
          long=True),
)  # fmt: skip


def rig_faults(page: str, kind: str, rig: str) -> Check:
    """Return the check of faults of a kind of rig: "" is that of the drives on a bus."""
    block = f"rig-faults{kind and f'-{kind}'}"
    file = f"runs/{block}.json"
    run = " ".join(("scripts.validation.rig.rig_faults", *filter(None, (kind and f"--{kind}",)), "--json", file))
    promise = f"every fault of {rig} is found out, stops it, and stays stopped"
    prints = "scripts.validation.rig.rig_faults:markdown"
    return Check(f"rig: faults of {rig}", promise, run, 15, page, block, prints, kept=file, long=True)


RIG = (  # rigs, in real time on an emulator
    rig_faults("docs/rig/what-stops-it.md", "", "drives on a bus"),
    rig_faults("docs/rig/what-stops-it.md", "height", "a height axis"),
    rig_faults("docs/rig/what-stops-it.md", "side", "an axis to the side"),
    rig_faults("docs/rig/serial-rig.md", "serial", "a serial rig"),
    rig_faults("docs/rig/serial-rig.md", "grbl", "a rig with GRBL"),
    Check("rig: attacks", "no attack on a rig moves its blade unwatched",
          "scripts.validation.rig.rig_attacks --times 3 --json runs/rig-attacks.json", 15, "docs/rig/what-stops-it.md",
          "rig-attacks", ":markdown", kept="runs/rig-attacks.json", long=True),
    Check("rig: soak", "an hour of cuts on an emulated rig, and the timing of its clock",
          "scripts.validation.rig.rig_soak --minutes 60 --json runs/rig-soak.json", 120, "docs/rig/what-stops-it.md",
          "rig-soak", ":markdown", kept="runs/rig-soak.json", long=True),
    Check("rig: jitter", "jitter of the loop of a rig, alone and beside other programs",
          "scripts.validation.rig.loop_jitter", 5, "docs/rig/what-stops-it.md"),
    Check("rig: twins", "verdicts of a comparison of rig and simulator under a known gain of the force",
          "scripts.validation.rig.twin_trials --json runs/twins.json", 5, "docs/rig/run.md", "twins", ":table",
          kept="runs/twins.json"),
    Check("rig: tasks with a third axis", "scripts on the same specimens in the simulator and on a rig",
          "scripts.validation.rig.tasks_on_rig --task depth", None, "docs/rig/run.md"),
    Check("rig: haptics", "an emulated haptic device stays passive, and the stiffness that it can render",
          "scripts.validation.rig.haptics passivity", 20, "docs/how-to/haptic-devices.md"),
    Check("rig: emulated haptic device", "a device of Force Dimension, emulated by its SDK's functions",
          "scripts.validation.rig.emulated_force_dimension", None, "docs/how-to/haptic-devices.md"),
)  # fmt: skip

CLASSES = (  # a class and its browsers
    Check("class: load", "what a server loses that is overloaded, killed and sent nonsense",
          "scripts.validation.classroom.class_load --json runs/class-load.json", 15, "docs/validation/class-server.md",
          "class-load", ":markdown", kept="runs/class-load.json", long=True),
    Check("class: attacks", "attacks that a class's server is tested with",
          "scripts.validation.classroom.class_attacks --try", 2, "docs/validation/class-server.md", "class-attacks",
          ":markdown"),
    Check("class: page in browsers", "pictures a second, delay and score of the page that cuts, in real browsers",
          "scripts.validation.classroom.page_in_browsers --json runs/measure_page.json", 5, "docs/how-to/browser.md",
          "browser-page", ":markdown", kept="runs/measure_page.json"),
)  # fmt: skip

SPEED = (  # speed
    speed("docs/results/speed.md", "speed", "speed of every part, beside something run in the same process", 10),
    speed("docs/results/path-cut.md", "path-speed", "speed of a batch along a line, beside GentleCut-v1", 1, "path"),
    speed("docs/validation/descent.md", "descent-speed", "speed of the law up and down, beside GentleCut-v1", 1,
          "descent"),
    speed("docs/validation/steering.md", "steering-speed", "speed of the law in the plane, beside GentleCut-v1", 1,
          "steering"),
    speed("docs/validation/steering.md", "freehand-speed", "jitter of a loop of 1 kHz whose plant is solved again", 1,
          "freehand"),
    Check("speed: training", "decisions a second of PPO, and of policies with memory",
          "scripts.benchmarks.speed.training_speed --memory", 2, "docs/results/from-scratch.md"),
    Check("speed: wheel", "size, first use and results of a wheel beside Numba's", "scripts.try_wheel WHEEL", None,
          "docs/results/speed.md", "wheel", ":kept"),
)  # fmt: skip


def on_task(task: str, page: str) -> Iterable[Check]:
    """Yield the checks of a task's table, of its agents and of its ladder of knowledge."""
    name, table = f"agents: {task}", f"scripts.benchmarks.policies.task_table {task}"
    best = "scripts and planner with truth on the same held-out specimens"
    yield Check(name, best, table, None, page, Path(page).stem, f":TABLES.{task}.kept_report")
    learned, more = f"{table} --agents runs/NAME/policy", "agents, scripts and planner on the same held-out specimens"
    yield Check(f"{name}, learned", more, learned, None, page, f"{task}-agents", f":TABLES.{task}.kept_agents_report")
    ladder = f"scripts.benchmarks.policies.knowledge_ladder {task}"
    truth = "the same script with more and more of the truth"
    yield Check(f"{name}, information", truth, ladder, None, page, f"{task}-ladder", f":LADDERS.{task}.kept_report")


AGENTS = (  # agents, scripts and planners
    Check("agents: training", "what the training command reaches, one run for each seed", "cutenv train", 4,
          "docs/results/training.md", "training", "scripts.documentation.training_blocks:training"),
    updated("README.md", "results", "agent, best script and planner in short",
          "scripts.documentation.training_blocks:results"),
    updated("README.md", "excision-short", "agents on excisions in short",
          "scripts.benchmarks.policies.task_table:TABLES.excision.short_report"),
    Check("agents: baselines", "every baseline on every class: how much there is to learn",
          "scripts.benchmarks.policies.baseline_table", 15, "docs/results/baselines.md", "baselines", ":kept_report"),
    Check("agents: benchmark", "the benchmark runs from its beginning to its end",
          "scripts.benchmarks.leaderboard.benchmark_agents --afresh", None, "docs/results/leaderboard.md", long=True),
    Check("agents: benchmark, against the published one", "another benchmark agrees with the published one",
          "scripts.benchmarks.leaderboard.benchmark_agents --against", None, "docs/results/leaderboard.md", long=True),
    Check("agents: leaderboard", "all agents, scripts, ablations and changed constants on the same specimens",
          "scripts.benchmarks.leaderboard.published", 0, "docs/results/leaderboard.md", "benchmark",
          "scripts.benchmarks.leaderboard.table:markdown"),
    Check("agents: information", "the same script with the mean tissue, with what it infers, and with the truth",
          "scripts.benchmarks.policies.ladder", 5, "docs/results/information.md", "ladder", ":report",
          kept="runs/ladder/ladder.csv"),
    Check("agents: return strokes", "return strokes of policies, and what they gain",
          "scripts.benchmarks.policies.return_strokes POLICY", None, "docs/results/information.md", "return-strokes",
          ":report", kept="runs/strokes/strokes.csv"),
    Check("agents: memory of a slab", "what there is to gain by remembering a slab",
          "scripts.benchmarks.policies.ladder --specimen-class liver", 5, "docs/results/information.md", "slab-memory",
          ":memory_report", kept="runs/ladder/liver.csv"),
    Check("agents: learned stop", "where a script should stop, learned from thousands of specimens",
          "scripts.benchmarks.policies.learned_stop", 5, "docs/results/information.md", "learned-stop", ":report",
          kept="runs/ladder/learned_stop.csv"),
    Check("agents: from scratch", "return by decisions and minutes, without scripts and demonstrations, on every task",
          "scripts.benchmarks.policies.from_scratch", 600, "docs/results/from-scratch.md", "from-scratch",
          ":kept_report"),
    Check("agents: learners of other libraries",
          "learners of other libraries with their defaults on the raw observation",
          "scripts.benchmarks.policies.stock_learners", 180, "docs/results/from-scratch.md", "stock", ":kept_report"),
    Check("agents: budget for the cost", "return and cost with and without a Lagrange multiplier",
          "scripts.benchmarks.policies.safe_cut", None, "docs/results/safe-cut.md", "safe-cut", ":report",
          kept="runs/safe-cut/rows.csv"),
    *on_task("depth", "docs/results/depth-cut.md"),
    *on_task("path", "docs/results/path-cut.md"),
    *on_task("excision", "docs/results/excision.md"),
    Check("agents: excision, tuned scripts", "scripts before and after their numbers were searched for",
          "scripts.benchmarks.policies.tune_scripts excision", None, "docs/results/excision.md", "excision-tuned",
          ":kept_report", ("excision",)),
    Check("agents: excision by hand, tuned scripts", "the same with a hand that yields",
          "scripts.benchmarks.policies.tune_scripts hand-excision", None, "docs/results/excision.md",
          "hand-excision-tuned", ":kept_report", ("hand-excision",)),
    Check("agents: excision by hand", "scripts and planner with truth, with a hand that yields",
          "scripts.benchmarks.policies.task_table hand-excision", None, "docs/results/excision.md", "hand-excision",
          ":TABLES.hand-excision.kept_report"),
    Check("agents: excision by hand, information", "the same script with more and more of the truth",
          "scripts.benchmarks.policies.knowledge_ladder hand-excision", None, "docs/results/excision.md",
          "hand-excision-ladder", ":LADDERS.hand-excision.kept_report"),
    Check("agents: excision by hand, learned", "agents and scripts with a hand that yields",
          "scripts.benchmarks.policies.task_table hand-excision --agents runs/NAME/policy", None,
          "docs/results/excision.md", "hand-excision-agents", ":TABLES.hand-excision.kept_agents_report"),
    Check("agents: learned from nothing", "agents that learned without a script",
          "scripts.benchmarks.policies.task_table excision --from-nothing runs/NAME/policy", None,
          "docs/results/excision.md", "from-nothing", ":from_nothing_report"),
    Check("agents: slow rig", "agents at the decisions and readings of a cheap rig",
          "scripts.benchmarks.policies.slow_rig_agents --train --on-rig 6", 45, "docs/results/slow-rig.md",
          "slow-rig-agents", ":markdown", kept="runs/slow-rig/table.json"),
)  # fmt: skip

CHECKS = (*THESIS, *PHYSICS, *MEASUREMENT, *RECORDS, *SCORE, *VISION, *RIG, *CLASSES, *SPEED, *AGENTS, *PAGES)
"""All checks, in the order of the page."""
BLOCKS = {check.block: check for check in CHECKS if check.block}  # check of each generated block
