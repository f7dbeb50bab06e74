"""Check that the overall score agrees with the task: same specimens, cut by scripts, agents, planner and hands.

    python -m scripts.validation.scoring.check_score  500 specimens of each class, some fifteen minutes
    python -m scripts.validation.scoring.check_score --hand
                                                      simulated people as well, who hold it by a spring; half an hour
    python -m scripts.validation.scoring.check_score --task depth --specimens 60
                                                      cuts along a wanted depth; some ten minutes
    python -m scripts.validation.scoring.check_score --task path --specimens 60
                                                      cuts along a drawn line; likewise
    python -m scripts.validation.scoring.check_score --doubts
                                                      how often records are doubted by their motion; some two minutes

A class that was measured is kept: a run that was broken off goes on with the next.

A success must have more than any failure on the same specimen; where two returns differ by more than 0.1, the score
must agree in 95 % of the pairs.  The records are those of a simulator: where the tip ended is noted in them.  A record
without a score is in no pair: in most of them nothing was cut.
"""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import combinations
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.stats import spearmanr

from cutenv.agents.learning.evaluation import batched_rollout, contestant
from cutenv.agents.learning.seeds import TEST_SEEDS
from cutenv.agents.policy import NULL_POLICIES, ORACLE, SCRIPTS
from cutenv.agents.policy.depth_policies import FollowDepth
from cutenv.agents.policy.interface import PrivilegedPolicy
from cutenv.envs.depth_cut import DepthCutEnv
from cutenv.envs.path_cut import PathCutEnv
from cutenv.records.measurement.depth import LAYER_DEPTH_KEY
from cutenv.records.scoring import score
from cutenv.records.scoring.cut_map import LINE_KEY
from cutenv.records.scoring.doubts import DOUBT
from cutenv.records.scoring.scored_cut import ScoredCut
from cutenv.records.scoring.truth import ASIDE_AT_END, FLOOR_AT_END, TIP_AT_END
from cutenv.records.scoring.validity import QUICKNESS, Unavailable
from cutenv.sim.plant.protocol import recorded_trace, to_trace
from cutenv.sim.tissue.lines import places_within
from cutenv.sim.trace import Trace
from cutenv.task.depth import DEPTH_COMPONENTS
from cutenv.task.observation import COMPONENTS
from cutenv.task.registry import TASKS
from scripts import ROOT
from scripts.tables import keep, kept_rows, markdown_table
from scripts.validation.scoring.simulated_hands import DRIVEN, SKILLS, SimulatedHand

FOLDER, FILE, HAND_FILE, DOUBTS_FILE = Path("runs") / "check-score", "rows.csv", "hand.csv", "doubts.csv"
"""Folder of what is kept; in it, the rows of each class in a folder of its name, and those about doubts."""
TEXTS = ("class", "policy", "end", "record")  # columns of the kept rows that are no numbers
CLASSES = ("mixed", "vascular", "liver", "uniform")
FEED, GIVES_UP = "constant 1.27 cm/s 90 deg", "gives up at two thirds"
PLAYERS = (ORACLE, *SCRIPTS, "ppo-free", "ppo-fixed", FEED, "constant 0.38 cm/s 45 deg", *NULL_POLICIES)
"""Names of all who cut; beside them one who gives up: the constant feed, up to two thirds of its target."""
ORDER = (ORACLE, "return stroke", FEED, GIVES_UP)  # those whose mean scores must stand in this order
DEEPER = 0.003  # [m]
TOO_DEEP = f"{1e3 * DEEPER:.0f} mm too deep"  # one who follows the depth, but deeper than wanted
DIFFERENT = 0.1  # in return


class Agreement(NamedTuple):
    """Agreement of the score with the task, over pairs of cuts of the same specimen."""

    success_pairs: int
    success_wrong: int
    pairs: int
    agreeing: float
    possible: float
    """The same of a score that puts every success first, and else orders by the return: none can agree more often."""
    rank_correlation: float
    unscored: int


