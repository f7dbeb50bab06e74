"""Submissions: what a file says is repeated to the last bit, and what was changed is refused with the cut's name."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("tqdm", reason="the evaluation needs an extra: pip install 'cutenv[rl]'")
pytest.importorskip("safetensors", reason="policies are an extra: pip install 'cutenv[rl]'")

from cutenv.commands import submit
from cutenv.learning import benchmark
from cutenv.learning.benchmark import (
    QUICK,
    TABLE_COLUMNS,
    Protocol,
    Submission,
    read_submission,
    replayed,
    returns_after,
    standing,
    submitted_run,
    write_submission,
)
from cutenv.learning.evaluation import contestant, evaluate
from cutenv.policy import ConstantFeed
from cutenv.policy.actor_network import Network

FEW = dataclasses.replace(QUICK, specimens=6, sweep_specimens=2, resamples=50)


def entry(*runs, protocol=FEW) -> Submission:
    return Submission("mine", "A. Name", "https://example.org/mine", "2026-11-23", protocol, runs)


@pytest.fixture(scope="module")
def shipped():
    return submitted_run(contestant("ppo-free"), returns_after([]), FEW)


@pytest.fixture
def written(shipped, tmp_path: Path) -> Path:
    path = tmp_path / "submission.json"
    write_submission(path, entry(shipped))
    return path


def changed(path: Path, change) -> Path:
    content = json.loads(path.read_text())
    change(content)
    path.write_text(json.dumps(content))
    return path


def test_a_submission_says_what_the_evaluation_says_and_its_replay_says_the_same(shipped, written):
    measured = evaluate({"it": contestant("ppo-free")}, FEW.test_seeds, {"specimen_class": "mixed"}, processes=1)
    assert list(shipped.returns) == [row["return"] for row in measured]
    read = read_submission(written, [FEW])
    assert read.author == "A. Name"
    assert read.runs[0].returns == shipped.returns
    assert all(np.array_equal(*pair) for pair in zip(read.runs[0].actions, shipped.actions, strict=True))
    (rows,) = replayed(read)
    assert [{"policy": "it", **row} for row in rows] == measured


def test_one_changed_action_is_refused_with_its_cut(shipped):
    actions = [own.copy() for own in shipped.actions]
    actions[4][10, 0] += 0.01
    with pytest.raises(ValueError, match=f"run 1, specimen {FEW.test_seeds[4]}: .* Refused"):
        replayed(entry(dataclasses.replace(shipped, actions=tuple(actions))))


def test_one_changed_bit_of_a_return_is_refused_with_its_cut(shipped):
    returns = list(shipped.returns)
    returns[2] = float(np.nextafter(returns[2], 1.0))
    with pytest.raises(ValueError, match=f"specimen {FEW.test_seeds[2]}: its replay returns .* Refused"):
        replayed(entry(dataclasses.replace(shipped, returns=tuple(returns))))


@pytest.mark.parametrize("more", [-1, 1])
def test_decisions_that_are_left_out_or_never_made_are_refused(shipped, more):
    first = shipped.actions[0]
    other = first[:-1] if more < 0 else np.concatenate([first, first[-1:]])
    run = dataclasses.replace(shipped, actions=(other, *shipped.actions[1:]))
    with pytest.raises(ValueError, match=f"its replay takes {len(first)} decisions, not {len(other)}"):
        replayed(entry(run))


def test_a_policy_of_python_floats_is_recorded_as_it_acted():
    class Mine:
        def reset(self, rng):
            self.speed = rng.uniform(0.1, 0.9)

        def __call__(self, observation):
            return [self.speed, 1.0 / 3.0]

    from cutenv.learning.evaluation import Contestant

    run = submitted_run(Contestant(Mine(), {"control_hz": 5}), {}, FEW)
    assert len(replayed(entry(run))[0]) == FEW.specimens


DAMAGES = {
    "it is not whole, or no JSON": lambda text: text[: len(text) // 2],
    "it is no file of cutenv submit": lambda text: "[1, 2]",
    "'author' is missing": lambda text: text.replace('"author"', '"auhtor"'),
    "author is ' '; give a text": lambda text: text.replace("A. Name", " "),
    r"author is 'A \| B'; give one line": lambda text: text.replace("A. Name", "A | B"),
    "made for protocol 2 of": lambda text: text.replace('"protocol": "quick"', '"protocol": "2"'),
    "environment argument 'dead_time' is the protocol's": lambda text: text.replace('"angle_mode"', '"dead_time"'),
    "its format is 9, not 1": lambda text: text.replace('"cutenv_submission": 1', '"cutenv_submission": 9'),
    "(Error|ncorrect|Invalid|rror|padding)": lambda text: text.replace('"actions": "', '"actions": "QUJD'),
}


@pytest.mark.parametrize("said", DAMAGES)
def test_a_damaged_file_is_refused_with_what_is_wrong(written, said):
    written.write_text(DAMAGES[said](written.read_text()))
    with pytest.raises(ValueError, match=said) as error:
        read_submission(written, [FEW])
    assert str(error.value).startswith(str(written))


def test_actions_that_no_policy_may_take_and_cuts_that_are_missing_are_refused(shipped, written):
    actions = [own.copy() for own in shipped.actions]
    actions[1][0, 1] = np.nan
    write_submission(written, entry(dataclasses.replace(shipped, actions=tuple(actions))))
    with pytest.raises(ValueError, match=rf"specimen {FEW.test_seeds[1]}: .*nan.* is outside \[-1, 1\]"):
        read_submission(written, [FEW])
    write_submission(written, entry(dataclasses.replace(shipped, returns=shipped.returns[:-1])))
    with pytest.raises(ValueError, match="run 1 holds 5 cuts, not the 6"):
        read_submission(written, [FEW])
    write_submission(written, entry(shipped, shipped))
    with pytest.raises(ValueError, match="runs 1 and 2 are the same"):
        read_submission(written, [FEW])


def test_whoever_is_shown_the_hidden_state_takes_no_part():
    with pytest.raises(ValueError, match="shown the hidden state, so it takes no part"):
        submitted_run(contestant("planner with truth"), {}, FEW)


def test_a_row_holds_return_difference_and_success_of_all_runs():
    rows = [{"seed": n, "specimen_class": "liver", "return": 0.1 * n, "success": n % 2} for n in range(8)]
    better = [row | {"return": row["return"] + 0.2} for row in rows]
    found = {column.heading: interval for column, interval in standing([rows, better], rows, FEW).items()}
    assert found["return (mean)"].value == pytest.approx(0.45)
    assert found["minus best script"].value == pytest.approx(0.1)
    assert found["success [%]"].value == pytest.approx(0.5)
    assert len(found) == 4 < len(TABLE_COLUMNS)  # what these rows lack is left out


def test_the_return_after_a_number_of_cuts_is_the_best_by_then():
    curve = [
        {"cuts": 90.0, "return": 9.0},
        {"cuts": 900.0, "validation_return": 0.5},
        {"cuts": 950.0, "validation_return": 0.4},
        {"cuts": 40_000.0, "validation_return": 0.7},
    ]
    assert returns_after(curve) == {"100": None, "1,000": 0.5, "10,000": 0.5, "all": 0.7}
    assert set(returns_after([{"validation_return": 0.5}]).values()) == {None}  # of a version that counted no cuts


@pytest.fixture
def few(monkeypatch, tmp_path: Path) -> Path:
    """Let the command's quick protocol have few specimens."""
    monkeypatch.setattr("cutenv.learning.benchmark.QUICK", FEW)
    monkeypatch.setattr(benchmark.read_submission, "__defaults__", ((Protocol(), FEW),))
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_quick_submission_is_made_checked_and_said_to_be_no_entry(few, capsys):
    assert submit.main(["ppo-free", "--author", "me", "--quick"]) == 0
    made = capsys.readouterr().out
    assert "every return of 6 cuts repeated to the last bit" in made
    assert "a quick one is no entry" in made
    assert submit.main(["--check", "submission.json"]) == 0
    assert capsys.readouterr().out in made
    changed(few / "submission.json", lambda content: content["runs"][0]["returns"].__setitem__(3, 0.99))
    assert submit.main(["--check", "submission.json"]) == 2
    assert f"specimen {FEW.test_seeds[3]}: its replay returns" in capsys.readouterr().err


