"""The comparison that the README shows: whole, plausible, of the present physics, and printed as it is kept."""

from __future__ import annotations

import json

import numpy as np
import pytest

pytest.importorskip("tqdm", reason="the comparison needs an extra: pip install 'cutenv[rl]'")

from evaluate import contestant, evaluate
from leaderboard import PUBLISHED, Table, origin_of, read_table
from protocol import BEST_FEED, ENTRIES, SCRIPTED, Protocol, content_of

from cutenv.policy import BOUND, IDLE, SCRIPTS

TRAINED = {name: len(Protocol().training_seeds) for name in ENTRIES}


@pytest.fixture(scope="module")
def table() -> Table:
    return read_table(PUBLISHED)


def test_it_follows_the_present_protocol():
    assert json.loads((PUBLISHED / "protocol.json").read_text()) == content_of(Protocol())
    (commit,) = origin_of(PUBLISHED)["commits"]
    assert len(commit) == 40  # of one clean checkout: another would be marked


@pytest.mark.parametrize("name", [*ENTRIES, *SCRIPTED])
def test_everyone_has_cut_every_specimen_of_every_class(table, name):
    for kind in Protocol().classes:
        line = table.line(name, kind, "return")
        assert line is not None
        assert line.cuts == Protocol().specimens * TRAINED.get(name, 1)


def test_the_planner_that_is_shown_the_truth_is_above_all(table):
    bound = table.line(BOUND, table.headline, "return")
    others = [table.line(name, table.headline, "return") for name in (*ENTRIES, *SCRIPTED) if name != BOUND]
    assert bound.interval.low > max(line.interval.high for line in others)


def test_scripts_and_agents_are_above_chance_and_idleness(table):
    idle = max(table.line(name, table.headline, "return").interval.high for name in IDLE)
    for name in (BEST_FEED, *SCRIPTS, *ENTRIES):
        assert table.line(name, table.headline, "return").interval.low > idle


@pytest.mark.parametrize("name", SCRIPTS)
def test_it_is_of_the_present_physics_and_reward(name):
    kept = origin_of(PUBLISHED)["returns"][name]
    rows = evaluate({name: contestant(name)}, [int(seed) for seed in kept], {"specimen_class": "mixed"})
    apart = [abs(float(row["return"]) - kept[str(row["seed"])]) for row in rows]
    # A linear algebra library rounds by machine and threads, which now and then moves a decision; what changes physics
    # or reward changes every cut.
    assert len(apart) == 10
    assert np.median(apart) < 1e-6