def measure(names: Iterable[str], specimens: int, kind: str) -> list[dict[str, Any]]:
    """Let everybody cut the first held-out specimens of a class, and score the records."""
    rows = []
    for name in names:
        policy, arguments = player(name)
        seeds = TEST_SEEDS[:specimens]
        cuts = batched_rollout(policy, seeds, {**arguments, "specimen_class": kind}, readings=True)
        for seed, cut in zip(seeds, cuts, strict=True):
            told, tip = cut.scores(), cut.readings["tip"]
            target, end = float(told["target_length_mm"]) / 1e3, len(tip)
            row = {"class": kind, "seed": seed, "policy": name, "return": told["return"], "success": told["success"]}
            rows.append(row | {"score": scored(cut, target, end, cut.end)})
            if name == FEED:
                end = int(np.argmax(tip >= 2.0 / 3.0 * target)) or len(tip)
                given_up = {"return": np.nan, "success": 0.0, "score": scored(cut, target, end, "given up")}
                rows.append(row | {"policy": GIVES_UP} | given_up)
    return rows


def player(name: str) -> tuple[Any, Mapping[str, Any]]:
    """Return one who cuts, and the arguments of the environment that they need."""
    if name in SKILLS:
        return SimulatedHand(SKILLS[name]), DRIVEN
    one = contestant(name)
    return one.policy, {**one.arguments, **({"control_hz": 10} if name in NULL_POLICIES else {})}


class Deeper(FollowDepth):
    """Script that follows the depth, and believes that a deeper cut is wanted."""

    def __call__(self, observation: Any) -> Any:
        """Return the action for an observation."""
        seen = observation.copy()
        for place, one in enumerate(DEPTH_COMPONENTS, start=len(COMPONENTS)):
            if one.name.startswith("wanted"):
                seen[place] += DEEPER / one.scale
        return super().__call__(seen)


def depth_cut(env: DepthCutEnv, policy: Any, seed: int) -> tuple[float, Trace]:
    """Cut a specimen along a wanted depth; return the return and the record, with what a simulator notes."""
    observation, _ = env.reset(seed=seed, options={"episode": 0})
    policy.reset(np.random.default_rng(seed))
    if isinstance(policy, PrivilegedPolicy):
        policy.set_state(env.cutting)
    total, parts, beside, ended = 0.0, [], [], False
    while not ended:
        observation, reward, ended, _, _ = env.step(policy(observation))
        total += float(reward)
        parts.append(env.cutting.readings.copy())
        beside.append(env.cutting.channels)
    cutting = env.cutting
    noted = {TIP_AT_END: cutting.tip, FLOOR_AT_END: cutting.floor_to_tip.tolist(), "end": cutting.end}
    noted[LAYER_DEPTH_KEY] = float(cutting.motion["boundary"][0])
    trace = to_trace(env.plant, np.concatenate(parts), **noted, **cutting.noted)
    measured = {name: np.concatenate([each[name] for each in beside]) for name in beside[0]}
    return total, dataclasses.replace(trace, **measured)


def path_cut(env: PathCutEnv, policy: Any, seed: int) -> tuple[float, Trace]:
    """Cut a specimen along a drawn line; return the return and the record, with what a simulator notes.

    The places of the blade are known at the decisions, and straight lines between them.
    """
    observation, _ = env.reset(seed=seed, options={"episode": 0})
    policy.reset(np.random.default_rng(seed))
    if isinstance(policy, PrivilegedPolicy):
        policy.set_state(env.cutting)
    cutting = env.cutting
    total, parts, lateral, times, places, ended = 0.0, [], [], [0.0], [cutting.blade_place], False
    while not ended:
        observation, reward, ended, _, _ = env.step(policy(observation))
        total += float(reward)
        parts.append(cutting.readings.copy())
        lateral.append(np.array(cutting.across)[: len(parts[-1])])
        times.append(float(parts[-1]["time"][-1]))
        places.append(cutting.blade_place)
    noted = {TIP_AT_END: cutting.tip, ASIDE_AT_END: cutting.aside_to_tip.tolist(), "end": cutting.end}
    noted |= {LINE_KEY: places_within(cutting.line).tolist(), "target_length_m": cutting.target_length}
    trace = to_trace(env.plant, np.concatenate(parts), **noted)
    x, y = (np.interp(trace.time, times, each) for each in np.array(places).T)
    return total, dataclasses.replace(trace, blade_x=x, blade_y=y, lateral_force=np.concatenate(lateral))


class MapTask(NamedTuple):
    """Task whose score has a map of the cut: how it is cut, and which metric of the card is which error of the task."""

    cut: Callable[[Any, Any, int], tuple[float, Trace]]
    compared: Mapping[str, tuple[str, str, float, str]]
    """Name of the error, words for it, its units in one of the metric's, and its unit, by metric."""
    end: str  # end for safety that the task adds
    ended: str
    further: Mapping[str, Callable[[], Any]] = {}  # those who cut besides planner and scripts


