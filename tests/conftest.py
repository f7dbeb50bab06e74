"""One way to run the tests everywhere: no window, one thread, repeatable examples, no quiet skip."""

from __future__ import annotations

import gc
import os
import signal
import sys
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

# Tests start some hundred programs, which should not translate the same modules each time.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# A shell's background ignores Ctrl-C, and so would every program that a test starts and interrupts.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# Compiling a kernel takes seconds and falls on whichever example comes first.
settings.register_profile("repeatable", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("exploring", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("exploring" if os.environ.get("CUTENV_EXPLORE") else "repeatable")


@pytest.fixture(scope="session")
def opened_chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """One Chromium for every test of a page; one with 3-D graphics is another."""
    from scripts.browsers import chromium  # from scripts/, which a copy of this file elsewhere does not have

    with chromium.browser(tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture
def browser(opened_chromium: Any) -> Iterator[Any]:
    """The browser, which leaves the page after the test."""
    yield opened_chromium
    opened_chromium.leave()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--allowed-skips", metavar="FILE", type=Path, help="fail on a skip that FILE does not list")
    parser.addoption("--installed", metavar="NAME,...", default="", help="programs for want of which nothing may skip")
    parser.addoption("--times", metavar="FILE", type=Path, help="write what the tests take to FILE; print the slowest")
    parser.addoption("--within", metavar="SECONDS", type=float, help="begin no test so long after the first")
    parser.addoption("--at-most", metavar="SECONDS", type=float, help="leave out those that tests/times.csv has longer")


FIRST = pytest.StashKey[float]()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test that needs a program which is not there (scripts/test_programs.py), or time that is over."""
    within, first = item.config.getoption("--within"), item.session.stash.setdefault(FIRST, time.monotonic())
    if within is not None and time.monotonic() - first >= within:
        pytest.skip("needs more time: python3 scripts/start.py test")
    for name in (name for mark in item.iter_markers("needs") for name in mark.args):
        from scripts import test_programs  # from scripts/, which a copy of this file elsewhere does not have

        if test_programs.GROUPS[name].found() is None:
            pytest.skip(test_programs.reason(name))


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out the tests that take longer than --at-most."""
    if config.getoption("--at-most") is None:
        return
    from scripts import suite_times  # from scripts/, which a copy of this file elsewhere does not have

    times = suite_times.read(Path(__file__).with_name("times.csv"))
    longer = {name for name, took in times.items() if max(took) > config.getoption("--at-most")}
    kept, left_out = [], []
    for item in items:
        (left_out if item.nodeid.partition("[")[0] in longer else kept).append(item)
    config.hook.pytest_deselected(items=left_out)
    items[:] = kept


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """Leave the tests and all that they import out of garbage collections, which would search them each time."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000)


BEGUN = pytest.StashKey[tuple[float, float]]()


def spent() -> tuple[float, float]:
    """Processor seconds of this process and of its ended children, and the clock on the wall [s]."""
    return sum(os.times()[:4]), time.monotonic()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Any:
    item.stash[BEGUN] = spent()
    return (yield)


def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]) -> None:
    """Tell what the whole test has taken, with its fixtures, to the process that sums up."""
    if call.when == "teardown":
        took = tuple(now - begun for now, begun in zip(spent(), item.stash[BEGUN], strict=True))
        item.user_properties.append(("took", took))


def taken(reporter: pytest.TerminalReporter) -> dict[str, tuple[float, float]]:
    """Processor and wall seconds of each test; of one that was run again, together."""
    ended = (report for reports in reporter.stats.values() for report in reports)
    return {
        report.nodeid: value
        for report in ended
        for name, value in getattr(report, "user_properties", ())
        if name == "took"
    }


LATE = 0.005
"""Lateness of a thread from which this machine may have failed a test in real time [s]; some hold times to 3 ms."""
REAL_TIME = tuple(Path(__file__).parent / name for name in ("rig", "drivers", "emulation", "agents/sim_to_real"))
"""Folders of tests in real time; in others it is said by the mark ``real_time``."""


class HostStalled(Exception):
    """Error raised for a test that failed while this machine stalled; pytest runs it again (pyproject.toml)."""


@contextmanager
def watched() -> Iterator[list[float]]:
    """Measure how late a thread is that should run every 2 ms; the list holds the largest lateness [s]."""
    worst, ended = [0.0], threading.Event()

    def watch() -> None:
        while not ended.is_set():
            begun = time.monotonic()
            time.sleep(0.002)  # costs less than to wait for the event, five hundred times a second
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
    marked = pyfuncitem.get_closest_marker("real_time") is not None
    if not marked and not any(folder in pyfuncitem.path.parents for folder in REAL_TIME):
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
    if file := config.getoption("--times"):
        from scripts import suite_times  # from scripts/, which a copy of this file elsewhere does not have

        rows = suite_times.summed(taken(terminalreporter))
        suite_times.write(file, rows)
        terminalreporter.write_line(f"{suite_times.tables(rows)}\n")
    groups = Counter(reason for reason in skips(terminalreporter).values() if reason.startswith("needs "))
    for reason, count in sorted(groups.items()):
        name, _, cure = reason.removeprefix("needs ").partition(": ")
        terminalreporter.write_line(f"left out: {count} tests that need {name}; to run them: {cure}")
    for nodeid in unlisted_skips(config):
        terminalreporter.write_line(f"SKIPPED WITHOUT LEAVE {nodeid}", red=True)
