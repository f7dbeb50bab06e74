"""A program's command line: a dataclass of arguments, refused at the door, and the same in RL Zoo's layout."""

from __future__ import annotations

import argparse
import dataclasses
import json
from dataclasses import dataclass

import pytest

from cutenv.agents.learning.arguments import (
    BadArguments,
    BCArguments,
    CrossQArguments,
    IQLArguments,
    PPOArguments,
    RecurrentPPOArguments,
    SACArguments,
    TQCArguments,
)
from cutenv.agents.learning.option_fields import declared, option, parse
from cutenv.agents.learning.run_folder import add_run_options, run_request
from cutenv.commands import train
from cutenv.task.registry import TASKS


def parsed(*given, kind=PPOArguments):
    parser = argparse.ArgumentParser(allow_abbrev=False)
    add_run_options(parser, kind)
    request = run_request(kind, parser.parse_args(given), "ppo")
    return request.arguments, request.run, request.resume


@pytest.fixture
def interrupted(tmp_path, monkeypatch):
    """Leave a run as an interruption does."""
    monkeypatch.chdir(tmp_path)
    run = tmp_path / "runs" / "mine"
    run.mkdir(parents=True)
    kept = PPOArguments(name="mine", gamma=0.99, timesteps=1000)
    (run / "run.json").write_text(json.dumps({"arguments": dataclasses.asdict(kept)}))
    (run / "checkpoint.zip").touch()
    return kept


def test_what_still_has_an_effect_is_taken_over_and_the_rest_is_kept(interrupted):
    changed = {"timesteps": 5000, "minutes": 3.0, "specimens": 0, "checkpoint_seconds": 5.0, "validations": 3}
    given = [text for name, value in changed.items() for text in ("--" + name.replace("_", "-"), str(value))]
    arguments, run, resume = parsed("--resume", "runs/mine", *given, "--tensorboard")
    assert resume
    assert str(run) == "runs/mine"
    assert arguments == dataclasses.replace(interrupted, **changed, tensorboard=True)


@pytest.mark.parametrize(
    ("option", "value"),
    [
        ("--learning-rate", "1e-4"), ("--gamma", "1.0"), ("--rollout", "16"), ("--batch-size", "64"),
        ("--epochs", "2"), ("--hidden", "32"), ("--history", "6"), ("--exploration", "0.3"), ("--environments", "8"),
        ("--seed", "1"), ("--name", "other"),
    ],
)  # fmt: skip
def test_what_has_no_effect_any_more_is_refused_with_what_has(interrupted, option, value):
    kept = repr(getattr(interrupted, option.removeprefix("--").replace("-", "_")))
    with pytest.raises(
        BadArguments, match=f"{option} .* would have no effect: runs/mine continues with {kept}.*--timesteps"
    ):
        parsed("--resume", "runs/mine", option, value)


def test_what_is_given_as_it_was_may_be_given(interrupted):
    assert parsed("--resume", "runs/mine", "--gamma", "0.99")[0] == interrupted


def test_a_run_of_another_program_or_made_quick_is_not_gone_on_with(interrupted):
    for kind in (BCArguments, IQLArguments, RecurrentPPOArguments, SACArguments):
        with pytest.raises(BadArguments, match="runs/mine was made by another learner"):
            parsed("--resume", "runs/mine", kind=kind)
    with pytest.raises(BadArguments, match="--quick is for a new run"):
        parsed("--resume", "runs/mine", "--quick")


def test_an_angle_of_ones_own_is_trained_for_and_told():
    arguments, _, _ = parsed("--angle-mode", "fixed", "--fixed-angle-deg", "75")
    assert arguments.environment["fixed_angle_deg"] == arguments.angle["fixed_angle_deg"] == 75.0
    assert "fixed_angle_deg" not in parsed()[0].environment
    with pytest.raises(BadArguments, match="--fixed-angle-deg 75 has no effect without --angle-mode fixed"):
        parsed("--fixed-angle-deg", "75")
    with pytest.raises(BadArguments, match=r"outside 45\.0 to 90\.0"):
        parsed("--angle-mode", "fixed", "--fixed-angle-deg", "30")


