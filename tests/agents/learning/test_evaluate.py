"""Comparing policies: the same specimens for all, differences of pairs, and a command line that says what is wrong."""

from __future__ import annotations

import csv
import dataclasses
import math
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from program import command, run

from cutenv.agents.learning.arguments import PPOArguments
from cutenv.agents.learning.evaluation import Contestant, batched_rollout, contestant, evaluate
from cutenv.agents.learning.seeds import TEST_SEEDS, VALIDATION_SEEDS
from cutenv.agents.learning.statistics import (
    best_script,
    by_policy,
    differences,
    mean_with_interval,
    summarise,
    write_csv,
)
from cutenv.agents.policy import (
    BASELINES,
    SHIPPED,
    ConstantFeed,
    NoAction,
    PlannerWithTruth,
    RandomAction,
)
from cutenv.commands.evaluate import main
from cutenv.sim.tissue import measured_liver
from cutenv.task.reward import TERMS

# Two policies on three specimens: differences of return 0.2, 0.1 and 0.3; of success 1, 0 and 0.
ROWS = [
    {"policy": policy, "seed": seed, "end": "finished", "return": value, "success": success}
    for policy, values in {
        "ours": [(7, 0.7, 1.0), (8, 0.5, 1.0), (9, 0.9, 0.0)],
        "theirs": [(9, 0.6, 0.0), (7, 0.5, 0.0), (8, 0.4, 1.0)],  # in another order
    }.items()
    for seed, value, success in values
]


def close(row: dict, mean: float, error: float) -> bool:
    expected = {"mean": mean, "low_95": mean - error, "high_95": mean + error}
    return all(row[name] == pytest.approx(value, abs=1e-12) for name, value in expected.items())


def test_a_mean_has_an_interval_of_1_96_standard_errors():
    assert close(mean_with_interval([1.0, 2.0, 6.0]), 3.0, 1.96 * math.sqrt(7.0 / 3.0))
    assert mean_with_interval([1.0, 2.0, 6.0])["cuts"] == 3
    assert math.isnan(mean_with_interval([1.0])["low_95"])


def test_differences_are_those_of_pairs_on_the_same_specimen():
    of_return, of_success = differences(ROWS, "ours")
    assert (of_return["policy"], of_return["baseline"], of_return["score"]) == ("ours", "theirs", "return")
    assert close(of_return, 0.2, 1.96 * 0.1 / math.sqrt(3.0))
    assert of_success["score"] == "success"
    assert close(of_success, 1.0 / 3.0, 1.96 * math.sqrt(1.0 / 3.0) / math.sqrt(3.0))


def test_a_policy_that_met_other_specimens_cannot_be_compared():
    elsewhere = [row | {"seed": row["seed"] + 1} if row["policy"] == "theirs" else row for row in ROWS]
    with pytest.raises(KeyError):
        differences(elsewhere, "ours")


def test_a_summary_has_every_number_of_every_policy_and_no_text():
    summary = summarise(ROWS)
    assert [(row["policy"], row["score"]) for row in summary] == [
        (policy, score) for policy in ("ours", "theirs") for score in ("return", "success")
    ]
    assert summary[0]["mean"] == pytest.approx(0.7)
    assert list(by_policy(ROWS)) == ["ours", "theirs"]
    assert best_script(summary, ["theirs", "ours", "nobody"]) == "ours"
    assert best_script(summary, ["theirs"]) == "theirs"


CONTESTANTS = {"feed": Contestant(ConstantFeed(speed=0.02)), "random": Contestant(RandomAction())}
SHORT = {"deadline_s": 1.0, "specimen_class": "mixed"}


@pytest.fixture(scope="module")
def rows() -> list[dict]:
    return evaluate(CONTESTANTS, TEST_SEEDS[:12], SHORT)


def test_rows_come_in_order_and_all_meet_the_same_specimens(rows):
    assert [(row["policy"], row["seed"]) for row in rows] == [
        (name, seed) for name in CONTESTANTS for seed in TEST_SEEDS[:12]
    ]
    one, other = by_policy(rows).values()
    for score in ("specimen_class", "target_length_mm"):
        assert [row[score] for row in one] == [row[score] for row in other]
    assert len({row["target_length_mm"] for row in one}) == 12


