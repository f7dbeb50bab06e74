"""RLlib trains on the native vector environment, on workers of a local cluster, and what it learns cuts without it.

Run by ``test_rllib.py`` with the Python of .venv-ray, which has Ray.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "agents"))  # the programs there are no package
from rllib import Arguments, algorithm, connect, network, train  # Ray itself is imported by connect()

ARGUMENTS = Arguments(
    workers=2, environments=32, iterations=20, specimen_class="uniform", angle_mode="fixed", checkpoint_every=10
)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Any, list[Any], Path]]:
    run = tmp_path_factory.mktemp("run")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(run))  # a local cluster keeps its token there
        connect(ARGUMENTS)
        ppo = algorithm(ARGUMENTS)
        yield ppo, train(ppo, ARGUMENTS, run), run
        ppo.stop()
        import ray

        ray.shutdown()


def test_the_return_improves_in_a_few_rounds_on_two_workers(trained: tuple[Any, list[Any], Path]) -> None:
    _, curve, _ = trained
    returns = [point["return"] for point in curve]
    assert np.mean(returns[-5:]) > np.mean(returns[:5]) + 0.15
    assert curve[-1]["decisions"] >= 20 * 2 * 32 * 128


def test_the_cluster_is_reached_from_this_machine_alone(trained: tuple[Any, list[Any], Path]) -> None:
    import ray

    assert [node["NodeManagerAddress"] for node in ray.nodes()] == ["127.0.0.1"]
    assert ray.get_runtime_context().gcs_address.startswith("127.0.0.1:")


def test_no_two_environments_cut_the_same_specimens(trained: tuple[Any, list[Any], Path]) -> None:
    ppo, _, _ = trained
    group = ppo.env_runner_group
    seeds = group.foreach_env_runner(lambda runner: runner.env.unwrapped.seeds, local_env_runner=False)
    every = [seed for own in seeds for seed in own]
    assert len(set(every)) == len(every) == 64
    assert max(every) < 100_000


def test_the_exported_network_does_what_rllibs_does(trained: tuple[Any, list[Any], Path]) -> None:
    import torch
    from ray.rllib.core.columns import Columns

    ppo, _, _ = trained
    exported = network(ppo)
    seen = np.random.default_rng(0).normal(size=(50, exported.sizes[0])).astype(np.float32)
    with torch.no_grad():
        means = ppo.get_module().forward_inference({Columns.OBS: torch.as_tensor(seen)})[Columns.ACTION_DIST_INPUTS]
    assert exported.sizes[1:] == (64, 64, 2)
    assert exported(seen) == pytest.approx(means.numpy()[:, :2], abs=1e-5)


def test_a_checkpoint_gives_the_same_agent_back(trained: tuple[Any, list[Any], Path]) -> None:
    ppo, _, run = trained
    before = network(ppo).to_arrays()
    ppo.train()
    assert any((before[name] != values).any() for name, values in network(ppo).to_arrays().items())
    ppo.restore_from_path((run / "checkpoint").absolute())
    assert all((before[name] == values).all() for name, values in network(ppo).to_arrays().items())
    assert ppo.iteration == ARGUMENTS.iterations
