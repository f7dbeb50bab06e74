"""One way to run the tests everywhere: no window, one thread, repeatable examples, no quiet skip."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

os.environ.setdefault("MPLBACKEND", "Agg")
os.environ.setdefault("SDL_VIDEODRIVER", "dummy")
os.environ.setdefault("SDL_AUDIODRIVER", "dummy")
os.environ.setdefault("OMP_NUM_THREADS", "1")  # torch's pool beside Numba's is a hundred times slower

# A shell's background ignores Ctrl-C, and so would every program that a test starts and interrupts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Compiling a kernel takes seconds and falls on whichever example comes first.
settings.register_profile("repeatable", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("exploring", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("exploring" if os.environ.get("CUTENV_EXPLORE") else "repeatable")


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """One browser for every test of a page; one with 3-D graphics is another."""
    import chromium  # from scripts/, which a copy of this file elsewhere does not have

    with chromium.browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--allowed-skips", metavar="FILE", type=Path, help="fail on a skip that FILE does not list")
    parser.addoption("--installed", metavar="NAME,...", default="", help="programs for want of which nothing may skip")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test that needs a program which is not there; scripts/test_programs.py lists them."""
    for name in (name for mark in item.iter_markers("needs") for name in mark.args):
        import test_programs  # from scripts/, which a copy of this file elsewhere does not have

        if test_programs.GROUPS[name].found() is None:
            pytest.skip(test_programs.reason(name))


LATE = 0.02
"""Lateness of a thread from which this machine may have failed a test in real time [s]; a force is stale after it."""
REAL_TIME = tuple(Path(__file__).parent / name for name in ("rig", "agreement"))
"""Folders of tests in real time."""


class HostStalled(Exception):
    """Error raised for a test that failed while this machine stalled; pytest runs it again (pyproject.toml)."""


@contextmanager
def watched() -> Iterator[list[float]]:
    """Measure how late a thread is that should run every 2 ms; the list holds the largest lateness [s]."""
    worst, ended = [0.0], threading.Event()

    def watch() -> None:
        while not ended.is_set():
            begun = time.monotonic()
            ended.wait(0.002)
            worst[0] = max(worst[0], time.monotonic() - begun - 0.002)

    thread = threading.Thread(target=watch, name="host watch", daemon=True)
    thread.start()
    try:
        yield worst
    finally:
        ended.set()
        thread.join()


@pytest.hookimpl(wrapper=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> Any:
    """Tell a failure in real time on a machine that stalled from one on a machine that did not."""
    if not any(folder in pyfuncitem.path.parents for folder in REAL_TIME):
        return (yield)
    with watched() as worst:
        try:
            return (yield)
        except (Exception, pytest.fail.Exception) as error:
            if worst[0] < LATE:
                raise
            raise HostStalled(f"the host stalled for {1e3 * worst[0]:.0f} ms in this test, which failed") from error


def unlisted_skips(config: pytest.Config) -> list[str]:
    """Every skip without leave.

    A skip has leave if --allowed-skips names the test, which covers its parametrised cases, or if the test is marked to
    need a program that is not there; not one of --installed.
    """
    listing = config.getoption("--allowed-skips")
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if listing is None or reporter is None:
        return []
    lines = [line.partition("#")[0].strip() for line in listing.read_text(encoding="utf-8").splitlines()]
    allowed = tuple(line for line in lines if line)
    installed = tuple(f"needs {name}:" for name in config.getoption("--installed").split(",") if name)
    return sorted(
        nodeid
        for nodeid, reason in skips(reporter).items()
        if reason.startswith(installed)
        or not (reason.startswith("needs ") or any(nodeid == name or nodeid.startswith(f"{name}[") for name in allowed))
    )


def skips(reporter: pytest.TerminalReporter) -> dict[str, str]:
    """Reason of each skip, by the test."""
    found = {}
    for report in reporter.stats.get("skipped", []):
        where = report.longrepr
        reason = where[2] if isinstance(where, tuple) else str(where)
        found[report.nodeid] = reason.removeprefix("Skipped: ")
    return found


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    if session.exitstatus == pytest.ExitCode.OK and unlisted_skips(session.config):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    groups = Counter(reason for reason in skips(terminalreporter).values() if reason.startswith("needs "))
    for reason, count in sorted(groups.items()):
        name, _, cure = reason.removeprefix("needs ").partition(": ")
        terminalreporter.write_line(f"left out: {count} tests that need {name}; to run them: {cure}")
    for nodeid in unlisted_skips(config):
        terminalreporter.write_line(f"SKIPPED WITHOUT LEAVE {nodeid}", red=True)
