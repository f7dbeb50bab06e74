"""The published comparison: whole, plausible, of a version that it names, and printed as it is kept."""

from __future__ import annotations

import json

import pytest

pytest.importorskip("tqdm", reason="the comparison needs an extra: pip install 'cutenv[rl]'")

from benchmark.protocol import BEST_FEED, ENTRIES, SCRIPTED, Protocol, content_of
from benchmark.summary import Table
from benchmark.table import PUBLISHED, about, earlier, origin_of, read_table

from cutenv.policy import NULL_POLICIES, ORACLE, SCRIPTS

LATER = {"return stroke"}
"""Scripts that are younger than the published comparison."""
OLDER = [name for name in SCRIPTED if name not in LATER]
TRAINED = {name: len(Protocol().training_seeds) for name in ENTRIES}


@pytest.fixture(scope="module")
def table() -> Table:
    return read_table(PUBLISHED)


def test_it_follows_the_present_protocol():
    kept = json.loads((PUBLISHED / "protocol.json").read_text())
    assert kept == content_of(Protocol()) | {"environment": kept["environment"]}
    (commit,) = origin_of(PUBLISHED)["commits"]
    assert len(commit) == 40  # of one clean checkout: another would be marked


@pytest.mark.parametrize("name", [*ENTRIES, *OLDER])
def test_everyone_has_cut_every_specimen_of_every_class(table, name):
    for kind in Protocol().classes:
        line = table.line(name, kind, "return")
        assert line is not None
        assert line.cuts == Protocol().specimens * TRAINED.get(name, 1)


def test_the_planner_that_is_shown_the_truth_is_above_all(table):
    bound = table.line(ORACLE, table.headline, "return")
    others = [table.line(name, table.headline, "return") for name in (*ENTRIES, *OLDER) if name != ORACLE]
    assert bound.interval.low > max(line.interval.high for line in others)


def test_scripts_and_agents_are_above_chance_and_idleness(table):
    idle = max(table.line(name, table.headline, "return").interval.high for name in NULL_POLICIES)
    for name in (BEST_FEED, *(name for name in SCRIPTS if name not in LATER), *ENTRIES):
        assert table.line(name, table.headline, "return").interval.low > idle


def test_it_says_so_where_it_is_not_of_the_present_physics(table):
    assert table.protocol.environment == "cutenv/GentleCut-v0"
    assert about(table).startswith("Measured on GentleCut-v0, which has another tissue and cutting law")
    assert earlier(Protocol().environment) == ""
