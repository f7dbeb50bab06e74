"""Several tasks are trained side by side, each in a process of its own."""

import os
import signal
import subprocess
import sys
import time

import pytest
from program import run

from cutenv.agents.learning import side_by_side
from cutenv.agents.learning.side_by_side import Training, train_side_by_side
from cutenv.commands.train import main

SAYS = "import sys, time; print('began'); [print(f'\\rtraining:  {k}0%|# | 1/9 [00:01<00:09, 8cut/s, return 0.{k}, success 0.5]', end='', file=sys.stderr, flush=True) or time.sleep(0.2) for k in range(9)]; print('\\nscore 7')"  # noqa: E501


def test_what_each_prints_is_kept_together_and_told_when_it_ends_with_the_status_of_one_that_fails(capfd):
    fails = "import sys; print('no disk'); sys.exit(3)"
    commands = {"one": SAYS, "two": SAYS, "bad": fails}
    assert train_side_by_side({name: [sys.executable, "-c", code] for name, code in commands.items()}) == 3
    out, _ = capfd.readouterr()
    assert "no disk" in out
    first, *ends = out.split("\n== ")
    assert "one: " in first
    assert "two: " in first
    assert sorted(each.splitlines()[0] for each in ends) == ["bad", "one", "two"]
    for each in (each for each in ends if not each.startswith("bad")):
        assert "began" in each
        assert "score 7" in each
        assert "|#" not in each  # a bar is progress, which is no result


def test_progress_names_its_step_for_each_of_them_counts_from_zero():
    training = Training("one", [sys.executable, "-c", SAYS], cores=1)
    assert training.end() == 0
    assert training.progress == "training 80 %, return 0.8, success 0.5"


def test_they_share_the_cores_unless_the_number_is_set(capfd, monkeypatch):
    monkeypatch.setattr(side_by_side, "cores", lambda: 5)
    says = [sys.executable, "-c", "import os; print('threads', os.environ['CUTENV_CORES'])"]
    for wanted, threads in ((None, 2), ("3", 3)):
        if wanted:
            monkeypatch.setenv("CUTENV_CORES", wanted)
        assert train_side_by_side({"one": says, "two": says}) == 0
        assert capfd.readouterr().out.count(f"threads {threads}") == 2


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
def test_ctrl_c_reaches_every_training_and_is_waited_for(tmp_path):
    waits = (
        "import pathlib, sys, time\n"
        "try:\n    pathlib.Path(sys.argv[1]).touch(); time.sleep(60)\n"
        "except KeyboardInterrupt:\n    time.sleep(0.3); print('saved ' + sys.argv[1]); sys.exit(130)\n"
    )
    code = (
        "import sys\nfrom cutenv.agents.learning.side_by_side import train_side_by_side\n"
        f"sys.exit(train_side_by_side({{n: [sys.executable, '-c', {waits!r}, n] for n in ('first', 'second')}}))"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", code], cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    until = time.monotonic() + 60.0
    while not ((tmp_path / "first").exists() and (tmp_path / "second").exists()):
        assert time.monotonic() < until
        time.sleep(0.05)
    parent.send_signal(signal.SIGINT)
    out, errors = parent.communicate(timeout=60)
    assert parent.returncode == 130
    assert "saved first" in out
    assert "saved second" in out
    assert "Traceback" not in errors


def test_bad_options_are_refused_before_anything_starts(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["--task", "gentle", "excision", "--script", "return stroke"]) == 2
    assert "'return stroke' is for --task gentle" in capsys.readouterr().err
    assert main(["--task", "gentle", "path", "--resume", "runs/old"]) == 2
    assert "--resume continues one run" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_two_tasks_are_trained_from_one_command_line(tmp_path, monkeypatch):
    """By the commands one after the other; that they run side by side is told above."""

    def in_turn(commands):
        assert list(commands) == ["gentle", "excision"]
        for python, _, module, command, *given in commands.values():
            assert (python, module) == (sys.executable, "cutenv")
            done = run(command, tmp_path, *given)
            assert done.returncode == 0, done.stderr
        return 0

    monkeypatch.setattr(side_by_side, "train_side_by_side", in_turn)
    few = ["--quick", "--timesteps", "640", "--demonstrations", "0", "--base", "none", "--environments", "20"]
    few += ["--rollout", "32", "--batch-size", "320", "--validations", "1", "--validation-specimens", "2"]
    done = run("train", tmp_path, "--task", "gentle", "excision", *few, "--specimens", "0", "--name", "two")
    assert done.returncode == 0, done.stderr
    for task in ("gentle", "excision"):
        assert (tmp_path / "runs" / f"two-{task}" / "policy" / "card.json").is_file()
