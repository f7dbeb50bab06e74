"""In real time, on an emulated rig in a process of its own: every fault stops the blade, at once, and it stays stopped.

``scripts/validation/rig/rig_faults.py`` makes many trials of each, and prints the table; here is one of each. Those
that every run makes need wires, or a process that ends. Of the others the two halves are tested on a clock moved by
hand: what the emulator then does (tests/emulation/test_emulator_faults.py), and what the rig makes of it
(test_every_fault_stops.py, test_cross_axes.py).
"""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from cutenv.emulation.emulated_bench import FAULTS
from cutenv.emulation.process import start
from cutenv.records import load_one
from cutenv.rig.toml_file import to_toml
from scripts.validation.rig import rig_faults, rig_trials
from scripts.validation.rig.cross_trials import CROSS_FAULTS

ATTEMPTS = 3  # at a trial that the host has delayed


def test_after_kill_9_the_blade_is_stopped_and_the_record_holds_the_cut_up_to_then(tmp_path):
    with start(free_air=True, angle_deg=90.0) as emulator:
        rig = tmp_path / "rig.toml"
        rig.write_text(to_toml(dataclasses.replace(emulator.settings, depth_profile=((0.0, 0.02), (0.15, 0.02)))))
        for trial in range(20):  # a busy host may stop a cut, and the kill then finds nobody cutting
            records = tmp_path / f"records-{trial}"
            killed = kill_while_cutting(rig, emulator.control.port, records)
            time.sleep(0.5)
            events = emulator.control.events()
            truth = emulator.control.truth()
            assert abs(truth["speed_m_s"]) < 1e-5
            rests = [event["time_s"] for event in events if event["what"] == "standstill"]
            assert rests[-1] < killed + 0.4
            cut = load_one(max(records.glob("*.csv")))
            if cut.metadata.get("truncated"):
                break
    assert cut.metadata["truncated"]
    assert cut.time[-1] > 0.5
    assert np.diff(cut.time) == pytest.approx(0.001)
    assert abs(cut.position[-1] - truth["position_m"]) < 0.0127 * 1.2


