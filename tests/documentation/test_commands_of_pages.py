"""The commands of every page run in their order with what that page has installed by then: minutes, so slow."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from given_files import give
from only_installed import environment, missing
from page_code import CONTRIBUTORS, PAGES, Code, code_of

OF_A_CHECKOUT = re.compile(r"python3? |\.venv|pipx? |\. |ls |export |cutenv warm")
"""Beginnings of commands that set up or take away, or that belong to a checkout or to another program."""
NOT_TO_THE_END = {
    r"play .*--device inverse3": "a device that is not there",
    r"serve (?!.*(--backup|--shortcut|--restore))": "a server, which runs until it is ended",
    r"(train|rig (?!init)).*my_rig": "a rig of one's own",
    r"rig emulate (?!.*--list-faults)": "an emulated rig, which runs until it is ended",
    r"rig run .*(emulated\.toml|--lsl)": "a rig or a stream of another program",
    r"record": "a stream of another program",
    r"rig speed cuts/RECORD": "a record of a rig of one's own",
    r"(evaluate|rig evaluate) .*--until decided": "takes minutes",
    r"evaluate (all|--report)": "takes minutes, or a training run of one's own",
    r"(depth|field) ": "films of one's own",
    r"score (rig.bag|specimen.xlsx)": "files of other programs",
    r"(score|view) .*--line": "a record of a cut in the plane",
}
"""Beginnings of commands that are stopped after some seconds, and why: until then nothing must be missing."""
SECONDS, MOST_SECONDS = 10.0, 900.0
TRIES = 2  # runs of a command that a busy machine stalls on a rig in real time, which then stops as it must


def short_training(line: str) -> str:
    """Options with which a training takes some seconds, of those that its learner takes."""
    options = "--validations=1 --validation-specimens=3 --specimens=3 --environments=64"
    if "--learner bc" not in line:
        options += " --timesteps=20000"
    corrects = "--base script" in line or ("--task" in line and "--base none" not in line)  # and imitates nothing
    imitates_others = "--dataset" in line or "--demonstrations" in line
    return options if corrects or imitates_others else f"{options} --demonstrations=3000"


def commands_of(page: str) -> list[tuple[Code, list[str] | None]]:
    """Blocks of Python, and every command of every block of commands, in their order."""
    found: list[tuple[Code, list[str] | None]] = []
    for block in code_of(page):
        if block.language == "python" and block.marked in ("", "after the commands"):
            found.append((block, None))
        if block.language == "bash" and block.marked != "not checked":
            found += [(block, words) for words in block.commands() if not OF_A_CHECKOUT.match(" ".join(words))]
    return found


def shortened(words: list[str], folder: Path) -> list[str]:
    """The same command with fewer specimens and decisions, an agent that there is, and patterns as files."""
    line = shlex.join(words)
    line = re.sub(r"--(specimens|cuts) (\d+)", lambda found: f"--{found[1]} {min(3, int(found[2]))}", line)
    if line.startswith("cutenv demo") and "--specimens" not in line:
        line += " --specimens 3"
    if line.startswith("cutenv train"):
        line += f" {short_training(line)}"
    if line.startswith("cutenv play") and "--device" not in line and "--scripted" not in line:
        line += " --scripted"
    runs = sorted(folder.glob("runs/*/policy"), key=lambda path: path.stat().st_mtime)
    agent = runs[-1].parent.relative_to(folder).as_posix() if runs else "runs/NAME"
    line = line.replace("runs/NAME", agent)
    line = re.sub(r"runs/NAME(/policy)?", "ppo-free", line)
    found = []
    for word in shlex.split(line):
        files = sorted(path.relative_to(folder).as_posix() for path in folder.glob(word)) if "*" in word else []
        found += files or [word]
    return found


def run(words: list[str], folder: Path, variables: dict[str, str], seconds: float) -> tuple[int | None, str]:
    """Exit status, None if it was stopped when its time was over, and all that it printed."""
    variables = variables | {"BROWSER": "true", "SDL_VIDEODRIVER": "dummy", "SDL_AUDIODRIVER": "dummy"}
    program = subprocess.Popen(
        words, cwd=folder, env=variables, text=True, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, start_new_session=True,
    )  # fmt: skip
    try:
        printed, _ = program.communicate(timeout=seconds)
    except subprocess.TimeoutExpired:
        os.killpg(program.pid, signal.SIGKILL)  # what it has started, too
        return None, program.communicate()[0]
    return program.returncode, printed


def stopped(words: list[str]) -> bool:
    return any(re.match(pattern, " ".join(words[1:])) for pattern in NOT_TO_THE_END)


USERS_PAGES = [page for page in PAGES if not page.startswith(CONTRIBUTORS) and any(w for _, w in commands_of(page))]


@pytest.mark.slow
@pytest.mark.flaky(reruns=0)  # a command alone is run again, not the page
@pytest.mark.parametrize("page", USERS_PAGES)
def test_the_commands_of_a_page_run_with_what_the_page_installs(
    page: str, tmp_path: Path, pytestconfig: pytest.Config
) -> None:
    stalled = "|".join(pytestconfig.getoption("only_rerun"))
    reader, hooks = tmp_path / "reader", tmp_path / "hooks"
    reader.mkdir()
    give(page, reader)
    kept = {"MINARI_DATASETS_PATH": str(tmp_path / "datasets"), "HF_LEROBOT_HOME": str(tmp_path / "lerobot")}
    wrong, late = [], []
    for block, words in commands_of(page):
        variables = environment(hooks, block.installed) | kept
        if words is None:
            name, command, to_its_end = "Python", [sys.executable, "-c", block.text], True
        else:
            words = [word for word in words if not re.match("[A-Z_]+=", word)]
            name, to_its_end = shlex.join(words), not stopped(words)
            command = [sys.executable, str(hooks / "cutenv-command"), *shortened(words, reader)[1:]]
        for _ in range(TRIES):
            begun, before = time.monotonic(), {*reader.glob("cuts/*")}
            status, printed = run(command, reader, variables, MOST_SECONDS if to_its_end else SECONDS)
            print(f"{time.monotonic() - begun:.0f} s, ended with {status}: {name}", flush=True)
            if status == 0 or not re.search(stalled, printed):
                break
            for path in {*reader.glob("cuts/*")} - before:  # too short for what is done with cuts
                path.unlink()
        else:
            late.append(name)
            continue
        if missing(printed):
            wrong.append(f"{name}: {missing(printed)[0]}")
        elif to_its_end and status != 0:
            wrong.append(f"{name}: ended with {status}:\n{printed[-2000:]}")
        elif not to_its_end and status == 0:
            wrong.append(f"{name}: runs to its end within {SECONDS:g} s, so it need not be in NOT_TO_THE_END")
    assert not wrong, "\n".join(wrong)
    if late:
        pytest.skip(f"this machine is too busy for a rig in real time: {'; '.join(late)}")


def test_every_command_that_is_not_run_to_its_end_is_on_a_page() -> None:
    lines = [" ".join(words[1:]) for page in USERS_PAGES for _, words in commands_of(page) if words]
    assert [pattern for pattern in NOT_TO_THE_END if not any(re.match(pattern, line) for line in lines)] == []
    assert sum(any(re.match(pattern, line) for pattern in NOT_TO_THE_END) for line in lines) < len(lines) / 2
