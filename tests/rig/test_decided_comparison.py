"""Two policies on a rig until it is decided: nothing is lost on the way, and what is told is what was cut."""

from __future__ import annotations

import csv
import dataclasses
import json

import numpy as np
import pytest

from cutenv.agents.policy import BASELINES, ConstantFeed
from cutenv.agents.sim_to_real.paired_experiment import cut_again, cut_once, simulator_like
from cutenv.agents.sim_to_real.sequential_experiment import KeptCuts, OpenedPolicy, RigComparison, opening_of
from cutenv.commands.cli import main
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.records.scoring.study.sequential import SequentialQuestion
from cutenv.rig.errors import RigError

SHORT = {"target_length": 0.04, "specimen_class": "liver"}
FEED, NOTHING, FASTER = "constant 1.65 cm/s 90 deg", "nothing", "constant 2.54 cm/s 90 deg"
FEEDS = type(BASELINES[FEED]())
pytestmark = pytest.mark.usefixtures("quick_return")


def compared(rig=None, **keywords):
    """A feed against a policy that does nothing: the first is better by most of the return."""
    rig = rig or RigCutEnv(rig="fake", deadline_s=4.0, **SHORT)
    policies = (BASELINES[FEED](), BASELINES[NOTHING]())
    question = SequentialQuestion(most=keywords.pop("most", 30))
    return RigComparison(
        rig=rig, simulator=simulator_like(rig, **SHORT), policies=policies, names=(FEED, NOTHING), question=question,
        **keywords,
    )  # fmt: skip


def test_it_ends_when_it_is_decided_and_goes_on_where_it_was_interrupted(tmp_path, monkeypatch):
    comparison = compared()
    made, whole = [], RigComparison._cut

    def interrupted(self, pair, turn, policy):
        if len(made) == 3:
            raise KeyboardInterrupt
        made.append((pair, turn))
        return whole(self, pair, turn, policy)

    monkeypatch.setattr(RigComparison, "_cut", interrupted)
    with pytest.raises(KeyboardInterrupt):
        comparison.run(KeptCuts(tmp_path, {"seed": 0}))
    with (tmp_path / "cuts.jsonl").open("a") as file:
        file.write('{"pair": 1, "tu')  # the power failed in the middle of a line
    monkeypatch.setattr(RigComparison, "_cut", whole)
    kept = KeptCuts(tmp_path, {"seed": 0})
    assert [(cut["pair"], cut["turn"]) for cut in kept.cuts] == made == [(0, 0), (0, 1), (1, 0)]
    assert kept.open_pair == 1
    assert "pair 2 has one cut alone" in " ".join(comparison.report(kept).notes)
    comparison.run(kept)
    report = comparison.report(KeptCuts(tmp_path, {"seed": 0}))
    assert report.decision == "better"
    assert len(report.rows) == report.outcomes[0].decision[0] < 30, "it stopped at the decision"
    assert {row["policy_first"] for row in report.rows} == {FEED, NOTHING}, "a coin gives the order"
    assert all(row["first_specimen"] == row["second_specimen"] for row in report.rows)


def test_another_question_in_the_same_folder_is_refused(tmp_path):
    KeptCuts(tmp_path, {"seed": 0, "error": 0.05})
    KeptCuts(tmp_path, {"seed": 0, "error": 0.05})
    with pytest.raises(ValueError, match=r"error = 0\.05, and 0\.2 was asked for"):
        KeptCuts(tmp_path, {"seed": 0, "error": 0.2})
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "mine.txt").touch()
    with pytest.raises(FileExistsError, match="not empty"):
        KeptCuts(tmp_path / "other", {})


def test_a_pair_that_cannot_be_completed_is_told_and_left_out(tmp_path):
    kept = KeptCuts(tmp_path, {})
    for pair, turn, policy, value in ((0, 0, 1, 0.2), (0, 1, 0, 0.7), (1, 0, 0, 0.0)):
        kept.add(
            {"pair": pair, "turn": turn, "policy": policy, "specimen": pair, "day": f"2026-01-0{pair + 1}",
             "end": "stopped" if value == 0.0 else "finished", "stopped": value == 0.0, "return": value,
             "clipped": value, "success": 0.0, "foretold": None}
        )  # fmt: skip
    comparison = compared()
    kept.add({"pair": kept.open_pair, "missing": "the liver fell"})
    found, _ = comparison.differences(kept)
    assert found[0] == pytest.approx([0.5])
    assert kept.open_pair is None
    assert "pair 2 is missing: the liver fell" in comparison.report(kept).notes