def test_a_row_is_the_cut_that_one_gets_alone_whatever_was_cut_before(rows):
    (cut,) = batched_rollout(RandomAction(), [TEST_SEEDS[5]], SHORT, readings=True)
    alone = cut.scores()
    assert {"policy": "random", **alone} == rows[12 + 5]
    assert len(cut.readings) == 1000
    assert alone["return"] == pytest.approx(sum(alone[f"reward_{term}"] for term in TERMS), abs=1e-12)
    assert alone["peak_force_N"] == cut.readings["true_force"].max()
    assert alone["end"] == "deadline"


def test_a_policy_that_sees_the_truth_is_shown_it_and_no_other():
    shown = []

    class Planner(PlannerWithTruth):
        def set_states(self, cuttings):
            shown.extend(cuttings)
            super().set_states(cuttings)

    batched_rollout(Planner(rounds=0), TEST_SEEDS[:2], {"deadline_s": 2.0})
    lengths = [cut.truth["target_length_m"] for cut in batched_rollout(NoAction(), TEST_SEEDS[:2], {"deadline_s": 2.0})]
    assert [cutting.target_length for cutting in shown] == lengths


def test_csv_files_are_read_back_as_written(tmp_path, rows):
    path = tmp_path / "scores.csv"
    write_csv(path, rows)
    with path.open() as file:
        again = list(csv.DictReader(file))
    assert [float(row["return"]) for row in again] == [row["return"] for row in rows]
    assert list(again[0]) == list(rows[0])
    assert [each.name for each in tmp_path.iterdir()] == ["scores.csv"], "no part is left"


def test_a_folder_is_a_policy_in_the_environment_that_it_needs(folder):
    given = contestant(str(folder))
    assert given.arguments == {"control_hz": 10, "angle_mode": "free"}
    assert math.isfinite(batched_rollout(given.policy, [0], given.arguments)[0].scores()["return"])
    assert contestant(str(folder.parent)).arguments == given.arguments, "the folder of a run stands for its policy"


def test_a_class_of_ones_own_is_compared_at_the_rate_that_it_tells(tmp_path, monkeypatch, capsys):
    (tmp_path / "my_still_policy.py").write_text(
        "from cutenv.agents.policy import NoAction\n\n\n"
        "class Still(NoAction):\n    environment_arguments = {'control_hz': 10}\n"
    )
    monkeypatch.chdir(tmp_path)
    given = contestant("my_still_policy:Still")
    assert isinstance(given.policy, NoAction)
    assert given.arguments == {"control_hz": 10}
    assert main(["my_still_policy:Still", "nothing", "--specimens", "2"]) == 0
    assert "my_still_policy:Still" in capsys.readouterr().out
    with pytest.raises(ValueError, match="no attribute 'Stil'"):
        contestant("my_still_policy:Stil")


@pytest.mark.parametrize("given", ["probe and crep", "Probe and Creep"])
def test_a_baseline_is_known_by_name_and_for_what_is_none_the_nearest_is_named(given):
    assert isinstance(contestant("nothing").policy, NoAction)
    with pytest.raises(ValueError, match=f"policy {given!r} is not known. Did you mean 'probe and creep'\\?"):
        contestant(given)


def test_the_list_names_every_script_and_agent_and_the_constant_feeds_in_one_line(capsys):
    assert main(["--list"]) == 0
    lines = [line.strip() for line in capsys.readouterr().out.splitlines()]
    feeds = [name for name in BASELINES if name.startswith("constant ")]
    assert {*BASELINES, *SHIPPED} - {*feeds} <= set(lines)
    assert [line for line in lines if line.startswith("constant V")] == [
        f"constant V cm/s A deg ({len(feeds)} of them): {feeds[0]} ... {feeds[-1]}"
    ]


def test_an_interval_stays_within_what_a_mean_can_be():
    rows = [{"policy": "p", "seed": k, "success": float(k > 0), "tip_error_mm": 9.0 * (k == 0)} for k in range(9)]
    found = {row["score"]: row for row in summarise(rows)}
    assert found["success"]["high_95"] == 1.0
    assert found["tip_error_mm"]["low_95"] == 0.0


@pytest.mark.parametrize("number", ["1", "0", "-3", "1000001"])
def test_a_number_of_specimens_that_makes_no_sense_is_refused(capsys, number):
    assert main(["nothing", "--specimens", number]) == 2
    assert f"cutenv evaluate: --specimens {number} is outside 2 to 1000000" in capsys.readouterr().err


