"""Submissions: specimens drawn from the entry's files, cuts repeated to the last bit, changed ones refused by name."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("tqdm", reason="the evaluation needs an extra: pip install 'cutenv[rl]'")
pytest.importorskip("safetensors", reason="policies are an extra: pip install 'cutenv[rl]'")

from cutenv.agents.learning import benchmark
from cutenv.agents.learning.benchmark import (
    QUICK,
    TABLE_COLUMNS,
    Protocol,
    Submission,
    entry_digest,
    entry_files,
    entry_seeds,
    read_submission,
    recorded_kind,
    replayed,
    returns_after,
    standing,
    submitted_run,
    training_kind,
    write_submission,
)
from cutenv.agents.learning.evaluation import Contestant, batched_rollout, contestant, evaluate
from cutenv.agents.learning.seeds import ENTRY_SEEDS, TEST_SEEDS, TRAINING_SEEDS, VALIDATION_SEEDS
from cutenv.agents.policy import ORACLE, ArrayPolicy, ConstantFeed
from cutenv.agents.policy.actor_network import Network
from cutenv.commands import submit

FEW = dataclasses.replace(QUICK, specimens=6, sweep_specimens=2, resamples=50)
DIGEST = entry_digest([entry_files("ppo-free")])
SEEDS = entry_seeds(DIGEST, FEW)


def entry(*runs, protocol=FEW) -> Submission:
    return Submission(
        "mine", "A. Name", "https://example.org/mine", "2026-11-23", "with demonstrations", DIGEST, "", protocol, runs
    )


@pytest.fixture(scope="module")
def shipped():
    return submitted_run(contestant("ppo-free"), returns_after([]), FEW, SEEDS)


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
    measured = evaluate({"it": contestant("ppo-free")}, SEEDS, {"specimen_class": "mixed"}, processes=1)
    assert list(shipped.returns) == [row["return"] for row in measured]
    read = read_submission(written, [FEW])
    assert read.author == "A. Name"
    assert read.runs[0].returns == shipped.returns
    assert all(np.array_equal(*pair) for pair in zip(read.runs[0].actions, shipped.actions, strict=True))
    (rows,) = replayed(read)
    assert [{"policy": "it", **row} for row in rows] == measured


def test_one_changed_action_or_bit_of_a_return_is_refused_with_its_cut(shipped):
    actions, returns = [own.copy() for own in shipped.actions], list(shipped.returns)
    actions[4][10, 0] += 0.01
    returns[2] = float(np.nextafter(returns[2], 1.0))
    for cut, changed in ((4, {"actions": tuple(actions)}), (2, {"returns": tuple(returns)})):
        with pytest.raises(ValueError, match=f"run 1, specimen {SEEDS[cut]}: .* Refused"):
            replayed(entry(dataclasses.replace(shipped, **changed)))
    first = shipped.actions[0]
    for other in (first[:-1], np.concatenate([first, first[-1:]])):
        run = dataclasses.replace(shipped, actions=(other, *shipped.actions[1:]))
        with pytest.raises(ValueError, match=f"its replay takes {len(first)} decisions, not {len(other)}"):
            replayed(entry(run))


def test_a_policy_of_python_floats_is_recorded_as_it_acted():
    class Mine:
        def reset(self, rng):
            self.speed = rng.uniform(0.1, 0.9)

        def __call__(self, observation):
            return [self.speed, 1.0 / 3.0]

    mine = Contestant(Mine(), {"control_hz": 5})
    run = submitted_run(mine, {}, FEW, SEEDS)
    assert len(replayed(entry(run), [mine])[0]) == FEW.specimens


DAMAGES = {
    "it is not whole, or no JSON": lambda text: text[: len(text) // 2],
    "it is no file of cutenv submit": lambda text: "[1, 2]",
    "'author' is missing": lambda text: text.replace('"author"', '"auhtor"'),
    "author is ' '; give a text": lambda text: text.replace("A. Name", " "),
    r"author is 'A \| B'; give one line": lambda text: text.replace("A. Name", "A | B"),
    "made for protocol 2 of": lambda text: text.replace('"protocol": "quick"', '"protocol": "2"'),
    "environment argument 'dead_time' is the protocol's": lambda text: text.replace('"angle_mode"', '"dead_time"'),
    "its format is 9, not 2": lambda text: text.replace('"cutenv_submission": 2', '"cutenv_submission": 9'),
    "kind is 'magic', not one of script, from": lambda text: text.replace("with demonstrations", "magic"),
    "digest is 'ab.*', not 64 hexadecimal digits": lambda text: text.replace(DIGEST, "ab"),
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
    with pytest.raises(ValueError, match=rf"specimen {SEEDS[1]}: .*nan.* is outside \[-1, 1\]"):
        read_submission(written, [FEW])
    write_submission(written, entry(dataclasses.replace(shipped, returns=shipped.returns[:-1])))
    with pytest.raises(ValueError, match="run 1 holds 5 cuts, not the 6"):
        read_submission(written, [FEW])
    write_submission(written, entry(shipped, shipped))
    with pytest.raises(ValueError, match="runs 1 and 2 are the same"):
        read_submission(written, [FEW])


def test_whoever_is_shown_the_hidden_state_takes_no_part():
    with pytest.raises(ValueError, match="shown the hidden state, so it takes no part"):
        submitted_run(contestant("planner with truth"), {}, FEW, SEEDS)


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
    monkeypatch.setattr("cutenv.agents.learning.benchmark.QUICK", FEW)
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
    assert f"specimen {SEEDS[3]}: its replay returns" in capsys.readouterr().err


def test_the_folder_of_a_run_is_enough_and_its_curve_is_told(few, capsys):
    from cutenv.agents.policy import Features, save_policy

    size = Features(history=0).size
    network = Network(((np.zeros((2, size), np.float32), np.array([0.5, 1.0], np.float32)),))
    about = {"environment": FEW.environment, "environment_arguments": {"control_hz": 10}}
    save_policy("runs/it/policy", network, **about, features={"history": 0}, training={})
    Path("runs/it/learning_curve.csv").write_text("decisions,cuts,validation_return\n9000,99,0.25\n")
    given = ["runs/it", "--author", "me", "--quick", "--name", "feed", "--out", "feed.json"]
    assert submit.main(given) == 2
    assert "--kind is missing: no card tells how this was made" in capsys.readouterr().err
    assert submit.main([*given, "--kind", "from scratch"]) == 0
    read = read_submission(few / "feed.json")
    assert (read.runs[0].after["100"], read.kind) == (0.25, "from scratch")
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
        (["ppo-free", "--author", "me", "--kind", "magic"], "--kind 'magic' is not known; give one of 'script'"),
        (
            ["ppo-free", "--author", "me", "--kind", "script"],
            "of kinds script, with demonstrations; an entry is",
        ),
        (["--check", "s.json", "--salt", "x"], "--salt is kept in the file"),
        (["--check", "s.json"], "s.json"),
    ],
)
def test_bad_options_are_refused_before_the_first_cut(few, capsys, given, said):
    assert submit.main(given) == 2
    captured = capsys.readouterr()
    assert said in captured.err
    assert list(few.iterdir()) == []


def test_entries_cut_specimens_that_nothing_else_uses_and_that_change_with_files_version_and_salt():
    assert len(set(SEEDS)) == FEW.specimens
    assert all(seed in ENTRY_SEEDS for seed in SEEDS)
    assert max(TRAINING_SEEDS.stop, VALIDATION_SEEDS.stop, TEST_SEEDS.stop) <= ENTRY_SEEDS.start
    assert len(ENTRY_SEEDS) > 1e18  # nobody solves them all beforehand
    others = [
        entry_seeds(DIGEST, dataclasses.replace(FEW, version="other")),
        entry_seeds(DIGEST, FEW, "salt"),
        entry_seeds("0" * 64, FEW),
    ]
    assert not set(SEEDS) & {seed for one in others for seed in one}


def test_one_byte_of_an_entry_changes_its_specimens_and_the_place_and_order_of_folders_does_not(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name / "more").mkdir(parents=True)
        (tmp_path / name / "card.json").write_text(name)
        (tmp_path / name / "more" / "weights").write_bytes(bytes(9))
    (tmp_path / "one").rename(tmp_path / "moved")
    moved, two = (entry_files(str(tmp_path / name)) for name in ("moved", "two"))
    assert sorted(moved) == ["card.json", "more/weights"]
    assert entry_digest([moved, two]) == entry_digest([two, moved])
    several = [[moved], [two], [moved, two]]
    several += [[{**moved, "more/weights": bytes(8) + b"\1"}], [{**moved, "another": b""}]]
    several += [[{"card.json": moved["card.json"] + moved["more/weights"]}]]
    assert len({entry_digest(one) for one in several}) == len(several)


def test_the_files_of_a_class_are_its_module_and_what_it_says_that_it_reads(tmp_path, monkeypatch):
    (tmp_path / "mine_of_files.py").write_text("class Mine:\n    files = ('table.npz',)\n")
    (tmp_path / "table.npz").write_bytes(b"table")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    contestant("mine_of_files:Mine")
    assert entry_files("mine_of_files:Mine")["table.npz"] == b"table"
    assert sorted(entry_files("mine_of_files:Mine")) == ["mine_of_files.py", "table.npz"]


class Table(ArrayPolicy):
    """The attack: the planner's actions on known specimens, looked up by the first observation of a cut."""

    def __init__(self, known: dict[bytes, np.ndarray]) -> None:
        self.known, self.hits = known, 0

    def begin(self, rngs):
        self.plans: list[np.ndarray] | None = None

    def forget(self, cuts):
        raise NotImplementedError

    def act(self, observations):
        if self.plans is None:
            found = [self.known.get(one.tobytes()) for one in observations]
            self.hits += sum(plan is not None for plan in found)
            feed = np.tile(np.float32([0.3, 1.0]), (1, 1))  # where the table has nothing
            self.plans, self.decision = [feed if plan is None else plan for plan in found], -1
        self.decision += 1
        return np.stack([plan[min(self.decision, len(plan) - 1)] for plan in self.plans])