def test_a_rig_that_cannot_go_on_keeps_what_was_cut(tmp_path, monkeypatch):
    comparison = compared()

    def ended(env, policy, between, **keywords):
        between.append("specimen 1: the operator stopped it.")

    monkeypatch.setattr("cutenv.agents.sim_to_real.sequential_experiment.cut_again", ended)
    with pytest.raises(RigError, match=r"the operator stopped it.*give the same command again"):
        comparison.run(KeptCuts(tmp_path, {}))


def test_a_stop_for_safety_counts(tmp_path, monkeypatch):
    comparison = compared(most=2)

    def stopped(env, policy, between, **keywords):
        cut = cut_again(env, policy, between, **keywords)
        return dataclasses.replace(cut, end="stopped", success=False, value=-0.7) if isinstance(policy, FEEDS) else cut

    monkeypatch.setattr("cutenv.agents.sim_to_real.sequential_experiment.cut_again", stopped)
    kept = KeptCuts(tmp_path, {})
    comparison.run(kept)
    feeds = [cut for cut in kept.cuts if cut["policy"] == 0]
    found = [(cut["stopped"], cut["return"], cut["clipped"], cut["success"]) for cut in feeds]
    assert found == 2 * [(True, -0.7, 0.0, 0.0)]
    assert f"no success: 2 by {FEED}, 0 by {NOTHING}" in " ".join(comparison.report(kept).notes)


def test_an_opening_is_the_same_whoever_takes_over_and_its_twins_know_no_more(tmp_path):
    rig = RigCutEnv(rig="fake", **SHORT)
    policies = [OpenedPolicy(one, 0.02, rig.start_angle) for one in (ConstantFeed(speed=0.02), BASELINES[FEED]())]
    records = [opening_of(cut_once(rig, one, seed=3, episode=2).trace, 0.02) for one in policies]
    assert np.array_equal(records[0].force, records[1].force)
    assert records[0].position.max() < 0.02
    rig.close()
    with pytest.raises(ValueError, match="side by side"):
        compared(opening=0.02)
    comparison = compared(apart=True, opening=0.02, draws=1, most=2)
    kept = KeptCuts(tmp_path, {})
    comparison.run(kept)
    assert [cut["specimen"] for cut in kept.cuts] == [0, 1, 2, 3]
    assert all(0.0 <= cut["foretold"][0] <= 1.0 for cut in kept.cuts)
    (found, room), (raw, _) = comparison.differences(kept), comparison.differences(kept, correct=False)
    assert np.abs(found - raw) == pytest.approx(room)
    assert room[0, 0] == 0.0, "the first pair has no earlier ones"


def test_the_command_writes_page_and_raw_pairs(tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")
    arrow = pytest.importorskip("pyarrow.parquet", reason="Parquet is an extra")
    out = tmp_path / "out"
    given = ["rig", "evaluate", FEED, FASTER, "--until", "decided", "--rig", "fake", "--target-length", "40mm"]
    assert main([*given, "--most", "2", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert f"{FEED} against {FASTER} is undecided in return, after 2 pairs" in said
    with (out / "pairs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["return_difference"]) for row in rows] == pytest.approx(
        [max(float(row["first_return"]), 0.0) - max(float(row["second_return"]), 0.0) for row in rows]
    )
    assert arrow.read_table(out / "pairs.parquet").num_rows == 2
    assert "undecided, after 2" in said or "undecided" in (out / "decision.html").read_text()
    assert json.loads((out / "study.json").read_text())["seed"] == 0
    assert main([*given, "--most", "3", "--out", str(out)]) == 0, "more pairs may be asked for later"
    assert main([*given, "--most", "3", "--error", "0.2", "--out", str(out)]) == 2
    assert "error = 0.05, and 0.2" in capsys.readouterr().err


def test_a_plan_comes_before_the_first_cut(capsys):
    given = ["rig", "plan", FEED, NOTHING, "--rig", "fake", "--target-length", "40mm", "--pilot", "20", "--most", "30"]
    assert main(given) == 0
    assert "nine in ten within" in capsys.readouterr().out
    assert main([*given[:3], FEED, *given[4:]]) == 2
    assert "two different policies" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ([FEED, NOTHING], "POLICY OTHER --until decided"),
        ([FEED, "--until", "decided"], "two different policies"),
        ([FEED, NOTHING, "--until", "decided", "--policy", FEED], "--policy is for one policy"),
        ([FEED, NOTHING, "--until", "decided", "--smallest", "3"], "smallest = 3"),
        ([FEED, NOTHING, "--until", "decided", "--opening", "10mm"], "--opening"),
        ([FEED, NOTHING, "--until", "decided", "--missing", "fell"], "--missing is for a pair with one cut"),
    ],
)
def test_what_cannot_be_asked_is_said_before_a_cut(given, told, tmp_path, capsys):
    assert main(["rig", "evaluate", *given, "--rig", "fake", "--out", str(tmp_path / "out")]) == 2
    assert told in capsys.readouterr().err
