"""Kernels of other packages are compiled by Numba alone, whatever this package does to compile its own faster."""

from __future__ import annotations

import gc
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import numba
import numba.extending
import pytest
from numba.core import targetconfig, types

import cutenv._engine.jit
from cutenv._engine.jit import njit
from cutenv._engine.shortcuts import LateInterrupt

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
