"""Attacks by the policy, through the environment: wrong actions, late actions, exceptions, misuse."""

from __future__ import annotations

import contextlib
import math
import resource
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cutenv.envs.rig_cut import RigCutEnv
from cutenv.records import load_one
from cutenv.records.schema import RecordError
from cutenv.rig.errors import RigError
from cutenv.rig.safety.stop_causes import RigStopped
from scripts.validation.rig.attack_scene import Found, Scene
from scripts.validation.rig.cutting_rig import UPRIGHT

_GOOD = 30  # decisions before the policy misbehaves
_BAD = 100  # largest number of decisions after that
_ATTEMPTS = 5  # to start a cut
_RESETS = 5  # in a row, of one rig


_made: list[RigCutEnv] = []


def close_all() -> None:
    """Close the environments of all trials so far, also of those that were broken off."""
    while _made:
        with contextlib.suppress(RigError, OSError):
            _made.pop().close()


class _Cut:
    """A recorded cut on its own emulated rig, with the motion of the carriage as the emulator reports it."""

    def __init__(self, folder: str) -> None:
        self.folder = Path(folder)
        self.env = RigCutEnv(rig="emulator", specimen_class="uniform", target_length=0.08, records=folder)
        _made.append(self.env)
        for attempt in range(_ATTEMPTS):  # a busy machine stops the blade on its way
            try:
                self.env.reset(seed=attempt)
            except RigError:
                if attempt == _ATTEMPTS - 1:
                    raise
                continue
            if not any(self.env.step([0.625, 1.0])[2] for _ in range(_GOOD)):
                break
        else:
            raise RigError("the host has stopped each of its cuts")
        emulator = self.env._source.emulator
        assert emulator is not None
        self._control = emulator.control
        self.begun = self._position()

    def _position(self) -> float:
        return float(self._control.truth()["position_m"])

    def judged(self, *, stopped: str | None) -> Found:
        """Return what is wrong in the end: motion, another cause of the stop, an unreadable record."""
        supervisor, wrong = self.env.session.plant.supervisor, []
        seen = [str(supervisor.report)]
        cause = None if supervisor.report is None else supervisor.report.cause.value
        if stopped is not None and cause != stopped:
            wrong.append(f"stopped as {cause}, not {stopped}")
        time.sleep(0.2)
        rest = self._position()
        time.sleep(0.4)
        if stopped is not None and abs(self._position() - rest) > 1e-4:
            wrong.append("it moves on")
        seen.append(f"{1e3 * (rest - self.begun):.2f} mm")
        self.env.close()
        for file in self.folder.glob("*.csv"):
            try:
                load_one(file)
            except RecordError as error:
                wrong.append(f"its record: {error}")
        return wrong, seen


def _returned(action: Callable[[int], Any], stopped: str | None, *, wait: float = 0.0) -> Found:
    """Run a policy that returns these actions, each after a delay of ``wait`` [s]."""
    with tempfile.TemporaryDirectory() as folder:
        cut = _Cut(folder)
        try:
            for i in range(_BAD):
                if wait:
                    time.sleep(wait)
                if cut.env.step(action(i))[2]:
                    break
        except ValueError:
            pass
        return cut.judged(stopped=stopped)


def infinite() -> Found:
    """Return infinity as an action."""
    return _returned(lambda i: np.array([math.inf, 0.0]), "not a number")


def text() -> Found:
    """Return text as an action."""
    return _returned(lambda i: "forward", "not a number")


def alternating() -> Found:
    """Return full speed forward and backward in turn: every limit may stop it, and nothing may move then."""
    return _returned(lambda i: np.array([1.0 if i % 2 else -1.0, 1.0 if i % 2 else -1.0]), None)


def nearly_late() -> Found:
    """Take 15 of the 20 ms for each decision: a busy machine may stop it, an idle one should not."""
    return _returned(lambda i: np.array([0.475, 1.0]), None, wait=0.015)


def late() -> Found:
    """Take 100 ms for a decision."""
    return _returned(lambda i: np.array([0.475, 1.0]), "clock overrun", wait=0.1)


def raising() -> Found:
    """Raise an exception that nothing catches."""
    with tempfile.TemporaryDirectory() as folder:
        cut = _Cut(folder)
        try:
            with cut.env.session:
                raise ZeroDivisionError("the policy's own")
        except ZeroDivisionError:
            pass
        supervisor = cut.env.session.plant.supervisor
        cause = None if supervisor.report is None else supervisor.report.cause.value
        wrong = [] if cause == "exception" else [f"stopped as {cause}"]
        cut.env.close()
        return wrong, [str(supervisor.report)]


def resetting() -> Found:
    """Reset the environment in the middle of a cut, and cut again."""
    with tempfile.TemporaryDirectory() as folder:
        cut = _Cut(folder)
        cut.env.reset(seed=5)
        cut.env.step([0.475, 1.0])
        return cut.judged(stopped=None)


def deleting_its_record() -> Found:
    """Delete the record of the cut: the blade stops, and nothing is promised about the record."""
    with tempfile.TemporaryDirectory() as folder:
        cut = _Cut(folder)
        for file in cut.folder.glob("*.csv"):
            file.unlink()
        told = ""
        try:
            for _ in range(_BAD):
                if cut.env.step([0.475, 1.0])[2]:
                    break
        except OSError as error:
            told = str(error)
        report = cut.env.session.plant.supervisor.report
        wrong = [] if report is not None and "record" in report.detail else [f"stopped as {report}"]
        if any("can be loaded" in message for message in (told, str(report))):
            wrong.append("it promises a record that was deleted")
        with contextlib.suppress(OSError):
            cut.env.close()
        return wrong, [str(report)]


def filling_the_disk() -> Found:
    """Fill the disk in the middle of a cut, so that the record cannot be continued."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    with tempfile.TemporaryDirectory() as folder:
        cut = _Cut(folder)
        written = max((file.stat().st_size for file in cut.folder.glob("*.csv")), default=0)
        resource.setrlimit(resource.RLIMIT_FSIZE, (written + 10_000, before[1]))
        try:
            for _ in range(_BAD):
                if cut.env.step([0.475, 1.0])[2]:
                    break
        except OSError:
            pass
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        report = cut.env.session.plant.supervisor.report
        wrong, seen = cut.judged(stopped=None)
        if report is None or "disk" not in report.detail:
            wrong.append(f"stopped as {report}")
        return wrong, seen


def resetting_at_rest() -> Found:
    """Pause the emulator for 45 ms while the blade rests, then reset the stop and request power at once."""
    wrong, seen = [], []
    with Scene() as scene:
        rig = scene.rig
        for again in range(_RESETS):
            rig.begin(again)
            pid = scene.emulator.pid
            subprocess.run(["sh", "-c", f"kill -STOP {pid}; sleep 0.045; kill -CONT {pid}"], check=True)
            try:
                rig.plant.advance(0.0, UPRIGHT, 100)
            except RigStopped as stop:
                seen.append(stop.report.cause.value)
            try:
                rig.plant.supervisor.reset(agreed=True)
                rig.plant.power()
            except RigError as error:  # at rest it may be too soon for once, and never for ever
                seen.append(str(error))
            try:
                rig.begin(again)
            except RigError as error:
                wrong.append(f"it cannot be used again: {error}")
                break
    return wrong, seen


POLICIES = (
    infinite, text, alternating, nearly_late, late, raising, resetting, deleting_its_record, filling_the_disk,
    resetting_at_rest,
)  # fmt: skip
