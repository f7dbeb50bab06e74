"""Run in about two minutes the tests that concern a change, with lint, form, types and layers.

    python3 scripts/start.py test --fast                   what differs from the branch main; on main, from its commit
    python3 scripts/start.py test --fast --since HEAD~3    what differs from a commit

A test file concerns a changed file that it imports or names (1); one that a file imports which it imports (2); one
whose name is part of its own, or whose folder has the name of its folder (3). They are taken in this order, shorter
ones first, until their seconds (tests/times.csv) fill two minutes; tests that take longer than ten seconds are left
out, and so is what has not begun when the time is over. The last lines say what was left out.
"""

from __future__ import annotations

import argparse
import ast
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

from scripts import ROOT, suite_times

TESTS = ROOT / "tests"
SOURCES = {"cutenv": ".", "scripts": ".", "agents": "agents", "tests": None}
"""Folders of modules, each with where their dotted names begin; a module of the tests is named by its file alone."""
LINT = [f"tests/packaging/test_habits.py::test_{what}" for what in (
    "lint_is_clean", "form_is_that_of_ruff_format", "types_are_strict_and_hold", "layers_import_downwards"
)]  # fmt: skip
LONGEST = 10.0  # [s]
BUDGET = 150.0  # of two processes [s]: the rest of four minutes is their start, lint and types
WITHIN = 90.0  # no test begins later than this after the first [s], should the machine be slow or the table old
SHORT = 0.05  # what a test takes that is in no table [s]
START = 1.0  # what a file takes to be imported [s]


def git(*arguments: str) -> list[str]:
    """Return the lines that git prints; none where it fails."""
    done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True)
    return done.stdout.splitlines() if done.returncode == 0 else []


def changed(since: str | None) -> list[Path]:
    """Return what differs from a commit or, without one, from where this branch left main; new files included."""
    base = since or "".join(git("merge-base", "HEAD", "main")) or "HEAD"
    names = git("diff", "--name-only", base) + git("ls-files", "--others", "--exclude-standard")
    return [ROOT / name for name in dict.fromkeys(names)]


@cache
def modules() -> dict[str, Path]:
    """Return the file of every module by the name that it is imported by; a package is its ``__init__``."""
    found = {}
    for folder, begin in SOURCES.items():
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT / begin if begin else path.parent).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


@cache
def imported_names(path: Path) -> dict[str, str]:
    """Return what a file imports anywhere in it, or names in quotes, each full name by the name that it has there."""
    names = {}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name: alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            names |= {alias.asname or alias.name: f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            if re.fullmatch(r"(cutenv|scripts)\.[\w.:]+", node.value):
                names[node.value] = node.value.replace(":", ".")
            elif program := re.fullmatch(r"(scripts/)?[\w/]*?(\w+)\.py", node.value):
                names[node.value] = node.value[:-3].replace("/", ".") if program[1] else program[2]
    return names


def file_of(name: str) -> Path | None:
    """Return the file that defines a full name; for one that a package took from a module, that module."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        path = modules().get(".".join(parts[:length]))
        if path is not None:
            taken = imported_names(path).get(parts[length]) if path.name == "__init__.py" and parts[length:] else None
            return path if taken is None or taken == name else file_of(taken)
    return None


@cache
def imports(path: Path) -> set[Path]:
    """Return the files that a file imports or names."""
    return {file for name in imported_names(path).values() if (file := file_of(name)) is not None}


@cache
def used(test: Path) -> set[Path]:
    """Return the files that a test imports, its helpers and fixtures among them, or that those import."""
    found: set[Path] = set()
    waiting = {test, *(path for path in [test.parent / "conftest.py"] if path.is_file())}
    while waiting:
        new = set().union(*(imports(path) for path in waiting), waiting) - found
        found |= new
        waiting = {path for path in new if TESTS in path.parents}
    return found


def nearness(test: Path, change: Path) -> tuple[int, bool] | None:
    """Return the steps from a test to what changed, and whether it lies elsewhere; None for a test of other things."""
    text, name = test.read_text(encoding="utf-8"), change.relative_to(ROOT)
    elsewhere = test.parent.name not in name.parent.parts
    if test == change:
        return 0, elsewhere
    if change in used(test) or (change.suffix != ".py" and name.name in text):
        return 1, elsewhere
    if any(change in imports(file) for file in used(test)):
        return 2, elsewhere
    named = f"_{change.stem}_" in f"{test.stem}_" or (change.suffix != ".py" and f'"{name.parts[0]}"' in text)
    return (3, elsewhere) if named or not elsewhere else None


def concerned(changes: list[Path]) -> list[Path]:
    """Return the test files that concern a change, the nearest first and of those the shortest."""
    ranks = {}
    for test in sorted(TESTS.rglob("test_*.py")):
        near = [rank for change in changes if (rank := nearness(test, change)) is not None]
        if near:
            ranks[test] = (min(near), seconds_of(test))
    return sorted(ranks, key=lambda test: ranks[test])


def seconds_of(test: Path) -> float:
    """Estimate what a file takes without the tests that are left out [s]."""
    prefix = f"{test.relative_to(ROOT).as_posix()}::"
    took = [max(seconds) for name, seconds in suite_times.read().items() if name.startswith(prefix)]
    others = test.read_text(encoding="utf-8").count("\ndef test_") - len(took)
    return START + SHORT * others + sum(seconds for seconds in took if seconds <= LONGEST)


def chosen(tests: list[Path], budget: float) -> list[Path]:
    """Return those that fit into a budget [s], each file whole."""
    taken = []
    for test in tests:
        if (seconds := seconds_of(test)) <= budget:
            taken.append(test)
            budget -= seconds
    return taken


def main(argv: list[str] | None = None) -> int:
    """Choose, run, and say what was left out."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--since", metavar="COMMIT", help="a commit to compare with; default: where main was left")
    options, passed_on = parser.parse_known_args(argv)
    changes = changed(options.since)
    tests = concerned(changes)
    run = chosen(tests, BUDGET)
    print(f"fast: {len(changes)} changed files concern {len(tests)} test files; {len(run)} of them run", flush=True)
    names = [path.relative_to(ROOT).as_posix() for path in run]
    limits = [f"--at-most={LONGEST:g}", f"--within={WITHIN:g}"]
    # Unlike "worksteal", "load" begins with the first tests in both processes.
    command = ["-m", "pytest", "-q", "-rfE", "-n", "2", "--dist", "load", *limits, *LINT, *names, *passed_on]
    status = subprocess.call([sys.executable, *command], cwd=ROOT)
    print(
        f"fast: left out {len(tests) - len(run)} test files for want of time, tests longer than {LONGEST:g} s, "
        "and what has nothing to do with the change; everything: python3 scripts/start.py test"
    )
    return status


if __name__ == "__main__":
    sys.exit(main())