def test_a_class_that_is_none_is_refused(capsys):
    with pytest.raises(SystemExit):
        main(["nothing", "--specimen-class", "livr"])
    assert "livr" in capsys.readouterr().err


def test_specimens_are_drawn_of_a_tissue_of_ones_own(tmp_path, capsys):
    """Half as stiff and tough: the same script meets half the force; a file that is none is refused."""
    liver, file = measured_liver(), tmp_path / "soft.json"
    soft = dataclasses.replace(liver, modulus=0.5 * liver.modulus, fracture_resistance=0.5 * liver.fracture_resistance)
    file.write_text(soft.to_json(), encoding="utf-8")
    forces = []
    for given in ([], ["--tissue", str(file)]):
        assert main(["constant 1.27 cm/s 90 deg", "--specimens", "10", "--out", str(tmp_path), *given]) == 0
        with (tmp_path / "scores.csv").open(encoding="utf-8") as scores:
            forces.append(np.mean([float(row["peak_force_N"]) for row in csv.DictReader(scores)]))
    assert 0.3 < forces[1] / forces[0] < 0.7
    assert f"of class mixed of {file}" in capsys.readouterr().out
    assert PPOArguments(tissue=str(file)).environment["tissue"] == str(file)
    assert main(["nothing", "--tissue", str(tmp_path / "none.json")]) == 2
    assert "no such file" in capsys.readouterr().err


def test_the_program_compares_a_trained_policy_with_a_baseline(folder, tmp_path):
    arguments = (str(folder), "nothing", "--specimens", "2", "--processes", "1", "--out", "scores")
    done = run("evaluate", tmp_path, *arguments)
    assert done.returncode == 0, done.stderr
    assert "2 held-out specimens of class mixed" in done.stdout
    differences_shown = done.stdout.partition(f"{folder} minus each other on the same specimens")[2].splitlines()
    assert differences_shown[2].split("  ")[-1].strip() == "by return"  # the columns are named
    assert {path.name for path in (tmp_path / "scores").iterdir()} == {"scores.csv", "summary.csv", "differences.csv"}
    with (tmp_path / "scores" / "scores.csv").open() as file:
        scores = list(csv.DictReader(file))
    assert [int(row["seed"]) for row in scores] == [*TEST_SEEDS[:2]] * 2


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no process group to press Ctrl-C for")
@pytest.mark.parametrize("shown", [r" 0/", r" [1-9]\d*/"], ids=["workers import", "workers cut"])
def test_ctrl_c_ends_an_evaluation_and_its_workers_in_one_line(shown: str, tmp_path: Path) -> None:
    line = [*command("evaluate"), "probe and creep", "--specimens", "5000", "--processes", "2"]
    process = subprocess.Popen(
        line, cwd=tmp_path, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stderr is not None
    printed, deadline = "", time.monotonic() + 240.0
    try:
        while not re.search(shown, printed) and process.poll() is None and time.monotonic() < deadline:
            printed += process.stderr.read(1)
        time.sleep(0.2)  # into what the workers are at
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does, to all of them, once
        printed += process.communicate(timeout=20)[1]
        assert process.returncode == 130, printed
        assert "Traceback" not in printed
        assert printed.rstrip().splitlines()[-1] == "cutenv evaluate: interrupted; nothing was written"
        end = time.monotonic() + 5.0
        while _alive(process.pid) and time.monotonic() < end:
            time.sleep(0.1)
        assert not _alive(process.pid)
    finally:
        if _alive(process.pid):
            os.killpg(process.pid, signal.SIGKILL)


def _alive(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def test_two_policies_are_compared_until_it_is_decided(tmp_path, capsys):
    pytest.importorskip("matplotlib", reason="pictures are an extra: pip install 'cutenv[view]'")
    given = ["probe and creep", "nothing", "--until", "decided", "--validation"]
    assert main([*given, "--out", str(tmp_path)]) == 0
    assert re.search(r"probe and creep is better than nothing in return, after \d+ specimens", capsys.readouterr().out)
    with (tmp_path / "pairs.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 20, "it stopped at its first look"
    assert [int(row["seed"]) for row in rows] == list(VALIDATION_SEEDS[:20])
    assert main(["ppo-free", *given]) == 2
    assert "compares two policies, and 3 are given" in capsys.readouterr().err
