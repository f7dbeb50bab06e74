"""One way to run the tests everywhere: no window, one thread, repeatable examples, no quiet skip."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
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


def unlisted_skips(config: pytest.Config) -> list[str]:
    """Every skipped test or file that --allowed-skips does not name; a name covers its parametrised cases."""
    listing = config.getoption("--allowed-skips")
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if listing is None or reporter is None:
        return []
    lines = [line.partition("#")[0].strip() for line in listing.read_text(encoding="utf-8").splitlines()]
    allowed = tuple(line for line in lines if line)
    skipped = {report.nodeid for report in reporter.stats.get("skipped", [])}
    return sorted(
        nodeid
        for nodeid in skipped
        if not any(nodeid == name or nodeid.startswith((f"{name}[", f"{name}::")) for name in allowed)
    )


@pytest.hookimpl(trylast=True)
def pytest_sessionfinish(session: pytest.Session) -> None:
    if session.exitstatus == pytest.ExitCode.OK and unlisted_skips(session.config):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    for nodeid in unlisted_skips(config):
        terminalreporter.write_line(f"SKIPPED WITHOUT LEAVE {nodeid}", red=True)