def kill_while_cutting(rig: Path, port: int, records: Path) -> float:
    """Cut in a process of its own, kill it 2 s after a cut began, and return when, by the monotonic clock [s]."""
    arguments = [sys.executable, "-c", CUT, str(rig), str(port), str(records)]
    process = subprocess.Popen(arguments, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "cutting\n"
        time.sleep(2.0)
        os.kill(process.pid, signal.SIGKILL)
        return time.monotonic()
    finally:
        process.kill()
        process.wait()
        process.stdout.close()


@pytest.fixture(scope="module")
def trials() -> Iterator[Callable[[str], rig_faults.Trials]]:
    """Trials on a kind of rig, whose emulator ends before another kind's begins: each takes a third of a processor."""
    made: list[rig_faults.Trials] = []

    def on(kind: str) -> rig_faults.Trials:
        if not made or made[0].kind != kind:
            close()
            made.append(rig_faults.Trials(kind=kind))
        return made[0]

    def close() -> None:
        while made:
            made.pop().close()

    yield on
    close()


def test_every_fault_of_the_emulator_has_its_expected_causes():
    across = {fault.emulated for faults in CROSS_FAULTS.values() for fault in faults.values()}
    assert set(rig_trials.EXPECTED) | across == {*FAULTS, *rig_trials.GAPS, *rig_trials.OWN}
    for axis, faults in CROSS_FAULTS.items():
        assert set(faults) == set(rig_trials.EXPECTED_ACROSS[axis])


def calm_trial(trials: rig_faults.Trials, fault: str) -> rig_trials.Trial:
    """A trial in which the host did not stall, or the last of ATTEMPTS.

    A late detection is tried again, too: delays of several threads, each too short to count as a stall, add up.  That
    the times are kept on a host without any is tested on a clock moved by hand (test_every_fault_stops.py).
    """
    random = np.random.default_rng(list(fault.encode()))
    for _ in range(ATTEMPTS):
        done = trials.one(fault, random)
        if not done.stalls and done.late is None:
            break
    return done


IN_ORDER = sorted(rig_trials.EXPECTED, key=lambda fault: (fault in rig_trials.IN_CHILD, fault == "slip"))
OF_WIRES = (
    "bus_gap", "ctrl_c", "doubled_frames", "exception", "heartbeat_lost", "kill_9", "latency", "over_force",
    "parent_death", "power_loss", "second_master",
)  # fmt: skip
"""Those of every run; of the two signals that end a program, which test_guard.py sends, one."""
OF_WIRES_ACROSS = {
    "height": ("no answer", "power loss", "quick stop not obeyed", "cannot be raised"),
    "side": ("quick stop not obeyed", "force to the side"),
}
"""Those of every run; a drive that is silent is the same to the rig whichever axis across the cut it moves."""


def some(faults, of_every_run):
    """The faults as cases, the others marked slow."""
    return [pytest.param(each, marks=() if each in of_every_run else pytest.mark.slow) for each in faults]


@pytest.mark.parametrize("fault", some(IN_ORDER, OF_WIRES))
def test_it_is_found_out_stopped_and_stays_stopped(trials, fault):
    assert calm_trial(trials(""), fault).wrong() == []


@pytest.mark.parametrize(
    ("axis", "fault"),
    [
        pytest.param(axis, *each.values, marks=each.marks)
        for axis, of_every_run in OF_WIRES_ACROSS.items()
        for each in some(CROSS_FAULTS[axis], of_every_run)
    ],
)
def test_a_fault_of_an_axis_across_the_cut_is_found_out_and_stops_both(trials, axis, fault):
    assert calm_trial(trials(axis), fault).wrong() == []


def told(**changes):
    well = {
        "fault": "over_force", "seed": 0, "injected": 10.0, "speed": 0.015, "cause": "force limit", "stated": 0.011,
        "detected": 10.010, "received": 10.011, "standstill": 10.030, "refused": True, "moved": 1e-6, "stalls": [],
    }  # fmt: skip
    return rig_trials.Trial(**{**well, **changes})


def test_a_trial_in_which_all_is_well_is_as_promised():
    assert told().wrong() == []


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"cause": "clock overrun"}, "the cause is"),
        ({"cause": None, "detected": None}, "does not come to rest"),
        ({"standstill": None}, "does not come to rest"),
        ({"refused": False}, "not latched"),
        ({"moved": 0.001}, "not latched"),
        ({"received": None}, "quick stop"),
        ({"received": 10.031}, "quick stop"),
        ({"detected": 10.025, "received": 10.026}, "found out after 25.0 ms"),
    ],
)
def test_a_trial_in_which_something_is_wrong_is_told(changes, says):
    assert any(says in why for why in told(**changes).wrong())


def test_a_stall_of_the_host_excuses_a_late_decision_but_no_late_stop():
    assert told(detected=10.2, received=10.201, standstill=10.22, stalls=[0.15]).wrong() == []
    assert told(received=10.2, standstill=10.22, stalls=[0.15]).wrong() != []


def test_a_rig_that_had_stopped_before_is_no_trial():
    assert told(detected=9.9).before
    assert told(speed=0.0).before
    assert not told().before


def test_a_force_that_is_the_tissues_own_is_no_trial_of_another_fault():
    assert told(fault="packet_loss", cause="force limit", crossed=10.001).before
    assert not told(fault="packet_loss", cause="force limit").before  # nothing passed the limit: a wrong cause
    assert not told(fault="over_force", cause="force limit", crossed=10.001).before


CUT = """
import sys
from cutenv.envs.rig_cut import RigCutEnv
from cutenv.rig.safety.stop_causes import RigStopped
from cutenv.emulation.control_port import EmulatorControl
from cutenv.rig.operation.operator import AutomaticOperator
from cutenv.rig.toml_file import read_rig_file

class LaysSpecimens(AutomaticOperator):
    def ask_ready(self, what):
        EmulatorControl(int(sys.argv[2])).specimen(seed=3)
        return True

rig = sys.argv[1]
env = RigCutEnv(rig=rig, operator=LaysSpecimens(read_rig_file(rig)), records=sys.argv[3], target_length=0.1)

def reset():
    for _ in range(20):  # a busy host may stop the rig while it is made ready
        try:
            return env.reset(seed=3)
        except RigStopped as stop:
            print(stop, file=sys.stderr)
    sys.exit("the host was too busy twenty times")

reset()
print("cutting", flush=True)
while True:
    if env.step([0.625, 1.0])[2]:
        reset()
"""


def test_time_counts_from_the_fault_that_stops_the_blade():
    deaf, silent = ({"what": "fault injected", "fault": fault} for fault in ("deaf", "silent"))
    assert rig_trials.last_injected([deaf, silent, {"what": "stall"}]) is silent
