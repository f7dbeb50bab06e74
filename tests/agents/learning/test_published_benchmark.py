"""The published comparison: of the present protocol and physics, plausible, small, and printed as it is kept."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.stats import norm

pytest.importorskip("tqdm", reason="the comparison needs an extra: pip install 'cutenv[rl]'")

from cutenv.agents.learning.benchmark import Protocol
from cutenv.agents.learning.evaluation import contestant, evaluate
from cutenv.agents.learning.statistics import interquartile_mean
from cutenv.agents.policy import NULL_POLICIES, ORACLE, SCRIPTS
from scripts.benchmarks.leaderboard.kept_cuts import DIGITS, file_of, read_run, read_runs
from scripts.benchmarks.leaderboard.protocol import BEST_FEED, ENTRIES, SCRIPTED, kept_protocol
from scripts.benchmarks.leaderboard.summary import Table
from scripts.benchmarks.leaderboard.table import PUBLISHED, read_table


@pytest.fixture(scope="module")
def table() -> Table:
    return read_table(PUBLISHED)


def test_it_follows_the_present_protocol():
    assert kept_protocol(PUBLISHED) == Protocol()


def test_it_is_of_the_present_physics_and_reward():
    kept = read_run(file_of(PUBLISHED, Protocol().script, None), Protocol()).by_class["mixed"][:10]
    script = {"it": contestant(Protocol().script)}
    measured = evaluate(script, Protocol().test_seeds[:10], {"specimen_class": "mixed"}, processes=1)
    for name in ("return", "tip_error_mm", "peak_force_N"):
        told = [float(row[name]) for row in kept]
        assert told == pytest.approx([row[name] for row in measured], abs=0.5 * 10.0 ** -DIGITS[name] + 1e-9)


def test_every_run_has_cut_every_specimen_of_every_class():
    runs = read_runs(PUBLISHED, Protocol())
    assert set(SCRIPTED) <= set(runs)
    for name, own in runs.items():
        seeds = [run.facts["training_seed"] for run in own]
        if name in SCRIPTED or name in ENTRIES:
            assert all(set(run.by_class) == set(Protocol().classes) for run in own), name
        if name in ENTRIES:
            assert set(seeds) <= set(ENTRIES[name].training_seeds(Protocol()))
        assert len(set(seeds)) == len(seeds)


def test_it_stays_small():
    assert sum(path.stat().st_size for path in PUBLISHED.rglob("*") if path.is_file()) < 3e6


def test_differences_are_taken_from_the_best_script(table):
    means = {name: table.line(name, table.headline, "return", "mean").interval.value for name in (BEST_FEED, *SCRIPTS)}
    assert max(means, key=means.__getitem__) == Protocol().script


def test_the_planner_that_is_shown_the_truth_is_above_all(table):
    bound = table.line(ORACLE, table.headline, "return")
    others = [table.line(name, table.headline, "return") for name in table.contestants if name != ORACLE]
    assert bound.interval.low > max(line.interval.high for line in others)


def test_scripts_and_agents_are_above_chance_and_idleness(table):
    idle = max(table.line(name, table.headline, "return").interval.high for name in NULL_POLICIES)
    for name in table.competitors():
        if name != "PPO without force":  # blind: most of its training runs come to little
            assert table.line(name, table.headline, "return").interval.low > idle


def test_what_the_best_of_many_entries_gains_is_what_the_page_says():
    """The best of k draws gains the mean of the largest of k normal numbers, times the standard error."""
    runs, script = (read_runs(PUBLISHED, Protocol())[name] for name in ("PPO", Protocol().script))
    own, theirs = (
        np.array([[float(row["return"]) for row in run.by_class["mixed"]] for run in some])
        for some in (runs[:5], script)
    )
    rng, x = np.random.default_rng(0), np.linspace(-8.0, 8.0, 8001)
    drawn = [rng.integers(own.shape[1], size=own.shape[1]) for _ in range(500)]
    errors = (
        np.std([interquartile_mean(own[:, which].ravel()) for which in drawn]),
        np.std([own[:, which].mean() for which in drawn]),
        np.std([own[:, which].mean() - theirs[:, which].mean() for which in drawn]),
    )
    factors = [np.trapezoid(x * np.gradient(norm.cdf(x) ** k, x), x) for k in (10, 100, 1000)]
    page = " ".join((PUBLISHED.parents[1] / "docs" / "results" / "leaderboard.md").read_text().split())
    assert "{:.2f} times with 10, {:.2f} with 100, {:.2f} with 1000".format(*factors) in page
    told = re.search(r"100 draws gain (\S+) of the interquartile mean, (\S+) of the mean and (\S+) of the paired", page)
    assert [float(number) for number in told.groups()] == pytest.approx(np.multiply(errors, factors[1]), abs=1e-3)
    assert f"{100.0 * (1.0 - 0.975**10):.0f} % (10 draws) or {100.0 * (1.0 - 0.975**100):.0f} % (100)" in page


def test_agents_that_kept_the_clone_are_one_row_and_have_no_rank(table):
    rows = {row[1]: row for row in table.main()[1]}
    assert rows["SAC, TQC"][0] == "–"
    assert not {"SAC", "TQC"} & {*rows, *table.competitors()}
