"""Check the decisions of a sequential comparison by simulated studies, whose truth is known.

    python -m scripts.validation.scoring.check_sequential                10,000 studies a row; some minutes
    python -m scripts.validation.scoring.check_sequential --studies 500 --block twins
    python -m scripts.validation.scoring.check_sequential --measure 140  what twins explain; 140 places, some 20 minutes
    PYTHONPATH=confseq/src python -m scripts.validation.scoring.check_sequential --block library
                                                                    the same studies decided by the library confseq

Differences of a pair are drawn with a known mean and bounded as returns are, by 1: normal, heavy-tailed (Student's t
with two degrees of freedom, clipped, its mean then set), drifting (the mean swings from study to study and day to day,
and its average so far is at most what it is said to be), and two-valued (a success more, a success less, or none).
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from cutenv._base.arrays import Array
from cutenv._base.output import progress_bar
from cutenv.agents.policy import SCRIPTS
from cutenv.agents.sim_to_real.paired_experiment import DRAWS, cut_again, simulator_like
from cutenv.agents.sim_to_real.sequential_experiment import (
    OpenedPolicy,
    RigComparison,
    forecast,
    opening_of,
    specimens_like,
)
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.records.scoring.study.sequential import (
    DECISIONS,
    SequentialQuestion,
    corrected,
    fixed_design,
    log_wealth,
    sequential_decisions,
    stops,
)
from cutenv.sim.tissue.specimen import Specimen
from scripts.tables import keep, keep_json, markdown_table

SPREAD = 0.2
"""Standard deviation of a difference on the same specimen, of returns clipped at 0, as of two scripts in simulation."""
SPREAD_APART, TOLD, TOLD_WRONGLY = 0.23, 0.22, 0.21
"""Standard deviation of the difference of two places, and the share of its variance that twins of an opening of 40 mm
explain, as they are, and 30 % too stiff with twice the friction, as measured by ``--measure 140``."""
OPENING, POLICIES = 0.040, ("return stroke", "probe and creep")
"""Length of the opening [m], and the policies that take over from it by turns, of the measured places."""
PLACES_FILE = Path("runs") / "check-sequential" / "places.csv"
"""File of the measured places: return, forecast and forecast of a wrong twin of each."""
LIBRARY_FILE = PLACES_FILE.with_name("library.json")  # file of what the library finds in the same studies
STUDIES = 10_000  # number of simulated studies of each row
_DAY = 20  # pairs between changes of a drifting mean
_AGAIN = 2000  # resampled sets of places
_TOGETHER = 1000  # studies drawn at a time, to limit memory
Draw = Callable[[np.random.Generator, tuple[int, int], float], Any]
"""Function that draws differences, shape (studies, pairs), or a tuple of such and their room."""


def normal(rng: np.random.Generator, shape: tuple[int, int], mean: float) -> Array:
    """Return normal differences, shape (studies, pairs)."""
    return np.clip(rng.normal(mean, SPREAD, shape), -1.0, 1.0)


def heavy(rng: np.random.Generator, shape: tuple[int, int], mean: float) -> Array:
    """Return differences most of which are small and some as large as can be: half of the variance is in the tail."""
    found = np.clip(0.1 * rng.standard_t(2, shape), mean - 1.0, 1.0 - mean)
    tail = max(abs(mean - 1.0), 1.0 - mean)
    return np.clip(found, -tail, tail) + mean


def drifting(rng: np.random.Generator, shape: tuple[int, int], mean: float) -> Array:
    """Return differences whose mean is lower on one day and higher on the next: on average at most ``mean``."""
    day = np.arange(shape[1]) // _DAY
    swing = np.where(day % 2 == 0, -0.15, 0.15) * rng.uniform(0.2, 1.0, (shape[0], 1))
    return np.clip(rng.normal(mean, SPREAD, shape) + swing, -1.0, 1.0)


def two_valued(rng: np.random.Generator, shape: tuple[int, int], mean: float) -> Array:
    """Return differences of success: three in ten pairs differ."""
    u = rng.random(shape)
    return (u < 0.5 * (0.3 + mean)).astype(float) - (u > 1.0 - 0.5 * (0.3 - mean))


KINDS: dict[str, Draw] = {"normal": normal, "heavy-tailed": heavy, "drifting": drifting, "two-valued": two_valued}


def studied(draw: Draw, mean: float, question: SequentialQuestion, studies: int, seed: int) -> dict[str, Any]:
    """Return what many studies decide, whether their intervals held the mean at every time, and the t tests."""
    rng = np.random.default_rng(seed)
    at, said, left, spread, peeked, fixed_said = [], [], [], [], [], []
    for first in range(0, studies, _TOGETHER):
        drawn = draw(rng, (min(_TOGETHER, studies - first), question.most), mean)
        found, room = drawn if isinstance(drawn, tuple) else (drawn, 0.0)
        stop, decision = stops(sequential_decisions(found, question, room))
        at.append(stop)
        said.append(decision)
        sides = [log_wealth(side * found, side * mean, question.reach + room) >= question.bar for side in (1.0, -1.0)]
        left.append((sides[0] | sides[1]).any(axis=1))
        spread.append(found.std(axis=1, ddof=1))
        t = _t(found)
        critical = student.isf(0.5 * question.error, np.arange(1, found.shape[1] + 1) - 1.0)
        peeked.append((np.abs(t[:, 9:]) > critical[9:]).any(axis=1))
        n = min(fixed_design(float(found.std()), question), question.most)
        fixed_said.append(np.abs(t[:, n - 1]) > critical[n - 1])
    decided = np.concatenate(said)
    return {
        "shares": {name: float(np.mean(decided == k)) for k, name in enumerate(DECISIONS)},
        "median": float(np.median(np.concatenate(at))),
        "left": float(np.mean(np.concatenate(left))),
        "spread": float(np.mean(np.concatenate(spread))),
        "peeked": float(np.mean(np.concatenate(peeked))),
        "fixed": float(np.mean(np.concatenate(fixed_said))),
    }


def _t(found: Array) -> Array:
    """Return Student's t after every pair, shape (studies, pairs)."""
    n = np.arange(1, found.shape[1] + 1)
    mean = np.cumsum(found, axis=1) / n
    variance = np.maximum(np.cumsum(found**2, axis=1) / n - mean**2, 1e-12) * n / np.maximum(n - 1, 1)
    return mean / np.sqrt(variance / n)