def table_of(seeds) -> Table:
    """Record what the planner that is shown the truth does on each specimen."""

    class Recorder(ArrayPolicy):
        privileged = True

        def __init__(self):
            self.planner, self.seen, self.done = contestant(ORACLE).policy, [], []

        def begin(self, rngs):
            self.planner.begin(rngs)

        def set_states(self, states):
            self.planner.set_states(states)

        def forget(self, cuts):
            raise NotImplementedError

        def act(self, observations):
            self.seen.append(observations.copy())
            self.done.append(np.array(self.planner.act(observations), np.float32))
            return self.done[-1]

    recorder = Recorder()
    batched_rollout(recorder, seeds, {"specimen_class": "mixed"})
    plans = np.stack(recorder.done, axis=1)
    return Table({first.tobytes(): plan for first, plan in zip(recorder.seen[0], plans, strict=True)})


def test_a_table_of_the_planners_actions_wins_on_public_specimens_and_finds_none_of_those_drawn_for_it():
    table = table_of(FEW.test_seeds)
    public = submitted_run(Contestant(table), {}, FEW, FEW.test_seeds)
    assert table.hits == FEW.specimens
    script = evaluate({"it": contestant("return stroke")}, FEW.test_seeds, {"specimen_class": "mixed"}, processes=1)
    assert np.mean(public.returns) > np.mean([row["return"] for row in script])
    content = b"".join(first + plan.tobytes() for first, plan in table.known.items())
    drawn = entry_seeds(entry_digest([{"table": content}]), FEW)
    table.hits = 0
    private = submitted_run(Contestant(table), {}, FEW, drawn)
    assert table.hits == 0
    assert np.mean(private.returns) < np.mean(public.returns) - 0.2


