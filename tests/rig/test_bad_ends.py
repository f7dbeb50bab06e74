"""Ends that come at a bad moment are told for what they are: between two looks, while nothing may move, at the exit."""

from __future__ import annotations

import gc
import math
from typing import Any

import pytest

from cutenv.envs.rig_cut import RigCutEnv
from cutenv.records import load_one
from cutenv.records.appending import AppendingRecord
from cutenv.rig.devices.loop import preferred
from cutenv.rig.devices.protocols import DriveState
from cutenv.rig.errors import RigError
from cutenv.rig.safety.stop_causes import Cause, RigStopped

UPRIGHT = math.pi / 2


@pytest.mark.parametrize("move", ["advance", "travel"])
def test_a_stop_between_the_look_and_the_command_is_told_as_a_stop(rig, move, monkeypatch):
    rig.plant.advance(0.01, UPRIGHT, 20)
    drive = rig.plant.supervisor.drive

    def too_late(*arguments: Any, **keywords: Any) -> float:
        rig.plant.supervisor.trip(Cause.OPERATOR, "at this very moment")
        return drive(*arguments, **keywords)

    monkeypatch.setattr(rig.plant.supervisor, "drive", too_late)
    with pytest.raises(RigStopped, match="very moment"):
        rig.plant.advance(0.01, UPRIGHT, 20) if move == "advance" else rig.plant.travel(0.0, speed=0.005)


def test_a_stop_while_the_blade_is_brought_to_rest_ends_the_waiting(rig, monkeypatch):
    for _ in range(20):
        rig.plant.advance(0.01, UPRIGHT, 20)

    def too_late(*arguments: Any, **keywords: Any) -> float:
        rig.plant.supervisor.trip(Cause.OPERATOR, "at this very moment")
        raise RigError("the blade may not move")

    monkeypatch.setattr(rig.plant.supervisor, "drive", too_late)
    rig.plant.halt()
    assert rig.plant.supervisor.phase == "stopped"


def test_who_sees_a_stop_sees_its_own_report(rig):
    supervisor = rig.plant.supervisor
    seen = []
    happens = supervisor._latch.happens

    def watched(event):
        seen.append(supervisor.report)
        return happens(event)

    supervisor._latch.happens = watched
    supervisor.trip(Cause.OPERATOR, "first")
    assert {report.detail for report in seen} == {"first"}


def made_env(**arguments: Any) -> RigCutEnv:
    env = RigCutEnv(rig="fake", specimen_class="uniform", target_length=0.06, **arguments)
    env.reset(seed=1)
    return env


@pytest.mark.parametrize("state", [DriveState.FAULT, DriveState.QUICK_STOP])
def test_a_drive_that_stopped_by_itself_between_cuts_is_reset_once_the_operator_agrees(state):
    env = made_env()
    session, fake = env.session, env.the_fake()
    session.plant.supervisor.lock()
    fake.blade.state = state
    fake.clock.sleep_until(fake.clock.now() + 0.02)
    with pytest.raises(RigError, match="not agreed"):
        session.plant.supervisor.reset(agreed=False)
    env.reset(seed=2)
    assert any(f'the blade drive went to "{state.value}" by itself' in asked for asked in session.operator.asked)
    assert not env.step([0.4, 1.0])[2]
    env.close()


def left_by_with(env: RigCutEnv, error: type[BaseException]) -> None:
    with env:
        raise error("the policy's own")


def left_by_finally(env: RigCutEnv, error: type[BaseException]) -> None:
    try:
        raise error("the policy's own")
    finally:
        env.close()


@pytest.mark.parametrize(
    ("error", "cause"), [(ZeroDivisionError, Cause.EXCEPTION), (KeyboardInterrupt, Cause.INTERRUPTED)]
)
@pytest.mark.parametrize("leave", [left_by_with, left_by_finally])
def test_what_ends_the_program_stops_the_blade_before_the_disk_is_waited_for(
    error, cause, leave, tmp_path, monkeypatch
):
    env = made_env(records=tmp_path)
    supervisor = env.session.plant.supervisor
    phases = []
    close = AppendingRecord.close

    def closed(self: AppendingRecord, *arguments: Any) -> None:
        phases.append(supervisor.phase)
        close(self, *arguments)

    monkeypatch.setattr(AppendingRecord, "close", closed)
    for _ in range(20):
        env.step([0.625, 1.0])
    with pytest.raises(error):
        leave(env, error)
    assert supervisor.report is not None
    assert supervisor.report.cause is cause
    assert phases == ["stopped"]
    assert load_one(env.records[0]).metadata["stop"]["cause"] == cause


def test_no_search_for_garbage_goes_through_all_that_is_loaded_while_a_rig_is_in_use():
    before = gc.get_freeze_count()
    with preferred():
        assert gc.get_freeze_count() > before + 10_000  # NumPy, SciPy, Numba
    assert gc.get_freeze_count() == 0
