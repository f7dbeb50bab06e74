"""The code of every page runs in its order with what that page has installed by then, and prints what it shows."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from only_installed import environment
from page_code import PAGES, Code, code_of

WORKER = """
import contextlib, io, json, os, sys, traceback, types

answers, sys.stdout = sys.stdout, sys.stderr
for line in sys.stdin:
    task = json.loads(line)
    os.chdir(task["folder"])
    printed, failed = io.StringIO(), ""
    module = types.ModuleType("__main__")  # a name of its own for every block: none lives on another's imports
    try:
        with contextlib.redirect_stdout(printed):
            exec(compile(task["code"], task["name"], "exec"), module.__dict__)
    except BaseException:
        failed = traceback.format_exc()
    print(json.dumps({"printed": printed.getvalue(), "failed": failed}), file=answers, flush=True)
"""


class Worker:
    """One process that runs blocks: imports and compiled code, most of their time, are then paid for once."""

    def __init__(self, folder: Path, installed: frozenset[str]) -> None:
        variables = environment(folder, installed) | {"MINARI_DATASETS_PATH": str(folder / "datasets")}
        self.process = subprocess.Popen(
            [sys.executable, "-c", WORKER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=variables
        )

    def run(self, code: str, name: str, folder: Path) -> str:
        """Run a block in a folder, and return what it prints."""
        task = json.dumps({"code": code, "name": name, "folder": str(folder)})
        self.process.stdin.write(task + "\n")
        self.process.stdin.flush()
        answer = json.loads(self.process.stdout.readline())
        assert not answer["failed"], answer["failed"]
        return answer["printed"]

    def end(self) -> None:
        self.process.kill()
        self.process.communicate()


@pytest.fixture(scope="session")
def worker(tmp_path_factory: pytest.TempPathFactory):
    """Return the worker of what is installed."""
    workers: dict[frozenset[str], Worker] = {}

    def of(installed: frozenset[str]) -> Worker:
        if installed not in workers:
            workers[installed] = Worker(tmp_path_factory.mktemp("installed"), installed)
        return workers[installed]

    yield of
    for each in workers.values():
        each.end()


def test_what_is_not_installed_is_missing_in_a_process_and_its_children(tmp_path: Path, worker) -> None:
    code = """
import importlib.util, matplotlib, subprocess, sys
print(importlib.util.find_spec("torch"))
child = subprocess.run([sys.executable, "-c", "import meshcat"], capture_output=True, text=True)
print(child.stderr.splitlines()[-1])
"""
    printed = worker(frozenset({"cutenv[view]"})).run(code, "a block", tmp_path)
    assert printed.splitlines() == ["None", "ModuleNotFoundError: No module named 'meshcat'"]


def python_of(page: str) -> list[Code]:
    return [block for block in code_of(page) if block.language == "python" and not block.marked]


@pytest.mark.parametrize("page", [page for page in PAGES if python_of(page)])
def test_the_python_of_a_page_runs_with_what_the_page_installs(page: str, tmp_path: Path, worker) -> None:
    for number, block in enumerate(python_of(page)):
        printed = worker(block.installed).run(block.text, f"{page}, block {number}", tmp_path)
        beginning = block.prints.rstrip().removesuffix("...")
        assert printed.startswith(beginning), f"{page} shows: {block.prints}"
