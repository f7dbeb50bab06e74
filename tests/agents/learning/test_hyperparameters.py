"""The hyper-parameters in RL Zoo's layout are the defaults of ``cutenv train``."""

from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

pytest.importorskip("sb3_contrib", reason="the learners are an extra: pip install 'cutenv[rl]'")

from cutenv.agents.learning.off_policy import OFF_POLICY
from cutenv.agents.learning.on_policy import ON_POLICY
from cutenv.agents.learning.seeds import ENVIRONMENT
from cutenv.commands.train import LEARNERS

FILE = Path(__file__).parents[3] / "agents" / "hyperparameters.toml"
ALL = tomllib.loads(FILE.read_text())
OURS = {"n_timesteps": "timesteps", "n_envs": "environments", "n_epochs": "epochs"}


@pytest.mark.parametrize("program", ALL)
def test_every_number_is_the_programs_default(program):
    _, kind = LEARNERS[program.replace("_", "-")]
    default = kind()
    told = dict(ALL[program][ENVIRONMENT])
    told.pop("policy", None)
    groups = [told.pop(name) for name in ("env_kwargs", "policy_kwargs", "agent")]
    ours = OURS | ({"n_steps": "rollout"} if hasattr(default, "rollout") else {})
    flat = {ours.get(name, name): value for group in (told, *groups) for name, value in group.items()}
    assert flat == {name: getattr(default, name) for name in flat}


def test_every_learner_is_there():
    assert {name.replace("_", "-") for name in ALL} == set(LEARNERS)


def test_the_named_policies_are_those_of_the_learners():
    for name, learner in {**ON_POLICY, **OFF_POLICY}.items():
        assert learner.policy.__name__ == ALL[name.replace("-", "_")][ENVIRONMENT]["policy"]
