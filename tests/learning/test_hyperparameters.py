"""The hyper-parameters in RL Zoo's layout are the programs' defaults."""

from __future__ import annotations

import importlib
import tomllib
from pathlib import Path

import pytest

pytest.importorskip("sb3_contrib", reason="the learners are an extra: pip install 'cutenv[rl]'")

from evaluate import ENVIRONMENT

FILE = Path(__file__).parents[2] / "agents" / "hyperparameters.toml"
ALL = tomllib.loads(FILE.read_text())
OURS = {"n_timesteps": "timesteps", "n_envs": "environments", "n_steps": "rollout", "n_epochs": "epochs"}


@pytest.mark.parametrize("program", ALL)
def test_every_number_is_the_programs_default(program):
    default = importlib.import_module(program).Arguments()
    told = dict(ALL[program][ENVIRONMENT])
    told.pop("policy", None)
    groups = [told.pop(name) for name in ("env_kwargs", "policy_kwargs", "agent")]
    flat = {OURS.get(name, name): value for group in (told, *groups) for name, value in group.items()}
    assert flat == {name: getattr(default, name) for name in flat}


def test_every_program_that_learns_is_there():
    learn = {path.stem for path in FILE.parent.glob("*.py") if "class Arguments(" in path.read_text()}
    assert set(ALL) == learn


@pytest.mark.parametrize("program", ["ppo", "recurrent_ppo"])
def test_the_named_policy_is_the_models(program):
    module = importlib.import_module(program)
    arguments = module.Arguments(environments=2, rollout=8, batch_size=16)
    model = module.new_model(arguments, arguments.environments_at(arguments.training_seeds))
    assert type(model.policy).__name__ == ALL[program][ENVIRONMENT]["policy"]
