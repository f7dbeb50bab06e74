"""TorchRL takes every environment and the native batch, and its guide runs."""

from __future__ import annotations

import re
import types
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.task.registry import TASKS

envs = pytest.importorskip("torchrl.envs", reason="it is no dependency: pip install torchrl")
torch = pytest.importorskip("torch")

PAGE = (Path(__file__).parents[3] / "docs" / "how-to" / "torchrl.md").read_text(encoding="utf-8")
PYTHON = re.findall(r"^```python\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
TRACKS = ("cutenv/FreeCut-v1", "cutenv/SafeCut-v1", "cutenv/GentleCutRaw-v1")
FEW = {"control_hz": 10, "deadline_s": 3.0}


@pytest.mark.parametrize("environment", [*(task.id for task in TASKS.values()), *TRACKS])
def test_every_environment_is_made_by_its_id_and_passes_the_check(environment):
    envs.check_env_specs(envs.GymEnv(environment))


def test_a_cut_in_torchrl_is_the_cut():
    env = envs.GymEnv("cutenv/GentleCut-v1", **FEW)
    action = torch.tensor([0.6, 0.4])
    seen, alone = env.reset(seed=5), GentleCutEnv(**FEW)
    observation, _ = alone.reset(seed=5)
    for _ in range(30):
        np.testing.assert_array_equal(seen["observation"].numpy(), observation)
        seen = env.step(seen.set("action", action))["next"]
        observation, reward, ended, _, _ = alone.step(action.numpy())
        assert (seen["reward"].item(), seen["done"].item()) == (np.float32(reward), ended)
        if ended:
            return
    pytest.fail("the cut does not end")


@pytest.mark.parametrize(("mode", "flat"), [("Disabled", False), ("Disabled", True), ("SameStep", True)])
def test_the_native_batch_passes_the_check_and_goes_on_after_ends(mode, flat):
    batch = gymnasium.make_vec("cutenv/GentleCut-v1", num_envs=3, autoreset_mode=mode, flat_info=flat, **FEW)
    env = envs.GymWrapper(batch)
    envs.check_env_specs(env)
    cuts = env.rollout(70, break_when_any_done=False)
    assert cuts.shape == (3, 70)
    assert int(cuts["next", "done"].sum()) >= 6


def test_flat_infos_are_kept_beside_the_observation():
    env = envs.GymEnv("cutenv/GentleCut-v1", flat_info=True, **FEW).auto_register_info_dict()
    envs.check_env_specs(env)
    cut = env.rollout(40)["next"]
    assert cut["end"].tolist()[:-1] == [0] * (len(cut) - 1)
    assert cut["end"][-1] > 0
    assert (cut["truth_tip_m"] >= 0.0).all()


@pytest.mark.parametrize("number", range(len(PYTHON)))
def test_the_python_of_the_guide_runs(number, capsys):
    module = types.ModuleType("__main__")
    exec(compile(PYTHON[number], f"torchrl.md, block {number}", "exec"), module.__dict__)
    assert capsys.readouterr().out


def test_the_guide_has_python():
    assert len(PYTHON) == 3
