"""Check that other machines would compute the same bits: cuts with kernels, NumPy and BLAS for other processors.

    python -m scripts.validation.physics.same_bits

Each setting runs in a separate process, which takes a minute: specimens of every class are cut by random actions for
4 seconds in batches of every task, and in single environments, 24 of PathCut, until the cut ends.  Fails if kernels,
NumPy or BLAS for another processor give other observations, rewards or infos than those for this one.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

_NUMBA = {"CUTENV_COMPILE": "1"}  # even where there is a library of kernels, which the first setting then uses
_KERNELS = _NUMBA | {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
_NUMPY = {"NPY_DISABLE_CPU_FEATURES": " ".join(name for name in __cpu_dispatch__ if __cpu_features__[name])}
_BLAS = {f"OpenBLAS for {name}": {"OPENBLAS_CORETYPE": name} for name in ("Haswell", "Nehalem", "SkylakeX")}
SETTINGS = {
    "this processor": {}, "compiled here": _NUMBA, **_BLAS, "kernels for the plainest": _KERNELS,
    "NumPy for the plainest": _NUMPY,
}  # fmt: skip
STEPS, BATCH = 200, 64
EPISODES = {"gentle": 6, "depth": 6, "path": 24}  # single cuts of each task


def digests(batch: int = BATCH) -> dict[str, str]:
    """Return the hash of every observation, reward and info of a batch and of single cuts, by task."""
    import gymnasium

    from cutenv.task.registry import TASKS

    found = {}
    for name, episodes in EPISODES.items():
        task = TASKS[name].id
        content = hashlib.sha256()
        for specimen_class in ("liver", "mixed", "vascular"):
            envs = gymnasium.make_vec(task, num_envs=batch, specimen_class=specimen_class)
            content.update(envs.reset(seed=5)[0].tobytes())
            for actions in _forward(envs.action_space.shape, STEPS):
                observations, rewards, *_ = envs.step(actions)
                content.update(np.asarray(observations).tobytes() + np.asarray(rewards).tobytes())
        found[f"{name}, batch"] = content.hexdigest()[:12]
        content = hashlib.sha256()
        env = gymnasium.make(task)
        for seed in range(episodes):
            content.update(env.reset(seed=seed)[0].tobytes())
            for action in _forward(env.action_space.shape, None):
                observation, reward, terminated, truncated, info = env.step(action)
                content.update(observation.tobytes() + np.float64(reward).tobytes())
                if terminated or truncated:
                    content.update(repr(info).encode())
                    break
        found[f"{name}, {episodes} cuts"] = content.hexdigest()[:12]
    return found


def _forward(shape: tuple[int, ...] | None, steps: int | None) -> Iterator[Any]:
    """Draw actions that go forward; without end if there is no number of steps."""
    rng, made = np.random.default_rng(0), 0
    while steps is None or made < steps:
        actions = rng.uniform(-1.0, 1.0, shape).astype(np.float32)
        actions[..., 0] = np.abs(actions[..., 0])
        yield actions
        made += 1


def main() -> int:
    """Compare every setting with the first."""
    found: dict[str, dict[str, str]] = {}
    with tempfile.TemporaryDirectory() as kept:
        for number, (name, setting) in enumerate(SETTINGS.items()):
            environment = os.environ | setting | {"NUMBA_CACHE_DIR": f"{kept}/{number}"}
            command = [sys.executable, __file__, "--digests"]
            done = subprocess.run(command, env=environment, capture_output=True, text=True)
            if done.returncode != 0:
                print(f"{name:26} {done.stderr.strip()[-400:]}")
                return 1
            found[name] = json.loads(done.stdout)
            first = found["this processor"]
            others = [part for part, value in found[name].items() if value != first[part]]
            shown = f"other bits: {'; '.join(others)}" if others else "the same bits"
            print(f"{name:26} {' '.join(found[name].values())}  {shown}", flush=True)
    print(f"{'':26} {'; '.join(first)}")
    return int(any(each != first for each in found.values()))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--digests"]:
        print(json.dumps(digests(*map(int, sys.argv[2:]))))
    else:
        sys.exit(main())
