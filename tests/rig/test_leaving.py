"""A rig is left at once and cleanly by another thread and by a signal's handler; a forked child cannot speak for it."""

from __future__ import annotations

import os
import signal
import threading
import time
from typing import Any

import pytest
from waiting import until

from cutenv.envs.rig_cut import RigCutEnv
from cutenv.records import load_one
from cutenv.records.appending import AppendingRecord
from cutenv.rig.safety.stop_causes import Cause
from cutenv.sim.trace import Reading


def made_env(**arguments: Any) -> RigCutEnv:
    env = RigCutEnv(rig="fake", specimen_class="uniform", target_length=0.06, **arguments)
    env.reset(seed=1)
    for _ in range(20):
        env.step([0.625, 1.0])
    return env


def during(env: RigCutEnv, happens: Any) -> None:
    """Have something happen in the middle of the next step: at its next look at the clock."""
    clock = env.session.plant.clock
    sleep = clock.sleep_until

    def once(moment: float) -> float:
        clock.sleep_until = sleep
        slept = sleep(clock.now() + 0.005)
        happens()
        return max(slept, sleep(moment))

    clock.sleep_until = once


def elsewhere(work: Any) -> None:
    """Do it in another thread, and pass on what it raises."""
    raised: list[BaseException] = []

    def run() -> None:
        try:
            work()
        except BaseException as error:  # for the one who waits
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join(30.0)
    assert not thread.is_alive()
    if raised:
        raise raised[0]


def test_another_thread_closes_the_rig_while_a_step_runs(tmp_path):
    env = made_env(records=tmp_path)
    plant, handlers = env.session.plant, signal.getsignal(signal.SIGINT)
    assert handlers is not signal.default_int_handler
    during(env, lambda: elsewhere(env.close))
    before = plant.clock.now()
    _, _, ended, _, info = env.step([0.625, 1.0])
    assert plant.clock.now() - before < 0.5, "it waits for a rig that is left"
    assert ended
    assert info["end"] == "stopped"
    assert info["stop"]["cause"] == Cause.OPERATOR
    with pytest.raises(Exception, match="no cut is going on"):
        env.step([0.625, 1.0])
    assert load_one(env.records[-1]).metadata["stop"]["cause"] == Cause.OPERATOR
    env.close()


def test_signals_are_answered_as_before_once_another_thread_has_left_the_rig():
    """Python lets only the main thread set handlers: what is left in place passes the signal on."""
    got = []
    before = signal.signal(signal.SIGTERM, lambda number, frame: got.append(number))
    try:
        env = made_env()
        elsewhere(env.close)
        os.kill(os.getpid(), signal.SIGTERM)
        until(lambda: got)
        with pytest.raises(KeyboardInterrupt):
            interrupt_oneself()
    finally:
        signal.signal(signal.SIGTERM, before)
        signal.signal(signal.SIGINT, signal.default_int_handler)


def interrupt_oneself() -> None:
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(5.0)


@pytest.mark.parametrize("then", ["returns", "exits"])
def test_a_signals_handler_closes_the_rig_while_a_step_runs(then, tmp_path):
    """It runs in the middle of whatever the step does, perhaps under a lock: what it asks for is done by others."""
    env = made_env(records=tmp_path)
    plant = env.session.plant

    def handle() -> None:
        with plant.supervisor._lock:  # as a command has it that is interrupted
            env.close()
        until(lambda: plant.supervisor.phase == "stopped")
        if then == "exits":
            raise SystemExit(3)

    during(env, handle)
    if then == "exits":
        with pytest.raises(SystemExit):
            env.step([0.625, 1.0])
    else:
        _, _, ended, _, info = env.step([0.625, 1.0])
        assert (ended, info["end"], info["stop"]["cause"]) == (True, "stopped", Cause.OPERATOR)
    assert env._session is None
    assert plant.supervisor.report.cause is Cause.OPERATOR
    assert len(env.records) == 1
    load_one(env.records[0])


def test_a_handler_that_closes_the_rig_while_it_is_prepared_ends_that():
    env = RigCutEnv(rig="fake", specimen_class="uniform")

    class Handler:
        asked = 0

        def tell(self, message: str) -> None:
            pass

        def confirm(self, question: str, *, expected: str | None = None) -> bool:
            env.close()  # as from a signal, in the middle of the preparation
            raise AssertionError("it goes on")

        ask_ready = confirm

    env._source._operator = Handler()
    with pytest.raises(KeyboardInterrupt):
        env.reset(seed=1)
    assert env._session is None


def in_a_fork(work: Any) -> str:
    """Do it in a forked child; what it raises, or "done"."""
    read, write = os.pipe()
    child = os.fork()
    if not child:
        try:
            work()
            told = "done"
        except BaseException as error:  # told to the parent
            told = f"{type(error).__name__}: {error}"
        os.write(write, told.encode())
        os._exit(0)
    os.close(write)
    with os.fdopen(read) as pipe:
        told = pipe.read()
    os.waitpid(child, 0)
    return told


FORKS = pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")


@FORKS
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_child_neither_moves_nor_closes_the_rig_nor_touches_its_record(tmp_path):
    env = made_env(records=tmp_path)
    released = []
    env.session._stack.callback(lambda: released.append(os.getpid()))
    plant, rows = env.session.plant, env._source._record.rows
    assert in_a_fork(env.close) == "done"
    for forbidden in (
        lambda: env.step([0.625, 1.0]),
        lambda: env.reset(seed=2),
        lambda: plant.advance(0.01, 1.5, 20),
        lambda: plant.travel(0.0, speed=0.005),
        env.session.end_cut,
    ):
        assert "RigError" in (told := in_a_fork(forbidden)), told
        assert "fork" in told
    in_a_fork(plant.close)
    in_a_fork(env.session.close)
    (part,) = tmp_path.glob("*.csv")
    assert load_one(part).metadata["truncated"] is True
    assert len(load_one(part).time) == rows
    assert not env.step([0.625, 1.0])[2]
    env.close()
    assert load_one(env.records[0]).metadata["end"] == "closed"
    assert released == [os.getpid()]


@FORKS
@pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning")
def test_a_forked_child_cannot_write_into_a_record(tmp_path):
    record = AppendingRecord(tmp_path / "cut.csv")
    readings = [Reading(1e-3 * i, 0.0, 0.0, 0.0, 1.5, 0.01) for i in range(3)]
    record.append(readings[:2])
    assert "ValueError" in in_a_fork(lambda: record.append(readings[2:]))
    assert in_a_fork(record.close) == "done"
    assert load_one(record.path).metadata["truncated"] is True
    record.close()
    assert len(load_one(record.path).time) == 2
