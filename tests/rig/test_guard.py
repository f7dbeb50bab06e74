"""A program that ends badly stops the blade first: signals, exceptions, a dead parent; a real process for each."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from cutenv.rig.safety.oversight import guarded
from cutenv.rig.safety.stop_causes import Cause, RigStopped

HERE = Path(__file__).parent
UPRIGHT = 1.5707963
CHILD = """
import os, sys, time
sys.path.insert(0, {here!r})
from made_ready import ready_rig
from cutenv.rig.safety.stop_causes import RigStopped
from cutenv.rig.safety.oversight import guarded
rig = ready_rig()
supervisor = rig.plant.supervisor
say = lambda *words: os.write(1, (" ".join(words) + chr(10)).encode())  # whole lines, from two threads
begin = supervisor._quick_stops.begin
def begin_and_say():
    unreached = begin()
    say("stopped", supervisor.report.cause.value, supervisor.report.detail)
    return unreached
supervisor._quick_stops.begin = begin_and_say
with guarded(supervisor):
    say("ready")
    while True:
        try:
            rig.plant.advance(0.01 if rig.plant.position < 0.05 else -0.01, 1.57, 20)
        except RigStopped as stop:
            say("met", stop.report.cause.value)
            break
        time.sleep(0.002)
"""


def child(script: str = CHILD) -> subprocess.Popen:
    ran = subprocess.Popen(
        [sys.executable, "-c", script.format(here=str(HERE))], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert ran.stdout is not None
    assert ran.stdout.readline() == "ready\n"
    return ran


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.promise("S9")
def test_a_signal_stops_the_blade_before_the_program_ends(number):
    ran = child()
    time.sleep(0.1)
    ran.send_signal(number)
    out, err = ran.communicate(timeout=30)
    assert sorted(out.splitlines()) == ["met interrupted", f"stopped interrupted {number.name}"], err


def test_a_signal_that_meets_a_rig_locked_this_very_moment_ends_the_program_all_the_same(rig):
    supervisor = rig.plant.supervisor
    trip = supervisor.trip

    def late(*arguments):
        supervisor.lock()  # as between the handler's look and its thread's
        trip(*arguments)

    supervisor.trip = late

    def ended():
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(10.0)

    begun = time.monotonic()
    with pytest.raises(KeyboardInterrupt, match="SIGTERM"), guarded(supervisor):
        ended()
    assert time.monotonic() - begun < 5.0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes of another kind have no orphans to watch")
def test_the_death_of_the_parent_stops_the_blade(tmp_path):
    """A parent that starts the rig's process and is killed; what the orphan says goes to a file."""
    script = tmp_path / "orphan.py"
    script.write_text(CHILD.format(here=str(HERE)))
    told = tmp_path / "told.txt"
    parent = subprocess.Popen(
        [
            sys.executable,
            "-c",
            f"import subprocess, sys\nwith open({str(told)!r}, 'w') as out:\n"
            f"    subprocess.run([sys.executable, {str(script)!r}], stdout=out)",
        ]
    )
    deadline = time.monotonic() + 60.0
    while "ready" not in (told.read_text() if told.exists() else "") and time.monotonic() < deadline:
        time.sleep(0.05)
    parent.kill()
    parent.wait()
    while "met" not in told.read_text() and time.monotonic() < deadline:
        time.sleep(0.02)
    assert [line.split(" ")[:3] for line in told.read_text().splitlines()][1] == ["stopped", "parent", "death"]


FORGETFUL = """
import atexit
from cutenv.envs.rig_cut import RigCutEnv
atexit.register(lambda: print(env.session.plant.supervisor.report))  # registered first, it runs last
env = RigCutEnv(rig="fake", specimen_class="uniform", target_length=0.06)
env.reset(seed=1)
for _ in range(20):
    env.step([0.625, 1.0])
"""


@pytest.mark.promise("S9")
def test_a_program_that_ends_without_closing_its_rig_stops_the_blade_and_ends():
    done = subprocess.run([sys.executable, "-c", FORGETFUL], capture_output=True, text=True, timeout=60.0, check=True)
    assert "the program ended without closing the rig" in done.stdout


@pytest.mark.promise("S9")
def test_an_exception_stops_the_blade_and_goes_on(rig):
    rig.plant.advance(0.01, UPRIGHT, 200)
    with pytest.raises(ZeroDivisionError), guarded(rig.plant.supervisor):
        _ = 1 / 0
    assert rig.plant.supervisor.report.cause is Cause.EXCEPTION
    assert "ZeroDivisionError" in rig.plant.supervisor.report.detail
    with pytest.raises(RigStopped):
        rig.plant.advance(0.01, UPRIGHT, 20)


def test_a_signal_while_nothing_may_move_ends_the_program_at_once(rig):
    rig.plant.supervisor.lock()
    with pytest.raises(KeyboardInterrupt), guarded(rig.plant.supervisor):
        signal.raise_signal(signal.SIGINT)
    assert rig.plant.supervisor.report is None


def test_handlers_are_put_back(rig):
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    with guarded(rig.plant.supervisor):
        assert signal.getsignal(signal.SIGTERM) is not before[signal.SIGTERM]
    assert {number: signal.getsignal(number) for number in before} == before


def test_a_watchdog_that_fails_stops_the_blade(rig):
    rig.plant.advance(0.01, UPRIGHT, 200)
    rig.plant.supervisor._alive = None
    with pytest.raises(RigStopped, match="the watchdog failed"):
        rig.plant.advance(0.01, UPRIGHT, 200)