def decision_rows(studies: int) -> list[list[str]]:
    """Return the rows of the table of decisions."""
    rows = []
    for kind, draw in KINDS.items():
        for mean in (0.0, 0.05, 0.1):
            question = SequentialQuestion(most=800 if kind == "two-valued" else 500)
            found = studied(draw, mean, question, studies, seed=len(rows))
            shares, fixed = found["shares"], fixed_design(found["spread"], question)
            wrong = shares["worse"] + (shares["better"] if mean == 0.0 else 0.0)
            wrong += shares["equivalent"] if mean >= question.smallest else 0.0
            saved = f"{100.0 * (1.0 - found['median'] / fixed):.0f} %" if mean == 0.1 else ""
            rows.append(
                [
                    kind, f"{mean:g}", _percent(wrong), _percent(found["left"]), _percent(shares["better"]),
                    _percent(shares["equivalent"]), f"{found['median']:.0f}", f"{fixed}", saved,
                    _percent(found["fixed"]), _percent(found["peeked"]),
                ]
            )  # fmt: skip
    return rows


def library_rows(studies: int) -> list[dict[str, Any]]:
    """Return what the library confseq finds in the first ``studies`` of each kind, beside what is found here.

    Its betting martingale, with its own bets, which learn from earlier pairs, tests one side at half of the error.
    """
    try:
        from confseq.betting import betting_mart
    except (ImportError, AttributeError) as error:  # numpy 2 has no float_
        raise SystemExit(
            f"check_sequential: {error}. Get the source of confseq from github.com/gostevehoward/confseq and give its "
            "folder src as PYTHONPATH, in an environment with numpy below 2 and multiprocess: it is not built for "
            "Python 3.11, but what is used of it needs no build."
        ) from None
    question = SequentialQuestion()

    def bets(x: Array) -> NDArray[np.bool_]:
        """Return when each study has shown a positive mean, as often as the error allows; its length if never."""
        wealth = betting_mart(0.5 * (1.0 + x), 0.5, alpha=0.5 * question.error, theta=1.0)
        return np.asarray(wealth) >= 2.0 / question.error

    rows = []
    for kind, mean in itertools.product(KINDS, (0.0, 0.05, 0.1)):
        drawn = KINDS[kind](np.random.default_rng(11), (studies, question.most), mean)
        ours = log_wealth(drawn, 0.0, question.reach) >= question.bar
        theirs = np.array([bets(each) for each in drawn])
        for name, shown in (("here", ours), ("confseq", theirs)):
            at = np.where(shown.any(axis=1), shown.argmax(axis=1) + 1.0, np.inf)
            rows.append({"kind": kind, "mean": mean, "by": name, "studies": studies,
                         "shown": float(shown.any(axis=1).mean()), "median": float(np.median(at))})  # fmt: skip
    return rows