MAP_TASKS = {  # tasks along a wanted depth, and along a line
    "depth": MapTask(
        depth_cut,
        {
            "mean_depth_error": ("mean_error_mm", "the mean error of the depth", 1e3, "mm"),
            "layer_depth": ("layer_mm", "the depth into the layer", 1e3, "mm"),
        },
        "layer", "in the layer below", {TOO_DEEP: Deeper},
    ),
    "path": MapTask(
        path_cut,
        {
            "largest_line_distance": ("largest_distance_mm", "the largest distance to the line", 1e3, "mm"),
            "line_area": ("area_mm2", "the area between cut and line", 1e6, "mm2"),
        },
        "off_line", "too far from the line",
    ),
}  # fmt: skip


def measure_map(name: str, specimens: int) -> list[dict[str, Any]]:
    """Let scripts and planner cut the first held-out specimens of a task, and score the records."""
    learned, task, rows = TASKS[name], MAP_TASKS[name], []
    env = learned.single(specimen_class="mixed")
    same, (known, _, scale, _) = next(iter(task.compared.items()))
    for player, make in {ORACLE: learned.planner, **learned.scripts, **task.further}.items():
        for seed in TEST_SEEDS[:specimens]:
            total, trace = task.cut(env, make(), seed)
            card = score(trace)
            hidden = (TIP_AT_END, FLOOR_AT_END, ASIDE_AT_END)
            alone = score(trace.with_metadata({k: v for k, v in trace.metadata.items() if k not in hidden}))
            errors = env.cutting.errors
            row = {"class": "mixed", "seed": seed, "policy": player, "return": total}
            row |= {"score": card.overall_score or 0.0, "from_record": alone.overall_score or 0.0}
            row |= {"success": float(env.cutting.success), "end": env.cutting.end}
            for metric, (error, _, units, _) in task.compared.items():
                row[error] = errors[error]
                row[f"{error}_recorded"] = units * alone[metric] if alone.metrics[metric].value is not None else np.nan
            row["definitions_apart"] = abs(scale * card[same] - errors[known])
            rows.append(row)
    return rows


