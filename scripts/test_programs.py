#!/usr/bin/env python3
"""Programs and files that some tests need: what there is, and how to get the others. Needs nothing but Python.

usage: python3 scripts/test_programs.py            # list them
       python3 scripts/test_programs.py install    # install what Debian and npm have, where this is root; print groups
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
NPM = ROOT / ".npm"  # folder into which npm's packages are installed; git ignores it
RECORDS = ROOT.parent / "shared" / "data" / "scalpel_excision_forces.csv"  # recorded cuts of others
PATIENCE_S = 900  # longest time that an installer may take [s]


def npm_file(name: str) -> Path | None:
    """Return a file of an npm package, where NODE_PATH, the machine or :data:`NPM` has it; None if none does."""
    told = [Path(folder) for folder in os.environ.get("NODE_PATH", "").split(os.pathsep) if folder]
    folders = [*told, Path("/usr/local/lib/node_modules"), NPM / "node_modules"]
    return next((folder / name for folder in folders if (folder / name).is_file()), None)


def scorm_again() -> Path | None:
    """Return the runtime of SCORM by others."""
    return npm_file("scorm-again/dist/scorm12.min.js")


def axe_core() -> Path | None:
    """Return the checker of accessibility."""
    return npm_file("axe-core/axe.min.js")


def postgresql() -> str | None:
    """Return the folder of PostgreSQL's programs."""
    installed = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb")) if os.environ.get("PATH") else []
    initdb = str(installed[-1]) if installed else shutil.which("initdb")
    return None if initdb is None else str(Path(initdb).parent)


@contextmanager
def own_postgresql() -> Iterator[str]:
    """Run a PostgreSQL that listens on a socket in a folder alone; yield its address, as SQLAlchemy has it."""
    programs = postgresql()
    folder = Path(tempfile.mkdtemp(prefix="pg"))  # the path of a socket is at most 107 characters long
    somebody: dict[str, Any] = {}
    if os.geteuid() == 0:  # PostgreSQL refuses to run as root
        shutil.chown(folder, "postgres", "postgres")
        somebody = {"user": "postgres", "group": "postgres", "extra_groups": []}
    data = folder / "data"
    start = [f"{programs}/initdb", "-D", data, "-A", "trust", "-U", "postgres", "--no-sync"]
    subprocess.run(start, check=True, capture_output=True, cwd=folder, **somebody)
    run = [f"{programs}/postgres", "-D", data, "-k", folder, "-c", "listen_addresses=", "-c", "fsync=off"]
    server = subprocess.Popen(run, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, cwd=folder, **somebody)
    try:
        until = time.monotonic() + 60.0
        while subprocess.run([f"{programs}/pg_isready", "-h", folder], capture_output=True).returncode:
            assert time.monotonic() < until, "PostgreSQL does not begin"
            time.sleep(0.1)
        yield f"postgresql+psycopg://postgres@/postgres?host={folder}"
    finally:
        server.send_signal(signal.SIGINT)  # it would wait for whoever is still connected otherwise
        server.wait(60.0)
        shutil.rmtree(folder, ignore_errors=True)


@dataclass(frozen=True)
class Group:
    """Tests that need one program or file."""

    found: Callable[[], object]  # return the program, or None
    cure: str  # command that brings it
    debian: tuple[str, ...] = ()
    npm: tuple[str, ...] = ()


GROUPS = {  # programs and files by name
    "chromium": Group(lambda: shutil.which("chromium"), "apt-get install chromium", debian=("chromium",)),
    "firefox": Group(
        lambda: shutil.which("firefox-esr") or shutil.which("firefox"),
        "apt-get install firefox-esr",
        debian=("firefox-esr",),
    ),
    "postgresql": Group(postgresql, "apt-get install postgresql", debian=("postgresql",)),
    "gio": Group(lambda: shutil.which("gio"), "apt-get install libglib2.0-bin", debian=("libglib2.0-bin",)),
    "scorm-again": Group(scorm_again, "npm install --prefix .npm scorm-again@3.4.3", npm=("scorm-again@3.4.3",)),
    "axe-core": Group(axe_core, "npm install --prefix .npm axe-core@4.10.3", npm=("axe-core@4.10.3",)),
    "records": Group(
        lambda: RECORDS if RECORDS.is_file() else None, "the recorded cuts are not part of the repository: ask for them"
    ),
}


def missing() -> list[str]:
    """Return the names of the groups that this machine cannot run."""
    return [name for name, group in GROUPS.items() if group.found() is None]


def reason(name: str) -> str:
    """Return why the tests of a group are left out, and how to get it."""
    return f"needs {name}: {GROUPS[name].cure}"


def install() -> None:
    """Install what is missing, where this is root and the installers answer; what fails stays missing."""
    debian = [package for name in missing() for package in GROUPS[name].debian]
    if shutil.which("npm") is None and any(GROUPS[name].npm for name in missing()):
        debian.append("npm")
    if debian and hasattr(os, "geteuid") and os.geteuid() == 0 and shutil.which("apt-get"):
        quiet = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
        apt = ["apt-get", "-q", "-y", "-o", "Acquire::Retries=2", "-o", "DPkg::Lock::Timeout=120"]
        if _ran([*apt, "update"], quiet):
            _ran([*apt, "install", "--no-install-recommends", *debian], quiet)
    npm = [package for name in missing() for package in GROUPS[name].npm]
    if npm and shutil.which("npm"):
        _ran(["npm", "install", "--prefix", str(NPM), "--no-audit", "--no-fund", "--ignore-scripts", *npm])


def _ran(command: list[str], environment: dict[str, str] | None = None) -> bool:
    """Run an installer, whose words are shown only if it fails; return whether it succeeded."""
    try:
        done = subprocess.run(
            command, env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            text=True, errors="replace", timeout=PATIENCE_S,
        )  # fmt: skip
    except (OSError, subprocess.TimeoutExpired) as error:
        print(f"{command[0]} failed: {error}", file=sys.stderr)
        return False
    if done.returncode:
        print("\n".join(done.stdout.splitlines()[-8:]), file=sys.stderr)
    return done.returncode == 0


def main(arguments: list[str]) -> int:
    """List the groups, or install what is missing and print those that are there, for ``--installed``."""
    if arguments == ["install"]:
        install()
        for name in missing():
            print(f"left out: tests that need {name}; {GROUPS[name].cure}", file=sys.stderr)
        print(",".join(name for name in GROUPS if name not in missing()))
        return 0
    if arguments:
        print(__doc__)
        return 2
    for name, group in GROUPS.items():
        print(f"{name}: {'there' if group.found() is not None else f'missing; {group.cure}'}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