@pytest.mark.parametrize("suffix", ["zip", "safetensors"])
def test_an_unfinished_checkpoint_is_nothing_to_go_on_from(interrupted, tmp_path, suffix):
    whole = tmp_path / "runs" / "mine" / "checkpoint.zip"
    whole.rename(whole.with_name(f"checkpoint.1a2b3c4d.part.{suffix}"))  # as a kill leaves it
    with pytest.raises(BadArguments, match=r"runs/mine contains no checkpoint\.zip or checkpoint\.safetensors"):
        parsed("--resume", "runs/mine")


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (PPOArguments, "exploration", 0.0),  # both once ended in a division or a logarithm, after the teaching
        (PPOArguments, "last_exploration", 0.0),
        (PPOArguments, "rollout", 0),
        (PPOArguments, "batch_size", 1),
        (PPOArguments, "epochs", 0),
        (PPOArguments, "learning_rate", 0.0),
        (PPOArguments, "learning_rate", float("nan")),
        (PPOArguments, "averaging", 0.0),
        (PPOArguments, "critic_first", 1.5),
        (PPOArguments, "checkpoint_seconds", -1.0),
        (RecurrentPPOArguments, "cloning_epochs", 0),
        (BCArguments, "batch_size", 0),
        (BCArguments, "learning_rate", -1e-3),
        (IQLArguments, "expectile", 1.0),
        (SACArguments, "tau", 0.0),
        (TQCArguments, "top_quantiles_to_drop_per_net", 25),
        (CrossQArguments, "policy_delay", 0),
    ],
)
def test_a_number_beyond_its_limits_is_refused(kind, name, value):
    with pytest.raises(BadArguments, match=f"--{name.replace('_', '-')} {value} is outside "):
        kind(**{name: value})


def test_the_least_of_every_number_is_taken():
    for kind in (PPOArguments, RecurrentPPOArguments, BCArguments, IQLArguments, TQCArguments, CrossQArguments):
        numbers = [field for field in dataclasses.fields(kind) if field.type in ("int", "float")]
        least = {
            field.name: type(field.default)(declared(kind, field.name)["allowed"][0])
            for field in numbers
            if declared(kind, field.name)["allowed"]
        }
        taken = kind(angle_mode="fixed", **least)
        assert {name: getattr(taken, name) for name in least} == least


def test_quick_sets_what_is_not_given_on_every_task():
    arguments, _, _ = parsed("--quick", "--specimens", "7")
    assert {name: getattr(arguments, name) for name in PPOArguments.quick} == {**PPOArguments.quick, "specimens": 7}
    quick = {**PPOArguments.quick, "demonstrations": 0}  # the others correct a script
    for task in ("depth", "path"):
        arguments, _, _ = parsed("--quick", "--task", task)
        assert {name: getattr(arguments, name) for name in quick} == quick
        assert arguments.exploration == TASKS[task].options["exploration"]


@dataclass(frozen=True, kw_only=True)
class Arguments:
    name: str = option("", "of the run")
    cuts: int = option(100, "that are made")
    noise_mm: float = option(0.5, "of the depth")
    tissue: str = option("liver", "to cut", ("liver", "uniform"))
    files: tuple[str, ...] = option((), "to read")
    quiet: bool = option(False, "say nothing")


def parsed_line(*given: str) -> Arguments:
    return parse(Arguments, "About it.", given)


def test_options_arrive_with_their_kinds():
    given = ["--name", "7", "--cuts", "7", "--noise-mm", "7", "--tissue", "uniform", "--files", "a", "b", "--quiet"]
    expected = Arguments(name="7", cuts=7, noise_mm=7.0, tissue="uniform", files=("a", "b"), quiet=True)
    assert parsed_line(*given) == expected
    assert isinstance(parsed_line(*given).noise_mm, float)
    assert parsed_line() == Arguments()


@pytest.mark.parametrize("given", [("--cuts", "x"), ("--tissue", "bone"), ("--cust", "3")])
def test_nonsense_is_refused(given):
    with pytest.raises(SystemExit, match="2"):
        parsed_line(*given)


def test_help_tells_meanings_and_defaults(capsys):
    with pytest.raises(SystemExit, match="0"):
        parsed_line("--help")
    shown = capsys.readouterr().out
    assert "that are made (default 100)" in shown
    assert "About it." in shown


@pytest.mark.parametrize("text", [None, "no JSON", '{"schema": "another"}'])
def test_a_file_that_is_no_tissue_is_refused_before_anything_is_made(text, tmp_path):
    path = tmp_path / "tissue.json"
    if text is not None:
        path.write_text(text)
    with pytest.raises(BadArguments, match=r"--tissue: .*tissue\.json"):
        PPOArguments(tissue=str(path))


@pytest.mark.parametrize("given", ["--learner foo", "--learner", "--resume", "--task", "--task gentle depth --name"])
def test_a_bad_option_is_told_on_one_line(given, capsys):
    with pytest.raises(SystemExit, match="2"):
        train.main(given.split())
    said = capsys.readouterr().err
    assert (said.count("\n"), said.startswith("cutenv train: ")) == (1, True), said