def map_report(task: MapTask, rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the report on cuts along a wanted depth or a line, and how well a record alone tells depth or path."""
    alone = agreement([{**row, "score": row["from_record"]} for row in rows])
    apart = max(float(row["definitions_apart"]) for row in rows)
    ends = sum(row["end"] == task.end for row in rows)
    same = next(iter(task.compared.values()))[1]
    said = []
    for error, words, _, unit in task.compared.values():
        off = np.abs([float(row[f"{error}_recorded"]) - float(row[error]) for row in rows])
        said.append(
            f"{words} is off by {np.nanmedian(off):.2f} {unit} (median; 95 % within {np.nanquantile(off, 0.95):.2f})"
        )
    return (
        f"{report(rows)}\n\n"
        f"{ends} cuts ended {task.ended}. On the card, {same} is the task's within {apart:.0e} mm.\n\n"
        f"From the record alone, without what the simulator notes: {', '.join(said)}; success not above "
        f"failure in {alone.success_wrong} of {alone.success_pairs} pairs, agreement with the return in "
        f"{100 * alone.agreeing:.1f} %."
    )


def scored(cut: Any, target: float, count: int, end: str) -> float:
    """Return the overall score of the first ``count`` readings of a cut that ended in that way; NaN without one."""
    noted = {TIP_AT_END: float(cut.readings["tip"][count - 1]), "end": end}
    trace = recorded_trace(cut.readings[:count], cut.measured_depth, **noted)
    found = score(trace, target_length=target).overall_score
    return np.nan if found is None else float(found)


def agreement(rows: Sequence[Mapping[str, Any]]) -> Agreement:
    """Compare score and task over all pairs of cuts of the same specimen."""
    by_specimen: dict[Any, list[tuple[float, float, float]]] = {}
    known = [row for row in rows if np.isfinite(float(row["score"]))]
    for row in known:
        numbers = float(row["return"]), float(row["success"]), float(row["score"])
        by_specimen.setdefault((row["class"], row["seed"]), []).append(numbers)
    success_pairs = success_wrong = pairs = agreeing = possible = 0
    for cuts in by_specimen.values():
        for (return_1, success_1, score_1), (return_2, success_2, score_2) in combinations(cuts, 2):
            if success_1 != success_2:
                success_pairs += 1
                success_wrong += (score_1 - score_2) * (success_1 - success_2) <= 0.0
            if abs(return_1 - return_2) > DIFFERENT:
                pairs += 1
                agreeing += (return_1 - return_2) * (score_1 - score_2) > 0.0
                possible += (return_1 - return_2) * (success_1 - success_2) >= 0.0
    whole = np.array([numbers for cuts in by_specimen.values() for numbers in cuts])
    whole = whole[np.isfinite(whole[:, 0])]
    correlation = float(spearmanr(whole[:, 0], whole[:, 2]).statistic)
    shares = agreeing / max(pairs, 1), possible / max(pairs, 1)
    return Agreement(success_pairs, success_wrong, pairs, *shares, correlation, len(rows) - len(known))


def mean_scores(rows: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Return the mean score of everybody."""
    scores: dict[str, list[float]] = {}
    for row in rows:
        scores.setdefault(str(row["policy"]), []).append(float(row["score"]))
    return {name: float(np.mean(np.nan_to_num(own))) for name, own in scores.items()}


def report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return two Markdown tables: agreement by class, and the mean score of everybody by class."""
    kinds = list(dict.fromkeys(row["class"] for row in rows))
    by_kind = {kind: [row for row in rows if row["class"] == kind] for kind in kinds}
    specimens = len({row["seed"] for row in rows})
    groups = {kind: {"": own} for kind, own in by_kind.items()}
    if any(row["policy"] in SKILLS for row in rows):
        for kind, own in by_kind.items():
            hands = [row for row in own if row["policy"] in SKILLS]
            groups[kind] = {", all": own, ", hands alone": hands}
    found = {f"{kind}{who}": agreement(own) for kind, parts in groups.items() for who, own in parts.items()}
    table = [
        (
            kind, f"{a.success_wrong} of {a.success_pairs}", f"{100 * a.agreeing:.1f} % of {a.pairs}",
            f"{100 * a.possible:.1f} %", f"{a.rank_correlation:.2f}", str(a.unscored),
        )
        for kind, a in found.items()
    ]  # fmt: skip
    means = {kind: mean_scores(own) for kind, own in by_kind.items()}
    names = sorted(means[kinds[0]], key=lambda name: -means[kinds[0]][name])
    scores = [(name, *(f"{means[kind][name]:.0f}" for kind in kinds)) for name in names]
    head = (
        "class", "success not above failure", "score agrees with the return", "at most", "rank correlation",
        "without a score",
    )  # fmt: skip
    which = "each class" if len(kinds) > 1 else f"class {kinds[0]}"
    return (
        f"{specimens} held-out specimens of {which}.\n\n{markdown_table(head, table)}\n\n"
        f"Mean overall score:\n\n{markdown_table(('who cut', *kinds), scores)}"
    )


def forged(trace: Trace, **fields: object) -> Trace:
    """Return a record with other fields, whose speed follows from its position."""
    return dataclasses.replace(trace, speed=None, **fields)  # type: ignore[arg-type]


def with_smooth_position(milliseconds: int) -> Callable[[Trace], Trace]:
    """Return a change of records at 1 kHz: the position is a moving mean over that time."""
    return lambda trace: forged(trace, position=uniform_filter1d(np.asarray(trace.position), milliseconds))


def with_fast_clock(factor: float) -> Callable[[Trace], Trace]:
    """Return a change of records: by a fast clock, the cut seems to last that many times as long."""
    return lambda trace: forged(trace, time=factor * trace.time)


def every(step: int) -> Callable[[Trace], Trace]:
    """Return a change of records: one reading of so many is kept."""
    return lambda trace: trace.select(slice(None, None, step))


AS_IT_IS = "1000 Hz"
RATES: Mapping[str, Callable[[Trace], Trace]] = {  # honest records, read at other rates
    AS_IT_IS: every(1), "200 Hz": every(5), "100 Hz": every(10), "33 Hz": every(30)
}  # fmt: skip
CHANGES: Mapping[str, Callable[[Trace], Trace]] = {
    **{f"position smoothed over {ms} ms": with_smooth_position(ms) for ms in (20, 30, 50)},
    **{f"clock faster by a factor of {factor}": with_fast_clock(factor) for factor in (2, 1.5, 1.3, 1.2)},
}
"""Changes to the motion in a person's record at 1 kHz by which it may gain."""
CHANGED = ("steady hand", "brisk hand", "hurried hand", "late hand")  # those whose records are changed
_BY_MOTION = "position was smoothed"  # in every doubt about motion, and in the reason why such a record has no score


def measure_doubts(names: Iterable[str], specimens: int, kind: str) -> list[dict[str, Any]]:
    """Let everybody cut the first held-out specimens of a class, and look for doubts about the motion in the records.

    A row for each record: as it is, at lower rates, and, of some people, changed.
    """
    rows = []
    for name in names:
        policy, arguments = player(name)
        person = {"operator": "p07"} if name in SKILLS else {}
        seeds = TEST_SEEDS[:specimens]
        cuts = batched_rollout(policy, seeds, {**arguments, "specimen_class": kind}, readings=True)
        for seed, cut in zip(seeds, cuts, strict=True):
            noted = {TIP_AT_END: float(cut.readings["tip"][-1]), "target_length_m": cut.truth["target_length_m"]}
            trace = recorded_trace(cut.readings, cut.measured_depth, end=cut.end, **noted, **person)
            for record, change in ({**RATES, **CHANGES} if name in CHANGED else RATES).items():
                row = {"class": kind, "seed": seed, "policy": name, "record": record}
                rows.append(row | _doubted(change(trace)))
    return rows


def _doubted(trace: Trace) -> dict[str, float]:
    """Return score, doubt and refusal by the motion in a record, and how its lurches are; NaN where there is none."""
    card = score(trace)
    found: dict[str, float | None] = {
        "score": card.overall_score,
        "doubted": float(any(note.startswith(DOUBT) and _BY_MOTION in note for note in card.notes)),
        "refused": float(_BY_MOTION in card.no_score),
    }
    try:
        lurches = ScoredCut(trace=trace).lurches
    except Unavailable:
        lurches = None
    sharpness, slowness, early = lurches[2:] if lurches else (None, None, None)
    found["lasts"] = 1.0 / sharpness if sharpness else None
    found["quickness"] = QUICKNESS / slowness if slowness else None
    found["early"] = early
    return {name: np.nan if value is None else float(value) for name, value in found.items()}


def doubts_report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return two Markdown tables: how often honest records are doubted by their motion, and what changed ones gain."""
    kinds, specimens = dict.fromkeys(row["class"] for row in rows), len({row["seed"] for row in rows})
    counts = []
    for who, people in (("by scripts and agents", False), ("by simulated people", True)):
        own = [row for row in rows if (row["policy"] in SKILLS) == people]
        for said, name in (("doubted", "doubted"), ("without a score for it", "refused")):
            some = [[row for row in own if row["record"] == rate] for rate in RATES]
            judged = [[row for row in each if np.isfinite(row["score"]) or row["refused"]] for each in some]
            counts.append((f"{who}: {said}", *(f"{sum(int(r[name]) for r in each)} of {len(each)}" for each in judged)))
    by_hand = [row["lasts"] for row in rows if row["policy"] in SKILLS and row["record"] in RATES]
    honest = {
        (row["class"], row["seed"], row["policy"]): row
        for row in rows
        if row["record"] == AS_IT_IS and row["policy"] in CHANGED and np.isfinite(row["score"])
    }
    gains = []
    for record in (AS_IT_IS, *CHANGES):
        own = [row for row in rows if row["record"] == record]
        pairs = [(honest[key], row) for row in own if (key := (row["class"], row["seed"], row["policy"])) in honest]
        told = [
            (float(np.nan_to_num(row["score"])) - before["score"], row["doubted"] or row["refused"])
            for before, row in pairs
        ]
        gained = [gain for gain, _ in told], [gain for gain, doubted in told if not doubted]
        columns = [np.array([row[name] for _, row in pairs]) for name in ("lasts", "quickness", "early")]
        (fast, slow), (low, high) = (np.nanquantile(column, (0.01, 0.99)) for column in columns[:2])
        gains.append(
            (
                "as it is" if record == AS_IT_IS else record, f"{1e3 * fast:.0f} to {1e3 * slow:.0f} ms",
                f"{low:.2f} to {high:.2f}", f"{100 * np.nanmedian(columns[2]):.0f} %",
                f"{sum(int(doubted) for _, doubted in told)} of {len(told)}",
                *(f"{max(some):.1f}" if some and record != AS_IT_IS else "" for some in gained),
            )
        )  # fmt: skip
    head = (
        "record", "a lurch lasts", "v over the root of D w", "before the fall (median)", "doubted, or no score",
        "largest gain", "largest gain without a doubt",
    )  # fmt: skip
    return (
        f"{specimens} held-out specimens of each class: {', '.join(kinds)}. Honest records:\n\n"
        f"{markdown_table(('honest records', *RATES), counts)}\n\n"
        f"At these rates, lurches of simulated people last {1e3 * np.nanmin(by_hand):.0f} to "
        f"{1e3 * np.nanmax(by_hand):.0f} ms, mean of a cut.\n\n"
        f"Records of {', '.join(CHANGED)}, as they are and changed; of times and of v over the root of D w, "
        "98 of 100:\n\n"
        f"{markdown_table(head, gains)}"
    )


def kept_classes(folder: Path, kinds: Iterable[str] = CLASSES, *, hand: bool = True) -> list[dict[str, Any]]:
    """Return the kept rows of classes, with or without hands; SystemExit with the command that makes them."""
    file, command = (
        (HAND_FILE, "scripts.validation.scoring.check_score --hand")
        if hand
        else (FILE, "scripts.validation.scoring.check_score")
    )
    return [row for kind in kinds for row in kept_rows(folder / kind / file, command, TEXTS)]


def kept_report() -> str:
    """Return the report of all classes with hands, of an earlier measurement."""
    return report(kept_classes(ROOT / FOLDER))


def kept_doubts(folder: Path = ROOT / FOLDER) -> str:
    """Return the report of doubts, of an earlier measurement."""
    return doubts_report(kept_rows(folder / DOUBTS_FILE, "scripts.validation.scoring.check_score --doubts", TEXTS))


def kept_map_report(task: str, folder: Path = ROOT / FOLDER) -> str:
    """Return the report of cuts along a wanted depth or a line, of an earlier measurement."""
    return map_report(
        MAP_TASKS[task],
        kept_rows(folder / f"{task}.csv", f"scripts.validation.scoring.check_score --task {task}", TEXTS),
    )


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--task", default="gentle", choices=("gentle", *MAP_TASKS), help="default gentle")
    parser.add_argument("--specimens", type=int, metavar="N", help="of each class; default 500, with --doubts 10")
    parser.add_argument("--classes", nargs="+", default=CLASSES, choices=CLASSES, help="default all")
    parser.add_argument("--out", type=Path, default=FOLDER, metavar="FOLDER", help=f"folder; default {FOLDER}")
    parser.add_argument("--hand", action="store_true", help="let simulated people of several skills cut as well")
    parser.add_argument("--doubts", action="store_true", help="count doubts about motion in honest and changed records")
    parser.add_argument("--print", action="store_true", help="print the kept table without measuring again")
    arguments = parser.parse_args()
    if arguments.specimens is None:
        arguments.specimens = 10 if arguments.doubts else 500
    if arguments.specimens < 1:
        parser.error(f"--specimens {arguments.specimens} is less than 1")
    if arguments.doubts:
        path, everybody = arguments.out / DOUBTS_FILE, (*PLAYERS, *SKILLS)
        if not arguments.print:
            # A mixed specimen is that of another class with the same seed, and would count twice.
            kinds = CLASSES[1:] if arguments.classes is CLASSES else arguments.classes
            keep(path, [row for kind in kinds for row in measure_doubts(everybody, arguments.specimens, kind)])
        print(kept_doubts(arguments.out), flush=True)
        return
    if arguments.task in MAP_TASKS:
        if not arguments.print:
            keep(arguments.out / f"{arguments.task}.csv", measure_map(arguments.task, arguments.specimens))
        print(kept_map_report(arguments.task, arguments.out), flush=True)
        return
    for kind in () if arguments.print else arguments.classes:
        path = arguments.out / kind / (HAND_FILE if arguments.hand else FILE)
        if path.is_file():
            print(f"{path} is there; delete it to measure it again.", flush=True)
            continue
        keep(path, measure((*PLAYERS, *SKILLS) if arguments.hand else PLAYERS, arguments.specimens, kind))
    print(report(kept_classes(arguments.out, arguments.classes, hand=arguments.hand)), flush=True)


if __name__ == "__main__":
    main()