def test_the_folder_of_a_run_is_enough_and_its_curve_is_told(few, capsys):
    from cutenv.policy import Features, save_policy

    size = Features(history=0).size
    network = Network(((np.zeros((2, size), np.float32), np.array([0.5, 1.0], np.float32)),))
    about = {"environment": FEW.environment, "environment_arguments": {"control_hz": 10}}
    save_policy("runs/it/policy", network, **about, features={"history": 0}, training={})
    Path("runs/it/learning_curve.csv").write_text("decisions,cuts,validation_return\n9000,99,0.25\n")
    assert submit.main(["runs/it", "--author", "me", "--quick", "--name", "feed", "--out", "feed.json"]) == 0
    (run,) = read_submission(few / "feed.json").runs
    assert run.after["100"] == 0.25
    assert "feed, by me" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ([], "name a policy to submit"),
        (["ppo-free"], "--author is missing"),
        (["ppo-free", "--author", " "], "--author is ' '; give a text"),
        (["ppo-free", "ppo-free", "--author", "me"], "named twice"),
        (["no-such-policy", "--author", "me"], "policy 'no-such-policy' is not known"),
        (["ppo-free", "--author", "me", "--out", "no/folder/s.json"], "give a file in a folder that exists"),
        (["ppo-free", "--check", "s.json"], "--check takes a file alone"),
        (["--check", "s.json"], "s.json"),
    ],
)
def test_bad_options_are_refused_before_the_first_cut(few, capsys, given, said):
    assert submit.main(given) == 2
    captured = capsys.readouterr()
    assert said in captured.err
    assert list(few.iterdir()) == []


def test_a_constant_feed_is_a_policy_like_any_other():
    from cutenv.learning.evaluation import Contestant

    run = submitted_run(Contestant(ConstantFeed(speed=0.02, angle=1.5)), {}, FEW)
    assert len(set(run.returns)) == FEW.specimens
