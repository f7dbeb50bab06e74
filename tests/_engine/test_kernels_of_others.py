"""Kernels of others are compiled by Numba alone; the step of one cut, as a callback for C, needs no Python."""

from __future__ import annotations

import ctypes
import gc
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numba
import numba.extending
import numpy as np
import pytest
from numba import carray
from numba.core import targetconfig, types

import cutenv._engine.jit
from cutenv._engine.jit import njit
from cutenv._engine.shortcuts import LateInterrupt
from cutenv.envs.gentle_cut import GentleCutEnv
from cutenv.sim.cutting.dtypes import READING
from cutenv.sim.cutting.simulate import CUT
from cutenv.task.declare import GENTLE_CUT
from cutenv.task.observation import COMPONENTS
from cutenv.task.stepper import step_one

METHODS = [
    (targetconfig.TargetConfig, "__eq__"),
    (targetconfig.TargetConfig, "__hash__"),
    (types.functions.BaseFunction, "get_call_type"),
]


def whose() -> set[str]:
    """Packages that Numba's methods are of, and whether garbage is collected."""
    packages = {getattr(owner, name).__module__.partition(".")[0] for owner, name in METHODS}
    return packages | ({"collects"} if gc.isenabled() else set())


NUMBA_ALONE, OURS = {"numba", "collects"}, {"cutenv"}


@pytest.fixture
def unkept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels that the tests make are compiled each time."""
    monkeypatch.setattr(cutenv._engine.jit, "kernel_folder", lambda *_, **__: None)


def calling(watch: Callable[[], Any]) -> Callable[[], int]:
    """A function not compiled yet, during whose compilation ``watch`` is called."""

    def watched() -> int:
        return 1

    @numba.extending.overload(watched)
    def type_of_watched() -> Callable[[], int]:
        watch()
        return lambda: 1

    def kernel() -> int:
        return watched()

    return kernel


@pytest.fixture
def handler() -> Iterator[Any]:
    """The handler of Ctrl-C, which the test must leave as it is."""
    before = signal.getsignal(signal.SIGINT)
    yield before
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.usefixtures("unkept", "handler")
def test_numbas_methods_are_its_own_before_and_after_a_kernel_of_ours_compiles() -> None:
    seen: list[set[str]] = []
    doors = (numba.njit, njit, numba.njit)
    assert [door(calling(lambda: seen.append(whose())))() for door in doors] == [1, 1, 1]
    assert seen == [NUMBA_ALONE, OURS, NUMBA_ALONE]
    assert whose() == NUMBA_ALONE


@pytest.mark.usefixtures("unkept", "handler")
def test_another_thread_compiles_by_numba_alone_although_a_kernel_of_ours_is_compiling() -> None:
    seen: list[set[str]] = []
    other = threading.Thread(target=numba.njit(calling(lambda: seen.append(whose()))))

    def meanwhile() -> None:
        other.start()
        other.join(0.1)  # it waits for Numba's lock
        seen.append(whose())

    assert njit(calling(meanwhile))() == 1
    other.join()
    assert seen == [OURS, NUMBA_ALONE]


@pytest.mark.usefixtures("unkept", "handler")
def test_what_a_kernel_of_others_calls_of_ours_changes_nothing_for_itself() -> None:
    seen: list[set[str]] = []
    ours, after = njit(calling(lambda: seen.append(whose()))), calling(lambda: seen.append(whose()))
    then = numba.njit(after)
    assert numba.njit(lambda: ours() + then())() == 2
    assert seen == [OURS, NUMBA_ALONE]


@pytest.mark.usefixtures("unkept", "handler")
def test_a_kernel_of_ours_that_does_not_compile_leaves_numba_as_it_was() -> None:
    with pytest.raises(numba.errors.TypingError):
        njit(lambda: undefined_name)()  # type: ignore[name-defined]  # noqa: F821
    assert whose() == NUMBA_ALONE


@pytest.mark.usefixtures("unkept")
@pytest.mark.parametrize(("door", "waits"), [(numba.njit, False), (njit, True)])
def test_ctrl_c_waits_until_a_kernel_of_ours_is_compiled_and_for_no_other(door: Any, waits: bool, handler: Any) -> None:
    waited: list[bool] = []

    def press() -> None:
        signal.raise_signal(signal.SIGINT)
        waited.append(True)

    kernel = door(calling(press))
    with pytest.raises(KeyboardInterrupt):
        kernel()
    assert bool(waited) is waits
    assert bool(kernel.signatures) is waits


def test_ctrl_c_does_not_wait_for_the_other_functions_that_a_kernel_calls(handler: Any) -> None:
    late, went_on = LateInterrupt(), []

    def compile_kernel() -> None:
        with late:
            with late:
                signal.raise_signal(signal.SIGINT)
            went_on.append(True)

    with pytest.raises(KeyboardInterrupt):
        compile_kernel()
    assert not went_on


def test_ctrl_c_while_a_kernel_compiles_obeys_a_handler_of_ones_own(handler: Any) -> None:
    told: list[int] = []
    signal.signal(signal.SIGINT, lambda number, frame: told.append(number))
    try:
        with LateInterrupt():
            signal.raise_signal(signal.SIGINT)
            assert not told
        assert told == [signal.SIGINT]
    finally:
        signal.signal(signal.SIGINT, handler)


def test_steps_of_an_environment_leave_nothing_of_ours_in_numba() -> None:
    use = (
        "import signal, numba\n"
        "from numba.core import event, targetconfig, types\n"
        "def all_of_it():\n"
        "    owners = targetconfig.TargetConfig, types.functions.BaseFunction, numba.core.dispatcher.Dispatcher\n"
        "    listeners = {kind: list(heard) for kind, heard in event._registered.items() if heard}\n"
        "    return [dict(vars(owner)) for owner in owners], listeners, signal.getsignal(signal.SIGINT)\n"
        "before = all_of_it()\n"
        "import gymnasium, cutenv\n"
        "env = gymnasium.make('cutenv/GentleCut-v1'); env.reset(seed=0); env.step(env.action_space.high)\n"
        "assert all_of_it() == before\n"
    )
    subprocess.run([sys.executable, "-c", use], check=True)


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
