"""A native batch of any task beside single environments one after the other, compared to the last bit."""

from __future__ import annotations

from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.testing import assert_array_equal

from cutenv.envs.vector import GentleCutVectorEnv

ENVIRONMENT = "cutenv/GentleCut-v1"
N, STEPS, SEED = 5, 160, 7
SHORT = {"deadline_s": 2.0, "control_hz": 20}  # so that every environment is begun anew several times


def both(mode: str = "NextStep", num_envs: int = N, id: str = ENVIRONMENT, **keywords: Any) -> tuple[Any, Any]:
    """The native batch, and single environments one after the other."""
    native = gymnasium.make_vec(id, num_envs=num_envs, autoreset_mode=mode, **keywords)
    assert isinstance(native.unwrapped, GentleCutVectorEnv)
    singles = gymnasium.make_vec(
        id,
        num_envs=num_envs,
        vectorization_mode="sync",
        vector_kwargs={"autoreset_mode": AutoresetMode(mode)},
        **keywords,
    )
    return native, singles


def actions(rng: np.random.Generator, num_envs: int = N, size: int = 2) -> np.ndarray:
    """Mostly forward, some beyond the reach, so that cuts end in different ways."""
    return rng.normal((0.5, 0.0, 0.0)[:size], (0.6, 0.8, 0.6)[:size], (num_envs, size)).astype(np.float32)


def check_same(one: Any, other: Any, where: str = "info") -> None:
    """Equal to the last bit: nested dicts of arrays, of numbers, of objects."""
    if isinstance(other, dict):
        assert set(one) == set(other), where
        for name in other:
            check_same(one[name], other[name], f"{where}[{name!r}]")
        return
    if isinstance(other, np.ndarray) and other.dtype == object and any(isinstance(v, np.ndarray) for v in other):
        assert [v is None for v in one] == [v is None for v in other], where
        for a, b in zip(one, other, strict=True):
            if b is not None:
                assert_array_equal(a, b, err_msg=where)
        return
    assert one.dtype == other.dtype, where
    assert_array_equal(one, other, err_msg=where)


def run_both(native: Any, singles: Any, *, steps: int = STEPS) -> tuple[int, set[str]]:
    """Step both with the same actions, comparing everything; how many cuts ended, and how."""
    rng, shape = np.random.default_rng(1), native.action_space.shape
    check_same(*(dict(zip(("obs", "info"), env.reset(seed=SEED), strict=True)) for env in (native, singles)))
    ended, ends = 0, set()
    for _ in range(steps):
        action = actions(rng, *shape)
        ours, theirs = native.step(action), singles.step(action)
        names = ("observation", "reward", "terminated", "truncated", "info")
        check_same(*(dict(zip(names, answer, strict=True)) for answer in (ours, theirs)))
        ended += int(ours[2].sum())
        last = ours[4].get("final_info", ours[4])
        ends |= {end for end in last.get("end", ()) if end}
        if ours[2].any() and native.metadata["autoreset_mode"] == AutoresetMode.DISABLED:
            masked = [env.reset(options={"reset_mask": ours[2].copy()}) for env in (native, singles)]
            check_same(*(dict(zip(("obs", "info"), answer, strict=True)) for answer in masked))
    return ended, ends