def test_a_policy_is_not_told_the_seeds_of_its_specimens_by_its_random_numbers():
    class Curious:
        def reset(self, rng):
            told.append(rng.bit_generator.seed_seq.entropy)

        def __call__(self, observation):
            return [0.0, 1.0]

    told: list[int] = []
    submitted_run(Contestant(Curious(), {"control_hz": 5}), {}, FEW, SEEDS)
    assert told
    assert not set(told) & set(SEEDS)


def test_the_policies_beside_the_file_must_have_its_digest_and_act_as_it_says(few, shipped, capsys):
    write_submission(few / "s.json", entry(shipped))
    assert submit.main(["--check", "s.json", "ppo-free"]) == 0
    assert "repeated to the last bit by the policies' own actions" in capsys.readouterr().out
    assert submit.main(["--check", "s.json", "ppo-fixed"]) == 2
    assert "but that of ppo-fixed is" in capsys.readouterr().err
    script = Contestant(contestant("return stroke").policy, shipped.arguments)
    write_submission(few / "s.json", entry(submitted_run(script, {}, FEW, SEEDS)))  # its cuts, under another's digest
    assert submit.main(["--check", "s.json"]) == 0
    assert submit.main(["--check", "s.json", "ppo-free"]) == 2
    assert "is not the file's. Refused" in capsys.readouterr().err


def test_other_actions_than_the_policys_are_refused_with_their_cut(shipped):
    slower = Contestant(ConstantFeed(speed=0.005, angle=1.5), shipped.arguments)
    with pytest.raises(ValueError, match=f"run 1, specimen {SEEDS[0]}: the policy's action 1 is not the file's"):
        replayed(entry(shipped), [slower])
    with pytest.raises(ValueError, match="holds 1 runs, and 2 policies are given"):
        replayed(entry(shipped), [contestant("ppo-free")] * 2)
    with pytest.raises(ValueError, match="run 1: the policy wants"):
        replayed(entry(shipped), [Contestant(contestant("ppo-free").policy)])


def test_a_salt_of_the_host_changes_the_specimens_and_is_kept_in_the_file(few, capsys):
    assert submit.main(["ppo-free", "--author", "me", "--quick", "--salt", "of the host"]) == 0
    assert "with salt 'of the host'" in capsys.readouterr().out
    read = read_submission(few / "submission.json")
    assert read.seeds == entry_seeds(DIGEST, FEW, "of the host") != SEEDS


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        ({"demonstrations": 0}, "from scratch"),
        ({"demonstrations": 9, "base": "none"}, "with demonstrations"),
        ({"demonstrations": 0, "dataset": "of/people-v0"}, "with demonstrations"),
        ({"demonstrations": 0, "base": "script"}, "correction of a script"),
    ],
)
def test_the_kind_of_an_agent_follows_from_the_options_of_its_training(options, kind):
    assert training_kind(options) == kind


def test_the_kind_of_a_policy_is_what_its_card_records():
    names = ("ppo-free", "ppo-path", "return stroke")
    assert [recorded_kind(name, contestant(name).policy) for name in names] == [
        "with demonstrations",
        "correction of a script",
        "script",
    ]
    assert recorded_kind("mine:Mine", ConstantFeed(speed=0.02)) is None
