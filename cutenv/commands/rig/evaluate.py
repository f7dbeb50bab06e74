"""Compare a policy on a rig and in the simulator, on the same specimens.

With --until decided two policies are compared on the rig, pair by pair, until it is decided which is better. Every cut
is kept in --out at once: the same command goes on where the last one ended, on any day.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cutenv._base.output import progress_bar
from cutenv._base.validation import nearest_choices
from cutenv.commands import options
from cutenv.commands.rig import AFTER_CTRL_C, by_signal, reports_rig_errors
from cutenv.rig.errors import RigError
from cutenv.task.registry import TASKS

if TYPE_CHECKING:
    from cutenv.agents.sim_to_real.comparison_report import Evaluation
    from cutenv.agents.sim_to_real.paired_experiment import ProgressCallback
    from cutenv.agents.sim_to_real.sequential_experiment import RigComparison
    from cutenv.envs.gentle_cut import GentleCutEnv
    from cutenv.envs.rig_cut import RigCutEnv
    from cutenv.sim.tissue.specimen import Specimen

AGREE, DIFFER = 0, 1
_OF_BOTH = ("control_hz", "deadline_s", "angle_mode", "fixed_angle_deg")
_PAGE, _RECORDS = "evaluation.html", "records"
_ASKED = (
    "policies", "task", "seed", "specimen_class", "target_length", "error", "smallest", "opening", "draws", "unknown",
)  # fmt: skip
SMALLEST_RETURN = 0.05  # smallest difference of returns that matters, by default [1]


@reports_rig_errors("evaluate", ImportError, TypeError, refused=2)
def main(argv: Sequence[str]) -> int:
    """Compare; return 0 (agreed, open), 1 (differ), 2 (bad input), 130 (Ctrl-C)."""
    arguments = _parser().parse_args(argv)
    if arguments.until is not None:
        return decide(arguments)
    if arguments.policies or arguments.policy is None:
        raise ValueError("give --policy POLICY to compare a rig with the simulator, or POLICY OTHER --until decided.")
    evaluation, interrupted = _evaluated(arguments)
    print("\n".join(evaluation.lines()))
    _write(arguments, evaluation)
    if interrupted:
        return AFTER_CTRL_C
    return DIFFER if evaluation.agreement.verdict.answer == "differ" else AGREE


def _evaluated(arguments: argparse.Namespace) -> tuple[Evaluation, bool]:
    """Return the comparison, and whether Ctrl-C ended the cuts on the rig."""
    from cutenv.agents.sim_to_real import FEWEST_SPECIMENS
    from cutenv.agents.sim_to_real.comparison_report import Evaluation
    from cutenv.agents.sim_to_real.paired_experiment import paired_experiment, save_records
    from cutenv.commands.rig.run import chosen_policy
    from cutenv.rig.operation.suitability import simulator_keywords

    _check_out(arguments)
    policy, wanted = chosen_policy(arguments.policy, arguments.task)
    task = TASKS[arguments.task]
    changed: dict[str, Any] = dict(_constant(text) for text in arguments.change)
    out: Path | None = arguments.out
    specimen = _specimen(arguments)
    shared = _shared(arguments, wanted)
    with ExitStack() as stack:
        records = None if out is None else out / _RECORDS / "rig"
        rig: RigCutEnv = task.rig(rig=arguments.rig, records=records, **shared, **changed)
        stack.callback(rig.close)
        simulator = _simulator(rig, shared, changed)
        cuts = paired_experiment(
            rig, simulator, policy, seed=arguments.seed, specimens=arguments.specimens, draws=arguments.draws,
            specimen=specimen, unknown=True if arguments.unknown else None,
            progress=_progress(arguments.specimens, stack),
        )  # fmt: skip
        given = simulator_keywords(rig.settings)
        name = _rig_name(arguments.rig, rig)
        stop = rig.session.plant.supervisor.report
    interrupted = stop is not None and by_signal(stop.cause)
    if len(cuts.rig) < FEWEST_SPECIMENS:
        if interrupted:
            raise KeyboardInterrupt
        said = "; ".join(cuts.between)
        raise RigError(f"{len(cuts.rig)} specimens were cut on the rig, and {FEWEST_SPECIMENS} are needed. {said}")
    if out is not None:
        save_records(out / _RECORDS / "simulator", cuts.simulator, {"policy": arguments.policy})
    evaluation = Evaluation(
        policy=str(arguments.policy),
        rig=name,
        specimen_class=arguments.specimen_class,
        seed=arguments.seed,
        agreement=cuts.agreement,
        clock=cuts.clock,
        given=given,
        changed=changed,
        notes=tuple(
            [f"the task is to cut {task.along}; tip and cut are estimates on both sides"] * bool(task.along)
            + cuts.between
            + ["constants of the rig were changed: " + ", ".join(f"{k} = {v:g}" for k, v in changed.items())]
            * bool(changed)
        ),
    )
    return evaluation, interrupted


def _shared(arguments: argparse.Namespace, wanted: Mapping[str, Any]) -> dict[str, Any]:
    """Return the keywords of both environments; warn of slow rigs."""
    from cutenv.commands.rig.run import paced
    from cutenv.drivers.rig_names import settings_of

    shared: dict[str, Any] = {"specimen_class": arguments.specimen_class, "tissue": arguments.tissue}
    shared["target_length"] = options.target_length(arguments)
    shared, note = paced(
        shared | {name: wanted[name] for name in _OF_BOTH if name in wanted}, settings_of(arguments.rig)
    )
    if note:
        print(f"cutenv rig evaluate: {note}", file=sys.stderr)
    return shared


def _simulator(rig: RigCutEnv, shared: Mapping[str, Any], changed: Mapping[str, Any]) -> GentleCutEnv:
    from cutenv.agents.sim_to_real.paired_experiment import simulator_like

    if changed and not rig.draws_specimens:
        raise ValueError("--change is for an emulated or fake rig: a real one is described by its file.")
    wanted = {name: value for name, value in shared.items() if name not in ("angle_mode", "fixed_angle_deg")}
    return simulator_like(rig, **wanted)


@contextmanager
def rig_comparison(arguments: argparse.Namespace, *, records: Path | None = None) -> Iterator[RigComparison]:
    """Yield the comparison on a rig, closed afterwards."""
    from cutenv.agents.sim_to_real.sequential_experiment import RigComparison, two_names
    from cutenv.commands.rig.run import chosen_policy

    names = two_names(arguments.policies)
    found = [chosen_policy(name, arguments.task) for name in names]
    wanted = [{name: given[name] for name in _OF_BOTH if name in given} for _, given in found]
    if wanted[0] != wanted[1]:
        raise ValueError(f"POLICY OTHER: {names[0]!r} needs {wanted[0]}, and {names[1]!r} {wanted[1]}. Take two alike.")
    opening = options.length_given(arguments, "opening", (0.020, 0.050), "Write 25mm.")
    changed: dict[str, Any] = dict(_constant(text) for text in arguments.change)
    shared = _shared(arguments, wanted[0])
    rig: RigCutEnv = TASKS[arguments.task].rig(rig=arguments.rig, records=records, **shared, **changed)
    try:
        yield RigComparison(
            rig=rig, simulator=_simulator(rig, shared, changed), policies=(found[0][0], found[1][0]), names=names,
            question=options.question_given(arguments, smallest=SMALLEST_RETURN), seed=arguments.seed,
            apart=arguments.unknown or not rig.draws_specimens, opening=opening, draws=arguments.draws,
        )  # fmt: skip
    finally:
        rig.close()


def decide(arguments: argparse.Namespace) -> int:
    """Compare two policies until it is decided; always return 0."""
    from cutenv.agents.sim_to_real.sequential_experiment import KeptCuts
    from cutenv.display.report.decision_page import write_decision

    for option in ("policy", "specimen", "json"):
        if getattr(arguments, option) is not None:
            raise ValueError(f"--{option} is for one policy beside the simulator: leave it out with --until decided.")
    if arguments.out is None:
        raise ValueError("--until decided keeps every cut: give --out FOLDER.")
    out = options.made_folder("--out", arguments.out)
    with rig_comparison(arguments, records=out / _RECORDS / "rig") as comparison:
        kept = KeptCuts(
            out,
            {name: getattr(arguments, name) for name in _ASKED}
            | {name: str(getattr(arguments, name)) for name in ("rig", "tissue", "change")},
        )
        if arguments.missing is not None:
            if (pair := kept.open_pair) is None:
                raise ValueError("--missing is for a pair with one cut, and there is none. Leave it out.")
            kept.add({"pair": pair, "missing": arguments.missing})
        try:
            with progress_bar("cutting", "pair", total=comparison.question.most) as bar:
                bar(len(kept.whole()))
                comparison.run(kept, bar)
        finally:
            report = comparison.report(kept)
            if kept.whole():
                paths = write_decision(out, report)
                print("\n".join([*report.lines(), f"page: {paths[0]}; cuts: {out}"]))
    return 0


def _specimen(arguments: argparse.Namespace) -> Specimen | None:
    """Return the specimen of every cut, None if they differ."""
    from cutenv.sim.tissue.specimen import Specimen

    if arguments.specimen is None:
        return None
    if TASKS[arguments.task].rig.needs_axis:
        raise ValueError(f"--specimen is for the task gentle: {arguments.task} cuts what its own task lays.")
    try:
        return Specimen.from_json(arguments.specimen.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"--specimen {arguments.specimen}: {error}") from None


def _rig_name(given: str, rig: RigCutEnv) -> str:
    return f"the {given} rig" if rig.draws_specimens else rig.settings.name


def _constant(text: str) -> tuple[str, float]:
    from cutenv.envs.constants import keyword_owners

    name, _, value = text.partition("=")
    try:
        changed = name.strip(), float(value)
    except ValueError:
        raise ValueError(f"--change {text!r} is no NAME=NUMBER, such as force_delay=0.04 (SI).") from None
    if changed[0] not in (known := keyword_owners()):
        raise ValueError(f"--change {text!r}: no constant has that name.{nearest_choices(changed[0], known)}")
    return changed


def _check_out(arguments: argparse.Namespace) -> None:
    """Refuse output paths that cannot be written."""
    out: Path | None = arguments.out
    if out is not None and out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise FileExistsError(f"--out {out} is there already and not empty; give another folder.")
    if out is not None:
        options.made_folder("--out", out)
    if arguments.json is not None:
        options.made_place("--json", arguments.json)


def _write(arguments: argparse.Namespace, evaluation: Evaluation) -> None:
    from cutenv._base.output import atomic_write
    from cutenv.agents.sim_to_real.comparison_report import write_evaluation

    if arguments.json is not None:
        with atomic_write(arguments.json) as part:
            part.write_text(evaluation.to_json() + "\n", encoding="utf-8")
        print(f"json: {arguments.json}")
    if arguments.out is not None:
        write_evaluation(arguments.out / _PAGE, evaluation)
        print(f"page: {arguments.out / _PAGE}; records: {arguments.out / _RECORDS}")


def _progress(specimens: int, stack: ExitStack) -> ProgressCallback:
    """Return what shows a progress bar for each side."""
    counted: dict[str, tuple[Callable[[int], object], int]] = {}

    def told(side: str, done: int) -> None:
        bar, before = counted.get(side) or (stack.enter_context(progress_bar(side, "specimen", total=specimens)), 0)
        bar(done - before)
        counted[side] = bar, done

    return told


def _parser() -> argparse.ArgumentParser:
    from cutenv.agents.sim_to_real.paired_experiment import DRAWS

    parser = options.command_parser(
        "rig evaluate",
        __doc__,
        examples=(
            '--policy "probe and creep" --rig fake --specimens 6',
            '--task depth --policy "follow the depth" --rig fake --specimens 6',
            '--task path --policy "steer by force" --rig fake --specimens 6',
            "--policy ppo-free --rig emulator --out evaluation",
            '"return stroke" "probe and creep" --until decided --rig fake --smallest 0.1 --out decided',
        ),
        note="Exit status: 0 where both agree or more specimens are needed, 1 where they differ, 2 for an error.",
    )
    add = parser.option
    add("policies POLICY", "with --until decided: the two policies to compare on the rig", nargs="*")
    add(
        "--policy POLICY",
        "policy to compare with itself in the simulator: name of a script or of a "
        "shipped policy, or folder of a trained policy",
    )
    add("--rig RIG", options.RIG, required=True)
    options.add_task(parser, "rig")
    add("--specimens N", "number of specimens, 6 or more; default 20", 20)
    options.add_specimen_class(parser, "mixed")
    options.add_target_length(parser, "drawn from 60mm to 100mm")
    add("--tissue FILE", "tissue that specimens are drawn from; default measured pig liver", Path)
    add(
        "--specimen FILE",
        "specimen whose tissue is known, as JSON, of which every cut is "
        "made: blocks from one mould; a gain of the force then shows",
        Path,
    )
    add(
        "--unknown", "treat the specimens of an emulated or fake rig as a lab's, which are known by their records alone"
    )
    add("--seed N", "seed of the specimens; default 0", 0)
    add("--draws N", f"simulated cuts of every specimen, each with other noise; default {DRAWS}", DRAWS)
    add(
        "--change NAME=NUMBER",
        "replace a constant of an emulated or fake rig, in SI, to see whether it shows: force_delay=0.04",
        action="append",
        default=[],
    )
    add("--out FOLDER", f"folder of {_PAGE} and the records of all cuts", Path)
    add("--json FILE", "file for every number that was found", Path)
    options.add_question(parser, unit="pair of cuts", smallest=f"{SMALLEST_RETURN:g} of return", most=400)
    add_opening(parser)
    add("--missing REASON", "the pair with one cut alone cannot be completed: leave it out, and say why")
    return parser


def add_opening(parser: argparse.ArgumentParser) -> None:
    """Add ``--opening``, the length of the measured opening."""
    options.add_option(
        parser,
        "--opening LENGTH",
        "let both policies take over after the same slow feed of this length, such "
        "as 25mm, by which twins of both places correct their difference; with --unknown on an emulated or fake rig",
    )