def library_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table of both beside each other as Markdown."""
    header = ["differences", "mean", "above 0 here", "above 0 by confseq", "median pairs here", "by confseq"]
    cells = []
    for kind, mean in dict.fromkeys((row["kind"], row["mean"]) for row in rows):
        here, library = (
            next(row for row in rows if (row["kind"], row["mean"], row["by"]) == (kind, mean, by))
            for by in ("here", "confseq")
        )
        medians = [
            f"{float(each['median']):.0f}" if np.isfinite(float(each["median"])) else "" for each in (here, library)
        ]
        cells.append([kind, f"{mean:g}", _percent(float(here["shown"])), _percent(float(library["shown"])), *medians])
    return f"{rows[0]['studies']:,} studies a row:\n\n{markdown_table(header, cells)}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.1f} %"


def apart(told: float, bias: float = 0.0) -> Draw:
    """Return what draws differences of two places, corrected by forecasts that explain a share of their variance."""

    def draw(rng: np.random.Generator, shape: tuple[int, int], mean: float) -> tuple[Array, Array]:
        covariates = np.clip(np.sqrt(told) * SPREAD_APART * rng.standard_normal(shape), -1.0, 1.0)
        rest = np.sqrt(1.0 - told) * SPREAD_APART * rng.standard_normal(shape)
        coin = rng.choice((-1.0, 1.0), shape)
        found = np.clip(mean + coin * (covariates + rest), -1.0, 1.0)
        return corrected(found, coin * np.clip(covariates + bias, -1.0, 1.0))

    return draw


def twin_rows(studies: int) -> list[list[str]]:
    """Return the rows of the table of twins: none, a right one, wrong ones."""
    cases: list[tuple[str, Draw]] = [
        ("none", apart(0.0)),
        ("fitted to the opening", apart(TOLD)),
        ("30 % too stiff, twice the friction", apart(TOLD_WRONGLY)),
        ("tells nothing", apart(0.0, bias=0.2)),
        ("explains half", apart(0.5)),
    ]
    rows = []
    for name, draw in cases:
        cells = []
        for mean in (0.0, 0.05, 0.1):
            question = SequentialQuestion(most=800)
            found = studied(draw, mean, question, studies, seed=17)
            shares = found["shares"]
            if mean == 0.0:
                cells += [_percent(shares["better"] + shares["worse"]), f"{found['spread']:.3f}"]
            else:
                cells += [_percent(shares["better"]), f"{found['median']:.0f}"]
        rows.append([name, *cells])
    return rows


def measure_places(places: int) -> Iterator[dict[str, Any]]:
    """Cut places of the fake rig, by two policies in turn; yield what came of each and what its twins had foretold."""
    rig = RigCutEnv(rig="fake", specimen_class="liver")
    simulator = simulator_like(rig, specimen_class="liver")
    policies = (
        OpenedPolicy(SCRIPTS[POLICIES[0]](), OPENING, rig.start_angle),
        OpenedPolicy(SCRIPTS[POLICIES[1]](), OPENING, rig.start_angle),
    )
    question = SequentialQuestion(most=places)
    comparison = RigComparison(rig=rig, simulator=simulator, policies=policies, names=POLICIES, question=question)
    try:
        for place in range(places):
            length = comparison.length(place)
            cut = cut_again(rig, policies[place % 2], [], seed=0, episode=place, target_length=length)
            if cut is None:
                continue
            key: dict[str, Any] = {"depth": np.array(rig.cutting.plant.depth), "seed": 0, "episode": place}
            value, right, wrong = comparison.outcomes, np.nan, np.nan
            with suppress(ValueError):  # the cut ended in its opening: no twin
                found = specimens_like(simulator, opening_of(cut.trace, OPENING), draws=DRAWS, **key)
                right, wrong = (
                    forecast(simulator, policies, each, target_length=length, value=value, **key).mean(axis=0)[0]
                    for each in (found, [_wrong(specimen) for specimen in found])
                )
            row = {"place": place, "turn": place % 2, "return": value(cut)[0], "right": right, "wrong": wrong}
            yield {name: float(number) for name, number in row.items()}
    finally:
        rig.close()


def _wrong(specimen: Specimen) -> Specimen:
    """Return a specimen that is 30 % stiffer and rubs twice as much."""
    return dataclasses.replace(
        specimen, modulus=1.3 * specimen.modulus, friction_per_depth=2.0 * specimen.friction_per_depth
    )


def places_report(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the spread of the difference of two places, and the shares that twins explain, with intervals."""
    own = {name: np.array([row[name] for row in rows]) for name in ("turn", "return", "right", "wrong")}
    rng = np.random.default_rng(0)
    by_policy = [np.flatnonzero(own["turn"] == k) for k in (0, 1)]
    again = [np.concatenate([rng.choice(each, len(each)) for each in by_policy]) for _ in range(_AGAIN)]

    def shares(some: Array) -> list[float]:
        """Return the spread and both shares, of places about the mean of their policy."""
        turn, rest = own["turn"][some], {}
        for name in ("return", "right", "wrong"):
            value = own[name][some]
            means = [np.nanmean(value[turn == k]) for k in (0, 1)]
            rest[name] = np.nan_to_num(value - np.where(turn == 0, *means))  # without a twin nothing is corrected
        spread = float(np.sqrt(2.0 * np.mean(rest["return"] ** 2)))
        return [spread, *(float(np.corrcoef(rest["return"], rest[name])[0, 1] ** 2) for name in ("right", "wrong"))]

    found = shares(np.arange(len(rows)))
    low, high = np.quantile([shares(some) for some in again], (0.05, 0.95), axis=0)
    header = ["of the difference of two places", "", "90 % interval"]
    names = ("standard deviation", "explained by twins", "explained by twins 30 % too stiff with twice the friction")
    cells = [
        [name, f"{found[k]:.2f}" if k == 0 else f"{100.0 * found[k]:.0f} %", _interval(low[k], high[k], k)]
        for k, name in enumerate(names)
    ]
    none = int(np.isnan(own["right"]).sum())
    made = f"{len(rows)} places, {none} of them without a twin, {' and '.join(POLICIES)} in turn"
    return f"{made}:\n\n{markdown_table(header, cells)}"


