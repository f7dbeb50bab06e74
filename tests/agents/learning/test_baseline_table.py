"""What there is to learn: cuts rewarded as they were earlier, and findings that say what they find."""

from __future__ import annotations

import functools
import math
import sys

import pytest

from cutenv.agents.learning.evaluation import batched_rollout
from cutenv.agents.learning.statistics import write_csv
from cutenv.agents.policy import (
    CONSTANT_FEEDS,
    NULL_POLICIES,
    ORACLE,
    SCRIPTS,
    ConstantFeed,
    ProbeAndCreep,
    RandomAction,
    feed_name,
)
from scripts.benchmarks.policies import baseline_table
from scripts.benchmarks.policies.baseline_table import earlier_return, findings, report

EARLIER = {
    "progress": 1.0, "accuracy": 0.0, "success": 0.0, "uncontrolled": 0.15, "jump": 0.05, "force": 0.02, "lag": 0.03,
    "backward": 0.15, "haste": 0.1, "time": 0.15, "wedge": 0.2, "stored": 0.1,
}  # fmt: skip
"""Weights of the earlier reward, which charged 0.2 per 3 mm of tip error at the end besides."""
ENDINGS = {
    "finished": ({}, ProbeAndCreep()),
    "overshoot": ({}, ConstantFeed(speed=0.0089)),
    "force_limit": ({"force_limit_per_depth": 200.0}, ConstantFeed(speed=0.005)),
    "deadline": ({}, RandomAction()),
}


def paid(policy, seed: int, weights: dict[str, float] | None = None, **keywords: float) -> dict:
    """The row of a cut in an environment with these weights."""
    given = {f"weight_{name}": value for name, value in (weights or {}).items()}
    (cut,) = batched_rollout(policy, [seed], {"specimen_class": "vascular", **given, **keywords})
    return cut.scores()


@functools.cache
def row_that_ends(end: str) -> tuple[dict, int]:
    keywords, policy = ENDINGS[end]
    return next((row, seed) for seed in range(60) if (row := paid(policy, seed, **keywords))["end"] == end)


@pytest.mark.parametrize("end", ENDINGS)
def test_the_earlier_return_is_what_the_environment_pays_with_its_weights_less_the_tip_error(end):
    row, seed = row_that_ends(end)
    keywords, policy = ENDINGS[end]
    expected = paid(policy, seed, EARLIER, **keywords)["return"] - 0.2 * min(row["tip_error_mm"] / 3.0, 3.0)
    if end in ("overshoot", "force_limit"):
        expected -= 0.6
    assert earlier_return(row) == pytest.approx(expected, abs=1e-9)
    assert abs(earlier_return(row) - row["return"]) > 0.05, "else it would show nothing"


def test_a_row_from_a_file_is_rewarded_alike(tmp_path):
    row, _ = row_that_ends("overshoot")
    write_csv(tmp_path / "vascular.csv", [{"policy": "feed", **row, "earlier_return": earlier_return(row)}])
    (kept,) = baseline_table.kept(tmp_path, "vascular")
    assert earlier_return(kept) == earlier_return(row) == kept["earlier_return"]


CORNER, MIDDLE = feed_name(2.54, 45), feed_name(1.27, 45)
SCRIPTED = len(CONSTANT_FEEDS) + len(SCRIPTS)


def made_up(**means: float) -> list[dict]:
    """Rows of every baseline on four specimens; returns spread by 0.1 about the mean that is given, 0.3 else."""
    named = {"corner": CORNER, "middle": MIDDLE, "probing": "probe and creep", "bound": ORACLE, "nothing": "nothing"}
    given = {named[name]: mean for name, mean in means.items()}
    rows = []
    for policy in (*CONSTANT_FEEDS, *SCRIPTS, ORACLE, *NULL_POLICIES):
        for seed in range(4):
            idle = policy in NULL_POLICIES
            value = given.get(policy, -1.0 if idle else 0.3) + (0.0 if idle else 0.1 * (seed % 2 - 0.5))
            end = "deadline" if idle else "finished"
            row = {"policy": policy, "seed": seed, "end": end, "return": value, "earlier_return": value - 0.2}
            rows.append(row | {"success": 0.5, "tip_error_mm": 2.0})
    return rows


def test_the_best_feed_is_told_with_the_corner_and_the_lead_of_the_bound_in_widths():
    for score, mean in (("return", "0.600"), ("earlier_return", "0.400")):
        assert findings(made_up(corner=0.6), score)[0] == f"best constant feed: {CORNER}, {mean} (the corner)"
    found = findings(made_up(middle=0.6, corner=0.5), "return")[0]
    assert found == f"best constant feed: {MIDDLE}, 0.600; the corner 0.500"
    found = findings(made_up(probing=0.7, bound=0.9), "return")
    assert found[1] == "best script: probe and creep, 0.700"
    width = 2.0 * 1.96 * math.sqrt(4 * 0.05**2 / 3.0) / 2.0
    assert found[3].startswith("the planner with truth leads it by 0.200 [0.200, 0.200], ")
    assert found[3].endswith(f" {0.2 / width:.1f} widths of the script's interval")


def test_finished_cuts_that_score_no_better_than_doing_nothing_and_force_limits_are_counted():
    rows = made_up(nothing=-0.75)
    fine = findings(rows, "return")[4]
    assert fine.startswith(f"finished cuts that score no better than doing nothing (-0.750): 0 of {4 * SCRIPTED};")
    bad = [row for row in rows if row["policy"] == CORNER]
    bad[0]["return"], bad[1]["return"] = -0.75, -3.0
    bad[2]["return"], bad[2]["end"] = -3.0, "overshoot"  # not finished: it counts neither way
    next(row for row in rows if row["policy"] == ORACLE)["end"] = "force_limit"
    found = findings(rows, "return")
    assert f"(-0.750): 2 of {4 * SCRIPTED - 1}; the worst scores -3.000" in found[4]
    assert found[5].endswith("in 1 of 4 cuts")


def test_the_best_return_is_ranked_by_success():
    rows = made_up(probing=0.7)
    for row in rows:
        row["success"] = {CORNER: 0.9, MIDDLE: 0.8, "probe and creep": 0.7}.get(row["policy"], 0.5)
    said = f"best success of a script: {CORNER}, 0.900; the best script's is 0.700, rank 3 of {SCRIPTED}"
    assert findings(rows, "return")[2] == findings(rows, "earlier_return")[2] == said


def test_the_report_names_every_script_the_best_feed_the_bound_and_both_rewards():
    text = report(made_up(middle=0.6), "liver")
    assert "class liver, 4 specimens" in text
    for name in (*SCRIPTS, MIDDLE, ORACLE, *NULL_POLICIES, "rewards as before", "rewards as it is"):
        assert name in text
    assert CORNER not in text.splitlines()[3:]


def test_printing_what_was_never_measured_says_what_to_run(tmp_path, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["baseline_table.py", "--print", "--out", str(tmp_path), "--classes", "liver"])
    with pytest.raises(SystemExit, match=r"liver\.csv is missing; run 'python -m scripts\..*baseline_table' first"):
        baseline_table.main()
