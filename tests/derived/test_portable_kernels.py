"""The step of one cut, compiled as a callback for C, needs no Python, no memory and no library: LLVM's code tells."""

from __future__ import annotations

import ctypes
import math
import re
from typing import Any

import numba
import numpy as np
import pytest
from numba import carray, types

from cutenv.cutting.dtypes import READING
from cutenv.cutting.simulate import CUT
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.task.gentle import GENTLE_CUT
from cutenv.task.observation import COMPONENTS
from cutenv.task.stepper import step_one

COMPONENT_COUNT = len(COMPONENTS)
LIBRARY = {
    *("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "sincos"),
    *("exp", "exp2", "exp10", "log", "log2", "log10", "pow", "powi"),
}
"""Intrinsics that no processor has as an instruction: LLVM calls a library, whose last digit differs by machine."""
NEVER_CALLED = {"NRT_MemInfo_call_dtor"}
"""Frees an array with its last reference. Views of the caller's memory count none, and others would be allocated."""


def needs(callback: Any) -> set[str]:
    """List what the callback calls, directly or not, outside its own code and instructions; and its exceptions.

    Around it, Numba adds what reports an exception to Python.  That is left out: it is called only with the status of
    an exception, each of which Numba keeps pickled in the module.
    """
    code = callback.inspect_llvm()
    own = dict(re.findall(r'^define [^@]*@"?([^"(]+)"?\((.*?)^}', code, re.MULTILINE | re.DOTALL))
    outside = set(re.findall(r'^declare [^@]*@"?([^"(]+)"?\(', code, re.MULTILINE))
    met, ahead = set(), {callback.native_name.removeprefix("cfunc.")}
    assert ahead < own.keys()
    while ahead:
        name = ahead.pop()
        met.add(name)
        ahead |= set(re.findall(r'@"?([^\s"(),]+)', own.get(name, ""))) & (own.keys() | outside) - met
    found = {"an exception"} if "picklebuf" in code else set()
    for name in met & outside - NEVER_CALLED:
        intrinsic = name.split(".")[1] if name.startswith("llvm.") else ""
        if not intrinsic or intrinsic in LIBRARY:
            found.add(intrinsic or name)
    return found


STEP_ONE = step_one(GENTLE_CUT)


@pytest.fixture(scope="module")
def callback() -> Any:
    """The reward of a step on raw memory: the cut, its episode, milliseconds, action, and what is filled."""
    records = [types.CPointer(numba.from_dtype(kind)) for kind in (CUT, GENTLE_CUT.episode, READING)]
    cut, episode, readings = records
    numbers, singles = types.CPointer(types.float64), types.CPointer(types.float32)

    @numba.cfunc(types.float64(cut, episode, types.int64, numbers, singles, readings), error_model="numpy")
    def step(cut: Any, episode: Any, ticks: int, action: Any, observation: Any, readings: Any) -> float:
        reward, _ = STEP_ONE(
            carray(cut, (1,)),
            carray(cut, (1,))[0].motions,
            carray(episode, (1,)),
            ticks,
            carray(action, (2,)),
            carray(observation, (COMPONENT_COUNT,)),
            carray(readings, (1, ticks)),
            carray(action, (0,)),
        )
        return reward  # type: ignore[no-any-return]

    return step


def test_a_step_needs_nothing_from_outside(callback):
    """Not even exp, log or pow of a mathematical library: they are in the kernel (cutenv/_engine/elementary.py)."""
    assert needs(callback) == set()


def test_the_callback_steps_a_cut_on_raw_memory_bit_for_bit(callback):
    env = GentleCutEnv()
    env.reset(seed=3)
    cutting, action = env.cutting, np.array([0.7, -0.5])
    c_cut, c_episode = cutting.plant.cuts.copy(), cutting.record.copy()
    c_observation, c_readings = np.zeros((1, COMPONENT_COUNT), np.float32), np.zeros((1, env.ticks), READING)
    places = (ctypes.c_void_p,) * 3
    call = ctypes.CFUNCTYPE(ctypes.c_double, *places[:2], ctypes.c_int64, *places)(callback.address)
    for _ in range(100):
        expected, reward = cutting.step(action)
        filled = (c_cut, c_episode, env.ticks, action, c_observation, c_readings)
        pointers = [part if isinstance(part, int) else part.ctypes.data for part in filled]
        assert call(*pointers) == reward
    assert c_observation.tobytes() == expected.tobytes()
    assert c_cut.tobytes() == cutting.plant.cuts.tobytes()


def raising(x: float) -> float:
    if x < 0.0:
        raise ValueError("x must not be negative")
    return x


@pytest.mark.parametrize(
    ("kernel", "found"),
    [
        (lambda x: math.sin(x), "sin"),
        (lambda x: math.atan2(x, 2.0), "atan2"),
        (lambda x: np.cumsum(np.full(int(x), x))[-1], "NRT_MemInfo_alloc"),
        (raising, "an exception"),
    ],
    ids=["library", "function of a library", "memory", "exception"],
)
def test_a_kernel_that_needs_more_fails_the_check(kernel, found):
    more = needs(numba.cfunc("float64(float64)", error_model="numpy")(kernel))
    assert any(name.startswith(found) for name in more), more