def _interval(low: float, high: float, k: int) -> str:
    return f"{low:.2f} to {high:.2f}" if k == 0 else f"{100.0 * low:.0f} to {100.0 * high:.0f} %"


def decision_table(studies: int = STUDIES) -> str:
    """Return the table of decisions as Markdown."""
    header = [
        "differences", "mean", "wrong decision", "interval ever wrong", "better", "equivalent", "median pairs",
        "fixed design", "saved", "fixed t test: differ", "t test after every pair: differ",
    ]  # fmt: skip
    return markdown_table(header, decision_rows(studies))


def twin_table(studies: int = STUDIES) -> str:
    """Return the table of twins as Markdown."""
    header = [
        "twin", "wrong at 0", "SD of a difference", "better at 0.05", "median pairs", "better at 0.1", "median pairs ",
    ]  # fmt: skip
    return markdown_table(header, twin_rows(studies))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--studies", type=int, default=STUDIES, metavar="N", help=f"default {STUDIES}")
    parser.add_argument("--block", choices=("decisions", "twins", "library"), help="print one table alone")
    parser.add_argument(
        "--measure", type=int, metavar="PLACES", help="cut so many places, and print what twins explain"
    )
    arguments = parser.parse_args()
    if arguments.measure is not None:
        with progress_bar("cutting", "place", total=arguments.measure) as bar:
            rows: list[dict[str, Any]] = []
            for row in measure_places(arguments.measure):
                rows.append(row)
                bar(1)
        keep(PLACES_FILE, rows)
        print(places_report(rows))
        return
    if arguments.block == "library":
        rows = library_rows(arguments.studies)
        keep_json(LIBRARY_FILE, rows)
        print(library_table(rows))
        return
    tables = {"decisions": decision_table, "twins": twin_table}
    print("\n\n".join(tables[name](arguments.studies) for name in tables if arguments.block in (None, name)))


if __name__ == "__main__":
    main()
